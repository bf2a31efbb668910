//! Shi-Tomasi corners ("good features to track"), computed row by row.
//!
//! In: a luma plane. Out: corners in 1/16 px, strongest first or most widely
//! spaced first. The strength of a pixel is twice the smaller eigenvalue of
//! `[[a, b], [b, c]]`, sums over its 3x3 block of products of 3x3 Sobel
//! derivatives: `a + c - sqrt((a - c)^2 + 4 b^2)`, in integers (J. Shi, C.
//! Tomasi, *Good Features to Track*, CVPR 1994). Borders mirror without
//! repeating the edge, the outermost pixels hold no corner, and a corner is a
//! pixel that no neighbour exceeds: OpenCV's `goodFeaturesToTrack`. Its place
//! is then refined by a parabola through the strengths beside it, where those
//! below the threshold so far count as none.
//!
//! Memory: [`SCRATCH_ROWS`] rows of `i32` and 12 bytes a candidate. Cost: one
//! pass over the pixels; a square root only where the smaller diagonal element
//! passes the threshold. Full: the weaker half of the candidates is dropped and
//! counted, and the threshold rises to the weakest that is left.

use core::cmp::Reverse;

use heapless::VecView;

use crate::capacity::StageStats;
use crate::geometry::Point;
use crate::math;
use crate::pyramid::Plane;
use crate::sort::sort_by_key;

/// Rows of `i32`, each as long as the image is wide, that [`detect_corners`]
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

/// The smaller eigenvalue of `[[a, b], [b, c]]`, times two, rounded up.
#[must_use]
#[allow(clippy::cast_possible_truncation, reason = "clamped")]
pub fn strength(a: i32, b: i32, c: i32) -> i32 {
    let d = i64::from(a) - i64::from(c);
    let e = 2 * i64::from(b);
    let root = math::isqrt((d * d + e * e).unsigned_abs());
    (i64::from(a) + i64::from(c) - i64::from(root)).clamp(0, i64::from(i32::MAX)) as i32
}

/// Where row or column `i` of a mirrored border lies: -1 is 1, `n` is `n - 2`.
const fn mirror(i: isize, n: usize) -> usize {
    let n = n.cast_signed();
    let i = if i < 0 { -i } else { i };
    (if i >= n { 2 * n - 2 - i } else { i }).cast_unsigned()
}

/// Sobel derivatives of row `y` as products `dx dx`, `dx dy`, `dy dy`.
fn products(luma: Plane<'_, u8>, y: usize, out: &mut [&mut [i32]; 3]) {
    let at = |d: isize| luma.row(mirror(y.cast_signed() + d, luma.height()));
    let (top, mid, low) = (at(-1), at(0), at(1));
    let w = luma.width();
    let [xx, xy, yy] = out;
    let mut put = |x: usize, l: usize, r: usize| {
        let p = |row: &[u8], i: usize| i16::from(row[i]);
        let dx = p(top, r) - p(top, l) + 2 * (p(mid, r) - p(mid, l)) + p(low, r) - p(low, l);
        let dy = p(low, l) - p(top, l) + 2 * (p(low, x) - p(top, x)) + p(low, r) - p(top, r);
        let (dx, dy) = (i32::from(dx), i32::from(dy));
        (xx[x], xy[x], yy[x]) = (dx * dx, dx * dy, dy * dy);
    };
    put(0, 1, 1);
    for x in 1..w - 1 {
        put(x, x - 1, x + 1);
    }
    put(w - 1, w - 2, w - 2);
}

/// Sums over each pixel and its two neighbours in the row.
fn sum3(p: &[i32], out: &mut [i32]) {
    let w = p.len();
    out[0] = p[0] + 2 * p[1];
    for (o, p) in out[1..].iter_mut().zip(p.windows(3)) {
        *o = p[0] + p[1] + p[2];
    }
    out[w - 1] = p[w - 1] + 2 * p[w - 2];
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
    scratch: &mut [i32],
    out: &mut VecView<Corner>,
) -> StageStats {
    let (w, h) = (luma.width(), luma.height());
    let mut stats = StageStats::default();
    let mut strongest = 0i32;
    let mut cut = params.floor.max(1);
    out.clear();

    let mut rows = scratch[..SCRATCH_ROWS * w].chunks_exact_mut(w);
    let mut take = || rows.next().unwrap_or_default();
    let mut raw = [take(), take(), take()];
    // Row y of the sums and of the strengths lies in slot y % 3.
    let mut sums: [[&mut [i32]; 3]; 3] = core::array::from_fn(|_| core::array::from_fn(|_| take()));
    let strengths = [take(), take(), take()];

    let mut next = 0;
    for y in 0..h {
        while next <= (y + 1).min(h - 1) {
            products(luma, next, &mut raw);
            for (p, s) in raw.iter().zip(&mut sums[next % 3]) {
                sum3(p, s);
            }
            next += 1;
        }
        let slots = [-1, 0, 1].map(|d| mirror(y.cast_signed() + d, h) % 3);
        let total = |i: usize, x: usize| slots.iter().map(|&s| sums[s][i][x]).sum::<i32>();
        for (x, o) in strengths[y % 3].iter_mut().enumerate() {
            let (a, c) = (total(0, x), total(2, x));
            // The smaller eigenvalue is at most the smaller diagonal element.
            *o = if 2 * a.min(c) < cut { 0 } else { strength(a, total(1, x), c) };
            strongest = strongest.max(*o);
        }
        cut = cut.max(relative(strongest, params.quality_q16));
        let margin = params.margin_px.max(1);
        if y < margin + 1 || y > h - margin {
            continue;
        }
        let around = [y - 2, y - 1, y].map(|r| &*strengths[r % 3]);
        for x in margin..w.saturating_sub(margin) {
            let Some(corner) = local_maximum(around, x, y - 1, cut) else { continue };
            stats.seen += 1;
            if out.push(corner).is_err() {
                cut = cut.max(drop_weaker_half(out, &mut stats));
                if corner.strength < cut || out.push(corner).is_err() {
                    stats.dropped += 1;
                }
            }
        }
    }
    out.retain(|c| c.strength >= cut);
    stats.kept = count(out.len());
    stats
}

/// The fraction `q16 / 65536` of `strongest`.
#[allow(clippy::cast_possible_truncation, reason = "a fraction of an i32")]
fn relative(strongest: i32, q16: u32) -> i32 {
    ((i64::from(strongest) * i64::from(q16)) >> 16).min(i64::from(i32::MAX)) as i32
}

/// The corner at `x` of the middle row, if its strength reaches `cut` and no
/// neighbour exceeds it (of equals the first in reading order wins).
fn local_maximum(rows: [&[i32]; 3], x: usize, y: usize, cut: i32) -> Option<Corner> {
    let [top, mid, low] = rows;
    let v = mid[x];
    let before = top[x - 1].max(top[x]).max(top[x + 1]).max(mid[x - 1]);
    let after = mid[x + 1].max(low[x - 1]).max(low[x]).max(low[x + 1]);
    if v < cut || v <= before || v < after {
        return None;
    }
    let at = |i: usize, d: i16| i16::try_from(i).unwrap_or(i16::MAX / 16).saturating_mul(16).saturating_add(d);
    let point = Point::new(at(x, vertex(mid[x - 1], v, mid[x + 1])), at(y, vertex(top[x], v, low[x])));
    Some(Corner { point, strength: v, radius2: 0 })
}

/// Where the parabola through `l`, `v`, `r` at -1, 0, 1 has its top, in 1/16;
/// within half a pixel.
#[allow(clippy::cast_possible_truncation, reason = "clamped")]
fn vertex(l: i32, v: i32, r: i32) -> i16 {
    let (l, v, r) = (i64::from(l), i64::from(v), i64::from(r));
    let bend = 2 * v - l - r;
    if bend <= 0 { 0 } else { ((r - l) * 8 / bend).clamp(-7, 7) as i16 }
}

/// Keeps the stronger half and returns the weakest strength that is left.
fn drop_weaker_half(corners: &mut VecView<Corner>, stats: &mut StageStats) -> i32 {
    let half = corners.len() / 2;
    if half == 0 {
        return i32::MAX;
    }
    corners.select_nth_unstable_by_key(half - 1, by_strength);
    stats.dropped += count(corners.len() - half);
    corners.truncate(half);
    corners[half - 1].strength
}

/// Strongest first; of equals the one that comes first in reading order.
fn by_strength(c: &Corner) -> (Reverse<i32>, i16, i16) {
    (Reverse(c.strength), c.point.y, c.point.x)
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
/// Cost: half the square of the number of corners.
pub fn rank_by_radius(corners: &mut VecView<Corner>, limit: usize, stats: &mut StageStats) {
    sort_by_key(corners, by_strength);
    for i in 0..corners.len() {
        let (before, rest) = corners.split_at_mut(i);
        let c = &mut rest[0];
        // Strengths fall, so the clearly stronger ones come first.
        let reach = i64::from(c.strength) * 10;
        let stronger = before.partition_point(|o| i64::from(o.strength) * 9 >= reach);
        let distance2 = |o: &Corner| {
            let dx = i32::from(o.point.x) - i32::from(c.point.x);
            let dy = i32::from(o.point.y) - i32::from(c.point.y);
            (dx * dx).cast_unsigned() + (dy * dy).cast_unsigned()
        };
        c.radius2 = before[..stronger].iter().map(distance2).min().unwrap_or(u32::MAX);
    }
    sort_by_key(corners, |c| (Reverse(c.radius2), by_strength(c)));
    stats.dropped += count(corners.len().saturating_sub(limit));
    corners.truncate(limit);
    stats.kept = count(corners.len());
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
        let mut scratch = std::vec![0; SCRATCH_ROWS * w];
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
        assert_eq!(strength(9, 0, 4), 8);
        assert_eq!(strength(10, 10, 10), 0);
        assert_eq!(strength(5, 2, 2), 2 /* eigenvalues 6 and 1 */);
        let most = 9 * 1020 * 1020;
        assert_eq!(strength(most, 0, most), 2 * most);
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
        let mut scratch = std::vec![0; SCRATCH_ROWS * w];
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

    #[test]
    fn suppression_radius_spreads_the_corners() {
        let corner = |x, y, strength| Corner { point: Point::new(x, y), strength, radius2: 0 };
        let mut c: Vec<Corner, 8> =
            Vec::from_slice(&[corner(0, 0, 100), corner(16, 0, 80), corner(32, 0, 85), corner(800, 0, 10)]).unwrap();
        let mut stats = StageStats::default();
        rank_by_radius(&mut c, 3, &mut stats);
        assert_eq!(c.iter().map(|c| c.point.x).collect::<std::vec::Vec<_>>(), [0, 800, 32]);
        assert_eq!((stats.kept, stats.dropped), (3, 1));
    }
}
