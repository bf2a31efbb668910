//! `keygraph assess`: good pictures, poor pictures, models.

use std::fs;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use serde_json::Value;

use crate::astronaut;
use crate::lines::{count, list, number, path, text};
use crate::program::{Folder, picture, pixels, run_in};

/// Kinds of the limits that an assessment names.
fn kinds(assessment: &Value) -> Vec<&str> {
    list(assessment, "limits").iter().map(|l| text(l, "kind")).collect()
}

/// The rate of one cell, 0 to 1.
fn rate(assessment: &Value, condition: &str, value: f64) -> f64 {
    let row = list(assessment, "table").iter().find(|r| text(r, "condition") == condition).unwrap();
    let cell = list(row, "cells").iter().find(|c| number(c, "value") == value).unwrap();
    number(cell, "found") / number(assessment, "views")
}

/// A picture of `width` x `height` px made by a function of its pixels.
fn drawn(folder: &Folder, name: &str, [width, height]: [u32; 2], f: impl Fn(u32, u32) -> [u8; 3]) -> PathBuf {
    let path = folder.join(name);
    RgbImage::from_fn(width, height, |x, y| Rgb(f(x, y))).save(&path).unwrap();
    path
}

#[test]
fn a_good_picture_has_a_high_score_and_its_table() {
    let folder = Folder::new("assess");
    let heat = folder.join("heat.png");
    let run = keygraph!("assess", picture("astronaut"), "--views", "2", "--json", "--annotate", heat).ended_with(0);
    let a = run.object();
    assert_eq!(text(&a, "object"), "astronaut");
    assert!((80..=100).contains(&count(&a, "score")), "{a}");
    assert!(list(&a, "table").iter().all(|r| (0.0..=1.0).contains(&number(r, "rate"))), "{a}");
    // Every version of the detector must find the object in these cells.
    for (condition, value) in [("scale", 420.0), ("rotation", 180.0), ("tilt", 15.0), ("blur", 1.0), ("noise", 5.0)] {
        assert_eq!(rate(&a, condition, value), 1.0, "{condition} {value}: {a}");
    }
    // The more is exchanged, the less is taken for it.
    let taken: Vec<u64> = list(&a, "look_alikes").iter().map(|c| count(c, "found")).collect();
    assert!(taken.len() == 3 && taken[0] == 2 && taken[2] <= taken[1], "{taken:?}");
    let structure = &a["structure"];
    assert!(number(structure, "repetition") < 0.4 && number(structure, "contrast") > 40.0, "{a}");
    assert!(!kinds(&a).contains(&"few corners") && !kinds(&a).contains(&"repeated pattern"), "{a}");
    // The heat map has colour where keygraphs were found, and none in the dark corner.
    let drawn = pixels(&heat);
    assert_eq!(drawn.dimensions(), (512, 512));
    let colour =
        |x: u32, y: u32| drawn.get_pixel(x, y).0.iter().max().unwrap() - drawn.get_pixel(x, y).0.iter().min().unwrap();
    let coloured = (0..512 * 512).filter(|i| colour(i % 512, i / 512) > 40).count();
    assert!((512 * 512 / 5..512 * 512 * 19 / 20).contains(&coloured), "{coloured} px are coloured");
}

#[test]
fn a_repeated_pattern_is_named_and_scores_low() {
    let folder = Folder::new("checkers");
    let path = drawn(&folder, "checkers.png", [480, 400], |x, y| {
        [if (x / 40 + y / 40).is_multiple_of(2) { 230 } else { 30 }; 3]
    });
    let a = keygraph!("assess", path, "--views", "1", "--json").ended_with(0).object();
    assert!(count(&a, "score") < 30, "{a}");
    assert!(kinds(&a).contains(&"repeated pattern") && kinds(&a).contains(&"no chroma"), "{a}");
}

#[test]
fn a_disc_has_too_few_corners_and_no_upright() {
    let folder = Folder::new("disc");
    let path = drawn(&folder, "disc.png", [500, 400], |x, y| {
        if x.abs_diff(250).pow(2) + y.abs_diff(200).pow(2) < 8100 { [200, 60, 30] } else { [200; 3] }
    });
    let a = keygraph!("assess", path, "--views", "1", "--json").ended_with(0).object();
    assert!(count(&a, "score") < 30, "{a}");
    assert!(["few corners", "wrong places"].iter().all(|k| kinds(&a).contains(k)), "{a}");
    let words = keygraph!("assess", path, "--views", "1").ended_with(0).out;
    assert!(words.contains("few corners") && words.contains("of 100") && words.contains("tilt"), "{words}");
}

#[test]
fn a_gradient_is_refused_with_a_score_of_0() {
    let folder = Folder::new("gradient");
    let (path, heat) =
        (drawn(&folder, "gradient.png", [500, 400], |x, _| [(20 + x * 2 / 5) as u8; 3]), folder.join("h.png"));
    let a = keygraph!("assess", path, "--json", "--annotate", heat).ended_with(0).object();
    assert_eq!((count(&a, "score"), kinds(&a)), (0, vec!["refused"]));
    assert!(text(&list(&a, "limits")[0], "text").contains("texture"), "{a}");
    assert_eq!(pixels(&heat).dimensions(), (500, 400));
}

#[test]
fn a_model_alone_has_no_score_and_with_its_picture_has_the_pictures() {
    let folder = Folder::new("assess-model");
    let model = astronaut(&folder);
    let alone = keygraph!("assess", model, "--json").ended_with(0).said(&["--picture"]);
    let a = alone.object();
    assert!(a["score"].is_null() && a["table"].is_null(), "{a}");
    assert!(count(&a["structure"], "keygraphs") > 1000, "{a}");
    let of = |input: &Path, options: &[&str]| {
        let input = path(input);
        let arguments = [&["assess", &input, "--views", "1", "--json"], options].concat();
        run_in(&folder.0, &arguments, b"").ended_with(0).object()
    };
    let astronaut = path(&picture("astronaut"));
    assert_eq!(of(&model, &["--picture", &astronaut]), of(&picture("astronaut"), &["--preset", "compact"]));
    keygraph!("assess", model, "--picture", picture("coffee")).refused_with(&["512x512", "600x400"]);
    keygraph!("assess", model, "--picture", astronaut, "--picture", astronaut)
        .refused_with(&["1 objects", "2 pictures"]);
    keygraph!("assess", picture("coffee"), "--picture", astronaut).refused_with(&["--picture goes with a model"]);
    keygraph!("assess", model, "--annotate", folder.join("h.png")).refused_with(&["give --picture"]);
}

#[test]
fn a_part_of_a_picture_is_assessed_as_it_is_trained() {
    let folder = Folder::new("assess-crop");
    let (astronaut, model) = (picture("astronaut"), folder.join("part.kgm"));
    let crop = "50,40,300,280";
    keygraph!("train", astronaut, "--crop", crop, "-o", model).ended_with(0);
    let whole = keygraph!("assess", astronaut, "--crop", crop, "--views", "1", "--json").ended_with(0).object();
    assert_eq!((count(&whole["structure"], "width"), count(&whole["structure"], "height")), (300, 280));
    let of_model = keygraph!("assess", model, "--picture", astronaut, "--crop", crop, "--views", "1", "--json");
    assert_eq!(of_model.ended_with(0).object()["table"], whole["table"]);
    keygraph!("assess", model, "--picture", astronaut).refused_with(&["300x280", "512x512"]);
    keygraph!("assess", model, "--crop", crop).refused_with(&["--crop goes with one picture"]);
}

#[test]
fn a_heat_map_that_cannot_be_written_is_refused_before_the_frames() {
    let folder = Folder::new("assess-annotate");
    let path = drawn(&folder, "p.png", [100, 100], |x, y| [(x * y) as u8; 3]);
    let before = fs::read(&path).unwrap();
    keygraph!("assess", path, "--annotate", path).refused_with(&["would overwrite"]);
    assert_eq!(fs::read(&path).unwrap(), before);
    keygraph!("assess", path, "--annotate", folder.join("h.bmp")).refused_with(&[".png"]);
    keygraph!("assess", path, "--annotate", folder.join("none/h.png")).refused_with(&["does not exist"]);
}
