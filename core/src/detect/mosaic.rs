//! Compares small cells of a template with the frame, one by one.
//!
//! In: the frame's pyramid, the object's template and a pose. Out: for each of 12 x 12 cells, how bright and how
//! coloured it is in the template and in the frame, and the correlation of the two. A look-alike that shares most of
//! the large blocks of a template shares fewer of its small cells, and has other colours.
//!
//! Memory: 1.9 KB, and that of `overlay` on top. Cost: a bilinear sample for each pixel of the template (at most 9,216;
//! twice on a target with vectors, which samples whole rows), and a sample of chroma for every fourth.

use core::ops::Range;

use crate::base::geometry::area;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::appearance::level_of_area;
use crate::detect::detection::Detection;
use crate::detect::light::{BLOCKS, Moments};
use crate::detect::overlay::{Columns, Overlay, block_ranges, number};
use crate::detect::tint::Tint;
use crate::image::pixels::NO_CHROMA;
use crate::image::pyramid::{PyramidView, into_level};
use crate::model::parse::Object;

/// Number of cells in each direction.
pub(crate) const SIDE: usize = 2 * BLOCKS;
/// Number of cells.
pub(crate) const ALL: usize = SIDE * SIDE;

/// Least number of pixels of a cell that counts. A narrow template has small cells, and some of none.
const LEAST_PIXELS: f32 = 4.0;

/// A cell of a template, over the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cell {
    /// Whether the frame shows most of it.
    pub(crate) is_seen: bool,
    /// Whether the template has texture there.
    pub(crate) is_textured: bool,
    /// Correlation of the template with the frame, 127 for 1.
    pub(crate) correlation: i8,
    /// Mean of the template and of the frame, gray levels.
    pub(crate) mean: [u8; 2],
    /// Spread of the template and of the frame, gray levels.
    pub(crate) spread: [u8; 2],
    /// Mean chroma of the template, [`NO_CHROMA`] where it has none, and of the frame at the same pixels. Where the frame
    /// has none at all, that of the frame is [`NO_CHROMA`].
    pub(crate) chroma: [[i8; 2]; 2],
}

/// The cells, row by row.
pub(crate) type Mosaic = [Cell; ALL];

/// Lays the template over the frame at the pose of a detection. What there was no time for is not seen.
#[inline(never)]
pub(crate) fn lay(view: &PyramidView<'_>, o: &Object<'_>, d: &Detection, pace: &mut dyn Pace) -> Mosaic {
    let luma = o.template.luma(0);
    let (w, h) = (luma.width(), luma.height());
    let level = level_of_area(area(&d.corners).abs() / number(w * h));
    let map = d.homography.after(&o.template.to_picture(o.width as f32, o.height as f32));
    let overlay = Overlay { luma, plane: view.luma(level), map: into_level(level).after(&map) };
    let tint = Tint::new(view, &o.template, &map, level);
    let mut mosaic = [Cell::UNSEEN; ALL];
    for (row, ys) in mosaic.chunks_exact_mut(SIDE).zip(block_ranges(h, SIDE, 0)) {
        let mut ranges = block_ranges(w, SIDE, 0);
        for cells in row.chunks_exact_mut(BLOCKS) {
            if !pace.goes_on() {
                return mosaic;
            }
            let columns: Columns = core::array::from_fn(|_| ranges.next().unwrap_or_default());
            let moments = overlay.correlate(ys.clone(), &columns, 1);
            for ((cell, m), xs) in cells.iter_mut().zip(&moments).zip(columns) {
                *cell = Cell::new(m, number(xs.len() * ys.len()));
                cell.chroma = chroma(&tint, [xs, ys.clone()]);
            }
        }
    }
    mosaic
}

impl Cell {
    /// A cell that is not seen.
    const UNSEEN: Self = Self {
        is_seen: false,
        is_textured: false,
        correlation: 0,
        mean: [0; 2],
        spread: [0; 2],
        chroma: [[NO_CHROMA; 2]; 2],
    };

    /// The cell with these moments. `full` is the number of its pixels.
    #[inline(never)]
    #[allow(clippy::cast_possible_truncation, reason = "casts of floats end at the limits")]
    fn new(m: &Moments, full: f32) -> Self {
        Self {
            is_seen: m.n >= (0.6 * full).max(LEAST_PIXELS),
            is_textured: m.is_textured(),
            correlation: (m.correlation() * 127.0) as i8,
            mean: m.mean.map(byte),
            spread: [m.t, m.f].map(|v| byte(math::coarse_sqrt(v.max(0.0)))),
            ..Self::UNSEEN
        }
    }
}

/// The whole part of a number, 0 to 255.
#[inline(never)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats end at the limits")]
pub(crate) fn byte(v: f32) -> u8 {
    v as u8
}

/// Mean chroma of a part of a template, given in px of its luma, and of the frame there, as [`Cell::chroma`] says.
#[inline(never)]
#[allow(clippy::cast_possible_truncation, reason = "a mean of bytes is a byte")]
fn chroma(tint: &Tint<'_>, part: [Range<usize>; 2]) -> [[i8; 2]; 2] {
    let [xs, ys] = part.map(|v| v.start / 2..v.end / 2);
    // Of the template alone, and of pixels that have chroma in both.
    let (mut alone, mut n_alone, mut both, mut n) = ([0i32; 2], 0, [[0i32; 2]; 2], 0);
    for y in ys {
        for x in xs.clone() {
            let [t, f] = tint.at([x, y]);
            if t[0] != NO_CHROMA {
                n_alone += 1;
                add(&mut alone, t);
                if f[0] != NO_CHROMA {
                    n += 1;
                    add(&mut both[0], t);
                    add(&mut both[1], f);
                }
            }
        }
    }
    let mean = |sum: [i32; 2], n: i32| if n > 0 { sum.map(|v| (v / n) as i8) } else { [NO_CHROMA; 2] };
    [if n > 0 { mean(both[0], n) } else { mean(alone, n_alone) }, mean(both[1], n)]
}

fn add(sum: &mut [i32; 2], v: [i8; 2]) {
    *sum = [sum[0] + i32::from(v[0]), sum[1] + i32::from(v[1])];
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Homography;
    use crate::base::pace::Steady;
    use crate::detect::appearance::tests::{PLACE, SIDE as PX, setup, template};
    use crate::image::plane::Plane;
    use std::vec::Vec;

    const SIZE: [f32; 2] = [PX as f32; 2];

    /// Stops after so many questions.
    struct Rounds(usize);

    impl Pace for Rounds {
        fn goes_on(&mut self) -> bool {
            self.0 = self.0.saturating_sub(1);
            self.0 > 0
        }
    }

    fn laid(hide: bool, moved: f32, pace: &mut dyn Pace) -> Mosaic {
        let (p, data, h) = setup(hide);
        let (width, height) = (PX as u32, PX as u32);
        let o = Object { name: "texture", width, height, triples: 0, keypoints: 0, template: template(&data) };
        let h = Homography::affine([h.0[0], h.0[1], PLACE[0] + moved, h.0[3], h.0[4], PLACE[1]]);
        lay(&p.view(), &o, &Detection::new(0, &h, SIZE), pace)
    }

    #[test]
    fn cells_agree_where_the_object_is_seen() {
        let agreeing = |mosaic: &Mosaic| -> Vec<bool> { mosaic.iter().map(|c| c.correlation > 100).collect() };
        let whole = laid(false, 0.0, &mut Steady);
        assert!(whole.iter().all(|c| c.is_seen && c.is_textured), "{whole:?}");
        assert!(agreeing(&whole).iter().filter(|&&a| a).count() > ALL * 9 / 10);
        // The left third is hidden.
        let hidden = agreeing(&laid(true, 0.0, &mut Steady));
        assert!((0..ALL).all(|i| i % SIDE >= SIDE / 3 || !hidden[i]), "{hidden:?}");
        assert!((0..ALL).filter(|&i| i % SIDE > SIDE / 3 && hidden[i]).count() > ALL / 2);
        assert!(agreeing(&laid(false, 24.0, &mut Steady)).iter().filter(|&&a| a).count() < ALL / 4);
    }

    #[test]
    fn a_gray_frame_and_a_gray_picture_have_no_chroma() {
        assert!(laid(false, 0.0, &mut Steady).iter().all(|c| c.chroma == [[NO_CHROMA; 2]; 2]));
    }

    #[test]
    fn what_lies_outside_or_was_not_looked_at_is_not_seen() {
        let outside = laid(false, 1e4, &mut Steady);
        assert!(outside.iter().all(|c| !c.is_seen));
        // Two halves of a row are looked at.
        let cut = laid(false, 0.0, &mut Rounds(3));
        assert_eq!(cut.iter().filter(|c| c.is_seen).count(), SIDE);
    }

    #[test]
    fn a_narrow_template_has_no_empty_cells_that_count() {
        let pixels = [90; 8 * 64];
        let plane = Plane::new(&pixels, 64, 8).unwrap();
        let overlay = Overlay { luma: plane, plane, map: Homography::IDENTITY };
        let columns: Columns = core::array::from_fn(|i| 5 * i..5 * (i + 1));
        let seen = |ys: Range<usize>| {
            let full = number(5 * ys.len());
            overlay.correlate(ys, &columns, 1).map(|m| Cell::new(&m, full).is_seen)
        };
        assert_eq!((seen(2..3), seen(2..2)), ([true; BLOCKS], [false; BLOCKS]));
    }
}
