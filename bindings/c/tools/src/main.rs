//! Tools for the C library.
//!
//! - `header [--write]`: makes include/keygraph.h of the crate, and compares it with the file, or
//!   writes it.
//! - `frames FOLDER PROFILE FRAME...`: writes what the firmware in C reads: the model of the sample and
//!   the frames, scaled and in YUYV.
//! - `ppm PICTURE FILE`: writes a picture as PPM or PGM.
//! - `compare C RUST`: compares what the firmware in C printed with the JSON lines of `scripts/board`.
//!
//! Exit status: 0 if all is well, 1 if not.

mod frames;
mod header;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Result, bail};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("keygraph-c-tools: {e:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[&str]) -> Result<()> {
    match arguments {
        ["header"] => header::compare(),
        ["header", "--write"] => header::write(),
        ["frames", folder, profile, frames @ ..] if !frames.is_empty() => {
            frames::write(Path::new(folder), profile, frames)
        }
        ["ppm", from, to] => frames::ppm(Path::new(from), Path::new(to)),
        ["compare", c, rust] => frames::compare(Path::new(c), Path::new(rust)),
        _ => bail!("see the top of tools/src/main.rs"),
    }
}
