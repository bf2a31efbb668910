//! Scaling pictures down before they are looked at.
//!
//! In: interleaved bytes, one or more a pixel. Out: a smaller picture in the
//! caller's buffer, each pixel the mean of the area that it covers (so that
//! nothing aliases), in integers. Memory: none. Cost: one pass over the source.

/// Scales `source`, of `from` (width, height) px with `C` bytes a pixel, down to
/// `to` px.
///
/// # Panics
/// When a buffer is shorter than its size says, or `to` has a zero side.
pub fn shrink<const C: usize>(source: &[u8], from: (usize, usize), target: &mut [u8], to: (usize, usize)) {
    let rows = target[..to.0 * to.1 * C].as_chunks_mut::<C>().0.chunks_exact_mut(to.0);
    for (y, row) in rows.enumerate() {
        let (y0, y1) = span(y, from.1, to.1);
        for (x, pixel) in row.iter_mut().enumerate() {
            let (x0, x1) = span(x, from.0, to.0);
            let columns = x0 >> 8..(x1 + 255) >> 8;
            let mut sums = [0u64; C];
            for sy in y0 >> 8..(y1 + 255) >> 8 {
                let line = source[sy * from.0 * C..][..from.0 * C].as_chunks::<C>().0;
                let part = weighted(&line[columns.clone()], columns.start, x0, x1);
                let wy = u64::from(covered(sy, y0, y1));
                for (s, p) in sums.iter_mut().zip(part) {
                    *s += wy * u64::from(p);
                }
            }
            let weight = (x1 - x0) as u64 * (y1 - y0) as u64;
            *pixel = sums.map(|s| u8::try_from((s + weight / 2) / weight).unwrap_or(u8::MAX));
        }
    }
}

/// Sum of a run of pixels, the first and the last by how much of them lies between
/// `x0` and `x1`.
fn weighted<const C: usize>(run: &[[u8; C]], start: usize, x0: usize, x1: usize) -> [u32; C] {
    let mut inner = [0u32; C];
    let mut sums = [0u32; C];
    let last = run.len() - 1;
    for p in &run[1.min(last)..last] {
        for (s, &v) in inner.iter_mut().zip(p) {
            *s += u32::from(v);
        }
    }
    let ends: &[usize] = if last == 0 { &[0] } else { &[0, last] };
    for &i in ends {
        let w = covered(start + i, x0, x1);
        for (s, &v) in sums.iter_mut().zip(&run[i]) {
            *s += w * u32::from(v);
        }
    }
    for (s, i) in sums.iter_mut().zip(inner) {
        *s += 256 * i;
    }
    sums
}

/// What pixel `i` of `to` covers of `from`, in 1/256 px.
const fn span(i: usize, from: usize, to: usize) -> (usize, usize) {
    (edge(i, from, to), edge(i + 1, from, to))
}

/// In 64 bits: 1280 px of a panorama of 14,000 would overflow 32.
#[allow(clippy::cast_possible_truncation, reason = "at most 256 times `from`")]
const fn edge(i: usize, from: usize, to: usize) -> usize {
    (i as u64 * from as u64 * 256 / to as u64) as usize
}

/// How much of pixel `i` lies between `a` and `b`, in 1/256 px.
#[allow(clippy::cast_possible_truncation, reason = "at most 256")]
fn covered(i: usize, a: usize, b: usize) -> u32 {
    (b.min((i + 1) << 8) - a.max(i << 8)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_means_of_what_they_cover() {
        let mut out = [0; 2];
        shrink::<1>(&[10, 20, 30, 50], (2, 2), &mut out, (1, 1));
        assert_eq!(out[0], 28);
        // Three pixels into two: each covers one and a half.
        shrink::<1>(&[0, 90, 240], (3, 1), &mut out, (2, 1));
        assert_eq!(out, [30, 190]);
    }

    #[test]
    fn channels_stay_apart_and_equal_size_copies() {
        let source = [1, 200, 3, 4, 5, 60];
        let mut out = [0; 6];
        shrink::<3>(&source, (2, 1), &mut out, (2, 1));
        assert_eq!(out, source);
    }
}
