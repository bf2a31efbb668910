//! Lays a template over the frame, and sums over its blocks.
//!
//! In: a level of a template, a level of the frame, and the map from the template's level to the
//! frame's. Out: for blocks of the template, the moments of the correlation between template and
//! frame, and the error sums of an alignment step.
//!
//! Each sum has four parts, one for every fourth column. The parts are added in a fixed order.
//! Therefore a target with vectors can sum four columns at a time, another target one column, and
//! the sums are equal. `N` is the number of columns at a time. `R` is the length of the arrays that
//! hold a row as floats.
//!
//! Memory: about 2 KB of stack, 4 KB on a target with vectors. Cost: one bilinear sample for each
//! pixel.

use core::iter::StepBy;
use core::ops::Range;

use crate::base::capacity::TEMPLATE_SIDE;
use crate::base::geometry::Homography;
use crate::base::math::{self, VECTORS};
use crate::detect::light::{BLOCKS, LEAST_WEIGHT, Light, Moments, Shade};
use crate::image::plane::Plane;

/// Number of parts of a sum: one for every fourth column, so that four columns can be added side by
/// side.
const LANES: usize = 4;

/// Number of columns that this target sums at a time, and the length of its row arrays. The arrays
/// are long enough for a whole group that starts at the last pixel. A target that sums one column
/// at a time samples a pixel when it needs it, and has no row arrays.
const AT_ONCE: usize = if VECTORS { LANES } else { 1 };
const ROOM: usize = if VECTORS { TEMPLATE_SIDE + LANES } else { 0 };

/// One number for each column that is summed at a time.
type Numbers<const N: usize> = [f32; N];

/// `K` sums, each with a part for every fourth column.
type Sums<const K: usize> = [[f32; LANES]; K];

/// Adds the values of `N` columns to `sums`. `lane` is the offset of the first column in its block.
#[inline(always)]
fn add<const K: usize, const N: usize>(sums: &mut Sums<K>, lane: usize, values: [Numbers<N>; K]) {
    let first = if N == LANES { 0 } else { lane % LANES };
    for (sum, v) in sums.iter_mut().zip(values) {
        for i in 0..N {
            sum[first + i] += v[i];
        }
    }
}

/// Adds the parts of each sum.
fn total<const K: usize>(sums: &Sums<K>) -> [f32; K] {
    const { assert!(LANES == 4) };
    sums.map(|v| (v[0] + v[1]) + (v[2] + v[3]))
}

#[inline(always)]
fn times<const N: usize>(a: &Numbers<N>, b: &Numbers<N>) -> Numbers<N> {
    core::array::from_fn(|i| a[i] * b[i])
}

/// Sums of a correlation: the number of pixels; the pixels of the template and of the frame; the
/// squares of each; their products.
type Pairs = Sums<6>;

/// Columns of each block of a row.
pub(crate) type Columns = [Range<usize>; BLOCKS];

/// Sums of the correlations of a row of blocks.
type RowOfPairs = [Pairs; BLOCKS];

/// Adds pixels of the template and of the frame. `seen` is 1 for a pixel that counts, and 0 for one
/// that does not.
#[inline(always)]
fn add_pairs<const N: usize>(sums: &mut Pairs, lane: usize, [t, f]: [&Numbers<N>; 2], seen: &Numbers<N>) {
    let (t, f) = (times(t, seen), times(f, seen));
    add(sums, lane, [*seen, t, f, times(&t, &t), times(&f, &f), times(&t, &f)]);
}

/// Computes the light of a row of blocks from its correlation sums.
#[inline(never)]
fn renew(light: &mut [Shade], pairs: &RowOfPairs) {
    for (shade, pairs) in light.iter_mut().zip(pairs) {
        *shade = Shade::new(&Moments::new(total(pairs)));
    }
}

/// Whether the light of the blocks is known when errors are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lit {
    /// The light is unknown: each row of blocks is read twice, first for its light.
    Unknown,
    /// The light of the step before is used, and stays as it is.
    Known,
    /// The light of the step before is used, and updated for the next step.
    Renewed,
}

/// Weighted sums over a block: the products of the steps, `x x`, `x y`, `y y`, and each step times
/// the error. The error is what the frame shows minus what the template says.
type Errors = Sums<5>;

/// Adds the errors of `N` pixels side by side.
#[inline(always)]
fn add_errors<const N: usize>(
    sums: &mut Errors,
    lane: usize,
    shade: &Shade,
    [gx, gy]: [&Numbers<N>; 2],
    [t, f]: [&Numbers<N>; 2],
    seen: &Numbers<N>,
) {
    let e: Numbers<N> = core::array::from_fn(|i| f[i] * shade.scale_f - t[i] * shade.scale_t + shade.offset);
    let weight = core::array::from_fn(|i| seen[i] * (shade.weight / (1.0 + e[i] * e[i])));
    let (wx, wy) = (times(&weight, gx), times(&weight, gy));
    add(sums, lane, [times(&wx, gx), times(&wx, gy), times(&wy, gy), times(&wx, &e), times(&wy, &e)]);
}

/// Error sums of one quarter of a block: half its width and half its height.
pub(crate) struct Cell {
    /// Sums of the products and errors of the steps, as in [`Errors`].
    pub(crate) sums: [f32; 5],
    /// Factor that normalises the steps: 1 over the spread of the template in the block.
    pub(crate) scale: f32,
    /// Middle of the quarter, px of the template's level.
    pub(crate) middle: [f32; 2],
}

/// Distance between the rows of a template's level that are correlated. A large level has enough
/// rows: every second one tells as much.
pub(crate) fn every(luma: &Plane<'_, u8>) -> usize {
    if luma.width().max(luma.height()) > TEMPLATE_SIDE / 2 { 2 } else { 1 }
}

/// Columns of each block in a row of `width` pixels that has `blocks` blocks, or rows of each block
/// in a column. Pixel `x` belongs to block `x * blocks / width`. A `margin` at both ends is left
/// out.
pub(crate) fn block_ranges(width: usize, blocks: usize, margin: usize) -> impl Iterator<Item = Range<usize>> {
    (0..blocks).map(move |b| block_range([width, blocks, margin], b))
}

/// Block `b` of [`block_ranges`].
#[inline(never)]
fn block_range([width, blocks, margin]: [usize; 3], b: usize) -> Range<usize> {
    let start = |b: usize| (b * width).div_ceil(blocks).max(margin);
    start(b)..start(b + 1).min(width.saturating_sub(margin))
}

/// Collects the first `K` ranges; missing ranges are empty.
fn ranges<const K: usize>(mut ranges: impl Iterator<Item = Range<usize>>) -> [Range<usize>; K] {
    core::array::from_fn(|_| ranges.next().unwrap_or_default())
}

/// Splits a range of pixels into its first and second half.
fn halves(range: &Range<usize>) -> [Range<usize>; 2] {
    let middle = (range.start + range.end).div_ceil(2);
    [range.start..middle, middle..range.end]
}

/// Middle of a range of pixels, px.
fn middle(range: &Range<usize>) -> f32 {
    number(range.start + range.end - 1) / 2.0
}

/// Converts a coordinate of a template to a float.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "templates are far smaller")]
pub(crate) fn number(v: usize) -> f32 {
    v as i32 as f32
}

/// A level of the template, and the level of the frame that it is laid over.
pub(crate) struct Overlay<'a> {
    pub(crate) luma: Plane<'a, u8>,
    pub(crate) plane: Plane<'a, u8>,
    /// Map from px of the template's level to px of the frame's level.
    pub(crate) map: Homography,
}

impl<'a> Overlay<'a> {
    /// Returns where the pixels of row `y` lie in the frame. On a target with row arrays it also
    /// writes what the frame shows there to `out`.
    #[inline(always)]
    fn row<const R: usize>(&self, y: usize, out: &mut [f32; R]) -> Scanline<'a> {
        let (h, v) = (self.map.0, number(y));
        let [a, b, c] = [0, 3, 6].map(|i| h[i + 1] * v + h[i + 2]);
        let line = Scanline { plane: self.plane, from: [a, b, c], step: [h[0], h[3], h[6]] };
        if R > 0 {
            line.sample(&mut out[..self.luma.width().min(TEMPLATE_SIDE)]);
        }
        line
    }

    /// Correlates a row of blocks, which have these columns and every `step`th of the rows `ys`.
    pub(crate) fn correlate(&self, ys: Range<usize>, columns: &Columns, step: usize) -> [Moments; BLOCKS] {
        let mut pairs = RowOfPairs::default();
        self.add_row::<AT_ONCE, ROOM>(ys.step_by(step), columns, &mut pairs);
        pairs.each_ref().map(|pairs| Moments::new(total(pairs)))
    }

    /// Adds the pixels of the rows `ys` to the correlation sums of the blocks with these columns.
    #[inline(never)]
    fn add_row<const N: usize, const R: usize>(
        &self,
        ys: StepBy<Range<usize>>,
        columns: &[Range<usize>],
        pairs: &mut RowOfPairs,
    ) {
        let (mut numbers, mut frame) = ([0.0; R], [f32::NAN; R]);
        for y in ys {
            let row = self.luma.row(y);
            let line = self.row(y, &mut frame);
            to_numbers(row, &mut numbers);
            for (pairs, xs) in pairs.iter_mut().zip(columns) {
                let mut sums = *pairs;
                let end = xs.end.min(row.len());
                for x in (xs.start..end).step_by(N) {
                    let Some((f, seen)) = line.group::<N, R>(&frame, x, end - x) else { continue };
                    // Whole gray levels make the sums exact in any order.
                    let f = f.map(|v| math::whole(v) as f32);
                    add_pairs(&mut sums, 0, [&pixels(row, &numbers, x), &f], &seen);
                }
                *pairs = sums;
            }
        }
    }

    /// Sums the errors of the inner pixels that lie in the frame, for `blocks` blocks in each
    /// direction. Calls `put` with the sums of each quarter of a block. With `steep`, flat pixels
    /// are left out.
    #[inline(always)]
    pub(crate) fn sum_errors(&self, blocks: usize, light: &mut Light, lit: Lit, steep: bool, put: impl FnMut(&Cell)) {
        self.sum_errors_by::<AT_ONCE, ROOM>(blocks, light, lit, steep, put);
    }

    #[inline(never)]
    fn sum_errors_by<const N: usize, const R: usize>(
        &self,
        blocks: usize,
        light: &mut Light,
        lit: Lit,
        steep: bool,
        mut put: impl FnMut(&Cell),
    ) {
        let (w, h) = (self.luma.width(), self.luma.height());
        let mut rows = Rows::<R>::EMPTY;
        let whole: [_; BLOCKS] = ranges(block_ranges(w, blocks, 1));
        let whole = &whole[..blocks];
        let columns: [_; 2 * BLOCKS] = ranges(whole.iter().flat_map(halves));
        let columns = &columns[..2 * blocks];
        for (ys, light) in block_ranges(h, blocks, 1).zip(light.chunks_exact_mut(blocks)) {
            let mut pairs = RowOfPairs::default();
            if lit == Lit::Unknown {
                self.add_row::<N, R>(ys.clone().step_by(every(&self.luma)), whole, &mut pairs);
                renew(light, &pairs);
                pairs = RowOfPairs::default();
            }
            for ys in halves(&ys) {
                let mut errors = [Errors::default(); 2 * BLOCKS];
                for y in ys.clone() {
                    let row = rows.load(self, y);
                    for (cell, (errors, xs)) in errors.iter_mut().zip(columns).enumerate() {
                        let (shade, pairs) = (&light[cell / 2], &mut pairs[cell / 2]);
                        if shade.weight < LEAST_WEIGHT {
                            continue;
                        }
                        let flat = if steep { shade.flat } else { 0.0 };
                        let pairs = (lit == Lit::Renewed).then_some(pairs);
                        row.add_cell::<N>(xs, shade, flat, errors, pairs);
                    }
                }
                for (cell, (errors, xs)) in errors.iter().zip(columns).enumerate() {
                    let (sums, scale) = (total(errors), light[cell / 2].scale_t);
                    put(&Cell { sums, scale, middle: [middle(xs), middle(&ys)] });
                }
            }
            if lit == Lit::Renewed {
                renew(light, &pairs);
            }
        }
    }
}

/// Arrays for a row of the template, its steps, and the frame's pixels, as floats. They are empty
/// on a target that sums one column at a time.
struct Rows<const R: usize> {
    /// Pixels of the template.
    numbers: [f32; R],
    /// Steps of the template along the row, and across it.
    across: [f32; R],
    down: [f32; R],
    /// Pixels of the frame; NaN where the frame shows nothing.
    frame: [f32; R],
}

/// A row of the template, its neighbours, and its place in the frame.
struct Row<'a, const R: usize> {
    rows: &'a Rows<R>,
    pixels: &'a [u8],
    /// Left and right neighbours of the inner pixels: of all pixels that have both.
    beside: [&'a [u8]; 2],
    /// Neighbours of the inner pixels above and below.
    upright: [&'a [u8]; 2],
    line: Scanline<'a>,
}

impl<const R: usize> Rows<R> {
    const EMPTY: Self = Self { numbers: [0.0; R], across: [0.0; R], down: [0.0; R], frame: [f32::NAN; R] };

    /// Loads row `y`, which must have a row above and a row below.
    #[inline(always)]
    fn load<'a>(&'a mut self, overlay: &Overlay<'a>, y: usize) -> Row<'a, R> {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| overlay.luma.row(y));
        to_numbers(row, &mut self.numbers);
        // Each slice of neighbours has one element for each inner pixel.
        let (w, n) = (row.len(), row.len().saturating_sub(2));
        let beside = [&row[..n], &row[w - n..]];
        let upright = [above, below].map(|row| &row[(w - n) / 2..][..n]);
        to_steps(beside, &mut self.across);
        to_steps(upright, &mut self.down);
        let line = overlay.row(y, &mut self.frame);
        Row { rows: self, pixels: row, beside, upright, line }
    }
}

impl<const R: usize> Row<'_, R> {
    /// Adds the pixels of the columns `xs` to the error sums and, if given, to the correlation sums
    /// of their block. Pixels whose step is below `flat` are left out.
    #[inline(always)]
    fn add_cell<const N: usize>(
        &self,
        xs: &Range<usize>,
        shade: &Shade,
        flat: f32,
        errors: &mut Errors,
        mut pairs: Option<&mut Pairs>,
    ) {
        let Rows { numbers, across, down, frame } = self.rows;
        let (shade, line) = (*shade, self.line);
        let mut next = xs.start;
        while next < xs.end {
            let x = next;
            next += N;
            let (gx, gy) = (steps(self.beside, across, x), steps(self.upright, down, x));
            let strong: [bool; N] = core::array::from_fn(|i| gx[i].abs() + gy[i].abs() >= flat);
            if N == 1 && !strong[0] {
                continue;
            }
            let Some((f, mut seen)) = line.group::<N, R>(frame, x, xs.end - x) else { continue };
            if N > 1 {
                seen = core::array::from_fn(|i| if strong[i] { seen[i] } else { 0.0 });
            }
            let t = pixels(self.pixels, numbers, x);
            if let Some(pairs) = pairs.as_deref_mut() {
                add_pairs(pairs, x - xs.start, [&t, &f], &seen);
            }
            add_errors(errors, x - xs.start, &shade, [&gx, &gy], [&t, &f], &seen);
        }
    }
}

/// Positions of a row of template pixels in a plane of the frame. `from` holds the two numerators
/// and the denominator of the first pixel's position, `step` their change from one pixel to the
/// next.
#[derive(Clone, Copy)]
struct Scanline<'a> {
    plane: Plane<'a, u8>,
    from: [f32; 3],
    step: [f32; 3],
}

impl Scanline<'_> {
    #[inline(always)]
    fn place(&self, x: usize) -> [f32; 2] {
        let [a, b, c] = core::array::from_fn(|i| self.step[i] * number(x) + self.from[i]);
        let reciprocal = 1.0 / c;
        [a * reciprocal, b * reciprocal]
    }

    /// Samples the plane at the first pixels of the row, as many as `out` holds.
    #[inline(never)]
    fn sample(&self, out: &mut [f32]) {
        let n = out.len().min(TEMPLATE_SIDE);
        let mut ys = [0.0; TEMPLATE_SIDE];
        for (x, (out, y)) in out.iter_mut().zip(&mut ys).enumerate() {
            [*out, *y] = self.place(x);
        }
        self.plane.sample(&mut out[..n], &mut ys[..n]);
    }

    /// Returns what the frame shows at `N` pixels from pixel `x` on, and 1 for each pixel that
    /// counts, else 0. At most the first `n` pixels count, and only where the frame shows
    /// something. `None` when a single pixel shows nothing.
    #[inline(always)]
    fn group<const N: usize, const R: usize>(
        &self,
        row: &[f32; R],
        x: usize,
        n: usize,
    ) -> Option<(Numbers<N>, Numbers<N>)> {
        if N == 1 {
            let [u, v] = self.place(x);
            return self.plane.sample_one(u, v).map(|value| ([value; N], [1.0; N]));
        }
        let values: Numbers<N> = core::array::from_fn(|i| row[x + i]);
        // Floats, because they can be compared side by side.
        let n = number(n);
        let there = |i: usize| (values[i] >= 0.0) & (number(i) < n);
        let seen = core::array::from_fn(|i| if there(i) { 1.0 } else { 0.0 });
        Some((core::array::from_fn(|i| if there(i) { values[i] } else { 0.0 }), seen))
    }
}

/// Converts a row of the template to floats, as many as `out` holds.
#[inline]
fn to_numbers(row: &[u8], out: &mut [f32]) {
    for (out, &v) in out.iter_mut().zip(row) {
        *out = f32::from(v);
    }
}

/// Writes the steps of the inner pixels to `out`, from index 1 on: each is `after` minus `before`.
/// It stops where `out` ends.
#[inline]
fn to_steps([before, after]: [&[u8]; 2], out: &mut [f32]) {
    for ((out, &a), &b) in out.iter_mut().skip(1).zip(after).zip(before) {
        *out = step(b, a);
    }
}

fn step(before: u8, after: u8) -> f32 {
    f32::from(i16::from(after) - i16::from(before))
}

/// Steps of `N` pixels from pixel `first` on.
#[inline]
fn steps<const N: usize>([before, after]: [&[u8]; 2], numbers: &[f32], first: usize) -> Numbers<N> {
    let one = |i: usize| step(before[first - 1 + i], after[first - 1 + i]);
    core::array::from_fn(|i| if N > 1 { numbers[first + i] } else { one(i) })
}

/// Values of `N` pixels of a row from pixel `first` on.
#[inline]
fn pixels<const N: usize>(row: &[u8], numbers: &[f32], first: usize) -> Numbers<N> {
    core::array::from_fn(|i| if N > 1 { numbers[first + i] } else { f32::from(row[first + i]) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const WIDTH: usize = 61;
    const HEIGHT: usize = 48;

    /// A texture with edges and flat parts.
    fn texture(x: usize, y: usize, seed: usize) -> u8 {
        let noise = ((x / 3 * 31 + y / 4 * 57 + seed) as u32).wrapping_mul(2_654_435_761) >> 24;
        if (x / 9 + y / 7).is_multiple_of(3) { 120 } else { noise as u8 }
    }

    fn plane(width: usize, height: usize, seed: usize) -> Vec<u8> {
        (0..width * height).map(|i| texture(i % width, i / width, seed)).collect()
    }

    /// A map that puts a part of the template outside the frame.
    const MAP: Homography = Homography([1.1, 0.2, -4.0, -0.15, 1.2, 6.0, 4e-4, -3e-4, 1.0]);

    fn each(test: impl Fn(&Overlay<'_>)) {
        let (template, frame) = (plane(WIDTH, HEIGHT, 3), plane(80, 60, 7));
        let luma = Plane::new(&template, WIDTH, HEIGHT).unwrap();
        let plane = Plane::new(&frame, 80, 60).unwrap();
        for map in [MAP, Homography::IDENTITY] {
            test(&Overlay { luma, plane, map });
        }
    }

    /// Moments of a block by their definition: number of pixels, variance of the template,
    /// covariance.
    fn naive_moments(overlay: &Overlay<'_>, ys: Range<usize>, xs: &Range<usize>) -> [f64; 3] {
        let mut pairs = Vec::new();
        for y in ys.step_by(every(&overlay.luma)) {
            for x in xs.clone() {
                let [u, v] = overlay.map.apply([x as f32, y as f32]);
                if let Some(f) = overlay.plane.sample_one(u, v) {
                    pairs.push((f64::from(overlay.luma.row(y)[x]), f64::from(f.round_ties_even())));
                }
            }
        }
        let n = pairs.len().max(1) as f64;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (t, f) = (mean(&|p| p.0), mean(&|p| p.1));
        [pairs.len() as f64, mean(&|p| (p.0 - t) * (p.0 - t)), mean(&|p| (p.0 - t) * (p.1 - f))]
    }

    #[test]
    fn correlations_one_by_one_and_four_at_a_time_are_those_of_the_definition() {
        each(|overlay| {
            let columns: [_; BLOCKS] = ranges(block_ranges(WIDTH, BLOCKS, 0));
            for ys in block_ranges(HEIGHT, BLOCKS, 0) {
                let (mut one, mut four) = (RowOfPairs::default(), RowOfPairs::default());
                overlay.add_row::<1, 0>(ys.clone().step_by(every(&overlay.luma)), &columns, &mut one);
                overlay.add_row::<LANES, { TEMPLATE_SIDE + LANES }>(
                    ys.clone().step_by(every(&overlay.luma)),
                    &columns,
                    &mut four,
                );
                for ((one, four), xs) in one.iter().zip(&four).zip(&columns) {
                    let m = Moments::new(total(one));
                    assert_eq!(m, Moments::new(total(four)), "rows {ys:?}, columns {xs:?}");
                    let [n, t, tf] = naive_moments(overlay, ys.clone(), xs);
                    assert_eq!(f64::from(m.n), n, "pixels of rows {ys:?}, columns {xs:?}");
                    assert!(
                        (f64::from(m.t) - t).abs() < 0.05 && (f64::from(m.tf) - tf).abs() < 0.05,
                        "{m:?}, {t} {tf}"
                    );
                }
            }
        });
    }

    #[test]
    fn errors_one_by_one_and_four_at_a_time_are_the_same() {
        each(|overlay| {
            for (blocks, lit, steep) in
                [(4, Lit::Unknown, false), (6, Lit::Unknown, true), (6, Lit::Renewed, true), (6, Lit::Known, false)]
            {
                let shade = Shade { scale_t: 0.05, scale_f: 0.06, offset: 0.3, weight: 0.7, flat: 9.0 };
                let (mut light_one, mut light_four) = ([shade; BLOCKS * BLOCKS], [shade; BLOCKS * BLOCKS]);
                let (mut one, mut four) = (Vec::new(), Vec::new());
                let bits = |cell: &Cell| (cell.sums.map(f32::to_bits), cell.scale.to_bits(), cell.middle);
                overlay.sum_errors_by::<1, 0>(blocks, &mut light_one, lit, steep, |cell| one.push(bits(cell)));
                overlay.sum_errors_by::<LANES, { TEMPLATE_SIDE + LANES }>(
                    blocks,
                    &mut light_four,
                    lit,
                    steep,
                    |cell| {
                        four.push(bits(cell));
                    },
                );
                assert_eq!(one.len(), 4 * blocks * blocks);
                assert_eq!(one, four, "{blocks} blocks, {lit:?}, steep {steep}");
                assert_eq!(light_one, light_four);
                assert_eq!(light_one != [shade; BLOCKS * BLOCKS], lit != Lit::Known, "{lit:?}");
            }
        });
    }

    #[test]
    fn blocks_cover_a_row_once() {
        for (width, margin) in [(61, 0), (61, 1), (8, 1), (96, 0)] {
            let covered: Vec<usize> = block_ranges(width, BLOCKS, margin).flatten().collect();
            assert_eq!(covered, (margin..width - margin).collect::<Vec<_>>(), "{width} px, margin {margin}");
            let halved: Vec<usize> = block_ranges(width, BLOCKS, margin).flat_map(|xs| halves(&xs)).flatten().collect();
            assert_eq!(halved, covered);
        }
    }
}
