//! Corner chrominance: what lies inside a keygraph, in 12 segments.
//!
//! In: the pyramid and three vertices in canonical order. Out: up to 36 bytes.
//! At each vertex, the points at a third of both adjacent edges are joined; four
//! segments run from the vertex to that line, ending at (s + 1/2)/4 of it; a
//! component is the mean of the pixels on a segment (paper, section 3.3). Luma
//! comes first (12 bytes), then chroma (12 pairs).
//!
//! The paper takes chroma as it is. [`Normalise::Own`] takes the keygraph's own
//! mean away and divides by its own spread, luma and chroma each, which survives
//! other cameras and lamps; a spread below a floor counts as that floor, so that
//! flat regions give small numbers and not amplified noise.
//!
//! Each segment is sampled at [`SAMPLES`] points, in the pyramid level whose
//! pixels are about as far apart as the samples. Memory: none. Cost: 48 samples
//! of luma and as many of chroma a keygraph.

use crate::capacity::{FEATURE_BYTES, LEVELS};
use crate::frame::NO_CHROMA;
use crate::geometry::Point;
use crate::math;
use crate::pyramid::PyramidView;

/// Segments of a keygraph: four at each of its three corners.
pub const SEGMENTS: usize = 12;
/// Samples on a segment.
pub const SAMPLES: i32 = 4;
/// The byte that stands for zero.
pub const ZERO: u8 = 128;
/// Steps of one spread.
const STEPS: f32 = 40.0;
/// Least spread of luma, gray levels, and of chroma, 1/127 of full saturation.
const LUMA_FLOOR: f32 = 3.0;
const CHROMA_FLOOR: f32 = 4.0;

/// What a feature is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeatureKind {
    /// 24 bytes of chroma.
    Chroma,
    /// 12 bytes of luma, for cameras without colour.
    Luma,
    /// 12 bytes of luma, then 24 of chroma.
    Both,
}

impl FeatureKind {
    /// Bytes of a feature.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Chroma => 2 * SEGMENTS,
            Self::Luma => SEGMENTS,
            Self::Both => 3 * SEGMENTS,
        }
    }

    /// The name used in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chroma => "chroma",
            Self::Luma => "luma",
            Self::Both => "both",
        }
    }
}

/// What is taken away from the means before they become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Normalise {
    /// Nothing: the paper.
    Absolute,
    /// The keygraph's own mean and spread.
    Own,
}

/// Bytes of one feature, as many as its kind has.
pub type Feature = [u8; FEATURE_BYTES];

/// The feature of the keygraph on `points`, in canonical order, found in
/// `level` of `view`. `size` is [`crate::keygraph::Keygraph::size`].
#[must_use]
pub fn extract(
    view: &PyramidView<'_>,
    level: usize,
    points: [Point; 3],
    size: u8,
    kind: FeatureKind,
    normalise: Normalise,
) -> Feature {
    let mut out = [ZERO; FEATURE_BYTES];
    let at = sample_level(level, size);
    let bundle = Bundle { points };
    let chroma_at = match kind {
        FeatureKind::Chroma => 0,
        FeatureKind::Luma => FEATURE_BYTES,
        FeatureKind::Both => SEGMENTS,
    };
    if kind != FeatureKind::Chroma {
        let means = luma_means(view, level, at, &bundle);
        write(&means, normalise, LUMA_FLOOR, &mut out[..SEGMENTS]);
    }
    if kind != FeatureKind::Luma {
        let means = chroma_means(view, level, at.saturating_sub(1), &bundle);
        write_chroma(means, normalise, &mut out[chroma_at..chroma_at + 2 * SEGMENTS]);
    }
    out
}

/// The level whose pixels are about as far apart as the samples are in `level`.
fn sample_level(level: usize, size: u8) -> usize {
    // A segment is about 1/3.5 of the longest side: a sample step is 1/14 of it.
    const STEP: u8 = 61; // 16 log2 14
    let above = usize::from(size.saturating_sub(STEP + 8 - 16) / 16);
    (level + above).min(LEVELS - 1)
}

/// The sample positions of a keygraph.
struct Bundle {
    points: [Point; 3],
}

impl Bundle {
    /// Calls `sample(segment, x, y)`, coordinates in 1/16 px plus half a pixel,
    /// so that shifting right by four gives the pixel.
    fn each(&self, mut sample: impl FnMut(usize, i32, i32)) {
        for corner in 0..3 {
            let [v, u, w] = [0, 1, 2].map(|k| {
                let p = self.points[(corner + k) % 3];
                (i32::from(p.x), i32::from(p.y))
            });
            for s in 0..4 {
                let (near, far) = (7 - 2 * s, 2 * s + 1);
                // 24 times the segment.
                let dx = (u.0 - v.0) * near + (w.0 - v.0) * far;
                let dy = (u.1 - v.1) * near + (w.1 - v.1) * far;
                let segment = 4 * corner + usize::try_from(s).unwrap_or(0);
                for k in 0..SAMPLES {
                    // 341 / 65536 = 1 / (24 * 2 * SAMPLES)
                    let along = |d: i32| (d * (2 * k + 1) * 341) >> 16;
                    sample(segment, v.0 + along(dx) + 8, v.1 + along(dy) + 8);
                }
            }
        }
    }
}

fn luma_means(view: &PyramidView<'_>, level: usize, at: usize, bundle: &Bundle) -> [f32; SEGMENTS] {
    let plane = view.luma(at);
    let shift = 4 + at - level;
    let mut sums = [0i32; SEGMENTS];
    bundle.each(|s, x, y| sums[s] += i32::from(plane.nearest(x >> shift, y >> shift)));
    sums.map(|s| s as f32 / SAMPLES as f32)
}

/// Mean chroma of each segment; `None` where it has none.
fn chroma_means(view: &PyramidView<'_>, level: usize, at: usize, bundle: &Bundle) -> [Option<[f32; 2]>; SEGMENTS] {
    let [a, b] = view.chroma(at);
    let shift = 5 + at - level;
    let mut sums = [(0i32, 0i32, 0i32); SEGMENTS];
    bundle.each(|s, x, y| {
        let (x, y) = (x >> shift, y >> shift);
        let va = a.nearest(x, y);
        if va != NO_CHROMA {
            sums[s].0 += i32::from(va);
            sums[s].1 += i32::from(b.nearest(x, y));
            sums[s].2 += 1;
        }
    });
    sums.map(|(a, b, n)| (n > 0).then(|| [a as f32 / n as f32, b as f32 / n as f32]))
}

fn write(means: &[f32], normalise: Normalise, floor: f32, out: &mut [u8]) {
    let n = means.len() as f32;
    let (mean, scale) = match normalise {
        Normalise::Absolute => (f32::from(ZERO), 1.0),
        Normalise::Own => {
            let mean = means.iter().sum::<f32>() / n;
            let spread2 = means.iter().map(|m| (m - mean) * (m - mean)).sum::<f32>() / n;
            (mean, STEPS / math::sqrt(spread2).max(floor))
        }
    };
    for (o, m) in out.iter_mut().zip(means) {
        *o = byte((m - mean) * scale);
    }
}

fn write_chroma(means: [Option<[f32; 2]>; SEGMENTS], normalise: Normalise, out: &mut [u8]) {
    let known = || means.iter().flatten();
    let n = (known().count() as f32).max(1.0);
    let (mean, scale) = match normalise {
        Normalise::Absolute => ([0.0; 2], 1.0),
        Normalise::Own => {
            let mean = [0, 1].map(|i| known().map(|m| m[i]).sum::<f32>() / n);
            let spread2 = known().map(|m| [0, 1].map(|i| (m[i] - mean[i]) * (m[i] - mean[i])));
            let spread2 = spread2.map(|[a, b]| a + b).sum::<f32>() / (2.0 * n);
            (mean, STEPS / math::sqrt(spread2).max(CHROMA_FLOOR))
        }
    };
    for (o, m) in out.chunks_exact_mut(2).zip(&means) {
        if let Some(m) = m {
            o[0] = byte((m[0] - mean[0]) * scale);
            o[1] = byte((m[1] - mean[1]) * scale);
        }
    }
}

fn byte(v: f32) -> u8 {
    u8::try_from(i32::from(ZERO) + math::round(v).clamp(-127, 127)).unwrap_or(ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Frame, PixelFormat};
    use crate::pyramid::Pyramid;

    type Small = Pyramid<{ 64 * 64 * 2 }, { 32 * 32 * 2 }>;

    /// A frame that is dark and blue on the left of `x = 32`, bright and red on
    /// its right, seen through a gain.
    fn picture(gain: f32) -> std::boxed::Box<Small> {
        let rgb: std::vec::Vec<u8> = (0..64 * 64)
            .flat_map(|i| if i % 64 < 32 { [60.0, 60.0, 120.0] } else { [200.0, 80.0, 60.0] })
            .map(|v: f32| (v * gain) as u8)
            .collect();
        let mut p = std::boxed::Box::new(Small::new());
        p.load(&Frame::new(PixelFormat::Rgb8, 64, 64, &rgb).unwrap()).unwrap();
        p.reduce();
        p
    }

    const TRIANGLE: [Point; 3] =
        [Point::new(8 * 16, 10 * 16), Point::new(56 * 16, 14 * 16), Point::new(30 * 16, 50 * 16)];

    fn feature(p: &Small, t: [Point; 3], normalise: Normalise) -> Feature {
        extract(&p.view(), 0, t, 90, FeatureKind::Both, normalise)
    }

    #[test]
    fn segments_see_their_own_side_of_the_picture() {
        let f = feature(&picture(1.0), TRIANGLE, Normalise::Own);
        assert!(f[0..4].iter().all(|&v| v < ZERO), "first corner lies in the dark: {f:?}");
        assert!(f[4..8].iter().all(|&v| v > ZERO), "second corner lies in the light: {f:?}");
        assert!(f[12] < ZERO && f[20] > ZERO, "blue against red: {f:?}");
    }

    #[test]
    fn gain_changes_luma_means_but_not_the_normalised_feature() {
        let (f, g) = (picture(1.0), picture(0.7));
        let distance = |n| {
            let (f, g) = (feature(&f, TRIANGLE, n), feature(&g, TRIANGLE, n));
            f.iter().zip(&g).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>()
        };
        assert!(distance(Normalise::Own) < 36, "{}", distance(Normalise::Own));
        assert!(distance(Normalise::Absolute) > 200, "{}", distance(Normalise::Absolute));
    }

    #[test]
    fn flat_regions_give_zeros_and_the_edge_of_the_frame_is_safe() {
        let p = picture(1.0);
        let flat = [Point::new(0, 0), Point::new(16 * 20, 0), Point::new(0, 16 * 25)];
        assert_eq!(feature(&p, flat, Normalise::Own), [ZERO; 36]);
        let far = [Point::new(0, 0), Point::new(i16::MAX, 0), Point::new(5, i16::MAX)];
        let _ = feature(&p, far, Normalise::Own);
    }
}
