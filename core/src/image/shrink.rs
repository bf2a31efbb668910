//! Scales pictures down before they are analysed.
//!
//! In: interleaved bytes, one or more a pixel. Out: a smaller picture in the caller's buffer. Each
//! pixel is the mean of the area that it covers, so that nothing aliases. The arithmetic uses
//! integers.
//!
//! Memory: 2 KB of stack. Cost: one pass over the source.

use core::ops::Range;

/// Number of column sums that are held at once.
const TILE: usize = 512;

/// Scales `source` down to `to` px. `source` has `from` (width, height) px with `C` bytes a pixel.
///
/// # Panics
/// Panics when a buffer is shorter than its size says, or when `to` has a zero side.
pub fn shrink<const C: usize>(source: &[u8], from: (usize, usize), target: &mut [u8], to: (usize, usize)) {
    let mut tile = [0u32; TILE];
    let rows = target[..to.0 * to.1 * C].as_chunks_mut::<C>().0.chunks_exact_mut(to.0);
    let least = 256 * from.0 / to.0;
    for (row, ys) in rows.zip(spans(from.1, to.1)) {
        let weights = [0, 1].map(|more| Weight::new(least + more, ys.len()));
        let mut pixels = row.iter_mut().zip(spans(from.0, to.0)).peekable();
        let mut sums = [0u64; C];
        for first in (0..from.0).step_by(TILE / C) {
            let end = from.0.min(first + TILE / C);
            let columns = &mut tile[..(end - first) * C];
            sum_columns(source, from.0 * C, first * C, &ys, columns);
            // A pixel that extends into the next tile is finished there.
            while let Some((pixel, xs)) = pixels.peek_mut() {
                add(&mut sums, columns.as_chunks().0, first, xs.start.max(first << 8)..xs.end.min(end << 8));
                if xs.end > end << 8 {
                    break;
                }
                **pixel = weights[xs.len() - least].means(&sums);
                sums = [0; C];
                pixels.next();
            }
        }
    }
}

/// Writes sums of columns of bytes into `out`. The columns start at byte `at` of each row, and a
/// row has `stride` bytes. Each row is weighted by how much of it lies within `ys`, in 1/256 px.
fn sum_columns(source: &[u8], stride: usize, at: usize, ys: &Range<usize>, out: &mut [u32]) {
    out.fill(0);
    for y in ys.start >> 8..ys.end.div_ceil(256) {
        let weight = covered(y, ys);
        for (sum, &v) in out.iter_mut().zip(&source[y * stride + at..]) {
            // The product is at most 256 * 255.
            *sum += u32::from(weight * u16::from(v));
        }
    }
}

/// Adds the columns that lie within `xs` to `sums`. The first of `columns` is column number
/// `first`.
fn add<const C: usize>(sums: &mut [u64; C], columns: &[[u32; C]], first: usize, xs: Range<usize>) {
    for x in xs.start >> 8..xs.end.div_ceil(256) {
        let weight = u64::from(covered(x, &xs));
        for (sum, &v) in sums.iter_mut().zip(&columns[x - first]) {
            *sum += weight * u64::from(v);
        }
    }
}

/// The weight of a pixel, and its reciprocal with 56 bits behind the point, rounded up. Division is
/// slow, and all pixels of a row have one of two weights.
#[derive(Clone, Copy)]
struct Weight {
    weight: u64,
    reciprocal: u64,
}

impl Weight {
    fn new(width: usize, height: usize) -> Self {
        let weight = width as u64 * height as u64;
        Self { weight, reciprocal: (1u64 << 56).div_ceil(weight.max(1)) }
    }

    /// Divides the sums by the weight and rounds to the nearest integer. A sum is at most 255 times
    /// the weight.
    #[allow(clippy::cast_possible_truncation, reason = "means of bytes")]
    fn means<const C: usize>(self, sums: &[u64; C]) -> [u8; C] {
        sums.map(|sum| {
            let sum = sum + self.weight / 2;
            let mean = (sum * self.reciprocal) >> 56;
            // The reciprocal is rounded up, so the mean can be one too large.
            (mean - u64::from(mean * self.weight > sum)) as u8
        })
    }
}

/// Returns the range of `from` pixels that each of `to` pixels covers, in 1/256 px.
fn spans(from: usize, to: usize) -> impl Iterator<Item = Range<usize>> {
    // Edge `i` is the integer part of `256 * from * i / to`.
    let (whole, part) = (256 * from / to, 256 * from % to);
    let (mut start, mut rest) = (0, 0);
    (0..to).map(move |_| {
        rest += part;
        let end = start + whole + usize::from(rest >= to);
        rest -= if rest >= to { to } else { 0 };
        core::mem::replace(&mut start, end)..end
    })
}

/// Returns how much of pixel `i` lies within a span, in 1/256 px.
#[allow(clippy::cast_possible_truncation, reason = "at most 256")]
fn covered(i: usize, span: &Range<usize>) -> u16 {
    (span.end.min((i + 1) << 8) - span.start.max(i << 8)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_means_of_what_they_cover() {
        let mut out = [0; 2];
        shrink::<1>(&[10, 20, 30, 50], (2, 2), &mut out, (1, 1));
        assert_eq!(out[0], 28);
        // Three pixels become two: each covers one and a half.
        shrink::<1>(&[0, 90, 240], (3, 1), &mut out, (2, 1));
        assert_eq!(out, [30, 190]);
    }

    /// Some tiles end within a pixel, and some pixels are wider than a tile.
    #[test]
    fn pixels_wider_than_a_tile_are_means_too() {
        let source: std::vec::Vec<u8> = (0..3 * 1500usize).map(|i| (i * i / 7) as u8).collect();
        let sizes = [1, 2, 7, 400, 1499, 1500];
        for to in if cfg!(miri) { &sizes[..3] } else { &sizes }.iter().copied() {
            let mut out = std::vec![0; 3 * to];
            shrink::<3>(&source, (1500, 1), &mut out, (to, 1));
            for (i, pixel) in out.chunks(3).enumerate() {
                let edge = |i: usize| i * 1500 * 256 / to;
                for (c, &mean) in pixel.iter().enumerate() {
                    let part = |x: usize| edge(i + 1).min((x + 1) * 256).saturating_sub(edge(i).max(x * 256));
                    let sum: usize = (0..1500).map(|x| part(x) * usize::from(source[3 * x + c])).sum();
                    let weight = edge(i + 1) - edge(i);
                    assert_eq!(usize::from(mean), (sum + weight / 2) / weight, "pixel {i} of {to}");
                }
            }
        }
    }

    #[test]
    fn channels_stay_apart_and_equal_size_copies() {
        let source = [1, 200, 3, 4, 5, 60];
        let mut out = [0; 6];
        shrink::<3>(&source, (2, 1), &mut out, (2, 1));
        assert_eq!(out, source);
    }
}
