//! Tells what the core sees at each pose that it looks at closely: a model and a frame a line in, a
//! JSON line out for each pose. `scripts/evaluate fit` fits the score to it.
//!
//! `cargo run --release --example scrutiny -p keygraph < PAIRS.jsonl`
//!
//! ```json
//! {"model": "cover.kgm", "frame": "frame.jpg"}
//! ```
//!
//! gives lines as this one, here with the first two of the properties:
//!
//! ```json
//! {"pair": 0, "object": 0, "score": 0.97, "corners": [[0, 0], [9, 0], [9, 9], [0, 9]], "properties": [255, 0]}
//! ```
//!
//! `pair` is the number of the line of input, from 0. `corners` are px of the frame. `properties` have
//! the order of [`keygraph_core::stages::scrutiny::NAMES`]. The search believes nothing, so that it goes on as long as
//! it can, and may come to a pose more than once.
//! The first line that cannot be read ends the program with its number, the reason and status 1.
//!
//! Memory: one model and a detector. Cost: a search to the end a line.

use std::io::{BufRead, Write, stdin, stdout};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use keygraph::input::read_picture;
use keygraph::search::{Profile, fit};
use keygraph_core::stages::scrutiny::Scrutiny;
use keygraph_core::{Detection, Frame, Model, Observer, Output, VgaDetector};
use serde_json::json;

/// A model, and the frame in which its objects are looked for.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Pair {
    model: PathBuf,
    frame: PathBuf,
}

/// What stays from line to line: the buffers, and the last model with its path.
struct Bench {
    detector: Box<VgaDetector>,
    model: (PathBuf, Vec<u8>),
}

/// Keeps the poses that are looked at closely.
#[derive(Default)]
struct Poses(Vec<(Detection, Scrutiny)>);

impl Observer for Poses {
    fn now(&mut self) -> u64 {
        0
    }

    fn saw(&mut self, output: Output<'_>) {
        if let Output::Scrutinised(detection, seen) = output {
            self.0.push((*detection, *seen));
        }
    }
}

/// A minimum score that nothing has.
const NEVER: f32 = 2.0;

fn main() -> ExitCode {
    let mut bench = Bench { detector: Box::new(VgaDetector::new()), model: Default::default() };
    for (at, line) in stdin().lock().lines().enumerate() {
        let told = line.context("standard input").and_then(|line| bench.tell(at, &line));
        if let Err(error) = told {
            eprintln!("scrutiny: line {}: {error:#}", at + 1);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

impl Bench {
    /// Searches one pair, and prints what is found.
    fn tell(&mut self, at: usize, line: &str) -> Result<()> {
        let pair: Pair = serde_json::from_str(line).context("give {\"model\": FILE, \"frame\": FILE}")?;
        if self.model.0 != pair.model {
            let bytes = std::fs::read(&pair.model).with_context(|| pair.model.display().to_string())?;
            self.model = (pair.model, bytes);
        }
        let model = Model::parse(&self.model.1).with_context(|| self.model.0.display().to_string())?;
        let picture = read_picture(&pair.frame)?;
        let (side, pixels) = Profile::Vga.limits();
        let scaled = fit(&picture, side, pixels);
        let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data)?;
        let mut poses = Poses::default();
        self.detector.detect(&frame, &model, NEVER, &mut poses)?;
        for (d, seen) in &poses.0 {
            let corners = d.corners.map(|p| [0, 1].map(|i| (p[i] + 0.5) / scaled.scale[i] - 0.5));
            let told =
                json!({"pair": at, "object": d.object, "score": d.score, "corners": corners, "properties": seen.0});
            writeln!(stdout(), "{told}").context("standard output")?;
        }
        Ok(())
    }
}
