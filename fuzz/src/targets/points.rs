//! any points. Their triangulation must be a Delaunay triangulation.
//!
//! In: two level lengths, whether the points stay in the range of corners, points. Out: nothing.
//! For points in that range the target checks that every triangle turns the right way, that no
//! point lies inside its circumcircle, and that the triangles cover the hull. Cost: proportional to
//! triangles times points.

use crate::Input;
use keygraph_core::heapless::Vec as Fixed;
use keygraph_core::stages::delaunay::{Triangulation, Triple, triangulate};
use keygraph_core::stages::geometry::{Point, in_circle, orient};
use keygraph_core::stages::pace::Steady;

const MOST: usize = 120;

fn triangles(points: &[Point], levels: &[usize]) -> Fixed<Triple, 1024> {
    let mut mesh: Triangulation<MOST> = Triangulation::new();
    let mut out = Fixed::new();
    let stats = triangulate(points, levels, mesh.workspace(), &mut out, &mut Steady);
    assert_eq!(stats.kept as usize, out.len());
    assert!(out.iter().flatten().all(|&v| usize::from(v) < points.len().min(MOST)), "{out:?}");
    out
}

/// Returns twice the area of the convex hull (A. Andrew's monotone chain, 1979).
fn hull_area2(points: &[Point]) -> i64 {
    let mut sorted = points.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    let mut area2 = 0;
    let reversed: Vec<Point> = sorted.iter().rev().copied().collect();
    for run in [&sorted, &reversed] {
        let mut chain: Vec<Point> = Vec::new();
        for &p in run {
            while let [.., a, b] = chain[..] {
                if orient(a, b, p) > 0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        let origin = Point::new(0, 0);
        area2 += chain.windows(2).map(|e| orient(origin, e[0], e[1])).sum::<i64>();
    }
    area2
}

/// Runs the target on one input.
pub fn points(data: &[u8]) {
    let mut input = Input(data);
    let levels = [usize::from(input.byte()), usize::from(input.byte())];
    let mask = match input.byte() % 4 {
        // No corner has such coordinates. The triangulation must end nevertheless.
        0 => !0,
        1 => 0x7fff,
        2 => 0x00ff,
        _ => 0x0007,
    };
    let n = (input.0.len() / 4).min(MOST + 8);
    let points: Vec<Point> =
        (0..n).map(|_| Point::new((input.word() & mask).cast_signed(), (input.word() & mask).cast_signed())).collect();
    let _ = triangles(&points, &levels);
    if mask == !0 {
        return;
    }
    let all = triangles(&points, &[points.len()]);
    let known = &points[..points.len().min(MOST)];
    let mut covered2 = 0;
    for t in &all {
        let [a, b, c] = t.map(|v| known[usize::from(v)]);
        assert!(orient(a, b, c) > 0, "{t:?} is turned over");
        covered2 += orient(a, b, c);
        assert!(known.iter().all(|&p| in_circle(a, b, c, p) <= 0), "{t:?} holds a point");
    }
    assert_eq!(covered2, hull_area2(known), "the triangles cover the hull once");
}
