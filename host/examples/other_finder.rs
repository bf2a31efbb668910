//! The framework is open: other keypoints and other triples in our pipeline.
//!
//! A detector needs two things from a frame, keypoints and triples of them, and
//! takes both from a [`Finder`]. Its own are Shi-Tomasi corners and nested
//! Delaunay triangles. Here they are FAST corners, from imageproc, and triples
//! among nearest neighbours. What comes after (partition, features, matching,
//! votes, pose, acceptance) stays as it is, and so does the model, whose
//! keypoints are Shi-Tomasi corners: two kinds of corner meet in the middle of
//! the pipeline, so the question is whether they lie at the same places.
//!
//! `cargo run --release --example other_finder -p keygraph [-- FRAME.jpg...]`
//!
//! Frames are named as in `assets/sequence`; without a name it is `0003.jpg`.
//! The exit status says whether the object was found in all of them, at the place
//! that `truth.json` gives.
#![allow(clippy::cast_possible_truncation, reason = "sizes of pictures and lists")]

use std::collections::BTreeSet;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::{Context, Result};
use image::{GrayImage, Luma};
use imageproc::corners::corners_fast9;
use imageproc::suppress::local_maxima;
use keygraph::input::read_picture;
use keygraph::learn::{Preset, train};
use keygraph::search::fit;
use keygraph_core::capacity::{Stage, StageStats};
use keygraph_core::corners::Corner;
use keygraph_core::delaunay::Triple;
use keygraph_core::detect::{DEFAULT_THRESHOLD, Finder, VgaDetector};
use keygraph_core::frame::Frame;
use keygraph_core::geometry::{Homography, Point, area};
use keygraph_core::heapless::VecView;
use keygraph_core::model::Model;
use keygraph_core::pyramid::Plane;
use keygraph_core::rank::rank_by_radius;

/// The name of the object, its picture and its entries in `truth.json`.
const OBJECT: &str = "astronaut";
/// Gray levels by which a FAST corner differs from the arc around it.
const THRESHOLD: u8 = 12;
/// Corners nearer than this to a better one are left out, px: FAST finds several
/// pixels at every corner.
const APART_PX: u32 = 2;
/// Most corners taken from each level of the pyramid, full size first; 0 leaves a
/// level out. Few, because a corner with 8 neighbours is in 28 triples of its own,
/// where Delaunay makes two a corner: these limits stay within the 4,096 triples,
/// keygraphs and matches that the detector has room for.
const LIMITS: [usize; 4] = [120, 80, 40, 0];
/// Neighbours of a corner that its triples are made of.
const NEIGHBOURS: usize = 8;

/// FAST corners and triples of nearest neighbours. A finder that needs memory
/// between frames, or between the levels of one, keeps it in such a struct.
#[derive(Debug, Default)]
struct FastNeighbours;

impl Finder for FastNeighbours {
    /// Called once for each level of the pyramid, full size first. Positions are in
    /// px of that level, times 16, and never negative.
    fn keypoints(&mut self, luma: Plane<'_, u8>, level: usize, out: &mut VecView<Corner>) -> StageStats {
        let limit = LIMITS[level];
        if limit == 0 {
            return StageStats::default();
        }
        let picture = GrayImage::from_fn(luma.width() as u32, luma.height() as u32, |x, y| {
            Luma([luma.row(y as usize)[x as usize]])
        });
        let mut found = local_maxima(&corners_fast9(&picture, THRESHOLD), APART_PX);
        // The buffer has a fixed size: give it the best first.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut stats = StageStats { seen: found.len() as u32, kept: 0, dropped: 0 };
        for c in &found {
            let at = |v: u32| i16::try_from(16 * v).unwrap_or(i16::MAX);
            // Any number will do for the strength, as long as more is better.
            let corner = Corner { point: Point::new(at(c.x), at(c.y)), strength: 1000 * c.score as i32, radius2: 0 };
            // What no longer fits is not an error: it is counted.
            stats.dropped += u32::from(out.push(corner).is_err());
        }
        // Best first: here what stands out in its surroundings, so that every
        // prefix covers the whole frame, and not only its busiest part.
        rank_by_radius(
            out,
            limit,
            &mut vec![0.0; 3 * out.len() + luma.width().div_ceil(16) * luma.height().div_ceil(16)],
            &mut stats,
        );
        stats
    }

    /// Called after each call of `keypoints`, with what that one gave. The triples
    /// index `points`, in any order of their vertices.
    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>) -> StageStats {
        let mut stats = StageStats::default();
        // Two neighbours see the same triangle: keep it once.
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

/// A detector is large, so it lives in a static, where it costs nothing until it
/// is used.
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
        let truth = entry.and_then(|e| pose(&e["objects"][OBJECT]));
        let truth = truth.with_context(|| format!("truth.json has no {OBJECT} in {name}"))?;
        let truth = truth.outline(picture.width as f32, picture.height as f32);
        let found = search(&read_picture(&sequence.join(&name))?, &model)?;
        let right = found.iter().any(|corners| error(corners, &truth) < 0.1);
        println!("{name}: {}", if right { "found" } else { "not found" });
        for corners in &found {
            println!("  outline {corners:.1?}, {:.1} % of its size from the truth", 100.0 * error(corners, &truth));
        }
        all &= right;
    }
    Ok(if all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Outlines of what is found in a frame, best first.
fn search(frame: &keygraph::input::Picture, model: &Model<'_>) -> Result<Vec<[[f32; 2]; 4]>> {
    let scaled = fit(frame, VgaDetector::MAX_SIDE, VgaDetector::MAX_PIXELS);
    let view = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data)?;
    let mut detector = DETECTOR.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    // `detect` takes the same without the last argument. The core reads no clock; a
    // caller who wants timings passes one.
    let detections = detector.detect_with(&view, model, DEFAULT_THRESHOLD, &mut || 0, &mut FastNeighbours)?;
    let found = detections.iter().map(|d| d.corners).collect();
    for stage in [Stage::Corners, Stage::Delaunay, Stage::Keygraphs, Stage::Classify] {
        let s = detector.stats().stages[stage as usize];
        println!("  {:9} seen {:6} kept {:5} dropped {:5}", stage.name(), s.seen, s.kept, s.dropped);
    }
    Ok(found)
}

/// Nine numbers as a map from picture px to frame px.
fn pose(value: &serde_json::Value) -> Option<Homography> {
    let v: Vec<f32> = value.as_array()?.iter().filter_map(|v| v.as_f64().map(|f| f as f32)).collect();
    v.try_into().ok().map(Homography)
}

/// Mean distance of the corners of two outlines, in sizes of the second.
fn error(a: &[[f32; 2]; 4], b: &[[f32; 2]; 4]) -> f32 {
    let distance = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
    a.iter().zip(b).map(distance).sum::<f32>() / 4.0 / area(b).sqrt()
}
