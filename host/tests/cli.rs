//! The program as its users and their scripts meet it: arguments in; standard
//! output, standard error, exit status and files out. The contract is section 5 of
//! the design: one JSON line a frame and nothing else, coordinates in the pixels of
//! the input, exit status 0, 1 or 2.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod program;

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use image::{GrayImage, Rgb, RgbImage, Rgba, RgbaImage, imageops};
use program::{Folder, assets, frame, keygraph, picture, pixels, run_in};
use serde_json::Value;

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

/// Arguments of several kinds as one list.
macro_rules! args {
    ($($a:expr),* $(,)?) => { [$(AsRef::<OsStr>::as_ref(&$a).to_os_string()),*] };
}

/// Runs the program with the arguments given, in the folder of temporary files.
macro_rules! keygraph {
    ($($a:expr),* $(,)?) => { keygraph(&args![$($a),*]) };
}

static ASTRONAUT: LazyLock<Vec<u8>> = LazyLock::new(|| compact("astronaut", &[]));

/// The compact model of a picture of the repository.
fn compact(name: &str, options: &[&str]) -> Vec<u8> {
    let folder = Folder::new(&format!("compact-{name}{}", options.concat()));
    let model = folder.join("model.kgm");
    let mut arguments = args!["train", picture(name), "-o", model, "--preset", "compact"].to_vec();
    arguments.extend(options.iter().map(Into::into));
    run_in(&folder.0, &arguments, b"").ended_with(0);
    fs::read(model).unwrap()
}

/// The compact model of the astronaut, as a file.
fn astronaut(folder: &Folder) -> PathBuf {
    folder.file("astronaut.kgm", &ASTRONAUT)
}

// ----------------------------------------------------------------- the lines

fn text<'a>(v: &'a Value, key: &str) -> &'a str {
    v[key].as_str().unwrap_or_else(|| panic!("{key:?} is no text in {v}"))
}

fn count(v: &Value, key: &str) -> u64 {
    v[key].as_u64().unwrap_or_else(|| panic!("{key:?} is no count in {v}"))
}

fn number(v: &Value, key: &str) -> f64 {
    v[key].as_f64().unwrap_or_else(|| panic!("{key:?} is no number in {v}"))
}

fn list<'a>(v: &'a Value, key: &str) -> &'a Vec<Value> {
    v[key].as_array().unwrap_or_else(|| panic!("{key:?} is no list in {v}"))
}

fn numbers<const N: usize>(v: &Value) -> [f64; N] {
    let all: Vec<f64> = v.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    all.try_into().unwrap_or_else(|_| panic!("not {N} numbers: {v}"))
}

fn corners(detection: &Value) -> [[f64; 2]; 4] {
    let corners: Vec<[f64; 2]> = list(detection, "corners").iter().map(numbers::<2>).collect();
    corners.try_into().unwrap_or_else(|_| panic!("not four corners: {detection}"))
}

fn centre(corners: [[f64; 2]; 4]) -> [f64; 2] {
    [0, 1].map(|i| corners.iter().map(|c| c[i]).sum::<f64>() / 4.0)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Square root of the outline's area.
fn size(c: [[f64; 2]; 4]) -> f64 {
    let cross = |i: usize| c[i][0] * c[(i + 1) % 4][1] - c[(i + 1) % 4][0] * c[i][1];
    ((0..4).map(cross).sum::<f64>() / 2.0).abs().sqrt()
}

/// Corners of the only detection on a line.
#[track_caller]
fn only(line: &Value) -> [[f64; 2]; 4] {
    let found = list(line, "detections");
    assert_eq!(found.len(), 1, "detections in {line}");
    corners(&found[0])
}

/// Everything that the contract says of the line of a frame that was read.
#[track_caller]
fn assert_line(line: &Value, source: &str, index: u64, sides: (u64, u64)) {
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
        corners(d);
        let h = numbers::<9>(&d["homography"]);
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

/// The corners are the images of the corners of a picture of `w` x `h` px.
#[track_caller]
fn assert_outline(detection: &Value, [w, h]: [f64; 2], tolerance: f64) {
    let m = numbers::<9>(&detection["homography"]);
    for ([x, y], corner) in [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].into_iter().zip(corners(detection)) {
        let third = m[6] * x + m[7] * y + m[8];
        let at = [(m[0] * x + m[1] * y + m[2]) / third, (m[3] * x + m[4] * y + m[5]) / third];
        assert!(distance(at, corner) < tolerance, "({x}, {y}) lies at {at:?}, and the corner at {corner:?}");
    }
}

fn path(p: &Path) -> String {
    p.display().to_string()
}

fn without_times(mut lines: Vec<Value>) -> Vec<Value> {
    for line in &mut lines {
        line.as_object_mut().unwrap().remove("time_ms");
    }
    lines
}

// --------------------------------------------------------- train and inspect

/// Trains with `options` and checks what holds for every report.
fn report(name: &str, options: &[&str]) -> Value {
    let folder = Folder::new(&format!("report-{name}{}", options.concat()));
    let model = folder.join("model.kgm");
    let mut arguments = args!["train", picture(name), "-o", model, "--json"].to_vec();
    arguments.extend(options.iter().map(Into::into));
    let trained = run_in(&folder.0, &arguments, b"").ended_with(0);
    assert_eq!(trained.err, "", "standard error");
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
fn luma_models_say_so() {
    assert_eq!(text(&report("astronaut", &["--preset", "compact", "--luma"]), "feature"), "luma");
}

/// Section 1 of the design: every triple of 79 corners, and of these as many
/// keygraphs, in subsets of such a size, as the paper's rules leave on photographs.
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
    keygraph!("train", text, "-o", model).refused_with(&["text.png", "not a PNG or JPEG"]);
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

// ------------------------------------------------------------ pack and merge

#[test]
fn packed_models_find_what_each_finds() {
    let folder = Folder::new("pack");
    let (astronaut, coffee) = (astronaut(&folder), folder.file("coffee.kgm", &compact("coffee", &[])));
    let all = folder.join("all.kgm");
    let packed = keygraph!("pack", astronaut, coffee, "-o", all).ended_with(0);
    assert!(packed.out.contains("2 objects"), "{}", packed.out);

    let one = |model: &Path| keygraph!("inspect", model, "--json").ended_with(0).object();
    let (report, parts) = (one(&all), [one(&astronaut), one(&coffee)]);
    let sum = |key| parts.iter().map(|p| count(p, key)).sum::<u64>();
    for key in ["keypoints", "triples"] {
        assert_eq!(count(&report, key), sum(key), "{key} add up");
    }
    let own = sum("keygraphs");
    assert!((own + 1..=2 * own).contains(&count(&report, "keygraphs")), "some are on the lists, too");
    let names: Vec<_> = list(&report, "objects").iter().map(|o| text(o, "name").to_string()).collect();
    assert_eq!(names, ["astronaut", "coffee"]);

    // The file, and the models given one by one, are the same to detect.
    let by_file = keygraph!("detect", "-m", all, frame(17), "--json").ended_with(0);
    let by_two = keygraph!("detect", "-m", astronaut, "-m", coffee, frame(17), "--json").ended_with(0);
    let mut found: Vec<_> =
        list(&by_two.lines()[0], "detections").iter().map(|d| text(d, "object").to_string()).collect();
    found.sort();
    assert_eq!(found, ["astronaut", "coffee"], "both objects of the frame");
    assert_eq!(without_times(by_file.lines()), without_times(by_two.lines()));
}

#[test]
fn models_that_do_not_go_together_are_refused_with_advice() {
    let folder = Folder::new("mixed");
    let (both, luma) = (astronaut(&folder), folder.file("luma.kgm", &compact("coffee", &["--luma"])));
    let all = folder.join("all.kgm");
    keygraph!("pack", both, luma, "-o", all).refused_with(&["model 2", "--luma", "train all alike"]);
    assert!(!all.exists());
    keygraph!("detect", "-m", luma, "-m", both, frame(0), "--json").refused_with(&["train all alike"]);
}

// -------------------------------------------------------------------- detect

#[test]
fn one_line_a_frame_in_order_whatever_cannot_be_read() {
    let folder = Folder::new("lines");
    let model = astronaut(&folder);
    let mut png = Vec::new();
    pixels(&frame(0)).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let broken = folder.file("broken.png", &png[..png.len() / 2]);
    let missing = folder.join("missing.png");
    let inputs = [frame(0), missing, frame(1), broken, frame(2)];
    let [a, b, c, d, e] = &inputs;

    let mut answers = Vec::new();
    for threads in ["1", "2"] {
        let run = keygraph!("detect", "-m", model, "--json", "--threads", threads, a, b, c, d, e)
            .ended_with(1)
            .said(&["missing.png: no such file", "broken.png", "damaged or cut off"]);
        let lines = run.lines();
        assert_eq!(lines.len(), inputs.len(), "lines of\n{}", run.out);
        for (line, input) in lines.iter().zip(&inputs) {
            let name = path(input);
            if input.parent() == Some(&folder.0) {
                assert_eq!(text(line, "source"), name);
                assert_eq!(count(line, "frame"), 0);
                assert!(!text(line, "error").is_empty());
                assert!(list(line, "detections").is_empty(), "detections of an error: {line}");
                continue;
            }
            assert_line(line, &name, 0, (640, 480));
            only(line);
            let found = &line["detections"][0];
            assert_eq!(text(found, "object"), "astronaut");
            assert!(count(found, "votes") >= 3, "{found}");
            assert_outline(found, [512.0, 512.0], 0.01);
            assert!(count(&line["stages"]["corners"], "kept") > 0, "{line}");
        }
        answers.push(without_times(lines));
    }
    assert_eq!(answers[0], answers[1], "one thread and two");
}

#[test]
fn a_folder_gives_its_pictures_by_name() {
    let folder = Folder::new("folder");
    let model = astronaut(&folder);
    let pictures = folder.join("pictures");
    fs::create_dir(&pictures).unwrap();
    for (from, to) in [(1, "b.jpg"), (0, "c.JPG"), (2, "a.jpeg")] {
        fs::copy(frame(from), pictures.join(to)).unwrap();
    }
    fs::write(pictures.join("notes.txt"), "not a picture").unwrap();
    let run = keygraph!("detect", "-m", model, pictures, "--json").ended_with(0);
    let lines = run.lines();
    let sources: Vec<_> = lines.iter().map(|l| text(l, "source").to_string()).collect();
    assert_eq!(sources, ["a.jpeg", "b.jpg", "c.JPG"].map(|n| path(&pictures.join(n))));
    assert_eq!(run.err, "", "standard error when all is well");
    for line in &lines {
        only(line);
    }
}

#[test]
fn without_json_the_answer_is_in_words() {
    let folder = Folder::new("words");
    let run = keygraph!("detect", "-m", astronaut(&folder), frame(0), frame(24)).ended_with(0);
    let lines: Vec<_> = run.out.lines().collect();
    assert_eq!(lines.len(), 2, "{}", run.out);
    assert!(lines[0].contains("0000.jpg") && lines[0].contains("astronaut at ("), "{}", lines[0]);
    assert!(lines[1].contains("0024.jpg") && lines[1].contains("nothing found"), "{}", lines[1]);
}

#[test]
fn every_profile_answers_in_the_pixels_of_the_input() {
    let folder = Folder::new("profiles");
    let model = astronaut(&folder);
    let detect = |profile: &str| {
        let run = keygraph!("detect", "-m", model, frame(0), frame(4), "--json", "--profile", profile).ended_with(0);
        let lines = run.lines();
        for (line, index) in lines.iter().zip([0, 4]) {
            assert_line(line, &path(&frame(index)), 0, (640, 480));
        }
        lines
    };
    let default = keygraph!("detect", "-m", model, frame(0), frame(4), "--json").ended_with(0).lines();
    let vga = detect("vga");
    assert_eq!(without_times(default), without_times(vga.clone()), "vga is the default");
    for profile in ["hd", "qvga", "qqvga"] {
        for (line, reference) in detect(profile).iter().zip(&vga) {
            let right = only(reference);
            // qqvga sees the object at a quarter: it may miss it, but not misplace it.
            if profile == "qqvga" && list(line, "detections").is_empty() {
                continue;
            }
            let found = only(line);
            let off = distance(centre(found), centre(right)) / size(right);
            assert!(off < 0.1, "{profile}: {found:?} is not {right:?}");
            assert!((size(found) / size(right) - 1.0).abs() < 0.1, "{profile}: {found:?} is not {right:?}");
            assert_outline(&line["detections"][0], [512.0, 512.0], 0.02);
        }
    }
}

/// A larger input is scaled down, and (x, y) of the detector is told as
/// ((x + 1/2)/scale - 1/2) of the input.
#[test]
fn a_large_or_upright_input_is_answered_in_its_own_pixels() {
    let folder = Folder::new("large");
    let model = astronaut(&folder);
    let small = pixels(&frame(1));
    let (large, upright) = (folder.join("large.png"), folder.join("upright.png"));
    imageops::resize(&small, 1920, 1440, imageops::FilterType::Triangle).save(&large).unwrap();
    imageops::rotate90(&small).save(&upright).unwrap();
    let lines = keygraph!("detect", "-m", model, frame(1), large, upright, "--json").ended_with(0).lines();
    assert_line(&lines[1], &path(&large), 0, (1920, 1440));
    assert_line(&lines[2], &path(&upright), 0, (480, 640));
    let right = only(&lines[0]);
    for (line, map) in [
        (&lines[1], (|[x, y]| [3.0 * x + 1.0, 3.0 * y + 1.0]) as fn([f64; 2]) -> [f64; 2]),
        (&lines[2], |[x, y]| [479.0 - y, x]),
    ] {
        let (found, expected) = (only(line), right.map(map));
        let off = found.iter().zip(expected).map(|(&a, b)| distance(a, b)).sum::<f64>() / 4.0 / size(expected);
        assert!(off < 0.03, "{found:?} is not {expected:?}");
        assert_outline(&line["detections"][0], [512.0, 512.0], 0.05);
    }
}

// -------------------------------------------------------------------- errors

#[test]
fn a_wrong_command_line_ends_with_2() {
    let folder = Folder::new("usage");
    let (m, f) = (path(&astronaut(&folder)), path(&frame(0)));
    let (m, f) = (m.as_str(), f.as_str());
    let wrong: &[&[&str]] = &[
        &[],
        &["fnid"],
        &["detect", "-m", m, f, "--colour"],
        &["detect", "-m", m],
        &["detect", f],
        &["detect", "-m", m, f, "--threshold", "2"],
        &["detect", "-m", m, f, "--threshold", "-0.5"],
        &["detect", "-m", m, f, "--threshold", "NaN"],
        &["detect", "-m", m, f, "--threshold", "high"],
        &["detect", "-m", m, f, "--threads", "0"],
        &["detect", "-m", m, f, "--track", "--threads", "2"],
        &["detect", "-m", m, f, "--track", "--json", "--digests"],
        &["detect", "-m", m, f, "--profile", "8k"],
        &["train", f],
        &["train", "-o", "m.kgm"],
        &["train", f, "-o", "m.kgm", "--preset", "huge"],
        &["pack", "-o", "all.kgm"],
        &["pack", m],
        &["inspect"],
        &["assess"],
        &["assess", f, "--views", "0"],
    ];
    for arguments in wrong {
        let run = run_in(&folder.0, arguments, b"");
        assert_eq!((run.status, run.out.as_str()), (2, ""), "{arguments:?}: {}", run.err);
        assert!(run.err.contains("Usage") || run.err.contains("error"), "{arguments:?}: {}", run.err);
    }
    assert_eq!(folder.names(), ["astronaut.kgm"]);
}

#[test]
fn help_and_version_end_with_0() {
    for arguments in [&["--help"][..], &["detect", "--help"], &["--version"]] {
        let run = keygraph(arguments).ended_with(0);
        assert!(run.out.contains("keygraph"), "{arguments:?}: {}", run.out);
    }
}

#[test]
fn a_damaged_model_or_another_file_is_refused_with_advice() {
    let folder = Folder::new("damaged");
    let whole = &*ASTRONAUT;
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    let mut newer = whole.clone();
    newer[4] = 200;
    let mut png = Vec::new();
    RgbImage::new(32, 32).write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    let table: [(&str, &[u8], &[&str]); 5] = [
        ("cut.kgm", &whole[..1000], &["cut off", "1000", "copy it again"]),
        ("flipped.kgm", &flipped, &["damaged", "copy it again"]),
        ("newer.kgm", &newer, &["version 200", "update"]),
        ("picture.png", &png, &["not a keygraph model", "keygraph train"]),
        ("empty.kgm", b"", &["not a keygraph model", "keygraph train"]),
    ];
    for (name, bytes, words) in table {
        let (model, all) = (folder.file(name, bytes), folder.join("all.kgm"));
        for run in [
            keygraph!("detect", "-m", model, frame(0), "--json"),
            keygraph!("inspect", model, "--json"),
            keygraph!("pack", model, "-o", all),
        ] {
            run.refused_with(words).said(&[name]);
        }
        assert!(!all.exists(), "{name} was packed");
    }
}

#[test]
fn a_missing_model_is_named() {
    let model = std::env::temp_dir().join("keygraph-cli-no-such.kgm");
    let words = ["cannot read the model", "keygraph-cli-no-such.kgm"];
    keygraph!("detect", "-m", model, frame(0), "--json").refused_with(&words);
    keygraph!("inspect", model).refused_with(&words);
}

#[test]
fn a_missing_model_comes_with_advice() {
    let model = std::env::temp_dir().join("keygraph-cli-no-such.kgm");
    keygraph!("detect", "-m", model, frame(0), "--json").refused_with(&["keygraph train"]);
}

// ------------------------------------------------------------------ annotate

#[test]
fn annotated_pictures_have_the_names_and_sizes_of_the_frames() {
    let folder = Folder::new("annotate");
    let model = astronaut(&folder);
    let half = folder.join("half.png");
    imageops::resize(&pixels(&frame(1)), 321, 240, imageops::FilterType::Triangle).save(&half).unwrap();
    let target = Folder::new("annotate-target");
    let run = keygraph!("detect", "-m", model, frame(0), half, frame(24), "--json", "--annotate", target.0);
    let lines = run.ended_with(0).lines();
    assert_eq!(lines.len(), 3);
    assert_eq!(target.names(), ["0000.jpg", "0024.jpg", "half.png"]);
    for (name, input) in [("0000.jpg", frame(0)), ("half.png", half), ("0024.jpg", frame(24))] {
        let (drawn, original) = (pixels(&target.join(name)), pixels(&input));
        assert_eq!(drawn.dimensions(), original.dimensions(), "{name}");
        assert_ne!(drawn, original, "{name} has nothing drawn onto it");
    }
}

#[test]
fn one_annotated_picture_goes_to_a_file() {
    let folder = Folder::new("annotate-file");
    let model = astronaut(&folder);
    let (one, two) = (folder.join("one.png"), folder.join("two.png"));
    keygraph!("detect", "-m", model, frame(0), "--annotate", one).ended_with(0);
    assert_eq!(pixels(&one).dimensions(), (640, 480));
    keygraph!("detect", "-m", model, frame(0), frame(1), "--annotate", two).ended_with(1).said(&[
        "two.png",
        "one picture",
        "give a folder",
    ]);
}

#[test]
fn an_input_is_never_overwritten() {
    let folder = Folder::new("overwrite");
    let model = astronaut(&folder);
    let input = folder.join("frame.jpg");
    fs::copy(frame(0), &input).unwrap();
    keygraph!("detect", "-m", model, input, "--annotate", input).ended_with(1).said(&["overwrite", "another folder"]);
    keygraph!("detect", "-m", model, input, "--annotate", folder.0).ended_with(1).said(&["overwrite"]);
    assert_eq!(fs::read(&input).unwrap(), fs::read(frame(0)).unwrap(), "the input is as it was");
}

#[test]
fn another_input_is_not_overwritten_either_and_equal_names_are_numbered() {
    let folder = Folder::new("overwrite-other");
    let model = astronaut(&folder);
    let (a, b) = (folder.join("a"), folder.join("b"));
    for place in [&a, &b] {
        fs::create_dir(place).unwrap();
        fs::copy(frame(0), place.join("x.jpg")).unwrap();
    }
    let inputs = [a.join("x.jpg"), b.join("x.jpg")];
    keygraph!("detect", "-m", model, inputs[0], inputs[1], "--annotate", b).ended_with(1).said(&["overwrite"]);
    assert_eq!(fs::read(&inputs[1]).unwrap(), fs::read(frame(0)).unwrap(), "the second input is as it was");
    let out = folder.join("out");
    keygraph!("detect", "-m", model, inputs[0], inputs[1], "--annotate", out).ended_with(0);
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["x-2.jpg", "x.jpg"]);
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

// -------------------------------------------------------------------- assess

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
    // What every change of the detector must keep, and what none can reach.
    for (condition, value) in [("scale", 420.0), ("rotation", 180.0), ("tilt", 15.0), ("blur", 1.0), ("noise", 5.0)] {
        assert_eq!(rate(&a, condition, value), 1.0, "{condition} {value}: {a}");
    }
    let structure = &a["structure"];
    assert!(number(structure, "repetition") < 0.4 && number(structure, "contrast") > 40.0, "{a}");
    assert!(!kinds(&a).contains(&"few corners") && !kinds(&a).contains(&"repeated pattern"), "{a}");
    // The heat map has colour where keygraphs hold and none in the dark corner.
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

// -------------------------------------------------------------------- videos

/// Makes a video of the first `frames` of the sequence. False, and a line that
/// cargo does not hide, if there is no ffmpeg.
fn make_video(frames: u32, output: &Path) -> bool {
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-y", "-framerate", "5", "-i"])
        .arg(assets().join("sequence/%04d.jpg"))
        .args(["-frames:v", &frames.to_string(), "-c:v", "mpeg4", "-q:v", "2", "-pix_fmt", "yuv420p"])
        .arg(output)
        .status();
    let Ok(status) = made else {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no ffmpeg, and nothing may be skipped");
        let _ = writeln!(std::io::stderr(), "SKIPPED: no ffmpeg to make {}", output.display());
        return false;
    };
    assert!(status.success(), "ffmpeg makes {}", output.display());
    true
}

/// The lines of a video of `frames` frames, each of which shows the astronaut where
/// the pictures of the sequence do.
#[track_caller]
fn assert_video(lines: &[Value], source: &str, frames: u32) {
    let folder = Folder::new(&format!("compare-{}", source.replace(|c: char| !c.is_alphanumeric(), "")));
    let mut arguments = args!["detect", "-m", astronaut(&folder), "--json"].to_vec();
    arguments.extend((0..frames).map(|i| frame(i).into_os_string()));
    let stills = run_in(&folder.0, &arguments, b"").ended_with(0).lines();
    assert_eq!(lines.len(), frames as usize, "frames of {source}");
    for (i, (line, still)) in lines.iter().zip(&stills).enumerate() {
        assert_line(line, source, i as u64, (640, 480));
        let (found, right) = (only(line), only(still));
        let off = found.iter().zip(right).map(|(&a, b)| distance(a, b)).sum::<f64>() / 4.0 / size(right);
        assert!(off < 0.03, "frame {i} of {source}: {found:?} is not {right:?}");
    }
}

#[test]
fn a_video_is_read_and_written() {
    let folder = Folder::new("video");
    let (model, clip) = (astronaut(&folder), folder.join("clip.mp4"));
    if !make_video(4, &clip) {
        return;
    }
    let target = folder.join("target");
    let run = keygraph!("detect", "-m", model, clip, "--json", "--annotate", target).ended_with(0);
    assert_video(&run.lines(), &path(&clip), 4);

    // The same into a file, and pictures into a video: all can be read again.
    let (again, of_stills) = (folder.join("again.mkv"), folder.join("stills.mp4"));
    keygraph!("detect", "-m", model, clip, "--json", "--annotate", again).ended_with(0);
    keygraph!("detect", "-m", model, frame(0), frame(1), "--json", "--annotate", of_stills).ended_with(0);
    for (video, frames) in [(target.join("clip.mp4"), 4), (again, 4), (of_stills, 2)] {
        let lines = keygraph!("detect", "-m", model, video, "--json").ended_with(0).lines();
        assert_eq!(lines.len(), frames, "frames of {}", video.display());
        for (i, line) in lines.iter().enumerate() {
            assert_line(line, &path(&video), i as u64, (640, 480));
        }
    }

    let picture = folder.join("picture.png");
    keygraph!("detect", "-m", model, clip, "--annotate", picture).ended_with(1).said(&[
        "picture.png",
        "clip.mp4",
        "give a folder",
    ]);
    let junk = folder.file("junk.mp4", b"this is no video");
    let run = keygraph!("detect", "-m", model, junk, frame(0), "--json").ended_with(1).said(&["junk.mp4"]);
    let lines = run.lines();
    assert_eq!((lines.len(), text(&lines[0], "source")), (2, path(&junk).as_str()), "{}", run.out);
    assert!(!text(&lines[0], "error").is_empty() && list(&lines[0], "detections").is_empty(), "{}", lines[0]);
    only(&lines[1]);
}

/// One YUV4MPEG2 frame: full planes of Y, then Cb and Cr at half the size, video
/// range of BT.601.
fn yuv4mpeg(picture: &RgbImage) -> Vec<u8> {
    let (w, h) = picture.dimensions();
    let component = |[r, g, b]: [f64; 3], k: [f64; 4]| (k[0] + k[1] * r + k[2] * g + k[3] * b).round() as u8;
    let rgb = |x: u32, y: u32| picture.get_pixel(x, y).0.map(f64::from);
    let mut frame = b"FRAME\n".to_vec();
    for y in 0..h {
        frame.extend((0..w).map(|x| component(rgb(x, y), [16.0, 0.257, 0.504, 0.098])));
    }
    for k in [[128.0, -0.148, -0.291, 0.439], [128.0, 0.439, -0.368, -0.071]] {
        for y in (0..h).step_by(2) {
            frame.extend((0..w).step_by(2).map(|x| {
                let four = [rgb(x, y), rgb(x + 1, y), rgb(x, y + 1), rgb(x + 1, y + 1)];
                component([0, 1, 2].map(|c| four.iter().map(|p| p[c]).sum::<f64>() / 4.0), k)
            }));
        }
    }
    frame
}

#[test]
fn a_stream_is_read_from_standard_input() {
    let folder = Folder::new("stream");
    let arguments = args!["detect", "-m", astronaut(&folder), "-", "--json"];
    let frames: Vec<_> = (0..3).map(|i| yuv4mpeg(&pixels(&frame(i)))).collect();
    let header = b"YUV4MPEG2 W640 H480 F5:1 Ip A1:1 C420jpeg\n".to_vec();
    let stream = [header.clone(), frames.concat()].concat();
    let run = run_in(&folder.0, &arguments, &stream).ended_with(0);
    assert_eq!(run.err, "", "standard error");
    assert_video(&run.lines(), "-", 3);

    // Cut off in the last frame: an error of its own, after what came before it.
    let run = run_in(&folder.0, &arguments, &stream[..stream.len() - 1000]).ended_with(1).said(&["ends inside"]);
    let lines = run.lines();
    assert_video(&lines[..2], "-", 2);
    assert_eq!((lines.len(), count(&lines[2], "frame")), (3, 2), "{}", run.out);
    assert!(text(&lines[2], "error").contains("ends inside the frame"), "{}", lines[2]);

    let run = run_in(&folder.0, &arguments, b"this is no stream").ended_with(1).said(&["YUV4MPEG2"]);
    assert_eq!(run.lines().len(), 1, "{}", run.out);
}

// ---------------------------------------------------------------------- demo

#[test]
fn the_demo_finds_its_objects() {
    let folder = Folder::new("demo");
    let run = keygraph!("demo", "--assets", assets(), "--out", folder.0).ended_with(0);
    let tally = |name: &str| -> usize {
        let line = run.out.lines().find(|l| l.contains(&format!("{name}: found in "))).unwrap_or_else(|| {
            panic!("no summary of {name} in\n{}", run.out);
        });
        line.split("found in ").nth(1).and_then(|l| l.split(' ').next()).unwrap().parse().unwrap()
    };
    assert!(tally("astronaut") >= 34, "{}", run.out);
    assert!(tally("coffee") >= 15, "{}", run.out);
    assert!(run.out.contains("48 frames"), "{}", run.out);
    assert_eq!(folder.names(), ["demo.kgm", "frames"]);
    assert_eq!(fs::read_dir(folder.join("frames")).unwrap().count(), 48, "annotated frames");
}

#[test]
fn the_demo_outside_the_repository_says_what_to_do() {
    let folder = Folder::new("demo-elsewhere");
    run_in(&folder.0, &["demo"], b"").refused_with(&["assets/sequence", "in the repository", "--assets"]);
    assert!(folder.names().is_empty(), "left behind: {:?}", folder.names());
}
