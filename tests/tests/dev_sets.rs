//! Tests on real photographs with known poses: DVD covers, a turned cube, a book, stills, and desks
//! that show none of these.
//!
//! The pictures are not ours to ship. The environment variable
//! `KEYGRAPH_EVAL` names the folder that holds them. Without the folder these tests are skipped, or
//! fail if `KEYGRAPH_MUST_NOT_SKIP` is set.
//!
//! An object is found if the mean corner distance is under 10 % of the square root of the area of
//! the true outline.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::PathBuf;

use keygraph::input::read_picture;
use keygraph::learn::{Preset, train};
use keygraph::render::corner_error;
use keygraph::search::{Profile, search};
use keygraph_core::{DEFAULT_THRESHOLD, Homography, Model};
use keygraph_tests::file;
use serde_json::Value;

/// Maximum corner error of a right detection, in sizes of the true outline.
const FOUND: f32 = 0.1;

/// Returns the folder of the evaluation data. If the folder is absent, returns `None` and prints a
/// line that cargo does not hide.
fn evaluation() -> Option<PathBuf> {
    let folder = std::env::var_os("KEYGRAPH_EVAL").map_or_else(|| file("../shared/eval/dev"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    let nothing = format!("no evaluation data at {}: set KEYGRAPH_EVAL to the folder that holds it", folder.display());
    assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "{nothing}, and nothing may be skipped");
    let _ = writeln!(std::io::stderr(), "SKIPPED: {nothing}");
    None
}

/// The results of a set.
#[derive(Default)]
struct Tally {
    frames: usize,
    /// Frames that show the object.
    shown: usize,
    /// Frames that show the object and in which it was found.
    found: usize,
    /// Detections in frames that do not show the object.
    absent: usize,
    /// Detections at another place than the object's.
    elsewhere: usize,
    /// One line for each frame with an error.
    report: String,
}

/// Reads the true pose from three rows of three numbers. Returns `None` if the object is absent.
fn pose(h: &Value) -> Option<Homography> {
    let numbers: Vec<f32> =
        h.as_array()?.iter().flat_map(|row| row.as_array().unwrap()).map(|v| v.as_f64().unwrap() as f32).collect();
    Some(Homography(numbers.try_into().unwrap()))
}

/// Searches every `step`th frame of a set for each of its objects. Each test has a detector of its
/// own in `slot`. Returns `None` without data.
fn run(set: &str, step: usize, slot: usize) -> Option<Tally> {
    let folder = evaluation()?;
    let path = folder.join(set).with_extension("json");
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let truth: Value = serde_json::from_str(&text).unwrap();
    let mut tally = Tally::default();
    for object in truth.as_array().unwrap() {
        let name = object["name"].as_str().unwrap();
        let picture = read_picture(&folder.join(object["model"].as_str().unwrap())).unwrap();
        let (model, _) = train(&picture, name, Preset::Large, false).unwrap();
        let model = Model::parse(&model).unwrap();
        let (w, h) = (picture.width as f32, picture.height as f32);
        let frames = object["frames"].as_array().unwrap().iter().step_by(step);
        // The frame that the picture of the model was cut from proves nothing.
        for frame in frames.filter(|f| f["train"] != true) {
            let image = frame["image"].as_str().unwrap();
            let picture = read_picture(&folder.join(image)).unwrap();
            let found = search(&picture, &model, Profile::Vga, DEFAULT_THRESHOLD, false, slot).unwrap().detections;
            let outline = pose(&frame["H"]).map(|p| p.outline(w, h));
            tally.frames += 1;
            let scores: Vec<f32> = found.iter().map(|d| d.score).collect();
            let Some(outline) = outline else {
                tally.absent += found.len();
                if !found.is_empty() {
                    writeln!(tally.report, "  {image}, {name} absent: found with scores {scores:.2?}").unwrap();
                }
                continue;
            };
            let errors: Vec<f32> = found.iter().map(|d| corner_error(&d.corners, &outline)).collect();
            let right = errors.first().is_some_and(|&e| e < FOUND);
            tally.shown += 1;
            tally.found += usize::from(right);
            tally.elsewhere += found.len() - usize::from(right);
            if !right || found.len() > 1 {
                let what = if right { "found, with other detections" } else { "missed" };
                writeln!(tally.report, "  {image}, {name} {what}: errors {errors:.2?}, scores {scores:.2?}").unwrap();
            }
        }
    }
    println!(
        "{set}: {} of {} found, {} elsewhere, {} where absent, {} frames\n{}",
        tally.found, tally.shown, tally.elsewhere, tally.absent, tally.frames, tally.report
    );
    Some(tally)
}

/// Checks that the object is found in at least 95 % of the `frames` frames, all of which show it.
fn check(set: &str, step: usize, slot: usize, frames: usize) {
    let Some(t) = run(set, step, slot) else { return };
    assert_eq!((t.frames, t.shown), (frames, frames), "frames of {set}, and those that show the object");
    let least = (frames * 95).div_ceil(100);
    assert!(t.found >= least, "{set}: {} of {frames} found, not {least}; wrong:\n{}", t.found, t.report);
}

#[test]
fn dvd_covers_are_found() {
    check("dvd", 1, 0, 40);
}

#[test]
fn the_turned_cube_is_found() {
    check("cube", 5, 1, 9);
}

#[test]
fn the_book_is_found() {
    check("book-mvg", 6, 2, 10);
}

#[test]
fn the_stills_are_found() {
    check("stills", 1, 3, 3);
}

#[test]
fn nothing_is_found_on_desks_without_it() {
    let Some(t) = run("desk-absent", 5, 4) else { return };
    assert_eq!((t.frames, t.shown), (30, 0), "frames of desk-absent, and those that show the object");
    assert_eq!(t.absent, 0, "detections of what is not there:\n{}", t.report);
}
