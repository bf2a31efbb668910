//! Tests the whole path on rendered frames: a seeded sweep whose result is kept as a table, several
//! copies of one object, and many objects in one model. Everything is made from the shipped
//! pictures and from seeds.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fmt::Write;
use std::sync::LazyLock;

use keygraph::input::{Picture, Pixels, read_picture};
use keygraph::learn::{Preset, merge, train};
use keygraph::random::Random;
use keygraph::render::{Exposure, Pose, Print, RIGHT, Scene, corner_error};
use keygraph::search::{Profile, Request, search_for};
use keygraph::wide::search_widely;
use keygraph_core::{DEFAULT_THRESHOLD, Depth, Detection, Model};
use keygraph_tests::file;

const MILD: Exposure = Exposure { gain: 1.0, blur_px: 0.6, noise: 3.0 };
const FRONT: Pose = Pose { side_px: 300.0, rotation_deg: 0.0, tilt_deg: 0.0, axis_deg: 0.0, centre: [320.0, 240.0] };

type Quad = [[f32; 2]; 4];

/// Reads a picture of the repository.
fn shipped(name: &str) -> Picture {
    read_picture(&file("assets/pictures").join(name).with_extension("jpg")).unwrap()
}

/// Renders a picture of dead leaves. It has as much texture as a photograph, and each seed gives
/// another picture.
fn leaves(seed: u64) -> Picture {
    let mut random = Random::of(&[seed, 77]);
    let (width, height) = (360, 240 + 30 * (seed as usize % 5));
    let exposure = Exposure { gain: 1.0, blur_px: 0.7, noise: 0.0 };
    Scene::dead_leaves(width, height, &mut random).expose(&exposure, &mut random)
}

fn size(picture: &Picture) -> (f32, f32) {
    (picture.width as f32, picture.height as f32)
}

fn model(picture: &Picture, name: &str, preset: Preset) -> Vec<u8> {
    train(picture, name, preset, false).unwrap().0
}

fn lay(scene: &mut Scene, picture: &Picture, pose: &Pose) -> Quad {
    let (w, h) = size(picture);
    scene.lay(&Print::new(picture), pose).outline(w, h)
}

fn detections(frame: &Picture, model: &Model<'_>, profile: Profile, depth: Depth) -> Vec<Detection> {
    let request = Request { depth, ..Request::new(profile, DEFAULT_THRESHOLD) };
    search_for(frame, model, &request, 0).unwrap().detections
}

// --------------------------------------------------------------------- sweep

/// A change of the pose and of the exposure, for one line of the table.
type Change = fn(&mut Pose, &mut Exposure);

/// Conditions: some are well within the limits of the detector, some are at the limits, and some
/// are beyond them.
const CONDITIONS: [(&str, Change); 10] = [
    ("plain", |_, _| ()),
    ("60 px", |p, _| p.side_px = 60.0),
    ("500 px", |p, _| p.side_px = 500.0),
    ("tilt 30", |p, _| p.tilt_deg = 30.0),
    ("tilt 50", |p, _| p.tilt_deg = 50.0),
    ("tilt 70", |p, _| p.tilt_deg = 70.0),
    ("blur 3", |_, e| e.blur_px = 3.0),
    ("blur 6", |_, e| e.blur_px = 6.0),
    ("light 6%", |_, e| e.gain = 0.06),
    ("noise 60", |_, e| e.noise = 60.0),
];

/// Returns the mean of the corners.
fn middle(q: &Quad) -> [f32; 2] {
    [0, 1].map(|i| q.iter().map(|p| p[i]).sum::<f32>() / 4.0)
}

/// Each line of the table is a condition. Each column is an object with a seed. It shows the middle
/// of the first outline that is found, or a dash. The middle is rounded to 20 px, so that a change
/// of the last bits does not move it.
#[test]
fn the_sweep_comes_out_as_it_did() {
    let mut table = String::from("condition   found  wrong  columns, tens of px\n");
    let objects = ["astronaut", "coffee"].map(|name| {
        let picture = shipped(name);
        (model(&picture, name, Preset::Standard), picture)
    });
    for (line, (name, change)) in CONDITIONS.iter().enumerate() {
        let (mut found, mut wrong, mut columns) = (0, 0, String::new());
        for (index, (bytes, picture)) in objects.iter().enumerate() {
            let model = Model::parse(bytes).unwrap();
            for view in 0..2 {
                let mut random = Random::of(&[line as u64, index as u64, view]);
                let mut pose = Pose { rotation_deg: random.between(0.0, 360.0), axis_deg: 40.0, ..FRONT };
                let mut exposure = MILD;
                change(&mut pose, &mut exposure);
                let mut scene = Scene::dead_leaves(640, 480, &mut random);
                let pose = scene.somewhere(size(picture), pose, &mut random);
                let truth = lay(&mut scene, picture, &pose);
                let seen = detections(&scene.expose(&exposure, &mut random), &model, Profile::Vga, Depth::Usual);
                let right = seen.iter().filter(|d| corner_error(&d.corners, &truth) < RIGHT).count();
                found += right.min(1);
                wrong += seen.len() - right.min(1);
                match seen.first() {
                    Some(d) => {
                        let [x, y] = middle(&d.corners).map(|v| (v / 20.0).round() as i32 * 2);
                        write!(columns, "{:>8}", format!("{x},{y}")).unwrap();
                    }
                    None => columns.push_str("       -"),
                }
            }
        }
        writeln!(table, "{name:10}  {found:>2}/4  {wrong:>5} {columns}").unwrap();
    }
    insta::assert_snapshot!(table);
}

// ------------------------------------------------------------ many at a time

/// Whether a detection is this instance.
fn is(d: &Detection, (object, quad): &(u16, Quad)) -> bool {
    d.object == *object && corner_error(&d.corners, quad) < RIGHT
}

/// Checks that every instance is found once, and nothing else is found.
fn assert_each_once(what: &str, seen: &[Detection], truth: &[(u16, Quad)]) {
    let mut faults = String::new();
    for (i, t) in truth.iter().enumerate() {
        let times = seen.iter().filter(|d| is(d, t)).count();
        if times != 1 {
            writeln!(faults, "instance {i} of object {} at {:.0?} is found {times} times", t.0, middle(&t.1)).unwrap();
        }
    }
    for d in seen.iter().filter(|d| !truth.iter().any(|t| is(d, t))) {
        writeln!(faults, "object {} at {:.0?}, score {:.2}, is not there", d.object, middle(&d.corners), d.score)
            .unwrap();
    }
    assert!(faults.is_empty(), "{what}:\n{faults}");
}

fn copies(name: &str, poses: &[Pose], depth: Depth) {
    let picture = shipped(name);
    let bytes = model(&picture, name, Preset::Large);
    for seed in 0..3 {
        let mut random = Random::of(&[seed, 5]);
        let mut scene = Scene::dead_leaves(640, 480, &mut random);
        let turn = random.between(0.0, 360.0);
        let truth: Vec<(u16, Quad)> = poses
            .iter()
            .map(|p| (0, lay(&mut scene, &picture, &Pose { rotation_deg: p.rotation_deg + turn, ..*p })))
            .collect();
        let frame = scene.expose(&MILD, &mut random);
        let seen = detections(&frame, &Model::parse(&bytes).unwrap(), Profile::Vga, depth);
        assert_each_once(&format!("{} copies of {name}, seed {seed}", poses.len()), &seen, &truth);
    }
}

#[test]
fn two_copies_are_both_found_and_none_doubled() {
    let poses = [
        Pose { centre: [165.0, 230.0], side_px: 220.0, ..FRONT },
        Pose { centre: [475.0, 250.0], side_px: 210.0, rotation_deg: 100.0, tilt_deg: 20.0, ..FRONT },
    ];
    copies("astronaut", &poses, Depth::Usual);
    copies("coffee", &poses, Depth::Usual);
}

#[test]
fn three_copies_are_all_found_and_none_doubled() {
    let poses = [
        Pose { centre: [125.0, 140.0], side_px: 170.0, ..FRONT },
        Pose { centre: [350.0, 330.0], side_px: 190.0, rotation_deg: 70.0, tilt_deg: 15.0, ..FRONT },
        Pose { centre: [520.0, 140.0], side_px: 170.0, rotation_deg: 200.0, ..FRONT },
    ];
    copies("astronaut", &poses, Depth::Usual);
}

/// A quick search stops after it has found the large copy.
#[test]
fn a_small_copy_beside_a_large_one_is_found_by_a_thorough_search() {
    let poses = [
        Pose { centre: [200.0, 240.0], side_px: 300.0, ..FRONT },
        Pose { centre: [530.0, 240.0], side_px: 100.0, rotation_deg: 70.0, tilt_deg: 15.0, ..FRONT },
    ];
    copies("astronaut", &poses, Depth::Thorough);
    copies("coffee", &poses, Depth::Thorough);
}

/// Twelve pictures, and their models in one.
static TWELVE: LazyLock<(Vec<Picture>, Vec<u8>)> = LazyLock::new(|| {
    let mut pictures: Vec<Picture> = ["astronaut", "coffee", "rocket", "hubble"].map(shipped).into();
    pictures.extend((0..8).map(leaves));
    let models: Vec<Vec<u8>> =
        pictures.iter().enumerate().map(|(i, p)| model(p, &format!("object {i}"), Preset::Compact)).collect();
    let packed = merge(&models).unwrap();
    (pictures, packed)
});

/// A shelf of eight columns and five rows. Its objects get too few of the corners of a frame, and are
/// found in its tiles.
#[test]
fn small_objects_in_a_crowd_are_found_in_tiles() {
    let (pictures, packed) = &*TWELVE;
    let model = Model::parse(packed).unwrap();
    let mut random = Random::of(&[40]);
    let mut scene = Scene::dead_leaves(640, 480, &mut random);
    let truth: Vec<(u16, Quad)> = (0..40)
        .map(|i| {
            let centre = [40.0 + 80.0 * (i % 8) as f32, 48.0 + 96.0 * (i / 8) as f32];
            let pose = Pose { side_px: 72.0, rotation_deg: random.between(-5.0, 5.0), centre, ..FRONT };
            (i as u16 % 12, lay(&mut scene, &pictures[i % 12], &pose))
        })
        .collect();
    let frame = scene.expose(&MILD, &mut random);
    let once = detections(&frame, &model, Profile::Vga, Depth::Once);
    let seen = detections(&frame, &model, Profile::Vga, Depth::Usual);
    // Details are of the whole frame, and not of the last tile.
    let request = Request { details: true, ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
    let shown = search_for(&frame, &model, &request, 0).unwrap();
    assert_eq!(shown.detections, seen);
    assert!(shown.corners.iter().any(|p| p[0] < 200.0) && shown.corners.iter().any(|p| p[0] > 440.0));
    assert!(shown.supporters.iter().any(|s| !s.is_empty()));
    let right = |found: &[Detection]| truth.iter().filter(|t| found.iter().filter(|d| is(d, t)).count() == 1).count();
    println!("of 40, {} are found at once and {} in tiles", right(&once), right(&seen));
    assert!(right(&once) < 30, "the test shows nothing");
    assert!(right(&seen) >= 38);
    assert_eq!(seen.len(), right(&seen), "nothing else is found");
}

/// Tests twelve objects in one model, all of them in one frame, in three layouts of four columns
/// and three rows.
#[test]
fn twelve_objects_in_a_frame_are_all_found_and_none_doubled() {
    let (pictures, packed) = &*TWELVE;
    let model = Model::parse(packed).unwrap();
    assert_eq!(model.objects(), 12);
    for seed in 0..3 {
        let mut random = Random::of(&[seed, 12]);
        let mut scene = Scene::dead_leaves(1280, 720, &mut random);
        let place = |i: usize| [160.0 + 320.0 * (i % 4) as f32, 120.0 + 240.0 * (i / 4) as f32];
        let truth: Vec<(u16, Quad)> = (0..12)
            .map(|i| {
                let object = (i * 5 + seed as usize) % 12;
                let turn = random.between(-25.0, 25.0);
                let pose = Pose { side_px: 235.0, rotation_deg: turn, tilt_deg: 10.0, centre: place(i), ..FRONT };
                (object as u16, lay(&mut scene, &pictures[object], &pose))
            })
            .collect();
        let seen = detections(&scene.expose(&MILD, &mut random), &model, Profile::Hd, Depth::Usual);
        assert_each_once(&format!("twelve objects, seed {seed}"), &seen, &truth);
    }
}

// --------------------------------------------------------------- far aside

/// Eight steep views of a picture, tilted along as many directions, and where they are seen.
fn steep_views(picture: &Picture, tilt_deg: f32) -> Vec<(Picture, Quad)> {
    let views = (0..8).map(|i| {
        let mut random = Random::of(&[i, 99]);
        let mut scene = Scene::dead_leaves(1000, 750, &mut random);
        let (axis_deg, rotation_deg) = (22.5 * i as f32 + 10.0, random.between(0.0, 360.0));
        let pose = Pose { side_px: 640.0, tilt_deg, axis_deg, rotation_deg, centre: [500.0, 375.0] };
        let truth = lay(&mut scene, picture, &pose);
        (scene.expose(&MILD, &mut random), truth)
    });
    views.collect()
}

#[test]
fn what_is_seen_from_far_to_the_side_is_found_by_a_wide_search() {
    for name in ["astronaut", "coffee"] {
        let picture = shipped(name);
        let bytes = model(&picture, name, Preset::Large);
        let model = Model::parse(&bytes).unwrap();
        let (mut plain, mut wide) = (0, 0);
        for (frame, truth) in steep_views(&picture, 79.0) {
            let request = Request::new(Profile::Vga, DEFAULT_THRESHOLD);
            let right = |found: &[Detection]| found.iter().filter(|d| is(d, &(0, truth))).count();
            plain += right(&search_widely(&frame, &model, &request, 0..1).unwrap().detections);
            let found = search_widely(&frame, &model, &Request { wide: true, ..request }, 0..2).unwrap();
            assert!(found.detections.len() <= 1, "one outline at a place: {:?}", found.detections);
            assert_eq!(found.rivals.len(), found.detections.len());
            wide += right(&found.detections);
        }
        println!("{name}: of 8 views at 79 degrees, {plain} are found plainly and {wide} widely");
        assert!(plain <= 2, "the test shows nothing");
        assert!(wide >= 7);
    }
}

/// One object of two is seen plainly, and the other from far to the side. Frames of gray do as well.
#[test]
fn a_wide_search_keeps_what_is_seen_plainly() {
    let pictures = ["coffee", "astronaut"].map(shipped);
    let models = [0, 1].map(|i| model(&pictures[i], &format!("object {i}"), Preset::Large));
    let packed = merge(&models).unwrap();
    let mut random = Random::of(&[7]);
    let mut scene = Scene::dead_leaves(1000, 750, &mut random);
    let steep = Pose { side_px: 640.0, tilt_deg: 78.0, axis_deg: 100.0, rotation_deg: 30.0, centre: [750.0, 375.0] };
    let poses = [Pose { centre: [250.0, 375.0], ..FRONT }, steep];
    let truth: Vec<(u16, Quad)> = (0..2).map(|i| (i as u16, lay(&mut scene, &pictures[i], &poses[i]))).collect();
    let frame = scene.expose(&MILD, &mut random);
    let Pixels::Rgb8(rgb) = &frame.pixels else { panic!("rendered frames have colour") };
    let gray = Picture { pixels: Pixels::Gray8(rgb.chunks(3).map(|p| p[1]).collect()), ..frame };
    for frame in [&frame, &gray] {
        let request = Request { wide: true, ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
        let seen = search_widely(frame, &Model::parse(&packed).unwrap(), &request, 0..1).unwrap().detections;
        assert_each_once("one plain, one steep", &seen, &truth);
    }
}
