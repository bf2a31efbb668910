//! Looks at a pose that is nearly believed, and asks what speaks against it.
//!
//! In: the frame's pyramid, a model and a detection. Out: [`Scrutiny`]: how much of the object is
//! seen and agrees, and what kind of disagreement there is. Something in front of an object is one
//! region, brings its own light, and hides the outline. A look-alike disagrees here and there, is
//! printed on the same paper, and shows its outline.
//!
//! Memory: about 1.5 KB of stack. Cost: that of `outline`, and of the template's blocks.

use crate::base::geometry::area;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::appearance::{Blocks, level_of_area};
use crate::detect::detection::Detection;
use crate::detect::light::{BLOCKS, Moments, agreement};
use crate::detect::outline::{Pieces, trace};
use crate::image::pyramid::PyramidView;
use crate::model::parse::{Model, Object};

/// Number of properties.
pub const PROPERTIES: usize = 16;

/// What is seen at a pose: properties, each 0 to 255.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scrutiny(pub [u8; PROPERTIES]);

impl Scrutiny {
    /// Properties that no object has: little of all that speaks for one, and some of what speaks against it. A
    /// test holds the score that they get below 0.2.
    pub const STRANGE: Self = Self([55; PROPERTIES]);
}

/// Names of the properties, in their order.
pub const NAMES: [&str; PROPERTIES] = [
    "good", "agree", "mid", "dis", "clump", "contra", "foreign", "edge", "edgen", "edgevis", "inside", "votes",
    "agreeing", "strong", "vper", "support",
];

/// Mean of a property over blocks, with weights.
#[derive(Clone, Copy)]
struct Mean {
    sum: f32,
    weight: f32,
}

impl Mean {
    const NONE: Self = Self { sum: 0.0, weight: 0.0 };

    #[inline(never)]
    fn add(&mut self, value: f32, weight: f32) {
        self.sum += value * weight;
        self.weight += weight;
    }

    /// The mean, or `otherwise` when nothing was added.
    #[inline(never)]
    fn or(&self, otherwise: f32) -> f32 {
        if self.weight > 1e-3 { self.sum / self.weight } else { otherwise }
    }
}

/// Limits a number to 0 to 1.
#[inline(never)]
fn unit(v: f32) -> f32 {
    v.clamp(0.0, 1.0)
}

/// Minimum correlation of a block that agrees well.
const GOOD: f32 = 0.75;

/// Share of an object from which on it counts as seen plainly, and what its outline then counts as.
const PLAIN: f32 = 0.99;
const PLAIN_STEP: Mean = Mean { sum: 4.5, weight: 1.0 };

/// Minimum share that must agree of what lies in the frame, of an object that lies mostly outside. Right
/// ones had 0.75 and more; wrong ones, which lie over smooth ground with a few strong lines, up to 0.62.
const LEAST_OF_PART: f32 = 0.65;

/// Number of blocks of an object.
const PLACES: usize = BLOCKS * BLOCKS;

/// Light in which an object is seen: brightness of the frame for brightness of the template.
struct Light {
    gain: f32,
    offset: f32,
    /// Reciprocal of the spread of the whole picture in this light.
    scale: f32,
}

impl Light {
    /// How foreign a block is, 0 to 1: how far its mean brightness is from the expected one.
    fn foreign(&self, m: &Moments) -> f32 {
        let off = (m.mean[1] - self.gain * m.mean[0] - self.offset).abs() * self.scale;
        unit((off - 0.15) / 0.3)
    }
}

/// The moments of the blocks, without those that are outside the frame.
struct Grid {
    moments: [Moments; PLACES],
    /// Correlation of each block that counts; NaN for others.
    correlation: [f32; PLACES],
    /// Whether the blocks divide a part of the object, since the rest lies outside the frame.
    is_part: bool,
}

impl Grid {
    #[inline(never)]
    fn new(view: &PyramidView<'_>, o: &Object<'_>, d: &Detection, pace: &mut dyn Pace) -> Self {
        let mut grid = Self { moments: [Moments::default(); PLACES], correlation: [f32::NAN; PLACES], is_part: false };
        let size = [o.width as f32, o.height as f32];
        let mut keep = |i: usize, m: &Moments| {
            pace.goes_on();
            grid.moments[i] = *m;
        };
        let blocks = Blocks::new(view, &o.template, 0, &d.homography, size, &mut keep);
        for (place, value) in blocks.correlations() {
            grid.correlation[place] = value;
        }
        grid.is_part = blocks.is_part(&o.template.luma(0));
        grid
    }

    /// The light in which the blocks that agree are seen.
    #[inline(never)]
    fn light(&self) -> Light {
        let [mut all, mut mean, mut square, mut own] = [0.0f32; 4];
        let ([mut n, mut t, mut f], mut means) = ([0.0f32; 3], [0.0f32; 2]);
        for (m, &r) in self.moments.iter().zip(&self.correlation) {
            if m.n > 0.0 {
                all += 1.0;
                mean += m.mean[0];
                square += m.mean[0] * m.mean[0];
                own += m.t.max(0.0);
            }
            if r > GOOD {
                n += 1.0;
                t += math::coarse_sqrt(m.t.max(0.0));
                f += math::coarse_sqrt(m.f.max(0.0));
                means = [means[0] + m.mean[0], means[1] + m.mean[1]];
            }
        }
        let (all, n) = (all.max(1.0), n.max(1.0));
        let gain = if t > 0.0 { f / t } else { 1.0 };
        let spread = math::coarse_sqrt(((own + square) / all - (mean / all) * (mean / all)).max(1.0));
        Light { gain, offset: (means[1] - gain * means[0]) / n, scale: 1.0 / (gain * spread + 2.0) }
    }

    /// Mean agreement of the neighbours of a block.
    #[inline(never)]
    fn neighbours(&self, i: usize) -> f32 {
        let mut mean = Mean::NONE;
        for (j, &r) in self.correlation.iter().enumerate() {
            let apart = (i % BLOCKS).abs_diff(j % BLOCKS) + (i / BLOCKS).abs_diff(j / BLOCKS);
            if apart == 1 && !r.is_nan() {
                mean.add(agreement(r), 1.0);
            }
        }
        mean.or(0.0)
    }
}

/// Properties of the blocks: means over them.
#[inline(never)]
fn blocks(grid: &Grid) -> [Mean; 7] {
    let light = grid.light();
    let mut means = [Mean::NONE; 7];
    let [good, agree, mid, dis, clump, contra, foreign] = &mut means;
    for (i, (&r, m)) in grid.correlation.iter().zip(&grid.moments).enumerate() {
        if !r.is_nan() {
            let strange = light.foreign(m);
            let (a, near) = (agreement(r), grid.neighbours(i));
            let off = 1.0 - unit(r / 0.7);
            let is = |is: bool| f32::from(u8::from(is));
            good.add(is(r > GOOD), 1.0);
            agree.add(a, 1.0);
            mid.add(is(r > 0.3 && r < GOOD), 1.0);
            clump.add(near, a);
            dis.add(1.0 - near, 1.0 - a);
            contra.add(off * (1.0 - strange), 1.0);
            foreign.add(off * strange, 1.0);
        }
    }
    means
}

/// Steps across the outline, where the object seems hidden and elsewhere: their means.
#[inline(never)]
fn steps(pieces: &Pieces) -> [Mean; 2] {
    let mut means = [Mean::NONE; 2];
    for (i, piece) in pieces.iter().enumerate() {
        let beside = [1, pieces.len() - 1].map(|k| pieces[(i + k) % pieces.len()].inside);
        // Comparisons with NaN are false: a piece that shows nothing is not off, and leaves its
        // neighbours as they are.
        let off = piece.inside < 0.3 && !beside.iter().any(|&r| r >= 0.45);
        if !piece.step.is_nan() {
            means[usize::from(!off)].add(piece.step.clamp(-1.0, 6.0), 1.0);
        }
    }
    means
}

/// Properties of the blocks of an object that is seen plainly.
fn plain(fit: f32) -> [Mean; 7] {
    let is = |sum: f32| Mean { sum, weight: 1.0 };
    [is(1.0), is(fit), Mean::NONE, Mean::NONE, is(fit), Mean::NONE, Mean::NONE]
}

/// Scrutinises a detection. An object that is seen plainly, [`Appearance::visible`], is not looked
/// at again. One that lies mostly outside the frame is [`Scrutiny::STRANGE`] when too little agrees of what lies
/// inside.
///
/// [`Appearance::visible`]: crate::Appearance::visible
#[inline(never)]
#[must_use]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
pub fn scrutinise(view: &PyramidView<'_>, model: &Model<'_>, d: &Detection, pace: &mut dyn Pace) -> Scrutiny {
    let mut means = plain(d.fit());
    let mut outline = [Mean::NONE, PLAIN_STEP];
    if d.appearance.visible < PLAIN {
        let o = model.object(usize::from(d.object));
        let grid = Grid::new(view, &o, d, pace);
        if grid.is_part && d.appearance.visible < LEAST_OF_PART {
            return Scrutiny::STRANGE;
        }
        means = blocks(&grid);
        let template = o.template.luma(0);
        let level = level_of_area(area(&d.corners).abs() / (template.width() * template.height()) as f32);
        outline = steps(&trace(view, &o, d, level, pace));
    }
    let [hidden, shown] = outline;
    let mut values = [0.0; PROPERTIES];
    for (value, mean) in values.iter_mut().zip(&means) {
        *value = mean.or(0.0);
    }
    values[5] *= 2.0;
    let n = hidden.weight;
    values[7] = (n / (n + 4.0) * (hidden.or(2.2) - 2.2) + 3.0) / 6.0;
    values[8] = n / 48.0;
    values[9] = (shown.or(3.0) + 1.0) / 7.0;
    values[10] = f32::from(d.appearance.inside) / PLACES as f32;
    let (votes, agreeing) = (f32::from(d.votes), f32::from(d.agreeing));
    let numbers =
        [(votes, 40.0), (agreeing, 30.0), (d.appearance.strong, 60.0), (0.0, 0.0), (d.appearance.support, 60.0)];
    for (value, (v, scale)) in values[11..].iter_mut().zip(numbers) {
        *value = math::ln(1.0 + v) * scale / 255.0;
    }
    values[14] = values[11] - values[15] * (40.0 / 60.0) + 128.0 / 255.0;
    let mut out = [0; PROPERTIES];
    for (out, v) in out.iter_mut().zip(values) {
        *out = (255.0 * unit(v) + 0.5) as u8;
    }
    Scrutiny(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::light::Moments;
    use std::vec::Vec;

    /// A grid in which the blocks of the right half agree, and the others are as much brighter.
    fn half(brighter: f32) -> Grid {
        let agrees = |i: usize| i % BLOCKS >= BLOCKS / 2;
        let seen = |i: usize| if agrees(i) { 60.0 } else { 60.0 + brighter };
        let moments = |i| Moments { n: 100.0, mean: [100.0, seen(i)], t: 900.0, f: 900.0, tf: 0.0 };
        Grid {
            moments: core::array::from_fn(moments),
            correlation: core::array::from_fn(|i| if agrees(i) { 0.95 } else { 0.0 }),
            is_part: false,
        }
    }

    #[test]
    fn what_disagrees_in_the_light_of_the_object_contradicts_and_a_stranger_hides() {
        let of = |grid: &Grid| blocks(grid).iter().map(|mean| mean.or(0.0)).collect::<Vec<_>>();
        let (same, other) = (of(&half(0.0)), of(&half(80.0)));
        let at = |name: &str| NAMES.iter().position(|&n| n == name).unwrap();
        let (contra, foreign) = (at("contra"), at("foreign"));
        assert_eq!((same[contra], same[foreign]), (0.5, 0.0), "printed on the same paper");
        assert_eq!((other[contra], other[foreign]), (0.0, 0.5), "something in front");
        assert!((same[at("good")] - 0.5).abs() < 1e-6 && same[at("mid")] == 0.0);
    }
}
