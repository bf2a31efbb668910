//! Looks for the outline of an object in the frame, piece by piece.
//!
//! In: the frame's pyramid and a pose. Out: for each of 48 pieces of the outline, how far a step of brightness across it
//! stands out. What covers a part of an object covers the outline there as well. A look-alike that differs in that part
//! shows its outline.
//!
//! Memory: 270 bytes. Cost: 19 samples along each of 288 lines across the outline.

use crate::base::geometry::area;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::detection::Detection;
use crate::detect::mosaic::SIDE;
use crate::image::plane::Plane;
use crate::image::pyramid::PyramidView;
use crate::model::parse::Object;

/// Number of lines across a piece.
const LINES: usize = 6;
/// Number of steps on each side of the outline.
const REACH: usize = 8;
/// Distance from the outline within which a step counts as the outline's.
const NEAR: usize = 3;

/// How far the step across each piece of an outline stands out of the steps beside it, in their spreads; NaN outside
/// the frame. A piece is the outer side of a cell of the mosaic; the pieces lie side by side around the object.
pub(crate) type Pieces = [f32; 4 * SIDE];

/// Sums of the brightness along a piece, step by step across the outline.
type Profile = [f32; 2 * REACH + 3];

/// The cell of the mosaic that a piece bounds: its column and row.
pub(crate) fn cell_at(piece: usize) -> [usize; 2] {
    let (side, k) = (piece / SIDE, piece % SIDE);
    [[k, 0], [SIDE - 1, k], [SIDE - 1 - k, SIDE - 1], [0, SIDE - 1 - k]][side]
}

/// Looks at the outline of a detection.
#[inline(never)]
pub(crate) fn trace(view: &PyramidView<'_>, o: &Object<'_>, d: &Detection, pace: &mut dyn Pace) -> Pieces {
    let plane = view.luma(0);
    let mut pieces = [f32::NAN; 4 * SIDE];
    let scale = [o.width as f32, o.height as f32].map(|v| v / SIDE as f32);
    let unit = (math::coarse_sqrt(area(&d.corners).abs()) / 200.0).clamp(1.0, 3.0);
    for (i, piece) in pieces.iter_mut().enumerate() {
        if !pace.goes_on() {
            break;
        }
        let [x, y] = cell_at(i);
        // The ends of the piece among the corners of its cell. The outline lies half a pixel outside of the middles of
        // the outer pixels.
        let corner = |n: usize| {
            let [u, v] = [n == 1 || n == 2, n >= 2].map(usize::from);
            d.homography.apply([(x + u) as f32 * scale[0] - 0.5, (y + v) as f32 * scale[1] - 0.5])
        };
        let (from, to) = (corner(i / SIDE), corner((i / SIDE + 1) % 4));
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
        *piece = prominence(&profile);
    }
    pieces
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
