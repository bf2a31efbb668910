//! Measures whether the frame looks like the object where the pose says it is.
//!
//! In: the frame's pyramid, the object's template and a homography. Out: an [`Appearance`]. The
//! frame is warped into the template, and each of 6 x 6 blocks is correlated by itself (zero mean,
//! unit spread). Therefore the light may differ from block to block, and a part that is hidden
//! loses only its own blocks. Blocks without texture or outside the frame do not count.
//!
//! Memory: about 2 KB of stack, 4 KB on a target with vectors. Cost: one bilinear sample for each
//! pixel of the template (at most 9,216).

use core::ops::Range;

use crate::base::capacity::{LEVELS, id};
use crate::base::geometry::{Homography, area, is_convex};
use crate::base::math;
use crate::base::pace::Pace;
use crate::base::sort::sort;
use crate::detect::light::{BLOCKS, Moments, agreement};
use crate::detect::overlay::{Columns, Overlay, block_ranges, every, number};
use crate::detect::tint::Tint;
use crate::detect::verify::{CHROMA_NOISE, Products};
use crate::image::pixels::NO_CHROMA;
use crate::image::plane::Plane;
use crate::image::pyramid::{PyramidView, into_level, out_of_level};
use crate::model::parse::{Object, Template};

/// Correlation of the frame with the template, block by block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Appearance {
    /// Number of blocks that count: textured, and in the frame.
    pub blocks: u16,
    /// Number of blocks that lie in the frame, textured or not, of 36.
    pub inside: u16,
    /// Share of the object that is seen and agrees, 0 to 1: the mean over the blocks that count. What
    /// lies outside the frame does not count.
    pub visible: f32,
    /// Median correlation of the blocks that count, -1 to 1.
    pub median: f32,
    /// Number of blocks that agree: the sum of the blocks' agreements, each 0 to 1.
    pub support: f32,
    /// Number of blocks that agree well. It is the sum of the squares of the blocks' agreements,
    /// each times a factor that says how much the block's texture runs both ways (0 for a single
    /// edge, up to 1). Alignment of a wrong pose tends to leave many blocks that agree a little,
    /// and single edges that agree well. Both count little here.
    pub strong: f32,
    /// Correlation of chroma over the whole object, -1 to 1. Only chroma above the noise counts. 0
    /// without chroma.
    pub chroma: f32,
}

impl Appearance {
    /// Share of the object that is seen and agrees, 0 to 1. What lies outside the frame counts as not
    /// seen, unless so little lies inside that this part alone is looked at.
    #[must_use]
    pub fn share(&self) -> f32 {
        self.visible * f32::from(self.inside) / (BLOCKS * BLOCKS) as f32
    }
}

/// Whether an outline can be that of a picture seen by a camera. It must be convex and not
/// mirrored, its area must be at least `min_area` square px, and no side may be shorter than its
/// opposite by a factor of `max_ratio` or more.
#[must_use]
pub fn is_plausible(outline: &[[f32; 2]; 4], min_area: f32, max_ratio: f32) -> bool {
    if !outline.iter().flatten().all(|v| v.is_finite()) || area(outline) < min_area || !is_convex(outline) {
        return false;
    }
    let side2 = |i: usize| {
        let (a, b) = (outline[i], outline[(i + 1) % 4]);
        (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
    };
    (0..2).all(|i| {
        let (a, b) = (side2(i), side2(i + 2));
        a.max(b) < max_ratio * max_ratio * a.min(b)
    })
}

/// The pyramid level in which an area of `px2` square px of level 0 is about one pixel.
#[inline(never)]
pub(crate) fn level_of_area(px2: f32) -> usize {
    // Half a log2 of the area, rounded.
    let l = math::round(math::log2(px2.max(1e-3)) / 2.0 - 0.2);
    usize::try_from(l).unwrap_or(0).min(LEVELS - 1)
}

/// The pyramid level of the frame whose pixels are about as large as the template's pixels under
/// `h` (template px to frame px).
fn level_under(h: &Homography, width: f32, height: f32) -> usize {
    level_of_area(area(&h.outline(width, height)).abs() / (width * height))
}

/// How much the gradients of a block run both ways, 0 to 1: twice the smaller eigenvalue of their
/// structure tensor, divided by its trace. It is 0 for a block with one straight edge, which agrees
/// at every place along another edge.
fn roundness(luma: &Plane<'_, u8>, [columns, rows]: &Part, block: usize) -> f32 {
    let range = |part: &Range<usize>, size: usize, b: usize| {
        let block = blocks_of(part).nth(b).unwrap_or_default();
        block.start.max(1)..block.end.min(size - 1)
    };
    let (mut xx, mut xy, mut yy) = (0i32, 0i32, 0i32);
    for y in range(rows, luma.height(), block / BLOCKS) {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| luma.row(y));
        for x in range(columns, luma.width(), block % BLOCKS) {
            let (gx, gy) = (i32::from(row[x + 1]) - i32::from(row[x - 1]), i32::from(below[x]) - i32::from(above[x]));
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
        }
    }
    let (sum, difference) = ((xx + yy) as f32, (xx - yy) as f32);
    let cross = 2.0 * xy as f32;
    (sum - math::coarse_sqrt(difference * difference + cross * cross)).max(0.0) / sum.max(1.0)
}

/// Columns and rows of a part of a template.
type Part = [Range<usize>; 2];

/// Largest share of a template that is looked at as a part. When more of it lies in the frame, all of
/// it is looked at.
const PART: f32 = 0.45;

/// Minimum sides of a part, px of the template.
const LEAST_PART: usize = 3 * BLOCKS;

/// Number of places along a side of a template that are looked for in the frame.
const PLACES: usize = 16;

/// The part of a template, of `size` px, that lies in the frame, of `frame` px, under `h`. It is the
/// whole template unless the object is so large or so far outside that most of it is not in the frame.
#[inline(never)]
fn part_in_frame(h: &Homography, size: [usize; 2], frame: [usize; 2]) -> Part {
    let ([mut least, mut most], bounds) = ([[PLACES; 2], [0; 2]], frame.map(|v| v as f32));
    for place in 0..(PLACES + 1) * (PLACES + 1) {
        let at = [place % (PLACES + 1), place / (PLACES + 1)];
        let [x, y] = h.apply([0, 1].map(|axis| (at[axis] * size[axis]) as f32 / PLACES as f32));
        if x >= 0.0 && y >= 0.0 && x < bounds[0] && y < bounds[1] {
            for axis in 0..2 {
                least[axis] = least[axis].min(at[axis]);
                most[axis] = most[axis].max(at[axis]);
            }
        }
    }
    let part = [0, 1].map(|axis| least[axis] * size[axis] / PLACES..most[axis] * size[axis] / PLACES);
    let [w, h] = part.each_ref().map(|side| side.len());
    let is_part = (w * h) as f32 <= PART * (size[0] * size[1]) as f32 && w.min(h) >= LEAST_PART;
    if is_part { part } else { size.map(|v| 0..v) }
}

/// Whether so much of an object lies outside the frame that its blocks divide the part inside.
pub(crate) fn is_part(view: &PyramidView<'_>, o: &Object<'_>, h: &Homography) -> bool {
    let template = o.template.luma(0);
    let (size, luma) = ([template.width(), template.height()], view.luma(0));
    let map = h.after(&o.template.to_picture(o.width as f32, o.height as f32));
    let part = part_in_frame(&map, size, [luma.width(), luma.height()]);
    part[0].len() * part[1].len() < size[0] * size[1]
}

/// The columns or rows of each block of a part.
fn blocks_of(part: &Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let start = part.start;
    block_ranges(part.len(), BLOCKS, 0).map(move |b| start + b.start..start + b.end)
}

/// Correlations of the blocks of one level of the template.
pub(crate) struct Blocks {
    /// The part of the template that the blocks divide.
    part: Part,
    values: [f32; BLOCKS * BLOCKS],
    /// Number of the block that each correlation belongs to.
    places: [u8; BLOCKS * BLOCKS],
    n: usize,
    inside: u16,
}

impl Blocks {
    /// Correlates the frame under `h` (picture px to frame px) with level `level` of the template
    /// of a picture of `width` x `height` px. Calls `saw` with the number and the moments of each
    /// block.
    #[inline(never)]
    pub(crate) fn new(
        view: &PyramidView<'_>,
        template: &Template<'_>,
        level: usize,
        h: &Homography,
        [width, height]: [f32; 2],
        saw: &mut dyn FnMut(usize, &Moments),
    ) -> Self {
        let luma = template.luma(level);
        let (w, h_) = (luma.width(), luma.height());
        let h = h.after(&template.to_picture(width, height)).after(&out_of_level(level));
        let target = level_under(&h, w as f32, h_ as f32);
        let overlay = Overlay { luma, plane: view.luma(target), map: into_level(target).after(&h) };
        let frame = [view.luma(0).width(), view.luma(0).height()];
        // The alignment, on level 1, knows the light of each block of the whole.
        let part = if level == 0 { part_in_frame(&h, [w, h_], frame) } else { [0..w, 0..h_] };
        let full = (part[0].len() * part[1].len() / (BLOCKS * BLOCKS)) as f32 / number(every(&luma));
        let mut columns: Columns = Default::default();
        columns.iter_mut().zip(blocks_of(&part[0])).for_each(|(to, from)| *to = from);
        let rows = blocks_of(&part[1]);
        let (values, places) = ([0.0; BLOCKS * BLOCKS], [0; BLOCKS * BLOCKS]);
        let mut blocks = Self { part: part.clone(), values, places, n: 0, inside: 0 };
        let mut places = 0u8..;
        for ys in rows {
            for (m, place) in overlay.correlate(ys, &columns, every(&luma)).iter().zip(&mut places) {
                saw(usize::from(place), m);
                blocks.add(place, m, full);
            }
        }
        blocks
    }

    /// Adds a block. `full` is the number of pixels that a block has when it lies in the frame.
    fn add(&mut self, place: u8, m: &Moments, full: f32) {
        if m.n < 0.6 * full {
            return;
        }
        self.inside += 1;
        if m.is_textured() {
            self.values[self.n] = m.correlation();
            self.places[self.n] = place;
            self.n += 1;
        }
    }

    /// Number of blocks that agree: the sum of the blocks' agreements.
    pub(crate) fn support(&self) -> f32 {
        self.values[..self.n].iter().map(|&c| agreement(c)).sum()
    }

    /// Computes [`Appearance::visible`]. A block counts in full from a correlation of 0.7 on.
    fn visible(&self) -> f32 {
        let seen = self.values[..self.n].iter().map(|&c| ((c - 0.3) / 0.4).clamp(0.0, 1.0));
        seen.sum::<f32>() / (self.n as f32).max(1.0)
    }

    /// Computes [`Appearance::strong`]. `luma` is the template's level that the blocks belong to.
    fn strong(&self, luma: &Plane<'_, u8>, pace: &mut dyn Pace) -> f32 {
        let mut sum = -0.0;
        for (&c, &place) in self.values[..self.n].iter().zip(&self.places) {
            let a = agreement(c);
            if a > 0.0 {
                pace.goes_on();
                sum += a * a * roundness(luma, &self.part, usize::from(place));
            }
        }
        sum
    }

    fn median(&mut self) -> f32 {
        let values = &mut self.values[..self.n];
        sort(values, |a, b| a.total_cmp(b).is_lt());
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Correlates the frame under `h` (picture px to frame px) with the template of a picture of
/// `width` x `height` px.
#[must_use]
pub fn appearance(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    [width, height]: [f32; 2],
    pace: &mut dyn Pace,
) -> Appearance {
    let map = h.after(&template.to_picture(width, height));
    let level = level_under(&map, template.width as f32, template.height as f32);
    let chroma = chroma_correlation(view, template, &map, level);
    Appearance { chroma, ..appearance_of_luma(view, template, h, [width, height], pace) }
}

/// Computes [`appearance`] without chroma: the correlation of chroma is 0.
pub(crate) fn appearance_of_luma(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    size: [f32; 2],
    pace: &mut dyn Pace,
) -> Appearance {
    let mut asked = |_: usize, _: &Moments| {
        pace.goes_on();
    };
    let mut blocks = Blocks::new(view, template, 0, h, size, &mut asked);
    Appearance {
        blocks: id(blocks.n),
        inside: blocks.inside,
        visible: blocks.visible(),
        support: blocks.support(),
        strong: blocks.strong(&template.luma(0), pace),
        median: blocks.median(),
        chroma: 0.0,
    }
}

/// Computes only [`Appearance::support`], on level `level` of the template.
pub(crate) fn support(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    level: usize,
    h: &Homography,
    size: [f32; 2],
) -> f32 {
    Blocks::new(view, template, level, h, size, &mut |_, _| {}).support()
}

fn chroma_correlation(view: &PyramidView<'_>, template: &Template<'_>, h: &Homography, level: usize) -> f32 {
    let tint = Tint::new(view, template, h, level);
    let mut sums = Products::default();
    // Every second pixel is enough for this correlation.
    for y in (0..template.height / 2).step_by(2) {
        for x in (0..template.width / 2).step_by(2) {
            let [t, f] = tint.at([x, y]);
            if t[0] != NO_CHROMA && f[0] != NO_CHROMA {
                sums.add_pair(t.map(i32::from), f.map(i32::from));
            }
        }
    }
    sums.correlation(CHROMA_NOISE)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use crate::image::frame::Frame;
    use crate::image::halve::halve_luma;
    use crate::image::pixels::PixelFormat;
    use crate::image::pyramid::{Pyramid, plane_bytes, reduce_all};
    use crate::model::format::template_bytes;
    use std::prelude::rust_2024::*;
    use std::vec;

    pub(crate) const SIDE: usize = if cfg!(miri) { 48 } else { 96 };
    const WIDTH: usize = 5 * SIDE / 2;
    const HEIGHT: usize = 3 * WIDTH / 4;
    /// Position of the object in the frame, px.
    pub(crate) const PLACE: [f32; 2] = [WIDTH as f32 / 12.0, WIDTH as f32 / 8.0];

    /// A texture without repetition.
    fn texture(x: f32, y: f32) -> f32 {
        128.0 + 50.0 * (x * 0.31 + (y * 0.17).sin() * 2.0).sin() + 50.0 * (y * 0.23 + (x * 0.11).cos() * 3.0).sin()
    }

    type Setup = (Box<Pyramid<60_000, 15_000>>, Vec<u8>, Homography);

    pub(crate) fn setup(hide: bool) -> Setup {
        setup_bent(hide, &|place| place)
    }

    /// Makes the frame of [`setup`] with a picture that is not flat: `flatten` maps places of the plane to those of the
    /// picture.
    pub(crate) fn setup_bent(hide: bool, flatten: &dyn Fn([f32; 2]) -> [f32; 2]) -> Setup {
        let h = Homography::affine([1.4, 0.3, PLACE[0], -0.3, 1.4, PLACE[1]]);
        let inverse = h.inverse().unwrap();
        let frame: Vec<u8> = (0..WIDTH * HEIGHT)
            .map(|i| {
                let [x, y] = flatten(inverse.apply([(i % WIDTH) as f32, (i / WIDTH) as f32]));
                let hidden = hide && x < SIDE as f32 / 3.0;
                (if hidden { 0.0 } else { texture(x, y) * 0.6 } + 10.0) as u8
            })
            .collect();
        let mut p = Box::new(Pyramid::new());
        p.planes_mut().load(&Frame::new(PixelFormat::Gray8, WIDTH, HEIGHT, &frame).unwrap()).unwrap();
        p.planes_mut().reduce();
        let mut template = vec![NO_CHROMA.cast_unsigned(); template_bytes(SIDE, SIDE)];
        let luma = &mut template[..plane_bytes(SIDE, SIDE)];
        for (i, t) in luma[..SIDE * SIDE].iter_mut().enumerate() {
            *t = texture((i % SIDE) as f32, (i / SIDE) as f32) as u8;
        }
        reduce_all(luma, SIDE, SIDE, halve_luma, &mut Steady);
        (p, template, h)
    }

    pub(crate) fn template(data: &[u8]) -> Template<'_> {
        Template::new(data, SIDE, SIDE).unwrap()
    }

    #[test]
    fn the_right_place_correlates_and_a_wrong_one_does_not() {
        let (p, data, h) = setup(false);
        let side = SIDE as f32;
        let right = appearance(&p.view(), &template(&data), &h, [side; 2], &mut Steady);
        assert!(right.median > 0.95 && right.blocks == 36, "{right:?}");
        let moved = Homography::affine([1.4, 0.3, PLACE[0] + 16.0, -0.3, 1.4, PLACE[1] + 12.0]);
        let wrong = appearance(&p.view(), &template(&data), &moved, [side; 2], &mut Steady);
        assert!(wrong.median < 0.5, "{wrong:?}");
        assert_eq!(right.chroma, 0.0, "a gray frame has no chroma");
    }

    #[test]
    fn hiding_a_third_leaves_the_median() {
        let (p, data, h) = setup(true);
        let a = appearance(&p.view(), &template(&data), &h, [SIDE as f32; 2], &mut Steady);
        assert!(a.median > 0.9, "{a:?}");
    }

    #[test]
    fn implausible_outlines_are_told() {
        let ok = |o: [[f32; 2]; 4]| is_plausible(&o, 100.0, 3.0);
        assert!(ok([[0.0, 0.0], [50.0, 5.0], [48.0, 60.0], [-3.0, 55.0]]));
        assert!(!ok([[0.0, 0.0], [-3.0, 55.0], [48.0, 60.0], [50.0, 5.0]]), "mirrored");
        assert!(!ok([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]]), "tiny");
        assert!(!ok([[0.0, 0.0], [50.0, 0.0], [5.0, 5.0], [0.0, 50.0]]), "not convex");
        assert!(!ok([[0.0, 0.0], [90.0, 0.0], [55.0, 40.0], [45.0, 40.0]]), "too steep");
        assert!(!ok([[f32::NAN; 2]; 4]), "not finite");
    }
}
