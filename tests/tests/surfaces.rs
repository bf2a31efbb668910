//! Tests surfaces on rendered frames of a label on a can.
#![allow(clippy::unwrap_used)]

use std::sync::LazyLock;

use keygraph::cutout::rectify;
use keygraph::learn::{Preset, train};
use keygraph::picture::{Picture, Pixels};
use keygraph::report::frame_line;
use keygraph::search::{Follower, Found, Profile, Request, Shape, follow, search_for};
use keygraph_core::stages::surface::SIDE;
use keygraph_core::{DEFAULT_THRESHOLD, Intrinsics, Model, Surface, cylinder};
use keygraph_tests::can::Can;
use keygraph_tests::motion::{Motion, Sequence, astronaut};
use keygraph_tests::scene::grid_error;

static PICTURE: LazyLock<Picture> = LazyLock::new(astronaut);
static MODEL: LazyLock<Vec<u8>> = LazyLock::new(|| train(&PICTURE, "astronaut", Preset::Compact, false).unwrap().0);

fn can(turn_deg: f32) -> Can<'static> {
    Can { picture: &PICTURE, turn: turn_deg.to_radians(), spin: 0.1, lean: 0.2 }
}

fn request() -> Request {
    Request::new(Profile::Vga, DEFAULT_THRESHOLD)
}

/// Mean distance of the grid points from where they are, in sizes of the object.
fn error(surface: &Surface, can: &Can<'_>) -> f32 {
    let sides = [PICTURE.width as f32, PICTURE.height as f32];
    let [a, b] = [can.place([0.0; 2]), can.place(sides)];
    grid_error(surface, &PICTURE, |p| can.place(p)) / ((b[0] - a[0]) * (b[1] - a[1])).abs().sqrt()
}

/// The surface and the plane of the one detection of a frame.
fn surfaces(found: &Found) -> (Option<Surface>, Surface) {
    assert_eq!(found.detections.len(), 1);
    let sides = [PICTURE.width as f32, PICTURE.height as f32];
    (found.surfaces[0], Surface::plane(&found.detections[0].homography, sides))
}

#[test]
fn a_label_on_a_can_is_laid_around_it() {
    let model = Model::parse(&MODEL).unwrap();
    for turn in [45.0, 75.0, 100.0] {
        let can = can(turn);
        let found = search_for(&can.frame(), &model, &request(), 0).unwrap();
        let (surface, plane) = surfaces(&found);
        let (bent, flat) = (error(&surface.unwrap(), &can), error(&plane, &can));
        assert!(bent < 0.01 && bent < flat / 2.0, "{turn} degrees: {bent} on a surface, {flat} on a plane");
        let line = frame_line("can", 0, (640, 480), &model, &found, None);
        let told = &line["detections"][0]["surface"];
        assert_eq!((told["cols"].as_u64(), told["points"].as_array().unwrap().len()), (Some(9), SIDE * SIDE));
    }
}

#[test]
fn what_is_flat_or_said_to_be_flat_has_no_surface() {
    let model = Model::parse(&MODEL).unwrap();
    let flat = Sequence::new(&PICTURE, Motion::Still, 4.0, 7).shot(0).picture;
    let of = |picture: &Picture, shape| search_for(picture, &model, &Request { shape, ..request() }, 1).unwrap();
    let (any, plane) = (of(&flat, Shape::Any), of(&flat, Shape::Plane));
    assert_eq!(any.surfaces, [None]);
    assert_eq!((any.detections, plane.surfaces.len()), (plane.detections, 0));
    let bent = can(75.0).frame();
    let (any, plane) = (of(&bent, Shape::Any), of(&bent, Shape::Plane));
    assert!(any.surfaces[0].is_some());
    assert_eq!((any.detections, plane.surfaces.len()), (plane.detections, 0), "a surface changes nothing else");
}

#[test]
fn a_surface_is_followed_while_the_can_turns() {
    let model = Model::parse(&MODEL).unwrap();
    let mut follower = Follower::default();
    for i in 0..20u8 {
        let can = Can { spin: 0.02 * f32::from(i) - 0.2, lean: 0.01 * f32::from(i), ..can(75.0) };
        let found = follow(&can.frame(), &model, &request(), 2, &mut follower).unwrap();
        let (surface, _) = surfaces(&found);
        let off = error(&surface.unwrap(), &can);
        assert!(off < 0.012, "frame {i}: {off}");
    }
}

#[test]
fn a_can_has_its_axis_and_its_radius() {
    let model = Model::parse(&MODEL).unwrap();
    // 700 px is the focal length of the frames.
    let camera = Intrinsics::new(700.0, 700.0, 320.0, 240.0).unwrap();
    let size = [PICTURE.width as f32, PICTURE.height as f32];
    for turn in [60.0, 90.0, 110.0] {
        let can = can(turn);
        let found = search_for(&can.frame(), &model, &request(), 0).unwrap();
        let (surface, _) = surfaces(&found);
        let round = cylinder(&surface.unwrap(), &camera, None, size, 100.0).unwrap();
        let radius = 100.0 / can.turn;
        assert!((round.radius_mm / radius - 1.0).abs() < 0.06, "{turn} degrees: {} mm for {radius}", round.radius_mm);
        let upright = round.axis[1] * can.lean.cos() - round.axis[0] * can.lean.sin();
        assert!(upright > 0.99 && !round.is_inside, "{turn} degrees: {round:?}");
        assert!(
            (round.centre_mm[2] / 220.0 - 1.0).abs() < 0.06 && round.pose.error_px < 1.5,
            "{turn} degrees: {round:?}"
        );
    }
}

#[test]
fn a_label_is_shown_flat() {
    let model = Model::parse(&MODEL).unwrap();
    let frame = can(75.0).frame();
    let found = search_for(&frame, &model, &request(), 3).unwrap();
    let (surface, _) = surfaces(&found);
    let size = (PICTURE.width, PICTURE.height);
    let off = |surface: Option<&Surface>| {
        let flat = rectify(&frame, &found.detections[0], surface, size);
        let (Pixels::Rgb8(a), Pixels::Rgb8(b)) = (&flat.pixels, &PICTURE.pixels) else { unreachable!("both are RGB") };
        assert_eq!((flat.width, flat.height), size);
        let each = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - 0.85 * f64::from(b)).abs());
        each.sum::<f64>() / a.len() as f64
    };
    let (bent, flat) = (off(surface.as_ref()), off(None));
    assert!(bent < 12.0 && bent < flat / 2.0, "gray levels: {bent} from the surface, {flat} from the plane");
}
