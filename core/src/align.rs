//! Does the frame look like the object where the pose says it is?
//!
//! In: the frame's pyramid, the object's template and a homography. Out: how well
//! blocks of the template correlate with the frame. The frame is warped into the
//! template; each of 6 x 6 blocks is correlated for itself (zero mean, unit
//! spread), so that light may differ from block to block and a hidden part loses
//! its blocks and not the object. Blocks without texture, or outside the frame,
//! do not count.
//!
//! Memory: some 2 KB of stack. Cost: one bilinear sample for each pixel
//! of the template (9,216 at most).

use crate::capacity::LEVELS;
use crate::frame::NO_CHROMA;
use crate::geometry::{Homography, area, is_convex};
use crate::math;
use crate::model::Template;
use crate::pose::solve;
use crate::pyramid::{Plane, PyramidView, into_level, out_of_level};
use crate::sort::sort;

/// Blocks each way.
pub const BLOCKS: usize = 6;

/// Least spread of a block of the template, gray levels, for it to count.
const LEAST_SPREAD: f32 = 5.0;

/// Blocks that must agree after the coarse steps for the finer ones to be worth it.
const HOPELESS: f32 = 0.8;

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
    /// How many agree well: the sum of the squares of their agreements. Many blocks
    /// that agree a little are what aligning makes of a wrong pose.
    pub strong: f32,
    /// Correlation of chroma over the whole object, -1 to 1; 0 when either has
    /// too little chroma to tell.
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

/// Running sums of a correlation.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f32,
    t: f32,
    f: f32,
    tt: f32,
    ff: f32,
    tf: f32,
}

impl Sums {
    /// Adds a pixel of the template and one of the frame.
    fn add(&mut self, t: f32, f: f32) {
        self.n += 1.0;
        self.t += t;
        self.f += f;
        self.tt += t * t;
        self.ff += f * f;
        self.tf += t * f;
    }

    /// Mean of the template and of the frame.
    fn means(&self) -> (f32, f32) {
        let n = self.n.max(1.0);
        (self.t / n, self.f / n)
    }

    /// Variance of the template, variance of the frame, covariance.
    fn moments(&self) -> (f32, f32, f32) {
        let n = self.n.max(1.0);
        let (t, f) = self.means();
        (self.tt / n - t * t, self.ff / n - f * f, self.tf / n - t * f)
    }
}

/// The pyramid level whose pixels are about as large in the frame as those of the
/// template are under `h` (template px to frame px).
fn level_for(h: &Homography, width: f32, height: f32) -> usize {
    let a = area(&h.outline(width, height)).abs() / (width * height);
    // Half a log2 of the area ratio, rounded.
    let l = math::round(math::log2(a.max(1e-3)) / 2.0 - 0.2);
    usize::try_from(l).unwrap_or(0).min(LEVELS - 1)
}

/// Correlations of the blocks of a level of the template.
struct Blocks {
    values: [f32; BLOCKS * BLOCKS],
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
        let mut sums = [Sums::default(); BLOCKS * BLOCKS];
        for y in 0..th {
            let first = y * BLOCKS / th * BLOCKS;
            for (x, &t) in luma.row(y).iter().enumerate() {
                if let Some(f) = bilinear(&plane, map.apply([x as f32, y as f32])) {
                    sums[first + x * BLOCKS / tw].add(f32::from(t), f);
                }
            }
        }
        let full = (tw * th / (BLOCKS * BLOCKS)) as f32;
        let mut blocks = Self { values: [0.0; BLOCKS * BLOCKS], n: 0, inside: 0 };
        for s in &sums {
            let (t, f, tf) = s.moments();
            if s.n < 0.6 * full {
                continue;
            }
            blocks.inside += 1;
            if t >= LEAST_SPREAD * LEAST_SPREAD {
                // A flat frame block correlates with nothing.
                blocks.values[blocks.n] = tf / math::sqrt(t * f.max(4.0));
                blocks.n += 1;
            }
        }
        blocks
    }

    fn support(&self) -> f32 {
        self.values[..self.n].iter().map(|&c| agreement(c)).sum()
    }

    fn strong(&self) -> f32 {
        self.values[..self.n].iter().map(|&c| agreement(c) * agreement(c)).sum()
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
    Appearance { chroma, ..appearance_of_luma(view, template, 0, h, [width, height]) }
}

/// The same without chroma, which is 0, on level `level` of the template.
pub(crate) fn appearance_of_luma(
    view: &PyramidView<'_>,
    template: &Template<'_>,
    level: usize,
    h: &Homography,
    size: [f32; 2],
) -> Appearance {
    let mut blocks = Blocks::new(view, template, level, h, size);
    Appearance {
        blocks: u16::try_from(blocks.n).unwrap_or(0),
        inside: blocks.inside,
        support: blocks.support(),
        strong: blocks.strong(),
        median: blocks.median(),
        chroma: 0.0,
    }
}

/// A step of [`refine`]: level of the template, blocks each way whose light is
/// evened out, how often, and the share of the support so far that must be left.
/// Support is seen on level 1, too coarse to tell what the finest step gains: it
/// must only not lose the object.
pub(crate) type Refinement = (usize, usize, usize, f32);
const REFINEMENTS: [Refinement; 3] = [(2, 4, 5, 1.0), (1, 6, 4, 1.0), (0, 6, 3, 0.98)];

/// Aligns the frame with the template by their gradients, starting at `h` (picture
/// px to frame px), from coarse to fine, and gives the homography that most blocks
/// support. A hidden half can pull a right pose away: such a step is not taken.
///
/// Inverse compositional Gauss-Newton (S. Baker, I. Matthews, *Lucas-Kanade 20
/// Years On*, IJCV 2004), with zero mean and unit spread in each block, and blocks
/// weighted by how well they correlate.
#[must_use]
pub fn refine(view: &PyramidView<'_>, template: &Template<'_>, h: &Homography, width: f32, height: f32) -> Homography {
    refine_by(&REFINEMENTS, view, template, h, [width, height])
}

/// [`refine`] by these steps.
pub(crate) fn refine_by(
    steps: &[Refinement],
    view: &PyramidView<'_>,
    template: &Template<'_>,
    h: &Homography,
    [width, height]: [f32; 2],
) -> Homography {
    let side = template.width.max(template.height) as f32;
    let middle = [template.width, template.height].map(|v| (v as f32 - 1.0) / 2.0);
    // Template px from coordinates near 1, with the origin in the middle.
    let unit = Homography::affine([side, 0.0, middle[0], 0.0, side, middle[1]]);
    let to_picture = template.to_picture(width, height);
    let support = |h: &Homography| Blocks::new(view, template, 1, h, [width, height]).support();
    let mut best = (*h, support(h));
    let Some(back) = to_picture.after(&unit).inverse() else {
        return *h;
    };
    for &(level, blocks, times, keep) in steps {
        let coarse = Coarse::new(template, level, blocks, side, middle);
        let mut g = best.0.after(&to_picture).after(&unit);
        for _ in 0..times {
            let Some(next) = coarse.improve(view, &g) else { break };
            g = next;
        }
        let g = g.after(&back).normalised();
        let seen = support(&g);
        if seen > keep * best.1 {
            best = (g, seen);
        }
        if best.1 < HOPELESS {
            break;
        }
    }
    best.0
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

    fn at(&self, x: usize, y: usize) -> f32 {
        f32::from(self.luma.row(y)[x])
    }

    /// Coordinates near 1 of the middle of coarse pixel `(x, y)`.
    fn unit(&self, x: usize, y: usize) -> [f32; 2] {
        let at = |v: usize, middle: f32| ((v * self.step) as f32 + (self.step as f32 - 1.0) / 2.0 - middle) / self.side;
        [at(x, self.middle[0]), at(y, self.middle[1])]
    }

    /// Calls `f(block, x, y, unit coordinates, frame)` for each inner coarse pixel
    /// that lies in the frame.
    fn each(&self, plane: &Plane<'_, u8>, g: &Homography, mut f: impl FnMut(usize, usize, usize, [f32; 2], f32)) {
        let [w, h] = self.size;
        for y in 1..h.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let u = self.unit(x, y);
                if let Some(v) = bilinear(plane, g.apply(u)) {
                    f(y * self.blocks / h * self.blocks + x * self.blocks / w, x, y, u, v);
                }
            }
        }
    }

    /// One Gauss-Newton step of `g`, which maps unit coordinates to the frame.
    fn improve(&self, view: &PyramidView<'_>, g: &Homography) -> Option<Homography> {
        let corner = |x: f32, y: f32| g.apply([x / self.side, y / self.side]);
        let [w, h] = [self.middle[0], self.middle[1]];
        let outline = [corner(-w, -h), corner(w, -h), corner(w, h), corner(-w, h)];
        if !is_plausible(&outline, 100.0, 5.0) {
            return None;
        }
        let px2 = area(&outline) / (self.size[0] * self.size[1]) as f32;
        let level = usize::try_from(math::round(math::log2(px2) / 2.0 - 0.2)).unwrap_or(0).min(LEVELS - 1);
        let plane = view.luma(level);
        let at = into_level(level).after(g);

        let mut sums = [Sums::default(); BLOCKS * BLOCKS];
        self.each(&plane, &at, |b, x, y, _, f| sums[b].add(self.at(x, y), f));
        let light = sums.map(|s| {
            let (t, f, tf) = s.moments();
            let (tm, fm) = s.means();
            let usable = t > 4.0 && f > 1.0;
            let correlation = if usable { tf / math::sqrt(t * f) } else { 0.0 };
            let weight = agreement(correlation);
            let (ts, fs) = (1.0 / math::sqrt(t.max(1.0)), 1.0 / math::sqrt(f.max(1.0)));
            (tm, ts, fm, fs, weight)
        });

        let mut normal = [[0.0f32; 9]; 8];
        self.each(&plane, &at, |b, x, y, [u, v], f| {
            let (tm, ts, fm, fs, weight) = light[b];
            if weight < 0.05 {
                return;
            }
            let e = (f - fm) * fs - (self.at(x, y) - tm) * ts;
            // Gradient in unit coordinates.
            let k = ts * self.side / (2.0 * self.step as f32);
            let gx = (self.at(x + 1, y) - self.at(x - 1, y)) * k;
            let gy = (self.at(x, y + 1) - self.at(x, y - 1)) * k;
            let along = gx * u + gy * v;
            let row = [gx * u, gx * v, gx, gy * u, gy * v, gy, -u * along, -v * along, e];
            let w = weight / (1.0 + e * e);
            for i in 0..8 {
                let r = w * row[i];
                for j in i..9 {
                    normal[i][j] += r * row[j];
                }
            }
        });
        // Damping: a little of each direction's own curvature.
        for (i, row) in normal.iter_mut().enumerate() {
            row[i] *= if i < 6 { 1.001 } else { 1.01 };
            row[i] += 1e-3;
        }
        let d = solve(&mut normal, 8)?;
        let step = Homography([1.0 + d[0], d[1], d[2], d[3], 1.0 + d[4], d[5], d[6], d[7], 1.0]);
        let g = g.after(&step.inverse()?).normalised();
        g.0.iter().all(|v| v.is_finite()).then_some(g)
    }
}

/// Bilinear sample; `None` outside the plane.
fn bilinear(plane: &Plane<'_, u8>, [x, y]: [f32; 2]) -> Option<f32> {
    let (w, h) = (plane.width() as f32, plane.height() as f32);
    if !(x >= 0.0 && y >= 0.0 && x < w - 1.0 && y < h - 1.0) {
        return None;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the plane")]
    let (ix, iy) = (x as usize, y as usize);
    let (fx, fy) = (x - ix as f32, y - iy as f32);
    let (top, low) = (&plane.row(iy)[ix..ix + 2], &plane.row(iy + 1)[ix..ix + 2]);
    let mix = |r: &[u8]| f32::from(r[0]) + fx * (f32::from(r[1]) - f32::from(r[0]));
    let (a, b) = (mix(top), mix(low));
    Some(a + fy * (b - a))
}

fn chroma_correlation(view: &PyramidView<'_>, template: &Template<'_>, h: &Homography, level: usize) -> f32 {
    let (cw, ch) = (template.width / 2, template.height / 2);
    let planes = view.chroma(level.min(LEVELS - 1));
    let source = template.chroma(0);
    // Chroma px are twice as large on both sides, so the same level fits.
    let to = into_level(level + 1).after(&h.after(&Homography::affine([2.0, 0.0, 0.5, 0.0, 2.0, 0.5])));
    let mut sums = [Sums::default(); 2];
    for y in 0..ch {
        for x in 0..cw {
            let [u, v] = to.apply([x as f32, y as f32]);
            let inside = u >= 0.0 && v >= 0.0 && u < planes[0].width() as f32 && v < planes[0].height() as f32;
            let t = source.map(|c| c.row(y)[x].cast_signed());
            let f = planes.map(|p| p.nearest(math::round(u), math::round(v)));
            if inside && t[0] != NO_CHROMA && f[0] != NO_CHROMA {
                for i in 0..2 {
                    sums[i].add(f32::from(t[i]), f32::from(f[i]));
                }
            }
        }
    }
    let [a, b] = sums.map(|s| s.moments());
    let (t, f, tf) = (a.0 + b.0, a.1 + b.1, a.2 + b.2);
    // Less than four steps of 127: noise.
    if t < 16.0 || f < 16.0 { 0.0 } else { tf / math::sqrt(t * f) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Frame, PixelFormat};
    use crate::model::template_bytes;
    use crate::pyramid::{Pyramid, luma_mean, plane_bytes, reduce_all};
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
        reduce_all(luma, SIDE, SIDE, luma_mean);
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
            let better = refine(&p.view(), &template(&data), &rough, side, side);
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
