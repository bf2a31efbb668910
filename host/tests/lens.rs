//! `keygraph calibrate` and `--lens` end to end, and what they refuse.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation)]

mod program;

use std::fs;

use program::{Folder, frame, keygraph, picture};

fn model(folder: &Folder) -> String {
    let model = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    keygraph(&["train", picture("astronaut").to_str().unwrap(), "--preset", "compact", "-o", &model]).ended_with(0);
    model
}

#[test]
fn the_camera_of_the_shipped_sequence_is_measured() {
    let folder = Folder::new("calibrate");
    let (model, out) = (model(&folder), folder.join("camera.yaml"));
    // The frames that show the picture were rendered with a focal length of 600 px, without a lens.
    let sequence = frame(0).parent().unwrap().to_str().unwrap().to_string();
    let run =
        keygraph(&["calibrate", "-m", &model, &sequence, "-o", out.to_str().unwrap(), "--profile", "vga", "--json"]);
    let run = run.ended_with(0);
    let focal = run.lines()[0]["numbers"]["fx"]["value"].as_f64().unwrap();
    assert!((focal - 600.0).abs() < 9.0, "{focal}");
    let yaml = fs::read_to_string(&out).unwrap();
    assert!(yaml.starts_with("%YAML:1.0\n---\nimage_width: 640\n"), "{yaml}");
    let shown = frame(5);
    let options = [
        "detect",
        "-m",
        &model,
        shown.to_str().unwrap(),
        "--lens",
        out.to_str().unwrap(),
        "--width-mm",
        "200",
        "--json",
    ];
    let run = keygraph(&options).ended_with(0);
    let seen = &run.lines()[0]["detections"][0];
    let away = seen["pose"]["translation_mm"][2].as_f64().unwrap();
    assert!((away - 276.6).abs() < 6.0 && seen["surface"]["bent"] == false, "{seen}");
}

#[test]
fn what_is_no_calibration_and_no_view_is_told() {
    let folder = Folder::new("no-lens");
    let (model, out) = (model(&folder), folder.join("camera.yaml"));
    let (out, shown) = (out.to_str().unwrap(), frame(5));
    let shown = shown.to_str().unwrap();
    keygraph(&["calibrate", "-m", &model, shown, "-o", out])
        .ended_with(1)
        .said(&["found in 1 of 1 frames", "5 are needed"]);
    assert!(!folder.join("camera.yaml").exists());
    keygraph(&["calibrate", "-m", &model, shown, "-o", &model]).ended_with(1).said(&["astronaut.kgm"]);
    keygraph(&["detect", "-m", &model, shown, "--lens", "none.yaml"]).ended_with(1).said(&["none.yaml"]);
    fs::write(out, "camera_matrix: [1, 2]").unwrap();
    keygraph(&["detect", "-m", &model, shown, "--lens", out]).ended_with(1).said(&["camera_matrix has 2 numbers"]);
    fs::write(
        out,
        "image_width: 640\nimage_height: 640\ncamera_matrix: [600, 0, 320, 0, 600, 240, 0, 0, 1]\nD: [0, 0, 0, 0]",
    )
    .unwrap();
    keygraph(&["detect", "-m", &model, shown, "--lens", out])
        .ended_with(1)
        .said(&["calibrate at this size", "0005.jpg"]);
}
