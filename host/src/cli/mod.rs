//! The command line: one file a command, with its arguments and what it does.
//!
//! - `model_files`: models as files, read and parsed
//! - `compare`: objects that look alike
//! - `values`: values of arguments that several commands take
//! - `config`: options from a file
//! - `train`, `pack`, `inspect`, `assess`, `detect`, `find`, `explain`, `bench`, `calibrate`, `camera`, `order`, `extras`, `demo`: the commands

mod compare;
mod model_files;
mod values;

#[cfg(feature = "live")]
mod config;

mod assess;
mod bench;
#[cfg(feature = "calibrate")]
mod calibrate;
#[cfg(feature = "live")]
mod camera;
mod demo;
mod detect;
mod explain;
#[cfg(feature = "extras")]
mod extras;
mod find;
mod inspect;
#[cfg(feature = "live")]
mod order;
mod pack;
mod train;

use std::env;
use std::ffi::OsString;
use std::fmt::Display;
use std::process::ExitCode;

#[cfg(feature = "live")]
use anyhow::Context;
use anyhow::Result;
use clap::error::ErrorKind;
use clap::{ColorChoice, CommandFactory, Parser, Subcommand};
use keygraph::notice::{keep_quiet, notice, set_colours};
use keygraph::output::plain_lines;

/// Finds planar objects (books, posters, boxes, signs) in camera frames from one
/// picture of each.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    /// Say only what fails: no notices, no progress, and no report of a file that was written
    #[arg(short, long, global = true, help_heading = "Of all commands")]
    quiet: bool,
    /// When messages and help have colours; NO_COLOR in the environment turns them off too
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto", help_heading = "Of all commands")]
    color: ColorChoice,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a model on one picture of an object, or on an object held up to a camera
    Train(Box<train::Arguments>),
    /// Merge models into one file that finds all their objects, or change the objects of such a file
    Pack(pack::Arguments),
    /// Tell what is in a model
    Inspect(inspect::Arguments),
    /// Tell how well a picture will be found, before it is used
    ///
    /// Renders frames that show the picture over a range of scale, rotation, tilt,
    /// blur, darkness and noise, searches them, and reports a score from 0 to 100,
    /// the table behind it, and what limits it.
    Assess(assess::Arguments),
    /// Find the objects of models in pictures, folders, videos or a stream
    Detect(detect::Arguments),
    /// Find the object of one picture in others: trains in memory, then as `detect`
    Find(find::Arguments),
    /// Tell why the object of a picture is found in a frame, or is not
    ///
    /// Writes a picture of each stage of the search, and says in words what it made. Where nothing is found, says
    /// what would help.
    Explain(explain::Arguments),
    /// Measure the search: time by stage, memory by buffer, one digest
    ///
    /// Searches the same frames again and again, one after the other. Each pass must find what
    /// the first pass found. The digest stands for the output of all stages; it is the
    /// same on every machine.
    Bench(bench::Arguments),
    /// Measure a camera and its lens with a trained picture
    ///
    /// The picture is shown to the camera from many sides; no chessboard is needed. Focal lengths, principal point
    /// and distortion are written as OpenCV reads them, for `detect --lens`.
    #[cfg(feature = "calibrate")]
    Calibrate(calibrate::Arguments),
    /// Find the objects of models in front of a camera, live
    ///
    /// Prints JSON lines, serves a page that shows what is seen and learns objects
    /// that are held up, and runs until it is told to stop.
    #[cfg(feature = "live")]
    Camera(Box<camera::Arguments>),
    /// Order models for cameras that follow a broker
    ///
    /// Prints one line of JSON, for `mosquitto_pub --retain --stdin-file`: names, addresses, sizes
    /// and hashes of the models that all cameras are to run.
    #[cfg(feature = "live")]
    Order(order::Arguments),
    /// Write what a package puts beside the program: completions of shells, pages of the manual
    #[cfg(feature = "extras")]
    Extras(extras::Arguments),
    /// Train on the repository's pictures and find them in its sequence
    Demo(demo::Arguments),
}

#[cfg(feature = "live")]
impl Command {
    /// Whether the command has an end of its own at a signal.
    fn is_live(&self) -> bool {
        match self {
            Self::Camera(_) => true,
            Self::Train(arguments) => arguments.is_from_camera(),
            _ => false,
        }
    }
}

/// Reads the command line and runs the command.
///
/// # Errors
/// When the command fails, a file of options cannot be read, or signals cannot be waited for. A wrong command line ends
/// the program with status 2.
pub fn run() -> Result<ExitCode> {
    // A wrong command line is told in colours or without, too.
    if let Some(when) = wanted_colours(env::args_os()) {
        set_colours(when);
    }
    #[cfg(feature = "live")]
    let (cli, warnings) = config::parse()?;
    #[cfg(not(feature = "live"))]
    let (cli, warnings) = (Cli::parse(), Vec::<String>::new());
    set_colours(cli.color);
    if cli.quiet {
        keep_quiet();
    }
    warnings.iter().for_each(|warning| notice(&plain_lines(warning)));
    #[cfg(feature = "live")]
    if !cli.command.is_live() {
        keygraph::ending::end_at_signals().context("signals cannot be waited for")?;
    }
    match cli.command {
        Command::Train(arguments) => train::run(&arguments)?,
        Command::Pack(arguments) => pack::run(&arguments)?,
        Command::Inspect(arguments) => inspect::run(&arguments)?,
        Command::Assess(arguments) => assess::run(&arguments)?,
        Command::Detect(arguments) => return detect::run(arguments),
        Command::Find(arguments) => return find::run(&arguments),
        Command::Explain(arguments) => return explain::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments)?,
        #[cfg(feature = "calibrate")]
        Command::Calibrate(arguments) => return calibrate::run(&arguments),
        #[cfg(feature = "live")]
        Command::Camera(arguments) => camera::run(&arguments)?,
        #[cfg(feature = "live")]
        Command::Order(arguments) => order::run(&arguments)?,
        #[cfg(feature = "extras")]
        Command::Extras(arguments) => extras::run(&arguments)?,
        Command::Demo(arguments) => demo::run(&arguments)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// What `--color` says, before the command line is known to be right.
fn wanted_colours(arguments: impl Iterator<Item = OsString>) -> Option<ColorChoice> {
    let arguments: Vec<_> = arguments.take_while(|a| a != "--").map(|a| a.to_string_lossy().into_owned()).collect();
    let apart = arguments.windows(2).filter(|pair| pair[0] == "--color").map(|pair| pair[1].as_str());
    let joined = arguments.iter().filter_map(|a| a.strip_prefix("--color="));
    joined.chain(apart).find_map(|when| when.parse().ok())
}

/// Ends the program with status 2, as a wrong command line does.
fn usage_error(kind: ErrorKind, message: impl Display) -> ! {
    Cli::command().error(kind, message).exit()
}
