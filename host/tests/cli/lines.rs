//! Values of JSON lines, and what the contract says of a line.

use std::path::Path;

use serde_json::Value;

pub use crate::program::numbers;

/// The stages of the contract, in the order of the pipeline.
const STAGES: [&str; 11] = [
    "convert",
    "pyramid",
    "corners",
    "delaunay",
    "keygraphs",
    "features",
    "classify",
    "verify",
    "vote",
    "pose",
    "accept",
];

pub fn text<'a>(v: &'a Value, key: &str) -> &'a str {
    v[key].as_str().unwrap_or_else(|| panic!("{key:?} is no text in {v}"))
}

pub fn count(v: &Value, key: &str) -> u64 {
    v[key].as_u64().unwrap_or_else(|| panic!("{key:?} is no count in {v}"))
}

pub fn number(v: &Value, key: &str) -> f64 {
    v[key].as_f64().unwrap_or_else(|| panic!("{key:?} is no number in {v}"))
}

pub fn list<'a>(v: &'a Value, key: &str) -> &'a Vec<Value> {
    v[key].as_array().unwrap_or_else(|| panic!("{key:?} is no list in {v}"))
}

pub fn corners(detection: &Value) -> [[f64; 2]; 4] {
    let corners: Vec<[f64; 2]> = list(detection, "corners").iter().map(numbers::<2>).collect();
    corners.try_into().unwrap_or_else(|_| panic!("not four corners: {detection}"))
}

pub fn centre(corners: [[f64; 2]; 4]) -> [f64; 2] {
    [0, 1].map(|i| corners.iter().map(|c| c[i]).sum::<f64>() / 4.0)
}

pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Square root of the outline's area.
pub fn size(c: [[f64; 2]; 4]) -> f64 {
    let cross = |i: usize| c[i][0] * c[(i + 1) % 4][1] - c[(i + 1) % 4][0] * c[i][1];
    ((0..4).map(cross).sum::<f64>() / 2.0).abs().sqrt()
}

/// Corners of the only detection on a line.
#[track_caller]
pub fn only(line: &Value) -> [[f64; 2]; 4] {
    let found = list(line, "detections");
    assert_eq!(found.len(), 1, "detections in {line}");
    corners(&found[0])
}

/// Asserts everything that the contract says of the line of a frame that was read.
#[track_caller]
pub fn assert_line(line: &Value, source: &str, index: u64, sides: (u64, u64)) {
    assert_eq!(text(line, "source"), source);
    assert_eq!(count(line, "frame"), index, "frame of {source}");
    assert_eq!((count(line, "width"), count(line, "height")), sides, "size of {source}");
    assert!(line.get("error").is_none(), "an error in {line}");
    let mut last = 1.0;
    for d in list(line, "detections") {
        assert!(!text(d, "object").is_empty());
        assert_eq!(text(d, "state"), "found");
        let score = number(d, "score");
        assert!((0.0..=last).contains(&score), "scores from 1 down to 0, best first: {line}");
        last = score;
        count(d, "votes");
        let places = corners(d);
        assert!(places.as_flattened().iter().all(|v| decimals(*v) <= 2), "places to 0.01 px: {places:?}");
        let h = numbers::<9>(&d["homography"]);
        assert!(h.iter().all(|v| digits(*v) <= 7), "seven digits: {h:?}");
        assert!((h[8] - 1.0).abs() < 1e-6, "the last number of a homography is 1: {h:?}");
    }
    let stages = line["stages"].as_object().unwrap();
    assert_eq!(stages.keys().collect::<Vec<_>>(), STAGES, "stages");
    for (name, s) in stages {
        for key in ["seen", "kept", "dropped"] {
            assert!(s[key].is_u64(), "{key} of {name} in {line}");
        }
    }
    let times = line["time_ms"].as_object().unwrap();
    assert_eq!(times.len(), STAGES.len() + 1, "all stages and the total: {times:?}");
    for name in STAGES.iter().chain(&["total"]) {
        assert!(times[*name].as_f64().unwrap() >= 0.0, "{name} in {times:?}");
    }
}

/// Number of significant digits of a number.
fn digits(v: f64) -> usize {
    format!("{v:e}").split('e').next().unwrap_or_default().matches(|c: char| c.is_ascii_digit()).count()
}

/// Number of decimals that a number has in JSON.
pub fn decimals(v: f64) -> usize {
    v.to_string().split_once('.').map_or(0, |(_, rest)| rest.len())
}

/// Asserts that the homography maps the corners of a picture of `w` x `h` px to the corners
/// of the detection.
#[track_caller]
pub fn assert_outline(detection: &Value, [w, h]: [f64; 2], tolerance: f64) {
    let m = numbers::<9>(&detection["homography"]);
    for ([x, y], corner) in [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].into_iter().zip(corners(detection)) {
        let third = m[6] * x + m[7] * y + m[8];
        let at = [(m[0] * x + m[1] * y + m[2]) / third, (m[3] * x + m[4] * y + m[5]) / third];
        assert!(distance(at, corner) < tolerance, "({x}, {y}) lies at {at:?}, and the corner at {corner:?}");
    }
}

pub fn path(p: &Path) -> String {
    p.display().to_string()
}

pub fn without_times(mut lines: Vec<Value>) -> Vec<Value> {
    for line in &mut lines {
        line.as_object_mut().unwrap().remove("time_ms");
    }
    lines
}
