//! Times the fixed-capacity triangulation beside spade and delaunator.
//!
//! Input: 50, 200 and 400 random points in a frame of 640x480 px, on the detector's grid of 1/16
//! px. Each pass takes a different set of points, because a processor that sees one set of 200
//! points again and again learns its branches and halves the time.
//!
//! Our triangulation is timed twice: with a single level, which is what spade computes, and with
//! nested levels, which spade has to triangulate one by one. Before any timing, the bench checks
//! that all libraries give the same triangles, level by level.
//!
//! `cargo bench -p keygraph-benches --bench delaunay`
#![allow(clippy::unwrap_used, clippy::cast_possible_truncation, missing_docs)]

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use heapless::Vec as FixedVec;
use keygraph_core::stages::delaunay::{Triangulation, Triple, triangulate};
use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::pace::Steady;
use spade::{DelaunayTriangulation, Point2, Triangulation as _};

/// Number of points that the triangulation has room for, as in the vga profile.
const CAPACITY: usize = 512;
/// Prefixes that are triangulated: five of the ten prefixes of the detector.
const LEVELS: [usize; 5] = [25, 50, 100, 200, 400];

/// Number of point sets. The passes take them in turn.
const SETS: usize = 64;

type Spade = DelaunayTriangulation<Point2<f64>>;

/// Returns set number `set` of `n` distinct points. Every run gives the same points.
fn points(n: usize, set: usize) -> Vec<Point> {
    let mut state = 0x2545_f491_4f6c_dd1d_u64 ^ (n * SETS + set) as u64;
    let mut below = |limit: u64| {
        // A linear congruential generator with Knuth's constants. Its low bits are its worst bits.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % limit) as i16
    };
    let mut found: Vec<Point> = Vec::new();
    while found.len() < n {
        let p = Point::new(below(640 * 16), below(480 * 16));
        if !found.contains(&p) {
            found.push(p);
        }
    }
    found
}

fn for_spade(points: &[Point]) -> Vec<Point2<f64>> {
    points.iter().map(|p| Point2::new(f64::from(p.x), f64::from(p.y))).collect()
}

fn for_delaunator(points: &[Point2<f64>]) -> Vec<delaunator::Point> {
    points.iter().map(|p| delaunator::Point { x: p.x, y: p.y }).collect()
}

fn inserted(points: &[Point2<f64>]) -> Spade {
    let mut mesh = Spade::new();
    for &p in points {
        mesh.insert(p).unwrap();
    }
    mesh
}

/// Returns the prefixes of `LEVELS` that are at most `n` points long.
fn prefixes(n: usize) -> impl Iterator<Item = usize> {
    LEVELS.into_iter().filter(move |&l| l <= n)
}

fn sorted(mut t: Triple) -> Triple {
    t.sort_unstable();
    t
}

/// Returns spade's triangles as triples of indices into `points`.
fn triangles_of(mesh: &Spade, points: &[Point]) -> BTreeSet<Triple> {
    let index: BTreeMap<Point, u16> = points.iter().zip(0..).map(|(&p, i)| (p, i)).collect();
    let id = |p: Point2<f64>| index[&Point::new(p.x as i16, p.y as i16)];
    mesh.inner_faces().map(|f| sorted(f.positions().map(id))).collect()
}

/// Checks that all triangulations of one point set agree. A panic names the one that differs.
fn check(points: &[Point], floats: &[Point2<f64>], mesh: &mut Triangulation<CAPACITY>) {
    let n = points.len();
    let mut ours = |levels: &[usize]| {
        let mut out: FixedVec<Triple, 4096> = FixedVec::new();
        let stats = triangulate(points, levels, mesh.workspace(), &mut out, &mut Steady);
        let triangles: BTreeSet<Triple> = out.iter().map(|&t| sorted(t)).collect();
        assert_eq!((stats.kept as usize, stats.dropped), (triangles.len(), 0), "each triangle once, none lost");
        triangles
    };
    let (single, nested) = (ours(&[n]), ours(&LEVELS));
    let bulk = Spade::bulk_load(floats.to_vec()).unwrap();
    assert_eq!(single, triangles_of(&bulk, points), "{n} points: bulk_load has other triangles");
    assert_eq!(single, triangles_of(&inserted(floats), points), "{n} points: insert has other triangles");
    let other = delaunator::triangulate(&for_delaunator(floats)).triangles;
    let other: BTreeSet<Triple> = other.chunks(3).map(|t| sorted([t[0], t[1], t[2]].map(|i| i as u16))).collect();
    assert_eq!(single, other, "{n} points: delaunator has other triangles");
    let union: BTreeSet<Triple> = prefixes(n).flat_map(|l| triangles_of(&inserted(&floats[..l]), points)).collect();
    assert_eq!(nested, union, "{n} points: the levels have other triangles");
}

fn bench(c: &mut Criterion) {
    let mut mesh: Box<Triangulation<CAPACITY>> = Box::default();
    let mut out: FixedVec<Triple, 4096> = FixedVec::new();
    for n in [50, 200, 400] {
        let sets: Vec<Vec<Point>> = (0..SETS).map(|set| points(n, set)).collect();
        let floats: Vec<Vec<Point2<f64>>> = sets.iter().map(|s| for_spade(s)).collect();
        for (points, floats) in sets.iter().zip(&floats) {
            check(points, floats, &mut mesh);
        }

        let mut group = c.benchmark_group("delaunay");
        group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
        let mut next = sets.iter().cycle();
        group.bench_function(BenchmarkId::new("ours, one level", n), |b| {
            b.iter(|| {
                out.clear();
                triangulate(next.next().unwrap(), &[n], mesh.workspace(), &mut out, &mut Steady)
            });
        });
        group.bench_function(BenchmarkId::new("ours, nested levels", n), |b| {
            b.iter(|| {
                out.clear();
                triangulate(next.next().unwrap(), &LEVELS, mesh.workspace(), &mut out, &mut Steady)
            });
        });
        let mut next = floats.iter().cycle();
        group.bench_function(BenchmarkId::new("spade, bulk_load", n), |b| {
            let set = || next.next().unwrap().clone();
            b.iter_batched(set, |f| Spade::bulk_load(f).unwrap(), BatchSize::SmallInput);
        });
        let flat: Vec<Vec<delaunator::Point>> = floats.iter().map(|f| for_delaunator(f)).collect();
        let mut next = flat.iter().cycle();
        group.bench_function(BenchmarkId::new("delaunator", n), |b| {
            b.iter(|| delaunator::triangulate(next.next().unwrap()));
        });
        let mut next = floats.iter().cycle();
        group.bench_function(BenchmarkId::new("spade, insert", n), |b| {
            b.iter(|| inserted(next.next().unwrap()));
        });
        group.bench_function(BenchmarkId::new("spade, bulk_load of each level", n), |b| {
            let levels = || {
                let set = next.next().unwrap();
                prefixes(n).map(|l| set[..l].to_vec()).collect::<Vec<_>>()
            };
            let load =
                |levels: Vec<Vec<_>>| levels.into_iter().map(|f| Spade::bulk_load(f).unwrap()).collect::<Vec<_>>();
            b.iter_batched(levels, load, BatchSize::SmallInput);
        });
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
