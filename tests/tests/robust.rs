//! Tests with frames that no camera should deliver, and with some that cameras do deliver. The
//! detector must not panic, and must count what it drops.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

use heapless::VecView;
use keygraph_core::stages::corners::Corner;
use keygraph_core::stages::delaunay::Triple;
use keygraph_core::stages::finder::Finder;
use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::pace::Pace;
use keygraph_core::stages::plane::Plane;
use keygraph_core::{
    DEFAULT_THRESHOLD, Detection, Detector, FeatureKind, Frame, FrameError, Method, Model, PixelFormat, Profile,
    QqvgaDetector, QvgaDetector, Stage, StageStats, Stats, VgaDetector,
};
use keygraph_tests::{small_model, small_picture};

static QQVGA: Mutex<QqvgaDetector> = Mutex::new(QqvgaDetector::new());
static QVGA: Mutex<QvgaDetector> = Mutex::new(QvgaDetector::new());
static VGA: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());

static KEYGRAPH: LazyLock<Vec<u8>> = LazyLock::new(|| small_model(Method::Keygraph, FeatureKind::Both, 40));
static PAPER: LazyLock<Vec<u8>> = LazyLock::new(|| small_model(Method::Paper, FeatureKind::Chroma, 40));

/// A detector of any profile.
type AnyDetector = Detector<dyn Profile>;

/// Searches a frame at a threshold of 0.
fn detect(
    detector: &mut AnyDetector,
    frame: &Frame<'_>,
    model: &Model<'_>,
) -> Result<(Vec<Detection>, Stats), FrameError> {
    let found = detector.detect(frame, model, 0.0, &mut || 0)?.to_vec();
    Ok((found, *detector.stats()))
}

fn lock<T>(detector: &Mutex<T>) -> MutexGuard<'_, T> {
    detector.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A function from column and row to three bytes: red, green, blue or Y, U, V.
type Pattern = fn(usize, usize) -> [u8; 3];

/// Returns noise. It is the same in every run.
fn noise(x: usize, y: usize) -> [u8; 3] {
    let mut v = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca6b);
    v = (v ^ v >> 15).wrapping_mul(0x2c1b_3c6d);
    v = (v ^ v >> 12).wrapping_mul(0x297a_2d39);
    v ^= v >> 15;
    [v as u8, (v >> 8) as u8, (v >> 16) as u8]
}

fn either(bright: bool) -> [u8; 3] {
    if bright { [235, 240, 16] } else { [16, 16, 240] }
}

const PATTERNS: [(&str, Pattern); 14] = [
    ("noise", noise),
    ("noise of 4 px", |x, y| noise(x / 4, y / 4)),
    ("black and white noise", |x, y| [noise(x, y)[0] & 0x80; 3].map(|v| v / 0x80 * 255)),
    ("black", |_, _| [0; 3]),
    ("gray", |_, _| [128; 3]),
    ("white", |_, _| [255; 3]),
    ("checkerboard of 1 px", |x, y| either((x + y) % 2 == 0)),
    ("checkerboard of 2 px", |x, y| either((x / 2 + y / 2) % 2 == 0)),
    ("checkerboard of 16 px", |x, y| either((x / 16 + y / 16) % 2 == 0)),
    ("columns", |x, _| either(x / 3 % 2 == 0)),
    ("rows", |_, y| either(y / 5 % 2 == 0)),
    ("diagonals", |x, y| either((x + 2 * y) / 7 % 2 == 0)),
    ("dots on a grid", |x, y| either(x % 11 == 5 && y % 11 == 5)),
    ("a ramp", |x, y| [(x + y) as u8, x as u8, y as u8]),
];

/// Draws a frame of the pattern. Returns `None` if the format does not allow the size.
fn draw(format: PixelFormat, w: usize, h: usize, pattern: Pattern) -> Option<Vec<u8>> {
    let places = || (0..h).flat_map(move |y| (0..w).map(move |x| (x, y)));
    let luma = || places().map(|(x, y)| pattern(x, y)[0]);
    // Each 2x2 block has one chroma sample.
    let chroma = |c: usize| places().filter(|(x, y)| x % 2 == 0 && y % 2 == 0).map(move |(x, y)| pattern(x, y)[c]);
    let (odd_width, odd_height) = (w % 2 == 1, h % 2 == 1);
    let data: Vec<u8> = match format {
        PixelFormat::Rgb8 => places().flat_map(|(x, y)| pattern(x, y)).collect(),
        PixelFormat::Gray8 => luma().collect(),
        PixelFormat::Rgb565 | PixelFormat::Rgb565Be => places()
            .flat_map(|(x, y)| {
                let p = pattern(x, y);
                [p[0], p[1]]
            })
            .collect(),
        PixelFormat::Yuyv | PixelFormat::Uyvy if odd_width => return None,
        PixelFormat::Yuyv => places()
            .flat_map(|(x, y)| {
                let p = pattern(x, y);
                [p[0], p[1 + x % 2]]
            })
            .collect(),
        PixelFormat::Uyvy => places()
            .flat_map(|(x, y)| {
                let p = pattern(x, y);
                [p[1 + x % 2], p[0]]
            })
            .collect(),
        PixelFormat::Nv12 | PixelFormat::I420 if odd_width || odd_height => return None,
        PixelFormat::Nv12 => luma().chain(chroma(1).zip(chroma(2)).flat_map(|(u, v)| [u, v])).collect(),
        PixelFormat::I420 => luma().chain(chroma(1)).chain(chroma(2)).collect(),
    };
    Some(data)
}

/// Checks the properties that the result of any frame must have.
fn check(what: &str, method: Method, found: &[Detection], stats: &Stats) {
    for stage in [Stage::Corners, Stage::Keygraphs, Stage::Vote] {
        let s = stats.stages[stage as usize];
        assert!(s.kept + s.dropped <= s.seen, "{what}: {} kept and dropped more than it saw: {s:?}", stage.name());
    }
    for d in found {
        assert!((0.0..=1.0).contains(&d.score), "{what}: score {}", d.score);
        assert!(d.corners.iter().flatten().all(|v| v.is_finite()), "{what}: corners {:?}", d.corners);
        assert!(method == Method::Paper || d.score < DEFAULT_THRESHOLD, "{what}: object seen, score {}", d.score);
    }
}

/// Searches every pattern in every size. With `all` each frame comes in every format; without it
/// the formats take turns.
fn sweep(detector: &mut AnyDetector, sizes: &[(usize, usize)], all: bool) {
    let models = [Model::parse(&KEYGRAPH).unwrap(), Model::parse(&PAPER).unwrap()];
    let mut frames = 0;
    for (s, &(w, h)) in sizes.iter().enumerate() {
        for (p, (name, pattern)) in PATTERNS.into_iter().enumerate() {
            for (f, format) in PixelFormat::ALL.into_iter().enumerate() {
                if !all && (s + p) % PixelFormat::ALL.len() != f {
                    continue;
                }
                let Some(data) = draw(format, w, h, pattern) else { continue };
                let frame = Frame::new(format, w, h, &data).unwrap();
                let model = &models[usize::from((s + p + f) % 4 == 0)];
                frames += 1;
                let what = format!("{name}, {format:?} {w}x{h}, {:?}", model.method());
                let (found, stats) = detect(detector, &frame, model).unwrap_or_else(|e| panic!("{what}: {e}"));
                check(&what, model.method(), &found, &stats);
            }
        }
    }
    assert!(frames >= 2 * sizes.len(), "only {frames} frames were drawn");
}

/// Returns the smallest size, odd sizes, and the largest sides for an area of `pixels`.
fn sizes(side: usize, pixels: usize) -> Vec<(usize, usize)> {
    let square = (1..=side).rev().find(|s| s * s <= pixels).unwrap();
    let other = pixels / side;
    vec![
        (16, 16),
        (17, 19),
        (side, 16),
        (16, side),
        (side - 1, 17),
        (side, other),
        (other, side),
        (square, square),
        (square - 1, square),
    ]
}

#[test]
fn qqvga_takes_any_pattern_in_any_format() {
    sweep(&mut *lock(&QQVGA), &sizes(160, 160 * 120), true);
}

#[test]
fn qvga_takes_any_pattern() {
    sweep(&mut *lock(&QVGA), &sizes(320, 320 * 240), false);
}

#[test]
fn vga_takes_any_pattern() {
    sweep(&mut *lock(&VGA), &sizes(640, 640 * 480), false);
}

fn noise_stats(detector: &mut AnyDetector, w: usize, h: usize) -> Stats {
    let data = draw(PixelFormat::Rgb8, w, h, noise).unwrap();
    let frame = Frame::new(PixelFormat::Rgb8, w, h, &data).unwrap();
    detect(detector, &frame, &Model::parse(&KEYGRAPH).unwrap()).unwrap().1
}

#[test]
fn dense_noise_overflows_and_is_counted() {
    for (name, stats) in [
        ("qqvga", noise_stats(&mut *lock(&QQVGA), 160, 120)),
        ("qvga", noise_stats(&mut *lock(&QVGA), 320, 240)),
        ("vga", noise_stats(&mut *lock(&VGA), 640, 480)),
    ] {
        let corners = stats.stages[Stage::Corners as usize];
        assert!(corners.dropped > 0 && corners.kept > 0, "{name}: {corners:?}");
        assert!(corners.seen > 2 * corners.kept, "{name}: {corners:?}");
    }
    // Noise makes more triangles than the smallest profile has room for.
    let delaunay = noise_stats(&mut *lock(&QQVGA), 160, 120).stages[Stage::Delaunay as usize];
    assert!(delaunay.dropped > 0, "qqvga: {delaunay:?}");
}

#[test]
fn a_frame_leaves_nothing_behind() {
    let picture = small_picture();
    let model = Model::parse(&KEYGRAPH).unwrap();
    let mut detector = lock(&QQVGA);
    let run = |detector: &mut QqvgaDetector| {
        let (found, stats) = detect(detector, &picture.frame(), &model).unwrap();
        (found.iter().map(|d| (d.corners, d.score, d.votes)).collect::<Vec<_>>(), stats.stages)
    };
    let first = run(&mut detector);
    for (_, pattern) in PATTERNS {
        let data = draw(PixelFormat::Yuyv, 160, 120, pattern).unwrap();
        detect(&mut *detector, &Frame::new(PixelFormat::Yuyv, 160, 120, &data).unwrap(), &model).unwrap();
        assert_eq!(run(&mut detector), first);
    }
}

#[test]
fn a_frame_too_large_is_refused_with_the_sizes() {
    let refuse = |detector: &mut AnyDetector, w: usize, h: usize, max_side: usize, max_pixels: usize| {
        let data = vec![90; w * h];
        let frame = Frame::new(PixelFormat::Gray8, w, h, &data).unwrap();
        let error = detect(detector, &frame, &Model::parse(&KEYGRAPH).unwrap()).unwrap_err();
        let (pixels, side) = (w * h, w.max(h));
        assert_eq!(error, FrameError::TooLarge { pixels, max_pixels, side, max_side }, "{w}x{h}");
        for number in [pixels, max_pixels, side, max_side] {
            assert!(error.to_string().contains(&number.to_string()), "{error} does not say {number}");
        }
    };
    let each = |detector: &mut AnyDetector, side: usize, pixels: usize| {
        refuse(detector, side + 1, 16, side, pixels);
        refuse(detector, 16, side + 1, side, pixels);
        refuse(detector, side, side, side, pixels);
        refuse(detector, side, pixels / side + 1, side, pixels);
        refuse(detector, 4 * side, 3 * side, side, pixels);
        // A refused frame must not affect the next frame.
        noise_stats(detector, side, pixels / side);
    };
    each(&mut *lock(&QQVGA), 160, 160 * 120);
    each(&mut *lock(&QVGA), 320, 320 * 240);
    each(&mut *lock(&VGA), 640, 640 * 480);
}

#[test]
fn refused_frames_say_what_would_do() {
    let data = [0; 20_000];
    let message = |format, w, h, n: usize| Frame::new(format, w, h, &data[..n]).unwrap_err().to_string();
    for (message, words) in [
        (message(PixelFormat::Rgb8, 40, 30, 3599), &["3599", "3600"][..]),
        (message(PixelFormat::Gray8, 15, 400, 6000), &["15x400", "at least 16"]),
        (message(PixelFormat::Yuyv, 31, 32, 1984), &["31", "even width"]),
        (message(PixelFormat::Nv12, 32, 31, 1488), &["31", "even height"]),
    ] {
        assert!(words.iter().all(|w| message.contains(w)), "{message:?} does not say {words:?}");
    }
}

/// A finder that fills every buffer with meaningless data.
struct Nonsense;

impl Finder for Nonsense {
    fn keypoints(&mut self, luma: Plane<'_, u8>, _: usize, out: &mut VecView<Corner>, _: &mut dyn Pace) -> StageStats {
        let mut i = 0;
        while !out.is_full() {
            let [x, y, _] = noise(i, luma.width());
            let far = if i % 5 == 0 { i16::MAX } else { i16::from(x) * 16 };
            let _ = out.push(Corner { point: Point::new(far, i16::from(y) * 16), strength: 1, radius2: 0 });
            i += 1;
        }
        StageStats::default()
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, _: &mut dyn Pace) -> StageStats {
        let n = points.len() as u16;
        let mut i = 0;
        while !out.is_full() {
            let [a, b, c] = noise(i, 3).map(u16::from);
            let _ = out.push([[a, b, c], [a, a, b], [n, u16::MAX, 0], [0, 1, n.saturating_sub(1)]][i % 4]);
            i += 1;
        }
        StageStats::default()
    }
}

#[test]
fn a_foreign_finder_may_err() {
    let picture = small_picture();
    for bytes in [&KEYGRAPH, &PAPER] {
        let model = Model::parse(bytes).unwrap();
        let mut detector = lock(&QQVGA);
        detector.detect_with(&picture.frame(), &model, 0.0, &mut || 0, &mut Nonsense).unwrap();
        let stats = *detector.stats();
        assert!(stats.stages[Stage::Keygraphs as usize].kept > 0, "{stats:?}");
    }
}
