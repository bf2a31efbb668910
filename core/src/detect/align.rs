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

use crate::base::capacity::LEVELS;
use crate::base::geometry::{Homography, area, is_convex};
use crate::base::math::{self, VECTORS};
use crate::base::sort::sort;
use crate::detect::overlay::{
    AT_ONCE, BLOCKS, Moments, NO_NUMBERS, NOTHING, Numbers, Overlay, Pairs, Sums, add, add_pairs, block_columns,
    block_ranges, every, number, pixels, row_of_numbers, row_of_steps, steps, times, total,
};
use crate::detect::pose::solve;
use crate::detect::verify::{CHROMA_NOISE, Counts};
use crate::image::frame::NO_CHROMA;
use crate::image::pyramid::{Plane, PyramidView, into_level, nearest, out_of_level};
use crate::model::parse::Template;

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
    /// the template of a picture of `width` x `height` px. How each block is lit goes to `light`.
    #[inline(never)]
    fn new(
        view: &PyramidView<'_>,
        template: &Template<'_>,
        level: usize,
        h: &Homography,
        [width, height]: [f32; 2],
        mut light: Option<&mut Light>,
    ) -> Self {
        let luma = template.luma(level);
        let (w, h_) = (luma.width(), luma.height());
        let h = h.after(&template.to_picture(width, height)).after(&out_of_level(level));
        let target = level_for(&h, w as f32, h_ as f32);
        let overlay = Overlay { luma, plane: view.luma(target), map: into_level(target).after(&h) };
        let columns = block_columns(w, BLOCKS, 0);
        let mut blocks = Self { values: [0.0; BLOCKS * BLOCKS], places: [0; BLOCKS * BLOCKS], n: 0, inside: 0 };
        let mut places = 0u8..;
        for ys in block_ranges(h_, BLOCKS, 0) {
            for (pairs, place) in overlay.correlate(ys, &columns).iter().zip(&mut places) {
                let m = Moments::new(pairs);
                if let Some(light) = &mut light {
                    light[usize::from(place)] = Shade::new(&m);
                }
                blocks.add(place, &m, (w * h_ / (BLOCKS * BLOCKS)) as f32 / number(every(&luma)));
            }
        }
        blocks
    }

    /// Adds a block that has `full` pixels.
    fn add(&mut self, place: u8, m: &Moments, full: f32) {
        if m.n < 0.6 * full {
            return;
        }
        self.inside += 1;
        if m.t >= LEAST_SPREAD * LEAST_SPREAD {
            // A flat frame block correlates with nothing.
            self.values[self.n] = m.tf / math::coarse_sqrt(m.t * m.f.max(4.0));
            self.places[self.n] = place;
            self.n += 1;
        }
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
    let mut blocks = Blocks::new(view, template, 0, h, size, None);
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
    Blocks::new(view, template, level, h, size, None).support()
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
    Refinement { level: 2, blocks: 4, times: 5, still: 0.2, keep: 1.0 },
    Refinement { level: 1, blocks: 6, times: 4, still: 0.15, keep: 1.0 },
    Refinement { level: 0, blocks: 6, times: 3, still: 0.12, keep: 0.98 },
];

/// The finest steps cannot lose the object on so short a way, px of the template.
const SHORT_WAY: f32 = 1.0;

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
    // Blocks of the middle level say how many agree, and how each is lit.
    let seen =
        |h: &Homography, light: &mut Light| Blocks::new(view, template, 1, h, [width, height], Some(light)).support();
    let mut light = NO_LIGHT;
    let (mut best, mut most) = (*h, seen(h, &mut light));
    if most < least[0] {
        return None;
    }
    let mut lit = light;
    let back = to_picture.after(&unit).inverse()?;
    for &Refinement { level, blocks, times, still, keep } in steps {
        let coarse = Coarse::new(template, level, blocks, side, middle);
        let mut g = best.after(&to_picture).after(&unit);
        // Other blocks are lit otherwise.
        let known = blocks == BLOCKS;
        light = lit;
        let mut way = 0.0;
        for i in 0..times {
            let Some((next, moved)) = coarse.improve(view, &g, &mut light, known, known && i + 1 < times) else {
                break;
            };
            g = next;
            way += moved;
            if moved < still {
                break;
            }
        }
        let g = g.after(&back).normalised();
        if level == 0 && way < SHORT_WAY {
            return Some(g);
        }
        let support = seen(&g, &mut light);
        if support > keep * most {
            (best, most, lit) = (g, support, light);
        }
        if most < least[1] {
            return None;
        }
    }
    Some(best)
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
        light: &mut Light,
        known: bool,
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
        self.look(&overlay, &unit, light, known, again, &mut normal);
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
        light: &mut Light,
        known: bool,
        again: bool,
        normal: &mut Normal,
    ) {
        let [mut numbers, mut across, mut down] = [NO_NUMBERS; 3];
        // Gradients of unit coordinates from differences over two px.
        let per_unit = self.side / (2.0 * self.step as f32);
        let [w, h] = self.size;
        let mut frame = NOTHING;
        let whole = block_columns(w, self.blocks, 1);
        let mut cells = whole[..self.blocks].iter().flat_map(halves);
        let columns: [Range<usize>; 2 * BLOCKS] = core::array::from_fn(|_| cells.next().unwrap_or_default());
        let columns = &columns[..2 * self.blocks];
        for (ys, light) in block_ranges(h, self.blocks, 1).zip(light.chunks_exact_mut(self.blocks)) {
            if !known {
                let pairs = overlay.correlate(ys.clone(), &whole[..self.blocks]);
                Shade::renew(light, &pairs);
            }
            let mut pairs: [Pairs; BLOCKS] = Default::default();
            for ys in halves(&ys) {
                let mut errors: [Errors; 2 * BLOCKS] = Default::default();
                for y in ys.clone() {
                    let [above, row, below] = [y - 1, y, y + 1].map(|y| self.luma.row(y));
                    row_of_numbers(row, &mut numbers);
                    // As many of each as have neighbours.
                    let n = w.saturating_sub(2);
                    let beside = [&row[..n], &row[w - n..]];
                    let upright = [above, below].map(|row| &row[(w - n) / 2..][..n]);
                    row_of_steps(beside, &mut across);
                    row_of_steps(upright, &mut down);
                    let track = overlay.row(y, &mut frame);
                    for (cell, (errors, xs)) in errors.iter_mut().zip(columns).enumerate() {
                        let (shade, pairs) = (&light[cell / 2], &mut pairs[cell / 2]);
                        if shade.weight < LEAST_WEIGHT {
                            continue;
                        }
                        // From far off all pixels help to come near.
                        let flat = if self.step == 1 { shade.flat } else { 0.0 };
                        for x in xs.clone().step_by(AT_ONCE) {
                            let (gx, gy) = (steps(beside, &across, x), steps(upright, &down, x));
                            let strong: [bool; AT_ONCE] = core::array::from_fn(|i| gx[i].abs() + gy[i].abs() >= flat);
                            if !VECTORS && !strong[0] {
                                continue;
                            }
                            let Some((f, mut seen)) = track.group(&frame, x, xs.end - x) else { continue };
                            if VECTORS {
                                seen = core::array::from_fn(|i| if strong[i] { seen[i] } else { 0.0 });
                            }
                            let t = pixels(row, &numbers, x);
                            if again {
                                add_pairs(pairs, x - xs.start, &t, &f, &seen);
                            }
                            add_errors(errors, x - xs.start, shade, [&gx, &gy], [&t, &f], &seen);
                        }
                    }
                }
                let v = unit.0[4] * middle(&ys) + unit.0[5];
                for (cell, (errors, xs)) in errors.iter().zip(columns).enumerate() {
                    let u = unit.0[0] * middle(xs) + unit.0[2];
                    normal.add(&total(errors), light[cell / 2].scale_t * per_unit, [u, v]);
                }
            }
            if again {
                Shade::renew(light, &pairs);
            }
        }
    }
}

/// The first and the second half of some pixels.
fn halves(range: &Range<usize>) -> [Range<usize>; 2] {
    let middle = (range.start + range.end).div_ceil(2);
    [range.start..middle, middle..range.end]
}

/// Where the middle of some pixels lies.
fn middle(range: &Range<usize>) -> f32 {
    number(range.start + range.end - 1) / 2.0
}

/// How a block is lit in template and frame, and how much it counts.
#[derive(Clone, Copy)]
struct Shade {
    scale_t: f32,
    scale_f: f32,
    /// What takes the one's mean to the other's, so scaled.
    offset: f32,
    weight: f32,
    /// Least steps of a pixel that counts, gray levels.
    flat: f32,
}

impl Shade {
    /// Of a row of blocks.
    #[inline(never)]
    fn renew(light: &mut [Self], pairs: &[Pairs; BLOCKS]) {
        for (shade, pairs) in light.iter_mut().zip(pairs) {
            *shade = Self::new(&Moments::new(pairs));
        }
    }

    fn new(m: &Moments) -> Self {
        let usable = m.t > 4.0 && m.f > 1.0;
        let correlation = if usable { m.tf / math::coarse_sqrt(m.t * m.f) } else { 0.0 };
        let [scale_t, scale_f] = [m.t, m.f].map(|v| 1.0 / math::coarse_sqrt(v.max(1.0)));
        let offset = m.mean[0] * scale_t - m.mean[1] * scale_f;
        Self { scale_t, scale_f, offset, weight: agreement(correlation), flat: (FLAT / scale_t).min(STEEP) }
    }
}

/// Pixels whose steps, along and across, together are less than so many spreads of their block
/// are left out, unless they are this many gray levels: of what is flat there, noise is most.
const FLAT: f32 = 0.8;
const STEEP: f32 = 16.0;

/// Blocks that count less are left out.
const LEAST_WEIGHT: f32 = 0.05;

type Light = [Shade; BLOCKS * BLOCKS];
const NO_LIGHT: Light = [Shade { scale_t: 0.0, scale_f: 0.0, offset: 0.0, weight: 0.0, flat: 0.0 }; BLOCKS * BLOCKS];

/// Weighted sums over a block: of the products of the steps, `x x`, `x y`, `y y`, and of each
/// with the error, what the frame shows less what it should.
type Errors = Sums<5>;

/// Adds pixels beside each other.
#[inline(always)]
fn add_errors(
    sums: &mut Errors,
    lane: usize,
    shade: &Shade,
    [gx, gy]: [&Numbers; 2],
    [t, f]: [&Numbers; 2],
    seen: &Numbers,
) {
    let e: Numbers = core::array::from_fn(|i| f[i] * shade.scale_f - t[i] * shade.scale_t + shade.offset);
    let weight = core::array::from_fn(|i| seen[i] * (shade.weight / (1.0 + e[i] * e[i])));
    let (wx, wy) = (times(&weight, gx), times(&weight, gy));
    add(sums, lane, [times(&wx, gx), times(&wx, gy), times(&wy, gy), times(&wx, &e), times(&wy, &e)]);
}

/// Upper triangle of the normal equations, and their right side.
#[derive(Default)]
struct Normal([[f32; 9]; 8]);

impl Normal {
    /// Adds pixels as if all of them lay at `(u, v)`: the design matrix of one is `[gx u, gx v, gx,
    /// gy u, gy v, gy, -u a, -v a]` with `a = gx u + gy v`. Their gradients are their steps times
    /// `scale`.
    fn add(&mut self, sums: &[f32; 5], scale: f32, [u, v]: [f32; 2]) {
        let [xx, xy, yy] = [0, 1, 2].map(|i| sums[i] * (scale * scale));
        let [xe, ye] = [3, 4].map(|i| sums[i] * scale);
        // Sums of gx a, gy a, a a and a e.
        let (xa, ya, ae) = (xx * u + xy * v, xy * u + yy * v, xe * u + ye * v);
        let aa = xa * u + ya * v;
        let place = [u, v, 1.0];
        let m = &mut self.0;
        for i in 0..3 {
            for j in 0..3 {
                let product = place[i] * place[j];
                if j >= i {
                    m[i][j] += product * xx;
                    m[3 + i][3 + j] += product * yy;
                }
                m[i][3 + j] += product * xy;
            }
            for j in 0..2 {
                let product = place[i] * place[j];
                m[i][6 + j] -= product * xa;
                m[3 + i][6 + j] -= product * ya;
            }
            m[i][8] += place[i] * xe;
            m[3 + i][8] += place[i] * ye;
        }
        for i in 0..2 {
            for j in i..2 {
                m[6 + i][6 + j] += place[i] * place[j] * aa;
            }
            m[6 + i][8] -= place[i] * ae;
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
            let f = nearest(planes, math::round(u), math::round(v));
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
    use crate::image::frame::{Frame, PixelFormat};
    use crate::image::pyramid::{Pyramid, halve_luma, plane_bytes, reduce_all};
    use crate::model::format::template_bytes;
    use std::prelude::rust_2024::*;
    use std::vec;

    const SIDE: usize = if cfg!(miri) { 48 } else { 96 };
    const WIDTH: usize = 5 * SIDE / 2;
    const HEIGHT: usize = 3 * WIDTH / 4;
    /// Where the object lies in the frame.
    const PLACE: [f32; 2] = [WIDTH as f32 / 12.0, WIDTH as f32 / 8.0];

    /// A texture without repetition.
    fn texture(x: f32, y: f32) -> f32 {
        128.0 + 50.0 * (x * 0.31 + (y * 0.17).sin() * 2.0).sin() + 50.0 * (y * 0.23 + (x * 0.11).cos() * 3.0).sin()
    }

    fn setup(hide: bool) -> (Box<Pyramid<60_000, 15_000>>, Vec<u8>, Homography) {
        let h = Homography::affine([1.4, 0.3, PLACE[0], -0.3, 1.4, PLACE[1]]);
        let inverse = h.inverse().unwrap();
        let frame: Vec<u8> = (0..WIDTH * HEIGHT)
            .map(|i| {
                let [x, y] = inverse.apply([(i % WIDTH) as f32, (i / WIDTH) as f32]);
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
        let moved = Homography::affine([1.4, 0.3, PLACE[0] + 16.0, -0.3, 1.4, PLACE[1] + 12.0]);
        let wrong = appearance(&p.view(), &template(&data), &moved, side, side);
        assert!(wrong.median < 0.5, "{wrong:?}");
        assert_eq!(right.chroma, 0.0, "a gray frame has no chroma");
    }

    #[test]
    fn refining_brings_a_rough_pose_within_a_quarter_of_a_pixel() {
        for hide in [false, true] {
            let (p, data, h) = setup(hide);
            let rough = Homography([1.46, 0.27, PLACE[0] - 2.0, -0.25, 1.36, PLACE[1] + 1.5, 2e-4, -1e-4, 1.0]);
            let side = SIDE as f32;
            let better = refine(&p.view(), &template(&data), &rough, side, side).unwrap();
            for (a, b) in better.outline(side, side).iter().zip(h.outline(side, side)) {
                let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
                // The hidden side is a guess; where there is little to see so are the others.
                let limit = if hide { 3.0 } else { 0.25 * (96 / SIDE).pow(2) as f32 };
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
