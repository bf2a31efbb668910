//! Source of the triangles of a frame: our corners, or other keypoints and triples.
//!
//! In: luma of a level, and later the keypoints of this level. Out: keypoints, and triples of them.
//! Memory: rows for the corners, and a triangulation. Cost: that of the stages `corners` and
//! `delaunay`. Full: both stages count what they dropped.

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::geometry::Point;
use crate::base::pace::Pace;
use crate::extract::corners::{Corner, detect_corners};
use crate::extract::delaunay::{Triple, Workspace, triangulate};
use crate::extract::rank::rank;
use crate::image::plane::Plane;
use crate::model::method::Parameters;

/// Finds keypoints and triples in a frame. An implementation can replace our corners and their
/// triangulation. The search asks for the levels above the finest first. It asks for the finest
/// level only when the other levels leave doubts. In a crowd it asks again for each tile of the frame
/// ([`Depth`](crate::Depth)): who can only give keypoints of whole levels sets
/// [`Depth::Once`](crate::Depth::Once). It stops when `pace` says so, and keeps what it has.
pub trait Finder {
    /// Appends the keypoints of `luma` to `out`. `luma` is pyramid level `level`, or a tile of it, and
    /// keypoints are in px from its first pixel. `out` is empty
    /// at the call. The best come first: keypoints that do not fit are lost.
    fn keypoints(
        &mut self,
        luma: Plane<'_, u8>,
        level: usize,
        out: &mut VecView<Corner>,
        pace: &mut dyn Pace,
    ) -> StageStats;

    /// Appends triples of indices into `points` to `out`, best first. `out` is empty at the call,
    /// and has room for `KEYGRAPHS` triples. A frame keeps `KEYGRAPHS` keygraphs over all levels.
    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, pace: &mut dyn Pace) -> StageStats;
}

/// Finds Shi-Tomasi corners and nested Delaunay triangles, in borrowed memory.
pub(crate) struct Corners<'a> {
    pub(crate) rules: &'static Parameters,
    /// Scratch memory: [`SCRATCH_ROWS`](crate::extract::corners::SCRATCH_ROWS) rows of the longest
    /// side.
    pub(crate) scratch: &'a mut [f32],
    pub(crate) mesh: Workspace<'a>,
}

impl Finder for Corners<'_> {
    fn keypoints(
        &mut self,
        luma: Plane<'_, u8>,
        level: usize,
        out: &mut VecView<Corner>,
        pace: &mut dyn Pace,
    ) -> StageStats {
        let Self { rules, scratch, mesh } = self;
        let limit = rules.corner_limits[level].min(mesh.capacity());
        if limit == 0 {
            return StageStats::default();
        }
        let mut stats = detect_corners(luma, &rules.corners, scratch, out, pace);
        rank(rules.ranking, out, limit, scratch, &mut stats, pace);
        stats
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, pace: &mut dyn Pace) -> StageStats {
        triangulate(points, self.rules.prefixes, self.mesh.reborrow(), out, pace)
    }
}
