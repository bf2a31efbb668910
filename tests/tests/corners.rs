//! Compares our corners with golden lists: the corners of OpenCV's `goodFeaturesToTrack`, in their
//! order, in `tests/data/corners`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fmt::Write;

use heapless::Vec as FixedVec;
use keygraph_core::stages::corners::{Corner, CornerParams, SCRATCH_ROWS, detect_corners};
use keygraph_core::stages::pace::Steady;
use keygraph_core::stages::plane::Plane;
use keygraph_core::stages::rank::rank_by_strength;
use keygraph_tests::file;

/// One corner of a golden list.
#[derive(Clone, Copy, Debug)]
struct Golden {
    x: i32,
    y: i32,
    /// OpenCV's eigenvalue, converted to our strength: twice the smaller eigenvalue of the integer
    /// structure tensor.
    strength: f64,
}

/// The contents of a golden list.
struct List {
    min_distance_px: u16,
    corners: Vec<Golden>,
}

/// Factor 1 / scale^2 of the headers: `eigenvalue = lambda_int / PER_EIGENVALUE`.
const PER_EIGENVALUE: f64 = 3060.0 * 3060.0;

fn read_list(name: &str, kind: &str) -> List {
    let text = std::fs::read_to_string(file(&format!("tests/data/corners/{name}.{kind}.txt"))).unwrap();
    let word = text.split_whitespace().find_map(|w| w.strip_prefix("minDistance="));
    let corners = text.lines().filter(|l| !l.starts_with('#')).map(|line| {
        let mut numbers = line.split(' ');
        let mut next = || numbers.next().unwrap_or_else(|| panic!("{name}.{kind}: short line {line:?}"));
        let (x, y) = (next().parse().unwrap(), next().parse().unwrap());
        let eigenvalue: f64 = next().parse().unwrap();
        Golden { x, y, strength: 2.0 * eigenvalue * PER_EIGENVALUE }
    });
    List { min_distance_px: word.unwrap().parse().unwrap(), corners: corners.collect() }
}

fn our_corners(name: &str, min_distance_px: u16, limit: usize) -> Vec<Corner> {
    let picture = image::open(file(&format!("tests/data/corners/{name}.png"))).unwrap().into_luma8();
    let (w, h) = (picture.width() as usize, picture.height() as usize);
    let plane = Plane::new(picture.as_raw(), w, h).unwrap();
    // OpenCV's quality of 0.01 is 655.36 in our unit. Rounding down lets in a few more weak corners,
    // at the end of a list that is cut long before.
    let params = CornerParams { quality_q16: 655, floor: 1, margin_px: 1 };
    let mut found: Box<FixedVec<Corner, 8192>> = Box::default();
    let mut scratch = vec![0.0; SCRATCH_ROWS * w];
    let stats = detect_corners(plane, &params, &mut scratch, &mut *found, &mut Steady);
    assert_eq!(stats.dropped, 0, "{name}: the buffer is too small for this test");
    rank_by_strength(&mut *found, min_distance_px, limit, &mut keygraph_core::StageStats::default(), &mut Steady);
    found.to_vec()
}

fn is_same_place(c: &Corner, g: &Golden) -> bool {
    let [x, y] = c.point.px();
    (x - g.x as f32).abs() < 1.0 && (y - g.y as f32).abs() < 1.0
}

/// Returns both lists around entry `at`, side by side.
fn side_by_side(ours: &[Corner], golden: &[Golden], at: usize) -> String {
    let mut out = String::from("entry |     ours x      y   strength |  OpenCV x  y   strength\n");
    for i in at.saturating_sub(2)..(at + 4).min(ours.len().max(golden.len())) {
        let ours = ours.get(i).map_or_else(
            || format!("{:>29}", "-"),
            |c| format!("{:>10.2} {:>6.2} {:>10} ", c.point.px()[0], c.point.px()[1], c.strength),
        );
        let golden =
            golden.get(i).map_or_else(|| "-".into(), |g| format!("{:>8} {:>3} {:>12.1}", g.x, g.y, g.strength));
        let mark = if i == at { ">" } else { " " };
        writeln!(out, "{mark}{i:>4} | {ours} | {golden}").unwrap();
    }
    out
}

fn compare(name: &str, kind: &str) {
    let list = read_list(name, kind);
    let golden = &list.corners;
    let ours = our_corners(name, list.min_distance_px, golden.len());
    let differs =
        |at: usize, how: &str| -> ! { panic!("{name}.{kind}, entry {at}: {how}\n{}", side_by_side(&ours, golden, at)) };
    if ours.len() != golden.len() {
        differs(ours.len().min(golden.len()), &format!("{} corners for {}", ours.len(), golden.len()));
    }
    // Corners of equal strength may come in any order.
    let mut start = 0;
    for run in ours.chunk_by(|a, b| a.strength == b.strength) {
        for (i, g) in golden[start..].iter().enumerate().take(run.len()) {
            if !run.iter().any(|c| is_same_place(c, g)) {
                differs(start + i, "another place");
            }
        }
        start += run.len();
    }
    // OpenCV computes in float32, and we round up: the tolerance is 1 plus 1e-6 of the largest strength.
    let tolerance = 1.0 + 1e-6 * golden[0].strength;
    for (i, (c, g)) in ours.iter().zip(golden).enumerate() {
        if (f64::from(c.strength) - g.strength).abs() > tolerance {
            differs(i, "another strength");
        }
    }
}

#[test]
fn astronaut_strongest_300() {
    compare("astronaut", "plain");
}

#[test]
fn astronaut_79_of_them_10_px_apart() {
    compare("astronaut", "spaced");
}

#[test]
fn coffee_strongest_300() {
    compare("coffee", "plain");
}

#[test]
fn coffee_79_of_them_10_px_apart() {
    compare("coffee", "spaced");
}

#[test]
fn rocket_strongest_300() {
    compare("rocket", "plain");
}

#[test]
fn rocket_79_of_them_10_px_apart() {
    compare("rocket", "spaced");
}
