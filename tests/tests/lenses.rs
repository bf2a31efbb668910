//! Tests detections through lenses, on rendered frames with known poses.
#![allow(clippy::unwrap_used)]

use std::sync::LazyLock;

use keygraph::calibrate::{Kind, View, calibrate};
use keygraph::learn::{Preset, train};
use keygraph::lens_file;
use keygraph::picture::Picture;
use keygraph::search::{Follower, Profile, Request, Shape, follow, search_for};
use keygraph_core::{DEFAULT_THRESHOLD, Distortion, Intrinsics, Lens, Model, Pose, Surface, plane_pose};
use keygraph_tests::lensed::Lensed;
use keygraph_tests::motion::astronaut;
use keygraph_tests::scene::{FRAME, grid_error};

static PICTURE: LazyLock<Picture> = LazyLock::new(astronaut);
static MODEL: LazyLock<Vec<u8>> = LazyLock::new(|| train(&PICTURE, "astronaut", Preset::Compact, false).unwrap().0);

/// The lens of 2.8 mm of an OpenMV, that of a module with a GC2145, and a fisheye lens of 170 degrees: focal length at
/// 640 x 480 px, and coefficients of the size that calibrations of such lenses have.
const LENSES: [(&str, f32, Distortion); 3] = [
    ("2.8 mm", 450.0, Distortion::Brown([-0.36, 0.14, 5e-4, -4e-4, -0.02, 0.0, 0.0, 0.0])),
    ("GC2145", 620.0, Distortion::Brown([0.09, -0.22, -1e-3, 1e-3, 0.08, 0.0, 0.0, 0.0])),
    ("fisheye", 230.0, Distortion::Fisheye([0.02, -0.006, 0.002, -0.0004])),
];

/// Views of the picture: turns, and the place of its middle for a focal length of 1 in frame widths.
const VIEWS: [([f32; 3], [f32; 3]); 5] = [
    ([0.0, 0.0, 0.1], [0.0, 0.0, 1.0]),
    ([0.5, 0.2, -0.4], [0.25, -0.1, 1.05]),
    ([-0.3, -0.5, 0.8], [-0.3, 0.12, 1.1]),
    ([0.1, 0.6, 2.0], [0.2, 0.15, 1.0]),
    ([0.6, -0.1, -1.2], [-0.2, -0.15, 0.95]),
];

fn lens(focal: f32, distortion: Distortion) -> Lens {
    Lens::new([focal, focal * 1.005, 316.0, 243.0], distortion).unwrap()
}

/// A view of the picture, at a distance at which it is about 300 px wide.
fn view((turn, middle): ([f32; 3], [f32; 3]), lens: Lens) -> Lensed<'static> {
    let depth = middle[2] * lens.intrinsics()[0] / 300.0;
    let aside = |i: usize| middle[i] * 640.0 / 300.0 * middle[2];
    Lensed { picture: &PICTURE, lens, turn, middle: [aside(0), aside(1), depth] }
}

/// Mean distance of the grid points from where they are, px.
fn error(surface: &Surface, truth: &Lensed<'_>) -> f32 {
    grid_error(surface, &PICTURE, |p| truth.place(p))
}

/// Angle between two rotations, degrees, and the distance of two places over that from the camera.
fn apart(pose: &Pose, truth: &Lensed<'_>) -> [f32; 2] {
    let (a, b) = (pose.rotation, truth.rotation());
    let trace: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    let off = |i: usize| pose.translation_mm[i] - truth.middle[i];
    let [x, y, z] = truth.middle;
    let far = (x * x + y * y + z * z).sqrt();
    [
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees(),
        (off(0).powi(2) + off(1).powi(2) + off(2).powi(2)).sqrt() / far,
    ]
}

#[test]
fn a_plane_is_told_through_its_lens() {
    let model = Model::parse(&MODEL).unwrap();
    for (name, focal, distortion) in LENSES {
        let lens = lens(focal, distortion);
        let [fx, fy, cx, cy] = lens.intrinsics();
        let camera = Intrinsics::new(fx, fy, cx, cy).unwrap();
        let size = [PICTURE.width as f32, PICTURE.height as f32];
        for (i, v) in VIEWS.into_iter().enumerate() {
            let truth = view(v, lens);
            let request = Request { lens: Some(lens), ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
            let found = search_for(&truth.frame(), &model, &request, 0).unwrap();
            assert_eq!(found.detections.len(), 1, "{name}, view {i}");
            let surface = found.surfaces[0].unwrap();
            let plane = Surface::plane(&found.detections[0].homography, size);
            let (through, without) = (error(&surface, &truth), error(&plane, &truth));
            let pose = plane_pose(&surface.homography, &camera, size, 1.0).unwrap();
            let [degrees, share] = apart(&pose.best, &truth);
            assert!(!surface.is_bent && through < 0.7, "{name}, view {i}: {through} px, without the lens {without}");
            assert!(degrees < 0.5 && share < 0.01, "{name}, view {i}: {degrees} degrees, {share}");
        }
    }
}

#[test]
fn a_plane_is_followed_through_its_lens() {
    let model = Model::parse(&MODEL).unwrap();
    let (_, focal, distortion) = LENSES[0];
    let lens = lens(focal, distortion);
    let request = Request { lens: Some(lens), ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
    let mut follower = Follower::default();
    for i in 0..12u8 {
        let ([a, b, c], [x, y, z]) = VIEWS[1];
        let truth = view(([a, b + 0.02 * f32::from(i), c], [x - 0.01 * f32::from(i), y, z]), lens);
        let found = follow(&truth.frame(), &model, &request, 1, &mut follower).unwrap();
        let off = error(&found.surfaces[0].unwrap(), &truth);
        assert!(off < 0.7, "frame {i}: {off} px");
    }
    assert_eq!(follower.tracker.tracks().len(), 1);
}

/// A view as `keygraph calibrate` makes it, through what is known of the lens.
fn seen(frame: &Picture, lens: Option<Lens>) -> View {
    let model = Model::parse(&MODEL).unwrap();
    let request = Request { lens, shape: Shape::Plane, matches: true, ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
    let found = search_for(frame, &model, &request, 2).unwrap();
    let surface = found.surfaces.first().copied().flatten();
    let homography = surface.map_or(found.detections[0].homography, |s| s.homography);
    View { homography, size: [PICTURE.width as f32, PICTURE.height as f32], matches: found.matches[0].clone() }
}

fn views(frames: &[Picture], lens: Option<Lens>) -> Vec<View> {
    frames.iter().map(|frame| seen(frame, lens)).collect()
}

#[test]
fn a_camera_is_calibrated_from_views_of_a_picture() {
    let more = VIEWS.map(|([a, b, c], [x, y, z])| ([0.2 - b, a - 0.3, c + 1.0], [-x, -y * 0.8, z]));
    let shown = [VIEWS, more].concat();
    for (name, focal, distortion) in LENSES {
        let lens = lens(focal, distortion);
        let kind = if matches!(distortion, Distortion::Fisheye(_)) { Kind::Fisheye } else { Kind::Brown };
        let size = FRAME;
        let frames: Vec<Picture> = shown.iter().map(|&v| view(v, lens).frame()).collect();
        let mut found = calibrate(kind, &views(&frames, None), size, None).unwrap();
        for _ in 0..3 {
            let known = Some(found.lens().unwrap());
            found = calibrate(kind, &views(&frames, known), size, Some(&found)).unwrap();
        }
        let off = [0, 1].map(|i| (found.numbers[i] / f64::from(lens.intrinsics()[i]) - 1.0).abs());
        assert!(off.iter().all(|&off| off < 0.006), "{name}: {:?}", found.numbers);
        assert!(found.error_px < 0.4 && found.uncertainty[0] < 0.01 * found.numbers[0], "{name}: {found:?}");
        // Where places were seen, the lens found shows them where the true one does.
        let seen = found.lens().unwrap();
        let [fx, fy, cx, cy] = lens.intrinsics();
        for (x, y) in [(-0.4, -0.3), (0.0, 0.0), (0.4, 0.3), (0.45, -0.1)] {
            let ideal = |l: [f32; 4]| [l[2] + x * l[0], l[3] + y * l[1]];
            let (a, b) = (lens.distort(ideal([fx, fy, cx, cy])), seen.distort(ideal(seen.intrinsics())));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1.5, "{name}: {a:?} {b:?}");
        }
        let text = lens_file::written(&found, size).unwrap();
        let read = lens_file::parse(&text).unwrap().of_size(size[0], size[1]).unwrap();
        let off = read.intrinsics().into_iter().zip(seen.intrinsics()).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f32::max) < 1e-3, "{text}");
    }
}

#[test]
fn too_few_views_and_views_that_are_alike_are_refused() {
    let lens = lens(450.0, Distortion::None);
    let refused = |views: &[View], word: &str| {
        let error = calibrate(Kind::Brown, views, FRAME, None).unwrap_err().to_string();
        assert!(error.contains(word), "{word:?} is not in: {error}");
    };
    let all = views(&VIEWS.map(|v| view(v, lens).frame()), None);
    refused(&all[..4], "4 views can be used, and 5 are needed");
    let front = [0.0f32, 0.1, 0.2, 0.3, 0.4, 0.5].map(|turn| ([0.0, 0.0, turn], [0.1 * turn, 0.0, 1.0]));
    refused(&views(&front.map(|v| view(v, lens).frame()), None), "tilted by 30 degrees");
}
