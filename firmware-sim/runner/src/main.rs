//! `scripts/board`: the emulated board on a model and frames.
//!
//! In: a model and pictures, folders or videos. Out: the lines of `keygraph detect
//! --json`, with `instructions` in place of `time_ms`; or tables of memory and cost.
//! Exit status 0 when all went well, 1 when not, 2 for a wrong command line.

use std::fs;
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
use keygraph_board::tables;
use keygraph_core::capacity::Stage;
use keygraph_core::detect::{DEFAULT_THRESHOLD, Stats};
use keygraph_core::digest::Digests;
use keygraph_core::frame::Frame;
use keygraph_core::model::Model;
use keygraph_firmware_sim::learn::largest;
use keygraph_firmware_sim::wire::{BUFFERS, FrameHeader, Job, Report, instructions};
use serde_json::{Value, json};

/// Finds the objects of a model on an emulated board.
#[derive(Debug, Parser)]
#[command(name = "scripts/board")]
struct Cli {
    /// Size of frames
    #[arg(long, value_enum, default_value = "qvga")]
    profile: Frames,
    /// The board [default: m7 for qvga, m4 for qqvga]
    #[arg(long, value_enum)]
    machine: Option<Machine>,
    /// What the board's sensor gives
    #[arg(long, value_enum, default_value = "yuyv")]
    format: SensorFormat,
    /// Least score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD)]
    threshold: f32,
    /// Add a digest of each stage's output
    #[arg(long)]
    digests: bool,
    /// Search each frame on this machine too, and fail if any digest differs
    #[arg(long)]
    check: bool,
    /// Learn what is in the middle of the first frame, and find it in the others: all
    /// arguments are frames
    #[arg(long)]
    learn: bool,
    /// Run the main loop of examples/camera.rs, and print what it sends over its serial
    /// port
    #[arg(long, conflicts_with_all = ["learn", "check", "digests", "tables"])]
    camera: bool,
    /// Print tables of memory and of instructions (median over the frames) instead
    #[arg(long)]
    tables: bool,
    /// Show the board's log on standard error; twice: in detail
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
    /// The model, then frames: pictures, folders, videos
    #[arg(required = true, value_name = "MODEL FRAME")]
    inputs: Vec<PathBuf>,
}

fn main() -> ExitCode {
    match board(&Cli::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("board: {e:#}");
            ExitCode::FAILURE
        }
    }
}

/// A frame as the board is given it.
struct Shot {
    source: String,
    frame: u64,
    picture: Picture,
    scale: [f32; 2],
    header: FrameHeader,
}

/// Whether every frame could be read, and every check held.
fn board(cli: &Cli) -> Result<bool> {
    let machine = cli.machine.unwrap_or(match cli.profile {
        Frames::Qvga => Machine::M7,
        Frames::Qqvga => Machine::M4,
    });
    let (model, inputs) = match &cli.inputs[..] {
        frames if cli.learn => (None, frames),
        [model, frames @ ..] => (Some(load(model)?), frames),
        [] => (None, &[][..]),
    };
    ensure!(!inputs.is_empty(), "give frames too: pictures, folders or videos");
    let program = match (cli.learn, cli.camera) {
        (true, _) => Program::Learn,
        (_, true) => Program::Camera,
        _ => Program::Detect,
    };
    let log = ["warn", "debug", "trace"][usize::from(cli.verbose.min(2))];
    let elf = build(program, machine, cli.profile, log)?;
    let contents = Contents::read(&elf)?;
    if log == "warn" {
        contents.check_code(program)?;
    }

    let (shots, stream, mut fine) = gather(cli, inputs)?;
    let output = run(&elf, &contents, machine, model.as_deref(), &stream)?;
    if cli.camera {
        print!("{}", output.serial);
        return Ok(fine);
    }

    let mut words = output.words.iter().copied();
    let mut searched = &shots[..];
    let learnt;
    let model = match &model {
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
    let detector = sizes()?;
    let buffers = (0..BUFFERS).map(|_| sizes()).collect::<Result<Vec<_>>>()?;
    let mut reports = Vec::new();
    for shot in searched {
        let (report, detections) =
            Report::decode(&mut || words.next()).with_context(|| format!("{}: the board told nothing", shot.source))?;
        let digests = Digests::from_values(report.digests);
        let stats = Stats { stages: report.stages, ..Stats::default() };
        let digests_told = (cli.digests || cli.check).then_some(digests);
        let mut found = Found { digests: digests_told, ..Found::new(detections.to_vec(), stats) };
        found.map_back(shot.scale);
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
    let stack = reports.iter().map(|r| r.stack_bytes).max().unwrap_or(0);
    if cli.tables {
        println!("{}", tables::memory((program, machine, cli.profile), &contents, detector, &buffers, stack));
        println!("{}", tables::cost(&reports));
    }
    ensure!(stack <= STACK_LIMIT, "the stack took {stack} bytes; at most {STACK_LIMIT} are allowed");
    Ok(fine)
}

fn load(path: &Path) -> Result<Vec<u8>> {
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Model::parse(&bytes).with_context(|| path.display().to_string())?;
    Ok(bytes)
}

const fn host_profile(frames: Frames) -> Profile {
    match frames {
        Frames::Qvga => Profile::Qvga,
        Frames::Qqvga => Profile::Qqvga,
    }
}

/// The frames, what the board is to read, and whether all could be read.
fn gather(cli: &Cli, inputs: &[PathBuf]) -> Result<(Vec<Shot>, Vec<u8>, bool)> {
    let (mut shots, mut frames, mut fine) = (Vec::new(), Vec::new(), true);
    for item in Source::open(inputs)? {
        let (source, frame) = (item.source, item.frame);
        let taken = item.picture.and_then(|picture| {
            let scaled = prepare(&picture, host_profile(cli.profile), Some(cli.format.0));
            Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).with_context(|| source.clone())?;
            let limit = 2 * cli.profile_pixels();
            ensure!(
                scaled.data.len() <= limit,
                "a frame in this format takes {} bytes, the board's buffer has {limit}: use yuyv, rgb565, nv12, i420 or gray8",
                scaled.data.len()
            );
            let header = FrameHeader { format: scaled.format, size: [scaled.width as u32, scaled.height as u32] };
            header.encode().iter().for_each(|w| frames.extend(w.to_le_bytes()));
            frames.extend_from_slice(&scaled.data);
            let scale = scaled.scale;
            Ok((picture, scale, header))
        });
        match taken {
            Ok((picture, scale, header)) => shots.push(Shot { source, frame, picture, scale, header }),
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
    let job = Job { threshold: cli.threshold, digests: cli.digests || cli.check, learn };
    let mut stream: Vec<u8> = job.encode().iter().flat_map(|w| w.to_le_bytes()).collect();
    stream.append(&mut frames);
    Ok((shots, stream, fine))
}

impl Cli {
    const fn profile_pixels(&self) -> usize {
        host_profile(self.profile).limits().1
    }
}

/// The middle of a frame that is learnt: three quarters of both sides.
fn middle(frames: Frames, size: [u32; 2]) -> [u32; 2] {
    let [longer, shorter] = largest(frames == Frames::Qvga);
    let limit = if size[0] >= size[1] { [longer, shorter] } else { [shorter, longer] };
    [0, 1].map(|i| (size[i] * 3 / 4).min(limit[i] as u32) & !1)
}

/// What learning told: the line to print, and the model.
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

/// Whether this machine does the same with the frame, stage by stage.
fn agrees(cli: &Cli, model: &Model<'_>, shot: &Shot, board: &Digests) -> Result<bool> {
    let request = Request {
        profile: host_profile(cli.profile),
        threshold: cli.threshold,
        details: false,
        format: Some(cli.format.0),
        digests: true,
    };
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

/// The line of a frame.
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
    }
    line
}
