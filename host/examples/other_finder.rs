//! Other keypoints and other triples in the same pipeline.
//!
//! A detector takes keypoints and triples of keypoints from a [`Finder`]. Its own finder
//! gives Shi-Tomasi corners and nested Delaunay triangles. The finder of this example gives
//! FAST corners, from imageproc, and triples of nearest neighbours. All later stages
//! (partition, features, matching, votes, pose, acceptance) stay the same. The model stays
//! the same too, and its keypoints are Shi-Tomasi corners: the example shows whether both
//! kinds of corner lie at the same places.
//!
//! `cargo run --release --example other_finder -p keygraph [-- FRAME.jpg...]`
//!
//! Frames are named as in `assets/sequence`; the default is `0003.jpg`. The exit status is 0
//! when the object was found in all of them, at the place that `truth.json` gives.
#![allow(clippy::cast_possible_truncation, reason = "sizes of pictures and lists")]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::{Context, Result};
use image::{GrayImage, Luma};
use imageproc::corners::corners_fast9;
use imageproc::suppress::local_maxima;
use keygraph::demo::true_pose;
use keygraph::learn::{Preset, train};
use keygraph::picture::{Picture, read_picture};
use keygraph::render::{RIGHT, corner_error};
use keygraph::search::fit;
use keygraph_core::stages::corners::Corner;
use keygraph_core::stages::delaunay::Triple;
use keygraph_core::stages::finder::Finder;
use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::pace::Pace;
use keygraph_core::stages::plane::Plane;
use keygraph_core::stages::rank::rank_by_radius;
use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, Stage, StageStats, VgaDetector, heapless::VecView};

/// The name of the object, its picture and its entries in `truth.json`.
const OBJECT: &str = "astronaut";
/// Minimum difference of a FAST corner from the arc around it, of 255.
const THRESHOLD: u8 = 12;
/// Minimum distance of a corner from a better one, px. FAST finds several pixels at every
/// corner.
const APART_PX: u32 = 2;
/// Maximum number of corners of each level of the pyramid, full size first; 0 leaves a level
/// out. The limits are low, since a corner with 8 neighbours gives 28 triples, where a
/// Delaunay triangulation gives two: the detector has room for 4,096 triples, keygraphs and
/// matches.
const LIMITS: [usize; 4] = [120, 80, 40, 0];
/// Number of neighbours of a corner in its triples.
const NEIGHBOURS: usize = 8;

/// Finds FAST corners and triples of nearest neighbours. A finder that needs memory between
/// frames, or between the levels of a frame, keeps it in such a struct.
#[derive(Debug, Default)]
struct FastNeighbours;

impl Finder for FastNeighbours {
    /// Gives the keypoints of one level of the pyramid; the levels above the finest come
    /// first. In a crowd it is called again for each tile of a level. Positions are in 1/16 px from the first
    /// pixel of `luma`, and never negative.
    fn keypoints(
        &mut self,
        luma: Plane<'_, u8>,
        level: usize,
        out: &mut VecView<Corner>,
        pace: &mut dyn Pace,
    ) -> StageStats {
        let limit = LIMITS[level];
        if limit == 0 {
            return StageStats::default();
        }
        let picture = GrayImage::from_fn(luma.width() as u32, luma.height() as u32, |x, y| {
            Luma([luma.row(y as usize)[x as usize]])
        });
        let mut found = local_maxima(&corners_fast9(&picture, THRESHOLD), APART_PX);
        // The buffer has a fixed size: the best corners go in first.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut stats = StageStats { seen: found.len() as u32, kept: 0, dropped: 0 };
        for c in &found {
            let at = |v: u32| i16::try_from(16 * v).unwrap_or(i16::MAX);
            // The strength can be any number, as long as more is better.
            let corner = Corner { point: Point::new(at(c.x), at(c.y)), strength: 1000 * c.score as i32, radius2: 0 };
            // A corner that does not fit is counted; it is no error.
            stats.dropped += u32::from(out.push(corner).is_err());
        }
        // Corners are ranked by suppression radius, so that every prefix covers the whole
        // frame, not only the part with the most texture.
        rank_by_radius(
            out,
            limit,
            &mut vec![0.0; 3 * out.len() + luma.width().div_ceil(16) * luma.height().div_ceil(16)],
            &mut stats,
            pace,
        );
        stats
    }

    /// Gives triples of the keypoints of one level; called after each call of `keypoints`.
    /// The triples index `points`, in any order of their vertices.
    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, _: &mut dyn Pace) -> StageStats {
        let mut stats = StageStats::default();
        // Two neighbours give the same triangle: it is kept once.
        let mut known = BTreeSet::new();
        for (i, p) in points.iter().enumerate() {
            let mut others: Vec<usize> = (0..points.len()).filter(|&o| o != i).collect();
            others.sort_by_key(|&o| points[o].distance2(*p));
            others.truncate(NEIGHBOURS);
            for (k, &a) in others.iter().enumerate() {
                for &b in &others[..k] {
                    let mut triple: Triple = [i, a, b].map(|v| v as u16);
                    triple.sort_unstable();
                    if known.insert(triple) {
                        stats.seen += 1;
                        match out.push(triple) {
                            Ok(()) => stats.kept += 1,
                            Err(_) => stats.dropped += 1,
                        }
                    }
                }
            }
        }
        stats
    }
}

/// The detector. It is large, so it lives in a static, where it costs no memory until it is
/// used.
static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());

fn main() -> Result<ExitCode> {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let picture = read_picture(&assets.join("pictures").join(OBJECT).with_extension("jpg"))?;
    let (bytes, _) = train(&picture, OBJECT, Preset::Large, false)?;
    let model = Model::parse(&bytes)?;

    let sequence = assets.join("sequence");
    let truth = std::fs::read_to_string(sequence.join("truth.json")).context("the true poses")?;
    let truth: serde_json::Value = serde_json::from_str(&truth)?;
    let mut frames: Vec<String> = std::env::args().skip(1).collect();
    if frames.is_empty() {
        frames.push("0003.jpg".into());
    }
    let mut all = true;
    for name in frames {
        let entry = truth.as_array().and_then(|t| t.iter().find(|e| e["image"] == name.as_str()));
        let truth = entry.and_then(|e| true_pose(&e["objects"][OBJECT]));
        let truth = truth.with_context(|| format!("truth.json has no {OBJECT} in {name}"))?;
        let truth = truth.outline(picture.width as f32, picture.height as f32);
        let found = search(&read_picture(&sequence.join(&name))?, &model)?;
        let right = found.iter().any(|corners| corner_error(corners, &truth) < RIGHT);
        println!("{name}: {}", if right { "found" } else { "not found" });
        for corners in &found {
            println!(
                "  outline {corners:.1?}, {:.1} % of its size from the truth",
                100.0 * corner_error(corners, &truth)
            );
        }
        all &= right;
    }
    Ok(if all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Searches a frame. Returns the outlines of the detections, best first.
fn search(frame: &Picture, model: &Model<'_>) -> Result<Vec<[[f32; 2]; 4]>> {
    let scaled = fit(frame, keygraph_core::Vga::LIMITS.side, keygraph_core::Vga::LIMITS.pixels);
    let view = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data)?;
    let mut detector = DETECTOR.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    // `detect` takes the same arguments without the last one. The core reads no clock; a
    // caller that wants times passes one.
    let detections = detector.detect_with(&view, model, DEFAULT_THRESHOLD, &mut || 0, &mut FastNeighbours)?;
    let found = detections.iter().map(|d| d.corners).collect();
    for stage in [Stage::Corners, Stage::Delaunay, Stage::Keygraphs, Stage::Classify] {
        let s = detector.stats().stages[stage as usize];
        println!("  {:9} seen {:6} kept {:5} dropped {:5}", stage.name(), s.seen, s.kept, s.dropped);
    }
    Ok(found)
}
