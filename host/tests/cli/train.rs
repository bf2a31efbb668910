//! `keygraph train` and `keygraph inspect`: models, and the pictures that make them.

use std::fs;

use image::{GrayImage, Rgb, Rgba, RgbaImage, imageops};
use serde_json::Value;

use crate::lines::{count, text};
use crate::program::{Folder, frame, picture, pixels, run_in};

/// Trains with `options`, and asserts what holds for every report.
fn report(name: &str, options: &[&str]) -> Value {
    let folder = Folder::new(&format!("report-{name}{}", options.concat()));
    let model = folder.join("model.kgm");
    let mut arguments = args!["train", picture(name), "-o", model, "--json"].to_vec();
    arguments.extend(options.iter().map(Into::into));
    let trained = run_in(&folder.0, &arguments, b"").ended_with(0);
    assert_eq!(trained.err, format!("keygraph: written: {}\n", model.display()), "standard error");
    let report = trained.object();
    for key in ["keypoints", "triples", "keygraphs", "cells_used", "largest_cell", "bytes"] {
        assert!(count(&report, key) > 0, "{key} in {report}");
    }
    assert_eq!(count(&report, "bytes"), fs::metadata(&model).unwrap().len(), "bytes are those of the file");
    assert!(count(&report, "largest_cell") <= count(&report, "keygraphs"), "{report}");
    assert!(count(&report, "keygraphs") <= count(&report, "largest_cell") * count(&report, "cells_used"), "{report}");
    let inspected = keygraph!("inspect", model, "--json").ended_with(0);
    assert_eq!(inspected.object(), report, "inspect tells what train told");
    assert!(keygraph!("inspect", model).ended_with(0).out.contains(name), "inspect in words names the object");
    report
}

#[test]
fn the_compact_model_is_reported_and_inspected_alike() {
    let report = report("astronaut", &["--preset", "compact"]);
    assert_eq!(text(&report, "feature"), "both");
    assert!(count(&report, "bytes") <= 524_288, "{report}");
}

#[test]
fn the_standard_model_keeps_its_size() {
    assert!(count(&report("coffee", &["--preset", "standard"]), "bytes") <= 1_500_000);
}

#[test]
fn bytes_stand_in_for_those_of_the_preset() {
    assert!((32 << 10..=64 << 10).contains(&count(&report("coffee", &["--bytes", "65536"]), "bytes")));
    let raised = count(&report("coffee", &["--preset", "compact", "--bytes", "1000000"]), "bytes");
    assert!((524_289..=1_000_000).contains(&raised), "{raised}");
}

#[test]
fn a_cap_too_small_for_a_model_is_refused_with_what_is_needed() {
    let folder = Folder::new("cap");
    let model = folder.join("m.kgm");
    keygraph!("train", picture("coffee"), "-o", model, "--bytes", "100").refused_with(&["100 bytes", "are needed"]);
    assert!(!model.exists());
}

#[test]
fn the_default_preset_is_large_and_keeps_its_size() {
    let large = report("chelsea", &[]);
    assert!((1_500_000..=2_000_000).contains(&count(&large, "bytes")), "{large}");
}

#[test]
fn the_report_is_for_users_and_its_numbers_are_extra() {
    let folder = Folder::new("words");
    let model = folder.join("my book.kgm");
    let run = keygraph!("train", picture("astronaut"), "-o", model).ended_with(0);
    assert_eq!(run.err, "");
    for part in [
        "object     astronaut, from ",
        "found      yes, in its own picture: score 0.99, outline 0.",
        "picture    good: ",
        &format!("written    {}, 2.0 MB\n", model.display()),
        &format!("next       keygraph detect -m '{}' photo.jpg\n", model.display()),
    ] {
        assert!(run.out.contains(part), "{part:?} is not in\n{}", run.out);
    }
    assert!(!run.out.contains("subsets"), "{}", run.out);
    let long = keygraph!("train", picture("astronaut"), "-o", model, "--verbose").ended_with(0).out;
    assert!(long.starts_with(&run.out) && long.contains("subsets ") && long.contains("views "), "{long}");
    let paper = keygraph!("train", picture("astronaut"), "-o", model, "--preset", "paper").ended_with(0).out;
    assert!(paper.contains("picture    not judged"), "{paper}");
    // What limits a picture is told with what to do, once.
    let (dull, model) = (folder.join("dull.png"), folder.join("dull.kgm"));
    let mut photo = image::open(picture("coffee")).unwrap().into_rgb8();
    photo.pixels_mut().for_each(|p| p.0 = p.0.map(|v| 110 + v / 9));
    photo.save(&dull).unwrap();
    let run = keygraph!("train", dull, "-o", model).ended_with(0);
    assert!(run.out.contains("picture    could be better:\n           - low contrast: "), "{}{}", run.out, run.err);
    assert!(run.out.contains("take the picture in better light"), "{}", run.out);
    let (narrow, model) = (folder.join("narrow.png"), folder.join("narrow.kgm"));
    imageops::crop_imm(&pixels(&picture("coffee")), 0, 150, 600, 110).to_image().save(&narrow).unwrap();
    let run = keygraph!("train", narrow, "-o", model).ended_with(0).said(&["times as long as wide"]);
    assert!(run.out.contains("picture    could be better, as said above\n"), "{}", run.out);
}

#[test]
fn luma_models_say_so() {
    assert_eq!(text(&report("astronaut", &["--preset", "compact", "--luma"]), "feature"), "luma");
}

/// The paper's method takes every triple of 79 corners. On photographs, its rules leave this
/// many keygraphs, in subsets of this size.
#[test]
fn the_paper_preset_counts_as_the_paper_does() {
    for name in ["astronaut", "coffee", "chelsea"] {
        let report = report(name, &["--preset", "paper"]);
        assert_eq!((count(&report, "keypoints"), count(&report, "triples")), (79, 79_079), "{name}");
        assert!((45_000..=56_000).contains(&count(&report, "keygraphs")), "{name}: {report}");
        assert!((450..=800).contains(&count(&report, "largest_cell")), "{name}: {report}");
        assert_eq!(text(&report, "feature"), "chroma", "{name}");
    }
}

#[test]
fn the_name_is_the_one_given() {
    let folder = Folder::new("name");
    let model = folder.join("m.kgm");
    let arguments = ["--name", "Eileen Collins", "--preset", "compact"];
    keygraph!("train", picture("astronaut"), "-o", model, arguments[0], arguments[1], arguments[2], arguments[3])
        .ended_with(0);
    let line = &keygraph!("detect", "-m", model, frame(0), "--json").ended_with(0).lines()[0];
    assert_eq!(text(&line["detections"][0], "object"), "Eileen Collins");
}

#[test]
fn a_picture_of_one_colour_is_refused_and_leaves_no_file() {
    let folder = Folder::new("constant");
    let (gray, model) = (folder.join("gray.png"), folder.join("gray.kgm"));
    GrayImage::from_pixel(200, 160, [128].into()).save(&gray).unwrap();
    keygraph!("train", gray, "-o", model).refused_with(&["gray.png", "more texture"]);
    assert_eq!(folder.names(), ["gray.png"]);
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let folder = Folder::new("nowhere");
    let model = folder.join("no/such/m.kgm");
    keygraph!("train", picture("astronaut"), "-o", model, "--preset", "compact").refused_with(&[
        "cannot write",
        "no/such/m.kgm",
        "no/such does not exist",
    ]);
}

#[test]
fn what_is_no_picture_is_refused() {
    let folder = Folder::new("no-picture");
    let (text, model) = (folder.file("text.png", b"hello"), folder.join("m.kgm"));
    keygraph!("train", text, "-o", model).refused_with(&["text.png", "not a PNG, JPEG, WebP"]);
    keygraph!("train", folder.join("missing.png"), "-o", model).refused_with(&["missing.png", "no such file"]);
    assert!(!model.exists(), "a model of nothing");
}

#[test]
fn a_transparent_picture_trains_and_the_transparency_is_told() {
    let folder = Folder::new("transparent");
    let (cut, model) = (folder.join("cut.png"), folder.join("cut.kgm"));
    let photo = pixels(&picture("coffee"));
    let alpha = |x: u32, y: u32| if (x as i32 - 300).pow(2) + (y as i32 - 200).pow(2) < 190 * 190 { 255 } else { 0 };
    let image = RgbaImage::from_fn(600, 400, |x, y| {
        let Rgb([r, g, b]) = *photo.get_pixel(x, y);
        Rgba([r, g, b, alpha(x, y)])
    });
    image.save(&cut).unwrap();
    let run = keygraph!("train", cut, "-o", model, "--preset", "compact", "--json").ended_with(0);
    assert!(count(&run.object(), "keygraphs") > 1000, "{}", run.out);
    run.said(&["cut.png", "transparent", "white"]);
}

#[test]
fn a_gray_picture_trains_but_not_as_the_paper_does() {
    let folder = Folder::new("gray");
    let (model, paper) = (folder.join("brick.kgm"), folder.join("paper.kgm"));
    let run = keygraph!("train", picture("brick"), "-o", model, "--preset", "compact", "--json").ended_with(0);
    assert!(count(&run.object(), "keygraphs") > 1000, "{}", run.out);
    keygraph!("train", picture("brick"), "-o", paper, "--preset", "paper")
        .refused_with(&["no colour", "another preset"]);
    assert_eq!(folder.names(), ["brick.kgm"]);
}

#[test]
fn a_small_picture_trains_or_is_refused_with_advice() {
    let folder = Folder::new("small");
    let photo = pixels(&picture("astronaut"));
    for side in [120, 20, 5] {
        let name = folder.join(&format!("{side}.png"));
        let model = name.with_extension("kgm");
        imageops::crop_imm(&photo, 200, 60, side, side).to_image().save(&name).unwrap();
        let run = keygraph!("train", name, "-o", model, "--preset", "compact", "--json");
        if run.status == 0 {
            assert!(count(&run.object(), "keygraphs") > 0, "{side} px: {}", run.out);
            keygraph!("detect", "-m", model, frame(0)).ended_with(0);
        } else {
            assert!(!model.exists(), "{side} px: refused, and there is a model");
            let advice = ["use", "take", "at least", "give"].iter().any(|w| run.err.contains(w));
            assert!(advice, "{side} px: no advice in {:?}", run.err);
            run.refused_with(&[".png"]);
        }
        assert!(side < 120 || model.exists(), "120 px are enough for a model");
    }
}

#[test]
fn a_gray_picture_trains_on_luma_and_is_found_in_colour() {
    let folder = Folder::new("gray-luma");
    let (gray, model) = (folder.join("gray.png"), folder.join("gray.kgm"));
    image::open(picture("astronaut")).unwrap().to_luma8().save(&gray).unwrap();
    let trained = keygraph!("train", gray, "-o", model, "--json").ended_with(0).said(&["no colour", "luma"]);
    assert_eq!(trained.object()["feature"], "luma");
    for line in keygraph!("detect", "-m", model, frame(0), frame(2), "--json").ended_with(0).lines() {
        assert_eq!(line["detections"].as_array().unwrap().len(), 1, "{line}");
    }
}

#[test]
fn a_picture_that_is_too_narrow_comes_with_advice() {
    let folder = Folder::new("narrow");
    let (narrow, model) = (folder.join("narrow.png"), folder.join("narrow.kgm"));
    image::open(picture("astronaut")).unwrap().resize_exact(640, 20, image::imageops::Triangle).save(&narrow).unwrap();
    let run = keygraph!("train", narrow, "-o", model);
    if run.status == 0 {
        run.said(&["not found even in", "less elongated"]);
    } else {
        run.said(&["narrow"]);
    }
}
