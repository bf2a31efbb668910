//! Tests what tells a look-alike that shares a third of a picture from the picture with something in front of it.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::sync::{LazyLock, Mutex};

use keygraph::input::{Picture, Pixels, read_picture};
use keygraph::learn::{Preset, train};
use keygraph_core::{Frame, Model, PixelFormat, VgaDetector};
use keygraph_tests::scene::frame_of;
use keygraph_tests::{Poses, file};

fn asset(name: &str) -> Picture {
    read_picture(&file("assets/pictures").join(name)).unwrap()
}

fn rgb(picture: &mut Picture) -> &mut Vec<u8> {
    let Pixels::Rgb8(rgb) = &mut picture.pixels else { panic!("the picture has no colour") };
    rgb
}

/// Puts `over` on the part of a picture that `covers` says, by column and row.
fn cover(picture: &mut Picture, over: &Picture, covers: impl Fn(u32, u32) -> bool) {
    let Pixels::Rgb8(source) = &over.pixels else { panic!("the picture has no colour") };
    let (w, h) = (picture.width, picture.height);
    for (i, pixel) in rgb(picture).chunks_exact_mut(3).enumerate() {
        let (x, y) = (i as u32 % w, i as u32 / w);
        if covers(x, y) {
            let at = (y * over.height / h * over.width + x * over.width / w) as usize;
            pixel.copy_from_slice(&source[3 * at..][..3]);
        }
    }
}

/// The last pose that is looked at in a frame: its score, and whether its outline is a border where it seems hidden.
fn last(frame: &mut Picture) -> (f32, bool) {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    static MODEL: LazyLock<Vec<u8>> =
        LazyLock::new(|| train(&asset("astronaut.jpg"), "astronaut", Preset::Compact, false).unwrap().0);
    let (w, h) = (frame.width as usize, frame.height as usize);
    let frame = Frame::new(PixelFormat::Rgb8, w, h, rgb(frame)).unwrap();
    let (model, mut poses) = (Model::parse(&MODEL).unwrap(), Poses::default());
    // With this threshold a search goes on to its last step.
    DETECTOR.lock().unwrap().detect(&frame, &model, 2.0, &mut poses).unwrap();
    let (d, seen) = poses.0.last().copied().unwrap_or_else(|| panic!("no pose was looked at"));
    (d.score, seen.1)
}

#[test]
fn a_look_alike_shows_its_border_and_something_in_front_hides_it() {
    let (own, mut other) = (asset("astronaut.jpg"), asset("coffee.jpg"));
    // Paler than the ground, so that it has a border.
    rgb(&mut other).iter_mut().for_each(|v| *v = 120 + *v / 2);
    // A package of the same brand: the upper part is shared.
    let mut sibling = asset("astronaut.jpg");
    let (h, shared) = (sibling.height, sibling.height * 3 / 10);
    cover(&mut sibling, &other, |_, y| y >= shared);
    for degrees in [0.0f32, 12.0, 170.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let place = |[x, y]: [f32; 2]| {
            let [x, y] = [(x - 320.0) * 1.5, (y - 240.0) * 1.5];
            Some([x * cos + y * sin + own.width as f32 / 2.0, y * cos - x * sin + h as f32 / 2.0])
        };
        let seen = last(&mut frame_of(&sibling, place));
        let mut hidden = frame_of(&own, place);
        cover(&mut hidden, &other, |x, y| y >= 208 && (40..600).contains(&x));
        let front = last(&mut hidden);
        assert!(seen.1 && seen.0 < 0.8, "{degrees} degrees: a look-alike, {seen:?}");
        assert!(!front.1 && front.0 > 0.8, "{degrees} degrees: half hidden, {front:?}");
    }
}
