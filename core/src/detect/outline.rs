//! Looks for the outline of an object in the frame, piece by piece.
//!
//! In: the frame's pyramid, the object's template and a pose. Out: for each of 48 pieces of the
//! outline, whether the template agrees with the frame just inside of it, and how far a step of
//! brightness across the outline stands out. What covers a part of an object covers the outline
//! there as well. A look-alike that differs in that part shows its outline.
//!
//! Memory: 400 bytes. Cost: 19 samples along each of 288 lines across the outline, and 64 samples
//! inside of each piece.

use crate::base::geometry::{Homography, area};
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::detection::Detection;
use crate::detect::light::Moments;
use crate::image::plane::Plane;
use crate::image::pyramid::{PyramidView, into_level};
use crate::model::parse::Object;

/// Number of pieces on a side of the outline.
const PIECES: usize = 12;
/// Number of lines across a piece.
const LINES: usize = 6;
/// Number of steps on each side of the outline.
const REACH: usize = 8;
/// Distance from the outline within which a step counts as the outline's.
const NEAR: usize = 3;

/// A piece of an outline.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    /// Correlation of the template with the frame just inside; NaN where the template is flat or
    /// the frame does not show it.
    pub(crate) inside: f32,
    /// How far the step at the outline stands out of the steps beside it, in their spreads; NaN
    /// outside the frame.
    pub(crate) step: f32,
}

/// Pieces of an outline, side by side around the object.
pub(crate) type Pieces = [Piece; 4 * PIECES];

/// Sums of the brightness along a piece, step by step across the outline.
type Profile = [f32; 2 * REACH + 3];

/// Looks at the outline of a detection. `level` is the level of the frame whose pixels are about as
/// large as those of the template.
#[inline(never)]
pub(crate) fn trace(
    view: &PyramidView<'_>,
    o: &Object<'_>,
    d: &Detection,
    level: usize,
    pace: &mut dyn Pace,
) -> Pieces {
    let to_picture = o.template.to_picture(o.width as f32, o.height as f32);
    let cell = Overlaid { map: into_level(level).after(&d.homography).after(&to_picture), luma: view.luma(level) };
    let (template, plane) = (o.template.luma(0), view.luma(0));
    let mut pieces = [Piece { inside: f32::NAN, step: f32::NAN }; 4 * PIECES];
    // The outline lies half a pixel outside of the middles of the outer pixels.
    let half = [0.5, 0.5];
    let unit = (math::coarse_sqrt(area(&d.corners).abs()) / 200.0).clamp(1.0, 3.0);
    for (i, piece) in pieces.iter_mut().enumerate() {
        if !pace.goes_on() {
            break;
        }
        let (side, k) = (i / PIECES, i % PIECES);
        // The piece lies on this side of its cell, one of 12 x 12.
        let (x, y) = [(k, 0), (PIECES - 1, k), (PIECES - 1 - k, PIECES - 1), (0, PIECES - 1 - k)][side];
        piece.inside = cell.correlation(&template, x, y);
        let scale = [o.width as f32, o.height as f32].map(|v| v / PIECES as f32);
        let at = |u: f32, v: f32| {
            let p = [(x as f32 + u) * scale[0] - half[0], (y as f32 + v) * scale[1] - half[1]];
            place(&d.homography, p)
        };
        // The ends of the piece among the corners of its cell.
        let corner = |i: usize| at(f32::from(u8::from(i == 1 || i == 2)), f32::from(u8::from(i >= 2)));
        let (from, to) = (corner(side), corner((side + 1) % 4));
        let along = [to[0] - from[0], to[1] - from[1]];
        let step = unit / math::coarse_sqrt((along[0] * along[0] + along[1] * along[1]).max(1e-6));
        // To the left of the direction in which the outline runs is outside.
        let across = [along[1] * step, -along[0] * step];
        let mut profile: Profile = [0.0; 2 * REACH + 3];
        for line in 0..LINES {
            let t = (line as f32 + 0.5) / LINES as f32;
            let [x, y] = [from[0] + along[0] * t, from[1] + along[1] * t];
            for (j, sum) in profile.iter_mut().enumerate() {
                let far = j as f32 - (REACH + 1) as f32;
                *sum += sample(&plane, [x + far * across[0], y + far * across[1]]);
            }
        }
        piece.step = prominence(&profile);
    }
    pieces
}

#[inline(never)]
fn place(h: &Homography, p: [f32; 2]) -> [f32; 2] {
    h.apply(p)
}

/// Brightness of a plane at a place; NaN outside.
#[inline(never)]
fn sample(plane: &Plane<'_, u8>, [x, y]: [f32; 2]) -> f32 {
    plane.sample_one(x, y).unwrap_or(f32::NAN)
}

/// How far the largest step near the middle of a profile stands out of the steps farther away. NaN
/// when a part of the profile lies outside the frame.
#[inline(never)]
fn prominence(profile: &Profile) -> f32 {
    let (mut top, mut n, mut sum, mut squares) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for j in 0..=2 * REACH {
        let step = (profile[j + 2] - profile[j]).abs() / LINES as f32;
        let far = j.abs_diff(REACH);
        // A NaN stays in the sum.
        if far <= NEAR {
            top = if step > top { step } else { top };
            sum += step * 0.0;
        } else if far > NEAR + 1 {
            (n, sum, squares) = (n + 1.0, sum + step, squares + step * step);
        }
    }
    let mean = sum / n;
    (top - mean) / (math::coarse_sqrt((squares / n - mean * mean).max(0.0)) + 2.0)
}

/// A level of the frame, and the map from the template to it.
struct Overlaid<'a> {
    map: Homography,
    luma: Plane<'a, u8>,
}

impl Overlaid<'_> {
    /// Correlation of a cell of the template, one of 12 x 12, with the frame; NaN where the
    /// template is flat or the frame does not show it.
    #[inline(never)]
    fn correlation(&self, template: &Plane<'_, u8>, cx: usize, cy: usize) -> f32 {
        let span = |c: usize, n: usize| (c * n).div_ceil(PIECES)..((c + 1) * n).div_ceil(PIECES);
        let (mut sums, mut all) = ([0.0f32; 6], 0.0f32);
        for y in span(cy, template.height()) {
            for x in span(cx, template.width()) {
                all += 1.0;
                let f = sample(&self.luma, place(&self.map, [x as f32, y as f32]));
                if !f.is_nan() {
                    let t = f32::from(template.row(y)[x]);
                    for (sum, v) in sums.iter_mut().zip([1.0, t, f, t * t, f * f, t * f]) {
                        *sum += v;
                    }
                }
            }
        }
        let m = Moments::new(sums);
        if m.n < 0.6 * all || m.t < 16.0 { f32::NAN } else { m.correlation() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_at_the_outline_stands_out_and_one_beside_it_does_not() {
        let profile = |edge: usize| -> Profile {
            core::array::from_fn(|j| (if j > edge { 600.0 } else { 0.0 }) + 6.0 * (j % 3) as f32)
        };
        assert!(prominence(&profile(REACH + 1)) > 5.0, "{}", prominence(&profile(REACH + 1)));
        assert!(prominence(&profile(3)) < 0.0, "{}", prominence(&profile(3)));
        let mut outside = profile(REACH + 1);
        outside[0] = f32::NAN;
        assert!(prominence(&outside).is_nan());
    }
}
