//! Tiles: parts of a frame that are searched once more, each with corners of its own.
//!
//! In: the size of a frame. Out: its tiles. The corners of a frame are shared by all that is seen: in
//! a crowd, a small object gets a few, and is not found. Each tile gets a third as many corners as the
//! whole frame, in a ninth of its area; in a thorough search as many.
//!
//! Memory: [`Tile`], 8 bytes. Cost: for a tile and a detection, 64 points in an outline.

use crate::base::capacity::id;
use crate::base::geometry::Point;
use crate::base::pace::Pace;
use crate::detect::detection::{Detections, is_inside};
use crate::image::plane::Plane;

/// Number of tiles along each side of a frame.
const SIDE: usize = 3;
const _: () = assert!(Tile::COUNT as usize == SIDE * SIDE);
/// Part of a tile by which it reaches into each of its neighbours, as a divisor. An object on a
/// border has most of its triangles in one of the tiles.
const LAP: usize = 14;
/// Number of points along each side of a tile at which it is tested.
const POINTS: usize = 8;
/// Minimum number of test points outside all outlines. With fewer, nothing new fits into the tile.
const OPEN: usize = 6;

/// A part of a frame, px of level 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tile {
    start: [u16; 2],
    end: [u16; 2],
}

impl Tile {
    /// Number of tiles of a frame.
    pub(crate) const COUNT: u8 = 9;

    /// Tile `i` of a frame; `None` when it has no more.
    #[inline(never)]
    pub(crate) fn nth(i: u8, width: usize, height: usize) -> Option<Self> {
        let (x, y) = (usize::from(i) % SIDE, usize::from(i) / SIDE);
        let part = |i: usize, length: usize| {
            let (step, lap) = (length / SIDE, length / SIDE / LAP);
            (id((i * step).saturating_sub(lap)), id(((i + 1) * step + lap).min(length)))
        };
        let ((x, right), (y, bottom)) = (y < SIDE).then(|| (part(x, width), part(y, height)))?;
        Some(Self { start: [x, y], end: [right, bottom] })
    }

    /// Whether the outlines of what has been found leave no room in the tile for anything else.
    #[inline(never)]
    pub(crate) fn is_explained(&self, found: &Detections, pace: &mut dyn Pace) -> bool {
        let at = |i: usize, d: usize| {
            let (start, end) = (f32::from(self.start[d]), f32::from(self.end[d]));
            start + (end - start) * (i as f32 + 0.5) / POINTS as f32
        };
        let points = (0..POINTS * POINTS).map(|i| [at(i % POINTS, 0), at(i / POINTS, 1)]);
        let mut is_open = |p: &[f32; 2]| {
            pace.goes_on();
            !is_inside(found, *p)
        };
        points.filter(|p| is_open(p)).count() < OPEN
    }

    /// The tile in a pyramid level, and the position of its first pixel.
    #[inline(never)]
    pub(crate) fn in_level<'a>(&self, plane: Plane<'a, u8>, level: usize) -> (Plane<'a, u8>, Point) {
        let [start, end] = [self.start, self.end].map(|p| p.map(|v| v >> level));
        let size = [0, 1].map(|i| usize::from(end[i] - start[i]));
        // Sides are below 2048 px, so that positions in 1/16 px fit.
        let at = start.map(|v| (v << 4).cast_signed());
        (plane.window(start.map(usize::from), size), Point::new(at[0], at[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Homography;
    use crate::base::pace::Steady;
    use crate::detect::detection::Detection;

    #[test]
    fn tiles_cover_the_frame_and_overlap_a_little() {
        let tiles: std::vec::Vec<_> = (0..).map_while(|i| Tile::nth(i, 640, 480)).collect();
        assert_eq!(tiles.len(), 9);
        for (x, y) in (0..640).flat_map(|x| (0..480).map(move |y| (x, y))) {
            let holds = |t: &&Tile| (t.start[0]..t.end[0]).contains(&x) && (t.start[1]..t.end[1]).contains(&y);
            assert!((1..=4).contains(&tiles.iter().filter(holds).count()), "({x}, {y})");
        }
        assert_eq!(tiles[4], Tile { start: [198, 149], end: [441, 331] });
    }

    #[test]
    fn a_tile_full_of_outlines_is_explained() {
        let tile = Tile::nth(0, 640, 480).unwrap();
        let at = |x: f32, width: f32| {
            let map = Homography::affine([width, 0.0, x, 0.0, 200.0, 0.0]);
            Detection::new(0, &map, [1.0; 2])
        };
        let mut found = Detections::new();
        assert!(!tile.is_explained(&found, &mut Steady));
        found.push(at(0.0, 120.0)).unwrap();
        assert!(!tile.is_explained(&found, &mut Steady));
        found.push(at(120.0, 110.0)).unwrap();
        assert!(tile.is_explained(&found, &mut Steady));
    }

    #[test]
    fn a_tile_of_a_level_starts_where_it_says() {
        let data: std::vec::Vec<u8> = (0..60 * 60).map(|i| (i % 60) as u8).collect();
        let tile = Tile::nth(4, 120, 120).unwrap();
        let (plane, at) = tile.in_level(Plane::new(&data, 60, 60).unwrap(), 1);
        let [x, y] = at.px();
        assert_eq!((f32::from(plane.row(0)[0]), y), (x, 19.0));
        assert_eq!((plane.width(), plane.height()), (22, 22));
    }
}
