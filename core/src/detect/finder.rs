//! Where the triangles of a frame come from: our corners, or other keypoints and triples.
//!
//! In: luma of a level; its keypoints. Out: keypoints; triples of them. Memory: rows for the
//! corners, and a triangulation. Cost: that of the stages `corners` and `delaunay`. Full:
//! both count what they dropped.

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::geometry::Point;
use crate::extract::corners::{Corner, detect_corners};
use crate::extract::delaunay::{Triple, Workspace, triangulate};
use crate::extract::rank::rank;
use crate::image::pyramid::Plane;
use crate::model::method::Parameters;

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

/// Finder of Shi-Tomasi corners and nested Delaunay triangles, in borrowed memory.
pub(crate) struct Corners<'a> {
    pub(crate) rules: &'static Parameters,
    /// [`SCRATCH_ROWS`](crate::extract::corners::SCRATCH_ROWS) rows of the longest side.
    pub(crate) scratch: &'a mut [f32],
    pub(crate) mesh: Workspace<'a>,
}

impl Finder for Corners<'_> {
    fn keypoints(&mut self, luma: Plane<'_, u8>, level: usize, out: &mut VecView<Corner>) -> StageStats {
        let Self { rules, scratch, mesh } = self;
        let limit = rules.corner_limits[level].min(mesh.capacity());
        if limit == 0 {
            return StageStats::default();
        }
        let mut stats = detect_corners(luma, &rules.corners, scratch, out);
        rank(rules.ranking, out, limit, scratch, &mut stats);
        stats
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>) -> StageStats {
        triangulate(points, self.rules.prefixes, self.mesh.reborrow(), out)
    }
}
