//! Tells what the core sees at each pose that it looks at closely: one JSON line in, one JSON line
//! out for each detection. `scripts/evaluate fit` fits the score to it.
//!
//! `cargo run --release --example scrutiny -p keygraph < PAIRS.jsonl`
//!
//! In, on standard input, a model and a frame a line:
//!
//! ```json
//! {"model": "cover.kgm", "frame": "frame.jpg"}
//! ```
//!
//! Out, on standard output, a line for each detection, whatever its score: the number of its line
//! of input (from 0), the object's index, the score, the corners in px of the frame, and the
//! properties in the order of [`keygraph_core::stages::scrutiny::NAMES`], each 0 to 255:
//!
//! ```json
//! {"pair": 0, "object": 0, "score": 0.97, "corners": [[0, 0], [9, 0], [9, 9], [0, 9]], "properties": [255, 240]}
//! ```
//!
//! Poses with a low first impression are no detections. Of several poses at one place, the one with
//! the best present score is told. A line that cannot be read ends the program: its number and the
//! reason go to standard error, and the exit status is 1.
//!
//! Memory: one model and a detector. Cost: a search for each line.

use std::io::{BufRead, Write, stdin, stdout};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use keygraph::input::read_picture;
use keygraph::search::{Profile, fit};
use keygraph_core::stages::pyramid::Pyramid;
use keygraph_core::stages::scrutiny::scrutinise;
use keygraph_core::{Frame, Model, VgaDetector, chroma_bytes, luma_bytes};
use serde_json::json;

const PIXELS: usize = 640 * 480;

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
    pyramid: Box<Pyramid<{ luma_bytes(PIXELS) }, { chroma_bytes(PIXELS) }>>,
    model: (PathBuf, Vec<u8>),
}

fn main() -> ExitCode {
    let (detector, pyramid) = (Box::new(VgaDetector::new()), Box::new(Pyramid::new()));
    let mut bench = Bench { detector, pyramid, model: Default::default() };
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
        let mut planes = self.pyramid.planes_mut();
        planes.load(&frame)?;
        planes.reduce();
        for d in self.detector.detect(&frame, &model, 0.0, &mut || 0)? {
            let properties = scrutinise(&planes.view(), &model, d).0;
            let corners = d.corners.map(|p| [0, 1].map(|i| (p[i] + 0.5) / scaled.scale[i] - 0.5));
            let told =
                json!({"pair": at, "object": d.object, "score": d.score, "corners": corners, "properties": properties});
            writeln!(stdout(), "{told}").context("standard output")?;
        }
        Ok(())
    }
}
