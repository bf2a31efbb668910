//! `keygraph bench`: what the search costs.

use std::path::PathBuf;

use anyhow::{Context, Result};
use keygraph::bench::{Plan, bench};
use keygraph::demo;
use keygraph::input::Source;
use keygraph::learn::Preset;
use keygraph::output::print_line;
use keygraph::picture::Picture;
use keygraph::search::{MAX_THREADS, Profile, Request, depth_of};
use keygraph::{report, words};
use keygraph_core::DEFAULT_THRESHOLD;

use super::model_files::{load, parse};

/// Arguments of `keygraph bench`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
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
    /// Number of passes that are timed
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    passes: u16,
    /// Maximum number of frames of a pass; they are held in memory
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..))]
    frames: u16,
    /// Threads that search a frame together; the digest does not depend on them
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=MAX_THREADS as i64))]
    threads: u8,
    /// Also measure following from frame to frame
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
}

/// Measures the search and prints the result.
///
/// # Errors
/// When a model or a frame cannot be read, or a pass differs from the first.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut inputs = arguments.inputs.clone();
    let bytes = if arguments.models.is_empty() {
        let (sequence, model) = demo::sample(&arguments.assets, arguments.preset)?;
        inputs.push(sequence);
        model
    } else {
        load(&arguments.models)?
    };
    let model = parse(&bytes, &arguments.models)?;
    let pictures: Vec<Picture> = Source::open(&inputs)?
        .take(usize::from(arguments.frames))
        .map(|f| f.picture.with_context(|| f.source))
        .collect::<Result<_>>()?;
    let plan = Plan {
        request: Request {
            depth: depth_of(arguments.thorough),
            threads: arguments.threads.into(),
            ..Request::new(arguments.profile, DEFAULT_THRESHOLD)
        },
        passes: usize::from(arguments.passes),
        track: arguments.track,
    };
    let measured = bench(&pictures, &model, &plan)?;
    print_line(&if arguments.json {
        report::bench_object(&measured).to_string()
    } else {
        words::benchmark(&measured, &model)
    })
}
