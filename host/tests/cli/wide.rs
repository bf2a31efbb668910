//! `keygraph detect --wide`: what is seen from far to the side.

use std::path::{Path, PathBuf};

use keygraph::canvas::Canvas;
use keygraph::input::read_picture;
use keygraph::random::Random;
use keygraph::render::{Exposure, Pose, Print, Scene, corner_error};
use keygraph_core::Homography;

use crate::astronaut;
use crate::lines::{assert_line, assert_outline, corners, count, list, only, path};
use crate::program::{Folder, frame, picture, pixels};

/// A picture of the astronaut, tilted by 78 degrees, and where it is seen.
fn steep(folder: &Folder) -> (PathBuf, [[f32; 2]; 4]) {
    let shown = read_picture(Path::new(&picture("astronaut"))).unwrap();
    let mut random = Random::of(&[3]);
    let mut scene = Scene::dead_leaves(1000, 750, &mut random);
    let pose = Pose { side_px: 640.0, rotation_deg: 25.0, tilt_deg: 78.0, axis_deg: 70.0, centre: [500.0, 375.0] };
    let at: Homography = scene.lay(&Print::new(&shown), &pose);
    let picture = scene.expose(&Exposure { gain: 1.0, blur_px: 0.6, noise: 3.0 }, &mut random);
    let file = folder.join("steep.png");
    Canvas::from_picture(&picture).save_png(&file).unwrap();
    (file, at.outline(shown.width as f32, shown.height as f32))
}

#[test]
fn what_is_seen_from_far_to_the_side_is_found_and_told() {
    let folder = Folder::new("wide");
    let (model, (steep, truth)) = (astronaut(&folder), steep(&folder));
    let plain = keygraph!("detect", "-m", model, "--json", steep).ended_with(0);
    assert!(list(&plain.lines()[0], "detections").is_empty(), "the test shows nothing: {}", plain.out);
    assert_eq!(plain.err, format!("keygraph: {}: found from far to the side: use --wide\n", path(&steep)));

    let mut answers = Vec::new();
    for options in [&["--threads", "1"][..], &["--threads", "4"], &["--annotate", "out", "--rectify", "flat"]] {
        let mut arguments = args!["detect", "-m", model, "--json", "--wide", steep].to_vec();
        arguments.extend(options.iter().map(|o| match *o {
            "out" | "flat" => folder.join(o).into(),
            option => option.into(),
        }));
        let run = crate::program::keygraph(&arguments).ended_with(0);
        let line = &run.lines()[0];
        assert_line(line, &path(&steep), 0, (1000, 750));
        assert!(corner_error(&only(line).map(|p| p.map(|v| v as f32)), &truth) < 0.1, "{line}");
        assert_outline(&line["detections"][0], [512.0, 512.0], 0.05);
        answers.push(corners(&line["detections"][0]));
    }
    assert!(answers.iter().all(|a| *a == answers[0]), "one thread and several: {answers:?}");
    assert!(
        folder.join("out").read_dir().unwrap().count() == 1 && folder.join("flat").read_dir().unwrap().count() == 1
    );

    let said = keygraph!("explain", picture("astronaut"), steep, "-o", folder.join("why")).ended_with(0);
    assert!(said.out.contains("`detect --wide` finds it"), "{}", said.out);
    // What is found without doubt is found as it is without the option.
    let usual = [&[][..], &["--wide"]].map(|options| {
        let mut arguments = args!["detect", "-m", model, "--json", frame(0)].to_vec();
        arguments.extend(options.iter().map(Into::into));
        only(&crate::program::keygraph(&arguments).ended_with(0).lines()[0])
    });
    assert_eq!(usual[0], usual[1]);
}

#[test]
fn a_mirrored_picture_has_each_object_once() {
    let folder = Folder::new("wide-mirror");
    let (model, (steep, truth), mirrored) = (astronaut(&folder), steep(&folder), folder.join("mirrored.png"));
    image::imageops::flip_horizontal(&pixels(&steep)).save(&mirrored).unwrap();
    let other = folder.join("coffee.kgm");
    keygraph!("train", picture("coffee"), "-o", other, "--preset", "compact").ended_with(0);
    // A model of two objects is searched for to the end.
    let run = keygraph!("detect", "-m", model, "-m", other, "--json", "--wide", "--mirror", mirrored).ended_with(0);
    let found = only(&run.lines()[0]).map(|[x, y]| [(999.0 - x) as f32, y as f32]);
    assert!(corner_error(&found, &truth) < 0.1, "{}", run.out);
}

#[test]
fn a_search_whose_time_is_over_is_not_wide() {
    let folder = Folder::new("wide-budget");
    let (model, (steep, _)) = (astronaut(&folder), steep(&folder));
    let run = keygraph!("detect", "-m", model, "--json", "--wide", "--budget-ms", "0.1", steep).ended_with(0);
    let line = &run.lines()[0];
    assert_eq!((&line["complete"], list(line, "detections").len()), (&serde_json::json!(false), 0), "{line}");
    assert_eq!(count(&line["stages"]["classify"], "seen"), 0, "no squeezed picture was searched: {line}");
}

#[test]
fn what_does_not_go_with_it_is_said() {
    let folder = Folder::new("wide-usage");
    let model = astronaut(&folder);
    keygraph!("detect", "-m", model, "--wide", "--track", frame(0)).ended_with(2).said(&["--wide", "--track"]);
    let camera = ["--intrinsics", "500,500,320,240", "--distortion", "-0.1,0,0,0"];
    let [a, b, c, d] = camera;
    keygraph!("detect", "-m", model, "--wide", a, b, c, d, frame(0))
        .ended_with(2)
        .said(&["--wide takes straight lines as straight"]);
}
