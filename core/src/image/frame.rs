//! Checks raw camera buffers once, and converts them to luma and chroma.
//!
//! In: a borrowed buffer in one of six pixel formats. Out: full-size luma (`u8`) and two half-size
//! planes of normalised chroma (`i8`).
//!
//! Luma is Y or (4899 R + 9617 G + 1868 B) / 16384 (BT.601), stretched in a dark frame. Chroma of a
//! 2x2 block is the vector `(R - (G+B)/2, sqrt(3)/2 (G-B)) / max(R,G,B)`, scaled by 127. Its angle is
//! the hue, its length the saturation of HSV, and brightness does not change it. A block darker than
//! [`DARK`], in a dark frame less, has no chroma: both planes then hold [`NO_CHROMA`].
//!
//! Memory: none beyond the planes. Cost: one pass over the pixels.

use core::ops::Range;

use crate::base::math::{self, VECTORS};
use crate::base::pace::{Pace, Steady};
use crate::base::says::says;
use crate::image::exposure::{Brightness, Exposure};

/// Value in both chroma planes where a block has no chroma: the block is too dark, or the frame is
/// gray.
pub const NO_CHROMA: i8 = -128;

/// Minimum value (of 255) of the brightest channel of a block that has chroma.
pub const DARK: i32 = 20;

/// Minimum side of a frame, px.
pub const MIN_SIDE: usize = 16;

/// Maximum side of any frame, px. It makes the size in bytes fit 32 bits. Detectors accept less.
pub const MAX_SIDE: usize = (1 << 15) - 1;

/// Layout of the pixels of a [`Frame`] in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PixelFormat {
    /// 3 bytes a pixel: red, green, blue.
    Rgb8,
    /// 1 byte a pixel.
    Gray8,
    /// 4:2:2 packed, `Y0 U Y1 V`, 2 bytes a pixel. The width must be even.
    Yuyv,
    /// 4:2:0, a Y plane, then interleaved U and V of half size. Both sides must be even.
    Nv12,
    /// 4:2:0, a Y plane, then a U plane and a V plane of half size. Both sides must be even.
    I420,
    /// 2 bytes a pixel, little endian, red in the top five bits.
    Rgb565,
}

impl PixelFormat {
    /// All formats, in the order of their declaration: `ALL[f as usize] == f`.
    pub const ALL: [Self; 6] = [Self::Rgb8, Self::Gray8, Self::Yuyv, Self::Nv12, Self::I420, Self::Rgb565];

    /// Returns the number of bytes of a frame of `width` x `height` px, without padding.
    #[must_use]
    pub const fn bytes(self, width: usize, height: usize) -> usize {
        let n = width * height;
        match self {
            Self::Rgb8 => 3 * n,
            Self::Gray8 => n,
            Self::Yuyv | Self::Rgb565 => 2 * n,
            Self::Nv12 | Self::I420 => n + n / 2,
        }
    }
}

/// The reason why a frame was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// The buffer does not hold exactly one frame. Pass `expected` bytes (rows without padding).
    WrongLength {
        /// Number of bytes of a frame of this size and format.
        expected: usize,
        /// Number of bytes that were given.
        given: usize,
    },
    /// The width is odd, and the format shares chroma between columns. Crop to an even width.
    OddWidth {
        /// Width that was given, px.
        width: usize,
    },
    /// The height is odd, and the format shares chroma between rows. Crop to an even height.
    OddHeight {
        /// Height that was given, px.
        height: usize,
    },
    /// A side is shorter than [`MIN_SIDE`]. Pass a larger frame.
    TooSmall {
        /// Width that was given, px.
        width: usize,
        /// Height that was given, px.
        height: usize,
    },
    /// The frame does not fit the buffers of the profile. Scale it down, or use a larger profile.
    TooLarge {
        /// Number of pixels that were given.
        pixels: usize,
        /// Maximum number of pixels.
        max_pixels: usize,
        /// Longer side that was given, px.
        side: usize,
        /// Maximum length of the longer side, px.
        max_side: usize,
    },
}

says!(FrameError {
    Self::WrongLength { expected, given } => (
        "the buffer has {} bytes; a frame of this size and format has {}",
        given,
        expected
    ),
    Self::OddWidth { width } => ("width {} is odd; this format needs an even width", width),
    Self::OddHeight { height } => ("height {} is odd; this format needs an even height", height),
    Self::TooSmall { width, height } => (
        "{}x{} is too small; each side must have at least {} px",
        width,
        height,
        MIN_SIDE
    ),
    Self::TooLarge { pixels, max_pixels, side, max_side } => (
        "{} pixels with a longer side of {} px do not fit: at most {} pixels and {} px; scale it down, or use a larger profile",
        pixels,
        side,
        max_pixels,
        max_side
    ),
});

/// A rectangular part of a frame, px.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) columns: Range<usize>,
    pub(crate) rows: Range<usize>,
}

/// One frame as the camera gave it. A view that exists is valid.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    format: PixelFormat,
    width: usize,
    height: usize,
    data: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Makes a frame. Size and length are checked here, once.
    ///
    /// # Errors
    /// Returns a [`FrameError`] when a side is too short or too long, when a side is odd and the
    /// format needs an even one, or when `data` is not exactly one frame.
    pub const fn new(format: PixelFormat, width: usize, height: usize, data: &'a [u8]) -> Result<Self, FrameError> {
        if width < MIN_SIDE || height < MIN_SIDE {
            return Err(FrameError::TooSmall { width, height });
        }
        let side = if width > height { width } else { height };
        if side > MAX_SIDE {
            let pixels = width.saturating_mul(height);
            return Err(FrameError::TooLarge { pixels, max_pixels: MAX_SIDE * MAX_SIDE, side, max_side: MAX_SIDE });
        }
        let (odd_width, odd_height) = match format {
            PixelFormat::Yuyv => (!width.is_multiple_of(2), false),
            PixelFormat::Nv12 | PixelFormat::I420 => (!width.is_multiple_of(2), !height.is_multiple_of(2)),
            _ => (false, false),
        };
        if odd_width {
            return Err(FrameError::OddWidth { width });
        }
        if odd_height {
            return Err(FrameError::OddHeight { height });
        }
        let expected = format.bytes(width, height);
        if data.len() != expected {
            return Err(FrameError::WrongLength { expected, given: data.len() });
        }
        Ok(Self { format, width, height, data })
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

    /// Returns the layout of the pixels in memory.
    #[must_use]
    pub const fn format(&self) -> PixelFormat {
        self.format
    }

    /// Writes luma alone into `luma` (`width * height`), in one pass over the pixels.
    ///
    /// # Panics
    /// Panics when `luma` is shorter than that.
    pub fn convert_luma(&self, luma: &mut [u8]) {
        let (w, h) = (self.width, self.height);
        let luma = &mut luma[..w * h];
        let exposure = Exposure::of(h, &mut luma[..w], |y, row| luma_from(self, y * w, row), &mut Steady);
        luma_from(self, 0, luma);
        exposure.apply(luma);
    }

    /// Writes the luma of a part of the frame into `luma`, row after row. The part must lie within
    /// the frame.
    pub(crate) fn convert_luma_of(&self, part: &Part, luma: &mut [u8]) {
        let mut brightness = Brightness::NONE;
        let starts = part.rows.clone().map(|y| y * self.width + part.columns.start);
        for (start, row) in starts.zip(luma.chunks_exact_mut(part.columns.len())) {
            luma_from(self, start, row);
            brightness.add(row);
        }
        brightness.exposure().apply(luma);
    }

    /// Writes luma into `luma` (`width * height`) and chroma into the planes `a` and `b`
    /// (`(width / 2) * (height / 2)` each).
    ///
    /// # Panics
    /// May panic when a slice is shorter than that.
    pub fn convert(&self, luma: &mut [u8], a: &mut [i8], b: &mut [i8]) {
        self.convert_at(luma, a, b, &mut Steady);
    }

    /// Converts the frame as [`Frame::convert`] does, in bands of rows.
    pub(crate) fn convert_at(&self, luma: &mut [u8], a: &mut [i8], b: &mut [i8], pace: &mut dyn Pace) {
        let (w, c) = (self.width, self.width / 2);
        let exposure = Exposure::of(self.height, &mut luma[..w], |y, row| luma_from(self, y * w, row), pace);
        // Each row of chroma stands for two rows of luma. An odd last row has luma alone.
        for y in (0..self.height.div_ceil(2)).step_by(BAND) {
            // The frame is converted to its end, so that what is known can be followed.
            pace.goes_on();
            let rows = BAND.min(self.height / 2 - y);
            let luma_rows = (2 * BAND).min(self.height - 2 * y);
            let band = &mut luma[2 * y * w..][..luma_rows * w];
            luma_from(self, 2 * y * w, band);
            exposure.apply(band);
            chroma_from(self, y, 4 * exposure.under(DARK), &mut a[y * c..][..rows * c], &mut b[y * c..]);
        }
    }
}

/// Writes the luma of the pixels from number `first` on, in reading order. The length of `luma` is
/// the number of pixels.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
#[cfg_attr(not(feature = "dispatch"), inline(never))]
fn luma_from(frame: &Frame<'_>, first: usize, luma: &mut [u8]) {
    let (n, data) = (luma.len(), frame.data);
    let pairs = || data[2 * first..].as_chunks::<2>().0;
    match frame.format {
        PixelFormat::Gray8 | PixelFormat::Nv12 | PixelFormat::I420 => luma.copy_from_slice(&data[first..][..n]),
        PixelFormat::Yuyv => luma_from_yuyv(luma, &data[2 * first..][..2 * n]),
        PixelFormat::Rgb8 => luma_from_rgb8(luma, &data[3 * first..][..3 * n]),
        PixelFormat::Rgb565 => luma.iter_mut().zip(pairs()).for_each(|(y, &p)| *y = luma_of(rgb565(p))),
    }
}

/// Number of rows of chroma that are converted at a time.
const BAND: usize = 4;

/// Fills rows of the chroma planes, from row `first` on: `a` and `b` hold these rows.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn chroma_from(frame: &Frame<'_>, first: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
    let (w, h, data) = (frame.width, frame.height, frame.data);
    let n = w * h;
    match frame.format {
        PixelFormat::Gray8 => {
            a.fill(NO_CHROMA);
            b[..a.len()].fill(NO_CHROMA);
        }
        PixelFormat::Rgb8 => fill_chroma(w / 2, first, dark, a, b, |y| {
            let [top, low] = rows(data, 3 * w, y).map(|row| row.as_chunks().0);
            move |x| sums_of_rgb8([&top[x], &low[x]])
        }),
        PixelFormat::Rgb565 => fill_chroma(w / 2, first, dark, a, b, |y| {
            let [top, low] = rows(data, 2 * w, y).map(|row| row.as_chunks().0);
            move |x| {
                let [p, q, r, s] = [top[2 * x], top[2 * x + 1], low[2 * x], low[2 * x + 1]].map(rgb565);
                [0, 1, 2].map(|c| p[c] + q[c] + r[c] + s[c])
            }
        }),
        PixelFormat::Yuyv => fill_chroma(w / 2, first, dark, a, b, |y| {
            let [top, low] = rows(data, 2 * w, y).map(|row| &row.as_chunks::<4>().0[..w / 2]);
            move |x| {
                // Each sum holds the values of two pixels: Y and Y, or U and V.
                let [top, low] = [top[x], low[x]].map(u32::from_le_bytes);
                let [luma, uv] = [0, 8].map(|at| (top >> at & EVEN) + (low >> at & EVEN));
                let halves = [luma & 0xffff, luma >> 16, uv & 0xffff, uv >> 16];
                let [y0, y1, u, v] = halves.map(u32::cast_signed);
                rgb_of_yuv([y0 + y1, 2 * u, 2 * v])
            }
        }),
        PixelFormat::Nv12 | PixelFormat::I420 => {
            let uv = &data[n..];
            // `step` is the distance between neighbours in one plane, `v` the distance from U to V.
            let (step, v) = if frame.format == PixelFormat::Nv12 { (2, 1) } else { (1, n / 4) };
            fill_chroma(w / 2, first, dark, a, b, |y| {
                let [top, low] = rows(data, w, y).map(|row| row.as_chunks().0);
                let (u, v) = (&uv[y * (w / 2) * step..], &uv[y * (w / 2) * step + v..]);
                move |x| {
                    let [[p, q], [r, s]] = [top[x], low[x]].map(|pair: [u8; 2]| pair.map(i32::from));
                    rgb_of_yuv([p + q + r + s, i32::from(u[step * x]) * 4, i32::from(v[step * x]) * 4])
                }
            });
        }
    }
}

/// Returns the two pixel rows of the blocks of row `y`. A row has `bytes` bytes. Each slice starts
/// at its row and ends with the data.
fn rows(data: &[u8], bytes: usize, y: usize) -> [&[u8]; 2] {
    [2 * y, 2 * y + 1].map(|y| &data[y * bytes..])
}

/// Returns red, green and blue of a pixel, 0 to 255 each.
fn rgb565(pixel: [u8; 2]) -> [i32; 3] {
    let v = i32::from(u16::from_le_bytes(pixel));
    let (r, g, b) = (v >> 11, v >> 5 & 63, v & 31);
    [r << 3 | r >> 2, g << 2 | g >> 4, b << 3 | b >> 2]
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a weighted mean of bytes")]
fn luma_of([r, g, b]: [i32; 3]) -> u8 {
    ((4899 * r + 9617 * g + 1868 * b + 8192) >> 14) as u8
}

/// Computes luma of four pixels at a time. Each pixel is read as one word, which holds red, green,
/// blue and a byte beside them. This avoids reading the bytes one by one.
#[inline(always)]
fn luma_from_rgb8(luma: &mut [u8], data: &[u8]) {
    let (groups, rest) = luma.as_chunks_mut::<4>();
    let (pixels, last) = data.as_chunks::<12>();
    for (y, p) in groups.iter_mut().zip(pixels) {
        let words = [word(p, 0), word(p, 3), word(p, 6), word(p, 8) >> 8];
        *y = words.map(|v| luma_of([v, v >> 8, v >> 16].map(|v| v & 255)));
    }
    for (y, p) in rest.iter_mut().zip(last.as_chunks::<3>().0) {
        *y = luma_of(p.map(i32::from));
    }
}

/// Returns the four bytes from `at` on as a number. The first byte is the lowest.
fn word(bytes: &[u8], at: usize) -> i32 {
    bytes.get(at..at + 4).map_or(0, |b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

/// Mask of every second byte.
const EVEN: u32 = 0x00ff_00ff;

/// Copies every second byte, four at a time.
#[inline(always)]
fn luma_from_yuyv(luma: &mut [u8], data: &[u8]) {
    let (groups, rest) = luma.as_chunks_mut::<4>();
    let (pixels, last) = data.as_chunks::<8>();
    for (y, &[a, _, b, _, c, _, d, _]) in groups.iter_mut().zip(pixels) {
        *y = [a, b, c, d];
    }
    for (y, p) in rest.iter_mut().zip(last.as_chunks::<2>().0) {
        *y = p[0];
    }
}

/// Returns the sums of red, green and blue over two pixels of each of two rows.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "16 bits each")]
fn sums_of_rgb8(rows: [&[u8; 6]; 2]) -> [i32; 3] {
    // This mask selects every second byte. The bytes between have room for carries, so that one
    // addition sums both rows for all of them.
    const EVEN: u64 = 0x00ff_00ff_00ff;
    let [top, low] = rows.map(|&[a, b, c, d, e, f]| u64::from_le_bytes([a, b, c, d, e, f, 0, 0]));
    // `even` holds red, blue, and green of the next pixel. `odd` holds green, and red and blue of
    // the next pixel.
    let (even, odd) = ((top & EVEN) + (low & EVEN), (top >> 8 & EVEN) + (low >> 8 & EVEN));
    let red_blue = even + (odd >> 16);
    [red_blue as u16, (even >> 32) as u16 + odd as u16, (red_blue >> 16) as u16].map(i32::from)
}

/// Returns the sums of red, green and blue over four pixels, 0 to 1023 each, from the sums of Y, U
/// and V (BT.601, limited range).
fn rgb_of_yuv([luma, u, v]: [i32; 3]) -> [i32; 3] {
    let (c, u, v) = ((luma - 64) * 298, u - 512, v - 512);
    [c + 409 * v, c - 100 * u - 208 * v, c + 516 * u].map(|t| (t >> 8).clamp(0, 1023))
}

/// Number of blocks whose chroma is computed together.
const STRIP: usize = 64;

/// Fills rows of the chroma planes, from row `first` on. `row(y)(x)` gives the sums of red, green and
/// blue over the four pixels of block `x` of row `y`.
#[inline(always)]
fn fill_chroma<F: Fn(usize) -> [i32; 3]>(
    width: usize,
    first: usize,
    dark: i32,
    a: &mut [i8],
    b: &mut [i8],
    row: impl Fn(usize) -> F,
) {
    for (y, (a, b)) in (first..).zip(a.chunks_exact_mut(width).zip(b.chunks_exact_mut(width))) {
        let sums = row(y);
        if VECTORS { fill_by_strips(dark, a, b, &sums) } else { fill_one_by_one(dark, a, b, &sums) }
    }
}

/// Fills a row of chroma, one block after the other.
#[inline(always)]
fn fill_one_by_one(dark: i32, a: &mut [i8], b: &mut [i8], sums: impl Fn(usize) -> [i32; 3]) {
    for (x, (a, b)) in a.iter_mut().zip(b).enumerate() {
        let [red, green, blue] = sums(x);
        let most = red.max(green).max(blue);
        [*a, *b] = if most < dark { [NO_CHROMA; 2] } else { chroma_of([red, green, blue], most, dark) };
    }
}

/// Fills a row of chroma, the blocks of a strip together.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sums of four bytes")]
fn fill_by_strips(dark: i32, a: &mut [i8], b: &mut [i8], sums: impl Fn(usize) -> [i32; 3]) {
    let mut strip = [[0; STRIP]; 3];
    for (i, (a, b)) in a.chunks_mut(STRIP).zip(b.chunks_mut(STRIP)).enumerate() {
        let [red, green, blue] = &mut strip;
        for x in 0..a.len().min(STRIP) {
            [red[x], green[x], blue[x]] = sums(i * STRIP + x).map(|v| v as i16);
        }
        chroma(&strip, dark, a, b);
    }
}

/// Computes the normalised chroma of blocks. `sums` holds the sums of red, of green and of blue
/// over the four pixels of each block.
#[inline(always)]
fn chroma<const N: usize>(sums: &[[i16; N]; 3], dark: i32, a: &mut [i8], b: &mut [i8]) {
    let n = a.len();
    let ([red, green, blue], b) = (sums.each_ref().map(|s| &s[..n]), &mut b[..n]);
    for i in 0..n {
        let most = red[i].max(green[i]).max(blue[i]);
        [a[i], b[i]] = chroma_of([red[i], green[i], blue[i]].map(i32::from), most.into(), dark);
    }
}

#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "within 127")]
fn chroma_of([red, green, blue]: [i32; 3], most: i32, dark: i32) -> [i8; 2] {
    let k = 63.5 / most as f32;
    let along = (2 * red - (green + blue)) as f32 * k;
    let across = (green - blue) as f32 * (1.732_050_8 * k);
    let lit = most >= dark;
    [along, across].map(|v| if lit { math::whole(v) as i8 } else { NO_CHROMA })
}

#[cfg(test)]
mod tests {
    use super::*;

    const W: usize = 16;
    const H: usize = 16;

    fn planes(format: PixelFormat, data: &[u8]) -> ([u8; W * H], [i8; 64], [i8; 64]) {
        let (mut l, mut a, mut b) = ([0; W * H], [0; 64], [0; 64]);
        Frame::new(format, W, H, data).unwrap().convert(&mut l, &mut a, &mut b);
        (l, a, b)
    }

    #[test]
    fn luma_of_a_part_is_that_of_the_whole() {
        let data: std::vec::Vec<u8> = (0..3 * W * H).map(|i| (i * i / 7) as u8 | 0x80).collect();
        for format in PixelFormat::ALL {
            let frame = Frame::new(format, W, H, &data[..format.bytes(W, H)]).unwrap();
            let (mut whole, mut luma) = ([0; W * H], [0; W * H]);
            frame.convert_luma(&mut whole);
            let part = Part { columns: 3..14, rows: 5..16 };
            frame.convert_luma_of(&part, &mut luma[..11 * 11]);
            for (y, row) in part.rows.zip(luma.chunks(11)) {
                assert_eq!(row, &whole[y * W + 3..][..11], "{format:?}, row {y}");
            }
        }
    }

    /// A solid colour gives the same luma and chroma in every format, within the precision of the
    /// narrower formats.
    #[test]
    fn formats_agree_on_solid_colours() {
        for [r, g, b] in [[200u8, 40, 40], [30, 160, 60], [50, 70, 220], [128, 128, 128], [240, 220, 30]] {
            let mut rgb = [0; 3 * W * H];
            rgb.chunks_mut(3).for_each(|p| p.copy_from_slice(&[r, g, b]));
            let (l0, a0, b0) = planes(PixelFormat::Rgb8, &rgb);

            let [rf, gf, bf] = [r, g, b].map(f32::from);
            let y = (16.0 + 0.257 * rf + 0.504 * gf + 0.098 * bf).round() as u8;
            let u = (128.0 - 0.148 * rf - 0.291 * gf + 0.439 * bf).round() as u8;
            let v = (128.0 + 0.439 * rf - 0.368 * gf - 0.071 * bf).round() as u8;
            let mut yuyv = [0; 2 * W * H];
            yuyv.chunks_mut(4).for_each(|p| p.copy_from_slice(&[y, u, y, v]));
            let mut nv12 = [y; 3 * W * H / 2];
            nv12[W * H..].chunks_mut(2).for_each(|p| p.copy_from_slice(&[u, v]));
            let mut i420 = [y; 3 * W * H / 2];
            i420[W * H..5 * W * H / 4].fill(u);
            i420[5 * W * H / 4..].fill(v);
            let packed = u16::from(r >> 3) << 11 | u16::from(g >> 2) << 5 | u16::from(b >> 3);
            let mut rgb565 = [0; 2 * W * H];
            rgb565.chunks_mut(2).for_each(|p| p.copy_from_slice(&packed.to_le_bytes()));

            for (format, data, luma_is_y) in [
                (PixelFormat::Yuyv, &yuyv[..], true),
                (PixelFormat::Nv12, &nv12[..], true),
                (PixelFormat::I420, &i420[..], true),
                (PixelFormat::Rgb565, &rgb565[..], false),
            ] {
                let (l, a, b) = planes(format, data);
                if luma_is_y {
                    assert!(l.iter().all(|&l| l == y), "{format:?}: luma is Y");
                } else {
                    assert!(l.iter().all(|&l| l.abs_diff(l0[0]) <= 8), "{format:?}: luma {} for {}", l[0], l0[0]);
                }
                for (name, c, c0) in [("a", a, a0), ("b", b, b0)] {
                    assert!(c.iter().all(|&c| c.abs_diff(c0[0]) <= 5), "{format:?} {name}: {} for {}", c[0], c0[0]);
                }
            }
        }
    }

    #[test]
    fn all_formats_are_listed_in_order() {
        for (i, format) in PixelFormat::ALL.into_iter().enumerate() {
            assert_eq!(format as usize, i, "{format:?}");
        }
        // `Rgb565` is the last format of the declaration.
        assert_eq!(PixelFormat::Rgb565 as usize + 1, PixelFormat::ALL.len());
    }

    fn chroma_of(sums: [i16; 3]) -> [i8; 2] {
        let (mut a, mut b) = ([0], [0]);
        chroma(&sums.map(|v| [v; STRIP]), 4 * DARK, &mut a, &mut b);
        [a[0], b[0]]
    }

    #[test]
    fn brightness_leaves_chroma_alone() {
        let at = |k: i16| chroma_of([200, 80, 40].map(|v| v * k));
        let [a, b] = at(4);
        for k in [1, 2, 3] {
            let [a2, b2] = at(k);
            assert!(a.abs_diff(a2) <= 2 && b.abs_diff(b2) <= 2, "{k}: {a2} {b2} for {a} {b}");
        }
    }

    #[test]
    fn dark_and_gray_say_so() {
        assert_eq!(chroma_of([40, 10, 10]), [NO_CHROMA; 2]);
        assert_eq!(chroma_of([400; 3]), [0, 0]);
        let (_, a, b) = planes(PixelFormat::Gray8, &[200; W * H]);
        assert!(a.iter().chain(&b).all(|&c| c == NO_CHROMA));
    }

    #[test]
    fn errors_say_what_was_expected() {
        use FrameError as E;
        let e = |f, w, h, n| Frame::new(f, w, h, &[0; 4096][..n]).unwrap_err();
        assert_eq!(e(PixelFormat::Rgb8, 16, 17, 815), E::WrongLength { expected: 816, given: 815 });
        assert_eq!(e(PixelFormat::Yuyv, 17, 16, 544), E::OddWidth { width: 17 });
        assert_eq!(e(PixelFormat::Nv12, 16, 17, 408), E::OddHeight { height: 17 });
        assert_eq!(e(PixelFormat::I420, 17, 16, 408), E::OddWidth { width: 17 });
        assert_eq!(e(PixelFormat::Gray8, 15, 16, 240), E::TooSmall { width: 15, height: 16 });
        assert!(Frame::new(PixelFormat::Rgb8, 17, 19, &[0; 969]).is_ok());
        assert!(Frame::new(PixelFormat::Yuyv, 16, 17, &[0; 544]).is_ok());
    }

    #[test]
    fn chroma_by_strips_and_one_by_one_are_those_of_the_definition() {
        let random = |i: usize| (i as u32 + 3).wrapping_mul(2_654_435_761) >> 22;
        // Sums of four bytes; every third block is dark.
        let sums =
            |x: usize| [0, 1, 2].map(|c| (random(3 * x + c) as i32).min(1020) >> (4 * i32::from(x.is_multiple_of(3))));
        for n in [1, 2, STRIP - 1, STRIP, STRIP + 1, 3 * STRIP + 5] {
            let [mut a, mut b, mut c, mut d] = [(); 4].map(|()| std::vec![0; n]);
            fill_one_by_one(4 * DARK, &mut a, &mut b, sums);
            fill_by_strips(4 * DARK, &mut c, &mut d, sums);
            assert_eq!((&a, &b), (&c, &d), "{n} blocks");
            for x in 0..n {
                let most = sums(x).into_iter().max().unwrap();
                let [red, green, blue] = sums(x).map(f64::from);
                if most < 4 * DARK {
                    assert_eq!([a[x], b[x]], [NO_CHROMA; 2]);
                } else {
                    let scale = 127.0 / f64::from(most);
                    let want = [(red - (green + blue) / 2.0) * scale, 0.75f64.sqrt() * (green - blue) * scale];
                    let near = [a[x], b[x]].iter().zip(want).all(|(&v, want)| (f64::from(v) - want).abs() < 0.51);
                    assert!(near, "{:?} for {want:?}", [a[x], b[x]]);
                }
            }
        }
    }
}
