//! Tests the whole path on the shipped sequence: trains both objects from their pictures, searches
//! all 48 frames for them, and compares the results with the true poses.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fmt::Write;

use keygraph::input::{Picture, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::render::corner_error;
use keygraph::search::{Profile, search};
use keygraph_core::{Homography, Model};
use keygraph_tests::file;
use serde_json::Value;

/// A frame, and the true pose of each object in it.
struct Shot {
    name: String,
    picture: Picture,
    truth: Value,
}

/// The results of one object over the sequence.
#[derive(Default)]
struct Tally {
    /// Frames that show the object.
    shown: usize,
    /// Frames that show the object and in which it was found.
    found: usize,
    /// Detections at a wrong place, in frames that show the object.
    wrong_place: usize,
    /// Detections in frames that do not show the object.
    false_alarms: usize,
    /// One line for each frame with an error.
    report: String,
}

fn shots() -> Vec<Shot> {
    let folder = file("assets/sequence");
    let truth: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("truth.json")).unwrap()).unwrap();
    let shot = |t: &Value| {
        let name = t["image"].as_str().unwrap().to_string();
        Shot { picture: read_picture(&folder.join(&name)).unwrap(), name, truth: t["objects"].clone() }
    };
    truth.as_array().unwrap().iter().map(shot).collect()
}

/// Returns the true outline of an object, or `None` if it is absent.
fn outline(truth: &Value, width: f32, height: f32) -> Option<[[f32; 2]; 4]> {
    let numbers = truth.as_array()?;
    assert_eq!(numbers.len(), 9, "a homography has nine numbers");
    let h = Homography(std::array::from_fn(|i| numbers[i].as_f64().unwrap() as f32));
    Some(h.outline(width, height))
}

/// Searches every frame for one object.
fn run(object: &str) -> Tally {
    let picture = read_picture(&file("assets/pictures").join(object).with_extension("jpg")).unwrap();
    let (bytes, _) = train(&picture, object, Preset::Large, false).unwrap();
    let model = Model::parse(&bytes).unwrap();
    let (w, h) = (picture.width as f32, picture.height as f32);
    let mut tally = Tally::default();
    for shot in shots() {
        let found = search(&shot.picture, &model, Profile::Vga, 0.5, false, 0).unwrap().detections;
        let truth = outline(&shot.truth[object], w, h);
        let errors: Vec<f32> =
            found.iter().map(|d| truth.as_ref().map_or(f32::INFINITY, |t| corner_error(&d.corners, t))).collect();
        let right = errors.iter().filter(|&&e| e < 0.1).count();
        let scores: Vec<f32> = found.iter().map(|d| d.score).collect();
        let mut note = |what: &str| {
            writeln!(tally.report, "{} {object}: {what}, errors {errors:.3?}, scores {scores:.3?}", shot.name).unwrap();
        };
        if truth.is_some() {
            tally.shown += 1;
            tally.found += usize::from(right > 0);
            tally.wrong_place += found.len() - right;
            if right == 0 {
                note("missed");
            }
            if found.len() > right {
                note("wrong place");
            }
        } else {
            tally.false_alarms += found.len();
            if !found.is_empty() {
                note("false alarm");
            }
        }
    }
    println!(
        "{object}: {} of {} frames, {} in a wrong place, {} false alarms\n{}",
        tally.found, tally.shown, tally.wrong_place, tally.false_alarms, tally.report
    );
    tally
}

/// Checks that the object is found in at least `least` of the `shown` frames that show it, and nowhere else.
fn check(object: &str, shown: usize, least: usize) {
    let t = run(object);
    assert_eq!(t.shown, shown, "frames of the truth that show {object}");
    assert_eq!(t.false_alarms, 0, "detections where {object} is absent:\n{}", t.report);
    assert_eq!(t.wrong_place, 0, "detections of {object} in a wrong place:\n{}", t.report);
    assert!(t.found >= least, "{object} found in {} of {} frames, not in {least}:\n{}", t.found, t.shown, t.report);
}

#[test]
fn astronaut_is_found_in_the_sequence() {
    check("astronaut", 36, 35);
}

/// When this test was written, 18 or 19 frames were found. The other frames are among the frames 38
/// to 43, which show the object at a third of its size. There no candidate is near the truth.
#[test]
fn coffee_is_found_in_the_sequence() {
    check("coffee", 23, 17);
}
