//! `keygraph explain`: the stages of one search, as pictures and in words.

use std::fs;

use image::imageops;

use crate::program::{Folder, frame, picture, pixels};

#[test]
fn a_frame_that_shows_the_object_is_explained_stage_by_stage() {
    let folder = Folder::new("explain");
    let out = folder.join("out");
    let run = keygraph!("explain", picture("astronaut"), frame(5), "-o", out).ended_with(0);
    assert!(run.out.starts_with("astronaut is found, with a score of 0.99."), "{}", run.out);
    run.said(&["written: ", "out/explain.md"]);
    let page = fs::read_to_string(out.join("explain.md")).unwrap();
    let stages = ["corners", "triangles", "keygraph", "matches", "votes", "poses", "look"];
    for (i, stage) in stages.iter().enumerate() {
        let name = format!("{}-{stage}.jpg", i + 1);
        assert!(page.contains(&format!("({name})")), "{page}");
        assert!(pixels(&out.join(name)).width() >= 640);
    }
    assert!(!page.contains("What to do"), "{page}");
    // The outline is drawn where the object is: green along its left side, in the middle.
    let poses = pixels(&out.join("6-poses.jpg"));
    let green = poses.pixels().filter(|p| p[1] > 180 && p[0] < 110 && p[2] < 130).count();
    assert!(green > 500, "{green} green pixels");
}

#[test]
fn what_would_help_is_said() {
    let folder = Folder::new("explain-help");
    let mirrored = folder.join("mirrored.png");
    imageops::flip_horizontal(&pixels(&frame(5))).save(&mirrored).unwrap();
    let plain = folder.join("plain.png");
    image::RgbImage::from_pixel(640, 480, image::Rgb([128; 3])).save(&plain).unwrap();
    for (shown, expected) in [
        (mirrored, "`detect --mirror` finds it, with a score of 0.99"),
        (plain, "The frame has 0 corners"),
        (frame(25), "Is the object in the frame at all?"),
    ] {
        let run = keygraph!("explain", picture("astronaut"), shown, "-o", folder.join("out")).ended_with(0);
        assert!(run.out.contains("astronaut is not found") && run.out.contains(expected), "{}", run.out);
    }
    keygraph!("explain", crate::astronaut(&folder), frame(0)).ended_with(2).said(&["give the picture"]);
}
