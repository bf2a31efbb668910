//! Plain margins of a picture: a table, a wall, a sheet of paper around the object.
//!
//! In: a picture. Out: the part within its margins, when all four sides have one. The
//! picture is scaled down to 200 px, which removes noise; a row or column is plain when
//! neighbours along it hardly differ. Memory: the small picture. Cost: one pass over the
//! picture.

use crate::picture::{Part, Picture, Pixels};
use crate::search::fit;

/// Longer side of the picture after it was scaled down, px.
const SIDE: usize = 200;
/// Maximum difference of neighbours on a plain surface, of 255. Light falls off slowly;
/// edges do not.
const PLAIN: u8 = 8;
/// One pixel of this many in a row or column may differ by more: dust.
const DUST: usize = 50;
/// A margin is wider than the picture's side divided by this.
const NARROW: usize = 25;

/// The part of `picture` within plain margins, px. `None` unless each of the four margins is
/// wider than 4 % of the picture and the part within them is not plain.
#[must_use]
pub fn within_margins(picture: &Picture) -> Option<Part> {
    let small = fit(picture, SIDE, SIDE * SIDE);
    let (w, h) = (small.width, small.height);
    let samples = match &picture.pixels {
        Pixels::Rgb8(_) => 3,
        Pixels::Gray8(_) | Pixels::I420(_) => 1,
    };
    let at = |x: usize, y: usize| &small.data[(y * w + x) * samples..][..samples];
    let differ = |a: &[u8], b: &[u8]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > PLAIN);
    let row = |y: usize| (1..w).filter(|&x| differ(at(x, y), at(x - 1, y))).count() <= w / DUST;
    let column = |x: usize| (1..h).filter(|&y| differ(at(x, y), at(x, y - 1))).count() <= h / DUST;
    let top = (0..h).position(|y| !row(y))?;
    let bottom = (0..h).rposition(|y| !row(y))?;
    let left = (0..w).position(|x| !column(x))?;
    let right = (0..w).rposition(|x| !column(x))?;
    let wide = |margin: usize, side: usize| margin * NARROW > side;
    if !(wide(top, h) && wide(h - 1 - bottom, h) && wide(left, w) && wide(w - 1 - right, w)) {
        return None;
    }
    // A pixel that is partly inside belongs to the object.
    let scale = |v: usize, small: usize, large: u32| u32::try_from(v as u64 * u64::from(large) / small as u64).ok();
    let (x, y) = (scale(left, w, picture.width)?, scale(top, h, picture.height)?);
    let (x1, y1) = (scale(right + 1, w, picture.width)?, scale(bottom + 1, h, picture.height)?);
    Some(Part { x, y, width: x1 - x, height: y1 - y })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A checkerboard of `part` on a table lit from one side, with noise.
    fn picture(width: u32, height: u32, part: Part) -> Picture {
        let sample = |i: u32| {
            let (x, y) = (i % width, i / width);
            let inside = x.wrapping_sub(part.x) < part.width && y.wrapping_sub(part.y) < part.height;
            let noise = i.wrapping_mul(2_654_435_761) >> 30;
            let value = if inside { 255 * ((x / 16 + y / 16) % 2) } else { 100 + 60 * x / width + noise };
            u8::try_from(value).unwrap_or(u8::MAX)
        };
        Picture { width, height, pixels: Pixels::Gray8((0..width * height).map(sample).collect()) }
    }

    #[test]
    fn margins_are_found_to_a_hundredth() {
        let part = Part { x: 240, y: 160, width: 400, height: 320 };
        let found = within_margins(&picture(1000, 700, part)).expect("there are margins");
        for (a, b) in [(found.x, 240), (found.y, 160), (found.x + found.width, 640), (found.y + found.height, 480)] {
            assert!(a.abs_diff(b) <= 10, "{found:?}");
        }
    }

    #[test]
    fn without_margins_on_all_sides_there_are_none() {
        for (x, y, width, height) in [(0, 0, 640, 480), (0, 100, 300, 200), (100, 100, 540, 200), (10, 10, 620, 460)] {
            assert_eq!(within_margins(&picture(640, 480, Part { x, y, width, height })), None, "{x} {y}");
        }
        let plain = Part { x: 640, y: 480, width: 0, height: 0 };
        assert_eq!(within_margins(&picture(640, 480, plain)), None, "nothing but table");
    }
}
