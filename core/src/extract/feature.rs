//! Describes what a keygraph looks like, in up to 36 bytes that neither light nor pose change.
//!
//! In: the pyramid and three vertices in canonical order. Out: bytes of luma, then pairs of chroma.
//! There are two ways of sampling.
//!
//! [`Sampling::Patch`] is ours. Three vertices are an affine frame: a point given in it is the same
//! point of the object under any turn, scale and tilt. 24 samples of luma and 6 of chroma are taken
//! on rings in and around the triangle. Luma and chroma are normalised separately: their mean is
//! subtracted, and they are divided by their spread. The result is the same with other cameras and
//! lamps. A spread below a floor counts as that floor, so that flat regions give small numbers and
//! not amplified noise.
//!
//! [`Sampling::Segments`] is the paper's corner chrominance (section 3.3). At each vertex a line
//! joins the points at a third of both adjacent edges. Four segments run from the vertex to that
//! line and end at (s + 1/2)/4 of it. A component is the mean of the pixels on a segment, without
//! normalisation.
//!
//! Samples come from the pyramid level whose pixels are about as far apart as the samples are.
//!
//! Memory: none. Cost: 24 bilinear samples of luma and 6 of chroma a keygraph; 48 of each for the
//! paper's sampling.

use crate::base::capacity::{FEATURE_BYTES, LEVELS};
use crate::base::geometry::Point;
use crate::base::math::{self, ROWS};
use crate::image::pixels::NO_CHROMA;
use crate::image::plane::nearest;
use crate::image::pyramid::PyramidView;

/// Number of segments of a keygraph: four at each of its three corners.
pub const SEGMENTS: usize = 12;
/// Number of samples on a segment.
pub const SAMPLES: i32 = 4;
/// The byte that stands for zero.
pub const ZERO: u8 = 128;
/// Number of steps of a byte that one spread covers.
const STEPS: f32 = 40.0;
/// Minimum spread of luma, in gray levels. `CHROMA_FLOOR` is the minimum spread of chroma, in 1/127
/// of full saturation.
const LUMA_FLOOR: f32 = 3.0;
const CHROMA_FLOOR: f32 = 4.0;

/// The planes that a feature is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FeatureKind {
    /// Chroma, as in the paper.
    Chroma,
    /// Luma, for cameras without colour.
    Luma,
    /// Luma, then chroma.
    Both,
}

impl FeatureKind {
    /// Returns the name of the kind in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Chroma => "chroma",
            Self::Luma => "luma",
            Self::Both => "both",
        }
    }
}

/// The places at which a feature is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sampling {
    /// On segments in the corners of the triangle, with absolute values, as in the paper.
    Segments,
    /// In and around the triangle, relative to the mean and the spread of the samples.
    Patch,
}

impl Sampling {
    /// Returns the numbers of bytes of luma and of chroma.
    const fn parts(self, kind: FeatureKind) -> [usize; 2] {
        let [luma, chroma] = match self {
            Self::Segments => [SEGMENTS, 2 * SEGMENTS],
            Self::Patch => [LUMA_POINTS.len(), 2 * CHROMA_POINTS.len()],
        };
        match kind {
            FeatureKind::Chroma => [0, chroma],
            FeatureKind::Luma => [luma, 0],
            FeatureKind::Both => [luma, chroma],
        }
    }

    /// Returns the number of bytes of a feature.
    #[must_use]
    pub const fn bytes(self, kind: FeatureKind) -> usize {
        let [luma, chroma] = self.parts(kind);
        luma + chroma
    }
}

/// Sample points of luma, in the affine frame in which the vertices lie at 0, 120 and 240 degrees
/// on a circle of radius 1. They lie on rings of 5, 9 and 10 points at radii 0.35, 0.8 and 1.25.
#[rustfmt::skip]
const LUMA_POINTS: [[f32; 2]; 24] = [
    [0.325, 0.129], [-0.022, 0.349], [-0.339, 0.087], [-0.188, -0.296], [0.223, -0.270], [0.800, 0.000],
    [0.613, 0.514], [0.139, 0.788], [-0.400, 0.693], [-0.752, 0.274], [-0.752, -0.274], [-0.400, -0.693],
    [0.139, -0.788], [0.613, -0.514], [1.248, 0.078], [0.963, 0.797], [0.311, 1.211], [-0.460, 1.162],
    [-1.055, 0.670], [-1.248, -0.078], [-0.963, -0.797], [-0.311, -1.211], [0.460, -1.162], [1.055, -0.670],
];
/// Sample points of chroma, in the same frame. They lie on rings of 4 and 2 points at radii 1 and
/// 0.35.
const CHROMA_POINTS: [[f32; 2]; 6] =
    [[1.000, 0.000], [0.000, 1.000], [-1.000, 0.000], [0.000, -1.000], [0.206, 0.283], [-0.206, -0.283]];
/// Distance between neighbouring sample points, in radii of the circle through the vertices.
const SPACING: f32 = 0.32;

/// Bytes of one feature. Its kind and its sampling say how many of them are used.
pub type Feature = [u8; FEATURE_BYTES];

/// Returns the feature of the keygraph on `points`. The points are in canonical order and lie in level
/// `level` of `view`. `size` is [`crate::extract::keygraph::Keygraph::size`].
#[must_use]
pub fn extract(
    view: &PyramidView<'_>,
    level: usize,
    points: [Point; 3],
    size: u8,
    kind: FeatureKind,
    sampling: Sampling,
) -> Feature {
    let mut out = [ZERO; FEATURE_BYTES];
    let [n, m] = sampling.parts(kind);
    let (luma, chroma) = out[..n + m].split_at_mut(n);
    match sampling {
        Sampling::Segments => {
            let at = sample_level(level, size);
            let bundle = Bundle { points };
            if n > 0 {
                let means = luma_means(view, level, at, &bundle);
                write_luma(&means, f32::from(ZERO), 1.0, luma);
            }
            if m > 0 {
                write_chroma(&chroma_means(view, level, at.saturating_sub(1), &bundle), [0.0; 2], 1.0, chroma);
            }
        }
        Sampling::Patch => {
            let patch = Patch::new(level, points);
            if n > 0 {
                let mut values = patch.luma(view, false);
                let (mut mean, mut spread) = luma_spread(&values);
                // A place outside the plane gives NaN, which makes the mean NaN.
                if mean.is_nan() {
                    values = patch.luma(view, true);
                    (mean, spread) = luma_spread(&values);
                }
                write_luma(&values, mean, STEPS / spread.max(LUMA_FLOOR), luma);
            }
            if m > 0 {
                let values = patch.chroma(view);
                let (mean, spread) = chroma_spread(&values);
                write_chroma(&values, mean, STEPS / spread.max(CHROMA_FLOOR), chroma);
            }
        }
    }
    out
}

/// Returns one bit for each of the first 24 bytes: whether the byte is above [`ZERO`], the mean.
/// Features that look alike differ in few bits. Counting these is faster than computing a distance.
#[must_use]
pub fn signature(feature: &[u8]) -> u32 {
    feature.iter().take(24).fold(0, |bits, &v| bits << 1 | u32::from(v > ZERO))
}

/// Distance from zero that a byte must exceed to count in a [`sketch`].
const HALF_SPREAD: u8 = 20;

/// Returns which of the last 32 bytes of a feature lie more than half a spread above zero (the low
/// 32 bits), and which lie more than half a spread below (the high 32 bits). The last byte has the
/// lowest bit of each half. Sketches of features that are near each other differ in few bits.
#[must_use]
pub fn sketch(feature: &[u8]) -> u64 {
    let last = &feature[feature.len().saturating_sub(32)..];
    let (below, above) = last.iter().fold((0u32, 0u32), |(below, above), &v| {
        (below << 1 | u32::from(v < ZERO - HALF_SPREAD), above << 1 | u32::from(v > ZERO + HALF_SPREAD))
    });
    u64::from(below) << 32 | u64::from(above)
}

/// The value of the chroma bytes of a gray keygraph in a model of coloured ones. Chroma that was
/// sampled never has this value.
pub const NO_CHROMA_BYTE: u8 = 0;

/// Number of luma bytes of a feature of luma and chroma.
pub(crate) const LUMA: usize = LUMA_POINTS.len();

/// Bits of a [`sketch`] of a feature of luma and chroma that belong to chroma.
pub(crate) const CHROMA_MARKS: u64 = 0xfff_0000_0fff;

/// Whether a [`sketch`] is that of a gray keygraph: all its chroma is below the mean, which no
/// sampled chroma is.
pub(crate) const fn is_gray_sketch(sketch: u64) -> bool {
    sketch >> 32 & 0xfff == 0xfff
}

/// An affine frame on a triangle, in px of the level that is sampled.
struct Patch {
    /// Level of luma that is sampled. The chroma of the level below it has px of the same size.
    level: usize,
    middle: [f32; 2],
    axes: [[f32; 2]; 2],
}

impl Patch {
    fn new(level: usize, points: [Point; 3]) -> Self {
        let p = points.map(Point::px);
        let middle = [0, 1].map(|i| (p[0][i] + p[1][i] + p[2][i]) / 3.0);
        let axes = [[0, 1].map(|i| p[0][i] - middle[i]), [0, 1].map(|i| (p[1][i] - p[2][i]) / 1.732_050_8)];
        // The root of the ratio of areas is a mean radius, px of `level`.
        let radius = math::coarse_sqrt((axes[0][0] * axes[1][1] - axes[0][1] * axes[1][0]).abs());
        let above = math::round(math::log2((SPACING * radius).max(1.0)));
        let to = (level + usize::try_from(above).unwrap_or(0)).clamp(1, LEVELS - 1).max(level);
        let scale = 1.0 / f32::from(1u8 << (to - level));
        Self { level: to, middle: middle.map(|v| (v + 0.5) * scale - 0.5), axes: axes.map(|a| a.map(|v| v * scale)) }
    }

    fn at(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        [0, 1].map(|i| self.middle[i] + u * self.axes[0][i] + v * self.axes[1][i])
    }

    /// Returns the brightness at the sample points. A point outside the plane gives the brightness
    /// at the edge when `clamped` is set, and NaN otherwise.
    fn luma(&self, view: &PyramidView<'_>, clamped: bool) -> [f32; LUMA_POINTS.len()] {
        if !ROWS && !clamped {
            return self.luma_one_by_one(view);
        }
        let plane = view.luma(self.level);
        let (mut xs, mut ys) = ([0.0; LUMA_POINTS.len()], [0.0; LUMA_POINTS.len()]);
        for ((x, y), &point) in xs.iter_mut().zip(&mut ys).zip(&LUMA_POINTS) {
            [*x, *y] = self.at(point);
        }
        if clamped {
            plane.sample_clamped(&mut xs, &mut ys);
        } else {
            plane.sample(&mut xs, &mut ys);
        }
        xs
    }

    /// Returns the brightness at each point, computed one after the other. The brightness of a
    /// point outside of the plane is NaN.
    #[inline(always)]
    fn luma_one_by_one(&self, view: &PyramidView<'_>) -> [f32; LUMA_POINTS.len()] {
        let plane = view.luma(self.level);
        LUMA_POINTS.map(|point| {
            let [x, y] = self.at(point);
            plane.sample_one(x, y).unwrap_or(f32::NAN)
        })
    }

    fn chroma(&self, view: &PyramidView<'_>) -> [Option<[f32; 2]>; CHROMA_POINTS.len()] {
        // Chroma has half the size of luma, so the level below has the px of luma here.
        let planes = view.chroma(self.level - 1);
        CHROMA_POINTS.map(|p| {
            let [x, y] = self.at(p).map(math::whole);
            let v = nearest(planes, x, y);
            (v[0] != NO_CHROMA).then(|| v.map(f32::from))
        })
    }
}

/// Returns the level whose pixels are about as far apart as the samples are in `level`.
fn sample_level(level: usize, size: u8) -> usize {
    // A segment is about 1/3.5 of the longest side. The step between samples is 1/14 of that side.
    const STEP: u8 = 61; // 16 log2 14
    let above = usize::from(size.saturating_sub(STEP + 8 - 16) / 16);
    (level + above).min(LEVELS - 1)
}

/// The sample positions of a keygraph on its segments.
struct Bundle {
    points: [Point; 3],
}

impl Bundle {
    /// Calls `sample(segment, x, y)` for each position. Coordinates are in 1/16 px plus half a
    /// pixel, so that a shift to the right by four gives the pixel.
    fn each(&self, mut sample: impl FnMut(usize, i32, i32)) {
        for corner in 0..3 {
            let [v, u, w] = [0, 1, 2].map(|k| {
                let p = self.points[(corner + k) % 3];
                (i32::from(p.x), i32::from(p.y))
            });
            for s in 0..4 {
                let (near, far) = (7 - 2 * s, 2 * s + 1);
                // `dx` and `dy` are 24 times the segment.
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

/// Returns the mean chroma of each segment. A segment without chroma gives `None`.
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

/// Returns the mean of the values, and their spread about it.
fn luma_spread(values: &[f32]) -> (f32, f32) {
    let n = values.len() as f32;
    let mean = sum(values, |v| v) / n;
    (mean, math::coarse_sqrt(sum(values, |v| (v - mean) * (v - mean)) / n))
}

/// Returns the sum of `of` over the values, whose number must be a multiple of four. Every fourth
/// value goes to the same partial sum, so that no addition waits for the one before it.
fn sum(values: &[f32], of: impl Fn(f32) -> f32) -> f32 {
    let mut sums = [0.0; 4];
    for group in values.as_chunks::<4>().0 {
        for (sum, &v) in sums.iter_mut().zip(group) {
            *sum += of(v);
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Returns the mean of the values that have chroma, and the spread of one component about it.
fn chroma_spread(values: &[Option<[f32; 2]>]) -> ([f32; 2], f32) {
    let known = || values.iter().flatten();
    let n = (known().count() as f32).max(1.0);
    let mean = [0, 1].map(|i| known().map(|v| v[i]).sum::<f32>() / n);
    let squares = known().map(|v| (v[0] - mean[0]) * (v[0] - mean[0]) + (v[1] - mean[1]) * (v[1] - mean[1]));
    (mean, math::coarse_sqrt(squares.sum::<f32>() / (2.0 * n)))
}

fn write_luma(values: &[f32], mean: f32, scale: f32, out: &mut [u8]) {
    for (o, v) in out.iter_mut().zip(values) {
        *o = byte((v - mean) * scale);
    }
}

fn write_chroma(values: &[Option<[f32; 2]>], mean: [f32; 2], scale: f32, out: &mut [u8]) {
    for (o, v) in out.chunks_exact_mut(2).zip(values) {
        if let Some(v) = v {
            o[0] = byte((v[0] - mean[0]) * scale);
            o[1] = byte((v[1] - mean[1]) * scale);
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 255")]
fn byte(v: f32) -> u8 {
    (math::whole(v).clamp(-127, 127) + i32::from(ZERO)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::frame::Frame;
    use crate::image::pixels::PixelFormat;
    use crate::image::pyramid::Pyramid;

    type Small = Pyramid<{ 64 * 64 * 2 }, { 32 * 32 * 2 }>;

    /// Makes a frame that is dark and blue left of `x = 32` and bright and red right of it. All
    /// values are multiplied by `gain`.
    fn picture(gain: f32) -> std::boxed::Box<Small> {
        let rgb: std::vec::Vec<u8> = (0..64 * 64)
            .flat_map(|i| if i % 64 < 32 { [60.0, 60.0, 120.0] } else { [200.0, 80.0, 60.0] })
            .map(|v: f32| (v * gain) as u8)
            .collect();
        let mut p = std::boxed::Box::new(Small::new());
        p.planes_mut().load(&Frame::new(PixelFormat::Rgb8, 64, 64, &rgb).unwrap()).unwrap();
        p.planes_mut().reduce();
        p
    }

    const TRIANGLE: [Point; 3] =
        [Point::new(8 * 16, 10 * 16), Point::new(56 * 16, 14 * 16), Point::new(30 * 16, 50 * 16)];

    fn feature(p: &Small, t: [Point; 3], sampling: Sampling) -> Feature {
        extract(&p.view(), 0, t, 90, FeatureKind::Both, sampling)
    }

    #[test]
    fn samples_see_their_own_side_of_the_picture() {
        let f = feature(&picture(1.0), TRIANGLE, Sampling::Segments);
        assert!(f[0..4].iter().all(|&v| v < 90), "first corner lies in the dark: {f:?}");
        assert!(f[4..8].iter().all(|&v| v > 90), "second corner lies in the light: {f:?}");
        assert!(f[12] < ZERO && f[20] > ZERO, "blue against red: {f:?}");
        let f = feature(&picture(1.0), TRIANGLE, Sampling::Patch);
        for (i, [u, v]) in LUMA_POINTS.into_iter().enumerate() {
            let patch = Patch::new(0, TRIANGLE);
            let x = patch.at([u, v])[0] * f32::from(1u8 << patch.level);
            assert!((x - 32.0).abs() < 8.0 || (f[i] > ZERO) == (x > 32.0), "{i} at {x}: {f:?}");
        }
    }

    #[test]
    fn gain_changes_what_the_paper_takes_but_not_a_patch() {
        let (f, g) = (picture(1.0), picture(0.7));
        let distance = |s| {
            let (f, g) = (feature(&f, TRIANGLE, s), feature(&g, TRIANGLE, s));
            f.iter().zip(&g).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>()
        };
        assert!(distance(Sampling::Patch) < 36, "{}", distance(Sampling::Patch));
        assert!(distance(Sampling::Segments) > 200, "{}", distance(Sampling::Segments));
    }

    /// Makes a frame of a smooth texture, seen under an affine map.
    fn texture(map: impl Fn(f32, f32) -> [f32; 2]) -> std::boxed::Box<Small> {
        let rgb: std::vec::Vec<u8> = (0..64 * 64)
            .flat_map(|i| {
                let [x, y] = map((i % 64) as f32, (i / 64) as f32);
                [(x * 0.25).sin() + (y * 0.2).cos(), (x * 0.15 + y * 0.2).sin() * 2.0, (y * 0.3).sin() * 2.0]
            })
            .map(|v| (128.0 + 55.0 * v) as u8)
            .collect();
        let mut p = std::boxed::Box::new(Small::new());
        p.planes_mut().load(&Frame::new(PixelFormat::Rgb8, 64, 64, &rgb).unwrap()).unwrap();
        p.planes_mut().reduce();
        p
    }

    #[test]
    fn a_patch_stays_alike_when_the_object_turns_and_tilts() {
        let here = [[20.0, 22.0], [44.0, 26.0], [30.0, 46.0f32]];
        // `there` leads to frame px of a turned, squeezed copy, and `back` is its inverse.
        let (c, s) = (0.8f32, 0.6);
        let there = |[x, y]: [f32; 2]| {
            let (x, y) = ((x - 32.0) * 0.75, y - 32.0);
            [c * x - s * y + 32.0, s * x + c * y + 32.0]
        };
        let back = |x: f32, y: f32| {
            let (x, y) = (x - 32.0, y - 32.0);
            [(c * x + s * y) / 0.75 + 32.0, c * y - s * x + 32.0]
        };
        let at = |p: [f32; 2]| Point::new((p[0] * 16.0) as i16, (p[1] * 16.0) as i16);
        let f = feature(&texture(|x, y| [x, y]), here.map(at), Sampling::Patch);
        let g = feature(&texture(back), here.map(|p| at(there(p))), Sampling::Patch);
        let mean = |g: &Feature| f.iter().zip(g).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>() / 36;
        assert!(mean(&g) < 10, "{f:?}\n{g:?}");
        assert!((signature(&f) ^ signature(&g)).count_ones() <= 3);
        let [a, b, c] = here.map(|p| at(there(p)));
        let other = feature(&texture(back), [b, c, a], Sampling::Patch);
        assert!(mean(&other) > 20, "{f:?}\n{other:?}");
    }

    #[test]
    fn a_sketch_has_two_bits_for_each_of_the_last_32_bytes() {
        let mut feature = [ZERO; 36];
        feature[..4].fill(255);
        assert_eq!(sketch(&feature), 0);
        (feature[4], feature[5]) = (149, 107);
        (feature[34], feature[35]) = (108, 148);
        assert_eq!(sketch(&feature), 1 << 31 | 1 << 62);
        assert_eq!(sketch(&feature[..12]), 0xf << 8 | 1 << 7 | 1 << 38);
    }

    #[test]
    fn a_signature_has_a_bit_for_each_of_24_bytes() {
        let mut feature = [ZERO; FEATURE_BYTES];
        assert_eq!(signature(&feature), 0);
        feature[0] = 200;
        feature[23] = 129;
        feature[24] = 255;
        assert_eq!(signature(&feature), 1 << 23 | 1);
        assert_eq!(signature(&feature[..12]), 1 << 11);
    }

    #[test]
    fn points_lie_on_their_rings() {
        let radii = |points: &[[f32; 2]], rings: &[(usize, f32)]| {
            let expected = rings.iter().flat_map(|&(n, r)| std::iter::repeat_n(r, n));
            points.iter().zip(expected).all(|(p, r)| (p[0].hypot(p[1]) - r).abs() < 2e-3)
        };
        assert!(radii(&LUMA_POINTS, &[(5, 0.35), (9, 0.8), (10, 1.25)]));
        assert!(radii(&CHROMA_POINTS, &[(4, 1.0), (2, 0.35)]));
    }

    #[test]
    fn flat_regions_give_zeros_and_the_edge_of_the_frame_is_safe() {
        let p = picture(1.0);
        let flat = [Point::new(0, 0), Point::new(16 * 20, 0), Point::new(0, 16 * 25)];
        assert_eq!(feature(&p, flat, Sampling::Patch), [ZERO; 36]);
        let far = [Point::new(0, 0), Point::new(i16::MAX, 0), Point::new(5, i16::MAX)];
        for sampling in [Sampling::Patch, Sampling::Segments] {
            let _ = feature(&p, far, sampling);
        }
    }

    #[test]
    fn brightness_one_by_one_is_that_of_all_points_together() {
        let p = picture(0.9);
        for d in 0..40i16 {
            // Some of the points of some of these lie outside.
            let t = TRIANGLE.map(|p| Point::new((p.x + 29 * d) % 1000, (p.y + 17 * d) % 1000));
            for level in 0..2 {
                let patch = Patch::new(level, t);
                let bits = |v: [f32; LUMA_POINTS.len()]| v.map(f32::to_bits);
                assert_eq!(bits(patch.luma_one_by_one(&p.view())), bits(patch.luma(&p.view(), false)), "{t:?}");
            }
        }
    }
}
