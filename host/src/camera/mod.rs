//! Live frames: `keygraph camera`, and `keygraph train --from-camera`.
//!
//! In: a camera, or a file in place of one. Out: JSON lines, a page, messages to a broker.
//! Each thread waits only for the thread to its left:
//!
//! ```text
//! source ──newest frame──► search ──newest result──► painter ──► page, events
//!                             └────► standard output, broker
//! ```
//!
//! Standard output has a thread of its own: when nobody reads it, lines are dropped.
//!
//! A file uses only files above it:
//!
//! - [`mode`]: the modes of a camera, and which one to ask for
//! - [`mjpeg`]: a frame of Motion-JPEG as a JPEG
//! - [`guard`]: which requests are answered
//! - [`arguments`]: arguments of the commands
//! - [`slot`]: the newest item of a thread, for another
//! - [`damage`]: damaged frames
//! - [`pace`]: at most so many items a second
//! - [`repeated`]: messages that come again and again
//! - [`lines`]: JSON lines on standard output
//! - [`tally`]: numbers for those who watch the program
//! - [`replay`]: a file in place of a camera
//! - [`shelf`]: a folder that keeps models when the program ends
//! - [`entry`]: one model as it was given
//! - [`models`]: the models in use
//! - [`tracker`]: the states of objects
//! - [`sightings`]: when each object was seen last
//! - [`shot`]: a searched frame in the form that viewers get
//! - [`live`]: the search of the newest frame
//! - [`folder`]: changes of the files on the shelf
//! - `device`: cameras through V4L2 (with the feature `camera`, on Linux)
//! - [`lesson`]: training on an object in a frame
//! - [`attempts`]: attempts to guess the token
//! - [`intake`]: bodies of requests, and those who wait to train
//! - [`server`]: connections to the page
//! - [`feed`]: pictures for other programs
//! - [`web`]: the page
//! - [`mqtt`]: messages to a broker
//! - [`signals`]: the end of the program at a signal
//! - [`session`]: the threads beside the search
//!
//! Memory: a few frames; it does not grow. Cost: a search a frame, and one encoded JPEG a
//! frame while a viewer looks; another one while somebody wants outlines in it.

pub mod mode;
pub mod mjpeg;
pub mod guard;
pub mod arguments;
pub mod slot;
pub mod damage;
pub mod pace;
pub mod repeated;
pub mod lines;
pub mod tally;
pub mod replay;
pub mod shelf;
pub mod entry;
pub mod models;
pub mod tracker;
pub mod sightings;
pub mod shot;
pub mod space;
pub mod live;
pub mod folder;
#[cfg(all(feature = "camera", target_os = "linux"))]
pub mod device;
pub mod lesson;
pub mod attempts;
pub mod intake;
pub mod server;
pub mod feed;
pub mod web;
pub mod mqtt;
pub mod signals;
pub mod session;

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, mpsc};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, ensure};
use keygraph_core::DEFAULT_THRESHOLD;
use tracing::level_filters::LevelFilter;

use crate::camera::space::Space;
use crate::learn::{Learned, Plan};
use crate::notice::{has_colours, is_quiet};
use crate::output::{plain, print_line, write_file};
use crate::picture::Picture;
use crate::run::default_threads;
use crate::search::{Profile, Request, depth_of};
use arguments::{Arguments, Lesson};
use lesson::{Errand, learn};
use lines::Lines;
use live::{Live, Outcome, search_frames};
use models::Models;
use mqtt::broker::Broker;
use mqtt::fetch::Fetcher;
use mqtt::fleet::Fleet;
use session::{Page, Session};
use shelf::Shelf;
use slot::Slot;
use tracker::State;
use web::School;

/// Maximum time at the end of the program for answers that are still being sent.
const FAREWELL: Duration = Duration::from_secs(1);
/// The folder of ordered models in that of models.
const ORDERED: &str = "ordered";

/// A frame from the source.
#[derive(Debug)]
pub struct Captured {
    /// Index of the frame; frames that were dropped count too.
    pub number: u64,
    /// Time at which the frame arrived.
    pub at: Instant,
    /// The frame, decoded.
    pub picture: Picture,
    /// The frame as JPEG, when the camera gives JPEG.
    pub jpeg: Option<Vec<u8>>,
}

/// Runs `keygraph camera` until a signal or `--frames` stops it, or the source ends.
///
/// # Errors
/// When a model or the source cannot be read, or the page's address cannot be bound.
/// [`Unsuitable`](crate::region::Unsuitable) when the region does not suit the first frame.
pub fn camera(arguments: &Arguments) -> Result<()> {
    log_to_standard_error(arguments.log);
    if arguments.list {
        return session::list()?.iter().try_for_each(|line| print_line(line));
    }
    arguments.token.as_deref().map(guard::check_token).transpose()?;
    let space = Space::new(&arguments.camera)?;
    let shelf = arguments.folder.as_deref().map(Shelf::open).transpose()?;
    let models = Models::load(&arguments.models, shelf)?;
    let broker = Broker::from_arguments(&arguments.publishing)?;
    let fleet = arguments.publishing.mqtt_models.as_ref().map(|_| {
        let fetcher = Fetcher::new(arguments.publishing.mqtt_ca.as_deref())?;
        Fleet::open(arguments.folder.as_ref().map(|folder| folder.join(ORDERED)), fetcher)
    });
    let fleet = fleet.transpose()?;
    if let Some(fleet) = &fleet {
        fleet.resume(&models);
    }
    ensure!(
        arguments.web.is_some() || fleet.is_some() || models.merged().bytes.is_some(),
        "nothing to look for: give a model with -m (make one with `keygraph train`), or --web to learn objects on a page"
    );
    let live = Arc::new(Live::new(session::name_of(&arguments.origin), models, arguments.threshold));
    let (mut publisher, outlet) = broker.map(mqtt::channel).unzip();
    let page = arguments.web.map(|address| Page {
        address,
        token: arguments.token.clone(),
        public: arguments.public_url.clone(),
        school: School { plan: Plan { mirror: arguments.look.mirror, ..Plan::default() }, errand: None },
    });
    let mut lines = arguments.json.then(|| Lines::start(io::stdout())).transpose()?;
    let session = Session::start(&arguments.origin, &live, page, outlet.map(|outlet| (outlet, fleet)), 0)?;

    let mut left = arguments.frames;
    let mut diary = Diary::default();
    let wanted = Request {
        depth: depth_of(arguments.thorough),
        budget: arguments.budget_ms,
        min_visible: arguments.min_visible,
        shape: arguments.surface,
        region: arguments.look.roi,
        mirror: arguments.look.mirror,
        smooth: arguments.smooth.unwrap_or(0),
        threads: arguments.threads.map_or_else(default_threads, usize::from),
        ..Request::new(arguments.profile, arguments.threshold)
    };
    let searched = search_frames(&live, wanted, space, |outcome| {
        diary.note(outcome);
        if let Some(publisher) = &mut publisher {
            publisher.take(outcome);
        }
        if let Some(lines) = &mut lines
            && !lines.put(&outcome.line.to_string())?
        {
            live.tally.line_dropped();
        }
        left = left.map(|n| n.saturating_sub(1));
        Ok(left != Some(0))
    });
    let ended = session.end();
    if lines.is_some_and(|lines| !lines.end()) {
        tracing::warn!("ended before the last lines were read");
    }
    searched?;
    ended
}

/// Learns the object that is held up to the camera, and writes its model to `output`. Its
/// outline is given, or somebody marks it on the page.
///
/// # Errors
/// When the source cannot be read, the page's address cannot be bound, the object cannot be
/// learned, its model cannot be written, or the program is stopped before.
pub fn learn_from_camera(lesson: &Lesson, name: String, output: &Path, plan: &Plan) -> Result<Learned> {
    const STOPPED: &str = "ended before an object was learned";
    log_to_standard_error(LevelFilter::INFO);
    let live = Arc::new(Live::new(session::name_of(&lesson.origin), Models::load(&[], None)?, DEFAULT_THRESHOLD));
    if let Some(outline) = &lesson.outline {
        let session = Session::start(&lesson.origin, &live, None, None, 1)?;
        let taken = take_picture(&live.frames, Duration::from_secs(lesson.countdown.into()));
        let ended = session.end();
        let Some(picture) = taken else { return ended.and(Err(anyhow!(STOPPED))) };
        let learned = learn(&picture, outline, &name, plan)?;
        write_file(output, |file| Ok(file.write_all(&learned.model)?))?;
        return Ok(learned);
    }
    let (sender, learned) = mpsc::channel();
    let errand = Errand { name, output: output.to_path_buf(), sender: Mutex::new(Some(sender)) };
    let school = School { plan: plan.clone(), errand: Some(errand) };
    let page = Page { address: lesson.web, token: lesson.token.clone(), public: None, school };
    let session = Session::start(&lesson.origin, &live, Some(page), None, 1)?;
    tracing::info!("open it, hold the object up, and press \"Learn from the camera\"");
    let searched = search_frames(&live, Request::new(Profile::Vga, DEFAULT_THRESHOLD), Space::default(), |_| Ok(true));
    let ended = session.end();
    learned.try_recv().or_else(|_| ended.and(searched).and(Err(anyhow!(STOPPED))))
}

/// Takes the newest frame when `countdown` is over; the countdown starts with the first
/// frame. `None` when the source ends before.
fn take_picture(frames: &Slot<Captured>, countdown: Duration) -> Option<Picture> {
    let mut captured = frames.take()?;
    let start = Instant::now();
    let mut told = None;
    while let Some(left) = countdown.checked_sub(start.elapsed()).filter(|left| !left.is_zero()) {
        let seconds = left.as_secs() + 1;
        if told.replace(seconds) != Some(seconds) {
            tracing::info!("hold the object up: the picture is taken in {seconds} s");
        }
        captured = frames.take()?;
    }
    Some(captured.picture)
}

/// Starts the log on standard error.
fn log_to_standard_error(level: LevelFilter) {
    let log = tracing_subscriber::fmt()
        .with_max_level(if is_quiet() { level.min(LevelFilter::ERROR) } else { level })
        .with_target(false)
        .with_ansi(has_colours())
        .with_writer(io::stderr);
    // The journal of systemd adds its own times. A second call, in a test, changes nothing.
    let _ = if std::env::var_os("JOURNAL_STREAM").is_some() { log.without_time().try_init() } else { log.try_init() };
}

/// Logs objects that come into view and leave it.
#[derive(Debug, Default)]
struct Diary(Vec<(String, State)>);

impl Diary {
    fn note(&mut self, outcome: &Outcome) {
        for (i, (name, state, score)) in outcome.objects.iter().enumerate() {
            let before = self.0.get(i).filter(|b| b.0 == *name).map_or(State::Searching, |b| b.1);
            let name = plain(name);
            match (before.is_seen(), state.is_seen()) {
                (false, true) => tracing::info!("{name} found, score {:.2}", score.unwrap_or(0.0)),
                (true, false) => tracing::info!("{name} lost"),
                _ => {}
            }
        }
        self.0 = outcome.objects.iter().map(|(name, state, _)| (name.clone(), *state)).collect();
    }
}
