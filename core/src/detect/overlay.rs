//! A template laid over the frame: sums over its blocks.
//!
//! In: a level of a template, one of the frame, and the map from the one to the other. Out: sums
//! over blocks of the template, of its pixels and of what the frame shows there. They are kept for
//! every fourth column apart, and added up in one order: with vectors and without, they are the
//! same.
//!
//! Memory: some 1 KB of stack, 4 where there are vectors. Cost: one bilinear sample for each pixel.

use core::ops::Range;

use crate::base::capacity::TEMPLATE_SIDE;
use crate::base::geometry::Homography;
use crate::base::math::{self, VECTORS};
use crate::image::pyramid::Plane;

/// Blocks each way.
pub(crate) const BLOCKS: usize = 6;

/// Columns whose sums are kept apart, so that they can be added up side by side.
pub(crate) const LANES: usize = 4;

/// Those that are: the others follow one by one, which gives the same sums.
pub(crate) const AT_ONCE: usize = if VECTORS { LANES } else { 1 };

/// Numbers of the columns that are added up at once.
pub(crate) type Numbers = [f32; AT_ONCE];

/// Some sums, of every fourth column each.
pub(crate) type Sums<const K: usize> = [[f32; LANES]; K];

/// Adds what some columns give, the first of which is the `lane`th of four.
#[inline(always)]
pub(crate) fn add<const K: usize>(sums: &mut Sums<K>, lane: usize, values: [Numbers; K]) {
    let first = if VECTORS { 0 } else { lane % LANES };
    for (sum, v) in sums.iter_mut().zip(values) {
        for i in 0..AT_ONCE {
            sum[first + i] += v[i];
        }
    }
}

/// Over all columns.
pub(crate) fn total<const K: usize>(sums: &Sums<K>) -> [f32; K] {
    const { assert!(LANES == 4) };
    sums.map(|v| (v[0] + v[1]) + (v[2] + v[3]))
}

/// Sums of a correlation: pixels; of the template, of the frame; of the squares of either, and
/// of their products.
pub(crate) type Pairs = Sums<6>;

/// Adds pixels of the template and of the frame, where `seen` is 1 and not 0.
#[inline(always)]
pub(crate) fn add_pairs(sums: &mut Pairs, lane: usize, t: &Numbers, f: &Numbers, seen: &Numbers) {
    let (t, f) = (times(t, seen), times(f, seen));
    add(sums, lane, [*seen, t, f, times(&t, &t), times(&f, &f), times(&t, &f)]);
}

#[inline(always)]
pub(crate) fn times(a: &Numbers, b: &Numbers) -> Numbers {
    core::array::from_fn(|i| a[i] * b[i])
}

/// Every how many rows of a level of a template are correlated: where there are many, half of
/// them tell as much.
pub(crate) fn every(luma: &Plane<'_, u8>) -> usize {
    if luma.width().max(luma.height()) > TEMPLATE_SIDE / 2 { 2 } else { 1 }
}

/// What a correlation is made of.
#[derive(Clone, Copy, Default)]
pub(crate) struct Moments {
    /// Pixels.
    pub(crate) n: f32,
    /// Means of the template and of the frame.
    pub(crate) mean: [f32; 2],
    /// Variance of the template, variance of the frame, covariance.
    pub(crate) t: f32,
    pub(crate) f: f32,
    pub(crate) tf: f32,
}

impl Moments {
    pub(crate) fn new(sums: &Pairs) -> Self {
        let [n, t, f, tt, ff, tf] = total(sums);
        let k = 1.0 / n.max(1.0);
        let mean = [t * k, f * k];
        Self { n, mean, t: tt * k - mean[0] * mean[0], f: ff * k - mean[1] * mean[1], tf: tf * k - mean[0] * mean[1] }
    }
}

/// The columns of each of `blocks` blocks of a row of `width`, or the rows of a height: those
/// whose `x * blocks / width` is the block's number; but for a `margin` at both ends.
pub(crate) fn block_ranges(width: usize, blocks: usize, margin: usize) -> impl Iterator<Item = Range<usize>> {
    let start = move |b: usize| (b * width).div_ceil(blocks).max(margin);
    (0..blocks).map(move |b| start(b)..start(b + 1).min(width.saturating_sub(margin)))
}

/// The columns of each, which are asked for in every row.
pub(crate) fn block_columns(width: usize, blocks: usize, margin: usize) -> [Range<usize>; BLOCKS] {
    let mut ranges = block_ranges(width, blocks, margin);
    core::array::from_fn(|_| ranges.next().unwrap_or_default())
}

/// What the frame shows where a row of the template lies, no number where it shows nothing;
/// with room for whole groups from any pixel on. Where there are no vectors pixels are sampled
/// when they are wanted.
pub(crate) type Row = [f32; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];
pub(crate) const NOTHING: Row = [f32::NAN; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];

/// A level of the template, and the level of the frame that it lies on.
pub(crate) struct Overlay<'a> {
    pub(crate) luma: Plane<'a, u8>,
    pub(crate) plane: Plane<'a, u8>,
    /// Px of the first to px of the second.
    pub(crate) map: Homography,
}

impl<'a> Overlay<'a> {
    /// What the frame shows where the pixels of row `y` lie: into `out`, if they are sampled at once.
    #[inline(always)]
    pub(crate) fn row(&self, y: usize, out: &mut Row) -> Track<'a> {
        let (h, v) = (self.map.0, number(y));
        let [a, b, c] = [0, 3, 6].map(|i| h[i + 1] * v + h[i + 2]);
        let track = Track { plane: self.plane, from: [a, b, c], step: [h[0], h[3], h[6]] };
        if VECTORS {
            track.sample(&mut out[..self.luma.width().min(TEMPLATE_SIDE)]);
        }
        track
    }

    /// Correlates each of the blocks that have these rows and columns.
    #[inline(never)]
    pub(crate) fn correlate(&self, ys: Range<usize>, columns: &[Range<usize>]) -> [Pairs; BLOCKS] {
        let mut pairs: [Pairs; BLOCKS] = Default::default();
        let (mut numbers, mut frame) = (NO_NUMBERS, NOTHING);
        for y in ys.step_by(every(&self.luma)) {
            let row = self.luma.row(y);
            let track = self.row(y, &mut frame);
            row_of_numbers(row, &mut numbers);
            for (pairs, xs) in pairs.iter_mut().zip(columns) {
                let mut sums = *pairs;
                let end = xs.end.min(row.len());
                for x in (xs.start..end).step_by(AT_ONCE) {
                    let Some((f, seen)) = track.group(&frame, x, end - x) else { continue };
                    // Of whole gray levels sums are exact, in whatever order.
                    let f = f.map(|v| math::whole(v) as f32);
                    add_pairs(&mut sums, 0, &pixels(row, &numbers, x), &f, &seen);
                }
                *pairs = sums;
            }
        }
        pairs
    }
}

/// Where the pixels of a row of the template lie in a plane: numerators and denominator of their
/// places at the first, and how they change from one to the next.
pub(crate) struct Track<'a> {
    plane: Plane<'a, u8>,
    from: [f32; 3],
    step: [f32; 3],
}

impl Track<'_> {
    #[inline(always)]
    fn place(&self, x: usize) -> [f32; 2] {
        let [a, b, c] = core::array::from_fn(|i| self.step[i] * number(x) + self.from[i]);
        let reciprocal = 1.0 / c;
        [a * reciprocal, b * reciprocal]
    }

    /// Samples the first of them.
    #[inline(never)]
    fn sample(&self, out: &mut [f32]) {
        let n = out.len().min(TEMPLATE_SIDE);
        let mut ys = [0.0; TEMPLATE_SIDE];
        for (x, (out, y)) in out.iter_mut().zip(&mut ys).enumerate() {
            [*out, *y] = self.place(x);
        }
        self.plane.sample(&mut out[..n], &mut ys[..n]);
    }

    /// What the frame shows from pixel `x` on, of at most `n` of them, and 1 for each where it
    /// shows something, or 0; `None` where it shows nothing.
    #[inline(always)]
    pub(crate) fn group(&self, row: &Row, x: usize, n: usize) -> Option<(Numbers, Numbers)> {
        if !VECTORS {
            let [u, v] = self.place(x);
            return self.plane.sample_one(u, v).map(|value| ([value; AT_ONCE], [1.0; AT_ONCE]));
        }
        let values: Numbers = core::array::from_fn(|i| row[x + i]);
        // Numbers, since they are compared side by side.
        let n = number(n);
        let there = |i: usize| (values[i] >= 0.0) & (number(i) < n);
        let seen = core::array::from_fn(|i| if there(i) { 1.0 } else { 0.0 });
        Some((core::array::from_fn(|i| if there(i) { values[i] } else { 0.0 }), seen))
    }
}

/// A row of the template as numbers, with room for whole groups from any pixel on, where they
/// are worth the stack.
pub(crate) type RowOfNumbers = [f32; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];
pub(crate) const NO_NUMBERS: RowOfNumbers = [0.0; if VECTORS { TEMPLATE_SIDE + LANES } else { 0 }];

/// Makes them, where they are.
#[inline]
pub(crate) fn row_of_numbers(row: &[u8], out: &mut RowOfNumbers) {
    for (out, &v) in out.iter_mut().zip(row) {
        *out = f32::from(v);
    }
}

/// Steps from what lies before the pixels of a row, but for the first, to what lies after them.
#[inline]
pub(crate) fn row_of_steps([before, after]: [&[u8]; 2], out: &mut RowOfNumbers) {
    for ((out, &a), &b) in out.iter_mut().skip(1).zip(after).zip(before) {
        *out = step(b, a);
    }
}

fn step(before: u8, after: u8) -> f32 {
    f32::from(i16::from(after) - i16::from(before))
}

/// Those of the pixels from `first` on.
#[inline]
pub(crate) fn steps([before, after]: [&[u8]; 2], numbers: &RowOfNumbers, first: usize) -> Numbers {
    let one = |i: usize| step(before[first - 1 + i], after[first - 1 + i]);
    core::array::from_fn(|i| if VECTORS { numbers[first + i] } else { one(i) })
}

/// Pixels of a row from `first` on.
#[inline]
pub(crate) fn pixels(row: &[u8], numbers: &RowOfNumbers, first: usize) -> Numbers {
    core::array::from_fn(|i| if VECTORS { numbers[first + i] } else { f32::from(row[first + i]) })
}

/// A coordinate of a template as a number.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "templates are far smaller")]
pub(crate) fn number(v: usize) -> f32 {
    v as i32 as f32
}
