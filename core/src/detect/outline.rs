//! Looks for the outline of an object in the frame, piece by piece.
//!
//! In: the frame's pyramid and a pose. Out: for each of 48 pieces of the outline, how far a step of brightness across it
//! stands out; and whether the outline is a border where the object seems hidden ([`is_bordered`]). What covers a part of
//! an object covers the outline there as well. A look-alike that differs in that part shows its outline.
//!
//! Memory: 700 bytes. Cost: 19 samples along each of 288 lines across the outline, and up to 43 for the border.

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
/// Number of steps on each side of the outline. A step is a two-hundredth of the object's size.
const REACH: usize = 20;
/// Number of steps on each side of the outline that tell how far the one at the outline stands out.
const BESIDE: usize = 8;
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
    let mut pieces = [f32::NAN; 4 * SIDE];
    for (i, piece) in pieces.iter_mut().enumerate() {
        if !pace.goes_on() {
            break;
        }
        *piece = prominence(&across(view, o, d, i, BESIDE));
    }
    pieces
}

/// The brightness across a piece, for `reach` steps on each side.
#[inline(never)]
fn across(view: &PyramidView<'_>, o: &Object<'_>, d: &Detection, i: usize, reach: usize) -> Profile {
    let plane = view.luma(0);
    let scale = [o.width as f32, o.height as f32].map(|v| v / SIDE as f32);
    let unit = (math::coarse_sqrt(area(&d.corners).abs()) / 200.0).clamp(1.0, 3.0);
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
        for (j, sum) in profile.iter_mut().enumerate().skip(REACH - reach).take(2 * reach + 3) {
            let far = j as f32 - (REACH + 1) as f32;
            *sum += sample(&plane, [x + far * across[0], y + far * across[1]]);
        }
    }
    profile
}

/// Brightness of a plane at a place; NaN outside.
#[inline(never)]
fn sample(plane: &Plane<'_, u8>, [x, y]: [f32; 2]) -> f32 {
    plane.sample_one(x, y).unwrap_or(f32::NAN)
}

/// Step `j` of a profile, gray levels.
fn step(profile: &Profile, j: usize) -> f32 {
    (profile[j + 2] - profile[j]).abs() / LINES as f32
}

/// How far the largest step near the middle of a profile stands out of the steps farther away. NaN
/// when a part of the profile lies outside the frame.
#[inline(never)]
fn prominence(profile: &Profile) -> f32 {
    let (mut top, mut n, mut sum, mut squares) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for j in REACH - BESIDE..=REACH + BESIDE {
        let step = step(profile, j);
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

/// Minimum number of pieces of a side that seem hidden, for the side to count.
const LEAST_PIECES: usize = 3;
/// Minimum number of sides along which the steps of a line stand out by [`STRONG`] sixteenths of a spread, and how far those
/// of all sides that count must stand out.
const LEAST_SIDES: i32 = 3;
const STRONG: i32 = 24;
const STRONG_IN_ALL: i32 = 33;

/// How far each step across a piece stands out of all, in sixteenths of their spread, -16 to 80; 0 outside the frame.
type Steps = [i8; 2 * REACH + 1];

/// Whether the outline is a border where the object seems hidden: along three sides at least, there is a straight line of
/// steps near the outline, beside cells that `is_off` says show something else. A pose that was found by a part of the
/// object is off by some pixels elsewhere, so that the line is looked for.
#[inline(never)]
#[allow(clippy::cast_possible_truncation, reason = "at most twelve")]
pub(crate) fn is_bordered(
    view: &PyramidView<'_>,
    o: &Object<'_>,
    d: &Detection,
    is_off: &dyn Fn(usize) -> bool,
    pace: &mut dyn Pace,
) -> bool {
    let (mut sides, mut more) = (0, 0);
    for side in 0..4 {
        let mut rows = [(0, [0; 2 * REACH + 1]); SIDE];
        let mut n = 0;
        for k in 0..SIDE {
            if is_off(side * SIDE + k) && pace.goes_on() {
                rows[n].0 = 2 * k as i32 + 1;
                stand_out(&across(view, o, d, side * SIDE + k, REACH), &mut rows[n].1);
                n += 1;
            }
        }
        if n >= LEAST_PIECES {
            let (line, n) = (strongest_line(&rows[..n], pace), n as i32);
            sides += i32::from(line >= STRONG * n);
            more += line - STRONG_IN_ALL * n;
        }
    }
    sides >= LEAST_SIDES && more >= 0
}

/// Writes how far the steps of a profile stand out.
#[inline(never)]
#[allow(clippy::cast_possible_truncation, reason = "limited")]
fn stand_out(profile: &Profile, out: &mut Steps) {
    let [mut n, mut sum, mut squares] = [1e-3f32, 0.0, 0.0];
    for j in 0..out.len() {
        let v = step(profile, j);
        // Outside the frame a step is NaN.
        if v >= 0.0 {
            n += 1.0;
            sum += v;
            squares += v * v;
        }
    }
    let mean = sum / n;
    let unit = 16.0 / (math::coarse_sqrt((squares / n - mean * mean).max(0.0)) + 2.0);
    for (j, out) in out.iter_mut().enumerate() {
        // NaN becomes 0.
        *out = ((step(profile, j) - mean) * unit).clamp(-16.0, 80.0) as i8;
    }
}

/// Sum of the steps along the line that crosses the greatest ones. `rows` has the steps across pieces of a side, and twice
/// the place of each piece, in pieces.
#[inline(never)]
#[allow(clippy::cast_possible_truncation, reason = "small constants")]
fn strongest_line(rows: &[(i32, Steps)], pace: &mut dyn Pace) -> i32 {
    const MOST: i32 = REACH as i32;
    let mut best = i32::MIN;
    for from in -MOST..=MOST {
        pace.goes_on();
        for to in (from - MOST).max(-MOST)..=(from + MOST).min(MOST) {
            // Where the line crosses a piece, in 1/256 of a step.
            let slope = (to - from) * 256 / (2 * SIDE as i32);
            let at = |k: i32| (((from + MOST) * 256 + 128 + slope * k) >> 8).cast_unsigned() as usize;
            let sum = rows.iter().map(|(k, steps)| i32::from(steps[at(*k).min(2 * REACH)])).sum();
            best = best.max(sum);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;

    #[test]
    fn a_step_at_the_outline_stands_out_and_one_beside_it_does_not() {
        let profile = |edge: usize| -> Profile {
            core::array::from_fn(|j| (if j > edge { 600.0 } else { 0.0 }) + 6.0 * (j % 3) as f32)
        };
        assert!(prominence(&profile(REACH + 1)) > 5.0, "{}", prominence(&profile(REACH + 1)));
        assert!(prominence(&profile(REACH - 5)) < 0.0, "{}", prominence(&profile(REACH - 5)));
        let mut outside = profile(REACH + 1);
        outside[REACH - BESIDE] = f32::NAN;
        assert!(prominence(&outside).is_nan());
    }

    #[test]
    fn a_line_that_is_off_and_aslant_is_found() {
        // Noise, and a step that moves from 12 steps outside to 3 steps inside.
        let row = |k: usize, edge: usize| {
            let noise = |j: usize| ((j * 37 + k * 101) % 17) as f32 * 8.0;
            let profile: Profile = core::array::from_fn(|j| if j > edge { 600.0 + noise(j) } else { noise(j) });
            let mut steps = [0; 2 * REACH + 1];
            stand_out(&profile, &mut steps);
            (2 * k as i32 + 1, steps)
        };
        let strongest = |edge: fn(usize) -> usize| {
            let rows: [_; 8] = core::array::from_fn(|k| row(k + 3, edge(k + 3)));
            strongest_line(&rows, &mut Steady) / 8
        };
        let (line, scattered) = (strongest(|k| 9 + k * 15 / 11), strongest(|k| k * 29 % 40));
        assert!(line > STRONG_IN_ALL && scattered < STRONG, "{line} {scattered}");
        let outside = [f32::NAN; 2 * REACH + 3];
        let mut steps = [7; 2 * REACH + 1];
        stand_out(&outside, &mut steps);
        assert_eq!(steps, [0; 2 * REACH + 1]);
    }
}
