//! Measures whether the surroundings of a match look alike.
//!
//! In: the vertices of a match in the template and in the frame. Out: how well the template around
//! the triangle correlates with the frame there. Three pairs of points determine an affine map.
//! Under this map a window somewhat larger than the triangle is compared pixel by pixel, luma and
//! chroma, each with zero mean and unit spread. Most matches from the classifier are wrong. This
//! stage rejects all but one or two in a hundred of the wrong ones, so that a few right matches are
//! enough for a pose.
//!
//! Memory: none. Cost: 144 bilinear samples of luma for every match, and 36 to 144 samples of chroma
//! for three in four. (A look at a quarter of the luma first would cost more than it saves: features
//! that match have much the same luma, and five matches in six pass.)

use crate::base::capacity::LEVELS;
use crate::base::geometry::Homography;
use crate::base::math;
use crate::image::pixels::NO_CHROMA;
use crate::image::plane::{Plane, between, nearest};
use crate::image::pyramid::{PyramidView, into_level, out_of_level};
use crate::model::parse::Template;

/// Half the side of a window, in square roots of the triangle's area.
const HALF_SIDE: f32 = 1.5;
/// Minimum half side of a window, template px.
const LEAST_HALF_SIDE: f32 = 5.0;
/// Maximum number of pixels on a side of a window.
const SIDE: f32 = 12.0;
/// Spread of the noise: gray levels of luma, and steps of chroma.
const LUMA_NOISE: f32 = 3.0;
pub(crate) const CHROMA_NOISE: f32 = 4.0;
/// Minimum correlation of luma for chroma to be compared.
const LEAST_LUMA: f32 = 0.3;

/// Factor for a match without chroma. What the correlation of luma lacks to 1 is multiplied by this
/// factor, and counts as what the correlation of chroma lacks. With this value luma alone lets
/// through as many wrong matches as luma and chroma together.
const GRAY: f32 = 7.0 / 3.0;
/// Minimum number of a window's pixels that lie in the frame, of luma and of chroma.
const LEAST_LUMA_SAMPLES: i32 = 36;
const LEAST_CHROMA_SAMPLES: i32 = 6;

/// The affine map that takes three points to three others; `None` when `from` lie on a line.
#[must_use]
pub fn affine_through(from: &[[f32; 2]; 3], to: &[[f32; 2]; 3]) -> Option<Homography> {
    let minus = |a: [f32; 2], b: [f32; 2]| [a[0] - b[0], a[1] - b[1]];
    let (u, v) = (minus(from[1], from[0]), minus(from[2], from[0]));
    let (p, q) = (minus(to[1], to[0]), minus(to[2], to[0]));
    let det = u[0] * v[1] - u[1] * v[0];
    if det == 0.0 {
        return None;
    }
    let row = |i: usize| {
        let (a, b) = ((p[i] * v[1] - q[i] * u[1]) / det, (q[i] * u[0] - p[i] * v[0]) / det);
        [a, b, to[0][i] - a * from[0][0] - b * from[0][1]]
    };
    let ([a, b, c], [d, e, f]) = (row(0), row(1));
    Some(Homography::affine([a, b, c, d, e, f]))
}

/// Number of fraction bits of a position.
const SHIFT: u32 = 16;
const HALF: i32 = 1 << (SHIFT - 1);

/// Positions in the frame of a window's pixels, computed step by step.
struct Walk {
    map: Homography,
    step: [i32; 2],
}

impl Walk {
    fn new(map: &Homography) -> Self {
        Self { map: *map, step: [fixed(map.0[0]), fixed(map.0[3])] }
    }

    fn start(&self, x: usize, y: usize) -> [i32; 2] {
        self.map.apply_affine([x as f32, y as f32]).map(fixed)
    }

    const fn next(&self, [x, y]: [i32; 2]) -> [i32; 2] {
        [x.saturating_add(self.step[0]), y.saturating_add(self.step[1])]
    }
}

fn fixed(v: f32) -> i32 {
    math::round(v * (1 << SHIFT) as f32)
}

/// Bilinear sample of a plane; `None` outside the plane.
fn sample(plane: &Plane<'_, u8>, [x, y]: [i32; 2]) -> Option<i32> {
    let square = plane.square([x, y].map(|v| (v >> SHIFT).cast_unsigned() as usize))?;
    Some((between(square, x >> 8 & 0xff, y >> 8 & 0xff) + (1 << 15)) >> 16)
}

/// Sums of a correlation. They are exact for at most ten thousand pixels.
#[derive(Clone, Copy, Default)]
pub(crate) struct Products {
    n: i32,
    /// Sums over the template, then over the frame, each for one or two components.
    t: [i32; 2],
    f: [i32; 2],
    tt: i32,
    ff: i32,
    tf: i32,
}

impl Products {
    fn add(&mut self, t: i32, f: i32) {
        self.add_pair([t, 0], [f, 0]);
    }

    pub(crate) fn add_pair(&mut self, t: [i32; 2], f: [i32; 2]) {
        self.n += 1;
        for i in 0..2 {
            self.t[i] += t[i];
            self.f[i] += f[i];
            self.tt += t[i] * t[i];
            self.ff += f[i] * f[i];
            self.tf += t[i] * f[i];
        }
    }

    /// Correlation of what stands above the noise. `noise` is the spread of a pixel's noise.
    pub(crate) fn correlation(&self, noise: f32) -> f32 {
        let n = self.n.max(1) as f32;
        let without_mean = |sum: i32, a: [i32; 2], b: [i32; 2]| {
            let products = a[0] as f32 * b[0] as f32 + a[1] as f32 * b[1] as f32;
            (sum as f32 - products / n) / n
        };
        let t = without_mean(self.tt, self.t, self.t) + noise * noise;
        let f = without_mean(self.ff, self.f, self.f) + noise * noise;
        without_mean(self.tf, self.t, self.f) / math::coarse_sqrt(t * f)
    }
}

/// Window of a match.
struct Window {
    /// Middle of the window, and half its side, template px.
    middle: [f32; 2],
    half: f32,
    /// Map from template px to frame px.
    map: Homography,
}

impl Window {
    /// Columns and rows that lie in the window, of a template plane of `size` px. `px` is the side
    /// of the plane's pixels, template px.
    fn pixels(&self, size: [usize; 2], px: f32) -> [core::ops::Range<usize>; 2] {
        [0, 1].map(|i| {
            let at = |v: f32| usize::try_from(math::floor((v + 0.5) / px + 0.5)).unwrap_or(0).min(size[i]);
            at(self.middle[i] - self.half)..at(self.middle[i] + self.half)
        })
    }

    /// Correlation of luma.
    fn luma(&self, view: &PyramidView<'_>, template: &Template<'_>, level: usize, scale: f32) -> f32 {
        let px = f32::from(1u8 << level);
        let source = template.luma(level);
        let target = level_for(scale * px);
        let plane = view.luma(target);
        let map = into_level(target).after(&self.map).after(&out_of_level(level));
        let [xs, ys] = self.pixels([source.width(), source.height()], px);
        let walk = Walk::new(&map);
        let mut sums = Products::default();
        for y in ys {
            let row = source.row(y);
            let mut at = walk.start(xs.start, y);
            for x in xs.clone() {
                if let Some(f) = sample(&plane, at) {
                    sums.add(i32::from(row[x]), f);
                }
                at = walk.next(at);
            }
        }
        // A window that lies mostly outside the frame tells nothing.
        if sums.n < LEAST_LUMA_SAMPLES { 0.0 } else { sums.correlation(LUMA_NOISE) }
    }

    fn chroma(&self, view: &PyramidView<'_>, template: &Template<'_>, level: usize, scale: f32) -> Option<f32> {
        let level = level.saturating_sub(1);
        let px = f32::from(2u8 << level);
        let source = template.chroma(level);
        let target = level_for(scale * px / 2.0);
        let planes = view.chroma(target);
        let map = into_level(target + 1).after(&self.map).after(&out_of_level(level + 1));
        let [xs, ys] = self.pixels([source[0].width(), source[0].height()], px);
        let walk = Walk::new(&map);
        let mut sums = Products::default();
        for y in ys {
            let rows = source.map(|s| s.row(y));
            let mut at = walk.start(xs.start, y);
            for x in xs.clone() {
                let t = rows.map(|r| r[x].cast_signed());
                let f = nearest(planes, (at[0] + HALF) >> SHIFT, (at[1] + HALF) >> SHIFT);
                if t[0] != NO_CHROMA && f[0] != NO_CHROMA {
                    sums.add_pair(t.map(i32::from), f.map(i32::from));
                }
                at = walk.next(at);
            }
        }
        (sums.n >= LEAST_CHROMA_SAMPLES).then(|| sums.correlation(CHROMA_NOISE))
    }
}

/// The pyramid level whose pixels have a side nearest to `px` px.
fn level_for(px: f32) -> usize {
    const { assert!(LEVELS == 4) };
    [1.41, 2.83, 5.66].iter().filter(|&&v| px > v).count()
}

/// Likeness of the surroundings of a match, at most 2: the correlation of luma plus that of chroma.
/// With `gray`, or where chroma is missing, luma alone is compared. `from` are the vertices in the
/// template, px; `to` are the vertices in the frame, px.
#[must_use]
pub fn likeness(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    from: &[[f32; 2]; 3],
    to: &[[f32; 2]; 3],
    gray: bool,
) -> f32 {
    let Some(map) = affine_through(from, to) else { return 0.0 };
    let [a, b, _, d, e, ..] = map.0;
    let [p, q, r] = from;
    let side = math::coarse_sqrt(((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])).abs() / 2.0);
    let half = (HALF_SIDE * side).max(LEAST_HALF_SIDE);
    let level = level_for(2.0 * half / SIDE * 1.2);
    // Frame px per template px.
    let scale = math::coarse_sqrt((a * e - b * d).abs());
    let middle = [0, 1].map(|i| (p[i] + q[i] + r[i]) / 3.0);
    let window = Window { middle, half, map };
    let luma = window.luma(view, template, level, scale);
    if luma < LEAST_LUMA {
        return 0.0;
    }
    let chroma = if gray { None } else { window.chroma(view, template, level, scale) };
    luma + chroma.unwrap_or(1.0 - (1.0 - luma) * GRAY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use crate::image::frame::Frame;
    use crate::image::halve::{halve_chroma, halve_luma};
    use crate::image::pixels::PixelFormat;
    use crate::image::pyramid::{Pyramid, plane_bytes, reduce_all};
    use crate::model::format::template_bytes;
    use std::prelude::rust_2024::*;
    use std::vec;

    const SIDE: usize = 64;
    /// Vertices in the template. The frame shows the template twice as large.
    const FROM: [[f32; 2]; 3] = [[12.0, 20.0], [40.0, 16.0], [28.0, 44.0]];
    const TO: [[f32; 2]; 3] = [[24.5, 40.5], [80.5, 32.5], [56.5, 88.5]];

    /// A texture without repetition, in colour.
    fn texture(x: f32, y: f32) -> [f32; 3] {
        let wave = |a: f32, b: f32| 128.0 + 90.0 * (x * a + (y * b).sin() * 2.0).sin() * (y * b * 0.7 + x * 0.05).cos();
        [wave(0.21, 0.17), wave(0.13, 0.29), wave(0.19, 0.11)]
    }

    fn pyramid(zoom: f32, light: f32) -> Box<Pyramid<40_000, 10_000>> {
        let side = (SIDE as f32 * zoom) as usize;
        let rgb: Vec<u8> = (0..side * side)
            .flat_map(|i| texture((i % side) as f32 / zoom, (i / side) as f32 / zoom))
            .map(|v| (v * light) as u8)
            .collect();
        let mut p = Box::new(Pyramid::new());
        p.planes_mut().load(&Frame::new(PixelFormat::Rgb8, side, side, &rgb).unwrap()).unwrap();
        p.planes_mut().reduce();
        p
    }

    fn template() -> Vec<u8> {
        let p = pyramid(1.0, 1.0);
        let v = p.view();
        let mut bytes = vec![0; template_bytes(SIDE, SIDE)];
        let (luma, chroma) = bytes.split_at_mut(plane_bytes(SIDE, SIDE));
        for y in 0..SIDE {
            luma[y * SIDE..][..SIDE].copy_from_slice(v.luma(0).row(y));
        }
        reduce_all(luma, SIDE, SIDE, halve_luma, &mut Steady);
        let half = SIDE / 2;
        for (plane, source) in chroma.chunks_exact_mut(plane_bytes(half, half)).zip(v.chroma(0)) {
            for (i, c) in plane[..half * half].iter_mut().enumerate() {
                *c = source.row(i / half)[i % half].cast_unsigned();
            }
            reduce_all(plane, half, half, halve_chroma, &mut Steady);
        }
        bytes
    }

    fn alike(frame: &Pyramid<40_000, 10_000>, to: &[[f32; 2]; 3], gray: bool) -> f32 {
        likeness(&frame.view(), &Template::new(&template(), SIDE, SIDE).unwrap(), &FROM, to, gray)
    }

    #[test]
    fn a_right_match_is_alike_in_any_light() {
        for light in [1.0, 0.4] {
            let frame = pyramid(2.0, light);
            assert!(alike(&frame, &TO, false) > 1.7, "light {light}: {}", alike(&frame, &TO, false));
            assert!(alike(&frame, &TO, true) > 1.5, "light {light}, gray: {}", alike(&frame, &TO, true));
        }
    }

    #[test]
    fn a_wrong_match_is_not() {
        let frame = pyramid(2.0, 1.0);
        let turned = [TO[1], TO[2], TO[0]];
        let moved = TO.map(|[x, y]| [x + 25.0, y - 17.0]);
        for (to, what) in [(turned, "turned"), (moved, "moved")] {
            for gray in [false, true] {
                assert!(alike(&frame, &to, gray) < 0.9, "{what}: {}", alike(&frame, &to, gray));
            }
        }
        assert_eq!(alike(&frame, &[TO[0]; 3].map(|p| p.map(|v| v * 1e9)), false), 0.0, "far outside");
    }

    #[test]
    fn three_pairs_are_an_affine_map() {
        let map = affine_through(&FROM, &TO).unwrap();
        for (f, t) in FROM.iter().zip(TO) {
            let p = map.apply_affine(*f);
            assert!((p[0] - t[0]).abs() < 1e-3 && (p[1] - t[1]).abs() < 1e-3, "{p:?} for {t:?}");
        }
        assert!(affine_through(&[[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]], &TO).is_none(), "on a line");
    }
}
