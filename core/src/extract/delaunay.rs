//! Makes a Delaunay triangulation in fixed memory, with its nested levels.
//!
//! In: points in the order of their rank. Out: the triangles of the Delaunay triangulations of
//! several prefixes of that order ("levels"), each triangle once.
//!
//! Points are inserted one at a time (Bowyer, Watson, 1981). The algorithm walks to a triangle in
//! conflict with the point, removes all triangles whose open circumcircle holds the point, and
//! joins the rim of the hole to it. A ghost vertex closes the hull, so that the hull needs no cases
//! of its own. The predicates are exact, so that no input can break the algorithm. Each triangle
//! keeps the number of points that were inserted at its birth. This number says at which level it
//! is new.
//!
//! Memory: 46 bytes a point ([`Triangulation`]). Cost: a walk of some sqrt(n) steps and about six
//! new triangles a point. Full: points beyond the capacity are counted as dropped. Duplicates are
//! left out.

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::geometry::{Point, in_circle, orient};
use crate::base::pace::Pace;

/// Three indices into the points.
pub type Triple = [u16; 3];

/// The vertex at infinity.
const GHOST: u16 = u16::MAX;

/// One triangle. Edge `i` runs from `vertices[i]` to `vertices[(i + 1) % 3]`, and `neighbours[i]`
/// lies across it. Real triangles have positive orientation. In a ghost triangle the outside of the
/// hull lies on the positive side of its real edge.
#[derive(Clone, Copy, Debug)]
struct Triangle {
    vertices: [u16; 3],
    neighbours: [u16; 3],
    /// Number of points that were inserted when the triangle was made; 0 in an unused slot.
    born: u16,
}

impl Triangle {
    const EMPTY: Self = Self { vertices: [0; 3], neighbours: [0; 3], born: 0 };

    /// Returns the index of the ghost among the vertices. Returns `None` for a real triangle.
    fn ghost(&self) -> Option<usize> {
        self.vertices.iter().position(|&v| v == GHOST)
    }
}

/// Working memory for up to `N` points. Every triangulation of `n` points and the ghost has
/// `2 n - 2` triangles.
#[derive(Debug)]
pub struct Triangulation<const N: usize> {
    triangles: [[Triangle; 2]; N],
    /// Triangles in conflict with the point that is being inserted.
    conflicts: [[u16; 2]; N],
    /// Edges of the hole that these triangles leave: from, to, triangle outside.
    rim: [[[u16; 3]; 2]; N],
    /// For each vertex, the new triangle whose rim edge starts there.
    starts: [u16; N],
}

impl<const N: usize> Default for Triangulation<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Triangulation<N> {
    const FITS: () = assert!(N >= 3 && N <= 16_000, "ids are u16: lower N");

    /// Makes an empty triangulation.
    #[must_use]
    pub const fn new() -> Self {
        let () = Self::FITS;
        Self { triangles: [[Triangle::EMPTY; 2]; N], conflicts: [[0; 2]; N], rim: [[[0; 3]; 2]; N], starts: [0; N] }
    }

    /// Returns the memory in the form that the stage functions take.
    pub fn workspace(&mut self) -> Workspace<'_> {
        Workspace {
            triangles: self.triangles.as_flattened_mut(),
            conflicts: self.conflicts.as_flattened_mut(),
            rim: self.rim.as_flattened_mut(),
            starts: &mut self.starts,
            ghost_start: 0,
        }
    }
}

/// A borrowed [`Triangulation`] without its const generic.
#[derive(Debug)]
pub struct Workspace<'a> {
    triangles: &'a mut [Triangle],
    conflicts: &'a mut [u16],
    rim: &'a mut [[u16; 3]],
    starts: &'a mut [u16],
    ghost_start: u16,
}

impl Workspace<'_> {
    /// Returns the maximum number of points.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.starts.len()
    }

    /// Returns the workspace for one call of [`triangulate`].
    pub fn reborrow(&mut self) -> Workspace<'_> {
        let Self { triangles, conflicts, rim, starts, ghost_start } = self;
        Workspace { triangles, conflicts, rim, starts, ghost_start: *ghost_start }
    }
}

/// Triangulates prefixes of `points` and appends to `out` every triangle that is Delaunay in one of
/// them. Each triangle is appended once, with its indices in positive orientation.
///
/// `levels` are the lengths of the prefixes in ascending order. A length beyond the number of
/// points stands for all points. `seen` in the statistics counts triangles.
pub fn triangulate(
    points: &[Point],
    levels: &[usize],
    work: Workspace<'_>,
    out: &mut VecView<Triple>,
    pace: &mut dyn Pace,
) -> StageStats {
    let mut stats = StageStats::default();
    let capacity = work.capacity();
    if points.len() > capacity {
        stats.dropped += u32::try_from(points.len() - capacity).unwrap_or(u32::MAX);
    }
    let points = &points[..points.len().min(capacity)];
    let Some((second, third)) = first_triangle(points) else { return stats };
    let mut mesh = Mesh { points, work, used: 0, inserted: 0, last: 0 };
    mesh.start([0, second, third]);
    let mut emitted = 0;
    let mut previous = 0;
    for &level in levels {
        let level = level.min(points.len());
        for i in previous..level {
            if !pace.goes_on() {
                return stats;
            }
            // The third vertex of the first triangle may come late in the order. By then it is in
            // the mesh, and inserting it again changes nothing.
            if i != 0 && i != usize::from(second) && i != usize::from(third) {
                mesh.insert(i);
            }
        }
        if level <= previous || level <= usize::from(third) {
            continue;
        }
        previous = level;
        for t in &mesh.work.triangles[..mesh.used] {
            if t.born > emitted && t.ghost().is_none() {
                stats.seen += 1;
                match out.push(t.vertices) {
                    Ok(()) => stats.kept += 1,
                    Err(_) => stats.dropped += 1,
                }
            }
        }
        emitted = mesh.inserted;
    }
    stats
}

/// Returns the index of the first point that differs from point 0, and the index of the first point
/// off the line through these two. Returns `None` when all points lie on one line.
fn first_triangle(points: &[Point]) -> Option<(u16, u16)> {
    let first = *points.first()?;
    let second = points.iter().position(|&p| p != first)?;
    let third = points.iter().position(|&p| orient(first, points[second], p) != 0)?;
    Some((u16::try_from(second).ok()?, u16::try_from(third).ok()?))
}

struct Mesh<'a> {
    points: &'a [Point],
    work: Workspace<'a>,
    used: usize,
    inserted: u16,
    /// A triangle near the last insertion, where the next walk starts.
    last: usize,
}

impl Mesh<'_> {
    fn at(&self, v: u16) -> Point {
        self.points[usize::from(v)]
    }

    /// Makes one real triangle and the three ghost triangles around it.
    fn start(&mut self, [a, b, c]: Triple) {
        let [a, b, c] = if orient(self.at(a), self.at(b), self.at(c)) > 0 { [a, b, c] } else { [a, c, b] };
        self.inserted = 3;
        let t = |vertices, neighbours| Triangle { vertices, neighbours, born: 3 };
        self.work.triangles[0] = t([a, b, c], [1, 2, 3]);
        self.work.triangles[1] = t([b, a, GHOST], [0, 3, 2]);
        self.work.triangles[2] = t([c, b, GHOST], [0, 1, 3]);
        self.work.triangles[3] = t([a, c, GHOST], [0, 2, 1]);
        self.used = 4;
        self.last = 0;
    }

    /// Returns whether the open circumcircle of triangle `t` holds `p`. The circumcircle of a ghost
    /// triangle is the open half-plane beyond its edge together with the open edge.
    fn conflicts(&self, t: usize, p: Point) -> bool {
        let v = self.work.triangles[t].vertices;
        match self.work.triangles[t].ghost() {
            None => in_circle(self.at(v[0]), self.at(v[1]), self.at(v[2]), p) > 0,
            Some(g) => {
                let (a, b) = (self.at(v[(g + 1) % 3]), self.at(v[(g + 2) % 3]));
                match orient(a, b, p) {
                    0 => p != a && p != b && (a.min(b)..=a.max(b)).contains(&p),
                    side => side > 0,
                }
            }
        }
    }

    /// Walks towards `p` and returns a triangle in conflict with it. Returns `None` when `p` is
    /// already a vertex.
    fn locate(&self, p: Point) -> Option<usize> {
        let mut t = self.last;
        'walk: loop {
            let tri = &self.work.triangles[t];
            if let Some(g) = tri.ghost() {
                let (a, b) = (tri.vertices[(g + 1) % 3], tri.vertices[(g + 2) % 3]);
                if orient(self.at(a), self.at(b), p) > 0 {
                    return Some(t);
                }
                t = usize::from(tri.neighbours[(g + 1) % 3]);
                continue;
            }
            for i in 0..3 {
                let (a, b) = (tri.vertices[i], tri.vertices[(i + 1) % 3]);
                if orient(self.at(a), self.at(b), p) < 0 {
                    t = usize::from(tri.neighbours[i]);
                    continue 'walk;
                }
            }
            let known = tri.vertices.iter().any(|&v| self.at(v) == p);
            return (!known).then_some(t);
        }
    }

    fn insert(&mut self, i: usize) {
        let p = self.points[i];
        let Some(seed) = self.locate(p) else { return };
        let Ok(id) = u16::try_from(i) else { return };
        self.inserted += 1;

        // The hole consists of all triangles in conflict. They are found from the first one through
        // their neighbours. `born` is 0 while a triangle is marked for removal.
        self.work.conflicts[0] = index(seed);
        self.work.triangles[seed].born = 0;
        let (mut n, mut next) = (1, 0);
        while next < n {
            let t = usize::from(self.work.conflicts[next]);
            next += 1;
            for o in self.work.triangles[t].neighbours {
                let o = usize::from(o);
                if self.work.triangles[o].born != 0 && self.conflicts(o, p) {
                    self.work.triangles[o].born = 0;
                    self.work.conflicts[n] = index(o);
                    n += 1;
                }
            }
        }

        // The rim is read before any slot is used again.
        let mut edges = 0;
        for k in 0..n {
            let t = &self.work.triangles[usize::from(self.work.conflicts[k])];
            for e in 0..3 {
                if self.work.triangles[usize::from(t.neighbours[e])].born != 0 {
                    self.work.rim[edges] = [t.vertices[e], t.vertices[(e + 1) % 3], t.neighbours[e]];
                    edges += 1;
                }
            }
        }
        debug_assert_eq!(edges, n + 2, "the hole is a disc");

        // A new triangle joins each rim edge to p. These use the slots of the hole and two more.
        let slot = |k: usize, work: &Workspace<'_>| if k < n { work.conflicts[k] } else { index(self.used + k - n) };
        for k in 0..edges {
            let [a, b, outer] = self.work.rim[k];
            let t = slot(k, &self.work);
            self.work.triangles[usize::from(t)] =
                Triangle { vertices: [a, b, id], neighbours: [outer, 0, 0], born: self.inserted };
            let o = &mut self.work.triangles[usize::from(outer)];
            for e in 0..3 {
                if o.vertices[e] == b && o.vertices[(e + 1) % 3] == a {
                    o.neighbours[e] = t;
                }
            }
            *start_of(&mut self.work, a) = t;
        }
        // The neighbours around p are linked: across (b, p) lies the triangle that starts at b.
        for k in 0..edges {
            let [_, b, _] = self.work.rim[k];
            let t = slot(k, &self.work);
            let next = *start_of(&mut self.work, b);
            self.work.triangles[usize::from(t)].neighbours[1] = next;
            self.work.triangles[usize::from(next)].neighbours[2] = t;
        }
        self.last = usize::from(slot(0, &self.work));
        self.used += 2;
    }
}

/// Returns the place that notes the new triangle whose rim edge starts at `v`.
fn start_of<'a>(work: &'a mut Workspace<'_>, v: u16) -> &'a mut u16 {
    if v == GHOST { &mut work.ghost_start } else { &mut work.starts[usize::from(v)] }
}

fn index(t: usize) -> u16 {
    u16::try_from(t).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use heapless::Vec;
    use std::prelude::rust_2024::*;

    /// Returns the points of a map. The digits in the map are the ranks of the points.
    fn points(map: &[&str]) -> std::vec::Vec<Point> {
        let mut found: std::vec::Vec<(u8, Point)> = std::vec::Vec::new();
        for (y, row) in map.iter().enumerate() {
            for (x, c) in row.bytes().enumerate() {
                if c.is_ascii_alphanumeric() {
                    found.push((c, Point::new(x as i16, y as i16)));
                }
            }
        }
        found.sort();
        found.into_iter().map(|(_, p)| p).collect()
    }

    fn triangles(map: &[&str], levels: &[usize]) -> (String, StageStats) {
        let mut mesh: Triangulation<16> = Triangulation::new();
        let mut out: Vec<Triple, 64> = Vec::new();
        let stats = triangulate(&points(map), levels, mesh.workspace(), &mut out, &mut Steady);
        let mut names: std::vec::Vec<String> = out
            .iter()
            .map(|t| {
                let mut n: std::vec::Vec<u16> = t.to_vec();
                n.sort_unstable();
                n.iter().map(u16::to_string).collect::<String>()
            })
            .collect();
        names.sort();
        (names.join(" "), stats)
    }

    #[test]
    fn a_kite_is_cut_along_its_short_diagonal() {
        let map = [
            ".....0.....", //
            "...........",
            "1.........2",
            "...........",
            ".....3.....",
        ];
        assert_eq!(triangles(&map, &[4]).0, "013 023");
    }

    #[test]
    fn a_point_inside_and_one_on_an_edge() {
        let map = [
            "0.........1", //
            "...........",
            "....3......",
            "...........",
            "...........",
            "2..........",
        ];
        assert_eq!(triangles(&map, &[9]).0, "013 023 123");
        let map = [
            "0....3....1", //
            "...........",
            "...........",
            "2..........",
        ];
        assert_eq!(triangles(&map, &[9]).0, "023 123");
    }

    #[test]
    fn levels_give_each_triangle_once() {
        let map = [
            "0........1", //
            "..........",
            "....4.....",
            "..........",
            "2........3",
        ];
        let (all, stats) = triangles(&map, &[3, 5]);
        assert_eq!(all, "012 014 024 134 234");
        assert_eq!((stats.seen, stats.kept, stats.dropped), (5, 5, 0));
    }

    #[test]
    fn lines_and_duplicates_give_no_triangles() {
        assert_eq!(triangles(&["0.1.2.3"], &[2, 4]).0, "");
        assert_eq!(triangles(&["0"], &[1]).0, "");
        assert_eq!(triangles(&[""], &[25]).0, "");
        let same = [Point::new(3, 3); 8];
        let mut mesh: Triangulation<8> = Triangulation::new();
        let mut out: Vec<Triple, 4> = Vec::new();
        assert_eq!(triangulate(&same, &[8], mesh.workspace(), &mut out, &mut Steady), StageStats::default());
    }

    #[test]
    fn collinear_first_then_a_point_aside() {
        assert_eq!(triangles(&["0.1.2", ".....", "..3.."], &[4]).0, "013 123");
        assert_eq!(triangles(&["2.0.1", ".....", "..3.."], &[3, 4]).0, "013 023");
    }

    #[test]
    fn beyond_the_capacity_points_and_triangles_are_counted() {
        let grid: std::vec::Vec<Point> = (0..25).map(|i| Point::new(i % 5 * 16, i / 5 * 16 + i % 3)).collect();
        let mut mesh: Triangulation<10> = Triangulation::new();
        let mut out: Vec<Triple, 4> = Vec::new();
        let stats = triangulate(&grid, &[25], mesh.workspace(), &mut out, &mut Steady);
        assert_eq!(out.len(), 4);
        assert_eq!(stats.kept, 4);
        assert_eq!(stats.dropped, 15 + stats.seen - 4);
    }
}
