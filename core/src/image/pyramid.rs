//! Holds luma and chroma of one frame with their half-size levels.
//!
//! In: a checked [`Frame`]. Out: [`LEVELS`] levels of luma and of both chroma planes. Each level is
//! the 2x2 mean of the level below it. A mean of chroma leaves out blocks that have no chroma.
//! Level `l` of a `w` x `h` frame has `(w >> l)` x `(h >> l)` px of luma and `(w / 2 >> l)` x
//! `(h / 2 >> l)` px of chroma.
//!
//! Memory: `LUMA + 2 * CHROMA` bytes. Cost: one pass over a third more pixels than the frame has.
//! Full: this cannot happen, because a frame that does not fit is refused.

use crate::base::capacity::{LEVELS, pixels_of};
use crate::base::geometry::{Homography, Point};
use crate::base::math::{self, VECTORS};
use crate::image::frame::{Frame, FrameError, MAX_SIDE, NO_CHROMA, Part};

/// A borrowed plane of pixels without padding.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a, T> {
    data: &'a [T],
    width: usize,
    height: usize,
}

impl<'a, T: Copy> Plane<'a, T> {
    /// Makes a view of `width * height` pixels. Returns `None` when `data` has another length or a
    /// side is zero.
    #[must_use]
    pub fn new(data: &'a [T], width: usize, height: usize) -> Option<Self> {
        (width > 0 && height > 0 && data.len() == width * height).then_some(Self { data, width, height })
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
        &self.data[y * self.width..][..self.width]
    }

    /// Returns the pixel at `(x, y)`. A place outside the plane gives the nearest pixel inside.
    #[must_use]
    #[inline(always)]
    #[allow(clippy::cast_sign_loss, clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "clamped")]
    pub fn nearest(&self, x: i32, y: i32) -> T {
        let x = x.clamp(0, self.width as i32 - 1) as usize;
        let y = y.clamp(0, self.height as i32 - 1) as usize;
        self.data[y * self.width + x]
    }
}

/// Returns the pixels at `(x, y)` of both chroma planes, as [`Plane::nearest`] does. The planes
/// must have the same size.
#[inline(always)]
pub(crate) fn nearest(planes: [Plane<'_, i8>; 2], x: i32, y: i32) -> [i8; 2] {
    let [a, b] = planes;
    let b = Plane { width: a.width, height: a.height, ..b };
    [a.nearest(x, y), b.nearest(x, y)]
}

impl Plane<'_, u8> {
    /// Samples the plane at the places `(x, y)`, px, rounded to 1/256 px. The value between four
    /// pixels replaces each `x`. It is NaN where the place does not lie between four pixels. The
    /// values of `y` are overwritten.
    pub(crate) fn sample(&self, x: &mut [f32], y: &mut [f32]) {
        if VECTORS { self.sample_by_strips(x, y) } else { self.sample_one_by_one(x, y) }
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
        let w = self.width & 0xffff;
        let rest = self.data.get(y * self.width + x..)?;
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
    let (width, right, bottom) = (number(plane.width), number(plane.width) - 1, number(plane.height) - 1);
    for i in 0..n {
        let (fx, fy) = (math::whole(x[i] * PARTS), math::whole(y[i] * PARTS));
        let (column, row) = (fx >> 8, fy >> 8);
        let inside = (column >= 0) & (column < right) & (row >= 0) & (row < bottom);
        // Both factors have 15 bits, so that one instruction multiplies them.
        let start = (row & 0x7fff) * (width & 0x7fff) + column;
        squares[i] = if inside { start.cast_unsigned() } else { 0 };
        x[i] = if inside { (fx & 255) as f32 } else { f32::NAN };
        y[i] = (fy & 255) as f32;
    }
    // `top` and `low` have the same length: an index that is valid in one is valid in the other.
    let low = &plane.data[plane.width..];
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

/// Owns the planes of one frame.
#[derive(Debug)]
pub struct Pyramid<const LUMA: usize, const CHROMA: usize> {
    /// Width and height of level 0, px.
    size: [usize; 2],
    luma: [u8; LUMA],
    chroma: [[i8; CHROMA]; 2],
}

impl<const LUMA: usize, const CHROMA: usize> Default for Pyramid<LUMA, CHROMA> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const LUMA: usize, const CHROMA: usize> Pyramid<LUMA, CHROMA> {
    /// Makes an empty pyramid. All its bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { size: [0; 2], luma: [0; LUMA], chroma: [[0; CHROMA]; 2] }
    }

    /// Returns whether a frame of this size fits.
    #[must_use]
    pub const fn fits(width: usize, height: usize) -> bool {
        plane_bytes(width, height) <= LUMA && plane_bytes(width / 2, height / 2) <= CHROMA
    }

    /// Returns the planes for writing, without their const generics.
    pub fn planes_mut(&mut self) -> PyramidMut<'_> {
        let Self { size, luma, chroma: [a, b] } = self;
        PyramidMut { size, luma, chroma: [a, b] }
    }

    /// Returns a view for the stages.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        let Self { size, luma, chroma: [a, b] } = self;
        PyramidView { width: size[0], height: size[1], luma, a, b }
    }
}

/// The planes of a [`Pyramid`], borrowed for writing.
#[derive(Debug)]
pub struct PyramidMut<'a> {
    /// Width and height of level 0, px.
    size: &'a mut [usize; 2],
    luma: &'a mut [u8],
    chroma: [&'a mut [i8]; 2],
}

impl<'a> PyramidMut<'a> {
    /// Returns whether a frame of this size fits.
    #[must_use]
    pub const fn fits(&self, width: usize, height: usize) -> bool {
        plane_bytes(width, height) <= self.luma.len() && plane_bytes(width / 2, height / 2) <= self.chroma[0].len()
    }

    /// Converts `frame` into level 0. [`PyramidMut::reduce`] makes the other levels.
    ///
    /// # Errors
    /// Returns [`FrameError::TooLarge`] when the frame does not fit.
    pub fn load(&mut self, frame: &Frame<'_>) -> Result<(), FrameError> {
        let (w, h) = (frame.width(), frame.height());
        if !self.fits(w, h) {
            let (pixels, max_pixels) = (w * h, pixels_of(self.luma.len()));
            return Err(FrameError::TooLarge { pixels, max_pixels, side: w.max(h), max_side: MAX_SIDE });
        }
        *self.size = [w, h];
        let [a, b] = &mut self.chroma;
        frame.convert(self.luma, a, b);
        Ok(())
    }

    /// Converts the luma of a part of a frame into level 0. The part must fit. The chroma planes
    /// keep their old bytes, which then mean nothing.
    pub(crate) fn load_luma(&mut self, frame: &Frame<'_>, part: &Part) {
        *self.size = [part.columns.len(), part.rows.len()];
        frame.convert_luma_of(part, &mut self.luma[..part.columns.len() * part.rows.len()]);
    }

    /// Sets the size and returns level 0 for writing: luma, then both chroma planes. Returns `None`
    /// when the size does not fit.
    pub fn level0(&mut self, width: usize, height: usize) -> Option<(&mut [u8], &mut [i8], &mut [i8])> {
        if !self.fits(width, height) {
            return None;
        }
        *self.size = [width, height];
        let c = (width / 2) * (height / 2);
        let [a, b] = &mut self.chroma;
        Some((&mut self.luma[..width * height], &mut a[..c], &mut b[..c]))
    }

    /// Makes the levels above level 0.
    pub fn reduce(&mut self) {
        self.reduce_luma();
        let [width, height] = *self.size;
        for plane in &mut self.chroma {
            reduce_chroma(plane, width / 2, height / 2);
        }
    }

    /// Makes the luma levels above level 0.
    pub(crate) fn reduce_luma(&mut self) {
        let [width, height] = *self.size;
        reduce_all(self.luma, width, height, halve_luma);
    }

    /// Turns the planes into a view for the stages, which lives as long as the planes are borrowed.
    #[must_use]
    pub fn into_view(self) -> PyramidView<'a> {
        let Self { size: &mut [width, height], luma, chroma: [a, b] } = self;
        PyramidView { width, height, luma, a, b }
    }

    /// Returns a view for the stages.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        let [width, height] = *self.size;
        let [a, b] = &self.chroma;
        PyramidView { width, height, luma: self.luma, a, b }
    }
}

/// A type that holds chroma in one byte.
pub(crate) trait Byte: Copy {
    /// Returns the bits of the number.
    fn bits(self) -> u8;
    /// Returns the number that has these bits.
    fn from_bits(bits: u8) -> Self;
}

impl Byte for u8 {
    fn bits(self) -> u8 {
        self
    }

    fn from_bits(bits: u8) -> Self {
        bits
    }
}

impl Byte for i8 {
    fn bits(self) -> u8 {
        self.cast_unsigned()
    }

    fn from_bits(bits: u8) -> Self {
        bits.cast_signed()
    }
}

/// Makes a module that halves rows, as many bytes at a time as a word has.
macro_rules! halve_by {
    ($name:ident, $word:ty) => {
        mod $name {
            use super::{Byte, NO_CHROMA, chroma_mean};

            type Word = $word;

            /// Number of bytes that are halved together.
            const WORD: usize = size_of::<Word>();

            /// Mask of the lower byte of each 16-bit part. `ONES` has the number 1 in each part.
            const EVEN: Word = Word::MAX / 0xffff * 0xff;
            const ONES: Word = Word::MAX / 0xffff;

            /// Returns the means of the 2x2 squares of two words, `low` lying below `top`. Halves are
            /// rounded up. The means fill the first half of the result.
            #[inline(always)]
            const fn means(top: Word, low: Word) -> [u8; WORD] {
                let sums = (top & EVEN) + (top >> 8 & EVEN) + (low & EVEN) + (low >> 8 & EVEN) + 2 * ONES;
                let means = sums >> 2 & EVEN;
                let pairs = (means | means >> 8) & (Word::MAX / 0xffff_ffff * 0xffff);
                (pairs | pairs >> 16).to_le_bytes()
            }

            /// Halves two rows of luma to one row. Each result is the mean of a 2x2 square.
            pub(crate) fn halve_luma(top: &[u8], low: &[u8], out: &mut [u8]) {
                let (words, rest) = out.as_chunks_mut::<{ WORD / 2 }>();
                let ((top, top_rest), (low, low_rest)) = (top.as_chunks(), low.as_chunks());
                for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                    let means = means(Word::from_le_bytes(*top), Word::from_le_bytes(*low));
                    *out = core::array::from_fn(|i| means[i]);
                }
                let word =
                    |row: &[u8]| Word::from_le_bytes(core::array::from_fn(|i| row.get(i).copied().unwrap_or_default()));
                rest.copy_from_slice(&means(word(top_rest), word(low_rest))[..rest.len()]);
            }

            /// Halves two rows of chroma to one row. Each result is the mean of the pixels of a 2x2
            /// square that have chroma. A square with fewer than two of them has no chroma.
            pub(crate) fn halve_chroma<T: Byte>(top: &[T], low: &[T], out: &mut [T]) {
                // XOR with this mask gives the number plus 128. The byte that means no chroma becomes 0.
                const SIGN: Word = Word::MAX / 0xff * 0x80;
                const { assert!(NO_CHROMA.cast_unsigned() == 0x80, "no chroma is the byte that is 0 here") };
                let word = |row: &[T; WORD]| Word::from_le_bytes(core::array::from_fn(|i| row[i].bits())) ^ SIGN;
                // This sets the highest bit of the first byte that is 0, and perhaps of bytes above it.
                let zeros = |word: Word| word.wrapping_sub(SIGN >> 7) & !word;
                let (words, rest) = out.as_chunks_mut::<{ WORD / 2 }>();
                let ((top, top_rest), (low, low_rest)) = (top.as_chunks(), low.as_chunks());
                let mut lacking = 0;
                for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                    let (top, low) = (word(top), word(low));
                    lacking |= zeros(top) | zeros(low);
                    let means = means(top, low);
                    *out = core::array::from_fn(|i| T::from_bits(means[i] ^ 0x80));
                }
                let square = |top: &[T], low: &[T]| {
                    T::from_bits(
                        chroma_mean([top[0], top[1], low[0], low[1]].map(T::bits).map(u8::cast_signed)).cast_unsigned(),
                    )
                };
                if lacking & SIGN != 0 {
                    for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                        let words = [word(top), word(low)];
                        // When all pixels of both words lack chroma, their means above lack it already.
                        if (zeros(words[0]) | zeros(words[1])) & SIGN != 0 && words != [0; 2] {
                            *out = core::array::from_fn(|i| square(&top[2 * i..], &low[2 * i..]));
                        }
                    }
                }
                for ((out, top), low) in
                    rest.iter_mut().zip(top_rest.as_chunks::<2>().0).zip(low_rest.as_chunks::<2>().0)
                {
                    *out = square(top, low);
                }
            }
        }
    };
}

// Words of eight bytes make good vectors; without vectors a word is what a register holds.
#[cfg(any(test, target_feature = "sse2", target_feature = "neon"))]
halve_by!(by_eight, u64);
#[cfg(any(test, not(any(target_feature = "sse2", target_feature = "neon"))))]
halve_by!(by_four, u32);

#[cfg(any(target_feature = "sse2", target_feature = "neon"))]
pub(crate) use by_eight::{halve_chroma, halve_luma};
#[cfg(not(any(target_feature = "sse2", target_feature = "neon")))]
pub(crate) use by_four::{halve_chroma, halve_luma};

/// Returns the mean of the pixels that have chroma. With fewer than two of them there is no chroma.
fn chroma_mean(p: [i8; 4]) -> i8 {
    let (mut sum, mut n) = (0i16, 0i16);
    for v in p {
        if v != NO_CHROMA {
            sum += i16::from(v);
            n += 1;
        }
    }
    #[allow(clippy::cast_possible_truncation, reason = "a mean of i8")]
    match n {
        4 => ((sum + 2) >> 2) as i8,
        2 | 3 => (sum / n) as i8,
        _ => NO_CHROMA,
    }
}

/// Makes the levels above level 0. Level 0 lies at the start of `data` and has `w` x `h` px. The
/// other levels follow it. `halve` makes one row of two.
pub(crate) fn reduce_all<T: Copy>(data: &mut [T], mut w: usize, mut h: usize, halve: impl Fn(&[T], &[T], &mut [T])) {
    let mut rest = data;
    for _ in 1..LEVELS {
        let (source, target) = rest.split_at_mut(w * h);
        let (hw, hh) = (w / 2, h / 2);
        for (y, out) in target[..hw * hh].chunks_exact_mut(hw.max(1)).enumerate() {
            let (top, low) = source[2 * y * w..][..2 * w].split_at(w);
            halve(top, low, out);
        }
        rest = target;
        (w, h) = (hw, hh);
    }
}

/// Makes the levels above level 0 of a chroma plane. The function is not inlined, because boards
/// have room for one copy of it.
#[inline(never)]
fn reduce_chroma(plane: &mut [i8], width: usize, height: usize) {
    reduce_all(plane, width, height, halve_chroma);
}

/// All levels of one frame, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct PyramidView<'a> {
    width: usize,
    height: usize,
    luma: &'a [u8],
    a: &'a [i8],
    b: &'a [i8],
}

impl<'a> PyramidView<'a> {
    /// Returns the width of level 0, px.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Returns the height of level 0, px.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Returns the luma of level `level`.
    ///
    /// # Panics
    /// Panics when the view has no such level.
    #[must_use]
    pub fn luma(&self, level: usize) -> Plane<'a, u8> {
        level_of(self.luma, self.width, self.height, level)
    }

    /// Returns both chroma planes of level `level`. They have half the size of its luma.
    ///
    /// # Panics
    /// Panics when the view has no such level.
    #[must_use]
    pub fn chroma(&self, level: usize) -> [Plane<'a, i8>; 2] {
        [self.a, self.b].map(|p| level_of(p, self.width / 2, self.height / 2, level))
    }
}

/// Returns the number of bytes of all levels of a plane of this size, at one byte a pixel.
pub(crate) const fn plane_bytes(width: usize, height: usize) -> usize {
    let (mut bytes, mut l) = (0, 0);
    while l < LEVELS {
        bytes += (width >> l) * (height >> l);
        l += 1;
    }
    bytes
}

/// Returns level `level` of a plane whose level 0 has `width` x `height` px.
pub(crate) fn level_of<T>(data: &[T], width: usize, height: usize, level: usize) -> Plane<'_, T> {
    assert!(level < LEVELS, "a pyramid has {LEVELS} levels");
    let start = (0..level).map(|l| (width >> l) * (height >> l)).sum();
    let (width, height) = (width >> level, height >> level);
    Plane { data: &data[start..][..width * height], width, height }
}

/// Returns the map from px of level 0 to px of level `level`.
#[must_use]
pub fn into_level(level: usize) -> Homography {
    Homography::scaling([1.0 / f32::from(1u8 << level); 2])
}

/// Returns the map from px of level `level` to px of level 0.
#[must_use]
pub fn out_of_level(level: usize) -> Homography {
    Homography::scaling([f32::from(1u8 << level); 2])
}

/// Returns the position in level 0, px, of the point `p` of level `level`. Pixel centres lie at
/// integers on both levels.
#[must_use]
pub fn to_level0(p: Point, level: usize) -> [f32; 2] {
    let scale = f32::from(1u8 << level);
    p.px().map(|v| v * scale + (scale - 1.0) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::frame::PixelFormat;

    #[test]
    fn levels_are_means_of_the_level_below() {
        let mut data = [0u8; 18 * 16];
        data.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 18 * 10) as u8);
        let mut p: Pyramid<400, 100> = Pyramid::new();
        p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 18, 16, &data).unwrap()).unwrap();
        p.planes_mut().reduce();
        let v = p.view();
        assert_eq!(v.luma(1).row(3), [5, 25, 45, 65, 85, 105, 125, 145, 165]);
        assert_eq!(v.luma(2).row(0), [15, 55, 95, 135]);
        assert_eq!((v.chroma(2)[0].width(), v.chroma(2)[0].height()), (2, 2));
        assert_eq!(v.chroma(1)[1].nearest(9, 9), NO_CHROMA);
    }

    #[test]
    fn chroma_mean_leaves_out_what_has_none() {
        assert_eq!(chroma_mean([10, NO_CHROMA, 20, NO_CHROMA]), 15);
        assert_eq!(chroma_mean([10, NO_CHROMA, NO_CHROMA, NO_CHROMA]), NO_CHROMA);
        assert_eq!(chroma_mean([-4, -4, -4, -4]), -4);
    }

    /// Rows of all lengths are halved. In some words all pixels have chroma, in some a part, in
    /// some none.
    #[test]
    fn rows_halved_by_words_are_means_of_squares() {
        let noise = |i: usize, seed: usize| ((i + 1) * (seed + 77)) as u32;
        let noise = |i, seed| noise(i, seed).wrapping_mul(2_654_435_761) >> 7;
        for seed in 0..40 {
            for n in 1..40 {
                let luma: [std::vec::Vec<u8>; 2] =
                    [0, 1].map(|r| (0..2 * n + n % 2).map(|i| noise(i, seed + 50 * r) as u8).collect());
                let lacks = |i: usize| i % 16 > 8 && (seed % 3 == 0 || noise(i / 2, seed) % 5 < 2);
                let chroma = luma.clone().map(|row| {
                    let value = |(i, v): (usize, u8)| if lacks(i) { NO_CHROMA } else { v.cast_signed() };
                    row.into_iter().enumerate().map(value).collect::<std::vec::Vec<i8>>()
                });
                let (mut halves, mut halves_of_chroma) = (std::vec![0; n], std::vec![0; n]);
                by_four::halve_luma(&luma[0], &luma[1], &mut halves);
                by_four::halve_chroma(&chroma[0], &chroma[1], &mut halves_of_chroma);
                let (mut by_eight, mut chroma_by_eight) = (std::vec![0; n], std::vec![0; n]);
                by_eight::halve_luma(&luma[0], &luma[1], &mut by_eight);
                by_eight::halve_chroma(&chroma[0], &chroma[1], &mut chroma_by_eight);
                assert_eq!((&by_eight, &chroma_by_eight), (&halves, &halves_of_chroma));
                for i in 0..n {
                    let square = [luma[0][2 * i], luma[0][2 * i + 1], luma[1][2 * i], luma[1][2 * i + 1]];
                    assert_eq!(u16::from(halves[i]), (square.map(u16::from).iter().sum::<u16>() + 2) / 4);
                    let square = [chroma[0][2 * i], chroma[0][2 * i + 1], chroma[1][2 * i], chroma[1][2 * i + 1]];
                    assert_eq!(halves_of_chroma[i], chroma_mean(square), "{square:?}");
                }
            }
        }
    }

    #[test]
    fn a_frame_that_does_not_fit_is_refused() {
        let mut p: Pyramid<340, 85> = Pyramid::new();
        let data = [0; 17 * 17];
        assert!(p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 16, 16, &data[..256]).unwrap()).is_ok());
        assert!(matches!(
            p.planes_mut().load(&Frame::new(PixelFormat::Gray8, 17, 17, &data).unwrap()),
            Err(FrameError::TooLarge { pixels: 289, max_pixels: 256, .. })
        ));
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
