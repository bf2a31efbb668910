//! Shi-Tomasi corners ("good features to track"), computed row by row.
//!
//! In: a luma plane. Out: corners in 1/16 px, strongest first or most widely
//! spaced first. The strength of a pixel is twice the smaller eigenvalue of
//! `[[a, b], [b, c]]`, sums over its 3x3 block of products of 3x3 Sobel
//! derivatives: `a + c - sqrt((a - c)^2 + 4 b^2)` (J. Shi, C. Tomasi, *Good
//! Features to Track*, CVPR 1994). The sums are integers below 2^24, which `f32`
//! holds exactly; it is taken because all processors have its multiplication in
//! their vector units. Borders mirror without
//! repeating the edge, the outermost pixels hold no corner, and a corner is a
//! pixel that no neighbour exceeds: OpenCV's `goodFeaturesToTrack`. Its place
//! is then refined by a parabola through the strengths beside it, where those
//! below the threshold so far count as none.
//!
//! Memory: [`SCRATCH_ROWS`] rows of `f32` and 12 bytes a candidate. Cost: one
//! pass over the pixels, some 100 operations each, written so that compilers
//! make vectors of them. Full: the weaker half of the candidates is dropped and
//! counted, and the threshold rises to the weakest that is left.

use core::cmp::Reverse;

use heapless::VecView;

use crate::capacity::StageStats;
use crate::geometry::Point;
use crate::math::{self, VECTORS};
use crate::pyramid::Plane;
use crate::sort::sort_by_key;

/// Rows of `f32`, each as long as the image is wide, that [`detect_corners`]
/// works in.
pub const SCRATCH_ROWS: usize = 15;

/// A corner of one pyramid level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Corner {
    /// Position in its level, 1/16 px.
    pub point: Point,
    /// Twice the smaller eigenvalue of the integer structure tensor.
    pub strength: i32,
    /// Squared distance, in (1/16 px)^2, to the nearest clearly stronger
    /// corner; 0 until [`rank_by_radius`] has set it.
    pub radius2: u32,
}

/// What counts as a corner.
#[derive(Clone, Copy, Debug)]
pub struct CornerParams {
    /// Least strength as a fraction of the strongest corner's, in 1/65536.
    /// OpenCV's `qualityLevel`, usually 0.01 (655). Raising it loses corners in
    /// the duller parts of a frame.
    pub quality_q16: u32,
    /// Least strength whatever the strongest corner: below it noise makes
    /// corners. 20,000 is a step of about 12 gray levels seen from its corner.
    pub floor: i32,
    /// Corners nearer than this to the edge are left out, px; at least 1.
    pub margin_px: usize,
}

/// The smaller eigenvalue of `[[a, b], [b, c]]`, times two, good to a millionth of
/// the larger one.
#[must_use]
pub fn strength(a: f32, b: f32, c: f32) -> f32 {
    let (d, e) = (a - c, 2.0 * b);
    let v = a + c - math::coarse_sqrt(d * d + e * e);
    if v > 0.0 { v } else { 0.0 }
}

/// Where row or column `i` of a mirrored border lies: -1 is 1, `n` is `n - 2`.
const fn mirror(i: isize, n: usize) -> usize {
    let n = n.cast_signed();
    let i = if i < 0 { -i } else { i };
    (if i >= n { 2 * n - 2 - i } else { i }).cast_unsigned()
}

/// Sobel derivatives of the middle row as products `dx dx`, `dx dy`, `dy dy`.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn products([top, mid, low]: [&[u8]; 3], [xx, xy, yy]: &mut [&mut [f32]; 3]) {
    let n = mid.len() - 2;
    // Each pixel and its neighbours as slices of one length: no bounds to check.
    let [[t0, t1, t2], [m0, _, m2], [l0, l1, l2]] = [top, mid, low].map(|row| [0, 1, 2].map(|d| &row[d..][..n]));
    let (ix, iy, iz) = (&mut xx[1..][..n], &mut xy[1..][..n], &mut yy[1..][..n]);
    for i in 0..n {
        let p = |row: &[u8]| i16::from(row[i]);
        let dx = p(t2) - p(t0) + 2 * (p(m2) - p(m0)) + p(l2) - p(l0);
        let dy = p(l0) - p(t0) + 2 * (p(l1) - p(t1)) + p(l2) - p(t2);
        let (dx, dy) = (f32::from(dx), f32::from(dy));
        (ix[i], iy[i], iz[i]) = (dx * dx, dx * dy, dy * dy);
    }
    for (x, beside) in [(0, 1), (n + 1, n)] {
        let slope = |x: usize| f32::from(i16::from(low[x]) - i16::from(top[x]));
        let dy = 2.0 * (slope(beside) + slope(x));
        (xx[x], xy[x], yy[x]) = (0.0, 0.0, dy * dy);
    }
}

/// Sums over each pixel and its two neighbours in the row.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn sum3(p: &[f32], out: &mut [f32]) {
    let w = p.len();
    out[0] = p[0] + 2.0 * p[1];
    out[w - 1] = p[w - 1] + 2.0 * p[w - 2];
    let n = w - 2;
    let (l, m, r, out) = (&p[..n], &p[1..][..n], &p[2..][..n], &mut out[1..][..n]);
    for i in 0..n {
        out[i] = l[i] + m[i] + r[i];
    }
}

/// The sums over each pixel of the middle row and its two neighbours of the products `dx dx`,
/// `dy dy`, `dx dy`, one pixel after the other: what a column adds is kept for the next two.
fn sums_one_by_one([top, mid, low]: [&[u8]; 3], out: &mut [f32]) {
    let (out, _) = out.as_chunks_mut::<3>();
    let n = mid.len();
    // What a column adds to the derivatives along and across the row.
    let sums = |[t, m, l]: [i32; 3]| (t + 2 * m + l, l - t);
    let column = |x: usize| sums([top[x], mid[x], low[x]].map(i32::from));
    let product = |dx: i32, dy: i32| {
        let (dx, dy) = (dx as f32, dy as f32);
        [dx * dx, dy * dy, dx * dy]
    };
    let plus = |a: [f32; 3], b: [f32; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let [(first, slope), second, third] = [0, 1, 2].map(column);
    // Borders mirror: the first pixel has the second on both sides.
    let p = product(0, 2 * (slope + second.1));
    let mut last = product(third.0 - first, slope + 2 * second.1 + third.1);
    let mut pair = plus(p, last);
    let (head, rest) = out.split_at_mut(1);
    head[0] = plus(pair, last);
    let (mut before, mut here) = (second, third);
    let mut add = |[t, m, l]: [u8; 3], out: &mut [f32; 3]| {
        let next = sums([t, m, l].map(i32::from));
        let p = product(next.0 - before.0, before.1 + 2 * here.1 + next.1);
        *out = plus(pair, p);
        (pair, last) = (plus(last, p), p);
        (before, here) = (here, next);
    };
    // Two at a time: less is moved from one name to another.
    let [top, mid, low] = [top, mid, low].map(|row| row[3..n].as_chunks::<2>());
    let (twos, ends) = rest.split_at_mut(2 * top.0.len());
    for (((t, m), l), out) in top.0.iter().zip(mid.0).zip(low.0).zip(twos.as_chunks_mut::<2>().0) {
        add([t[0], m[0], l[0]], &mut out[0]);
        add([t[1], m[1], l[1]], &mut out[1]);
    }
    for (((t, m), l), out) in top.1.iter().zip(mid.1).zip(low.1).zip(&mut *ends) {
        add([*t, *m, *l], out);
    }
    let p = product(0, 2 * (before.1 + here.1));
    rest[n - 3] = plus(pair, p);
    rest[n - 2] = plus(p, plus(last, last));
}

/// Numbers that are looked at together.
const LANES: usize = 8;

/// Strengths of a row from the sums in the rows around it; what is below `cut`
/// may be 0. Returns the greatest.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn strengths(sums: [&[f32]; 3], cut: f32, out: &mut [f32]) -> f32 {
    if !VECTORS {
        return strengths_one_by_one(sums.map(|s| s.as_chunks().0), cut, out);
    }
    let w = out.len();
    let [[a0, b0, c0], [a1, b1, c1], [a2, b2, c2]] = sums.map(|s| [0, 1, 2].map(|i| &s[i * w..][..w]));
    for x in 0..w {
        let (a, b, c) = (a0[x] + a1[x] + a2[x], b0[x] + b1[x] + b2[x], c0[x] + c1[x] + c2[x]);
        // The smaller eigenvalue is at most the smaller diagonal element.
        let least = 2.0 * min(a, c);
        let v = strength(a, b, c);
        out[x] = if least < cut { 0.0 } else { v };
    }
    let (chunks, rest) = out.as_chunks::<LANES>();
    let mut most = [0.0; LANES];
    for chunk in chunks {
        most = core::array::from_fn(|i| max(most[i], chunk[i]));
    }
    most.iter().chain(rest).fold(0.0, |m, &v| max(m, v))
}

/// The same of the sums that [`sums_one_by_one`] makes.
fn strengths_one_by_one([above, here, below]: [&[[f32; 3]]; 3], cut: f32, out: &mut [f32]) -> f32 {
    let mut most = 0.0;
    for (out, ((p, q), r)) in out.iter_mut().zip(above.iter().zip(here).zip(below)) {
        let sum = |i: usize| p[i] + q[i] + r[i];
        *out = 0.0;
        let a = sum(0);
        if a < cut / 2.0 {
            continue;
        }
        let c = sum(1);
        if c < cut / 2.0 {
            continue;
        }
        *out = strength(a, sum(2), c);
        most = max(most, *out);
    }
    most
}

/// The greater of two numbers, which are numbers.
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, which are numbers.
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Finds the corners of `luma`, in no particular order: rank them next.
///
/// `scratch` needs [`SCRATCH_ROWS`] times the width; `out` is cleared first. Its
/// capacity bounds the candidates.
///
/// # Panics
/// When `scratch` is too short or the image has a side under 3 px.
pub fn detect_corners(
    luma: Plane<'_, u8>,
    params: &CornerParams,
    scratch: &mut [f32],
    out: &mut VecView<Corner>,
) -> StageStats {
    let (w, h) = (luma.width(), luma.height());
    let mut stats = StageStats::default();
    let mut strongest = 0.0;
    let mut cut = params.floor.max(1) as f32;
    out.clear();

    let mut rows = scratch[..SCRATCH_ROWS * w].chunks_exact_mut(3 * w);
    let mut take = || rows.next().unwrap_or_default();
    let mut raw = thirds(take());
    // Row y of the sums and of the strengths lies in slot y % 3.
    let sums = [take(), take(), take()];
    let ring = thirds(take());

    let mut next = 0;
    for y in 0..h {
        while next <= (y + 1).min(h - 1) {
            let around = [-1, 0, 1].map(|d| luma.row(mirror(next.cast_signed() + d, h)));
            if VECTORS {
                products(around, &mut raw);
                for (p, s) in raw.iter().zip(sums[next % 3].chunks_exact_mut(w)) {
                    sum3(p, s);
                }
            } else {
                sums_one_by_one(around, sums[next % 3]);
            }
            next += 1;
        }
        let sums = [-1, 0, 1].map(|d| &*sums[mirror(y.cast_signed() + d, h) % 3]);
        strongest = max(strongest, strengths(sums, cut, ring[y % 3]));
        cut = max(cut, strongest * (params.quality_q16 as f32 / 65536.0));
        let margin = params.margin_px.max(1);
        if y < margin + 1 || y > h - margin {
            continue;
        }
        let around = [y - 2, y - 1, y].map(|r| &*ring[r % 3]);
        let mut take = |x: usize| {
            if (whole(around[1][x]) as f32) < cut {
                return;
            }
            stats.seen += 1;
            let corner = corner_at(around, x, y - 1);
            if out.push(corner).is_err() {
                cut = max(cut, drop_weaker_half(out, &mut stats) as f32);
                if (corner.strength as f32) < cut || out.push(corner).is_err() {
                    stats.dropped += 1;
                }
            }
        };
        if VECTORS {
            for first in (margin..w - margin).step_by(STRIP) {
                let mut peaks = [0; STRIP];
                let end = (first + STRIP).min(w - margin);
                find_peaks(around.map(|row| &row[first - 1..=end]), &mut peaks);
                for (words, word) in peaks.as_chunks().0.iter().enumerate() {
                    let mut word = u64::from_le_bytes(*word);
                    while word != 0 {
                        take(first + LANES * words + word.trailing_zeros() as usize / 8);
                        word &= word - 1;
                    }
                }
            }
        } else {
            let [left, here, right] = beside(around);
            let (mut x, end) = (margin - 1, w - 1 - margin);
            // Most are 0.
            while let Some(next) = here[1][x.min(end)..end].iter().position(|v| v.to_bits() != 0) {
                x += next;
                let v = here[1][x];
                // What follows one that is not exceeded by it is no peak.
                let falls = v >= right[1][x];
                let across = || v > here[0][x] && v >= here[2][x];
                let aslant = || v > left[0][x] && v > right[0][x] && v >= left[2][x] && v >= right[2][x];
                if falls && v > left[1][x] && across() && aslant() {
                    take(x + 1);
                }
                x += 1 + usize::from(falls);
            }
        }
    }
    out.retain(|c| c.strength as f32 >= cut);
    stats.kept = count(out.len());
    stats
}

/// Pixels of a row that are looked at for peaks together.
const STRIP: usize = 16 * LANES;

/// Whether no neighbour exceeds the strength of a pixel of the middle row (of equals the first
/// in reading order wins), 1 or 0 for all but its first and last.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn find_peaks(around: [&[f32]; 3], out: &mut [u8; STRIP]) {
    let [[t0, m0, l0], [t1, m1, l1], [t2, m2, l2]] = beside(around);
    for (i, out) in out.iter_mut().enumerate().take(m1.len()) {
        let v = m1[i];
        let before = max(max(t0[i], t1[i]), max(t2[i], m0[i]));
        let after = max(max(l0[i], l1[i]), max(l2[i], m2[i]));
        *out = u8::from((v > before) & (v >= after));
    }
}

/// Rows from their first pixel on, from their second and from their third: what lies left of a
/// pixel, the pixel, and what lies right of it.
fn beside(rows: [&[f32]; 3]) -> [[&[f32]; 3]; 3] {
    let n = rows[1].len() - 2;
    [0, 1, 2].map(|d| rows.map(|row| &row[d..][..n]))
}

/// Three rows.
fn thirds(rows: &mut [f32]) -> [&mut [f32]; 3] {
    let (a, rest) = rows.split_at_mut(rows.len() / 3);
    let (b, c) = rest.split_at_mut(a.len());
    [a, b, c]
}

/// A strength as corners have it.
#[allow(clippy::cast_possible_truncation, reason = "strengths are below 2^25")]
const fn whole(strength: f32) -> i32 {
    strength as i32
}

/// The corner at `x` of the middle row, a local maximum.
fn corner_at([top, mid, low]: [&[f32]; 3], x: usize, y: usize) -> Corner {
    let at = |i: usize, d: i16| i16::try_from(i).unwrap_or(i16::MAX / 16).saturating_mul(16).saturating_add(d);
    let point = Point::new(at(x, vertex(mid[x - 1], mid[x], mid[x + 1])), at(y, vertex(top[x], mid[x], low[x])));
    Corner { point, strength: whole(mid[x]), radius2: 0 }
}

/// Where the parabola through `l`, `v`, `r` at -1, 0, 1 has its top, in 1/16;
/// within half a pixel.
#[allow(clippy::cast_possible_truncation, reason = "clamped")]
fn vertex(l: f32, v: f32, r: f32) -> i16 {
    let bend = 2.0 * v - l - r;
    if bend > 0.0 { ((r - l) * 8.0 / bend).clamp(-7.0, 7.0) as i16 } else { 0 }
}

/// Keeps the stronger half and returns the weakest strength that is left.
fn drop_weaker_half(corners: &mut VecView<Corner>, stats: &mut StageStats) -> i32 {
    let half = corners.len() / 2;
    if half == 0 {
        return i32::MAX;
    }
    sort_by_key(corners, by_strength);
    stats.dropped += count(corners.len() - half);
    corners.truncate(half);
    corners[half - 1].strength
}

/// Strongest first; of equals the one that comes first in reading order. One number, since
/// sorting compares little else.
fn by_strength(c: &Corner) -> u64 {
    let [strength, y, x] =
        [c.strength, i32::from(c.point.y), i32::from(c.point.x)].map(i32::cast_unsigned).map(u64::from);
    (u64::from(u32::MAX) - strength) << 32 | y << 16 | x
}

/// Lengths fit `u32`: every buffer of the core is far smaller.
#[allow(clippy::cast_possible_truncation, reason = "capacities are far below 2^32")]
const fn count(n: usize) -> u32 {
    n as u32
}

/// Orders corners strongest first and, where two lie nearer than
/// `min_distance_px`, keeps the stronger: the plain ranking of OpenCV. At most
/// `limit` are left; those beyond, far enough from the others, count as dropped.
pub fn rank_by_strength(corners: &mut VecView<Corner>, min_distance_px: u16, limit: usize, stats: &mut StageStats) {
    sort_by_key(corners, by_strength);
    let least2 = i64::from(min_distance_px).pow(2);
    let pixel = |p: Point| Point::new((p.x + 8) >> 4, (p.y + 8) >> 4);
    let mut kept = 0;
    for i in 0..corners.len() {
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

/// Orders corners by suppression radius, the distance to the nearest corner
/// that is stronger even after a discount of a tenth: each prefix then covers
/// the image evenly (M. Brown, R. Szeliski, S. Winder, *Multi-Image Matching
/// using Multi-Scale Oriented Patches*, CVPR 2005). At most `limit` are left;
/// what is cut off is counted as dropped.
///
/// `scratch` needs three numbers for each corner and one for each 16 x 16 px. Cost: the stronger
/// corners around each, as far as the nearest; a corner is given up as soon as it is nearer to one than
/// `limit` others are to theirs.
///
/// # Panics
/// When `scratch` is shorter.
pub fn rank_by_radius(corners: &mut VecView<Corner>, limit: usize, scratch: &mut [f32], stats: &mut StageStats) {
    sort_by_key(corners, by_strength);
    let mut reach = Reach::new(limit);
    if VECTORS {
        let mut list = List::new(corners.len(), scratch);
        set_radii(corners, &mut reach, &mut list);
    } else {
        let mut grid = Grid::new(corners, scratch);
        set_radii(corners, &mut reach, &mut grid);
    }
    let all = corners.len();
    corners.retain(|c| c.radius2 >= reach.least);
    sort_by_key(corners, |c| (Reverse(c.radius2), by_strength(c)));
    corners.truncate(limit);
    stats.dropped += count(all - corners.len());
    stats.kept = count(corners.len());
}

/// Sets the suppression radius of corners, strongest first.
fn set_radii(corners: &mut [Corner], reach: &mut Reach, others: &mut impl Nearest) {
    let mut stronger = 0;
    for i in 0..corners.len() {
        // Strengths fall, so the clearly stronger ones come first, and become no fewer.
        let least = i64::from(corners[i].strength) * 10;
        while stronger < i && i64::from(corners[stronger].strength) * 9 >= least {
            others.put(stronger, corners[stronger].point);
            stronger += 1;
        }
        corners[i].radius2 = others.nearest2(corners, corners[i].point, reach.least);
        reach.add(corners[i].radius2);
    }
}

/// Corners of which the nearest to a place is sought.
trait Nearest {
    /// Puts in the `i`th corner: one after the other.
    fn put(&mut self, i: usize, p: Point);

    /// Squared distance of a place to the nearest of those that have been put in; anything below
    /// `least` if that is.
    fn nearest2(&self, corners: &[Corner], p: Point, least: u32) -> u32;
}

/// Corners in a list, which vectors go through, with the last of each neighbourhood apart: most
/// places are near to one.
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
        // Of floats that are not below 0 the least has the least bits.
        let bits = near.iter().fold(i32::MAX, |least, d| least.min(d.to_bits().cast_signed()));
        f32::from_bits(bits.cast_unsigned()) as u32
    }
}

/// Lowers squared distances to those of other places. Not inlined: sums in registers would
/// not become vectors.
#[inline(never)]
fn nearer2(near: &mut [f32], place: [f32; 2], xs: &[f32], ys: &[f32]) {
    for ((near, u), v) in near.iter_mut().zip(xs).zip(ys) {
        *near = min(*near, distance2(place, [*u, *v]));
    }
}

fn distance2([x, y]: [f32; 2], [u, v]: [f32; 2]) -> f32 {
    (u - x) * (u - x) + (v - y) * (v - y)
}

/// The last place put into each cell of a grid, which repeats itself.
struct Cells<'a> {
    places: &'a mut [[f32; 2]],
    rows: usize,
}

impl<'a> Cells<'a> {
    /// 1/16 px that a cell is wide, in bits, and cells in a row; the next is the first again.
    const SIZE: u32 = 8;
    const ROW: usize = 32;

    /// As many rows as there is room for.
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

    /// Where a cell is kept.
    fn index(&self, [x, y]: [usize; 2]) -> usize {
        (y & self.rows.wrapping_sub(1)).wrapping_mul(Self::ROW) + (x & (Self::ROW - 1))
    }

    fn put(&mut self, place: [f32; 2]) {
        let at = self.index(Self::cell(place));
        if let Some(kept) = self.places.get_mut(at) {
            *kept = place;
        }
    }

    /// Whether one in this cell or those around it is nearer than the root of `least`.
    fn is_near(&self, place: [f32; 2], least: f32) -> bool {
        const AROUND: [[u8; 2]; 9] = [[1, 1], [1, 0], [0, 1], [2, 1], [1, 2], [0, 0], [2, 0], [0, 2], [2, 2]];
        let [column, row] = Self::cell(place).map(|v| v.wrapping_sub(1));
        AROUND.iter().any(|&[right, down]| {
            let at = self.index([column.wrapping_add(right.into()), row.wrapping_add(down.into())]);
            self.places.get(at).is_some_and(|&kept| distance2(place, kept) < least)
        })
    }
}

/// Corners by the cells of a grid in which they lie, for those who look at one at a time.
/// Numbers of corners count from 1; 0 is none.
struct Grid<'a> {
    /// The last of each cell, row by row.
    last: &'a mut [f32],
    /// The one before each in its cell.
    before: &'a mut [f32],
    columns: usize,
    rows: usize,
}

impl<'a> Grid<'a> {
    /// 1/16 px that a cell is wide, in bits.
    const SIZE: u32 = 8;

    /// For these corners, with none in it.
    fn new(corners: &[Corner], scratch: &'a mut [f32]) -> Self {
        let most = corners.iter().fold([0; 2], |m: [usize; 2], c| {
            let [x, y] = Self::cell(c.point);
            [m[0].max(x), m[1].max(y)]
        });
        let [columns, rows] = most.map(|v| v + 1);
        let (last, rest) = scratch.split_at_mut(columns * rows);
        last.fill(0.0);
        Self { last, before: &mut rest[..corners.len()], columns, rows }
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
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers")]
    fn nearest2(&self, corners: &[Corner], p: Point, least: u32) -> u32 {
        let ([column, row], place) = (Self::cell(p), [p.x, p.y].map(f32::from));
        let mut near = f32::MAX;
        // Cells around the place, then those around them.
        for ring in 0..self.columns.max(self.rows) {
            for y in row.saturating_sub(ring)..(row + ring + 1).min(self.rows) {
                let whole = y.abs_diff(row) == ring;
                let cells = &self.last[y * self.columns..][..self.columns];
                let columns = column.saturating_sub(ring)..(column + ring + 1).min(self.columns);
                for (x, cell) in columns.clone().zip(&cells[columns]) {
                    if !whole && x.abs_diff(column) != ring {
                        continue;
                    }
                    let mut number = *cell as usize;
                    while number > 0 {
                        // In floats as a list does it: far ones are rounded.
                        let q = corners[number - 1].point;
                        near = min(near, distance2(place, [q.x, q.y].map(f32::from)));
                        number = self.before[number - 1] as usize;
                    }
                    if near < least as f32 {
                        return 0;
                    }
                }
            }
            // What lies in other cells is farther.
            let reach = (count(ring) << Self::SIZE) as f32;
            if near <= reach * reach {
                break;
            }
        }
        near as u32
    }
}

/// What `limit` radii reach.
struct Reach {
    limit: usize,
    /// Radii by the bits that their squares have.
    bits: [u16; 33],
    /// At least `limit` squares are not below this, which has `low` bits.
    least: u32,
    low: usize,
    /// Squares of `low` bits or more.
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
    use heapless::Vec;

    /// Draws a map of `.` (dark) and `#` (bright) and marks the corners found.
    fn corner_map(picture: &[&str]) -> std::vec::Vec<std::string::String> {
        let (w, h) = (picture[0].len(), picture.len());
        let data: std::vec::Vec<u8> =
            picture.iter().flat_map(|r| r.bytes().map(|b| if b == b'#' { 200 } else { 40 })).collect();
        let mut out: Vec<Corner, 64> = Vec::new();
        let mut scratch = std::vec![0.0; SCRATCH_ROWS * w];
        let params = CornerParams { quality_q16: 655 * 20, floor: 1, margin_px: 1 };
        detect_corners(Plane::new(&data, w, h).unwrap(), &params, &mut scratch, &mut out);
        let mut map: std::vec::Vec<std::vec::Vec<u8>> = picture.iter().map(|r| r.bytes().collect()).collect();
        for c in &out {
            map[((c.point.y + 8) >> 4) as usize][((c.point.x + 8) >> 4) as usize] = b'o';
        }
        map.into_iter().map(|r| std::string::String::from_utf8(r).unwrap()).collect()
    }

    #[test]
    fn a_square_has_four_corners_and_a_stripe_has_none() {
        let square = [
            "................",
            "................",
            "................",
            "....########....",
            "....########....",
            "....########....",
            "....########....",
            "....########....",
            "................",
            "................",
            "................",
        ];
        let found = corner_map(&square);
        let want = [
            "................",
            "................",
            "................",
            "....o######o....",
            "....########....",
            "....########....",
            "....########....",
            "....o######o....",
            "................",
            "................",
            "................",
        ];
        assert_eq!(
            found,
            want,
            "
found:
{}
wanted:
{}",
            found.join("\n"),
            want.join("\n")
        );
        let stripe = ["....####....."; 9];
        assert_eq!(corner_map(&stripe), stripe);
    }

    #[test]
    fn strength_is_the_smaller_eigenvalue_doubled() {
        for (a, b, c, want) in [(9.0, 0.0, 4.0, 8.0), (10.0, 10.0, 10.0, 0.0), (5.0, 2.0, 2.0, 2.0 /* of 6 and 1 */)] {
            let got = strength(a, b, c);
            assert!((got - want).abs() < 1e-3, "{got} for {want}");
        }
        let most = 9.0 * 1020.0 * 1020.0;
        assert_eq!(strength(most, 0.0, most), 2.0 * most);
    }

    #[test]
    fn a_full_buffer_keeps_the_strongest_and_counts_the_rest() {
        // Isolated dots, each brighter than the one before it.
        let (w, h) = (120, 16);
        let mut data = std::vec![20u8; w * h];
        for i in 0..14 {
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                data[(7 + dy) * w + 6 + 8 * i + dx] = 60 + 12 * i as u8;
            }
        }
        let mut scratch = std::vec![0.0; SCRATCH_ROWS * w];
        let params = CornerParams { quality_q16: 0, floor: 1000, margin_px: 1 };
        let mut run = |out: &mut VecView<Corner>| {
            let s = detect_corners(Plane::new(&data, w, h).unwrap(), &params, &mut scratch, out);
            rank_by_strength(out, 0, usize::MAX, &mut StageStats::default());
            s
        };
        let (mut all, mut few): (Vec<Corner, 256>, Vec<Corner, 8>) = (Vec::new(), Vec::new());
        let (s, t) = (run(&mut all), run(&mut few));
        assert_eq!((s.dropped, s.kept, s.seen), (0, s.seen, s.seen));
        assert!(t.dropped > 0 && t.kept <= 8 && t.kept + t.dropped <= t.seen);
        assert_eq!(few[..], all[..few.len()], "the strongest are kept");
    }

    /// With room for cells of none, few, or all places, the ranking is that of the definition.
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
            rank_by_radius(&mut ranked, limit, &mut std::vec![0.0; scratch], &mut StageStats::default());
            let points = |corners: &[Corner]| corners.iter().map(|c| c.point).collect::<std::vec::Vec<_>>();
            assert_eq!(points(&ranked), points(&want[..limit]), "{limit} of {ALL}, {scratch} numbers");
        }
    }

    /// Boards use the one, processors with vectors the other.
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
        set_radii(&mut listed, &mut Reach::new(ALL), &mut List::new(ALL, &mut a));
        let mut grid = Grid::new(&sorted, &mut b);
        set_radii(&mut sorted, &mut Reach::new(ALL), &mut grid);
        assert_eq!(listed, sorted);
    }

    #[test]
    fn suppression_radius_spreads_the_corners() {
        let corner = |x, y, strength| Corner { point: Point::new(x, y), strength, radius2: 0 };
        let mut c: Vec<Corner, 8> =
            Vec::from_slice(&[corner(0, 0, 100), corner(16, 0, 80), corner(32, 0, 85), corner(800, 0, 10)]).unwrap();
        let mut stats = StageStats::default();
        rank_by_radius(&mut c, 3, &mut [0.0; 8], &mut stats);
        assert_eq!(c.iter().map(|c| c.point.x).collect::<std::vec::Vec<_>>(), [0, 800, 32]);
        assert_eq!((stats.kept, stats.dropped), (3, 1));
    }
}
