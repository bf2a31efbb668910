//! `keygraph detect`: objects in pictures, folders, videos or a stream.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;
use clap::error::ErrorKind;
use keygraph::canvas::Canvas;
use keygraph::gallery::Gallery;
use keygraph::input::{Kind, Reading, Source, read_picture};
use keygraph::notice::{is_quiet, notice};
use keygraph::output::{Inputs, file_stem, plain, plain_lines, print_line, tell_written_files};
use keygraph::pose::{Calibration, CameraArguments};
use keygraph::progress::Progress;
use keygraph::region::{Look, Unsuitable};
use keygraph::run::{Options, run as search_all};
use keygraph::search::{
    Found, Profile, Request, Shape, depth_of, parse_budget, parse_share, parse_threshold, search_for,
};
use keygraph::sensor::SensorFormat;
use keygraph::wide::search_squeezed;
use keygraph::{report, words};
use keygraph_core::{DEFAULT_THRESHOLD, Model};

use super::model_files::{expanded, is_model, load, parse};
use super::train::name_of;
use super::usage_error;
use super::values::Threads;

/// Arguments of `keygraph detect`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Model with the objects to find, or a folder of models; several are searched at once
    #[arg(short, long = "model", value_name = "MODEL.kgm|DIR")]
    models: Vec<PathBuf>,
    #[command(flatten)]
    search: Search,
}

/// What is searched, how, and what is told of it.
#[derive(Debug, clap::Args)]
pub struct Search {
    /// Pictures, folders, videos, addresses (rtsp://, http://, ...), or - for standard input
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Read folders in folders too
    #[arg(short, long)]
    recursive: bool,
    /// Print one JSON line a frame
    #[arg(long)]
    json: bool,
    /// Print one line of comma-separated values for each object that is found
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// End with status 0 when something was found, 1 when nothing was, 2 when a frame could not be read
    #[arg(long)]
    exit_code: bool,
    /// Draw what was found: into a folder, a picture, or a video file
    #[arg(long, value_name = "DIR|FILE")]
    annotate: Option<PathBuf>,
    /// Write each object that is found as it looks flat, at the resolution of the frame, as a PNG in this folder
    #[arg(long, value_name = "DIR")]
    rectify: Option<PathBuf>,
    /// Size that frames are searched at; larger ones are scaled down
    #[arg(long, value_enum, default_value = "vga")]
    profile: Profile,
    /// Minimum score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD, value_parser = parse_threshold)]
    threshold: f32,
    /// Minimum share of an object that must be seen and agree, 0 to 1. With 0 the score decides
    /// alone. Where objects share parts of their look, a share above theirs keeps one from being
    /// taken for the other
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = parse_share)]
    min_visible: f32,
    /// Stop the search of a frame after this time, ms, and report what was found; followed objects are
    /// followed all the same
    #[arg(long, value_name = "MS", value_parser = parse_budget)]
    budget_ms: Option<Duration>,
    /// Report all objects that could be at a place, and not the best alone
    #[arg(long, conflicts_with = "track")]
    all_names: bool,
    /// Shape that objects may have: with `any`, an object that a plane does not explain is laid on a surface
    /// that bends along one direction, as a label on a can or a page does
    #[arg(long, value_enum, default_value = "any", value_name = "SHAPE")]
    surface: Shape,
    #[command(flatten)]
    threads: Threads,
    /// Search all of each frame for all of the models, and again in tiles: finds small objects, small
    /// copies beside large ones, and each of many objects by itself; takes three times as long as a
    /// frame that shows nothing, for each object
    #[arg(long)]
    thorough: bool,
    /// Search for what is seen from far to the side, too, up to some 80 degrees: each frame is searched eight times more,
    /// as it looks squeezed along eight directions. A model of one object that is found without doubt, and not
    /// from far to the side, needs no more; a second copy of it is then not looked for
    #[arg(long, conflicts_with_all = ["track", "digests", "format"])]
    wide: bool,
    #[command(flatten)]
    look: Look,
    /// Convert frames to the format of a camera's sensor before they are searched
    #[arg(long, value_enum, value_name = "FORMAT")]
    format: Option<SensorFormat>,
    /// With --json: report a digest of each stage's output, to compare machines by
    #[arg(long, requires = "json", conflicts_with = "track")]
    digests: bool,
    /// Follow objects from frame to frame: faster and steadier; the inputs are taken as
    /// frames of a camera, in order
    #[arg(long)]
    track: bool,
    /// Average the outlines of what is followed over this many frames while they stand still [default: 8]: they tremble
    /// less, and lag by less than a pixel of the searched frame
    #[arg(long, value_name = "FRAMES", requires = "track", num_args = 0..=1, require_equals = true, default_missing_value = "8", value_parser = clap::value_parser!(u8).range(1..))]
    smooth: Option<u8>,
    /// The camera and its lens.
    #[command(flatten)]
    camera: CameraArguments,
}

impl Search {
    /// Ends the program when the arguments lack something, before anything is read.
    pub fn check(&self) {
        if let Some(message) = self.camera.lacks() {
            usage_error(ErrorKind::MissingRequiredArgument, message);
        }
        if self.wide && self.camera.has_lens() {
            let message = "--wide takes straight lines as straight: leave out --lens or --distortion";
            usage_error(ErrorKind::ArgumentConflict, message);
        }
    }
}

/// Searches the inputs and prints a line a frame.
///
/// # Errors
/// When a model cannot be read, or a result cannot be written. Frames that cannot be read
/// are reported; they make the exit status 1.
pub fn run(mut arguments: Arguments) -> Result<ExitCode> {
    arguments.search.check();
    let inputs = &mut arguments.search.inputs;
    // Models between the inputs belong to -m, as in `-m *.kgm photo.jpg`.
    let strays: Vec<_> = inputs.extract_if(.., |path| is_model(path)).collect();
    match (arguments.models.is_empty(), strays.first()) {
        (true, Some(stray)) => usage_error(
            ErrorKind::MissingRequiredArgument,
            format!("{0} is a model: did you mean -m {0}?", plain(&stray.display().to_string())),
        ),
        (true, None) => usage_error(
            ErrorKind::MissingRequiredArgument,
            "give a model with -m MODEL.kgm (make one with `keygraph train`), or use `keygraph find PICTURE INPUT`",
        ),
        (false, _) => arguments.models.extend(strays),
    }
    if inputs.is_empty() {
        usage_error(ErrorKind::MissingRequiredArgument, "there is nothing to search: give pictures, folders or videos");
    }
    let models = expanded(&arguments.models)?;
    search(&load(&models)?, &models, &arguments.search)
}

/// Searches the inputs for the objects of a model, which was read from `paths`.
///
/// # Errors
/// As [`run`].
pub fn search(bytes: &[u8], paths: &[PathBuf], arguments: &Search) -> Result<ExitCode> {
    let model = parse(bytes, paths)?;
    let optics = arguments.camera.optics()?;
    let calibration = arguments.camera.intrinsics(optics.as_ref())?.map(|intrinsics| {
        let calibration = Calibration::new(intrinsics, arguments.camera.widths(), &model);
        calibration.unwrap_or_else(|e| usage_error(ErrorKind::ValueValidation, e))
    });
    let options = Options {
        request: Request {
            budget: arguments.budget_ms,
            min_visible: arguments.min_visible,
            all_names: arguments.all_names,
            shape: arguments.surface,
            region: arguments.look.roi,
            mirror: arguments.look.mirror,
            format: arguments.format.map(|f| f.0),
            depth: depth_of(arguments.thorough),
            wide: arguments.wide,
            digests: arguments.digests,
            smooth: arguments.smooth.unwrap_or(0),
            ..Request::new(arguments.profile, arguments.threshold)
        },
        threads: arguments.threads.count(),
        track: arguments.track,
        annotate: arguments.annotate.is_some(),
        rectify: arguments.rectify.is_some(),
        optics,
        calibration: calibration.as_ref(),
    };
    let reading = Reading { recursive: arguments.recursive, reconnect: true };
    let mut source = Source::open_as(&arguments.inputs, reading)?;
    source.left_out().iter().for_each(|left| notice(&words::left_out(left)));
    let read = arguments.inputs.iter().chain(paths).map(PathBuf::as_path);
    let gallery = |path: &Path| Gallery::new(path, Inputs::of(read.clone()));
    // A slash at its end makes a folder of any name.
    let mut flats = arguments.rectify.as_deref().map(|folder| gallery(&folder.join(""))).transpose()?;
    let mut gallery = arguments.annotate.as_deref().map(gallery).transpose()?;
    let progress = Progress::new(source.len_hint(), "frames");
    let (mut failed, mut suited, mut any) = (false, false, false);
    if arguments.csv {
        print_line(report::CSV_HEAD)?;
    }
    // The first picture in which nothing was found, while nothing was found in any.
    let mut empty = Some(None);
    let searched = search_all(&mut source, &model, &options, |outcome| {
        progress.tick();
        match outcome.result {
            // While the region has suited no frame, it is the command line that is wrong.
            Err(e) if e.is::<Unsuitable>() && !suited => return Err(e),
            Err(e) => {
                failed = true;
                progress.error(&plain_lines(&format!("{e:#}")));
                if arguments.json {
                    let line = report::error_line(&outcome.source, outcome.frame, &format!("{e:#}"));
                    let line = report::timed(line, outcome.time);
                    progress.aside(|| print_line(&line.to_string()))?;
                }
            }
            Ok(s) => {
                suited = true;
                any |= !s.found.detections.is_empty();
                if !s.found.detections.is_empty() || matches!(outcome.kind, Kind::Video { .. }) {
                    empty = None;
                } else if let Some(first) = &mut empty {
                    first.get_or_insert_with(|| outcome.source.clone());
                }
                let (source, frame) = (&outcome.source, outcome.frame);
                let text = if arguments.json {
                    let line = report::frame_line(source, frame, s.size, &model, &s.found, s.places.as_deref());
                    report::timed(line, outcome.time).to_string()
                } else if arguments.csv {
                    report::csv_lines(source, frame, &model, &s.found)
                } else {
                    words::frame(source, frame, &model, &s)
                };
                progress.aside(|| text.lines().try_for_each(print_line))?;
                if let (Some(g), Some(c)) = (&mut gallery, &s.canvas) {
                    g.add(source, outcome.kind, c)?;
                }
                for (d, picture) in s.found.detections.iter().zip(&s.flat) {
                    let name = flat_name(source, outcome.kind, frame, model.object(usize::from(d.object)).name);
                    if let Some(flats) = &mut flats {
                        flats.add(&name, Kind::Still, &Canvas::from_picture(picture))?;
                    }
                }
            }
        }
        Ok(())
    });
    progress.finish();
    if let Err(e) = searched {
        drop(gallery);
        return if e.is::<Unsuitable>() { usage_error(ErrorKind::ValueValidation, format!("{e:#}")) } else { Err(e) };
    }
    for (gallery, path) in [(gallery, &arguments.annotate), (flats, &arguments.rectify)] {
        if let (Some(gallery), Some(path)) = (gallery, path) {
            tell_written_files(path, gallery.finish()?);
        }
    }
    if let Some(Some(name)) = empty
        && !arguments.track
        && !is_quiet()
    {
        hint_at_others(&name, &model, &options);
    }
    Ok(ExitCode::from(match (arguments.exit_code, failed, any) {
        (true, true, _) => 2,
        (true, false, false) | (false, true, _) => 1,
        _ => 0,
    }))
}

/// The name of the file of an object that is shown flat: input, number of the frame in a video, object.
fn flat_name(source: &str, kind: Kind, frame: u64, object: &str) -> String {
    let input = if source == "-" { "stdin".into() } else { name_of(Path::new(source)) };
    let number = if matches!(kind, Kind::Video { .. }) { format!("-{frame:06}") } else { String::new() };
    format!("{input}{number}-{}.png", file_stem(object))
}

/// Says so when the other `--mirror`, or `--wide`, finds an object in a picture in which nothing was found. It costs
/// nine searches for the whole run.
fn hint_at_others(name: &str, model: &Model<'_>, options: &Options<'_>) {
    let Ok(picture) = read_picture(Path::new(name)) else { return };
    let request = Request { details: false, digests: false, ..options.request };
    let mirrored = Request { mirror: !request.mirror, ..request };
    if search_for(&picture, model, &mirrored, 0).is_ok_and(|f| !f.detections.is_empty()) {
        let (how, advice) = if mirrored.mirror { ("", "use") } else { ("not ", "leave out") };
        notice(&format!("{}: found when {how}mirrored: {advice} --mirror", plain(name)));
        return;
    }
    if request.wide || options.optics.is_some() || options.request.digests || request.format.is_some() {
        return;
    }
    let squeezed = search_squeezed(Found::default(), &picture, model, &request, (0..options.threads, Instant::now()));
    if squeezed.is_ok_and(|f| !f.detections.is_empty()) {
        notice(&format!("{}: found from far to the side: use --wide", plain(name)));
    }
}
