//! Where the triangles of a frame come from: our corners, or other keypoints and triples.
//!
//! In: luma of a level; its keypoints. Out: keypoints; triples of them. Memory: rows for the
//! corners, and a triangulation. Cost: that of the stages `corners` and `delaunay`. Full:
//! both count what they dropped.

use heapless::VecView;

use crate::capacity::StageStats;
use crate::corners::{Corner, SCRATCH_ROWS, detect_corners};
use crate::delaunay::{Triangulation, Triple, triangulate};
use crate::geometry::Point;
use crate::method::{Parameters, Ranking};
use crate::pyramid::Plane;
use crate::rank::{rank_by_radius, rank_by_strength};

/// Where keypoints and triples of a frame come from: the framework is open to
/// others than our corners and their triangulation. The levels above the finest are asked
/// for first, the finest only where they leave doubts.
pub trait Finder {
    /// Appends the keypoints of pyramid level `level` to `out`, which is empty, in
    /// px of that level: the best first, since what does not fit is lost.
    fn keypoints(&mut self, luma: Plane<'_, u8>, level: usize, out: &mut VecView<Corner>) -> StageStats;

    /// Appends triples of indices into `points` (best first) to `out`, which is
    /// empty and holds `KEYGRAPHS` of them; so many keygraphs are kept in all.
    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>) -> StageStats;
}

/// Finder of Shi-Tomasi corners and nested Delaunay triangles.
#[derive(Debug)]
pub(crate) struct Corners<const SIDE: usize, const POINTS: usize> {
    scratch: [[f32; SIDE]; SCRATCH_ROWS],
    mesh: Triangulation<POINTS>,
    rules: Option<&'static Parameters>,
}

impl<const SIDE: usize, const POINTS: usize> Corners<SIDE, POINTS> {
    pub(crate) const fn new() -> Self {
        Self { scratch: [[0.0; SIDE]; SCRATCH_ROWS], mesh: Triangulation::new(), rules: None }
    }

    /// Sets the limits of the search that follows; it finds nothing without.
    pub(crate) const fn set_rules(&mut self, rules: &'static Parameters) {
        self.rules = Some(rules);
    }
}

impl<const SIDE: usize, const POINTS: usize> Finder for Corners<SIDE, POINTS> {
    fn keypoints(&mut self, luma: Plane<'_, u8>, level: usize, out: &mut VecView<Corner>) -> StageStats {
        let Some(rules) = self.rules else { return StageStats::default() };
        let limit = rules.corner_limits[level].min(POINTS);
        if limit == 0 {
            return StageStats::default();
        }
        let scratch = self.scratch.as_flattened_mut();
        let mut stats = detect_corners(luma, &rules.corners, scratch, out);
        match rules.ranking {
            Ranking::Radius => rank_by_radius(out, limit, scratch, &mut stats),
            Ranking::Strength(apart) => rank_by_strength(out, apart, limit, &mut stats),
        }
        stats
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>) -> StageStats {
        let prefixes = self.rules.map_or(&[][..], |r| r.prefixes);
        triangulate(points, prefixes, self.mesh.workspace(), out)
    }
}
