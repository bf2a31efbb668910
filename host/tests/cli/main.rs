//! The program as users and scripts run it.
//!
//! In: arguments. Out: standard output, standard error, exit status and files. The
//! contract: one JSON line a frame and nothing else on standard output, coordinates in
//! the pixels of the input, exit status 0, 1 or 2.
//!
//! - `lines`: values of JSON lines, and what the contract says of them
//! - `commands`: the page with the help of every command
//! - `usage`: wrong command lines, and models that cannot be read
//! - `train`, `pack`, `detect`, `find`, `explain`, `inputs`, `annotate`, `assess`, `video`, `demo`: by command and by input
//! - `ending`: commands that a signal ends
//! - `region`: parts of frames, and frames that are mirrored
//! - `wide`: what is seen from far to the side
//! - `debian`: what the package for Debian holds
//! - `writing`: files that are written, and faults while they are
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

#[path = "../program/mod.rs"]
mod program;

/// Arguments of several kinds as one list.
macro_rules! args {
    ($($a:expr),* $(,)?) => { [$(AsRef::<std::ffi::OsStr>::as_ref(&$a).to_os_string()),*] };
}

/// Runs the program with the arguments given, in the folder of temporary files.
macro_rules! keygraph {
    ($($a:expr),* $(,)?) => { crate::program::keygraph(&args![$($a),*]) };
}

mod lines;

mod annotate;
mod assess;
mod commands;
#[cfg(unix)]
mod debian;
mod demo;
mod detect;
mod ending;
mod explain;
mod find;
mod inputs;
mod pack;
mod region;
mod train;
mod usage;
mod video;
mod wide;
mod writing;

use std::fs;
use std::path::PathBuf;
use std::sync::LazyLock;

use program::{Folder, picture, run_in};

static ASTRONAUT: LazyLock<Vec<u8>> = LazyLock::new(|| compact("astronaut", &[]));

/// Trains the compact model of a picture of the repository.
fn compact(name: &str, options: &[&str]) -> Vec<u8> {
    let folder = Folder::new(&format!("compact-{name}{}", options.concat()));
    let model = folder.join("model.kgm");
    let mut arguments = args!["train", picture(name), "-o", model, "--preset", "compact"].to_vec();
    arguments.extend(options.iter().map(Into::into));
    run_in(&folder.0, &arguments, b"").ended_with(0);
    fs::read(model).unwrap()
}

/// Writes the compact model of the astronaut to a file.
fn astronaut(folder: &Folder) -> PathBuf {
    folder.file("astronaut.kgm", &ASTRONAUT)
}
