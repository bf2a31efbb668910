//! `scripts/board`: searches frames for the objects of a model on an emulated board.
//!
//! In: a model and pictures, folders or videos. Without a model, the sample model is linked in.
//! Out: the lines of `keygraph detect --json`, with `instructions` in place of `time_ms`; or tables
//! of memory and cost.
//! Exit status: 0 if everything went well, 1 if not, 2 for a wrong command line.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use keygraph::input::{Picture, Source};
use keygraph::report::{error_line, frame_line};
use keygraph::search::{Found, Profile, Request, prepare, search_for};
use keygraph::sensor::SensorFormat;
use keygraph_board::board::{Contents, Frames, Machine, Program, STACK_LIMIT, build};
use keygraph_board::emulator::run;
use keygraph_board::tables::Run;
use keygraph_board::{baseline, sample};
use keygraph_core::stages::digest::Digests;
use keygraph_core::{Buffer, DEFAULT_THRESHOLD, Frame, Homography, MAGIC, Model, Stage, Stats};
use keygraph_firmware_sim::learn::largest;
use keygraph_firmware_sim::wire::{FORMATS, FrameHeader, Job, Report, instructions, ticks_of};
use serde_json::{Value, json};

/// Finds the objects of a model on an emulated board.
#[derive(Debug, Parser)]
#[command(name = "scripts/board")]
struct Cli {
    /// Size of the frames
    #[arg(long, value_enum, default_value = "qvga")]
    profile: Frames,
    /// The board [default: n6 for vga, m7 for qvga, m4 for qqvga]
    #[arg(long, value_enum)]
    machine: Option<Machine>,
    /// Pixel format of the board's sensor
    #[arg(long, value_enum, default_value = "yuyv")]
    format: SensorFormat,
    /// Minimum score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD)]
    threshold: f32,
    /// Add a digest of each stage's output
    #[arg(long)]
    digests: bool,
    /// Search each frame on this machine too, and fail if any digest differs
    #[arg(long)]
    check: bool,
    /// Learn the object in the middle of the first frame, and find it in the other frames: all
    /// arguments are frames
    #[arg(long)]
    learn: bool,
    /// Run the main loop of examples/camera.rs, and print what it sends over its serial
    /// port
    #[arg(long, conflicts_with_all = ["learn", "check", "digests", "tables"])]
    camera: bool,
    /// Fail if the sample costs more instructions than firmware-sim/baseline.json allows: the frames
    /// of the sample are searched, and no arguments are needed
    #[arg(long, conflicts_with_all = ["learn", "camera", "inputs", "format"])]
    baseline: bool,
    /// Stop each search after this many instructions
    #[arg(long, value_name = "N", conflicts_with_all = ["check", "baseline"])]
    budget: Option<u64>,
    /// Search the frames that are hard on a search: patterns, noise, copies of the object
    #[arg(long, conflicts_with_all = ["baseline", "learn", "camera", "inputs"])]
    worst: bool,
    /// Measure the sample on all boards, and write firmware-sim/baseline.json and the tables of
    /// firmware-sim/README.md again
    #[arg(long, exclusive = true)]
    renew: bool,
    /// Run a firmware that ends with an error, for the tests
    #[arg(long, hide = true)]
    ends: Option<Ends>,
    /// Print tables of memory and of instructions (median over the frames) instead of lines
    #[arg(long)]
    tables: bool,
    /// Show the board's log on standard error; give it twice for more detail
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
    /// A model, then frames: pictures, folders, videos. Without a model, the sample model (of
    /// assets/pictures/astronaut.jpg) is linked in
    #[arg(required_unless_present_any = ["baseline", "worst", "renew", "ends"], value_name = "[MODEL] FRAME")]
    inputs: Vec<PathBuf>,
}

/// The error that a test firmware ends with.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Ends {
    Panic,
    Fault,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    match if cli.renew { renew() } else { board(&cli).map(|(fine, _)| fine) } {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("board: {e:#}");
            ExitCode::FAILURE
        }
    }
}

/// A frame as it is given to the board.
struct Shot {
    source: String,
    frame: u64,
    picture: Picture,
    /// The map from px of the board's frame to px of the picture.
    to_picture: Homography,
    header: FrameHeader,
}

/// Measures the sample on all boards, and writes the baseline and the tables.
fn renew() -> Result<bool> {
    let (mut runs, mut worst) = (Vec::new(), Vec::new());
    for (profile, machine) in [("vga", "m55"), ("vga", "n6"), ("qvga", "m7"), ("qqvga", "m4")] {
        let board = ["--profile", profile, "--machine", machine];
        let cli = Cli::parse_from(["scripts/board", "--baseline", "--tables", "--check"].iter().chain(&board));
        for (frames, to) in [(sample::frames()?, &mut runs), (cli.hard_frames(true)?, &mut worst)] {
            let (fine, run) = searched(&cli, &frames)?;
            ensure!(fine, "this machine and the board {machine} differ with {profile}: nothing was written");
            to.extend(run);
        }
    }
    baseline::renew(&runs, &worst)?;
    Ok(true)
}

/// Runs what the command line asks for. Returns whether every frame could be read and every check
/// passed, and the figures of the run.
fn board(cli: &Cli) -> Result<(bool, Option<Run>)> {
    if cli.worst {
        return searched(cli, &cli.hard_frames(true)?);
    }
    if !cli.baseline {
        return searched(cli, &cli.inputs);
    }
    let (mut fine, run) = searched(cli, &sample::frames()?)?;
    let (fine_too, worst) = searched(cli, &cli.hard_frames(false)?)?;
    fine &= fine_too;
    if let (Some(run), Some(worst)) = (&run, &worst) {
        for line in baseline::compare(run, worst)? {
            fine = false;
            eprintln!("board: {line}");
        }
    }
    let advice = if fine { "no more than the baseline" } else { "if that has to be, run scripts/board --renew" };
    eprintln!("board: {advice}");
    Ok((fine, run))
}

/// Searches frames. The first of `inputs` may be a model. Returns the same as `board`.
fn searched(cli: &Cli, inputs: &[PathBuf]) -> Result<(bool, Option<Run>)> {
    let machine = cli.machine.unwrap_or(match cli.profile {
        Frames::Vga => Machine::N6,
        Frames::Qvga => Machine::M7,
        Frames::Qqvga => Machine::M4,
    });
    let (model, inputs) = match inputs {
        [model, frames @ ..] if is_model(model) => (Some(load(model)?), frames),
        frames => (None, frames),
    };
    ensure!(model.is_none() || !cli.learn, "--learn makes the model: give it frames alone");
    ensure!(!inputs.is_empty() || cli.ends.is_some(), "give frames too: pictures, folders or videos");
    let program = match (cli.learn, cli.camera, cli.ends) {
        (_, _, Some(Ends::Panic)) => Program::Panic,
        (_, _, Some(Ends::Fault)) => Program::Fault,
        (true, ..) => Program::Learn,
        (_, true, _) => Program::Camera,
        _ => Program::Detect,
    };
    // Without a model, the sample model becomes part of the firmware.
    let linked = match program {
        Program::Detect | Program::Camera if model.is_none() => Some(sample::model()?),
        _ => None,
    };
    let log = ["warn", "debug", "trace"][usize::from(cli.verbose.min(2))];
    let elf = build(program, machine, cli.profile, log, linked.as_ref().map(|(path, _)| path.as_path()))?;
    let contents = Contents::read(&elf)?;
    if log == "warn" {
        contents.check_code(program, machine)?;
    }
    let mut show = |line: &str| eprintln!("board: {line}");
    if cli.ends.is_some() {
        run(&elf, &contents, machine, None, &[], &mut show)?;
        return Ok((true, None));
    }

    let (shots, stream, mut fine) = gather(cli, inputs)?;
    let output = run(&elf, &contents, machine, model.as_deref(), &stream, &mut show)?;
    if cli.camera {
        print!("{}", output.serial);
        return Ok((fine, None));
    }

    let mut words = output.words.iter().copied();
    let mut searched = &shots[..];
    let learnt;
    let model = match model.as_ref().or(linked.as_ref().map(|(_, bytes)| bytes)) {
        Some(bytes) => Model::parse(bytes)?,
        None => {
            let (line, bytes) = read_learnt(&mut words, &shots[0]).context("the board's results end early")?;
            searched = &shots[1..];
            learnt = bytes;
            if !cli.tables {
                println!("{line}");
            }
            Model::parse(&learnt)?
        }
    };
    let mut sizes = || words.next().context("the board's results end early");
    let detector = (sizes()?, (0..Buffer::COUNT).map(|_| sizes()).collect::<Result<Vec<_>>>()?);
    let mut reports = Vec::new();
    for shot in searched {
        let (report, detections) =
            Report::decode(&mut || words.next()).with_context(|| format!("{}: the board told nothing", shot.source))?;
        let digests = Digests::from_values(report.digests);
        let mut stats = Stats::default();
        stats.stages = report.stages;
        stats.stopped = report.stopped != 0;
        let digests_told = (cli.digests || cli.check).then_some(digests);
        let mut found = Found { digests: digests_told, ..Found::new(detections.to_vec(), stats) };
        found.map_back(&shot.to_picture);
        if cli.check {
            fine &= agrees(cli, &model, shot, &digests)?;
        }
        if !cli.tables {
            println!("{}", line(shot, &model, &found, &report));
        }
        reports.push(report);
    }
    if cli.check && fine {
        eprintln!("board: {} frames: every stage does the same here and there", reports.len());
    }
    let run = Run { of: (program, machine, cli.profile), contents, detector, reports };
    if cli.tables {
        println!("{}", run.memory_table());
        println!("{}", run.cost_table());
    }
    let stack = run.stack();
    ensure!(stack <= STACK_LIMIT, "the stack took {stack} bytes; at most {STACK_LIMIT} are allowed");
    Ok((fine, Some(run)))
}

/// Returns whether a file is a model, whole or damaged, and not a frame.
fn is_model(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    let read = File::open(path).and_then(|mut f| f.read_exact(&mut magic));
    path.extension().is_some_and(|e| e == "kgm") || (read.is_ok() && magic == MAGIC)
}

fn load(path: &Path) -> Result<Vec<u8>> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Model::parse(&bytes).with_context(|| path.display().to_string())?;
    Ok(bytes)
}

const fn host_profile(frames: Frames) -> Profile {
    match frames {
        Frames::Vga => Profile::Vga,
        Frames::Qvga => Profile::Qvga,
        Frames::Qqvga => Profile::Qqvga,
    }
}

/// Reads the frames. Returns them, the bytes that the board will read, and whether all frames could be read.
fn gather(cli: &Cli, inputs: &[PathBuf]) -> Result<(Vec<Shot>, Vec<u8>, bool)> {
    let (mut shots, mut frames, mut fine) = (Vec::new(), Vec::new(), true);
    for item in Source::open(inputs)? {
        let (source, frame) = (item.source, item.frame);
        let taken = item.picture.and_then(|picture| {
            let scaled = prepare(&picture, &cli.request())?;
            Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).with_context(|| source.clone())?;
            let limit = 2 * cli.profile_pixels();
            ensure!(
                scaled.data.len() <= limit,
                "a frame in this format takes {} bytes, the board's buffer has {limit}: use yuyv, rgb565, nv12, i420 or gray8",
                scaled.data.len()
            );
            ensure!(
                FORMATS.contains(&scaled.format),
                "the firmware has no room for the code of this format: use yuyv, rgb565, nv12, i420 or gray8"
            );
            let header = FrameHeader { format: scaled.format, size: [scaled.width as u32, scaled.height as u32] };
            header.encode().iter().for_each(|w| frames.extend(w.to_le_bytes()));
            frames.extend_from_slice(&scaled.data);
            let to_picture = scaled.to_picture;
            Ok((picture, to_picture, header))
        });
        match taken {
            Ok((picture, to_picture, header)) => shots.push(Shot { source, frame, picture, to_picture, header }),
            Err(e) => {
                fine = false;
                eprintln!("board: {e:#}");
                if !cli.tables && !cli.camera {
                    println!("{}", error_line(&source, frame, &format!("{e:#}")));
                }
            }
        }
    }
    ensure!(!shots.is_empty(), "there is no frame to give to the board");
    let learn = if cli.learn { middle(cli.profile, shots[0].header.size) } else { [0; 2] };
    let job = Job {
        threshold: cli.threshold,
        digests: cli.digests || cli.check,
        learn,
        budget: cli.budget.map_or(0, ticks_of),
    };
    let mut stream: Vec<u8> = job.encode().iter().flat_map(|w| w.to_le_bytes()).collect();
    stream.append(&mut frames);
    Ok((shots, stream, fine))
}

impl Cli {
    fn hard_frames(&self, all: bool) -> Result<Vec<PathBuf>> {
        sample::hard_frames(host_profile(self.profile).limits(), all)
    }

    /// The search of the board, for this machine.
    const fn request(&self) -> Request {
        Request { format: Some(self.format.0), ..Request::new(host_profile(self.profile), self.threshold) }
    }

    const fn profile_pixels(&self) -> usize {
        host_profile(self.profile).limits().1
    }
}

/// Returns the size of the part that is learnt, px: three quarters of both sides of the frame, and
/// at most the largest object that the board can learn.
fn middle(frames: Frames, size: [u32; 2]) -> [u32; 2] {
    let [longer, shorter] = largest(frames == Frames::Qqvga);
    let limit = if size[0] >= size[1] { [longer, shorter] } else { [shorter, longer] };
    [0, 1].map(|i| (size[i] * 3 / 4).min(limit[i] as u32) & !1)
}

/// Reads the result of learning: the line to print, and the model.
fn read_learnt(words: &mut impl Iterator<Item = u32>, shot: &Shot) -> Option<(Value, Vec<u8>)> {
    let [ticks, bytes, keygraphs, stack] = [words.next()?, words.next()?, words.next()?, words.next()?];
    let model: Vec<u8> =
        words.take(bytes.div_ceil(4) as usize).flat_map(u32::to_le_bytes).take(bytes as usize).collect();
    let line = json!({
        "source": shot.source, "frame": shot.frame,
        "learnt": {"keygraphs": keygraphs, "bytes": bytes, "stack_bytes": stack},
        "instructions": {"total": instructions(ticks)},
    });
    Some((line, model))
}

/// Searches the frame on this machine too, and returns whether all digests are equal.
fn agrees(cli: &Cli, model: &Model<'_>, shot: &Shot, board: &Digests) -> Result<bool> {
    let request = Request { digests: true, ..cli.request() };
    let host = search_for(&shot.picture, model, &request, 0)?.digests.context("digests were asked for")?;
    let differs = Stage::ALL.into_iter().find(|&s| host.of(s) != board.of(s));
    if let Some(stage) = differs {
        eprintln!(
            "board: {} [{}]: {} differs first: {:08x} here, {:08x} on the board",
            shot.source,
            shot.frame,
            stage.name(),
            host.of(stage),
            board.of(stage)
        );
    }
    Ok(differs.is_none())
}

/// Returns the JSON line of a frame.
fn line(shot: &Shot, model: &Model<'_>, found: &Found, report: &Report) -> Value {
    let size = (shot.picture.width, shot.picture.height);
    let mut line = frame_line(&shot.source, shot.frame, size, model, found, None);
    let stages = report.instructions();
    let mut counts = json!({"total": stages.iter().sum::<u64>()});
    for (stage, n) in Stage::ALL.iter().zip(stages) {
        counts[stage.name()] = n.into();
    }
    if let Some(line) = line.as_object_mut() {
        line.remove("time_ms");
        line.insert("instructions".into(), counts);
        line.insert("stack_bytes".into(), report.stack_bytes.into());
        line.insert("longest".into(), instructions(report.longest).into());
    }
    line
}
