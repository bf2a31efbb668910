//! Makes keygraphs: thick scalene triangles of keypoints, in canonical order.
//!
//! In: triples of points. Out: the triples whose angles are large enough and different enough, each
//! with its vertices in ascending order of angle and with the key that partitions them. The key
//! consists of the orientation of that order, the second-largest angle and the largest angle (M.
//! Hashimoto, R. Cesar, *A Keygraph Classification Framework for Real-Time Object Detection*,
//! section 3.2).
//!
//! Memory: 12 bytes a keygraph. Cost: three arc tangents a triple. Full: later triples are counted
//! as dropped. Triples of coarse levels come first.

use core::mem::swap;

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::geometry::{Circle, Point, orient};
use crate::base::math;
use crate::base::pace::Pace;
use crate::extract::delaunay::Triple;

/// Number of subsets of the partition. There are two orientations, 18 bins of 5 degrees for the
/// second-largest angle (below 90), and 24 for the largest (60 to 180). These are the paper's 2 x
/// 36 x 36 bins without the impossible ones.
pub const CELLS: usize = 2 * SECOND_BINS * LARGEST_BINS;
/// Number of bins of the second-largest angle.
pub const SECOND_BINS: usize = 18;
/// Number of bins of the largest angle.
pub const LARGEST_BINS: usize = 24;
/// Width of a bin, half-degrees.
pub const BIN: u8 = 10;

/// The rule that says which triples are keygraphs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scalene {
    /// Minimum angle, degrees. The angles of thin triangles are badly determined. The paper uses 5.
    pub min_angle_deg: f32,
    /// Minimum difference between two angles, degrees. Below it noise decides the order of the
    /// vertices. The paper uses 5.
    pub min_difference_deg: f32,
    /// Minimum length of a side, px. A pixel of noise turns a side of 10 px by up to 5.7 degrees.
    pub min_side_px: f32,
}

/// The key of the partition, in steps of half a degree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Key {
    /// Whether the vertices in ascending order of angle have negative orientation.
    pub mirrored: bool,
    /// Second-largest angle, half-degrees.
    pub second: u8,
    /// Largest angle minus 60 degrees, half-degrees.
    pub largest: u8,
}

impl Key {
    /// Returns the index of the subset that the key falls into, below [`CELLS`].
    #[must_use]
    pub fn cell(self) -> usize {
        cell_of(self.mirrored, self.second / BIN, self.largest / BIN)
    }
}

/// Returns the index of the subset of an orientation and two bins. Bins are clamped.
#[must_use]
pub fn cell_of(mirrored: bool, second_bin: u8, largest_bin: u8) -> usize {
    let second = usize::from(second_bin).min(SECOND_BINS - 1);
    let largest = usize::from(largest_bin).min(LARGEST_BINS - 1);
    (usize::from(mirrored) * SECOND_BINS + second) * LARGEST_BINS + largest
}

/// A triangle of keypoints in canonical order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Keygraph {
    /// Indices of the vertices, in ascending order of their angle.
    pub vertices: Triple,
    /// Key of the partition.
    pub key: Key,
    /// Length of the longest side as `16 log2(px)`, in the level in which the keygraph was found.
    pub size: u8,
    /// Length of the shortest side, px, saturating.
    pub shortest: u8,
    /// Pyramid level in which the vertices were found.
    pub level: u8,
}

impl Keygraph {
    /// Makes the keygraph on three points, whose ids are `ids`. Returns `None` when `rule` does not
    /// allow it.
    #[must_use]
    pub fn new(points: [Point; 3], ids: Triple, rule: &Scalene) -> Option<Self> {
        let side2 = |i: usize| points[(i + 1) % 3].distance2(points[(i + 2) % 3]);
        // Side i lies opposite to vertex i, so that vertices and sides have the same order.
        let sides = [side2(0), side2(1), side2(2)];
        let (mut s, mut m, mut l) = (0usize, 1, 2);
        // A sort of the library takes 2 KB of code for these three.
        if sides[s] > sides[m] {
            swap(&mut s, &mut m);
        }
        if sides[m] > sides[l] {
            swap(&mut m, &mut l);
        }
        if sides[s] > sides[m] {
            swap(&mut s, &mut m);
        }
        let px = |d: i64| math::inline_sqrt(d as f32) / 16.0;
        let shortest = px(sides[s]);
        if shortest < rule.min_side_px {
            return None;
        }
        let turn = orient(points[s], points[m], points[l]);
        let cross = turn.unsigned_abs() as f32;
        let dot = |i: usize| {
            let (a, b) = (sides[(i + 1) % 3], sides[(i + 2) % 3]);
            (a + b - sides[i]) as f32 / 2.0
        };
        let deg = |i: usize| math::coarse_atan2(cross, dot(i)) * (180.0 / core::f32::consts::PI);
        let (second, largest) = (deg(m), deg(l));
        let smallest = 180.0 - second - largest;
        if smallest < rule.min_angle_deg
            || second - smallest < rule.min_difference_deg
            || largest - second < rule.min_difference_deg
        {
            return None;
        }
        let half = |deg: f32, most: i32| u8::try_from(math::floor(deg * 2.0).clamp(0, most)).unwrap_or(0);
        Some(Self {
            vertices: [ids[s], ids[m], ids[l]],
            key: Key { mirrored: turn < 0, second: half(second, 179), largest: half(largest - 60.0, 239) },
            size: u8::try_from(math::round(math::log2(px(sides[l]).max(1.0)) * 16.0)).unwrap_or(u8::MAX),
            shortest: u8::try_from(math::floor(shortest)).unwrap_or(u8::MAX),
            level: 0,
        })
    }
}

/// Appends the keygraphs among `triples` to `out`. The triples are indices into `points`. The
/// vertices of a keygraph are numbered from `first` on, and it carries `level`.
pub fn collect_keygraphs(
    points: &[Point],
    triples: &[Triple],
    rule: &Scalene,
    first: u16,
    level: u8,
    out: &mut VecView<Keygraph>,
    pace: &mut dyn Pace,
) -> StageStats {
    let mut stats = StageStats::default();
    for &t in triples {
        if !pace.goes_on() {
            break;
        }
        stats.seen += 1;
        let Some(k) = Keygraph::new(t.map(|v| points[usize::from(v)]), t, rule) else { continue };
        let k = Keygraph { vertices: k.vertices.map(|v| v + first), level, ..k };
        match out.push(k) {
            Ok(()) => stats.kept += 1,
            Err(_) => stats.dropped += 1,
        }
    }
    stats
}

/// Maximum cost of a triple that is worth its bytes.
pub(crate) const MAX_COST: u32 = 15;
pub(crate) const COSTS: usize = MAX_COST as usize + 1;

/// Returns how unlikely it is that the triangulation of a frame contains the triple `[i, j, k]` of
/// `n` ranked points; `k` must be the largest index. Each point in the circumcircle of the triple
/// costs two when it is ranked before `k`, and one when it is ranked soon after
/// ([`crate::model::train`] says why). Counting stops above [`MAX_COST`]. Three points on a line
/// cost `u32::MAX`.
pub(crate) fn cost(point: impl Fn(usize) -> Point, n: usize, [i, j, k]: [usize; 3]) -> u32 {
    let (a, mut b, mut c) = (point(i), point(j), point(k));
    match orient(a, b, c) {
        0 => return u32::MAX,
        o if o < 0 => core::mem::swap(&mut b, &mut c),
        _ => {}
    }
    let circle = Circle::through(a, b, c);
    let mut cost = 0;
    for l in 0..n.min(2 * k + 1) {
        // The vertices themselves lie on the circle, not in it.
        if circle.holds(point(l)) {
            cost += if l < k { 2 } else { 1 };
            if cost > MAX_COST {
                break;
            }
        }
    }
    cost
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: Scalene = Scalene { min_angle_deg: 5.0, min_difference_deg: 5.0, min_side_px: 10.0 };

    fn at(p: [[i16; 2]; 3]) -> Option<Keygraph> {
        Keygraph::new(p.map(|[x, y]| Point::new(x * 16, y * 16)), [7, 8, 9], &RULE)
    }

    #[test]
    fn a_right_triangle_has_its_angles() {
        // A 3-4-5 triangle has 36.87, 53.13 and 90 degrees. The right angle lies at the first
        // point.
        let k = at([[10, 10], [50, 10], [10, 40]]).unwrap();
        assert_eq!(k.vertices, [8, 9, 7]);
        assert!(k.key.second.abs_diff(106) <= 1, "{:?}", k.key);
        assert!(k.key.largest.abs_diff(60) <= 1, "{:?}", k.key);
        assert_eq!(k.shortest, 30);
        assert_eq!(k.size, 90 /* 16 log2 50 */);
    }

    #[test]
    fn rotation_keeps_the_key_and_reflection_flips_it() {
        let k = at([[10, 10], [50, 10], [10, 40]]).unwrap();
        let turned = at([[50, 50], [50, 90], [20, 50]]).unwrap();
        assert_eq!((turned.key, turned.vertices), (k.key, k.vertices));
        let flipped = at([[50, 10], [10, 10], [50, 40]]).unwrap();
        assert_eq!(flipped.key, Key { mirrored: !k.key.mirrored, ..k.key });
        assert_eq!(flipped.vertices, k.vertices);
        assert_ne!(flipped.key.cell(), k.key.cell());
    }

    #[test]
    fn thin_small_and_isosceles_triangles_are_none() {
        assert_eq!(at([[0, 0], [100, 0], [50, 3]]), None, "thin");
        assert_eq!(at([[0, 0], [9, 0], [4, 20]]), None, "short side");
        assert_eq!(at([[0, 0], [40, 0], [20, 50]]), None, "isosceles");
        assert_eq!(at([[5, 5], [5, 5], [90, 9]]), None, "duplicate");
    }

    #[test]
    fn cells_cover_the_keys() {
        assert_eq!(Key { mirrored: true, second: 179, largest: 239 }.cell(), CELLS - 1);
        assert_eq!(Key::default().cell(), 0);
        assert_eq!(cell_of(true, 255, 255), CELLS - 1);
    }

    #[test]
    fn a_triple_costs_what_would_have_to_be_missed() {
        let p = |x, y| Point::new(x, y);
        let cost = |points: &[Point], triple| cost(|l| points[l], points.len(), triple);
        // In the order of rank: one far away, the triangle, one in its circle, one outside.
        let mut points = std::vec![p(900, 900), p(0, 0), p(160, 0), p(0, 160), p(60, 60), p(400, 10)];
        assert_eq!(cost(&points, [1, 2, 3]), 1, "a later corner lies inside");
        points.swap(0, 4);
        assert_eq!(cost(&points, [1, 2, 3]), 2, "an earlier corner lies inside");
        assert_eq!(cost(&points, [1, 3, 2]), cost(&points, [1, 2, 3]), "either orientation");
        assert!(cost(&[p(0, 0), p(5, 5), p(9, 9)], [0, 1, 2]) > MAX_COST, "a line");
        // Index 2 is the largest of the triple: only the two corners after it count.
        let mut many = std::vec![p(0, 0), p(160, 0), p(0, 160)];
        many.extend([p(50, 50); 10]);
        assert_eq!(cost(&many, [0, 1, 2]), 2);
    }
}
