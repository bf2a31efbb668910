//! Tells what the core sees at each pose that it looks at closely: a model and a frame a line in, a
//! JSON line out for each detection. `scripts/evaluate fit` fits the score to it.
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
//! {"pair": 0, "thorough": false, "object": 0, "score": 0.97, "corners": [[0, 0], [9, 0], [9, 9], [0, 9]],
//!  "properties": [255, 240]}
//! ```
//!
//! `pair` is the number of the line of input, from 0. `corners` are px of the frame. `properties` have
//! the order of [`keygraph_core::stages::scrutiny::NAMES`]. A frame is searched twice: as if every pose
//! were believed, and thoroughly, since a search goes on after what is not believed. All scores are
//! told, but no pose with a low first impression, and at each place only the pose with the best score.
//! The first line that cannot be read ends the program with its number, the reason and status 1.
//!
//! Memory: one model and a detector. Cost: two searches a line.

use std::io::{BufRead, Write, stdin, stdout};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use keygraph::input::read_picture;
use keygraph::search::{Profile, depth_of, fit};
use keygraph_core::stages::pace::Steady;
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
        for thorough in [false, true] {
            self.detector.set_depth(depth_of(thorough));
            for d in self.detector.detect(&frame, &model, 0.0, &mut || 0)? {
                let corners = d.corners.map(|p| [0, 1].map(|i| (p[i] + 0.5) / scaled.scale[i] - 0.5));
                let told = json!({
                    "pair": at, "thorough": thorough, "object": d.object, "score": d.score, "corners": corners,
                    "properties": scrutinise(&planes.view(), &model, d, &mut Steady).0,
                });
                writeln!(stdout(), "{told}").context("standard output")?;
            }
        }
        Ok(())
    }
}
