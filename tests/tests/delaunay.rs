//! Compares the fixed-capacity triangulation with spade, and checks the properties that every
//! Delaunay triangulation has.
//!
//! Where the triangulation is unique, the triangles must be those of spade. Where four points share
//! an empty circle, several triangulations are right. Then the triangles must have empty circles,
//! cover the hull once, and be as many as Euler's formula says.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::collections::{BTreeMap, BTreeSet};

use heapless::Vec as FixedVec;
use keygraph_core::StageStats;
use keygraph_core::stages::delaunay::{Triangulation, Triple, triangulate};
use keygraph_core::stages::geometry::{Point, in_circle, orient};
use keygraph_core::stages::pace::Steady;
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestCaseResult};
use spade::{DelaunayTriangulation, Point2, Triangulation as _};

/// Number of points that the triangulation under test has room for.
const CAPACITY: usize = 64;

/// Runs the triangulation under test, with room for every triangle.
fn ours(points: &[Point], levels: &[usize]) -> (Vec<Triple>, StageStats) {
    let mut mesh: Triangulation<CAPACITY> = Triangulation::new();
    let mut out: FixedVec<Triple, 4096> = FixedVec::new();
    let stats = triangulate(points, levels, mesh.workspace(), &mut out, &mut Steady);
    (out.to_vec(), stats)
}

/// Rotates a triangle so that its smallest index comes first. The orientation stays the same.
fn turned([a, b, c]: Triple) -> Triple {
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
}

/// Returns the first index of each position.
fn firsts(points: &[Point]) -> BTreeMap<Point, u16> {
    let mut map = BTreeMap::new();
    for (i, &p) in points.iter().enumerate() {
        map.entry(p).or_insert(i as u16);
    }
    map
}

/// Returns spade's triangles of `points` with positive orientation, and whether the triangulation is unique.
fn oracle(points: &[Point]) -> (BTreeSet<Triple>, bool) {
    let mut mesh: DelaunayTriangulation<Point2<f64>> = DelaunayTriangulation::new();
    for p in points {
        mesh.insert(Point2::new(f64::from(p.x), f64::from(p.y))).unwrap();
    }
    let index = firsts(points);
    let triangles: BTreeSet<Triple> = mesh
        .inner_faces()
        .map(|f| {
            let [a, b, c] = f.positions().map(|p| index[&Point::new(p.x as i16, p.y as i16)]);
            let turn = orient(points[usize::from(a)], points[usize::from(b)], points[usize::from(c)]);
            turned(if turn > 0 { [a, b, c] } else { [a, c, b] })
        })
        .collect();
    // The triangulation is unique if no edge between two triangles could be flipped.
    let mut apex = BTreeMap::new();
    for &[a, b, c] in &triangles {
        for (from, to, far) in [(a, b, c), (b, c, a), (c, a, b)] {
            apex.insert((from, to), far);
        }
    }
    let at = |v: u16| points[usize::from(v)];
    let unique = apex.iter().all(|(&(from, to), &far)| {
        apex.get(&(to, from)).is_none_or(|&beyond| in_circle(at(from), at(to), at(far), at(beyond)) != 0)
    });
    (triangles, unique)
}

/// Returns the points on the hull in order around it: its corners and the points on its edges. If
/// all points lie on one line, returns the points of that line.
fn hull(points: &[Point]) -> Vec<Point> {
    let sorted: Vec<Point> = firsts(points).into_keys().collect();
    let chain = |points: &mut dyn Iterator<Item = Point>| {
        let mut chain: Vec<Point> = Vec::new();
        for p in points {
            while chain.len() > 1 && orient(chain[chain.len() - 2], chain[chain.len() - 1], p) < 0 {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut around = chain(&mut sorted.iter().copied());
    around.extend(chain(&mut sorted.iter().rev().copied()));
    around
}

fn is_flat(points: &[Point]) -> bool {
    let Some(&first) = points.first() else { return true };
    let Some(&second) = points.iter().find(|&&p| p != first) else { return true };
    points.iter().all(|&p| orient(first, second, p) == 0)
}

/// Checks the properties of one triangulation of all `points`.
fn check_is_delaunay(points: &[Point], triangles: &[Triple]) -> TestCaseResult {
    if is_flat(points) {
        prop_assert!(triangles.is_empty(), "points on a line have no triangles, not {triangles:?}");
        return Ok(());
    }
    let at = |v: u16| points[usize::from(v)];
    let mut edges = BTreeSet::new();
    let mut area = 0;
    for &[a, b, c] in triangles {
        let turn = orient(at(a), at(b), at(c));
        prop_assert!(turn > 0, "triangle {a} {b} {c} turns {turn}");
        area += turn;
        for (i, &p) in points.iter().enumerate() {
            prop_assert!(in_circle(at(a), at(b), at(c), p) <= 0, "point {i} lies in the circle of {a} {b} {c}");
        }
        for e in [(a, b), (b, c), (c, a)] {
            prop_assert!(edges.insert(e), "edge {e:?} belongs to two triangles on one side");
        }
    }
    let hull = hull(points);
    let distinct = firsts(points).len();
    prop_assert_eq!(
        triangles.len(),
        2 * distinct - 2 - hull.len(),
        "triangles of {} points, {} on the hull",
        distinct,
        hull.len()
    );
    let twice_hull: i64 = (0..hull.len()).map(|i| orient(hull[0], hull[i], hull[(i + 1) % hull.len()])).sum();
    prop_assert_eq!(area, twice_hull, "twice the area: of the triangles, of the hull");
    let open = edges.iter().filter(|&&(a, b)| !edges.contains(&(b, a))).count();
    prop_assert_eq!(open, hull.len(), "edges with a triangle on one side only");
    Ok(())
}

/// Runs all checks on one point set.
fn check(points: &[Point]) -> TestCaseResult {
    let inside = &points[..points.len().min(CAPACITY)];
    let over = points.len() - inside.len();
    let (triangles, stats) = ours(points, &[points.len()]);
    prop_assert_eq!(
        (stats.seen as usize, stats.kept as usize, stats.dropped as usize),
        (triangles.len(), triangles.len(), over),
        "seen, kept, dropped"
    );
    check_is_delaunay(inside, &triangles)?;
    let (golden, unique) = oracle(inside);
    prop_assert_eq!(triangles.len(), golden.len(), "number of triangles, ours and spade's");
    if unique {
        let ours: BTreeSet<Triple> = triangles.iter().copied().map(turned).collect();
        let differ: Vec<_> = ours.symmetric_difference(&golden).collect();
        prop_assert!(differ.is_empty(), "triangles of only one of the two: {differ:?}");
    }
    Ok(())
}

fn check_levels(points: &[Point], levels: &[usize]) -> TestCaseResult {
    let (triangles, stats) = ours(points, levels);
    prop_assert_eq!((stats.seen, stats.kept), (triangles.len() as u32, triangles.len() as u32));
    let union: BTreeSet<Triple> = triangles.iter().copied().map(turned).collect();
    prop_assert_eq!(union.len(), triangles.len(), "a triangle came twice");

    let inside = &points[..points.len().min(CAPACITY)];
    let prefixes: Vec<&[Point]> = levels.iter().map(|&l| &inside[..l.min(inside.len())]).collect();
    let mut golden = BTreeSet::new();
    let mut all_unique = true;
    for prefix in &prefixes {
        let (triangles, unique) = oracle(prefix);
        golden.extend(triangles);
        all_unique &= unique;
    }
    if all_unique {
        let differ: Vec<_> = union.symmetric_difference(&golden).collect();
        prop_assert!(differ.is_empty(), "triangles of only one of the two: {differ:?}");
        return Ok(());
    }
    // Otherwise each triangle must be Delaunay in at least one prefix that holds it.
    for t in &union {
        let [a, b, c] = t.map(|v| inside[usize::from(v)]);
        let right = |prefix: &&[Point]| {
            usize::from(*t.iter().max().unwrap()) < prefix.len() && prefix.iter().all(|&p| in_circle(a, b, c, p) <= 0)
        };
        prop_assert!(prefixes.iter().any(right), "{t:?} is Delaunay in no prefix");
    }
    Ok(())
}

fn point(range: std::ops::RangeInclusive<i16>) -> impl Strategy<Value = Point> + Clone {
    (range.clone(), range).prop_map(|(x, y)| Point::new(x, y))
}

fn most() -> std::ops::Range<usize> {
    0..CAPACITY + 12
}

/// Generates points over the whole range of coordinates.
fn random() -> impl Strategy<Value = Vec<Point>> {
    prop::collection::vec(point(0..=i16::MAX), most())
}

/// Generates points in a square so small that points repeat and circles are shared.
fn crowded() -> impl Strategy<Value = Vec<Point>> {
    prop::collection::vec(point(0..=9), most())
}

/// Generates points on one line, and up to two points beside it.
fn collinear() -> impl Strategy<Value = Vec<Point>> {
    let step = (0i16..=40, 0i16..=40);
    let aside = prop::collection::vec(point(0..=8000), 0..3);
    (point(0..=900), step, prop::collection::vec(0i16..170, most()), aside, any::<prop::sample::Index>()).prop_map(
        |(from, (dx, dy), places, aside, at)| {
            let mut points: Vec<Point> = places.iter().map(|k| Point::new(from.x + k * dx, from.y + k * dy)).collect();
            for p in aside {
                points.insert(at.index(points.len() + 1), p);
            }
            points
        },
    )
}

/// Generates points on one circle, and other points around it. A circle of radius 65 has 36 points
/// with integer coordinates.
fn cocircular() -> impl Strategy<Value = Vec<Point>> {
    let circle: Vec<(i16, i16)> = (-65i16..=65)
        .flat_map(|x| (-65i16..=65).map(move |y| (x, y)))
        .filter(|(x, y)| x * x + y * y == 65 * 65)
        .collect();
    let on = (prop::sample::subsequence(circle, 3..=36).prop_shuffle(), 1i16..=120);
    (on, prop::collection::vec(point(0..=16_000), 0..30), any::<bool>()).prop_map(|((circle, scale), others, first)| {
        let on = circle.iter().map(|(x, y)| Point::new(8000 + x * scale, 8000 + y * scale));
        let (a, b): (Vec<_>, Vec<_>) = if first { (on.collect(), others) } else { (others, on.collect()) };
        [a, b].concat()
    })
}

/// Generates few positions, each of them several times.
fn duplicates() -> impl Strategy<Value = Vec<Point>> {
    prop::collection::vec(point(0..=10_240), 1..12)
        .prop_flat_map(|places| prop::collection::vec(prop::sample::select(places), most()))
}

/// Generates a part of a regular grid, in any order.
fn grid() -> impl Strategy<Value = Vec<Point>> {
    (1i16..=9, 1i16..=9, 1i16..=900, 1i16..=900).prop_flat_map(|(columns, rows, dx, dy)| {
        let all: Vec<Point> = (0..columns * rows).map(|i| Point::new(i % columns * dx, i / columns * dy)).collect();
        let n = all.len();
        prop::sample::subsequence(all, 0..=n).prop_shuffle()
    })
}

/// Generates dense clusters that lie far apart.
fn clusters() -> impl Strategy<Value = Vec<Point>> {
    let middles = prop::collection::vec(point(40..=i16::MAX - 40), 1..5);
    middles.prop_flat_map(|middles| {
        let one = (prop::sample::select(middles), -12i16..=12, -12i16..=12);
        prop::collection::vec(one.prop_map(|(m, x, y)| Point::new(m.x + x, m.y + y)), most())
    })
}

fn levels() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(0..CAPACITY + 20, 1..6).prop_map(|mut l| {
        l.sort_unstable();
        l
    })
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: 300, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn random_points(points in random()) {
        check(&points)?;
    }

    #[test]
    fn crowded_points(points in crowded()) {
        check(&points)?;
    }

    #[test]
    fn points_on_a_line(points in collinear()) {
        check(&points)?;
    }

    #[test]
    fn points_on_a_circle(points in cocircular()) {
        check(&points)?;
    }

    #[test]
    fn repeated_points(points in duplicates()) {
        check(&points)?;
    }

    #[test]
    fn grid_points(points in grid()) {
        check(&points)?;
    }

    #[test]
    fn clustered_points(points in clusters()) {
        check(&points)?;
    }

    #[test]
    fn levels_are_the_union_of_their_prefixes(points in random(), levels in levels()) {
        check_levels(&points, &levels)?;
    }

    #[test]
    fn levels_of_degenerate_points(
        points in prop_oneof![crowded(), collinear(), cocircular(), duplicates(), grid(), clusters()],
        levels in levels(),
    ) {
        check_levels(&points, &levels)?;
    }

    #[test]
    fn a_full_output_keeps_the_first_triangles(points in prop_oneof![random(), grid(), crowded()], levels in levels()) {
        let (all, _) = ours(&points, &levels);
        let mut mesh: Triangulation<CAPACITY> = Triangulation::new();
        let mut out: FixedVec<Triple, 7> = FixedVec::new();
        let stats = triangulate(&points, &levels, mesh.workspace(), &mut out, &mut Steady);
        prop_assert_eq!(&out[..], &all[..all.len().min(7)]);
        let over = points.len().saturating_sub(CAPACITY);
        prop_assert_eq!(
            stats,
            StageStats { seen: all.len() as u32, kept: out.len() as u32, dropped: (over + all.len() - out.len()) as u32 }
        );
    }

    #[test]
    fn the_memory_can_be_used_again(first in crowded(), second in random()) {
        let mut mesh: Triangulation<CAPACITY> = Triangulation::new();
        let mut out: FixedVec<Triple, 4096> = FixedVec::new();
        triangulate(&first, &[first.len()], mesh.workspace(), &mut out, &mut Steady);
        out.clear();
        triangulate(&second, &[second.len()], mesh.workspace(), &mut out, &mut Steady);
        prop_assert_eq!(&out[..], &ours(&second, &[second.len()]).0[..]);
    }
}

#[test]
fn random_points_have_one_right_answer() {
    // Without this property the comparison with spade would test nothing.
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 17) as i16
    };
    let points: Vec<Point> = (0..CAPACITY).map(|_| Point::new(next(), next())).collect();
    let (triangles, unique) = oracle(&points);
    assert!(unique && triangles.len() > CAPACITY, "{} triangles", triangles.len());
}

#[test]
fn exactly_full_and_one_over() {
    let place = |i: usize| Point::new((i * 7919 % 20_011) as i16, (i * 104_729 % 19_997) as i16);
    let points: Vec<Point> = (0..=CAPACITY).map(place).collect();
    let (full, stats) = ours(&points[..CAPACITY], &[CAPACITY]);
    assert_eq!(stats.dropped, 0);
    let (over, stats) = ours(&points, &[CAPACITY + 1]);
    assert_eq!((over, stats.dropped), (full, 1));
}
