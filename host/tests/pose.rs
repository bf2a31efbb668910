//! Poses with 6 degrees of freedom end to end: a picture is rendered at known poses, and
//! the poses that `detect` reports are compared with them.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod program;

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use keygraph::render::Exposure;
use program::{CLEAR, Folder, Map, Run, frame, keygraph, numbers, photograph, picture};
use serde_json::Value;

/// Focal length and principal point of the camera, px.
const FOCAL: f64 = 560.0;
const CENTRE: [f64; 2] = [322.0, 236.0];
const INTRINSICS: &str = "560,560,322,236";
const WIDTH_MM: f64 = 200.0;
/// Width and height of the camera's frames, px.
const FRAME: (usize, usize) = (640, 480);
const DIM_AND_NOISY: Exposure = Exposure { gain: 0.67, blur_px: 0.0, noise: 5.0 };

/// A pose: rotation in row order, and position of the picture's centre, mm.
struct Pose {
    rotation: [f64; 9],
    translation_mm: [f64; 3],
}

impl Pose {
    /// A pose turned by `turn` degrees, then tilted by `tilt` degrees about an axis in the
    /// frame's plane at `direction` degrees.
    fn new(tilt: f64, direction: f64, turn: f64, translation_mm: [f64; 3]) -> Self {
        let z = |a: f64| [a.cos(), -a.sin(), 0.0, a.sin(), a.cos(), 0.0, 0.0, 0.0, 1.0];
        let x = |a: f64| [1.0, 0.0, 0.0, 0.0, a.cos(), -a.sin(), 0.0, a.sin(), a.cos()];
        let times = |a: Map, b: Map| -> Map {
            std::array::from_fn(|i| (0..3).map(|k| a[i / 3 * 3 + k] * b[3 * k + i % 3]).sum())
        };
        let [tilt, direction, turn] = [tilt, direction, turn].map(f64::to_radians);
        Self { rotation: times(times(times(z(direction), x(tilt)), z(-direction)), z(turn)), translation_mm }
    }

    /// The map from picture px to frame px, for a picture of `w` x `h` px.
    fn map(&self, [w, h]: [f64; 2]) -> Map {
        let mm = WIDTH_MM / w;
        let (r, t) = (&self.rotation, &self.translation_mm);
        let middle = [(w - 1.0) / 2.0, (h - 1.0) / 2.0];
        // The camera's view of picture px (u, v): rows of [r1 r2 t].
        let row = |i: usize| {
            let (a, b) = (r[3 * i] * mm, r[3 * i + 1] * mm);
            [a, b, t[i] - a * middle[0] - b * middle[1]]
        };
        let [x, y, z] = [row(0), row(1), row(2)];
        std::array::from_fn(|i| match i / 3 {
            0 => FOCAL * x[i % 3] + CENTRE[0] * z[i % 3],
            1 => FOCAL * y[i % 3] + CENTRE[1] * z[i % 3],
            _ => z[i % 3],
        })
    }

    /// The angle between the rotations in degrees, and the distance as a share of the depth.
    fn errors(&self, found: &Value) -> (f64, f64) {
        let (r, t) = (numbers::<9>(&found["rotation"]), numbers::<3>(&found["translation_mm"]));
        let trace: f64 = self.rotation.iter().zip(r).map(|(a, b)| a * b).sum();
        let squares: f64 = self.translation_mm.iter().zip(t).map(|(a, b)| (a - b) * (a - b)).sum();
        (((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees(), squares.sqrt() / self.translation_mm[2])
    }
}

/// Poses turned and tilted in all directions, with the picture 160 to 300 px wide.
fn poses() -> Vec<Pose> {
    let pose = |i: u32| {
        let k = f64::from(i);
        let depth = 370.0 + 90.0 * (k % 4.0);
        let middle = [0.12 * (k * 2.4).sin() * depth, 0.08 * (k * 1.7).cos() * depth, depth];
        Pose::new([0.0, 12.0, 24.0, 36.0, 48.0][i as usize % 5], 67.0 * k, 31.0 * k - 60.0, middle)
    };
    (0..20).map(pose).collect()
}

/// Trains the compact model of a picture of the repository.
fn compact(folder: &Folder, name: &str) -> PathBuf {
    let model = folder.join(name).with_extension("kgm");
    let picture = picture(name);
    let arguments: [&OsStr; 6] =
        ["train".as_ref(), picture.as_ref(), "-o".as_ref(), model.as_ref(), "--preset".as_ref(), "compact".as_ref()];
    keygraph(&arguments).ended_with(0);
    model
}

fn detect(models: &[PathBuf], input: &Path, options: &[&str]) -> Run {
    let mut arguments: Vec<&OsStr> = vec!["detect".as_ref(), "--json".as_ref(), input.as_ref()];
    arguments.extend(models.iter().flat_map(|m| ["-m".as_ref(), m.as_os_str()]));
    arguments.extend(options.iter().map(OsStr::new));
    keygraph(&arguments)
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

#[test]
fn reported_poses_are_those_that_were_rendered() {
    let folder = Folder::new("poses");
    let (model, frames) = (compact(&folder, "astronaut"), folder.join("frames"));
    fs::create_dir(&frames).unwrap();
    let truths = poses();
    for (i, truth) in truths.iter().enumerate() {
        let frame = frames.join(format!("{i:02}.png"));
        photograph("astronaut", &truth.map([512.0, 512.0]), FRAME, &DIM_AND_NOISY, &frame);
    }
    let width = WIDTH_MM.to_string();
    let annotated = folder.join("annotated");
    let options = ["--intrinsics", INTRINSICS, "--width-mm", &width, "--annotate", annotated.to_str().unwrap()];
    let run = detect(&[model], &frames, &options).ended_with(0);

    let (mut degrees, mut parts, mut report) = (Vec::new(), Vec::new(), String::new());
    let (mut missed, mut mirrored) = (0, 0);
    for (i, (line, truth)) in run.lines().iter().zip(&truths).enumerate() {
        let Some(pose) = line["detections"].get(0).map(|d| &d["pose"]) else {
            missed += 1;
            report += &format!("{i}: not found\n");
            continue;
        };
        let (degree, part) = truth.errors(pose);
        let other = truth.errors(&pose["mirrored"]).0;
        // The mirrored pose may be reported only when the pose is ambiguous.
        mirrored += usize::from(pose["ambiguous"] == false && other < degree);
        report += &format!(
            "{i}: {degree:.2} degrees, {:.2} % of the depth, errors {} and {} px, ambiguous {}, the other {other:.2} degrees\n",
            100.0 * part,
            pose["error_px"],
            pose["mirrored"]["error_px"],
            pose["ambiguous"]
        );
        degrees.push(degree);
        parts.push(part);
    }
    println!("{report}median {:.2} degrees, {:.3} % of the depth", median(&degrees), 100.0 * median(&parts));
    assert_eq!((missed, mirrored), (0, 0), "missed, mirrored unawares:\n{report}");
    assert!(median(&degrees) < 0.5 && median(&parts) < 0.005, "{report}");
    assert_eq!(fs::read_dir(annotated).unwrap().count(), truths.len(), "annotated frames");
}

/// Frames twice as large with intrinsics twice as large give the same pose, though they are
/// searched at half their size.
#[test]
fn intrinsics_are_those_of_the_input_as_given() {
    let folder = Folder::new("large");
    let frame = folder.join("large.png");
    let truth = Pose::new(30.0, 40.0, 15.0, [20.0, -15.0, 420.0]);
    // Pixel centres are at integers: x becomes (x + 1/2) * 2 - 1/2.
    let map = truth.map([600.0, 400.0]);
    let twice = |i: usize| 2.0 * map[i] + 0.5 * map[6 + i % 3];
    let large: Map = std::array::from_fn(|i| if i < 6 { twice(i) } else { map[i] });
    photograph("coffee", &large, (1280, 960), &CLEAR, &frame);
    let camera = ["--intrinsics", "1120,1120,644.5,472.5", "--width-mm", "coffee=200"];
    let run = detect(&[compact(&folder, "coffee")], &frame, &camera).ended_with(0);
    let (degrees, part) = truth.errors(&run.lines()[0]["detections"][0]["pose"]);
    assert!(degrees < 2.0 && part < 0.015, "{degrees} degrees, {part} of the depth: {}", run.out);
}

#[test]
fn far_and_nearly_frontal_is_ambiguous_but_well_placed() {
    let folder = Folder::new("far");
    let frame = folder.join("far.png");
    let truth = Pose::new(4.0, 70.0, 20.0, [60.0, 30.0, 1000.0]);
    photograph("astronaut", &truth.map([512.0, 512.0]), FRAME, &CLEAR, &frame);
    let camera = ["--intrinsics", INTRINSICS, "--width-mm", "200"];
    let run = detect(&[compact(&folder, "astronaut")], &frame, &camera).ended_with(0);
    let pose = &run.lines()[0]["detections"][0]["pose"];
    assert_eq!(pose["ambiguous"], true, "{}", run.out);
    for pose in [pose, &pose["mirrored"]] {
        let (degrees, part) = truth.errors(pose);
        assert!(degrees < 20.0 && part < 0.015, "{degrees} degrees, {part} of the depth: {}", run.out);
    }
}

#[test]
fn each_object_has_its_own_width_or_all_have_one() {
    let folder = Folder::new("widths");
    let models = ["astronaut", "coffee"].map(|name| compact(&folder, name));
    let frame = frame(17);
    let run = |widths: &[&str]| {
        let mut options = vec!["--intrinsics", INTRINSICS];
        options.extend(widths.iter().flat_map(|w| ["--width-mm", w]));
        detect(&models, &frame, &options)
    };
    let depths = |widths: &[&str]| {
        let line = run(widths).ended_with(0).lines().remove(0);
        ["astronaut", "coffee"].map(|name| {
            let found = line["detections"].as_array().unwrap().iter().find(|d| d["object"] == name).unwrap().clone();
            numbers::<3>(&found["pose"]["translation_mm"])[2]
        })
    };
    let one = depths(&["100"]);
    for (widths, factors) in [
        (&["astronaut=100", "coffee=300"][..], [1.0, 3.0]),
        (&["coffee=50", "100"], [1.0, 0.5]),
        (&["200"], [2.0, 2.0]),
    ] {
        for ((depth, one), factor) in depths(widths).into_iter().zip(one).zip(factors) {
            assert!((depth / one - factor).abs() < 1e-3, "{widths:?}: {depth} mm, against {one} at 100");
        }
    }
    for (widths, words) in [
        (&["astronaut=100"][..], ["coffee", "--width-mm coffee=WIDTH"]),
        (&["100", "200"], ["twice for all objects", "NAME=WIDTH"]),
        (&["100", "coffee=1", "coffee=2"], ["twice for coffee", "NAME=WIDTH"]),
        (&["100", "tea=1"], ["no such object", "astronaut, coffee"]),
    ] {
        let run = run(widths).ended_with(2).said(&words);
        assert_eq!(run.out, "", "{widths:?}");
    }
}

#[test]
fn a_camera_that_is_none_is_a_wrong_command_line() {
    let (model, frame) = (PathBuf::from("m.kgm"), PathBuf::from("f.png"));
    for (options, word) in [
        (&["--intrinsics", INTRINSICS][..], "--width-mm"),
        (&["--width-mm", "200"], "--intrinsics"),
        (&["--intrinsics", "560,560,320", "--width-mm", "200"], "fx,fy,cx,cy"),
        (&["--intrinsics", "0,560,320,240", "--width-mm", "200"], "focal lengths above 0"),
        (&["--intrinsics", "-560,560,320,240", "--width-mm", "200"], "focal lengths above 0"),
        (&["--intrinsics", "NaN,560,320,240", "--width-mm", "200"], "focal lengths above 0"),
        (&["--intrinsics", INTRINSICS, "--width-mm", "0"], "millimetres above 0"),
        (&["--intrinsics", INTRINSICS, "--width-mm", "-3"], "millimetres above 0"),
        (&["--intrinsics", INTRINSICS, "--width-mm", "NaN"], "millimetres above 0"),
        (&["--intrinsics", INTRINSICS, "--width-mm", "coffee=wide"], "millimetres above 0"),
        (&["--intrinsics", INTRINSICS, "--distortion", "0.1,0.2"], "4, 5 or 8 numbers"),
        (&["--distortion", "0,0,0,0"], "--intrinsics"),
        (&["--intrinsics", INTRINSICS, "--lens", "camera.yaml"], "--lens"),
    ] {
        let run = detect(std::slice::from_ref(&model), &frame, options).ended_with(2).said(&[word]);
        assert_eq!(run.out, "", "{options:?}");
    }
}
