//! Scaling pictures down before they are looked at.
//!
//! In: interleaved bytes of any number of channels. Out: a smaller picture in the
//! caller's buffer, each pixel the mean of the area that it covers (so that
//! nothing aliases), in integers. Memory: none. Cost: one pass over the source.

/// Scales `source`, of `from` (width, height) px and `channels` bytes a pixel,
/// down to `to` px.
///
/// # Panics
/// When a buffer is shorter than its size says, or `to` has a zero side.
pub fn shrink(source: &[u8], channels: usize, from: (usize, usize), target: &mut [u8], to: (usize, usize)) {
    let rows = target[..to.0 * to.1 * channels].chunks_exact_mut(to.0 * channels);
    for (y, row) in rows.enumerate() {
        let (y0, y1) = span(y, from.1, to.1);
        for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let (x0, x1) = span(x, from.0, to.0);
            for (c, o) in pixel.iter_mut().enumerate() {
                let mut sum = 0u64;
                let mut weight = 0u64;
                for sy in y0 >> 8..(y1 + 255) >> 8 {
                    let wy = covered(sy, y0, y1);
                    let line = &source[sy * from.0 * channels..];
                    for sx in x0 >> 8..(x1 + 255) >> 8 {
                        let w = wy * covered(sx, x0, x1);
                        sum += w * u64::from(line[sx * channels + c]);
                        weight += w;
                    }
                }
                *o = u8::try_from((sum + weight / 2) / weight).unwrap_or(u8::MAX);
            }
        }
    }
}

/// What pixel `i` of `to` covers of `from`, in 1/256 px.
const fn span(i: usize, from: usize, to: usize) -> (usize, usize) {
    (i * from * 256 / to, (i + 1) * from * 256 / to)
}

/// How much of pixel `i` lies between `a` and `b`, in 1/256 px.
fn covered(i: usize, a: usize, b: usize) -> u64 {
    (b.min((i + 1) << 8) - a.max(i << 8)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_means_of_what_they_cover() {
        let mut out = [0; 2];
        shrink(&[10, 20, 30, 50], 1, (2, 2), &mut out, (1, 1));
        assert_eq!(out[0], 28);
        // Three pixels into two: each covers one and a half.
        shrink(&[0, 90, 240], 1, (3, 1), &mut out, (2, 1));
        assert_eq!(out, [30, 190]);
    }

    #[test]
    fn channels_stay_apart_and_equal_size_copies() {
        let source = [1, 200, 3, 4, 5, 60];
        let mut out = [0; 6];
        shrink(&source, 3, (2, 1), &mut out, (2, 1));
        assert_eq!(out, source);
    }
}
