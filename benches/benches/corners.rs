//! Times corner detection on a 640x480 frame: ours with ranking, beside FAST of imageproc with the
//! local maxima of its scores.
//!
//! The bench checks both results before it times them: of the 100 strongest FAST corners, at least
//! 90 must lie within 3 px of one of our corners.
//!
//! `cargo bench -p keygraph-benches --bench corners`
#![allow(clippy::unwrap_used, missing_docs)]

use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use heapless::Vec;
use imageproc::corners::{Corner as FastCorner, corners_fast9};
use imageproc::suppress::local_maxima;
use keygraph_core::stages::corners::{Corner, SCRATCH_ROWS, detect_corners};
use keygraph_core::stages::method::Parameters;
use keygraph_core::stages::pace::Steady;
use keygraph_core::stages::plane::Plane;
use keygraph_core::stages::rank::rank_by_radius;
use keygraph_core::{Method, StageStats};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
/// Minimum difference between a FAST corner and the pixels of its ring, gray levels.
const FAST_THRESHOLD: u8 = 20;

fn ours(luma: Plane<'_, u8>, rules: &Parameters, scratch: &mut [f32], out: &mut Vec<Corner, 2000>) {
    let mut stats: StageStats = detect_corners(luma, &rules.corners, scratch, out, &mut Steady);
    rank_by_radius(out, rules.corner_limits[0], scratch, &mut stats, &mut Steady);
}

fn fast(image: &image::GrayImage) -> std::vec::Vec<FastCorner> {
    local_maxima(&corners_fast9(image, FAST_THRESHOLD), 3)
}

fn bench(c: &mut Criterion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/sequence/0004.jpg");
    let image = image::open(path).unwrap().to_luma8();
    assert_eq!(image.dimensions(), (640, 480));
    let luma = Plane::new(image.as_raw(), WIDTH, HEIGHT).unwrap();
    let rules = Method::Keygraph.parameters();
    let mut scratch = vec![0.0; SCRATCH_ROWS * WIDTH];
    let mut corners = Vec::new();

    ours(luma, rules, &mut scratch, &mut corners);
    assert_eq!(corners.len(), rules.corner_limits[0]);
    let mut theirs = fast(&image);
    theirs.sort_by(|a, b| b.score.total_cmp(&a.score));
    assert!(theirs.len() >= 100, "{} corners", theirs.len());
    let mut all = Vec::<Corner, 2000>::new();
    detect_corners(luma, &rules.corners, &mut scratch, &mut all, &mut Steady);
    let near = |f: &&FastCorner| {
        all.iter().any(|c| {
            let [x, y] = c.point.px();
            (x - f.x as f32).hypot(y - f.y as f32) < 3.0
        })
    };
    let shared = theirs[..100].iter().filter(near).count();
    assert!(shared >= 90, "only {shared} of the 100 strongest FAST corners lie near one of ours");

    let mut group = c.benchmark_group("corners of 640x480");
    group.bench_function("ours, ranked", |b| b.iter(|| ours(luma, rules, &mut scratch, &mut corners)));
    group.bench_function("imageproc FAST-9, local maxima", |b| b.iter(|| fast(&image)));
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
