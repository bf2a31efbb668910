//! Several threads find in a frame what one finds, to the bit.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use image::imageops::{FilterType, overlay};
use keygraph::demo::sample;
use keygraph::input::{Picture, Pixels, Source, SourceFrame, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::search::{Follower, Found, Profile, Request, follow, search_for};
use keygraph_core::{DEFAULT_THRESHOLD, Depth, Model};
use keygraph_tests::file;

/// Every `step`th frame of the shipped sequence.
fn frames(step: usize) -> impl Iterator<Item = SourceFrame> {
    Source::open(&[file("assets/sequence")]).unwrap().step_by(step)
}

fn request(profile: Profile, depth: Depth, threads: usize) -> Request {
    Request { depth, threads, digests: true, details: true, ..Request::new(profile, DEFAULT_THRESHOLD) }
}

/// All of a result but the times.
fn told(found: &Found) -> String {
    let stats = (found.stats.stages, found.stats.tiles, found.stats.stopped);
    let tracks = found.tracking.as_ref().map(|t| (&t.seen, t.searched));
    let digests = found.digests.as_ref().map(|d| format!("{d:?}"));
    let Found { detections, rivals, surfaces, corners, keygraphs, supporters, high_water, .. } = found;
    format!(
        "{digests:?} {stats:?} {tracks:?} {detections:?} {rivals:?} {surfaces:?} {corners:?} {keygraphs:?} {supporters:?} {high_water:?}"
    )
}

#[test]
fn the_results_do_not_depend_on_the_number_of_threads() {
    let (_, both) = sample(&file("assets"), Preset::Compact).unwrap();
    let both = Model::parse(&both).unwrap();
    assert!(both.has_lists(), "several objects are searched for at once");
    let mut instances = 0;
    for frame in frames(5) {
        let picture = frame.picture.unwrap();
        for (profile, depth) in
            [(Profile::Vga, Depth::Usual), (Profile::Vga, Depth::Thorough), (Profile::Qvga, Depth::Once)]
        {
            let one = search_for(&picture, &both, &request(profile, depth, 1), 0).unwrap();
            for threads in [2, 3] {
                let several = search_for(&picture, &both, &request(profile, depth, threads), 0).unwrap();
                assert!(told(&several) == told(&one), "{}: {profile:?}, {depth:?}, {threads} threads", frame.source);
            }
            instances += one.detections.len();
        }
    }
    assert!(instances > 20, "{instances}");
}

/// A frame with two copies of the picture of an object.
fn crowd(picture: &Path) -> Picture {
    let mut frame = image::open(file("assets/sequence/0002.jpg")).unwrap().to_rgb8();
    let copy = image::open(picture).unwrap().resize_exact(300, 300, FilterType::Triangle).to_rgb8();
    for (x, y) in [(5, 20), (330, 150)] {
        overlay(&mut frame, &copy, x, y);
    }
    Picture { width: frame.width(), height: frame.height(), pixels: Pixels::Rgb8(frame.into_raw()) }
}

#[test]
fn a_crowd_is_searched_in_tiles_as_by_one_thread() {
    let path = file("assets/pictures/astronaut.jpg");
    let (bytes, _) = train(&read_picture(&path).unwrap(), "astronaut", Preset::Large, false).unwrap();
    let model = Model::parse(&bytes).unwrap();
    assert!(!model.has_lists(), "one object, whose search ends when nothing is in doubt");
    let frame = crowd(&path);
    for depth in [Depth::Usual, Depth::Thorough] {
        let one = search_for(&frame, &model, &request(Profile::Vga, depth, 1), 0).unwrap();
        assert!(one.detections.len() == 2 && one.stats.tiles > 0, "{:?}", one.stats);
        for threads in [2, 3] {
            let several = search_for(&frame, &model, &request(Profile::Vga, depth, threads), 0).unwrap();
            assert!(told(&several) == told(&one), "{depth:?}, {threads} threads");
        }
    }
    // In pieces, beside a tracker, and with another number of threads in each frame.
    let (mut one, mut several) = (Follower::default(), Follower::default());
    for threads in [2, 1, 3, 2] {
        let alone = follow(&frame, &model, &request(Profile::Vga, Depth::Usual, 1), 0, &mut one).unwrap();
        let together = follow(&frame, &model, &request(Profile::Vga, Depth::Usual, threads), 1, &mut several).unwrap();
        assert!(told(&together) == told(&alone), "{threads} threads");
    }
}

#[test]
fn a_sequence_is_followed_as_by_one_thread() {
    let (_, both) = sample(&file("assets"), Preset::Compact).unwrap();
    let model = Model::parse(&both).unwrap();
    let (mut one, mut several) = (Follower::default(), Follower::default());
    for frame in frames(1).take(24) {
        let picture = frame.picture.unwrap();
        let (alone, together) = (request(Profile::Vga, Depth::Usual, 1), request(Profile::Vga, Depth::Usual, 2));
        let alone = follow(&picture, &model, &alone, 0, &mut one).unwrap();
        let together = follow(&picture, &model, &together, 1, &mut several).unwrap();
        assert!(told(&together) == told(&alone), "{}", frame.source);
    }
}
