//! Finds Shi-Tomasi corners ("good features to track"), row by row.
//!
//! In: a luma plane. Out: corners in 1/16 px, in no particular order.
//!
//! The strength of a pixel is twice the smaller eigenvalue of `[[a, b], [b, c]]`, which is
//! `a + c - sqrt((a - c)^2 + 4 b^2)` (J. Shi, C. Tomasi, *Good Features to Track*, CVPR 1994). `a`,
//! `b` and `c` are sums over the 3x3 block of the pixel of products of 3x3 Sobel derivatives. The
//! sums are integers below 2^24, which `f32` holds exactly. `f32` is used because the vector units
//! of all processors multiply it.
//!
//! Borders mirror without repeating the edge. The outermost pixels hold no corner. A corner is a
//! pixel that no neighbour exceeds, as in OpenCV's `goodFeaturesToTrack`. A parabola through the
//! strengths beside a corner then refines its place. Strengths below the threshold reached so far
//! count as 0 for it.
//!
//! Memory: [`SCRATCH_ROWS`] rows of `f32` and 12 bytes a candidate. Cost: one pass over the pixels,
//! with some 100 operations a pixel, written so that compilers make vectors of them. Full: the
//! weaker half of the candidates is dropped and counted, and the threshold rises to the weakest
//! strength that is left.

use heapless::VecView;

use crate::base::capacity::{StageStats, count};
use crate::base::geometry::Point;
use crate::base::math::{ROWS, max};
use crate::base::pace::Pace;
use crate::base::sort::sort_by_key;
use crate::extract::strength::{OneByOne, Pass, SideBySide, mirror};
use crate::image::plane::Plane;

/// Number of rows of `f32` that [`detect_corners`] works in. Each row is as long as the image is
/// wide.
pub const SCRATCH_ROWS: usize = 15;

/// A corner of one pyramid level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Corner {
    /// Position in its level, 1/16 px.
    pub point: Point,
    /// Twice the smaller eigenvalue of the integer structure tensor.
    pub strength: i32,
    /// Squared distance to the nearest clearly stronger corner, in (1/16 px)^2. It is 0 until
    /// [`rank`](crate::extract::rank) has set it.
    pub radius2: u32,
}

/// Thresholds of the corner detector.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CornerParams {
    /// Minimum strength as a fraction of the strength of the strongest corner, in 1/65536. This is
    /// OpenCV's `qualityLevel`, usually 0.01 (655). Raising it loses corners in the duller parts of
    /// a frame.
    pub quality_q16: u32,
    /// Minimum strength, whatever the strongest corner is. Below it noise makes corners. 20,000 is
    /// the strength of the corner of a step of about 12 gray levels.
    pub floor: i32,
    /// Minimum distance of a corner from the edge, px; at least 1. Nearer corners are left out.
    pub margin_px: usize,
}

/// Finds the corners of `luma` and writes them into `out` in no particular order. The next step is
/// to rank them. When it is told to stop, it keeps what it has found.
///
/// `scratch` needs [`SCRATCH_ROWS`] times the width of `luma`. `out` is cleared first. Its capacity
/// is the maximum number of candidates.
///
/// # Panics
/// Panics when `scratch` is too short, or when a side of the image is shorter than 3 px.
pub fn detect_corners(
    luma: Plane<'_, u8>,
    params: &CornerParams,
    scratch: &mut [f32],
    out: &mut VecView<Corner>,
    pace: &mut dyn Pace,
) -> StageStats {
    if ROWS {
        detect_by::<SideBySide>(luma, params, scratch, out, pace)
    } else {
        detect_by::<OneByOne>(luma, params, scratch, out, pace)
    }
}

/// The corners found so far, and the strength that further ones need.
struct Kept<'a> {
    out: &'a mut VecView<Corner>,
    stats: StageStats,
    cut: f32,
}

impl Kept<'_> {
    /// Takes the peak at `x` of the middle row, which is row `y`, if it is strong enough. A full
    /// buffer makes room first.
    fn take(&mut self, around: [&[f32]; 3], x: usize, y: usize, pace: &mut dyn Pace) {
        if (whole(around[1][x]) as f32) < self.cut {
            return;
        }
        self.stats.seen += 1;
        let corner = corner_at(around, x, y);
        if self.out.push(corner).is_err() {
            self.cut = max(self.cut, drop_weaker_half(self.out, &mut self.stats, pace) as f32);
            if (corner.strength as f32) < self.cut || self.out.push(corner).is_err() {
                self.stats.dropped += 1;
            }
        }
    }

    /// Drops the corners that turned out too weak.
    fn finish(mut self) -> StageStats {
        self.out.retain(|c| c.strength as f32 >= self.cut);
        self.stats.kept = count(self.out.len());
        self.stats
    }
}

/// Row by row: sums, strengths, and one row behind them the peaks.
fn detect_by<P: Pass>(
    luma: Plane<'_, u8>,
    params: &CornerParams,
    scratch: &mut [f32],
    out: &mut VecView<Corner>,
    pace: &mut dyn Pace,
) -> StageStats {
    let (w, h) = (luma.width(), luma.height());
    out.clear();
    let mut kept = Kept { out, stats: StageStats::default(), cut: params.floor.max(1) as f32 };
    let mut strongest = 0.0;
    let margin = params.margin_px.max(1);

    let mut rows = scratch[..SCRATCH_ROWS * w].chunks_exact_mut(3 * w);
    let mut take = || rows.next().unwrap_or_default();
    let mut raw = thirds(take());
    // Row y of the sums and of the strengths lies in slot y % 3.
    let sums = [take(), take(), take()];
    let ring = thirds(take());

    let mut next = 0;
    for y in 0..h {
        if !pace.goes_on() {
            break;
        }
        while next <= (y + 1).min(h - 1) {
            let around = [-1, 0, 1].map(|d| luma.row(mirror(next.cast_signed() + d, h)));
            P::sum(around, &mut raw, sums[next % 3]);
            next += 1;
        }
        let sums = [-1, 0, 1].map(|d| &*sums[mirror(y.cast_signed() + d, h) % 3]);
        strongest = max(strongest, P::strengths(sums, kept.cut, ring[y % 3]));
        kept.cut = max(kept.cut, strongest * (params.quality_q16 as f32 / 65536.0));
        if y < margin + 1 || y > h - margin {
            continue;
        }
        let around = [y - 2, y - 1, y].map(|r| &*ring[r % 3]);
        P::each_peak(around, margin, |x| kept.take(around, x, y - 1, pace));
    }
    kept.finish()
}

/// Splits a slice into three rows of equal length.
fn thirds(rows: &mut [f32]) -> [&mut [f32]; 3] {
    let (a, rest) = rows.split_at_mut(rows.len() / 3);
    let (b, c) = rest.split_at_mut(a.len());
    [a, b, c]
}

/// Returns a strength as the integer that a [`Corner`] holds.
#[allow(clippy::cast_possible_truncation, reason = "strengths are below 2^25")]
const fn whole(strength: f32) -> i32 {
    strength as i32
}

/// Returns the corner at column `x` of the middle row, which is row `y` of the image. The pixel
/// must be a local maximum.
fn corner_at([top, mid, low]: [&[f32]; 3], x: usize, y: usize) -> Corner {
    let at = |i: usize, d: i16| i16::try_from(i).unwrap_or(i16::MAX / 16).saturating_mul(16).saturating_add(d);
    let point = Point::new(at(x, vertex(mid[x - 1], mid[x], mid[x + 1])), at(y, vertex(top[x], mid[x], low[x])));
    Corner { point, strength: whole(mid[x]), radius2: 0 }
}

/// Returns where the parabola through `l`, `v`, `r` at -1, 0, 1 has its top, in 1/16 px. The result
/// is within half a pixel.
#[allow(clippy::cast_possible_truncation, reason = "clamped")]
fn vertex(l: f32, v: f32, r: f32) -> i16 {
    let bend = 2.0 * v - l - r;
    if bend > 0.0 { ((r - l) * 8.0 / bend).clamp(-7.0, 7.0) as i16 } else { 0 }
}

/// Keeps the stronger half of the corners. Returns the weakest strength that is left.
fn drop_weaker_half(corners: &mut VecView<Corner>, stats: &mut StageStats, pace: &mut dyn Pace) -> i32 {
    let half = corners.len() / 2;
    if half == 0 {
        return i32::MAX;
    }
    sort_by_key(corners, by_strength, pace);
    stats.dropped += count(corners.len() - half);
    corners.truncate(half);
    corners[half - 1].strength
}

/// Returns a key that sorts the strongest corner first. Of equally strong corners the first in
/// reading order comes first. The key is one number, because sorting mostly compares.
pub(crate) fn by_strength(c: &Corner) -> u64 {
    let [strength, y, x] =
        [c.strength, i32::from(c.point.y), i32::from(c.point.x)].map(i32::cast_unsigned).map(u64::from);
    (u64::from(u32::MAX) - strength) << 32 | y << 16 | x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use crate::extract::strength::tests::{SIZES, texture};
    use heapless::Vec;

    /// Finds the corners of a map of `.` (dark) and `#` (bright), and marks them in the map.
    fn corner_map(picture: &[&str]) -> std::vec::Vec<std::string::String> {
        let (w, h) = (picture[0].len(), picture.len());
        let data: std::vec::Vec<u8> =
            picture.iter().flat_map(|r| r.bytes().map(|b| if b == b'#' { 200 } else { 40 })).collect();
        let mut out: Vec<Corner, 64> = Vec::new();
        let mut scratch = std::vec![0.0; SCRATCH_ROWS * w];
        let params = CornerParams { quality_q16: 655 * 20, floor: 1, margin_px: 1 };
        detect_corners(Plane::new(&data, w, h).unwrap(), &params, &mut scratch, &mut out, &mut Steady);
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
    fn a_full_buffer_keeps_the_strongest_and_counts_the_rest() {
        // The picture has isolated dots. Each dot is brighter than the one before it.
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
            let s = detect_corners(Plane::new(&data, w, h).unwrap(), &params, &mut scratch, out, &mut Steady);
            sort_by_key(out, by_strength, &mut Steady);
            s
        };
        let (mut all, mut few): (Vec<Corner, 256>, Vec<Corner, 8>) = (Vec::new(), Vec::new());
        let (s, t) = (run(&mut all), run(&mut few));
        assert_eq!((s.dropped, s.kept, s.seen), (0, s.seen, s.seen));
        assert!(t.dropped > 0 && t.kept <= 8 && t.kept + t.dropped <= t.seen);
        assert_eq!(few[..], all[..few.len()], "the strongest are kept");
    }

    #[test]
    fn both_passes_find_the_same_corners() {
        for &(w, h) in SIZES {
            for seed in 0..6 {
                let data = texture(w, h, seed);
                for (quality_q16, floor, margin_px) in [(33, 6000, 3), (655, 1, 1), (20_000, 1000, 2)] {
                    let params = CornerParams { quality_q16, floor, margin_px };
                    if w.min(h) <= 2 * margin_px {
                        continue;
                    }
                    let plane = Plane::new(&data, w, h).unwrap();
                    let mut scratch = std::vec![0.0; SCRATCH_ROWS * w];
                    let (mut a, mut b): (Vec<Corner, 60>, Vec<Corner, 60>) = (Vec::new(), Vec::new());
                    let stats = detect_by::<SideBySide>(plane, &params, &mut scratch, &mut a, &mut Steady);
                    assert_eq!(
                        detect_by::<OneByOne>(plane, &params, &mut scratch, &mut b, &mut Steady),
                        stats,
                        "{w}x{h}, {params:?}"
                    );
                    assert_eq!(a, b, "{w}x{h}, {params:?}");
                }
            }
        }
    }
}
