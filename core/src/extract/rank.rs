//! Ranks corners: the strongest first, or the most widely spaced first.
//!
//! In: the corners of a level. Out: the same corners in order, up to a limit.
//!
//! Memory: what the caller lends, which is three numbers for each corner and one for each 16 x 16
//! px. Cost: a sort, and a search for the nearest clearly stronger corner of each corner. Full: the
//! corners that come last are dropped and counted.

use core::cmp::Reverse;

use heapless::VecView;

use crate::base::capacity::{StageStats, count};
use crate::base::geometry::Point;
use crate::base::math::{VECTORS, min};
use crate::base::pace::Pace;
use crate::base::sort::sort_by_key;
use crate::extract::corners::{Corner, by_strength};
use crate::extract::strength::LANES;

/// The order in which corners are put.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ranking {
    /// By suppression radius. Each prefix then covers the image evenly.
    Radius,
    /// By strength. Corners are at least this many px apart.
    Strength(u16),
}

/// Orders corners as `ranking` says, and keeps at most `limit` of them.
///
/// # Panics
/// Panics when `scratch` is shorter than [`rank_by_radius`] needs.
pub fn rank(
    ranking: Ranking,
    corners: &mut VecView<Corner>,
    limit: usize,
    scratch: &mut [f32],
    stats: &mut StageStats,
    pace: &mut dyn Pace,
) {
    match ranking {
        Ranking::Radius => rank_by_radius(corners, limit, scratch, stats, pace),
        Ranking::Strength(apart) => rank_by_strength(corners, apart, limit, stats, pace),
    }
}

/// Orders corners with the strongest first, as OpenCV does. Where two lie nearer to each other than
/// `min_distance_px`, the stronger is kept. At most `limit` corners are left. Corners beyond the
/// limit that are far enough from the others count as dropped.
pub fn rank_by_strength(
    corners: &mut VecView<Corner>,
    min_distance_px: u16,
    limit: usize,
    stats: &mut StageStats,
    pace: &mut dyn Pace,
) {
    sort_by_key(corners, by_strength, pace);
    let least2 = i64::from(min_distance_px).pow(2);
    let pixel = |p: Point| Point::new((p.x + 8) >> 4, (p.y + 8) >> 4);
    let mut kept = 0;
    for i in 0..corners.len() {
        if !pace.goes_on() {
            break;
        }
        let c = corners[i];
        let near = |k: &Corner| pixel(k.point).distance2(pixel(c.point)) < least2;
        if corners[..kept].iter().any(near) {
            continue;
        }
        if kept < limit {
            corners[kept] = c;
            kept += 1;
        } else {
            stats.dropped += 1;
        }
    }
    corners.truncate(kept);
    stats.kept = count(kept);
}

/// Orders corners by suppression radius, largest first. The suppression radius of a corner is the
/// distance to the nearest corner that is stronger even after a discount of a tenth. Each prefix
/// then covers the image evenly (M. Brown, R. Szeliski, S. Winder, *Multi-Image Matching using
/// Multi-Scale Oriented Patches*, CVPR 2005). At most `limit` corners are left. The others count as
/// dropped.
///
/// `scratch` needs three numbers for each corner and one for each 16 x 16 px.
///
/// Cost: for each corner, a look at the stronger corners around it, as far as the nearest. The
/// search for a corner stops as soon as a stronger one is nearer to it than `limit` others are to
/// theirs.
///
/// # Panics
/// Panics when `scratch` is shorter than that.
pub fn rank_by_radius(
    corners: &mut VecView<Corner>,
    limit: usize,
    scratch: &mut [f32],
    stats: &mut StageStats,
    pace: &mut dyn Pace,
) {
    sort_by_key(corners, by_strength, pace);
    let mut reach = Reach::new(limit);
    if VECTORS {
        let mut list = List::new(corners.len(), scratch);
        set_radii(corners, &mut reach, &mut list, pace);
    } else {
        let mut grid = Grid::new(corners, scratch);
        set_radii(corners, &mut reach, &mut grid, pace);
    }
    let all = corners.len();
    corners.retain(|c| c.radius2 >= reach.least);
    sort_by_key(corners, |c| (Reverse(c.radius2), by_strength(c)), pace);
    corners.truncate(limit);
    stats.dropped += count(all - corners.len());
    stats.kept = count(corners.len());
}

/// Sets the suppression radii of corners, which are sorted with the strongest first.
fn set_radii(corners: &mut [Corner], reach: &mut Reach, others: &mut impl Nearest, pace: &mut dyn Pace) {
    let mut stronger = 0;
    for i in 0..corners.len() {
        if !pace.goes_on() {
            return;
        }
        // Strengths fall. The clearly stronger corners therefore come first, and their number never
        // falls.
        let least = i64::from(corners[i].strength) * 10;
        while stronger < i && i64::from(corners[stronger].strength) * 9 >= least {
            others.put(stronger, corners[stronger].point);
            stronger += 1;
        }
        corners[i].radius2 = others.nearest2(corners, corners[i].point, reach.least);
        reach.add(corners[i].radius2);
    }
}

/// A set of corners that finds the one nearest to a place.
trait Nearest {
    /// Adds corner number `i`. Corners are added in ascending order.
    fn put(&mut self, i: usize, p: Point);

    /// Returns the squared distance from `p` to the nearest corner that has been added. When it is
    /// below `least` the result may be any number below `least`.
    fn nearest2(&self, corners: &[Corner], p: Point, least: u32) -> u32;
}

/// Corners in a list, which is searched with vectors. The last corner of each neighbourhood is also
/// kept apart, because most places are near to one of these.
struct List<'a> {
    xs: &'a mut [f32],
    ys: &'a mut [f32],
    n: usize,
    cells: Cells<'a>,
}

impl<'a> List<'a> {
    fn new(most: usize, scratch: &'a mut [f32]) -> Self {
        let (xs, rest) = scratch.split_at_mut(most);
        let (ys, cells) = rest.split_at_mut(most);
        Self { xs, ys, n: 0, cells: Cells::new(cells) }
    }
}

impl Nearest for List<'_> {
    fn put(&mut self, i: usize, p: Point) {
        let [x, y] = [p.x, p.y].map(f32::from);
        (self.xs[i], self.ys[i], self.n) = (x, y, i + 1);
        self.cells.put([x, y]);
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "squares of 16 bits, or saturating")]
    fn nearest2(&self, _: &[Corner], p: Point, least: u32) -> u32 {
        let place = [p.x, p.y].map(f32::from);
        if self.cells.is_near(place, least as f32) {
            return 0;
        }
        let mut near = [f32::MAX; 4 * LANES];
        let (xs, ys) = (&self.xs[..self.n], &self.ys[..self.n]);
        for (xs, ys) in xs.chunks(near.len()).zip(ys.chunks(near.len())) {
            nearer2(&mut near, place, xs, ys);
        }
        // Floats that are not below 0 have the same order as their bits.
        let bits = near.iter().fold(i32::MAX, |least, d| least.min(d.to_bits().cast_signed()));
        f32::from_bits(bits.cast_unsigned()) as u32
    }
}

/// Lowers each squared distance in `near` where the place at `xs` and `ys` is nearer. The function
/// is not inlined: sums in registers would not become vectors.
#[inline(never)]
fn nearer2(near: &mut [f32], place: [f32; 2], xs: &[f32], ys: &[f32]) {
    for ((near, u), v) in near.iter_mut().zip(xs).zip(ys) {
        *near = min(*near, distance2(place, [*u, *v]));
    }
}

fn distance2([x, y]: [f32; 2], [u, v]: [f32; 2]) -> f32 {
    (u - x) * (u - x) + (v - y) * (v - y)
}

/// The last place that was put into each cell of a grid. The grid repeats itself.
struct Cells<'a> {
    places: &'a mut [[f32; 2]],
    rows: usize,
}

impl<'a> Cells<'a> {
    /// Width of a cell: 2 to this power, in 1/16 px. `ROW` is the number of cells in a row; after
    /// the last cell comes the first again.
    const SIZE: u32 = 8;
    const ROW: usize = 32;

    /// Makes as many rows as `scratch` has room for. Their number is a power of two, or 0.
    fn new(scratch: &'a mut [f32]) -> Self {
        let (places, _) = scratch.as_chunks_mut();
        let rows = (places.len() / Self::ROW).checked_ilog2().map_or(0, |bits| 1 << bits);
        let places = &mut places[..rows * Self::ROW];
        places.fill([f32::MAX; 2]);
        Self { places, rows }
    }

    #[allow(clippy::cast_possible_truncation, reason = "16 bits")]
    fn cell([x, y]: [f32; 2]) -> [usize; 2] {
        [x, y].map(|v| (v as i32 >> Self::SIZE).cast_unsigned() as usize)
    }

    /// Returns the index at which a cell is kept.
    fn index(&self, [x, y]: [usize; 2]) -> usize {
        (y & self.rows.wrapping_sub(1)).wrapping_mul(Self::ROW) + (x & (Self::ROW - 1))
    }

    fn put(&mut self, place: [f32; 2]) {
        let at = self.index(Self::cell(place));
        if let Some(kept) = self.places.get_mut(at) {
            *kept = place;
        }
    }

    /// Returns whether a place in this cell or in those around it is nearer than the root of
    /// `least`.
    fn is_near(&self, place: [f32; 2], least: f32) -> bool {
        const AROUND: [[u8; 2]; 9] = [[1, 1], [1, 0], [0, 1], [2, 1], [1, 2], [0, 0], [2, 0], [0, 2], [2, 2]];
        let [column, row] = Self::cell(place).map(|v| v.wrapping_sub(1));
        AROUND.iter().any(|&[right, down]| {
            let at = self.index([column.wrapping_add(right.into()), row.wrapping_add(down.into())]);
            self.places.get(at).is_some_and(|&kept| distance2(place, kept) < least)
        })
    }
}

/// Corners by the cell of a grid in which they lie, for targets that process one corner at a time.
/// Numbers of corners count from 1; 0 stands for none.
struct Grid<'a> {
    /// Number of the last corner of each cell, row by row.
    last: &'a mut [f32],
    /// For each corner, the number of the corner before it in its cell.
    before: &'a mut [f32],
    columns: usize,
    rows: usize,
    /// Number of corners that have been put.
    n: usize,
}

impl<'a> Grid<'a> {
    /// Width of a cell: 2 to this power, in 1/16 px.
    const SIZE: u32 = 8;

    /// Makes a grid that is large enough for these corners. It is empty.
    fn new(corners: &[Corner], scratch: &'a mut [f32]) -> Self {
        let most = corners.iter().fold([0; 2], |m: [usize; 2], c| {
            let [x, y] = Self::cell(c.point);
            [m[0].max(x), m[1].max(y)]
        });
        let [columns, rows] = most.map(|v| v + 1);
        let (last, rest) = scratch.split_at_mut(columns * rows);
        last.fill(0.0);
        Self { last, before: &mut rest[..corners.len()], columns, rows, n: 0 }
    }

    fn cell(p: Point) -> [usize; 2] {
        [p.x, p.y].map(|v| usize::try_from(v >> Self::SIZE).unwrap_or(0))
    }
}

impl Nearest for Grid<'_> {
    fn put(&mut self, i: usize, p: Point) {
        let [x, y] = Self::cell(p);
        let last = &mut self.last[y * self.columns + x];
        self.before[i] = *last;
        *last = count(i + 1) as f32;
        self.n = i + 1;
    }

    fn nearest2(&self, corners: &[Corner], p: Point, least: u32) -> u32 {
        let place = [p.x, p.y].map(f32::from);
        let mut search = Search { grid: self, corners, place, least: least as f32, near: f32::MAX };
        let [column, row] = Self::cell(p);
        // The search goes through the cell of the place, then along rings of cells around it. Where
        // that would be longer than the list of all corners, the list is searched.
        let mut visited = 0;
        for ring in 0..self.columns.max(self.rows) {
            visited += 8 * ring + 1;
            if visited > self.n + FEW {
                return search.all(self.n);
            }
            let (left, right) = (column.wrapping_sub(ring), column + ring);
            let (top, bottom) = (row.wrapping_sub(ring), row + ring);
            search.row(top, left, right);
            if ring > 0 {
                search.row(bottom, left, right);
            }
            for y in row.saturating_sub(ring - ring.min(1))..(row + ring).min(self.rows) {
                search.cell(left, y);
                search.cell(right, y);
            }
            if search.near < search.least {
                return 0;
            }
            // Corners in cells that have not been searched are at least this far away.
            let reach = (count(ring) << Self::SIZE) as f32;
            if search.near <= reach * reach {
                break;
            }
        }
        whole(search.near)
    }
}

/// Number of cells that are visited in any case, before a list is searched instead.
const FEW: usize = 25;

/// A search for the corner nearest to a place.
struct Search<'a> {
    grid: &'a Grid<'a>,
    corners: &'a [Corner],
    place: [f32; 2],
    least: f32,
    /// Squared distance to the nearest so far.
    near: f32,
}

impl Search<'_> {
    fn look_at(&mut self, p: Point) {
        // The distance is an `f32`, as in a list: large ones are rounded.
        self.near = min(self.near, distance2(self.place, [p.x, p.y].map(f32::from)));
    }

    /// Looks at the first `n` corners, until one is near enough.
    fn all(&mut self, n: usize) -> u32 {
        for c in &self.corners[..n] {
            self.look_at(c.point);
            if self.near < self.least {
                return 0;
            }
        }
        whole(self.near)
    }

    /// Looks into the cells of a row, from column `left` to column `right`.
    fn row(&mut self, y: usize, left: usize, right: usize) {
        let left = if left > right { 0 } else { left };
        for x in left..(right + 1).min(self.grid.columns) {
            self.cell(x, y);
        }
    }

    /// Looks into a cell, if there is one.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers")]
    #[inline(never)]
    fn cell(&mut self, x: usize, y: usize) {
        if x >= self.grid.columns || y >= self.grid.rows {
            return;
        }
        let mut number = self.grid.last[y * self.grid.columns + x] as usize;
        while number > 0 {
            self.look_at(self.corners[number - 1].point);
            number = self.grid.before[number - 1] as usize;
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a square of 16 bits, or saturating")]
const fn whole(v: f32) -> u32 {
    v as u32
}

/// Keeps the squared radius that at least `limit` corners reach.
struct Reach {
    limit: usize,
    /// Number of squared radii by their number of bits.
    bits: [u16; 33],
    /// At least `limit` squared radii are not below this number, which has `low` bits.
    least: u32,
    low: usize,
    /// Number of squared radii with `low` bits or more.
    above: usize,
}

impl Reach {
    const fn new(limit: usize) -> Self {
        Self { limit: if limit == 0 { 1 } else { limit }, bits: [0; 33], least: 0, low: 0, above: 0 }
    }

    fn add(&mut self, radius2: u32) {
        let bits = (u32::BITS - radius2.leading_zeros()) as usize;
        self.bits[bits] = self.bits[bits].saturating_add(1);
        self.above += usize::from(bits >= self.low);
        while self.above - usize::from(self.bits[self.low]) >= self.limit {
            self.above -= usize::from(self.bits[self.low]);
            self.low += 1;
            self.least = 1 << (self.low - 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use heapless::Vec;

    /// The ranking follows the definition, with room for no cells, for few, or for all.
    #[test]
    fn ranks_are_those_of_the_nearest_clearly_stronger_corner() {
        // Miri takes a thousand times as long.
        const ALL: usize = if cfg!(miri) { 90 } else { 900 };
        let noise = |i: u32| (i + 1).wrapping_mul(2_654_435_761) >> 8;
        let corner = |i: u32| Corner {
            point: Point::new((noise(i) % 10_000) as i16, (noise(i + 5000) % 7_000) as i16),
            strength: (noise(i + 9000) % 100_000) as i32,
            radius2: 0,
        };
        let all: std::vec::Vec<Corner> = (0..ALL as u32).map(corner).collect();
        let mut want = all.clone();
        for c in &mut want {
            let stronger = all.iter().filter(|s| i64::from(s.strength) * 9 >= i64::from(c.strength) * 10);
            c.radius2 = stronger.map(|s| s.point.distance2(c.point) as u32).min().unwrap_or(u32::MAX);
        }
        want.sort_by_key(|c| (Reverse(c.radius2), by_strength(c)));
        let few = 2 * ALL;
        for (limit, scratch) in [(ALL / 4, few), (ALL / 4, few + 100), (ALL / 4, 9600), (ALL / 22, 9600), (ALL, 9600)] {
            let mut ranked: Vec<Corner, ALL> = Vec::from_slice(&all).unwrap();
            rank_by_radius(&mut ranked, limit, &mut std::vec![0.0; scratch], &mut StageStats::default(), &mut Steady);
            let points = |corners: &[Corner]| corners.iter().map(|c| c.point).collect::<std::vec::Vec<_>>();
            assert_eq!(points(&ranked), points(&want[..limit]), "{limit} of {ALL}, {scratch} numbers");
        }
    }

    /// Boards use the grid, and processors with vectors use the list.
    #[test]
    fn a_grid_gives_the_radii_of_a_list() {
        const ALL: usize = if cfg!(miri) { 60 } else { 400 };
        let noise = |i: usize| (i as u32 + 1).wrapping_mul(2_654_435_761) >> 8;
        let corner = |i: usize| Corner {
            point: Point::new((noise(i) % 20_000) as i16, (noise(i + 5000) % 12_000) as i16),
            strength: 1_000_000 / (i as i32 + 1),
            radius2: 0,
        };
        let mut listed: std::vec::Vec<Corner> = (0..ALL).map(corner).collect();
        let mut sorted = listed.clone();
        let (mut a, mut b) = (std::vec![0.0; 9600], std::vec![0.0; 9600]);
        set_radii(&mut listed, &mut Reach::new(ALL), &mut List::new(ALL, &mut a), &mut Steady);
        let mut grid = Grid::new(&sorted, &mut b);
        set_radii(&mut sorted, &mut Reach::new(ALL), &mut grid, &mut Steady);
        assert_eq!(listed, sorted);
    }

    #[test]
    fn suppression_radius_spreads_the_corners() {
        let corner = |x, y, strength| Corner { point: Point::new(x, y), strength, radius2: 0 };
        let mut c: Vec<Corner, 8> =
            Vec::from_slice(&[corner(0, 0, 100), corner(16, 0, 80), corner(32, 0, 85), corner(800, 0, 10)]).unwrap();
        let mut stats = StageStats::default();
        rank_by_radius(&mut c, 3, &mut [0.0; 8], &mut stats, &mut Steady);
        assert_eq!(c.iter().map(|c| c.point.x).collect::<std::vec::Vec<_>>(), [0, 800, 32]);
        assert_eq!((stats.kept, stats.dropped), (3, 1));
    }
}
