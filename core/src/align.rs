//! Does the frame look like the object where the pose says it is?
//!
//! In: the frame's pyramid, the object's template and a homography. Out: how well
//! blocks of the template correlate with the frame. The frame is warped into the
//! template; each of 6 x 6 blocks is correlated for itself (zero mean, unit
//! spread), so that light may differ from block to block and a hidden part loses
//! its blocks and not the object. Blocks without texture, or outside the frame,
//! do not count.
//!
//! Memory: some 2 KB of stack, 12 where there are vectors. Cost: one bilinear sample for
//! each pixel of the template (9,216 at most).

use core::ops::Range;

use crate::capacity::{LEVELS, TEMPLATE_SIDE};
use crate::frame::NO_CHROMA;
use crate::geometry::{Homography, area, is_convex};
use crate::math::{self, VECTORS};
use crate::model::Template;
use crate::pose::{accumulate, solve};
use crate::pyramid::{Plane, PyramidView, into_level, out_of_level};
use crate::sort::sort;
use crate::verify::{CHROMA_NOISE, Counts};

/// Blocks each way.
pub const BLOCKS: usize = 6;

/// Least spread of a block of the template, gray levels, for it to count.
const LEAST_SPREAD: f32 = 5.0;

/// Blocks that must agree for aligning to be worth it, and after the coarse steps for the
/// finer ones. Of 565 right poses none had fewer than 2.4 of them as it was grown; of
/// wrong ones two in five fall short of the first, and two in three of either.
const LEAST_SUPPORT: [f32; 2] = [1.2, 2.0];

/// How the frame correlates with the template, block by block.
#[derive(Clone, Copy, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Appearance {
    /// Blocks that count.
    pub blocks: u16,
    /// Blocks that lie in the frame, textured or not, of 36.
    pub inside: u16,
    /// Their median correlation, -1 to 1.
    pub median: f32,
    /// How many blocks agree: the sum of their agreements.
    pub support: f32,
    /// How many agree well: the sum of the squares of their agreements, each times how much
    /// its texture runs both ways (0 for a lone edge, 1). Many blocks that agree a little,
    /// and lone edges that agree well, are what aligning makes of a wrong pose.
    pub strong: f32,
    /// Correlation of chroma over the whole object, of what stands above noise, -1 to 1; 0
    /// without chroma.
    pub chroma: f32,
}

/// How much a block of this correlation speaks for a pose, 0 to 1: what chance
/// gives counts nothing, and a hidden block does not pull.
fn agreement(correlation: f32) -> f32 {
    let a = ((correlation - 0.2) / 0.8).max(0.0);
    a * a
}

/// Whether an outline can be that of a picture seen by a camera: convex, not
/// mirrored, with an area of at least `min_area` px and no side shrunk more than
/// `max_ratio` times against its opposite.
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

/// Columns whose sums are kept apart, so that they can be added up side by side.
const LANES: usize = 4;

/// Those that are: the others follow one by one, which gives the same sums.
const AT_ONCE: usize = if VECTORS { LANES } else { 1 };

/// Some sums, of some columns each.
type Sums<const K: usize, const N: usize> = [[f32; N]; K];

/// The sums of the columns from `lane` on that are added up at once.
#[inline]
fn part<const K: usize>(sums: &Sums<K, LANES>, lane: usize) -> Sums<K, AT_ONCE> {
    core::array::from_fn(|k| core::array::from_fn(|i| sums[k][lane + i]))
}

/// Puts them back.
#[inline]
fn put_back<const K: usize>(sums: &mut Sums<K, LANES>, lane: usize, part: &Sums<K, AT_ONCE>) {
    for (s, p) in sums.iter_mut().zip(part) {
        s[lane..lane + AT_ONCE].copy_from_slice(p);
    }
}

/// Over all columns.
fn total<const K: usize>(sums: &Sums<K, LANES>) -> [f32; K] {
    const { assert!(LANES == 4) };
    sums.map(|v| (v[0] + v[1]) + (v[2] + v[3]))
}

/// Sums of a correlation: pixels; of the template, of the frame; of the squares of either, and
/// of their products.
type Pairs<const N: usize> = Sums<6, N>;

/// Adds pixels of the template and of the frame, where `seen` is 1 and not 0.
#[inline]
fn add_pairs(sums: &mut Pairs<AT_ONCE>, t: &[f32; AT_ONCE], f: &[f32; AT_ONCE], seen: &[f32; AT_ONCE]) {
    for i in 0..AT_ONCE {
        let (t, f) = (t[i] * seen[i], f[i] * seen[i]);
        for (sum, v) in sums.iter_mut().zip([seen[i], t, f, t * t, f * f, t * f]) {
            sum[i] += v;
        }
    }
}

/// What a correlation is made of.
#[derive(Clone, Copy, Default)]
struct Moments {
    /// Pixels.
    n: f32,
    /// Means of the template and of the frame.
    mean: [f32; 2],
    /// Variance of the template, variance of the frame, covariance.
    t: f32,
    f: f32,
    tf: f32,
}

impl Moments {
    fn new(sums: &Pairs<LANES>) -> Self {
        let [n, t, f, tt, ff, tf] = total(sums);
        let k = 1.0 / n.max(1.0);
        let mean = [t * k, f * k];
        Self { n, mean, t: tt * k - mean[0] * mean[0], f: ff * k - mean[1] * mean[1], tf: tf * k - mean[0] * mean[1] }
    }
}

/// The columns of each of `blocks` blocks of a row of `width`, or the rows of a height: those
/// whose `x * blocks / width` is the block's number; but for a `margin` at both ends.
fn block_ranges(width: usize, blocks: usize, margin: usize) -> impl Iterator<Item = Range<usize>> {
    let start = move |b: usize| (b * width).div_ceil(blocks).max(margin);
    (0..blocks).map(move |b| start(b)..start(b + 1).min(width.saturating_sub(margin)))
}

/// The columns of each, which are asked for in every row.
fn block_columns(width: usize, blocks: usize, margin: usize) -> [Range<usize>; BLOCKS] {
    let mut ranges = block_ranges(width, blocks, margin);
    core::array::from_fn(|_| ranges.next().unwrap_or_default())
}

/// What the frame shows where a row of the template lies, no number where it shows nothing;
/// with room for whole groups from any pixel on.
type Row = [f32; TEMPLATE_SIDE + LANES];
const NOTHING: Row = [f32::NAN; TEMPLATE_SIDE + LANES];

/// Rows that are kept from the first look at a row of blocks to the second: all of them, of
/// four blocks each way or more, but where that is more stack than there is.
const BAND: usize = if VECTORS { TEMPLATE_SIDE / 4 } else { 1 };
type Band = [Row; BAND];

/// Values from `first` on, at most `n` of them, and 1 for each that there is, or 0; `None` where
/// there is none.
#[inline]
fn group(row: &Row, first: usize, n: usize) -> Option<(Numbers, Numbers)> {
    let values: Numbers = core::array::from_fn(|i| row[first + i]);
    if AT_ONCE == 1 {
        return (values[0] >= 0.0).then_some((values, [1.0; AT_ONCE]));
    }
    // Numbers, since they are compared side by side.
    let n = number(n);
    let there = |i: usize| (values[i] >= 0.0) & (number(i) < n);
    let seen = core::array::from_fn(|i| if there(i) { 1.0 } else { 0.0 });
    Some((core::array::from_fn(|i| if there(i) { values[i] } else { 0.0 }), seen))
}

/// A level of the template, and the level of the frame that it lies on.
struct Overlay<'a> {
    luma: Plane<'a, u8>,
    plane: Plane<'a, u8>,
    /// Px of the first to px of the second.
    map: Homography,
}

impl Overlay<'_> {
    /// What the frame shows where the pixels of row `y` lie.
    #[inline(never)]
    fn row(&self, y: usize, out: &mut Row) {
        let n = self.luma.width().min(TEMPLATE_SIDE);
        let out = &mut out[..n];
        let (h, v) = (&self.map.0, number(y));
        // What is the same along the row.
        let [a, b, c] = [0, 3, 6].map(|i| h[i + 1] * v + h[i + 2]);
        let place = |i: usize| {
            let u = number(i);
            let reciprocal = 1.0 / (h[6] * u + c);
            ((h[0] * u + a) * reciprocal, (h[3] * u + b) * reciprocal)
        };
        if VECTORS {
            let mut ys = [0.0; TEMPLATE_SIDE];
            let ys = &mut ys[..n];
            for i in 0..n {
                (out[i], ys[i]) = place(i);
            }
            self.plane.sample(out, ys);
        } else {
            for (i, out) in out.iter_mut().enumerate() {
                let (x, y) = place(i);
                *out = self.plane.sample_one(x, y);
            }
        }
    }

    /// Correlates each of `blocks` x `blocks` blocks.
    fn correlate(&self, blocks: usize) -> [Moments; BLOCKS * BLOCKS] {
        let mut moments = [Moments::default(); BLOCKS * BLOCKS];
        let mut band = [NOTHING; BAND];
        let columns = block_columns(self.luma.width(), blocks, 0);
        for (moments, ys) in moments.chunks_exact_mut(blocks).zip(block_ranges(self.luma.height(), blocks, 0)) {
            let pairs = self.correlate_band(ys, &columns[..blocks], &mut band);
            for (m, pairs) in moments.iter_mut().zip(&pairs) {
                *m = Moments::new(pairs);
            }
        }
        moments
    }

    /// Correlates each of the blocks that have these rows and columns, and leaves in `band` what
    /// the frame shows there.
    #[inline(never)]
    fn correlate_band(&self, ys: Range<usize>, columns: &[Range<usize>], band: &mut Band) -> [Pairs<LANES>; BLOCKS] {
        let mut pairs: [Pairs<LANES>; BLOCKS] = Default::default();
        let mut numbers = NO_NUMBERS;
        for (i, y) in ys.enumerate() {
            let (row, frame) = (self.luma.row(y), &mut band[i % BAND]);
            self.row(y, frame);
            row_of_numbers(row, &mut numbers);
            for (pairs, xs) in pairs.iter_mut().zip(columns) {
                for lane in (0..LANES).step_by(AT_ONCE) {
                    let mut sums = part(pairs, lane);
                    for x in (xs.start + lane..xs.end).step_by(LANES) {
                        let Some((f, seen)) = group(frame, x, xs.end - x) else { continue };
                        add_pairs(&mut sums, &pixels(row, &numbers, x), &f, &seen);
                    }
                    put_back(pairs, lane, &sums);
                }
            }
        }
        pairs
    }
}

/// A row of the template as numbers, with room for whole groups from any pixel on, where they
/// are worth the stack.
type RowOfNumbers = [f32; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];
const NO_NUMBERS: RowOfNumbers = [0.0; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];

/// Makes them, where they are.
#[inline]
fn row_of_numbers(row: &[u8], out: &mut RowOfNumbers) {
    for (out, &v) in out.iter_mut().zip(row) {
        *out = f32::from(v);
    }
}

/// Steps from what lies before the pixels of a row, but for the first, to what lies after them.
#[inline]
fn row_of_steps([before, after]: [&[u8]; 2], out: &mut RowOfNumbers) {
    for ((out, &a), &b) in out.iter_mut().skip(1).zip(after).zip(before) {
        *out = step(b, a);
    }
}

fn step(before: u8, after: u8) -> f32 {
    f32::from(i16::from(after) - i16::from(before))
}

/// Those of the pixels from `first` on.
#[inline]
fn steps([before, after]: [&[u8]; 2], numbers: &RowOfNumbers, first: usize) -> Numbers {
    let one = |i: usize| step(before[first - 1 + i], after[first - 1 + i]);
    core::array::from_fn(|i| if VECTORS { numbers[first + i] } else { one(i) })
}

/// Pixels of a row from `first` on.
#[inline]
fn pixels(row: &[u8], numbers: &RowOfNumbers, first: usize) -> Numbers {
    core::array::from_fn(|i| if VECTORS { numbers[first + i] } else { f32::from(row[first + i]) })
}

/// A coordinate of a template as a number.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "templates are far smaller")]
fn number(v: usize) -> f32 {
    v as i32 as f32
}

/// The pyramid level whose pixels are about as large in the frame as those of the
/// template are under `h` (template px to frame px).
fn level_for(h: &Homography, width: f32, height: f32) -> usize {
    let a = area(&h.outline(width, height)).abs() / (width * height);
    // Half a log2 of the area ratio, rounded.
    let l = math::round(math::log2(a.max(1e-3)) / 2.0 - 0.2);
    usize::try_from(l).unwrap_or(0).min(LEVELS - 1)
}

/// How much the gradients of a block run both ways, 0 to 1: twice the smaller eigenvalue of
/// their structure tensor over its trace. A block with one straight edge, 0, agrees
/// wherever it is slid along another.
fn roundness(luma: &Plane<'_, u8>, block: usize) -> f32 {
    let (w, h) = (luma.width(), luma.height());
    let range = |size: usize, b: usize| block_ranges(size, BLOCKS, 1).nth(b).unwrap_or_default();
    let (mut xx, mut xy, mut yy) = (0i32, 0i32, 0i32);
    for y in range(h, block / BLOCKS) {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| luma.row(y));
        for x in range(w, block % BLOCKS) {
            let (gx, gy) = (i32::from(row[x + 1]) - i32::from(row[x - 1]), i32::from(below[x]) - i32::from(above[x]));
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
        }
    }
    let (sum, difference) = ((xx + yy) as f32, (xx - yy) as f32);
    let cross = 2.0 * xy as f32;
    (sum - math::sqrt(difference * difference + cross * cross)).max(0.0) / sum.max(1.0)
}

/// Correlations of the blocks of a level of the template.
struct Blocks {
    values: [f32; BLOCKS * BLOCKS],
    /// Which block each of them is.
    places: [u8; BLOCKS * BLOCKS],
    n: usize,
    inside: u16,
}

impl Blocks {
    /// Correlates the frame under `h` (picture px to frame px) with level `level` of
    /// the template of a picture of `width` x `height` px.
    fn new(view: &PyramidView<'_>, template: &Template<'_>, level: usize, h: &Homography, [w, h_]: [f32; 2]) -> Self {
        let luma = template.luma(level);
        let (tw, th) = (luma.width(), luma.height());
        let h = h.after(&template.to_picture(w, h_)).after(&out_of_level(level));
        let target = level_for(&h, tw as f32, th as f32);
        let plane = view.luma(target);
        let map = into_level(target).after(&h);
        let moments = Overlay { luma, plane, map }.correlate(BLOCKS);
        let full = (tw * th / (BLOCKS * BLOCKS)) as f32;
        let mut blocks = Self { values: [0.0; BLOCKS * BLOCKS], places: [0; BLOCKS * BLOCKS], n: 0, inside: 0 };
        for (place, m) in (0u8..).zip(&moments) {
            if m.n < 0.6 * full {
                continue;
            }
            blocks.inside += 1;
            if m.t >= LEAST_SPREAD * LEAST_SPREAD {
                // A flat frame block correlates with nothing.
                blocks.values[blocks.n] = m.tf / math::sqrt(m.t * m.f.max(4.0));
                blocks.places[blocks.n] = place;
                blocks.n += 1;
            }
        }
        blocks
    }

    fn support(&self) -> f32 {
        self.values[..self.n].iter().map(|&c| agreement(c)).sum()
    }

    /// `luma` is the level that they are of.
    fn strong(&self, luma: &Plane<'_, u8>) -> f32 {
        let blocks = self.values[..self.n].iter().zip(self.places);
        let agreeing = blocks.map(|(&c, place)| (agreement(c), place)).filter(|&(a, _)| a > 0.0);
        agreeing.map(|(a, place)| a * a * roundness(luma, usize::from(place))).sum()
    }

    fn median(&mut self) -> f32 {
        let values = &mut self.values[..self.n];
        sort(values, |a, b| a.total_cmp(b).is_lt());
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Correlates the frame under `h` (picture px to frame px) with the template of a
/// picture of `width` x `height` px.
#[must_use]
pub fn appearance(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    width: f32,
    height: f32,
) -> Appearance {
    let map = h.after(&template.to_picture(width, height));
    let level = level_for(&map, template.width as f32, template.height as f32);
    let chroma = chroma_correlation(view, template, &map, level);
    Appearance { chroma, ..appearance_of_luma(view, template, h, [width, height]) }
}

/// The same without chroma, which is 0.
pub(crate) fn appearance_of_luma(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    size: [f32; 2],
) -> Appearance {
    let mut blocks = Blocks::new(view, template, 0, h, size);
    Appearance {
        blocks: u16::try_from(blocks.n).unwrap_or(0),
        inside: blocks.inside,
        support: blocks.support(),
        strong: blocks.strong(&template.luma(0)),
        median: blocks.median(),
        chroma: 0.0,
    }
}

/// [`Appearance::support`] alone, on level `level` of the template.
pub(crate) fn support(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    level: usize,
    h: &Homography,
    size: [f32; 2],
) -> f32 {
    Blocks::new(view, template, level, h, size).support()
}

/// Some steps of [`refine`].
pub(crate) struct Refinement {
    /// Level of the template.
    pub(crate) level: usize,
    /// Blocks each way whose light is evened out.
    pub(crate) blocks: usize,
    /// Most steps.
    pub(crate) times: usize,
    /// A step that moves no corner so far, px of the level, is the last.
    pub(crate) still: f32,
    /// Share of the support so far that must be left. Support is seen on level 1, too coarse to
    /// tell what the finest steps gain: they must only not lose the object.
    pub(crate) keep: f32,
}
const REFINEMENTS: [Refinement; 3] = [
    Refinement { level: 2, blocks: 4, times: 5, still: 0.05, keep: 1.0 },
    Refinement { level: 1, blocks: 6, times: 4, still: 0.05, keep: 1.0 },
    Refinement { level: 0, blocks: 6, times: 3, still: 0.02, keep: 0.98 },
];

/// Aligns the frame with the template by their gradients, starting at `h` (picture
/// px to frame px), from coarse to fine, and gives the homography that most blocks
/// support. A hidden half can pull a right pose away: such a step is not taken.
///
/// Inverse compositional Gauss-Newton (S. Baker, I. Matthews, *Lucas-Kanade 20
/// Years On*, IJCV 2004), with zero mean and unit spread in each block, and blocks
/// weighted by how well they correlate.
///
/// `None` when so little looks alike that no step could mend it.
#[must_use]
pub fn refine(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    width: f32,
    height: f32,
) -> Option<Homography> {
    refine_by(&REFINEMENTS, LEAST_SUPPORT, view, template, h, [width, height])
}

/// [`refine`] by these steps, with so much support at the start and after the first.
pub(crate) fn refine_by(
    steps: &[Refinement],
    least: [f32; 2],
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    [width, height]: [f32; 2],
) -> Option<Homography> {
    let side = template.width.max(template.height) as f32;
    let middle = [template.width, template.height].map(|v| (v as f32 - 1.0) / 2.0);
    // Template px from coordinates near 1, with the origin in the middle.
    let unit = Homography::affine([side, 0.0, middle[0], 0.0, side, middle[1]]);
    let to_picture = template.to_picture(width, height);
    let support = |h: &Homography| support(view, template, 1, h, [width, height]);
    let mut best = (*h, support(h));
    if best.1 < least[0] {
        return None;
    }
    let back = to_picture.after(&unit).inverse()?;
    for &Refinement { level, blocks, times, still, keep } in steps {
        let coarse = Coarse::new(template, level, blocks, side, middle);
        let mut g = best.0.after(&to_picture).after(&unit);
        let mut light = None;
        for i in 0..times {
            // On the finest level steps are so small that the light of the one before will do.
            let again = level == 0 && i + 1 < times;
            let Some((next, moved)) = coarse.improve(view, &g, &mut light, again) else { break };
            light = light.filter(|_| again);
            g = next;
            if moved < still {
                break;
            }
        }
        let g = g.after(&back).normalised();
        let seen = support(&g);
        if seen > keep * best.1 {
            best = (g, seen);
        }
        if best.1 < least[1] {
            return None;
        }
    }
    Some(best.0)
}

/// A template seen at a fraction of its size.
struct Coarse<'a> {
    luma: Plane<'a, u8>,
    step: usize,
    blocks: usize,
    side: f32,
    middle: [f32; 2],
    size: [usize; 2],
}

impl<'a> Coarse<'a> {
    fn new(template: &Template<'a>, level: usize, blocks: usize, side: f32, middle: [f32; 2]) -> Self {
        let luma = template.luma(level);
        Self { luma, step: 1 << level, blocks, side, middle, size: [luma.width(), luma.height()] }
    }

    /// Unit coordinates of `(x, y)`, coarse px.
    fn unit(&self) -> Homography {
        let step = self.step as f32;
        let start = self.middle.map(|m| ((step - 1.0) / 2.0 - m) / self.side);
        Homography::affine([step / self.side, 0.0, start[0], 0.0, step / self.side, start[1]])
    }

    /// One Gauss-Newton step of `g`, which maps unit coordinates to the frame; and how far it
    /// moves a corner, coarse px. `light` is that of the step before, and is brought up to
    /// date for one that follows, if it is asked for `again`.
    fn improve(
        &self,
        view: &PyramidView<'_>,
        g: &Homography,
        light: &mut Option<Light>,
        again: bool,
    ) -> Option<(Homography, f32)> {
        let corner = |x: f32, y: f32| g.apply([x / self.side, y / self.side]);
        let [w, h] = [self.middle[0], self.middle[1]];
        let outline = [corner(-w, -h), corner(w, -h), corner(w, h), corner(-w, h)];
        if !is_plausible(&outline, 100.0, 5.0) {
            return None;
        }
        let px2 = area(&outline) / (self.size[0] * self.size[1]) as f32;
        let level = usize::try_from(math::round(math::log2(px2) / 2.0 - 0.2)).unwrap_or(0).min(LEVELS - 1);
        let unit = self.unit();
        let overlay =
            Overlay { luma: self.luma, plane: view.luma(level), map: into_level(level).after(g).after(&unit) };
        let mut normal = Normal::default();
        self.look(&overlay, &unit, light, again, &mut normal);
        let Normal(mut normal) = normal;
        // Damping: a little of each direction's own curvature.
        for (i, row) in normal.iter_mut().enumerate() {
            row[i] *= if i < 6 { 1.001 } else { 1.01 };
            row[i] += 1e-3;
        }
        let d = solve(&mut normal, 8)?;
        let step = Homography([1.0 + d[0], d[1], d[2], d[3], 1.0 + d[4], d[5], d[6], d[7], 1.0]);
        let g = g.after(&step.inverse()?).normalised();
        // How far that moves its corners at most, but for the square of a small number.
        let unit_px = self.side / self.step as f32;
        let moved =
            [0, 3].map(|i| (d[i].abs() + d[i + 1].abs() + (d[6].abs() + d[7].abs()) / 2.0) / 2.0 + d[i + 2].abs());
        g.0.iter().all(|v| v.is_finite()).then_some((g, unit_px * moved[0].max(moved[1])))
    }

    /// Looks at each inner coarse pixel that lies in the frame: adds what the errors under this
    /// light ask for to `normal`, and brings the light up to date where it is asked for `again`.
    /// Where there is none each row of blocks is looked at twice, first for its light.
    #[inline(never)]
    fn look(
        &self,
        overlay: &Overlay<'_>,
        unit: &Homography,
        light: &mut Option<Light>,
        again: bool,
        normal: &mut Normal,
    ) {
        let is_new = light.is_none();
        let light = light.get_or_insert([Shade::default(); BLOCKS * BLOCKS]);
        let [mut numbers, mut across, mut down] = [NO_NUMBERS; 3];
        // Gradients of unit coordinates from differences over two px.
        let per_unit = self.side / (2.0 * self.step as f32);
        let [w, h] = self.size;
        let mut band = [NOTHING; BAND];
        let columns = block_columns(w, self.blocks, 1);
        for (ys, light) in block_ranges(h, self.blocks, 1).zip(light.chunks_exact_mut(self.blocks)) {
            if is_new {
                let pairs = overlay.correlate_band(ys.clone(), &columns[..self.blocks], &mut band);
                Shade::renew(light, &pairs);
            }
            let mut pairs: [Pairs<LANES>; BLOCKS] = Default::default();
            for (i, y) in ys.enumerate() {
                let [above, row, below] = [y - 1, y, y + 1].map(|y| self.luma.row(y));
                row_of_numbers(row, &mut numbers);
                let from = |row: &'a [u8], first: usize| row.get(first..).unwrap_or_default();
                let (beside, upright) = ([row, from(row, 2)], [from(above, 1), from(below, 1)]);
                row_of_steps(beside, &mut across);
                row_of_steps(upright, &mut down);
                let frame = &mut band[i % BAND];
                if !is_new || BAND == 1 {
                    overlay.row(y, frame);
                }
                let mut line = Line::default();
                for lane in (0..LANES).step_by(AT_ONCE) {
                    let mut sums = part(&line, lane);
                    for ((shade, pairs), xs) in light.iter().zip(&mut pairs).zip(&columns) {
                        let mut block = part(pairs, lane);
                        for x in (xs.start + lane..xs.end).step_by(LANES) {
                            let Some((f, seen)) = group(frame, x, xs.end - x) else { continue };
                            let t = pixels(row, &numbers, x);
                            if again {
                                add_pairs(&mut block, &t, &f, &seen);
                            }
                            if shade.weight < LEAST_WEIGHT {
                                continue;
                            }
                            let e =
                                core::array::from_fn(|i| f[i] * shade.scale_f - t[i] * shade.scale_t + shade.offset);
                            let scale = shade.scale_t * per_unit;
                            let slope = |side: [&[u8]; 2], numbers| steps(side, numbers, x).map(|v| v * scale);
                            let pixels = Pixels {
                                u: core::array::from_fn(|i| unit.0[0] * number(x + i) + unit.0[2]),
                                gx: slope(beside, &across),
                                gy: slope(upright, &down),
                                e,
                                weight: core::array::from_fn(|i| seen[i] * (shade.weight / (1.0 + e[i] * e[i]))),
                            };
                            pixels.add_to(&mut sums);
                        }
                        put_back(pairs, lane, &block);
                    }
                    put_back(&mut line, lane, &sums);
                }
                normal.add(&line, unit.0[4] * number(y) + unit.0[5]);
            }
            if again {
                Shade::renew(light, &pairs);
            }
        }
    }
}

/// How a block is lit in template and frame, and how much it counts.
#[derive(Clone, Copy, Default)]
struct Shade {
    scale_t: f32,
    scale_f: f32,
    /// What takes the one's mean to the other's, so scaled.
    offset: f32,
    weight: f32,
}

impl Shade {
    /// Of a row of blocks.
    #[inline(never)]
    fn renew(light: &mut [Self], pairs: &[Pairs<LANES>; BLOCKS]) {
        for (shade, pairs) in light.iter_mut().zip(pairs) {
            *shade = Self::new(Moments::new(pairs));
        }
    }

    fn new(m: Moments) -> Self {
        let usable = m.t > 4.0 && m.f > 1.0;
        let correlation = if usable { m.tf / math::sqrt(m.t * m.f) } else { 0.0 };
        let [scale_t, scale_f] = [m.t, m.f].map(|v| 1.0 / math::sqrt(v.max(1.0)));
        let offset = m.mean[0] * scale_t - m.mean[1] * scale_f;
        Self { scale_t, scale_f, offset, weight: agreement(correlation) }
    }
}

/// Blocks that count less are left out.
const LEAST_WEIGHT: f32 = 0.05;

type Light = [Shade; BLOCKS * BLOCKS];

/// Weighted sums along a row, where v is the same: of the gradient's products `x x`, `x y`,
/// `y y` and of its products with the error, each times powers of u from 0 on, of which there
/// are 5, 4, 3, 3 and 2.
type Line = Sums<17, LANES>;

/// Pixels beside each other.
struct Pixels {
    u: [f32; AT_ONCE],
    /// Gradient, of unit coordinates.
    gx: [f32; AT_ONCE],
    gy: [f32; AT_ONCE],
    /// What the frame shows less what it should.
    e: [f32; AT_ONCE],
    weight: [f32; AT_ONCE],
}

impl Pixels {
    /// Where there are vectors, sums that stay in memory are made some of.
    #[cfg_attr(any(target_feature = "sse2", target_feature = "neon"), inline(never))]
    #[cfg_attr(not(any(target_feature = "sse2", target_feature = "neon")), inline(always))]
    fn add_to(&self, sums: &mut Sums<17, AT_ONCE>) {
        let product = |a: &Numbers, b: &Numbers| -> Numbers { core::array::from_fn(|i| a[i] * b[i]) };
        let Self { u, gx, gy, e, weight } = self;
        let (wx, wy) = (product(weight, gx), product(weight, gy));
        let u2 = product(u, u);
        let powers = [[1.0; AT_ONCE], *u, u2, product(&u2, u), product(&u2, &u2)];
        let [xx @ .., xy0, xy1, xy2, xy3, yy0, yy1, yy2, xe0, xe1, xe2, ye0, ye1] = sums;
        add_products(xx.each_mut(), &powers, &product(&wx, gx));
        add_products([xy0, xy1, xy2, xy3], &powers, &product(&wx, gy));
        add_products([yy0, yy1, yy2], &powers, &product(&wy, gy));
        add_products([xe0, xe1, xe2], &powers, &product(&wx, e));
        add_products([ye0, ye1], &powers, &product(&wy, e));
    }
}

/// Numbers of the columns that are added up at once.
type Numbers = [f32; AT_ONCE];

/// Adds each power times the values.
#[inline(always)]
fn add_products<const K: usize>(sums: [&mut Numbers; K], powers: &[Numbers; 5], values: &Numbers) {
    for k in 0..K {
        for i in 0..AT_ONCE {
            sums[k][i] += powers[k][i] * values[i];
        }
    }
}

/// Upper triangle of the normal equations, and their right side.
#[derive(Default)]
struct Normal([[f32; 9]; 8]);

impl Normal {
    /// Adds the pixels of a row. The design matrix of a pixel is `[gx u, gx v, gx, gy u,
    /// gy v, gy, -u a, -v a]` with `a = gx u + gy v`.
    fn add(&mut self, line: &Line, v: f32) {
        let all = total(line);
        let (xx, xy, yy, xe, ye) = (&all[..5], &all[5..9], &all[9..12], &all[12..15], &all[15..]);
        // Sums of gx a, gy a, a a and a e, times powers of u.
        let xa = [0, 1, 2].map(|k| xx[k + 1] + v * xy[k]);
        let ya = [0, 1, 2].map(|k| xy[k + 1] + v * yy[k]);
        let aa = [0, 1, 2].map(|k| xx[k + 2] + v * (2.0 * xy[k + 1] + v * yy[k]));
        let ae = [0, 1].map(|k| xe[k + 1] + v * ye[k]);
        let rows: [[f32; 9]; 8] = [
            [xx[2], v * xx[1], xx[1], xy[2], v * xy[1], xy[1], -xa[2], -v * xa[1], xe[1]],
            [0.0, v * v * xx[0], v * xx[0], v * xy[1], v * v * xy[0], v * xy[0], -v * xa[1], -v * v * xa[0], v * xe[0]],
            [0.0, 0.0, xx[0], xy[1], v * xy[0], xy[0], -xa[1], -v * xa[0], xe[0]],
            [0.0, 0.0, 0.0, yy[2], v * yy[1], yy[1], -ya[2], -v * ya[1], ye[1]],
            [0.0, 0.0, 0.0, 0.0, v * v * yy[0], v * yy[0], -v * ya[1], -v * v * ya[0], v * ye[0]],
            [0.0, 0.0, 0.0, 0.0, 0.0, yy[0], -ya[1], -v * ya[0], ye[0]],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, aa[2], v * aa[1], -ae[1]],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, v * v * aa[0], -v * ae[0]],
        ];
        for (sums, row) in self.0.iter_mut().zip(&rows) {
            accumulate(sums, row, 1.0);
        }
    }
}

fn chroma_correlation(view: &PyramidView<'_>, template: &Template<'_>, h: &Homography, level: usize) -> f32 {
    let (cw, ch) = (template.width / 2, template.height / 2);
    let planes = view.chroma(level.min(LEVELS - 1));
    let source = template.chroma(0);
    // Chroma px are twice as large on both sides, so the same level fits.
    let to = into_level(level + 1).after(&h.after(&Homography::affine([2.0, 0.0, 0.5, 0.0, 2.0, 0.5])));
    let mut sums = Counts::default();
    // Every second pixel tells as much as it is asked for.
    for y in (0..ch).step_by(2) {
        for x in (0..cw).step_by(2) {
            let [u, v] = to.apply([x as f32, y as f32]);
            let inside = u >= 0.0 && v >= 0.0 && u < planes[0].width() as f32 && v < planes[0].height() as f32;
            let t = source.map(|c| c.row(y)[x].cast_signed());
            let f = planes.map(|p| p.nearest(math::round(u), math::round(v)));
            if inside && t[0] != NO_CHROMA && f[0] != NO_CHROMA {
                sums.add_pair(t.map(i32::from), f.map(i32::from));
            }
        }
    }
    sums.correlation(CHROMA_NOISE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Frame, PixelFormat};
    use crate::model::template_bytes;
    use crate::pyramid::{Pyramid, halve_luma, plane_bytes, reduce_all};
    use std::prelude::rust_2024::*;
    use std::vec;

    const SIDE: usize = 48;

    /// A texture without repetition.
    fn texture(x: f32, y: f32) -> f32 {
        128.0 + 50.0 * (x * 0.31 + (y * 0.17).sin() * 2.0).sin() + 50.0 * (y * 0.23 + (x * 0.11).cos() * 3.0).sin()
    }

    fn setup(hide: bool) -> (Box<Pyramid<40_000, 10_000>>, Vec<u8>, Homography) {
        let h = Homography::affine([1.4, 0.3, 20.0, -0.3, 1.4, 30.0]);
        let inverse = h.inverse().unwrap();
        let frame: Vec<u8> = (0..160 * 120)
            .map(|i| {
                let [x, y] = inverse.apply([(i % 160) as f32, (i / 160) as f32]);
                let hidden = hide && x < 16.0;
                (if hidden { 0.0 } else { texture(x, y) * 0.6 } + 10.0) as u8
            })
            .collect();
        let mut p = Box::new(Pyramid::new());
        p.load(&Frame::new(PixelFormat::Gray8, 160, 120, &frame).unwrap()).unwrap();
        p.reduce();
        let mut template = vec![NO_CHROMA.cast_unsigned(); template_bytes(SIDE, SIDE)];
        let luma = &mut template[..plane_bytes(SIDE, SIDE)];
        for (i, t) in luma[..SIDE * SIDE].iter_mut().enumerate() {
            *t = texture((i % SIDE) as f32, (i / SIDE) as f32) as u8;
        }
        reduce_all(luma, SIDE, SIDE, halve_luma);
        (p, template, h)
    }

    fn template(data: &[u8]) -> Template<'_> {
        Template::new(data, SIDE, SIDE).unwrap()
    }

    #[test]
    fn the_right_place_correlates_and_a_wrong_one_does_not() {
        let (p, data, h) = setup(false);
        let side = SIDE as f32;
        let right = appearance(&p.view(), &template(&data), &h, side, side);
        assert!(right.median > 0.95 && right.blocks == 36, "{right:?}");
        let moved = Homography::affine([1.4, 0.3, 36.0, -0.3, 1.4, 42.0]);
        let wrong = appearance(&p.view(), &template(&data), &moved, side, side);
        assert!(wrong.median < 0.5, "{wrong:?}");
        assert_eq!(right.chroma, 0.0, "a gray frame has no chroma");
    }

    #[test]
    fn refining_brings_a_rough_pose_within_a_quarter_of_a_pixel() {
        for hide in [false, true] {
            let (p, data, h) = setup(hide);
            let rough = Homography([1.46, 0.27, 18.0, -0.25, 1.36, 31.5, 2e-4, -1e-4, 1.0]);
            let side = SIDE as f32;
            let better = refine(&p.view(), &template(&data), &rough, side, side).unwrap();
            for (a, b) in better.outline(side, side).iter().zip(h.outline(side, side)) {
                let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
                // The hidden side is a guess.
                let limit = if hide { 3.0 } else { 0.25 };
                assert!(dx.hypot(dy) < limit, "{a:?} for {b:?}");
            }
        }
    }

    #[test]
    fn hiding_a_third_leaves_the_median() {
        let (p, data, h) = setup(true);
        let a = appearance(&p.view(), &template(&data), &h, SIDE as f32, SIDE as f32);
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
