//! The command line: `keygraph train`, `pack`, `inspect`, `assess`,
//! `detect`, `bench`, `camera`, `demo`.
//!
//! Exit status 0 when all went well, 1 when something could not be read, trained
//! or written (what could be done is done), 2 for a wrong command line.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use keygraph::assess::{self, Assessment, Cell, assess, frames};
use keygraph::bench::bench;
use keygraph::camera::arguments::{Arguments, Lesson};
use keygraph::camera::lesson::{Learned, Plan};
use keygraph::camera::{camera, learn_from_camera};
use keygraph::gallery::Gallery;
use keygraph::heat::Heat;
use keygraph::input::{Picture, Source};
use keygraph::learn::{Preset, has_colour, merge, train, train_within};
use keygraph::margins::within_margins;
use keygraph::picture::{Framed, Part, read_framed};
use keygraph::pose::{Calibration, Width, parse_intrinsics};
use keygraph::progress::Progress;
use keygraph::run::{Options, Searched, default_threads, run};
use keygraph::search::{MAX_THREADS, Profile, Request, search};
use keygraph::sensor::SensorFormat;
use keygraph::{demo, report};
use keygraph_core::camera::{Intrinsics, PlanePose};
use keygraph_core::detect::DEFAULT_THRESHOLD;
use keygraph_core::feature::FeatureKind;
use keygraph_core::model::{MAGIC, Method, Model, NAME_BYTES};
use keygraph_core::train::{TrainError, Trained};
use keygraph_core::write::PackError;

/// Finds planar objects (books, posters, boxes, signs) in camera frames from one
/// picture of each.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a model from one picture of an object, or of what is held up to a camera
    Train {
        /// PNG or JPEG picture that shows the object, from the front, and nothing else
        #[arg(required_unless_present = "from_camera", conflicts_with = "from_camera")]
        picture: Option<PathBuf>,
        /// Part of the picture that shows the object, px [default: all that is opaque]
        #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
        crop: Option<Part>,
        /// Model file to write
        #[arg(short, long, value_name = "MODEL.kgm")]
        output: PathBuf,
        /// Name of the object [default: that of the picture's file, or of the model's]
        #[arg(long)]
        name: Option<String>,
        /// How much the model holds
        #[arg(long, value_enum, default_value = "large")]
        preset: Preset,
        /// Most bytes of the model, instead of the preset's
        #[arg(long, value_name = "N", value_parser = model_size)]
        bytes: Option<usize>,
        /// For cameras without colour
        #[arg(long)]
        luma: bool,
        /// Print the report as one JSON object
        #[arg(long)]
        json: bool,
        /// How to come by a picture from a camera.
        #[command(flatten, next_help_heading = "From a camera")]
        lesson: Box<Lesson>,
    },
    /// Merge models into one file that finds all their objects
    Pack {
        /// Models to merge
        #[arg(required = true, value_name = "MODEL.kgm")]
        models: Vec<PathBuf>,
        /// Model file to write
        #[arg(short, long, value_name = "ALL.kgm")]
        output: PathBuf,
    },
    /// Tell what is in a model
    Inspect {
        /// Model to look into
        #[arg(value_name = "MODEL.kgm")]
        model: PathBuf,
        /// Print it as one JSON object
        #[arg(long)]
        json: bool,
    },
    /// Tell how well a picture will be found, before it is used
    ///
    /// Renders frames that show the picture over a range of scale, rotation, tilt,
    /// blur, darkness and noise, searches them, and gives a score from 0 to 100,
    /// the table behind it, and what limits it.
    Assess {
        /// Picture of the object, or a model
        #[arg(value_name = "PICTURE|MODEL.kgm")]
        input: PathBuf,
        /// The picture that the model was made from, to assess that very model; one
        /// for each object of it, in order
        #[arg(long, value_name = "PICTURE")]
        picture: Vec<PathBuf>,
        /// Part of the picture that shows the object, px [default: all that is opaque]
        #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
        crop: Option<Part>,
        /// How much the model of the picture holds
        #[arg(long, value_enum, default_value = "large")]
        preset: Preset,
        /// For cameras without colour
        #[arg(long)]
        luma: bool,
        /// Size of the frames
        #[arg(long, value_enum, default_value = "vga")]
        profile: Profile,
        /// Frames for each field of the table
        #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
        views: u16,
        /// Frames searched at once [default: one a processor, at most 8]
        #[arg(long, value_parser = clap::value_parser!(u8).range(1..=MAX_THREADS as i64))]
        threads: Option<u8>,
        /// Print one JSON line an object
        #[arg(long)]
        json: bool,
        /// Picture to write: bright where the object's keygraphs hold, dark where
        /// nothing does
        #[arg(long, value_name = "FILE")]
        annotate: Option<PathBuf>,
    },
    /// Find the objects of models in pictures, folders, videos or a stream
    Detect {
        /// Model with the objects to find; several are searched at once
        #[arg(short, long = "model", required = true, value_name = "MODEL.kgm")]
        models: Vec<PathBuf>,
        /// Pictures, folders of pictures, video files, or - for a YUV4MPEG2 stream
        #[arg(required = true, value_name = "INPUT")]
        inputs: Vec<PathBuf>,
        /// Print one JSON line a frame
        #[arg(long)]
        json: bool,
        /// Draw what was found: into a folder, a picture, or a video file
        #[arg(long, value_name = "DIR|FILE")]
        annotate: Option<PathBuf>,
        /// Size that frames are searched at; larger ones are scaled down
        #[arg(long, value_enum, default_value = "vga")]
        profile: Profile,
        /// Least score of a detection, 0 to 1
        #[arg(long, default_value_t = DEFAULT_THRESHOLD, value_parser = score)]
        threshold: f32,
        /// Frames searched at once [default: one a processor, at most 8]
        #[arg(long, value_parser = clap::value_parser!(u8).range(1..=MAX_THREADS as i64))]
        threads: Option<u8>,
        /// Search all of each frame for all of the models: finds small copies beside large
        /// ones, and each of very many objects, in some five times the time
        #[arg(long)]
        thorough: bool,
        /// Turn frames into what a camera's sensor gives before they are searched
        #[arg(long, value_enum, value_name = "FORMAT")]
        format: Option<SensorFormat>,
        /// With --json: a digest of each stage's output, to compare machines by
        #[arg(long, requires = "json", conflicts_with = "track")]
        digests: bool,
        /// Follow what was found from frame to frame: faster and steadier; the inputs
        /// are taken as frames of a camera, in order
        #[arg(long)]
        track: bool,
        /// The camera's focal lengths and principal point, px of the input: reports the
        /// pose of each object
        #[arg(long, value_name = "FX,FY,CX,CY", requires = "width_mm", value_parser = parse_intrinsics, allow_hyphen_values = true)]
        intrinsics: Option<Intrinsics>,
        /// True width of every object, mm, or of the one named; may be repeated
        #[arg(long, value_name = "[NAME=]W", requires = "intrinsics", allow_hyphen_values = true)]
        width_mm: Vec<Width>,
    },
    /// Tell what the search costs: time by stage, memory by buffer, one digest
    ///
    /// Searches the same frames again and again on one thread. Each pass must find what
    /// the first found; the digest stands for all that every stage made, and is the same
    /// on every machine.
    Bench {
        /// Model with the objects to find [default: those of the repository's sequence]
        #[arg(short, long = "model", value_name = "MODEL.kgm", requires = "inputs")]
        models: Vec<PathBuf>,
        /// Pictures, folders of pictures, or video files [default: the repository's sequence]
        #[arg(value_name = "INPUT", requires = "models")]
        inputs: Vec<PathBuf>,
        /// Size that frames are searched at; larger ones are scaled down
        #[arg(long, value_enum, default_value = "vga")]
        profile: Profile,
        /// Search all of each frame for all of the models
        #[arg(long)]
        thorough: bool,
        /// Passes that are timed
        #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
        passes: u16,
        /// Most frames of a pass; they are held in memory
        #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..))]
        frames: u16,
        /// Time following from frame to frame too
        #[arg(long)]
        track: bool,
        /// How much the model of the repository's objects holds
        #[arg(long, value_enum, default_value = "large", conflicts_with = "models")]
        preset: Preset,
        /// The repository's assets
        #[arg(long, default_value = "assets")]
        assets: PathBuf,
        /// Print one JSON object
        #[arg(long)]
        json: bool,
    },
    /// Find the objects of models in front of a camera, live
    ///
    /// Prints JSON lines, serves a page that shows what is seen and learns objects
    /// that are held up, and goes on until it is told to stop.
    Camera(Box<Arguments>),
    /// Train on the repository's pictures and find them in its sequence
    Demo {
        /// The repository's assets
        #[arg(long, default_value = "assets")]
        assets: PathBuf,
        /// Folder for models and annotated frames
        #[arg(long, default_value = "out/demo")]
        out: PathBuf,
    },
}

/// A picture with fewer keypoints in every view is hard to find; photographs have 110.
const FEW_KEYPOINTS: u16 = 40;
/// The same for likely keygraphs: with 20,000 and more nearly all of 16 rendered frames
/// were right, with fewer some none at all. Photographs have 58,000 to 72,000.
const FEW_KEYGRAPHS: u32 = 20_000;
/// Pictures longer than so many times their width were found only where they were
/// 250 px long or more.
const ELONGATED: u32 = 4;
/// A picture with a shorter longer side loses detail for its smallness, px.
const SMALL_PX: u32 = 120;

fn score(s: &str) -> Result<f32, String> {
    match s.parse::<f32>() {
        Ok(v) if (0.0..=1.0).contains(&v) => Ok(v),
        _ => Err("a score lies between 0 and 1".into()),
    }
}

fn model_size(s: &str) -> Result<usize, String> {
    const MOST: usize = 64 << 20;
    match s.parse() {
        Ok(v) if v <= MOST => Ok(v),
        _ => Err(format!("a number of bytes up to {MOST}, please")),
    }
}

fn main() -> ExitCode {
    match dispatch(Cli::parse().command) {
        Ok(code) => code,
        // A reader that has seen enough (`| head`) is no failure.
        Err(e) if e.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe) => {
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("keygraph: {e:#}");
            ExitCode::FAILURE
        }
    }
}

fn dispatch(command: Command) -> Result<ExitCode> {
    match command {
        Command::Train { picture, crop, output, name, preset, bytes, luma, json, lesson } => {
            if !lesson.from_camera && lesson.origin.is_given() {
                let message = "a camera or --replay is only looked at with --from-camera";
                Cli::command().error(ErrorKind::ArgumentConflict, message).exit();
            }
            let plan = Plan { preset, bytes: bytes.unwrap_or(preset.bytes()), luma };
            match picture {
                Some(picture) => train_on_picture(&picture, crop, &output, name, &plan, json)?,
                None => train_from_camera(&lesson, &output, name, &plan, json)?,
            }
        }
        Command::Pack { models, output } => pack_all(&models, &output)?,
        Command::Inspect { model, json } => inspect(&model, json)?,
        Command::Assess { input, picture, crop, preset, luma, profile, views, threads, json, annotate } => {
            let threads = threads.map_or_else(default_threads, usize::from);
            let options = assess::Options { profile, views: usize::from(views), threads };
            assess_all(&input, &picture, crop, (preset, luma), &options, json, annotate.as_deref())?;
        }
        Command::Detect {
            models,
            inputs,
            json,
            annotate,
            profile,
            threshold,
            threads,
            thorough,
            format,
            digests,
            track,
            intrinsics,
            width_mm,
        } => {
            if track && threads.is_some_and(|n| n > 1) {
                let message = "--track works on one frame after the other: leave --threads out";
                Cli::command().error(ErrorKind::ArgumentConflict, message).exit();
            }
            let options = Options {
                profile,
                threshold,
                format: format.map(|f| f.0),
                thorough,
                digests,
                threads: threads.map_or_else(default_threads, usize::from),
                track,
                annotate: annotate.is_some(),
                calibration: None,
            };
            let calibration = intrinsics.map(|i| (i, width_mm));
            return detect(&models, &inputs, json, annotate.as_deref(), &options, calibration);
        }
        Command::Bench { models, mut inputs, profile, thorough, passes, frames, track, preset, assets, json } => {
            let bytes = if models.is_empty() {
                let (sequence, model) = demo::sample(&assets, preset)?;
                inputs.push(sequence);
                model
            } else {
                load(&models)?
            };
            let request = Request { thorough, ..Request::new(profile, DEFAULT_THRESHOLD) };
            bench_all(
                &parse(&bytes, &models)?,
                &inputs,
                &request,
                usize::from(passes),
                usize::from(frames),
                track,
                json,
            )?;
        }
        Command::Camera(arguments) => camera(&arguments)?,
        Command::Demo { assets, out } => {
            demo::demo(&assets, &out)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn train_on_picture(
    picture: &Path,
    crop: Option<Part>,
    output: &Path,
    name: Option<String>,
    plan: &Plan,
    json: bool,
) -> Result<()> {
    check_folder_of(output)?;
    let framed = read_framed(picture, crop)?;
    tell_framing(&framed, picture, crop.is_some());
    let pixels = framed.picture;
    let label = picture.display().to_string();
    check_colour(&pixels, &label, plan)?;
    let name = name.unwrap_or_else(|| name_of(picture));
    let (model, trained) = train_within(&pixels, &name, plan.preset, plan.luma, plan.bytes)
        .with_context(|| format!("cannot train on {label}"))?;
    keep_trained(&Learned { name, picture: pixels, model, trained, found: None }, &label, output, json)
}

fn train_from_camera(lesson: &Lesson, output: &Path, name: Option<String>, plan: &Plan, json: bool) -> Result<()> {
    check_folder_of(output)?;
    let name = name.unwrap_or_else(|| name_of(output));
    let learned = learn_from_camera(lesson, name, output, plan)?;
    let label = format!("the picture of {}", learned.name);
    check_colour(&learned.picture, &label, plan)?;
    keep_trained(&learned, &label, output, json)
}

/// Training takes a second: a folder that is not there is said before.
fn check_folder_of(output: &Path) -> Result<()> {
    if let Some(folder) = output.parent().filter(|f| !f.as_os_str().is_empty() && !f.is_dir()) {
        bail!("cannot write {}: the folder {} does not exist", output.display(), folder.display());
    }
    Ok(())
}

fn check_colour(pixels: &Picture, label: &str, plan: &Plan) -> Result<()> {
    match (has_colour(pixels), plan.preset) {
        (false, Preset::Paper) if !plan.luma => {
            bail!("{label} has no colour, which the paper's features are made of: use another preset");
        }
        (false, _) if !plan.luma => eprintln!("keygraph: {label} has no colour: trained on luma alone"),
        _ => {}
    }
    Ok(())
}

/// Writes a model and tells of it; `label` is what its picture is called.
fn keep_trained(learned: &Learned, label: &str, output: &Path, json: bool) -> Result<()> {
    // A model that would be refused is not left behind as a file.
    let model = Model::parse(&learned.model)?;
    fs::write(output, &learned.model).with_context(|| format!("cannot write {}", output.display()))?;
    warn(&learned.picture, label, &learned.name, &model, &learned.trained)?;
    if json {
        return print(&report::model_object(&model).to_string());
    }
    print(&format!("picture    {label}, {}x{} px", learned.picture.width, learned.picture.height))?;
    print(&training_report(&learned.trained))?;
    print(&model_report(&model, output))
}

/// Says on standard error which part of the picture is taken for the object, where
/// that may surprise.
fn tell_framing(framed: &Framed, path: &Path, cropped: bool) {
    let (path, Part { x, y, width, height }) = (path.display(), framed.part);
    if !cropped && (width, height) != framed.whole {
        eprintln!(
            "keygraph: {path} is transparent around {x},{y},{width},{height}: trained on that part, whose outline will be reported"
        );
    }
    if framed.transparent {
        eprintln!("keygraph: {path} is transparent in places: white is taken there");
    }
    if let Some(m) = within_margins(&framed.picture).filter(|_| !cropped) {
        eprintln!(
            "keygraph: {path} has plain margins, and the outline of the whole picture will be reported: if the object is only what is within them, train with --crop {},{},{},{}",
            x + m.x,
            y + m.y,
            m.width,
            m.height
        );
    }
}

/// What an object is called if nothing else is said.
fn name_of(picture: &Path) -> String {
    picture.file_stem().map_or_else(|| "object".into(), |s| s.to_string_lossy().into_owned())
}

/// Says on standard error what makes a model less useful than it looks.
fn warn(pixels: &Picture, label: &str, name: &str, model: &Model<'_>, trained: &Trained) -> Result<()> {
    if name.len() > NAME_BYTES {
        eprintln!("keygraph: the name was cut to {NAME_BYTES} bytes: {}", model.object(0).name);
    }
    if let Some(advice) = advice(pixels, trained).filter(|_| model.method() == Method::Keygraph) {
        eprintln!("keygraph: {label} {advice}");
    }
    let own = search(pixels, model, Profile::Vga, DEFAULT_THRESHOLD, false, 0)?;
    if model.method() == Method::Keygraph && own.detections.is_empty() {
        eprintln!(
            "keygraph: the object is not found even in {label} itself: use a picture with more texture, a larger one, or a less elongated part of the object"
        );
    }
    Ok(())
}

/// What to do about a picture that gave little; `None` when it gave enough.
fn advice(pixels: &Picture, trained: &Trained) -> Option<String> {
    let (longer, shorter) = (pixels.width.max(pixels.height), pixels.width.min(pixels.height));
    let keypoints = trained.view_keypoints.iter().copied().max().unwrap_or(0);
    let keygraphs = trained.keygraphs.seen;
    let elongated = longer > ELONGATED * shorter;
    let what = if keypoints < FEW_KEYPOINTS || keygraphs < FEW_KEYGRAPHS {
        format!(
            "has little to hold on to ({keypoints} keypoints in its best view, {keygraphs} likely keygraphs) and may often be missed"
        )
    } else if elongated {
        format!("is more than {ELONGATED} times as long as wide and will be missed where it is seen small")
    } else {
        return None;
    };
    let remedy = match (longer < SMALL_PX, elongated) {
        (true, _) => format!("take a larger one, of {SMALL_PX} px or more"),
        (_, true) => "train on a less elongated part of the object".into(),
        _ => "take a sharper one, or one of a part with more texture".into(),
    };
    Some(format!("{what}: {remedy}"))
}

fn training_report(t: &Trained) -> String {
    let each = t.view_keypoints.iter().map(u16::to_string).collect::<Vec<_>>().join(" ");
    let sum: u32 = t.view_keypoints.iter().map(|&n| u32::from(n)).sum();
    format!(
        "views      {}, with {each} keypoints: {sum}\nlikely     {} keygraphs, of which the caps left out {}",
        t.view_keypoints.len(),
        t.keygraphs.seen,
        t.keygraphs.dropped
    )
}

fn model_report(model: &Model<'_>, path: &Path) -> String {
    let (used, largest) = model.occupancy();
    let triples: u64 = (0..model.objects()).map(|i| u64::from(model.object(i).triples)).sum();
    format!(
        "method     {}\ntriples    {triples} possible\nkeygraphs  {}\nsubsets    {used} used, the largest has {largest}\n\
         model      {}, {} bytes, feature {}",
        report::method_name(model),
        model.keygraphs(),
        path.display(),
        model.bytes().len(),
        match model.feature() {
            FeatureKind::Both => "both (luma and chroma)",
            other => other.name(),
        }
    )
}

fn pack_all(models: &[PathBuf], output: &Path) -> Result<()> {
    let packed = load(models)?;
    let model = parse(&packed, models)?;
    fs::write(output, &packed).with_context(|| format!("cannot write {}", output.display()))?;
    print(&format!("{} objects\n{}", model.objects(), model_report(&model, output)))
}

/// Reads models; several become one. A single one is not looked at: [`parse`] does that
/// once, which takes most of the time in which a search gets ready.
fn load(paths: &[PathBuf]) -> Result<Vec<u8>> {
    let mut models = Vec::new();
    for path in paths {
        models.push(fs::read(path).map_err(|e| {
            let advice = match e.kind() {
                io::ErrorKind::NotFound => " (make one with `keygraph train`)",
                _ => "",
            };
            anyhow::Error::new(e).context(format!("cannot read the model {}{advice}", path.display()))
        })?);
    }
    if models.len() == 1 {
        return Ok(models.remove(0));
    }
    for (bytes, path) in models.iter().zip(paths) {
        parse(bytes, std::slice::from_ref(path))?;
    }
    merge(&models).map_err(|e| match e.downcast_ref() {
        Some(&PackError::Different { index }) => e.context(paths[index].display().to_string()),
        _ => e,
    })
}

/// The model that was loaded from `paths`; the message names the first.
fn parse<'a>(bytes: &'a [u8], paths: &[PathBuf]) -> Result<Model<'a>> {
    Model::parse(bytes).with_context(|| paths.first().map(|p| p.display().to_string()).unwrap_or_default())
}

fn inspect(path: &Path, json: bool) -> Result<()> {
    let paths = [path.to_path_buf()];
    let bytes = load(&paths)?;
    let model = parse(&bytes, &paths)?;
    if json {
        return print(&report::model_object(&model).to_string());
    }
    for i in 0..model.objects() {
        let o = model.object(i);
        print(&format!("object     {}, {}x{} px, {} keypoints", o.name, o.width, o.height, o.keypoints))?;
    }
    print(&model_report(&model, path))
}

fn assess_all(
    input: &Path,
    pictures: &[PathBuf],
    crop: Option<Part>,
    (preset, luma): (Preset, bool),
    options: &assess::Options,
    json: bool,
    annotate: Option<&Path>,
) -> Result<()> {
    let inputs: Vec<&Path> = pictures.iter().map(PathBuf::as_path).chain([input]).collect();
    if let Some(path) = annotate {
        check_annotated(path, &inputs)?;
    }
    let show = |a: &Assessment| print(&if json { report::assessment_object(a).to_string() } else { assessed(a) });
    let draw = |heat: &Heat, picture: &Picture| annotate.map_or(Ok(()), |path| heat.draw(picture).save(path));
    let is_model = fs::read(input).is_ok_and(|bytes| bytes.starts_with(&MAGIC));
    let (bytes, pictures) = if is_model {
        ensure!(
            crop.is_none() || pictures.len() == 1,
            "--crop goes with one picture, and {} were given",
            pictures.len()
        );
        let pictures = pictures.iter().map(|p| Ok(read_framed(p, crop)?.picture)).collect::<Result<Vec<_>>>()?;
        (load(&[input.to_path_buf()])?, pictures)
    } else {
        ensure!(pictures.is_empty(), "--picture goes with a model, and {} is none: leave it out", input.display());
        let framed = read_framed(input, crop)?;
        tell_framing(&framed, input, crop.is_some());
        let picture = framed.picture;
        let name = name_of(input);
        match train(&picture, &name, preset, luma) {
            Ok((model, _)) => (model, vec![picture]),
            // That a picture cannot be used at all is an answer too.
            Err(e) if e.is::<TrainError>() => {
                show(&Assessment::refused(&name, &e.to_string()))?;
                return draw(&Heat::new(picture.width, picture.height), &picture);
            }
            Err(e) => return Err(e.context(format!("cannot train on {}", input.display()))),
        }
    };
    let model = parse(&bytes, &[input.to_path_buf()])?;
    let objects = model.objects();
    ensure!(
        pictures.is_empty() || pictures.len() == objects,
        "the model has {objects} objects and {} pictures were given: give --picture once for each, in the order of `keygraph inspect`",
        pictures.len()
    );
    if annotate.is_some() {
        ensure!(!pictures.is_empty(), "--annotate draws on the picture that the model was made from: give --picture");
        ensure!(objects == 1, "--annotate takes one object and the model has {objects}: assess them one by one");
    }
    let progress = Progress::new(Some((pictures.len() * frames(options.views)) as u64), "frames");
    for index in 0..objects {
        let picture = pictures.get(index);
        let assessment = assess(&model, index, picture, options, || progress.tick())?;
        progress.aside(|| show(&assessment))?;
        if let (Some(sweep), Some(picture)) = (&assessment.sweep, picture) {
            draw(&sweep.heat, picture)?;
        }
    }
    progress.finish();
    if pictures.is_empty() {
        eprintln!("keygraph: a model holds no picture to render: for the score and the table, give --picture");
    }
    Ok(())
}

/// What would only fail after the frames are searched is said before.
fn check_annotated(path: &Path, inputs: &[&Path]) -> Result<()> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    ensure!(
        matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg")),
        "--annotate {} is no picture: its name must end with .png, .jpg or .jpeg",
        path.display()
    );
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty() && !f.is_dir()) {
        bail!("cannot write {}: the folder {} does not exist", path.display(), folder.display());
    }
    let is_input =
        fs::canonicalize(path).is_ok_and(|p| inputs.iter().any(|i| fs::canonicalize(i).is_ok_and(|i| i == p)));
    ensure!(!is_input, "--annotate would overwrite the input {}: give another name", path.display());
    Ok(())
}

/// An assessment in words.
fn assessed(a: &Assessment) -> String {
    let mut lines = vec![format!("{:17}  {}", "object", a.name)];
    if let Some(s) = &a.structure {
        let feature = if s.luma_only { "luma alone" } else { "luma and chroma" };
        lines[0] +=
            &format!(", {}x{} px, {} keypoints, {} keygraphs, {feature}", s.size.0, s.size.1, s.keypoints, s.keygraphs);
    }
    if let Some(score) = a.score {
        lines.push(format!("{:17}  {score} of 100", "score"));
    }
    if let Some(sweep) = &a.sweep {
        for row in &sweep.rows {
            let cell = |c: &Cell| format!("{}: {:.0} %", c.value, c.rate(sweep.views) * 100.0);
            let cells = row.cells.iter().map(cell).collect::<Vec<_>>().join("   ");
            let head = format!("{}, {}", row.condition.name(), row.condition.unit());
            lines.push(format!("{head:17}  {cells}"));
        }
        lines.push(format!("{:17}  {} outlines in {} frames", "wrong", sweep.wrong, frames(sweep.views)));
    }
    let mut head = "limits";
    for limit in &a.limits {
        lines.push(format!("{head:17}  {}", limit.text));
        head = "";
    }
    if a.limits.is_empty() {
        lines.push(format!("{head:17}  none"));
    }
    lines.join("\n")
}

fn bench_all(
    model: &Model<'_>,
    inputs: &[PathBuf],
    request: &Request,
    passes: usize,
    frames: usize,
    track: bool,
    json: bool,
) -> Result<()> {
    let pictures: Vec<Picture> =
        Source::open(inputs)?.take(frames).map(|f| f.picture.with_context(|| f.source)).collect::<Result<_>>()?;
    let b = bench(&pictures, model, request, passes, track)?;
    if json {
        return print(&report::bench_object(&b).to_string());
    }
    print(&format!(
        "{} objects, {} keygraphs, {} bytes of model; {} frames, {} passes, one thread",
        model.objects(),
        model.keygraphs(),
        model.bytes().len(),
        b.frames,
        b.passes
    ))?;
    print(&format!(
        "\n{:10} {:>10} {:>10} {:>9}  a plain copy of the bytes it moves",
        "stage", "median ms", "95 % ms", "dropped"
    ))?;
    for s in &b.stages {
        let copy =
            s.moved.zip(s.copy_ms).map_or_else(String::new, |(moved, copy)| format!("  {copy:.3} ms for {moved}"));
        print(&format!("{:10} {:10.3} {:10.3} {:9}{copy}", s.stage.name(), s.times.median, s.times.p95, s.dropped))?;
    }
    print(&format!("{:10} {:10.3} {:10.3}", "total", b.total.median, b.total.p95))?;
    if let Some(t) = &b.tracking {
        print(&format!(
            "{:10} {:10.3} {:10.3}  {} of {} frames",
            "followed", t.times.median, t.times.p95, t.followed, b.frames
        ))?;
    }
    print(&format!("\n{:14} {:>9} {:>9} {:>11}", "buffer", "bytes", "capacity", "high water"))?;
    for h in &b.buffers {
        print(&format!("{:14} {:9} {:9} {:11}", h.buffer.name(), h.room.bytes, h.room.capacity, h.high_water))?;
    }
    print(&format!("{:14} {:9}, all fixed when it was compiled", "the detector", b.detector_bytes))?;
    print(&format!("\n{} detections in a pass; digest {:08x}, equal on every machine", b.detections, b.digest))
}

fn detect(
    models: &[PathBuf],
    inputs: &[PathBuf],
    json: bool,
    annotate: Option<&Path>,
    options: &Options<'_>,
    camera: Option<(Intrinsics, Vec<Width>)>,
) -> Result<ExitCode> {
    let bytes = load(models)?;
    let model = parse(&bytes, models)?;
    let calibration = camera.map(|(intrinsics, widths)| {
        Calibration::new(intrinsics, &widths, &model)
            .unwrap_or_else(|e| Cli::command().error(ErrorKind::ValueValidation, e).exit())
    });
    let options = &Options { calibration: calibration.as_ref(), ..*options };
    let mut source = Source::open(inputs)?;
    let mut gallery = annotate.map(|path| Gallery::new(path, inputs)).transpose()?;
    let progress = Progress::new(source.len_hint(), "frames");
    let mut failed = false;
    run(&mut source, &model, options, |outcome| {
        progress.tick();
        match outcome.result {
            Err(e) => {
                failed = true;
                progress.print(&format!("keygraph: {e:#}"));
                if json {
                    let line = report::error_line(&outcome.source, outcome.frame, &format!("{e:#}"));
                    progress.aside(|| print(&line.to_string()))?;
                }
            }
            Ok(s) => {
                let line = if json {
                    report::frame_line(&outcome.source, outcome.frame, s.size, &model, &s.found, s.poses.as_deref())
                        .to_string()
                } else {
                    in_words(&outcome.source, outcome.frame, &model, &s)
                };
                progress.aside(|| print(&line))?;
                if let (Some(g), Some(c)) = (&mut gallery, &s.canvas) {
                    g.add(&outcome.source, outcome.kind, c)?;
                }
            }
        }
        Ok(())
    })?;
    progress.finish();
    gallery.map_or(Ok(()), Gallery::finish)?;
    Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

fn in_words(source: &str, frame: u64, model: &Model<'_>, searched: &Searched) -> String {
    let found = &searched.found;
    let what = if found.detections.is_empty() {
        "nothing found".to_string()
    } else {
        let one = |(i, d): (usize, &keygraph_core::detect::Detection)| {
            let [x, y] = [0, 1].map(|i| d.corners.iter().map(|c| c[i]).sum::<f32>() / 4.0);
            let side = |a: [f32; 2], b: [f32; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
            let [a, b, c, _] = d.corners;
            // Plus nothing: -0 is written as 0.
            let angle = (b[1] - a[1]).atan2(b[0] - a[0]).to_degrees().round() + 0.0;
            let distance = |p: &PlanePose| {
                let mm = p.best.translation_mm.iter().map(|v| v * v).sum::<f32>().sqrt();
                format!(", {mm:.0} mm away")
            };
            let pose = searched.poses.as_ref().and_then(|p| p[i].as_ref()).map_or_else(String::new, distance);
            format!(
                "{} at ({x:.0}, {y:.0}), {:.0}x{:.0} px, turned by {angle:.0} degrees, score {:.2}{pose}",
                model.object(usize::from(d.object)).name,
                side(a, b),
                side(b, c),
                d.score
            )
        };
        found.detections.iter().enumerate().map(one).collect::<Vec<_>>().join("; ")
    };
    format!("{source} [{frame}]: {what} ({:.1} ms)", found.total_ns as f64 / 1e6)
}

/// A line on standard output, at once.
fn print(line: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()?;
    Ok(())
}
