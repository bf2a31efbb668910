//! `keygraph find`, what is meant by `-m`, and results as comma-separated values and exit statuses.

use std::fs;

use image::imageops::{FilterType, resize, rotate180};

use crate::lines::{self, path};
use crate::program::{Folder, frame, picture, pixels};
use crate::{astronaut, compact};

#[test]
fn a_picture_is_found_without_a_model_file() {
    let run = keygraph!("find", picture("astronaut"), frame(4), picture("rocket")).ended_with(0);
    let lines: Vec<_> = run.out.lines().collect();
    assert!(lines[0].contains("astronaut at (31") && lines[1].contains("nothing found"), "{}", run.out);
    assert_eq!(run.err, "", "a good picture needs no advice");
    keygraph!("find", picture("nowhere"), frame(4)).refused_with(&["nowhere"]);
}

#[test]
fn found_or_not_is_the_exit_status_if_asked_for() {
    let folder = Folder::new("exit-code");
    let (model, nothing) = (astronaut(&folder), folder.join("missing.jpg"));
    for (input, plain, asked) in [(&frame(4), 0, 0), (&picture("rocket"), 0, 1), (&nothing, 1, 2)] {
        keygraph!("detect", "-m", model, input).ended_with(plain);
        keygraph!("detect", "-m", model, input, "--exit-code").ended_with(asked);
    }
}

#[test]
fn comma_separated_values_have_a_line_for_each_object() {
    let folder = Folder::new("csv");
    let model = folder.join("m.kgm");
    keygraph!("train", picture("astronaut"), "--name", "a, \"b\"", "--preset", "compact", "-o", model).ended_with(0);
    let run = keygraph!("detect", "-m", model, "--csv", frame(4), picture("rocket"), frame(0)).ended_with(0);
    let lines: Vec<_> = run.out.lines().collect();
    assert_eq!(lines.len(), 3, "a head, and two frames with an object:\n{}", run.out);
    assert_eq!(lines[0].split(',').count(), 13);
    let start = format!("{},0,\"a, \"\"b\"\"\",0.98", path(&frame(4)));
    assert!(lines[1].starts_with(&start), "{}", lines[1]);
    let corners: Vec<f64> = lines[1].rsplit(',').take(8).map(|v| v.parse().unwrap()).collect();
    assert!((corners[7] - 178.8).abs() < 1.0, "x of the first corner, px: {corners:?}");
    // They are the numbers of JSON.
    let told = &keygraph!("detect", "-m", model, "--json", frame(4)).ended_with(0).lines()[0]["detections"][0];
    let [score, visible] = ["score", "visible"].map(|key| told[key].as_f64().unwrap());
    let values: Vec<f64> = lines[1].rsplit(',').take(10).map(|v| v.parse().unwrap()).collect();
    assert_eq!(values[8..], [visible, score]);
    assert!(values[..8].iter().rev().eq(lines::corners(told).as_flattened()), "{values:?} are not those of {told}");
    keygraph!("detect", "-m", model, "--csv", "--json", frame(0)).ended_with(2);
}

#[test]
fn models_are_what_they_look_like() {
    let folder = Folder::new("models");
    let one = astronaut(&folder);
    let shelf = folder.join("shelf");
    fs::create_dir(&shelf).unwrap();
    keygraph!("detect", "-m", shelf, frame(4)).refused_with(&["no model", "shelf"]);
    let two = shelf.join("coffee.kgm");
    fs::write(&two, compact("coffee", &[])).unwrap();
    fs::write(shelf.join("notes.txt"), "no model").unwrap();
    fs::copy(&one, shelf.join("astronaut.kgm")).unwrap();
    let found =
        |run: &crate::program::Run| run.out.matches("astronaut at").count() + run.out.matches("coffee at").count();
    // A folder, several files as a shell gives them, and a file that is given twice.
    let expected = found(&keygraph!("detect", "-m", one, "-m", two, frame(9)).ended_with(0));
    assert!(expected > 0);
    assert_eq!(found(&keygraph!("detect", "-m", shelf, frame(9)).ended_with(0)), expected);
    assert_eq!(found(&keygraph!("detect", "-m", one, two, frame(9)).ended_with(0)), expected);
    let line = keygraph!("detect", "-m", one, "-m", one, one, "--json", "--all-names", frame(9)).ended_with(0).object();
    assert_eq!(line["detections"].as_array().unwrap().len(), 1, "searched for once: {line}");

    keygraph!("detect", one, frame(4)).ended_with(2).said(&["did you mean -m", "astronaut.kgm"]);
    keygraph!("detect", frame(4)).ended_with(2).said(&["-m MODEL.kgm", "keygraph find"]);
    keygraph!("detect", "-m", one, two).ended_with(2).said(&["nothing to search"]);
    keygraph!("detect", "-m", picture("coffee"), frame(4)).refused_with(&["not a keygraph model", "keygraph train"]);
    keygraph!("find", one, frame(4)).ended_with(2).said(&["is a model", "detect -m"]);
}

#[test]
fn objects_are_written_as_they_look_flat() {
    let folder = Folder::new("rectify");
    let (model, flat) = (astronaut(&folder), folder.join("flat"));
    // Turned by 170 degrees; nothing; and turned by 20.
    keygraph!("detect", "-m", model, "--rectify", flat, frame(16), picture("rocket"), frame(4))
        .ended_with(0)
        .said(&["written: 2 files in ", &path(&flat)]);
    let mut names: Vec<_> =
        fs::read_dir(&flat).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["0004-astronaut.png", "0016-astronaut.png"]);
    let small = |image: &image::RgbImage| resize(image, 32, 32, FilterType::Triangle).into_raw();
    let own = pixels(&picture("astronaut"));
    for name in names {
        let shown = pixels(&flat.join(&name));
        assert!(shown.width() >= own.width() && shown.height() >= own.height(), "{name}: {:?}", shown.dimensions());
        // A frame has its own light, which correlation leaves out.
        let alike = |shown: &image::RgbImage| correlation(&small(shown), &small(&own));
        let (upright, turned) = (alike(&shown), alike(&rotate180(&shown)));
        assert!(upright > 0.95 && turned < 0.5, "{name}: {upright:.3}, and upside down {turned:.3}");
    }
}

fn correlation(a: &[u8], b: &[u8]) -> f64 {
    let mean = |v: &[u8]| v.iter().map(|&x| f64::from(x)).sum::<f64>() / v.len() as f64;
    let (p, q) = (mean(a), mean(b));
    let sum = |x: &[u8], y: &[u8], [p, q]: [f64; 2]| {
        x.iter().zip(y).map(|(&x, &y)| (f64::from(x) - p) * (f64::from(y) - q)).sum::<f64>()
    };
    sum(a, b, [p, q]) / (sum(a, a, [p, p]) * sum(b, b, [q, q])).sqrt()
}
