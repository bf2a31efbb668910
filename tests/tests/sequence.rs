//! End to end on the shipped sequence: both objects trained from their pictures,
//! looked for in all 48 frames, and held against the truth.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fmt::Write;

use keygraph::input::{Picture, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::search::{Profile, search};
use keygraph_core::geometry::{Homography, area};
use keygraph_core::model::Model;
use keygraph_tests::file;
use serde_json::Value;

/// The frame, and where the truth puts each object.
struct Shot {
    name: String,
    picture: Picture,
    truth: Value,
}

/// How an object fared over the sequence.
#[derive(Default)]
struct Tally {
    /// Frames that show it, and those of them in which it was found.
    shown: usize,
    found: usize,
    /// Detections where it is not, in frames that show it and that do not.
    wrong_place: usize,
    false_alarms: usize,
    /// One line for each frame that went wrong.
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

/// The true outline of an object, `None` where it is absent.
fn outline(truth: &Value, width: f32, height: f32) -> Option<[[f32; 2]; 4]> {
    let numbers = truth.as_array()?;
    assert_eq!(numbers.len(), 9, "a homography has nine numbers");
    let h = Homography(std::array::from_fn(|i| numbers[i].as_f64().unwrap() as f32));
    Some(h.outline(width, height))
}

/// Mean distance of the corners, as a part of the object's size in the frame.
fn corner_error(found: &[[f32; 2]; 4], truth: &[[f32; 2]; 4]) -> f32 {
    let distance = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
    found.iter().zip(truth).map(distance).sum::<f32>() / 4.0 / area(truth).abs().sqrt()
}

/// Looks for one object in every frame.
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

/// In at least `least` of the frames that show the object, and nowhere else.
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

/// 18 or 19 were found while this was written: in the others, of the frames 38 to
/// 43 that show it at a third of its size, no candidate is near the truth.
#[test]
fn coffee_is_found_in_the_sequence() {
    check("coffee", 23, 17);
}
