//! A plane of pixels, and samples of it.
//!
//! In: borrowed pixels, and positions in px. Out: the pixel nearest to a position,
//! or the bilinear sample there. Positions are rounded to 1/256 px. Several positions are sampled
//! together where the target has vectors, else one by one; the samples are the same.
//!
//! Memory: 128 bytes of stack. Cost: some 20 operations a sample.

use crate::base::math::{self, ROWS};

/// A borrowed plane of pixels, or a window of one.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a, T> {
    data: &'a [T],
    width: usize,
    height: usize,
    /// Number of values from the start of a row to the start of the next.
    stride: usize,
}

impl<'a, T> Plane<'a, T> {
    /// The view of the first `width * height` values of `data`.
    ///
    /// # Panics
    /// Panics when there are fewer values.
    #[inline(always)]
    pub(crate) fn of_first(data: &'a [T], width: usize, height: usize) -> Self {
        Self { data: &data[..width * height], width, height, stride: width }
    }
}

impl<'a, T: Copy> Plane<'a, T> {
    /// Makes a view of `width * height` pixels. Returns `None` when `data` has another length or a
    /// side is zero.
    #[must_use]
    pub fn new(data: &'a [T], width: usize, height: usize) -> Option<Self> {
        (width > 0 && height > 0 && data.len() == width * height).then_some(Self { data, width, height, stride: width })
    }

    /// Returns the width, px.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Returns the height, px.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Returns row `y`.
    ///
    /// # Panics
    /// Panics when `y` is not below the height.
    #[must_use]
    pub fn row(&self, y: usize) -> &'a [T] {
        &self.data[y * self.stride..][..self.width]
    }

    /// Returns the window with the first pixel `start` and this size, px. It ends at the edges of the
    /// plane.
    pub(crate) fn window(&self, start: [usize; 2], size: [usize; 2]) -> Self {
        let (x, y) = (start[0].min(self.width), start[1].min(self.height));
        let (width, height) = (size[0].min(self.width - x), size[1].min(self.height - y));
        Self { data: self.data.get(y * self.stride + x..).unwrap_or_default(), width, height, ..*self }
    }

    /// Returns the pixel at `(x, y)`. A place outside the plane gives the nearest pixel inside.
    #[must_use]
    #[inline(always)]
    #[allow(clippy::cast_sign_loss, clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "clamped")]
    pub fn nearest(&self, x: i32, y: i32) -> T {
        let x = x.clamp(0, self.width as i32 - 1) as usize;
        let y = y.clamp(0, self.height as i32 - 1) as usize;
        self.data[y * self.stride + x]
    }
}

/// Returns the pixels at `(x, y)` of both chroma planes, as [`Plane::nearest`] does. The planes
/// must have the same size.
#[inline(always)]
pub(crate) fn nearest(planes: [Plane<'_, i8>; 2], x: i32, y: i32) -> [i8; 2] {
    let [a, b] = planes;
    let b = Plane { data: b.data, ..a };
    [a.nearest(x, y), b.nearest(x, y)]
}

impl Plane<'_, u8> {
    /// Samples the plane at the places `(x, y)`, px, rounded to 1/256 px. The value between four
    /// pixels replaces each `x`. It is NaN where the place does not lie between four pixels. The
    /// values of `y` are overwritten.
    pub(crate) fn sample(&self, x: &mut [f32], y: &mut [f32]) {
        if ROWS { self.sample_by_strips(x, y) } else { self.sample_one_by_one(x, y) }
    }

    fn sample_by_strips(&self, x: &mut [f32], y: &mut [f32]) {
        for (x, y) in x.chunks_mut(STRIP).zip(y.chunks_mut(STRIP)) {
            sample_strip(self, x, y);
        }
    }

    fn sample_one_by_one(&self, x: &mut [f32], y: &mut [f32]) {
        for (x, y) in x.iter_mut().zip(y) {
            *x = self.sample_one(*x, *y).unwrap_or(f32::NAN);
        }
    }

    /// Samples the plane at one place, by integers. Returns `None` outside the plane.
    #[inline]
    pub(crate) fn sample_one(&self, x: f32, y: f32) -> Option<f32> {
        let [x, y] = [x, y].map(|v| math::whole(v * PARTS));
        let square = self.square([x, y].map(|v| (v >> 8).cast_unsigned() as usize))?;
        Some(between(square, x & 255, y & 255) as f32 * (1.0 / (PARTS * PARTS)))
    }

    /// Returns the pixel `(x, y)`, its right neighbour, and the two pixels below them. Returns
    /// `None` when one of them lies outside the plane.
    #[inline(always)]
    pub(crate) fn square(&self, [x, y]: [usize; 2]) -> Option<[i32; 4]> {
        if x >= self.width - 1 || y >= self.height - 1 {
            return None;
        }
        // The compiler then knows that `w` has 16 bits, so that one check of the length is enough.
        let w = self.stride & 0xffff;
        let rest = self.data.get(y * self.stride + x..)?;
        (rest.len() > w + 1).then(|| [rest[0], rest[1], rest[w], rest[w + 1]].map(i32::from))
    }

    /// Samples the plane as [`Plane::sample`] does, with places outside moved to the edge of the
    /// plane.
    pub(crate) fn sample_clamped(&self, x: &mut [f32], y: &mut [f32]) {
        // The last place that lies between four pixels.
        let [right, bottom] = [self.width, self.height].map(|v| (number(v) - 1) as f32 - 1.0 / PARTS);
        let clamp = |v: f32, most: f32| {
            let v = if v < most { v } else { most };
            if v > 0.0 { v } else { 0.0 }
        };
        x.iter_mut().for_each(|x| *x = clamp(*x, right));
        y.iter_mut().for_each(|y| *y = clamp(*y, bottom));
        self.sample(x, y);
    }
}

/// Samples up to [`STRIP`] places. The compiler makes vectors of the first and of the third loop.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
#[inline(never)]
fn sample_strip(plane: &Plane<'_, u8>, x: &mut [f32], y: &mut [f32]) {
    let n = x.len().min(STRIP);
    let mut squares = [0u32; STRIP];
    let (x, y, squares) = (&mut x[..n], &mut y[..n], &mut squares[..n]);
    let (stride, right, bottom) = (number(plane.stride), number(plane.width) - 1, number(plane.height) - 1);
    for i in 0..n {
        let (fx, fy) = (math::whole(x[i] * PARTS), math::whole(y[i] * PARTS));
        let (column, row) = (fx >> 8, fy >> 8);
        let inside = (column >= 0) & (column < right) & (row >= 0) & (row < bottom);
        // Both factors have 15 bits, so that one instruction multiplies them.
        let start = (row & 0x7fff) * (stride & 0x7fff) + column;
        squares[i] = if inside { start.cast_unsigned() } else { 0 };
        x[i] = if inside { (fx & 255) as f32 } else { f32::NAN };
        y[i] = (fy & 255) as f32;
    }
    // `top` and `low` have the same length: an index that is valid in one is valid in the other.
    let low = &plane.data[plane.stride..];
    let top = &plane.data[..low.len()];
    for square in squares.iter_mut() {
        let at = *square as usize;
        let pair = |row: &[u8]| row.get(at..at + 2).map_or(0, |v| u32::from(v[0]) | u32::from(v[1]) << 8);
        *square = pair(top) | pair(low) << 16;
    }
    for i in 0..n {
        // The formula is the one of `between`. No step is rounded.
        let byte = |shift: u32| (squares[i] >> shift & 255).cast_signed() as f32;
        let top = PARTS * byte(0) + x[i] * (byte(8) - byte(0));
        let low = PARTS * byte(16) + x[i] * (byte(24) - byte(16));
        x[i] = (PARTS * top + y[i] * (low - top)) * (1.0 / (PARTS * PARTS));
    }
}

/// Number of places that are sampled together.
const STRIP: usize = 32;

/// Number of positions that are told apart along each side of a pixel.
const PARTS: f32 = 256.0;

/// Returns 65536 times the value between the four pixels of [`Plane::square`], at `x` / 256 of the
/// way to the right and `y` / 256 of the way down.
#[inline(always)]
pub(crate) fn between([a, b, c, d]: [i32; 4], x: i32, y: i32) -> i32 {
    let (top, low) = ((a << 8) + x * (b - a), (c << 8) + x * (d - c));
    (top << 8) + y * (low - top)
}

/// Returns a side of a plane as a signed number.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "planes are far smaller")]
const fn number(side: usize) -> i32 {
    side as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_shows_its_part_and_ends_at_the_edges() {
        let data: std::vec::Vec<u8> = (0..35).collect();
        let plane = Plane::new(&data, 7, 5).unwrap();
        let window = plane.window([2, 1], [3, 2]);
        assert_eq!((window.row(0), window.row(1)), (&[9, 10, 11][..], &[16, 17, 18][..]));
        assert_eq!(window.sample_one(0.5, 0.5), Some((9.0 + 10.0 + 16.0 + 17.0) / 4.0));
        assert_eq!(window.sample_one(2.5, 0.0), None, "outside the window");
        assert_eq!(window.nearest(9, 9), 18);
        let inner = window.window([1, 1], [9, 9]);
        assert_eq!((inner.width(), inner.height(), inner.row(0)), (2, 1, &[17, 18][..]));
        let beyond = plane.window([8, 0], [1, 1]);
        assert_eq!((beyond.width(), beyond.height()), (0, 1));
    }

    #[test]
    fn samples_by_strips_and_one_by_one_are_those_of_the_definition() {
        let (w, h) = (23, 17);
        let random = |i: usize| (i as u32 + 3).wrapping_mul(2_654_435_761) >> 8;
        let data: std::vec::Vec<u8> = (0..w * h).map(|i| (random(i) >> 16) as u8).collect();
        let plane = Plane::new(&data, w, h).unwrap();
        for n in [1, STRIP - 1, STRIP, 2 * STRIP + 3] {
            // Some of them lie outside.
            let place = |i: usize, side: usize| (random(i) % 4000) as f32 / 4000.0 * (side as f32 + 4.0) - 2.0;
            let xs: std::vec::Vec<f32> = (0..n).map(|i| place(2 * i, w)).collect();
            let ys: std::vec::Vec<f32> = (0..n).map(|i| place(2 * i + 1, h)).collect();
            let (mut a, mut b) = (xs.clone(), xs.clone());
            plane.sample_by_strips(&mut a, &mut ys.clone());
            plane.sample_one_by_one(&mut b, &mut ys.clone());
            for i in 0..n {
                assert_eq!(a[i].to_bits(), b[i].to_bits(), "({}, {})", xs[i], ys[i]);
                let [x, y] = [xs[i], ys[i]].map(|v| f64::from((v * 256.0).round_ties_even() / 256.0));
                if x < 0.0 || y < 0.0 || x >= (w - 1) as f64 || y >= (h - 1) as f64 {
                    assert!(a[i].is_nan(), "({x}, {y}) lies outside");
                    continue;
                }
                let at = |dx: usize, dy: usize| f64::from(data[(y as usize + dy) * w + x as usize + dx]);
                let (u, v) = (x.fract(), y.fract());
                let top = at(0, 0) * (1.0 - u) + at(1, 0) * u;
                let low = at(0, 1) * (1.0 - u) + at(1, 1) * u;
                let want = top * (1.0 - v) + low * v;
                assert!((f64::from(a[i]) - want).abs() < 1e-3, "{} for {want} at ({x}, {y})", a[i]);
            }
        }
    }
}
