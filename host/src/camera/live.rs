//! The newest frame through the tracker, and the state that the threads share.
//!
//! In: the newest frame, and the current models and threshold. Out: one [`Outcome`] a frame
//! to the caller at once, and the frame with its results to the painter, which encodes it
//! for the page in its own thread. While a viewer wants corners and triangles, every frame
//! is searched: frames in which objects are only followed have none.
//!
//! Memory: one waiting frame on each side. Cost: that of the tracker.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Result, anyhow};
use keygraph_core::Model;
use serde_json::{Value, json};
use tokio::sync::watch;

use super::Captured;
use super::damage::Damage;
use super::models::Models;
use super::pace::Pace;
use super::repeated::Repeated;
use super::shot::{Drawing, Shot, Work};
use super::sightings::Sightings;
use super::slot::{Slot, Taken};
use super::tally::Tally;
use super::tracker::{State, states};
use crate::camera::space::Space;
use crate::region::Unsuitable;
use crate::report::{frame_line, rounded, timed};
use crate::run::outlines;
use crate::search::{Found, Request};
use crate::trail::Trail;

/// Number of frames over which the frame rate is averaged.
const RATE_FRAMES: usize = 30;
/// Pause after a frame that cannot be searched. Each one in a row makes it longer, up to five
/// times.
const PAUSE: Duration = Duration::from_millis(100);
/// Maximum time for which a merged model is held while no frame arrives: it may be in the way of
/// the next one.
const LONGEST_HOLD: Duration = Duration::from_millis(100);
/// Maximum time between two frames of a source that delivers.
const SILENCE: Duration = Duration::from_secs(15);
/// Maximum number of pictures a second that outlines are drawn into.
pub(super) const MOST_FPS: f64 = 25.0;

/// The state that the threads share.
#[derive(Debug)]
pub struct Live {
    /// Frames from the source.
    pub frames: Slot<Captured>,
    /// Damaged frames.
    pub damage: Damage,
    /// Searched frames on their way to the page.
    pub work: Slot<Work>,
    /// The models in use.
    pub models: Models,
    /// The newest searched frame.
    pub shots: watch::Sender<Option<Arc<Shot>>>,
    /// The name of the source.
    pub source: String,
    /// Numbers for those who watch the program.
    pub tally: Tally,
    threshold: AtomicU32,
    trouble: Mutex<Option<String>>,
    start: Instant,
    /// The time of the newest frame, ms after `start`; `u64::MAX` before the first.
    newest: AtomicU64,
    /// The time until which a viewer wants pictures, ms after `start`.
    watched_until: AtomicU64,
    /// The time until which a viewer wants corners and triangles, ms after `start`.
    details_until: AtomicU64,
    /// The time until which a viewer wants outlines in the picture, ms after `start`.
    outlines_until: AtomicU64,
}

/// What a viewer wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The picture.
    Picture,
    /// The picture, corners and triangles.
    Details,
    /// The picture with outlines and names in it.
    Outlines,
}

impl Live {
    /// The state before the first frame.
    #[must_use]
    pub fn new(source: String, models: Models, threshold: f32) -> Self {
        Self {
            frames: Slot::default(),
            damage: Damage::default(),
            work: Slot::default(),
            models,
            shots: watch::Sender::new(None),
            source,
            tally: Tally::default(),
            threshold: AtomicU32::new(threshold.to_bits()),
            trouble: Mutex::new(None),
            start: Instant::now(),
            newest: AtomicU64::new(u64::MAX),
            watched_until: AtomicU64::new(0),
            details_until: AtomicU64::new(0),
            outlines_until: AtomicU64::new(0),
        }
    }

    /// The minimum score of a detection, 0 to 1.
    pub fn threshold(&self) -> f32 {
        f32::from_bits(self.threshold.load(Ordering::Relaxed))
    }

    /// Sets the minimum score of a detection, from the next frame on.
    pub fn set_threshold(&self, threshold: f32) {
        self.threshold.store(threshold.to_bits(), Ordering::Relaxed);
    }

    /// The reason why there are no frames; `None` when there are.
    pub fn trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sets the reason why there are no frames; `None` when there are frames again.
    pub fn set_trouble(&self, trouble: Option<String>) {
        *self.trouble.lock().unwrap_or_else(PoisonError::into_inner) = trouble;
    }

    /// Whether frames arrive.
    pub fn delivers(&self) -> bool {
        let newest = self.newest.load(Ordering::Relaxed);
        let silence = self.now_ms().saturating_sub(newest);
        newest != u64::MAX && u128::from(silence) < SILENCE.as_millis() && self.trouble().is_none()
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Notes what a viewer wants for `time` from now.
    pub fn look(&self, time: Duration, wish: Wish) {
        let until = self.now_ms() + u64::try_from(time.as_millis()).unwrap_or(0);
        let all: &[&AtomicU64] = match wish {
            Wish::Picture => &[&self.watched_until],
            Wish::Details => &[&self.watched_until, &self.details_until],
            Wish::Outlines => &[&self.outlines_until],
        };
        all.iter().for_each(|one| _ = one.fetch_max(until, Ordering::Relaxed));
    }

    fn is_watched(&self) -> bool {
        self.now_ms() < self.watched_until.load(Ordering::Relaxed)
    }

    fn wants_details(&self) -> bool {
        self.now_ms() < self.details_until.load(Ordering::Relaxed)
    }

    fn wants_outlines(&self) -> bool {
        self.now_ms() < self.outlines_until.load(Ordering::Relaxed)
    }
}

/// A threshold for JSON, rounded to three decimals.
pub(crate) fn thousandths(threshold: f32) -> f64 {
    f64::from((threshold * 1000.0).round()) / 1000.0
}

/// The outcome of one frame.
#[derive(Debug)]
pub struct Outcome {
    /// The JSON line of the frame, as `--json` prints it.
    pub line: Value,
    /// The name and the state of each object, and the best score if it is in view.
    pub objects: Vec<(String, State, Option<f32>)>,
}

/// What a tracker takes for one sequence: the models' generation, the frame's size and the
/// threshold. When one of them changes, earlier results are of no use.
type Sequence = (u64, (u32, u32), u32);

/// Tracks objects through the frames until the slot is closed or `each` returns false. Uses
/// the current threshold, and reports details while a viewer wants them.
///
/// # Errors
/// The error that `each` returned; [`Unsuitable`] when the region does not suit the first frame.
pub fn search_frames(
    live: &Live,
    wanted: Request,
    mut space: Space,
    mut each: impl FnMut(&Outcome) -> Result<bool>,
) -> Result<()> {
    let mut rate = Rate::default();
    let mut trail = Trail::default();
    let (repeated, mut failures) = (Repeated::default(), 0);
    let mut suits = false;
    let mut sightings = Sightings::default();
    loop {
        let merged = live.models.merged();
        // The model is parsed once for each change, not for each frame: that reads all of it.
        let model = merged.bytes.as_ref().and_then(|b| Model::parse(b).ok());
        space.meet(model.as_ref());
        while live.models.are(&merged) {
            let captured = match live.frames.take_within(LONGEST_HOLD) {
                Taken::Item(captured) => captured,
                Taken::Nothing => continue,
                Taken::Closed => return Ok(()),
            };
            live.newest.store(live.now_ms(), Ordering::Relaxed);
            let start = Instant::now();
            let details = live.is_watched() && live.wants_details();
            let request = Request { details, threshold: live.threshold(), ..wanted };
            let lens = space.lens(&captured.picture);
            let found = lens.and_then(|lens| {
                let request = Request { lens, ..request };
                look_at(&captured, model.as_ref(), merged.generation, &mut trail, &request)
            });
            let found = match found {
                Ok(found) => found,
                // A camera that was replaced by one with smaller frames does not end the program.
                Err(error) if error.is::<Unsuitable>() && !suits => return Err(error),
                Err(error) => {
                    if let Some(told) = repeated.note(&format!("{error:#}"), Instant::now()) {
                        tracing::error!("{}, frame {}: {told}", live.source, captured.number);
                    }
                    failures += 1;
                    thread::sleep(PAUSE * failures.min(5));
                    continue;
                }
            };
            (failures, suits) = (0, true);
            let time = start.elapsed();
            let searched = found.as_ref().and_then(|f| f.tracking.as_ref()).is_some_and(|t| t.searched);
            live.tally.frame(found.as_ref().map_or(0, |f| f.detections.len()), searched.then_some(time));
            let fps = rate.tick(Instant::now());
            let mut outcome = outcome(live, &captured, model.as_ref(), found.as_ref(), &mut space);
            outcome.line["fps"] = rounded(fps, 2);
            outcome.line["dropped"] = json!(live.frames.dropped());
            outcome.line["damaged"] = json!(live.damage.count());
            let (now, age) = (SystemTime::now(), captured.at.elapsed());
            outcome.line["age_ms"] = json!(age.as_millis());
            outcome.line = timed(outcome.line, Some(now.checked_sub(age).unwrap_or(now)));
            outcome.line["models"] = json!(merged.generation);
            outcome.line["threshold"] = json!(thousandths(request.threshold));
            sightings.note(merged.generation, &outcome.objects, captured.at);
            let go_on = each(&outcome)?;
            let drawing = live.wants_outlines().then(|| match (&model, &found) {
                (Some(model), Some(found)) => Drawing { part: found.part, outlines: outlines(model, found) },
                _ => Drawing::default(),
            });
            let watched = live.is_watched();
            let seen = if watched { sightings.last(captured.at) } else { Vec::new() };
            let details = found.filter(|_| details);
            live.work.put(Work { captured, line: outcome.line, details, watched, seen, drawing });
            if !go_on {
                return Ok(());
            }
        }
    }
}

/// Tracks one frame; `None` when there is no model. A panic becomes an error of this frame
/// alone.
fn look_at(
    captured: &Captured,
    model: Option<&Model<'_>>,
    generation: u64,
    trail: &mut Trail<Sequence>,
    request: &Request,
) -> Result<Option<Found>> {
    let Some(model) = model else { return Ok(None) };
    let picture = &captured.picture;
    let sequence = (generation, (picture.width, picture.height), request.threshold.to_bits());
    if request.details {
        trail.search_next();
    }
    catch_unwind(AssertUnwindSafe(|| trail.next(sequence, picture, model, request, 0)))
        .map_err(|_| anyhow!("the search failed; please report this frame"))?
        .map(Some)
}

fn outcome(
    live: &Live,
    captured: &Captured,
    model: Option<&Model<'_>>,
    found: Option<&Found>,
    space: &mut Space,
) -> Outcome {
    let size = (captured.picture.width, captured.picture.height);
    let (Some(model), Some(found)) = (model, found) else {
        let line = json!({
            "source": live.source, "frame": captured.number, "width": size.0, "height": size.1,
            "detections": [], "lost": [], "state": "searching", "searched": false, "stages": {}, "time_ms": {},
        });
        return Outcome { line, objects: Vec::new() };
    };
    let places = space.places(model, found);
    let mut line = frame_line(&live.source, captured.number, size, model, found, places.as_deref());
    space.draw(&mut line, found, places.as_deref());
    let best = |object: usize| {
        let scores = found.detections.iter().filter(|d| usize::from(d.object) == object).map(|d| d.score);
        scores.reduce(f32::max)
    };
    let states = states(model.objects(), found).into_iter().enumerate();
    Outcome { line, objects: states.map(|(i, state)| (model.object(i).name.to_string(), state, best(i))).collect() }
}

/// Encodes searched frames for the page until the slot is closed.
pub fn paint(live: &Live) {
    let repeated = Repeated::default();
    let mut pace = Pace::new(Duration::from_secs_f64(1.0 / MOST_FPS));
    while let Some(mut work) = live.work.take() {
        let frame = work.captured.number;
        work.drawing = work.drawing.filter(|_| pace.takes(Instant::now()));
        match Shot::new(work) {
            Ok(shot) => _ = live.shots.send_replace(Some(Arc::new(shot))),
            Err(error) => {
                if let Some(told) = repeated.note(&format!("{error:#}"), Instant::now()) {
                    tracing::error!("frame {frame}: {told}");
                }
            }
        }
    }
}

/// The frame rate, averaged over the last [`RATE_FRAMES`] frames.
#[derive(Debug, Default)]
struct Rate(VecDeque<Instant>);

impl Rate {
    fn tick(&mut self, now: Instant) -> f64 {
        self.0.push_back(now);
        if self.0.len() > RATE_FRAMES {
            self.0.pop_front();
        }
        let span = self.0.front().map_or(0.0, |first| (now - *first).as_secs_f64());
        if span > 0.0 { (self.0.len() - 1) as f64 / span } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_frames() {
        let mut rate = Rate::default();
        let start = Instant::now();
        assert!(rate.tick(start).abs() < 1e-9, "one frame has no rate");
        let after = |ms: u64| start + Duration::from_millis(ms);
        let slow = (1..20).map(|i| rate.tick(after(i * 1000))).last().expect("19");
        assert!((slow - 1.0).abs() < 1e-6, "{slow}");
        let fast = (1..=40).map(|i| rate.tick(after(19_000 + i * 20))).last().expect("40");
        assert!((fast - 50.0).abs() < 1e-6, "{fast}");
    }
}
