//! Computes the strengths of corners and their peaks, row by row.
//!
//! In: rows of luma. Out: rows of sums, rows of strengths, and the peaks of a row. A [`Pass`] is a
//! way to compute them: side by side, where the target has vectors, or one by one. Both passes
//! give the same corners. `corners` gives the formula and its source.
//!
//! Memory: what the caller lends. Cost: some 100 operations a pixel.

use crate::base::math::{self, max, min};

/// Returns twice the smaller eigenvalue of `[[a, b], [b, c]]`. The error is at most a millionth of
/// the larger eigenvalue.
#[must_use]
pub fn strength(a: f32, b: f32, c: f32) -> f32 {
    let (d, e) = (a - c, 2.0 * b);
    let v = a + c - math::inline_sqrt(d * d + e * e);
    if v > 0.0 { v } else { 0.0 }
}

/// Returns the row or column that stands for `i` where the border mirrors: 1 for -1, `n - 2` for
/// `n`.
pub(crate) const fn mirror(i: isize, n: usize) -> usize {
    let n = n.cast_signed();
    let i = if i < 0 { -i } else { i };
    (if i >= n { 2 * n - 2 - i } else { i }).cast_unsigned()
}

/// Writes the products `dx dx`, `dx dy`, `dy dy` of the Sobel derivatives of the middle row.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn products([top, mid, low]: [&[u8]; 3], [xx, xy, yy]: &mut [&mut [f32]; 3]) {
    let n = mid.len() - 2;
    // Each pixel and its neighbours are slices of one length, so that no bounds are checked.
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

/// Writes the sums over each pixel and its two neighbours in the row.
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

/// Writes, for each pixel of the middle row, the sums over the pixel and its two neighbours of the
/// products `dx dx`, `dy dy`, `dx dy`. The pixels are computed one by one. What a column adds is
/// kept for the next two pixels.
fn sums_one_by_one([top, mid, low]: [&[u8]; 3], out: &mut [f32]) {
    let (out, _) = out.as_chunks_mut::<3>();
    let n = mid.len();
    // A column adds these two sums to the derivatives along and across the row.
    let sums = |[t, m, l]: [i32; 3]| (t + 2 * m + l, l - t);
    let column = |x: usize| sums([top[x], mid[x], low[x]].map(i32::from));
    let product = |dx: i32, dy: i32| {
        let (dx, dy) = (dx as f32, dy as f32);
        [dx * dx, dy * dy, dx * dy]
    };
    let plus = |a: [f32; 3], b: [f32; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let [(first, slope), second, third] = [0, 1, 2].map(column);
    // Borders mirror: the first pixel has the second pixel on both sides.
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
    // Two pixels at a time: fewer values are moved between variables.
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

/// Number of values that are processed together.
pub(crate) const LANES: usize = 8;

/// Computes the strengths of a row from the sums in the rows around it. A strength below `cut` may
/// be written as 0. Returns the greatest strength.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn strengths(sums: [&[f32]; 3], cut: f32, out: &mut [f32]) -> f32 {
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

/// Does the work of [`strengths`] on sums that [`sums_one_by_one`] has made.
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

/// A way to compute the rows of an image. Both ways give the same corners.
pub(crate) trait Pass {
    /// Sums over each pixel of the middle row and its neighbours of the products of derivatives:
    /// three rows in `out`, in an order of the pass's own. `raw` is scratch.
    fn sum(around: [&[u8]; 3], raw: &mut [&mut [f32]; 3], out: &mut [f32]);

    /// Strengths of a row from the sums in the rows around it; a strength below `cut` may be 0.
    /// Returns the maximum.
    fn strengths(sums: [&[f32]; 3], cut: f32, out: &mut [f32]) -> f32;

    /// Calls `found` with each pixel of the middle row, but for `margin` at both ends, whose
    /// strength no neighbour exceeds; of equals the first in reading order.
    fn each_peak(around: [&[f32]; 3], margin: usize, found: impl FnMut(usize));
}

/// The pass of targets with vectors: loops over pixels side by side.
pub(crate) struct SideBySide;

impl Pass for SideBySide {
    fn sum(around: [&[u8]; 3], raw: &mut [&mut [f32]; 3], out: &mut [f32]) {
        products(around, raw);
        for (p, s) in raw.iter().zip(out.chunks_exact_mut(raw[0].len())) {
            sum3(p, s);
        }
    }

    fn strengths(sums: [&[f32]; 3], cut: f32, out: &mut [f32]) -> f32 {
        strengths(sums, cut, out)
    }

    fn each_peak(around: [&[f32]; 3], margin: usize, mut found: impl FnMut(usize)) {
        let w = around[1].len();
        for first in (margin..w - margin).step_by(STRIP) {
            let mut peaks = [0; STRIP];
            let end = (first + STRIP).min(w - margin);
            find_peaks(around.map(|row| &row[first - 1..=end]), &mut peaks);
            for (words, word) in peaks.as_chunks().0.iter().enumerate() {
                let mut word = u64::from_le_bytes(*word);
                while word != 0 {
                    found(first + LANES * words + word.trailing_zeros() as usize / 8);
                    word &= word - 1;
                }
            }
        }
    }
}

/// The pass of targets without vectors: one pixel after the other, and no work for what cannot
/// be a corner.
pub(crate) struct OneByOne;

impl Pass for OneByOne {
    fn sum(around: [&[u8]; 3], _: &mut [&mut [f32]; 3], out: &mut [f32]) {
        sums_one_by_one(around, out);
    }

    fn strengths(sums: [&[f32]; 3], cut: f32, out: &mut [f32]) -> f32 {
        strengths_one_by_one(sums.map(|s| s.as_chunks().0), cut, out)
    }

    fn each_peak(around: [&[f32]; 3], margin: usize, mut found: impl FnMut(usize)) {
        let [left, here, right] = beside(around);
        let (mut x, end) = (margin - 1, around[1].len() - 1 - margin);
        // Most strengths are 0.
        while let Some(next) = here[1][x.min(end)..end].iter().position(|v| v.to_bits() != 0) {
            x += next;
            let v = here[1][x];
            // A pixel that does not exceed the pixel before it is no peak and is skipped.
            let falls = v >= right[1][x];
            let across = || v > here[0][x] && v >= here[2][x];
            let aslant = || v > left[0][x] && v > right[0][x] && v >= left[2][x] && v >= right[2][x];
            if falls && v > left[1][x] && across() && aslant() {
                found(x + 1);
            }
            x += 1 + usize::from(falls);
        }
    }
}

/// Number of pixels of a row that are tested for peaks together.
const STRIP: usize = 16 * LANES;

/// Writes 1 for each pixel of the middle row that is a peak, and 0 for each other pixel. A peak is
/// a pixel whose strength no neighbour exceeds. Of equal neighbours only the first in reading order
/// is a peak. The first and the last pixel of the row are not tested.
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

/// Returns the rows from their first, from their second and from their third pixel on. At one index
/// these hold the left neighbour of a pixel, the pixel, and its right neighbour.
fn beside(rows: [&[f32]; 3]) -> [[&[f32]; 3]; 3] {
    let n = rows[1].len() - 2;
    [0, 1, 2].map(|d| rows.map(|row| &row[d..][..n]))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    #[test]
    fn strength_is_the_smaller_eigenvalue_doubled() {
        for (a, b, c, want) in [(9.0, 0.0, 4.0, 8.0), (10.0, 10.0, 10.0, 0.0), (5.0, 2.0, 2.0, 2.0 /* of 6 and 1 */)] {
            let got = strength(a, b, c);
            assert!((got - want).abs() < 1e-3, "{got} for {want}");
        }
        let most = 9.0 * 1020.0 * 1020.0;
        assert_eq!(strength(most, 0.0, most), 2.0 * most);
    }

    /// A texture with edges, flat parts and equal neighbours.
    pub(crate) fn texture(w: usize, h: usize, seed: u32) -> std::vec::Vec<u8> {
        let noise = |x: usize, y: usize| ((x * 31 + y * 57) as u32 + seed).wrapping_mul(2_654_435_761) >> 24;
        let value = |x: usize, y: usize| match (x / 8 + y / 6) % 3 {
            0 => 90,
            1 => noise(x / 3, y / 3) as u8,
            _ => noise(x, y) as u8,
        };
        (0..w * h).map(|i| value(i % w, i / w)).collect()
    }

    /// The strength of every pixel, from the definition, without a threshold.
    fn naive_strengths(data: &[u8], w: usize, h: usize) -> std::vec::Vec<f64> {
        let at = |x: isize, y: isize| i64::from(data[mirror(y, h) * w + mirror(x, w)]);
        let derivatives = |x: isize, y: isize| {
            let (x, y) = (mirror(x, w).cast_signed(), mirror(y, h).cast_signed());
            let smooth = |v: [i64; 3]| v[0] + 2 * v[1] + v[2];
            let dx = smooth([-1, 0, 1].map(|d| at(x + 1, y + d) - at(x - 1, y + d)));
            let dy = smooth([-1, 0, 1].map(|d| at(x + d, y + 1) - at(x + d, y - 1)));
            [dx * dx, dx * dy, dy * dy]
        };
        let strength = |i: usize| {
            let (x, y) = ((i % w).cast_signed(), (i / w).cast_signed());
            let mut sums = [0; 3];
            for d in 0..9 {
                let products = derivatives(x + d % 3 - 1, y + d / 3 - 1);
                sums.iter_mut().zip(products).for_each(|(s, p)| *s += p);
            }
            let [a, b, c] = sums.map(|s| s as f64);
            a + c - ((a - c) * (a - c) + 4.0 * b * b).sqrt()
        };
        (0..w * h).map(strength).collect()
    }

    /// Miri takes a thousand times as long.
    pub(crate) const SIZES: &[(usize, usize)] =
        if cfg!(miri) { &[(17, 9)] } else { &[(17, 9), (64, 48), (140, 30), (150, 40), (5, 60), (3, 3)] };

    #[test]
    fn both_passes_compute_the_strengths_of_the_definition() {
        for &(w, h) in SIZES {
            let data = texture(w, h, 3);
            let want = naive_strengths(&data, w, h);
            check_strengths::<SideBySide>(&data, w, h, &want);
            check_strengths::<OneByOne>(&data, w, h, &want);
        }
    }

    fn check_strengths<P: Pass>(data: &[u8], w: usize, h: usize, want: &[f64]) {
        let mut raw = [(); 3].map(|()| std::vec![0.0; w]);
        let mut sums = std::vec![std::vec![0.0; 3 * w]; h];
        for (y, sums) in sums.iter_mut().enumerate() {
            let around = [-1, 0, 1].map(|d| &data[mirror(y.cast_signed() + d, h) * w..][..w]);
            P::sum(around, &mut raw.each_mut().map(|row| &mut row[..]), sums);
        }
        for y in 0..h {
            let mut out = std::vec![0.0; w];
            let around = [-1, 0, 1].map(|d| &sums[mirror(y.cast_signed() + d, h)][..]);
            let most = P::strengths(around, 0.0, &mut out);
            assert_eq!(most, out.iter().fold(0.0, |m, &v| max(m, v)));
            for (x, v) in out.iter().enumerate() {
                let want = want[y * w + x];
                // The square root is good to a millionth of the larger eigenvalue.
                let larger = 9.0 * 1020.0 * 1020.0 * 2.0;
                assert!((f64::from(*v) - want).abs() <= 1e-6 * larger, "{w}x{h}, ({x}, {y}): {v} for {want}");
            }
        }
    }

    #[test]
    fn peaks_are_those_that_no_neighbour_exceeds() {
        let (w, margin) = (150, 2);
        let rows = [0, 1, 2].map(|r| -> std::vec::Vec<f32> {
            let value = |x: usize| f32::from(texture(w, 3, 9)[r * w + x] / 60 * 60);
            (0..w).map(value).collect()
        });
        let around = rows.each_ref().map(|row| &row[..]);
        let want: std::vec::Vec<usize> = (margin..w - margin)
            .filter(|&x| {
                let v = rows[1][x];
                let before = [rows[0][x - 1], rows[0][x], rows[0][x + 1], rows[1][x - 1]];
                let after = [rows[1][x + 1], rows[2][x - 1], rows[2][x], rows[2][x + 1]];
                v > 0.0 && before.iter().all(|&b| v > b) && after.iter().all(|&a| v >= a)
            })
            .collect();
        assert!(!want.is_empty());
        let (mut side, mut one) = (std::vec::Vec::new(), std::vec::Vec::new());
        SideBySide::each_peak(around, margin, |x| side.push(x));
        OneByOne::each_peak(around, margin, |x| one.push(x));
        assert_eq!(side, want);
        assert_eq!(one, want);
    }
}
