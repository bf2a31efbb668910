//! Looks at a pose that is nearly believed, and asks what speaks against it.
//!
//! In: the frame's pyramid, a model and a detection. Out: [`Scrutiny`]: how much of the object is
//! seen and agrees, and what kind of disagreement there is. Something in front of an object is one
//! region, brings its own light and colour, and hides the outline; beside it all agrees. A look-alike
//! agrees and disagrees here and there, also in light and colour, and shows its outline.
//!
//! Memory: about 2.7 KB of stack, and that of `overlay` while the mosaic is laid. Cost: that of `mosaic` and of
//! `outline`.

use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::appearance::is_part;
use crate::detect::detection::Detection;
use crate::detect::light::BLOCKS;
use crate::detect::mosaic::{ALL, Cell, Mosaic, SIDE, byte, lay};
use crate::detect::outline::{Pieces, cell_at, is_bordered, trace};
use crate::image::pixels::NO_CHROMA;
use crate::image::pyramid::PyramidView;
use crate::model::parse::Model;

/// Number of properties.
pub const PROPERTIES: usize = 12;

/// What is seen at a pose: properties, each 0 to 255, and whether the outline is a border where the object seems hidden:
/// the border of a look-alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scrutiny(pub [u8; PROPERTIES], pub bool);

impl Scrutiny {
    /// Returns what is seen at the pose, with another number of votes that agree.
    #[inline(never)]
    pub(crate) fn with_votes(mut self, votes: u16) -> Self {
        self.0[PROPERTIES - 1] = share(math::ln(1.0 + f32::from(votes)) * 40.0 / 255.0);
        self
    }
}

/// Names of the properties, in their order. 255 stands for the number in brackets.
///
/// - `agree`: mean agreement of the textured cells (1).
/// - `mid`: share of them that neither agree nor disagree (1).
/// - `foreign`: how far the light of those that disagree is from the expected one, in spreads of the picture (2).
/// - `tint`: how far the chroma of cells that agree is from the expected one, in its spreads (2); 0 in a gray frame.
/// - `strange`: the same of cells that disagree (4).
/// - `colour`: spread of the picture's chroma (64 steps); 0 for a gray picture.
/// - `clump`: how much the neighbours of cells that agree do, too (1).
/// - `dis`: how much the neighbours of cells that disagree do, too (1).
/// - `hidden`: share of the pieces of the outline beside cells that disagree (1).
/// - `edge`: how far the outline stands out beside cells that agree (-1 to 6 spreads).
/// - `inside`: share of the object that lies in the frame (1).
/// - `votes`: 40 times the natural logarithm of 1 and the votes.
pub const NAMES: [&str; PROPERTIES] =
    ["agree", "mid", "foreign", "tint", "strange", "colour", "clump", "dis", "hidden", "edge", "inside", "votes"];

/// Number of properties of the cells and of the outline.
const OF_CELLS: usize = PROPERTIES - 2;

/// Properties of the cells and of the outline of an object that is seen plainly.
const PLAIN_CELLS: [u8; OF_CELLS] = [255, 0, 0, 13, 0, 128, 255, 0, 0, 191];

/// Correlation above which a cell agrees, and below which it disagrees.
const GOOD: f32 = 0.7;
const OFF: f32 = 0.4;

/// Agreement of a cell below which the outline beside it seems hidden, and above which it is looked at.
const COVERED: f32 = 0.125;
const BARE: f32 = 0.75;

/// Spread of a flat cell of the template, and of the noise of the frame, gray levels.
const FLAT: f32 = 6.0;
const NOISE: f32 = 4.0;

/// Least spread of a picture, gray levels.
const LEAST_SPREAD: f32 = 2.0;

/// Maximum difference of the mean brightness of a flat cell that agrees, in spreads of the picture.
const LIT: f32 = 0.25;

/// Part by which the gain may be wrong: a blurred frame has less contrast than its light.
const UNSURE: f32 = 0.35;

/// Part with which the spreads within cells count beside those between them: a blurred frame has less of them.
const WITHIN: f32 = 0.25;

/// Least gain of the light and of the colour.
const LEAST_GAIN: f32 = 0.05;

/// Spread of the noise of chroma in a cell, steps.
const CHROMA_NOISE: f32 = 6.0;

/// Share of an object from which on it counts as seen plainly, when its colours are its own or nothing is known of them:
/// the correlation of chroma from which on they are.
const PLAIN: f32 = 0.99;
const OWN_COLOURS: f32 = 0.75;

/// Share of an object that must be seen for its outline not to be looked at as a border. Bent objects show one, too, but
/// more of them agrees.
const MOST_HIDDEN: f32 = 0.5;

/// Minimum share that must agree of what lies in the frame, of an object that lies mostly outside. Right
/// ones had 0.75 and more; wrong ones, which lie over smooth ground with a few strong lines, up to 0.62.
const LEAST_OF_PART: f32 = 0.65;

/// Number of blocks of a whole object.
const BLOCKS_OF_ALL: f32 = (BLOCKS * BLOCKS) as f32;

/// Mean of a property, with weights.
#[derive(Clone, Copy)]
struct Mean {
    sum: f32,
    weight: f32,
}

impl Mean {
    const NONE: Self = Self { sum: 0.0, weight: 0.0 };

    fn add(&mut self, value: f32, weight: f32) {
        self.add_sums(value * weight, weight);
    }

    #[inline(never)]
    fn add_sums(&mut self, sum: f32, weight: f32) {
        self.sum += sum;
        self.weight += weight;
    }

    /// The mean, or `otherwise` when nothing was added.
    #[inline(never)]
    fn or(&self, otherwise: f32) -> f32 {
        if self.weight > 1e-3 { self.sum / self.weight } else { otherwise }
    }
}

/// Means of pairs of numbers: of the first, of the second, of the squares of the first, and of the products.
#[derive(Clone, Copy)]
struct Pairs([Mean; 4]);

impl Pairs {
    const NONE: Self = Self([Mean::NONE; 4]);

    #[inline(never)]
    fn add(&mut self, [t, f]: [f32; 2], weight: f32) {
        for (mean, value) in self.0.iter_mut().zip([t, f, t * t, t * f]) {
            mean.add(value, weight);
        }
    }

    /// The means, the variance of the first numbers, and the covariance.
    #[inline(never)]
    fn moments(&self) -> [f32; 4] {
        let [t, f, tt, tf] = self.0.map(|mean| mean.or(0.0));
        [t, f, (tt - t * t).max(0.0), tf - t * f]
    }
}

/// A share as a property: 255 for 1.
#[inline(never)]
fn share(v: f32) -> u8 {
    byte(255.0 * v + 0.5)
}

/// 1 for true.
fn number(is: bool) -> f32 {
    f32::from(u8::from(is))
}

impl Cell {
    /// Correlation with the frame; NaN for a flat cell, and where the frame does not show it.
    #[inline(never)]
    fn value(&self) -> f32 {
        if self.is_seen && self.is_textured { f32::from(self.correlation) / 127.0 } else { f32::NAN }
    }
}

/// A line through pairs of numbers: what the frame shows for what the template says.
struct Line {
    gain: f32,
    offset: f32,
    /// Mean of what the template says where it agrees.
    middle: f32,
}

impl Line {
    /// The line through these pairs. `more` are the variance and the covariance of others, whose means are not known.
    #[inline(never)]
    fn through(pairs: &Pairs, more: [f32; 2]) -> Self {
        let [middle, f, tt, tf] = pairs.moments();
        let gain = (tf + more[1]) / (tt + more[0]).max(1e-3);
        let gain = gain.clamp(LEAST_GAIN, 4.0);
        Self { gain, offset: f - gain * middle, middle }
    }

    /// How far the second number is from the line.
    fn off(&self, [t, f]: [f32; 2]) -> f32 {
        (f - self.gain * t - self.offset).abs()
    }
}

/// Light and colour in which an object is seen: those of the cells that agree.
struct Light {
    luma: Line,
    chroma: [Line; 2],
    /// Spread of the whole picture in this light, with that of the noise.
    spread: f32,
    /// Spread of the picture's chroma, and what the frame shows of it, with that of the noise.
    colour: f32,
    shown: f32,
}

impl Light {
    #[inline(never)]
    fn new(mosaic: &Mosaic) -> Self {
        // Of all cells, and of those that agree.
        let (mut all, mut own, mut inner) = ([Pairs::NONE; 3], Mean::NONE, Pairs::NONE);
        let mut agreeing = [Pairs::NONE; 3];
        for cell in mosaic.iter().filter(|cell| cell.is_seen) {
            let agrees = number(cell.value() > GOOD);
            let (mean, spread) = (cell.mean.map(f32::from), cell.spread.map(f32::from));
            all[2].add(mean, 1.0);
            agreeing[2].add(mean, agrees);
            own.add(spread[0] * spread[0], 1.0);
            inner.add(spread, agrees);
            let [t, f] = cell.chroma;
            let [in_template, in_both] = [t[0] != NO_CHROMA, f[0] != NO_CHROMA].map(number);
            for i in 0..2 {
                let pair = [t[i], f[i]].map(f32::from);
                all[i].add(pair, in_template);
                agreeing[i].add(pair, in_both * agrees);
            }
        }
        let [.., squares, products] = inner.0.map(|mean| WITHIN * mean.or(0.0));
        let luma = Line::through(&agreeing[2], [squares, products]);
        // Of one colour alone no line is known: it counts as if it was shown as it is.
        let chroma = [0, 1].map(|i| Line::through(&agreeing[i], [CHROMA_NOISE * CHROMA_NOISE; 2]));
        let [a, b, whole] = all.map(|pairs| pairs.moments()[2]);
        let colour = math::coarse_sqrt(a + b);
        let shown = 0.5 * (chroma[0].gain + chroma[1].gain) * colour + CHROMA_NOISE;
        Self { spread: luma.gain * math::coarse_sqrt(own.or(0.0) + whole) + LEAST_SPREAD, luma, chroma, colour, shown }
    }

    /// How far the mean brightness of a cell is from the expected one, in spreads of the picture.
    #[inline(never)]
    fn off(&self, cell: &Cell) -> f32 {
        (self.luma.off(cell.mean.map(f32::from)) / self.spread).min(2.0)
    }

    /// How far the chroma of a cell is from the expected one, in spreads of the picture's chroma.
    #[inline(never)]
    fn strange(&self, [t, f]: [[i8; 2]; 2]) -> f32 {
        let off = |i: usize| self.chroma[i].off([t[i], f[i]].map(f32::from));
        ((off(0) + off(1)) / self.shown).min(4.0)
    }

    /// How well a cell agrees, 0 to 1. A flat cell agrees when the frame is flat there and as bright as expected; the
    /// expectation is less sure the more its brightness differs from that of the cells that agree.
    #[inline(never)]
    fn agreement(&self, cell: &Cell) -> f32 {
        let flat = f32::from(cell.spread[1]) < FLAT * self.luma.gain + NOISE;
        let unsure = UNSURE * self.luma.gain * (f32::from(cell.mean[0]) - self.luma.middle).abs() / self.spread;
        let even = flat && self.off(cell) < LIT + unsure;
        if cell.is_textured { ((cell.value() - 0.3) / 0.4).clamp(0.0, 1.0) } else { number(even) }
    }
}

/// Properties of a mosaic and of the steps across the outline, in the order of [`NAMES`].
#[inline(never)]
fn properties(mosaic: &Mosaic, pieces: &Pieces) -> [u8; OF_CELLS] {
    let light = Light::new(mosaic);
    let agreement: [f32; ALL] = core::array::from_fn(|i| light.agreement(&mosaic[i]));
    let [mut agree, mut mid, mut foreign, mut tint, mut strange, mut clump, mut dis] = [Mean::NONE; 7];
    for (i, (cell, &a)) in mosaic.iter().zip(&agreement).enumerate().filter(|(_, (cell, _))| cell.is_seen) {
        let value = cell.value();
        let (good, off) = (number(value > GOOD), number(value < OFF));
        if cell.is_textured {
            agree.add(a, 1.0);
            mid.add(1.0 - good - off, 1.0);
        }
        foreign.add(light.off(cell), off);
        if cell.chroma[1][0] != NO_CHROMA {
            let far = light.strange(cell.chroma);
            tint.add(far, if cell.is_textured { good } else { 0.5 * a });
            strange.add(far, off);
        }
        // The neighbours to the right and below.
        for (j, there) in [(i + 1, i % SIDE + 1 < SIDE), (i + SIDE, i + SIDE < ALL)] {
            if there && mosaic[j].is_seen {
                let b = agreement[j];
                clump.add_sums(2.0 * a * b, a + b);
                dis.add_sums(2.0 * (1.0 - a) * (1.0 - b), 2.0 - a - b);
            }
        }
    }
    let (mut edge, mut hidden) = (Mean::NONE, 0.0);
    for (i, &step) in pieces.iter().enumerate() {
        let [x, y] = cell_at(i);
        let (cell, a) = (&mosaic[y * SIDE + x], agreement[y * SIDE + x]);
        if cell.is_seen && !step.is_nan() {
            hidden += number(a < COVERED);
            edge.add(step.clamp(-1.0, 6.0), number(a > BARE));
        }
    }
    [
        share(agree.or(0.0)),
        share(mid.or(0.0)),
        share(foreign.or(0.0) / 2.0),
        share(tint.or(0.0) / 2.0),
        share(strange.or(0.0) / 4.0),
        share(light.colour / 64.0),
        share(clump.or(0.0)),
        share(dis.or(0.0)),
        share(hidden / pieces.len() as f32),
        share((edge.or(3.0) + 1.0) / 7.0),
    ]
}

/// Whether an object seems hidden beside a piece of its outline: the outer cell and the one behind it do not agree, and
/// one of them has texture.
fn seems_hidden(mosaic: &Mosaic, piece: usize) -> bool {
    let [x, y] = cell_at(piece);
    let [dx, dy] = [[0, 1], [-1, 0], [0, -1], [1, 0]][piece / SIDE];
    let behind = [x.wrapping_add_signed(dx), y.wrapping_add_signed(dy)];
    let [a, b] = [[x, y], behind].map(|[x, y]| mosaic[y * SIDE + x].value());
    // A flat cell has no value.
    let all_flat = a.is_nan() && b.is_nan();
    !(a >= OFF || b >= OFF || all_flat)
}

/// Scrutinises a detection. An object that is seen plainly, [`Appearance::visible`], and in its own colours is not
/// looked at again. `None` for one that lies mostly outside the frame when too little agrees of what lies inside.
///
/// [`Appearance::visible`]: crate::Appearance::visible
#[inline(never)]
#[must_use]
pub fn scrutinise(view: &PyramidView<'_>, model: &Model<'_>, d: &Detection, pace: &mut dyn Pace) -> Option<Scrutiny> {
    let (mut values, mut bordered) = ([0; PROPERTIES], false);
    let (cells, others) = values.split_at_mut(OF_CELLS);
    cells.copy_from_slice(&PLAIN_CELLS);
    let a = &d.appearance;
    if a.visible < PLAIN || (a.chroma != 0.0 && a.chroma < OWN_COLOURS) {
        let o = model.object(usize::from(d.object));
        if a.visible < LEAST_OF_PART && is_part(view, &o, &d.homography) {
            return None;
        }
        let mosaic = lay(view, &o, d, pace);
        cells.copy_from_slice(&properties(&mosaic, &trace(view, &o, d, pace)));
        if a.visible < MOST_HIDDEN {
            bordered = is_bordered(view, &o, d, &|piece| seems_hidden(&mosaic, piece), pace);
        }
    }
    others[0] = share(f32::from(d.appearance.inside) / BLOCKS_OF_ALL);
    Some(Scrutiny(values, bordered).with_votes(d.votes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn at(name: &str) -> usize {
        NAMES.iter().position(|&n| n == name).unwrap()
    }

    /// A mosaic of which the cells agree that `agrees` says, by column and row. The others are as much brighter, and
    /// have as much more of the first chroma.
    fn mosaic(agrees: impl Fn(usize, usize) -> bool, brighter: i16, tinted: i16) -> Mosaic {
        core::array::from_fn(|i| {
            let agrees = agrees(i % SIDE, i / SIDE);
            let [brighter, tinted] = if agrees { [0, 0] } else { [brighter, tinted] };
            let own = i as i16 % 7 * 6;
            Cell {
                is_seen: true,
                is_textured: true,
                correlation: if agrees { 120 } else { 0 },
                mean: [100, (100 + brighter) as u8],
                spread: [30, 30],
                chroma: [[own as i8, 0], [(own + tinted) as i8, 0]],
            }
        })
    }

    fn of(mosaic: &Mosaic) -> Vec<f32> {
        properties(mosaic, &[3.0; 4 * SIDE]).iter().map(|&v| f32::from(v) / 255.0).collect()
    }

    #[test]
    fn something_in_front_is_one_region_with_its_own_light_and_colour() {
        let front = of(&mosaic(|x, _| x >= SIDE / 2, 80, 60));
        let alike = of(&mosaic(|x, y| (x + y) % 2 == 0, 0, 0));
        for name in ["foreign", "strange", "clump", "dis"] {
            assert!(front[at(name)] > alike[at(name)] + 0.1, "{name}: {front:?} {alike:?}");
        }
        assert_eq!((front[at("tint")], alike[at("tint")]), (0.0, 0.0), "what agrees is as expected");
        assert_eq!(front[at("agree")], 128.0 / 255.0);
    }

    #[test]
    fn other_colours_of_what_agrees_are_told() {
        let mut mosaic = mosaic(|_, _| true, 0, 0);
        let own = of(&mosaic)[at("tint")];
        for (i, cell) in mosaic.iter_mut().enumerate() {
            cell.chroma = [[0, 0], [if i % 2 == 0 { 40 } else { -40 }, 0]];
        }
        assert!(of(&mosaic)[at("tint")] > own + 0.5);
    }

    #[test]
    fn a_gray_frame_has_no_tint_and_a_gray_picture_no_colour() {
        let mut mosaic = mosaic(|x, _| x >= SIDE / 2, 80, 0);
        let colour = of(&mosaic)[at("colour")];
        mosaic.iter_mut().for_each(|cell| cell.chroma[1] = [NO_CHROMA; 2]);
        let seen = of(&mosaic);
        assert_eq!(["tint", "strange", "colour"].map(|n| seen[at(n)]), [0.0, 0.0, colour]);
        mosaic.iter_mut().for_each(|cell| cell.chroma = [[NO_CHROMA; 2]; 2]);
        assert_eq!(of(&mosaic)[at("colour")], 0.0);
        assert!(colour > 0.1);
    }

    #[test]
    fn where_the_outline_seems_hidden_is_counted() {
        let seen = of(&mosaic(|x, _| x >= 3, 80, 60));
        // The left side, and three cells of the upper and of the lower one.
        assert_eq!(seen[at("hidden")], 96.0 / 255.0);
        assert_eq!(seen[at("edge")], 146.0 / 255.0);
    }
}
