//! Checks raw camera buffers once, and converts them to luma and chroma.
//!
//! In: a borrowed buffer in one of eight pixel formats, whose rows may have bytes between them. Out:
//! full-size luma (`u8`) and two half-size planes of normalised chroma (`i8`), as the file `pixels`
//! defines them; and windows of the frame, which are frames themselves. The luma of a dark frame is
//! stretched.
//!
//! Memory: none beyond the planes. No pixel is copied for a window or for a stride. Cost: one pass
//! over the pixels.

use crate::base::geometry::Homography;
use crate::base::pace::{Pace, Steady};
use crate::base::says::says;
use crate::image::exposure::{Brightness, Exposure};
use crate::image::pixels::{Code, DARK, PixelFormat, Raster};

/// Minimum side of a frame, px.
pub const MIN_SIDE: usize = 16;

/// Maximum side of any frame, px. It makes the size in bytes fit 32 bits. Detectors accept less.
pub const MAX_SIDE: usize = (1 << 15) - 1;

/// The reason why a frame was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameError {
    /// The buffer does not hold exactly one frame: pass `expected` bytes (rows without padding), or
    /// use [`Frame::with_stride`]. With a stride, the buffer ends before the frame does: pass at least
    /// `expected` bytes.
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
    /// The stride is shorter than a row, or odd where half of it is the stride of the chroma planes
    /// ([`PixelFormat::I420`]). Pass the number of bytes from a row to the next.
    WrongStride {
        /// Stride that was given, bytes.
        stride: usize,
        /// Number of bytes of a row.
        row: usize,
    },
    /// The window leaves the frame. Move it inside, or make it smaller.
    Outside {
        /// The window.
        window: Window,
        /// Width of the frame, px.
        width: usize,
        /// Height of the frame, px.
        height: usize,
    },
    /// The window begins between pixels that share chroma. Begin at an even x; in
    /// [`PixelFormat::Nv12`] and [`PixelFormat::I420`] at an even y too.
    OddPlace {
        /// Leftmost column of the window.
        x: usize,
        /// Topmost row of the window.
        y: usize,
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
    Self::WrongStride { stride, row } => (
        "a stride of {} bytes does not suit rows of {} bytes: it must be as long, and even in I420",
        stride,
        row
    ),
    Self::Outside { window, width, height } => (
        "the window at ({}, {}) of {}x{} px leaves the frame, which has {}x{} px",
        window.x,
        window.y,
        window.width,
        window.height,
        width,
        height
    ),
    Self::OddPlace { x, y } => (
        "a window at ({}, {}) parts pixels that share chroma: it needs an even x, and an even y in NV12 and I420",
        x,
        y
    ),
});

/// A rectangular part of a frame, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl Window {
    /// Returns the map from px of the window to px of the frame. [`Detection::mapped`] takes it.
    ///
    /// [`Detection::mapped`]: crate::Detection::mapped
    #[must_use]
    pub const fn to_frame(&self) -> Homography {
        Homography::affine([1.0, 0.0, self.x as f32, 0.0, 1.0, self.y as f32])
    }
}

/// One frame as the camera gave it. A view that exists is valid.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    format: PixelFormat,
    height: usize,
    raster: Raster<'a>,
    code: &'static Code,
}

impl<'a> Frame<'a> {
    /// Makes a frame. Size and length are checked here, once. Where `format` is a constant, a program
    /// links the conversion of this format alone.
    ///
    /// # Errors
    /// Returns a [`FrameError`] when a side is too short or too long, when a side is odd and the
    /// format needs an even one, or when `data` is not exactly one frame.
    #[inline(always)]
    pub const fn new(format: PixelFormat, width: usize, height: usize, data: &'a [u8]) -> Result<Self, FrameError> {
        Self::packed(format, format.code(), width, height, data)
    }

    /// Makes a frame whose rows begin `stride` bytes apart: what lies between the end of a row and the
    /// next is not read, and need not be there after the last row. `data` begins with the first row.
    ///
    /// The stride is that of luma in [`PixelFormat::Nv12`] and [`PixelFormat::I420`]. The chroma
    /// planes follow after `stride * height` bytes. The rows of NV12's chroma have the same stride,
    /// those of I420's have half of it, as cameras and video decoders have it.
    ///
    /// # Errors
    /// Returns a [`FrameError`] as [`Frame::new`] does, and when the stride is shorter than a row.
    #[inline(always)]
    pub const fn with_stride(
        format: PixelFormat,
        width: usize,
        height: usize,
        stride: usize,
        data: &'a [u8],
    ) -> Result<Self, FrameError> {
        Self::strided(format, format.code(), [width, height], stride, data)
    }

    /// Makes a frame whose rows have nothing between them.
    const fn packed(
        format: PixelFormat,
        code: &'static Code,
        width: usize,
        height: usize,
        data: &'a [u8],
    ) -> Result<Self, FrameError> {
        if let Err(e) = check_size(format, width, height) {
            return Err(e);
        }
        let expected = format.bytes(width, height);
        if data.len() != expected {
            return Err(FrameError::WrongLength { expected, given: data.len() });
        }
        Ok(Self { format, height, raster: raster(format, [width, height], format.row_bytes(width), data), code })
    }

    const fn strided(
        format: PixelFormat,
        code: &'static Code,
        [width, height]: [usize; 2],
        stride: usize,
        data: &'a [u8],
    ) -> Result<Self, FrameError> {
        if let Err(e) = check_size(format, width, height) {
            return Err(e);
        }
        let row = format.row_bytes(width);
        if stride < row || (matches!(format, PixelFormat::I420) && !stride.is_multiple_of(2)) {
            return Err(FrameError::WrongStride { stride, row });
        }
        // A length that no number holds is longer than any buffer.
        let countable = stride <= usize::MAX / (2 * height);
        let expected = if countable { bytes_to_last(format, width, height, stride) } else { usize::MAX };
        if data.len() < expected {
            return Err(FrameError::WrongLength { expected, given: data.len() });
        }
        Ok(Self { format, height, raster: raster(format, [width, height], stride, data), code })
    }

    /// Returns a part of the frame as a frame of its own. It shares the bytes: no pixel is copied.
    ///
    /// What is found in it is in px of the window. [`Detection::mapped`] with [`Window::to_frame`]
    /// gives px of the whole frame.
    ///
    /// ```
    /// use keygraph_core::{Frame, PixelFormat, Window};
    ///
    /// let camera = [0; 2 * 640 * 480];
    /// let frame = Frame::new(PixelFormat::Uyvy, 640, 480, &camera)?;
    /// let window = Window { x: 200, y: 100, width: 320, height: 240 };
    /// let part = frame.window(window)?;
    /// assert_eq!((part.width(), part.height()), (320, 240));
    /// assert_eq!(window.to_frame().apply([10.0, 20.0]), [210.0, 120.0]);
    /// # Ok::<(), keygraph_core::FrameError>(())
    /// ```
    ///
    /// [`Detection::mapped`]: crate::Detection::mapped
    ///
    /// # Errors
    /// Returns a [`FrameError`] when the window leaves the frame, when it is smaller than a frame can
    /// be, or when the format shares chroma between pixels and a place or a side of the window is odd.
    pub const fn window(&self, window: Window) -> Result<Self, FrameError> {
        let Self { format, height, raster, code } = *self;
        let Window { x, y, width: w, height: h } = window;
        let inside = w <= raster.width && x <= raster.width - w && h <= height && y <= height - h;
        if !inside {
            return Err(FrameError::Outside { window, width: raster.width, height });
        }
        if let Err(e) = check_size(format, w, h) {
            return Err(e);
        }
        let (columns, rows) = format.shares();
        if (columns && !x.is_multiple_of(2)) || (rows && !y.is_multiple_of(2)) {
            return Err(FrameError::OddPlace { x, y });
        }
        let first = y * raster.stride + format.row_bytes(x);
        let (_, data) = raster.data.split_at(first);
        let to_u = if format.has_planes() {
            let (step, row) = raster.chroma_steps();
            raster.to_u + y / 2 * row + x / 2 * step - first
        } else {
            0
        };
        Ok(Self { format, height: h, raster: Raster { data, width: w, to_u, ..raster }, code })
    }

    /// Returns the width, px.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.raster.width
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
        let (width, height) = (self.width(), self.height);
        let luma = &mut luma[..width * height];
        let exposure = self.exposure(&mut luma[..width], &mut Steady);
        self.read_luma(Window { x: 0, y: 0, width, height }, luma);
        exposure.apply(luma);
    }

    /// Measures how bright the frame is. `row` is scratch memory for a row.
    fn exposure(&self, row: &mut [u8], pace: &mut dyn Pace) -> Exposure {
        let read = |y, row: &mut [u8]| self.read_luma(Window { x: 0, y, width: row.len(), height: 1 }, row);
        Exposure::of(self.height, row, read, pace)
    }

    /// Writes the luma of a part of the frame into `luma`, row after row. The part must lie within
    /// the frame. It may begin anywhere. `luma` has one byte for each of its pixels.
    pub(crate) fn convert_luma_of(&self, part: Window, luma: &mut [u8]) {
        self.read_luma(part, luma);
        let mut brightness = Brightness::NONE;
        luma.chunks_exact(part.width).for_each(|row| brightness.add(row));
        brightness.exposure().apply(luma);
    }

    /// Writes the luma of a part of the frame as it is.
    #[cfg_attr(not(feature = "dispatch"), inline(never))]
    fn read_luma(&self, part: Window, luma: &mut [u8]) {
        let row = self.format.row_bytes(part.width);
        let mut first = part.y * self.raster.stride + self.format.row_bytes(part.x);
        // Rows with nothing between them are one row.
        let (times, rows) = if row == self.raster.stride { (1, part.height) } else { (part.height, 1) };
        let pixels = rows * part.width;
        for i in 0..times {
            (self.code.luma)(&self.raster.data[first..][..rows * row], &mut luma[i * pixels..][..pixels]);
            first += self.raster.stride;
        }
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
        let (w, c) = (self.width(), self.width() / 2);
        let exposure = self.exposure(&mut luma[..w], pace);
        let dark = 4 * exposure.under(DARK);
        // Each row of chroma stands for two rows of luma. An odd last row has luma alone.
        for y in (0..self.height.div_ceil(2)).step_by(BAND) {
            // The frame is converted to its end, so that what is known can be followed.
            pace.goes_on();
            let rows = BAND.min(self.height / 2 - y);
            let height = (2 * BAND).min(self.height - 2 * y);
            let band = Window { x: 0, y: 2 * y, width: w, height };
            let luma = &mut luma[2 * y * w..][..height * w];
            self.read_luma(band, luma);
            exposure.apply(luma);
            for y in y..y + rows {
                (self.code.chroma)(&self.raster, y, dark, &mut a[y * c..][..c], &mut b[y * c..][..c]);
            }
        }
    }
}

/// Number of rows of chroma that are converted at a time.
const BAND: usize = 4;

/// Checks the size of a frame.
const fn check_size(format: PixelFormat, width: usize, height: usize) -> Result<(), FrameError> {
    if width < MIN_SIDE || height < MIN_SIDE {
        return Err(FrameError::TooSmall { width, height });
    }
    let side = if width > height { width } else { height };
    if side > MAX_SIDE {
        let pixels = width.saturating_mul(height);
        return Err(FrameError::TooLarge { pixels, max_pixels: MAX_SIDE * MAX_SIDE, side, max_side: MAX_SIDE });
    }
    let (columns, rows) = format.shares();
    if columns && !width.is_multiple_of(2) {
        return Err(FrameError::OddWidth { width });
    }
    if rows && !height.is_multiple_of(2) {
        return Err(FrameError::OddHeight { height });
    }
    Ok(())
}

/// Returns the number of bytes from the first pixel of a frame to the last.
const fn bytes_to_last(format: PixelFormat, width: usize, height: usize, stride: usize) -> usize {
    let last = stride * (height - 1) + width;
    match format {
        PixelFormat::Nv12 => last + stride * (height / 2),
        PixelFormat::I420 => stride * height + stride / 2 * (height - 1) + width / 2,
        _ => stride * (height - 1) + format.row_bytes(width),
    }
}

/// Returns where the pixels of a whole frame lie.
const fn raster(format: PixelFormat, [width, height]: [usize; 2], stride: usize, data: &[u8]) -> Raster<'_> {
    let to_v = if matches!(format, PixelFormat::Nv12) { 1 } else { stride / 2 * (height / 2) };
    Raster { data, width, stride, to_u: stride * height, to_v }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const W: usize = 16;
    const H: usize = 16;

    fn planes(format: PixelFormat, data: &[u8]) -> ([u8; W * H], [i8; 64], [i8; 64]) {
        let (mut l, mut a, mut b) = ([0; W * H], [0; 64], [0; 64]);
        Frame::new(format, W, H, data).unwrap().convert(&mut l, &mut a, &mut b);
        (l, a, b)
    }

    #[test]
    fn luma_of_a_part_is_that_of_the_whole() {
        let data: Vec<u8> = (0..3 * W * H).map(|i| (i * i / 7) as u8 | 0x80).collect();
        for format in PixelFormat::ALL {
            let frame = Frame::new(format, W, H, &data[..format.bytes(W, H)]).unwrap();
            let (mut whole, mut luma) = ([0; W * H], [0; W * H]);
            frame.convert_luma(&mut whole);
            let part = Window { x: 3, y: 5, width: 11, height: 11 };
            frame.convert_luma_of(part, &mut luma[..11 * 11]);
            for (y, row) in (5..).zip(luma[..11 * 11].chunks(11)) {
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
            let mut uyvy = [0; 2 * W * H];
            uyvy.chunks_mut(4).for_each(|p| p.copy_from_slice(&[u, y, v, y]));
            let packed = u16::from(r >> 3) << 11 | u16::from(g >> 2) << 5 | u16::from(b >> 3);
            let [mut rgb565, mut rgb565_be] = [[0; 2 * W * H]; 2];
            rgb565.chunks_mut(2).for_each(|p| p.copy_from_slice(&packed.to_le_bytes()));
            rgb565_be.chunks_mut(2).for_each(|p| p.copy_from_slice(&packed.to_be_bytes()));

            for (format, data, luma_is_y) in [
                (PixelFormat::Yuyv, &yuyv[..], true),
                (PixelFormat::Nv12, &nv12[..], true),
                (PixelFormat::I420, &i420[..], true),
                (PixelFormat::Rgb565, &rgb565[..], false),
                (PixelFormat::Uyvy, &uyvy[..], true),
                (PixelFormat::Rgb565Be, &rgb565_be[..], false),
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

    /// Bytes of a sensor that sends them in the other order give the same planes.
    #[test]
    fn the_order_of_bytes_does_not_matter() {
        let data: Vec<u8> = (0..2 * W * H).map(|i| (i * i / 5 + i) as u8).collect();
        let swapped: Vec<u8> = data.as_chunks::<2>().0.iter().flat_map(|&[a, b]| [b, a]).collect();
        assert_eq!(planes(PixelFormat::Yuyv, &data), planes(PixelFormat::Uyvy, &swapped));
        assert_eq!(planes(PixelFormat::Rgb565, &data), planes(PixelFormat::Rgb565Be, &swapped));
    }

    #[test]
    fn a_window_may_begin_anywhere_where_no_chroma_is_shared() {
        let at = |format: PixelFormat, x, y, width, height| {
            let data = &[0; 3 * 64 * 48][..format.bytes(64, 48)];
            Frame::new(format, 64, 48, data).unwrap().window(Window { x, y, width, height }).map(|_| ())
        };
        for format in PixelFormat::ALL {
            let (columns, rows) = format.shares();
            let odd = |x, y| Err(FrameError::OddPlace { x, y });
            assert_eq!(at(format, 3, 2, 20, 20), if columns { odd(3, 2) } else { Ok(()) }, "{format:?}");
            assert_eq!(at(format, 2, 3, 20, 20), if rows { odd(2, 3) } else { Ok(()) }, "{format:?}");
            let wide = if columns { Err(FrameError::OddWidth { width: 21 }) } else { Ok(()) };
            assert_eq!(at(format, 2, 2, 21, 20), wide, "{format:?}");
            let high = if rows { Err(FrameError::OddHeight { height: 21 }) } else { Ok(()) };
            assert_eq!(at(format, 2, 2, 20, 21), high, "{format:?}");
        }
    }

    #[test]
    fn a_window_lies_in_its_frame() {
        let data = [0; 64 * 48];
        let frame = Frame::new(PixelFormat::Gray8, 64, 48, &data).unwrap();
        let at = |x, y, width, height| frame.window(Window { x, y, width, height }).map(|f| (f.width(), f.height()));
        assert_eq!(at(48, 32, 16, 16), Ok((16, 16)));
        for (x, y, w, h) in
            [(49, 0, 16, 16), (0, 33, 16, 16), (0, 0, 65, 48), (0, 0, 64, 49), (usize::MAX, 0, 16, 16), (64, 0, 16, 16)]
        {
            let window = Window { x, y, width: w, height: h };
            assert_eq!(at(x, y, w, h), Err(FrameError::Outside { window, width: 64, height: 48 }));
        }
        assert_eq!(at(0, 0, 15, 16), Err(FrameError::TooSmall { width: 15, height: 16 }));
    }

    #[test]
    fn a_stride_holds_a_row_and_a_buffer_holds_the_frame() {
        use FrameError as E;
        let data = [0; 8192];
        let e = |f, stride, n| Frame::with_stride(f, 32, 16, stride, &data[..n]).map(|_| ());
        for format in PixelFormat::ALL {
            let row = format.row_bytes(32);
            let stride = row + 4;
            // The last row needs no padding.
            let needed = match format {
                PixelFormat::Nv12 => 23 * stride + 32,
                PixelFormat::I420 => 16 * stride + 15 * stride / 2 + 16,
                _ => 15 * stride + row,
            };
            assert_eq!(e(format, stride, needed), Ok(()), "{format:?}");
            assert_eq!(e(format, stride, needed + 99), Ok(()), "{format:?}");
            assert_eq!(
                e(format, stride, needed - 1),
                Err(E::WrongLength { expected: needed, given: needed - 1 }),
                "{format:?}"
            );
            assert_eq!(e(format, row - 1, 8192), Err(E::WrongStride { stride: row - 1, row }), "{format:?}");
            let endless = Err(E::WrongLength { expected: usize::MAX, given: 8192 });
            assert_eq!(e(format, usize::MAX & !1, 8192), endless, "{format:?}");
        }
        assert_eq!(e(PixelFormat::I420, 33, 8192), Err(E::WrongStride { stride: 33, row: 32 }));
        assert_eq!(e(PixelFormat::Nv12, 33, 8192), Ok(()));
        assert_eq!(Frame::with_stride(PixelFormat::Yuyv, 17, 16, 64, &data).unwrap_err(), E::OddWidth { width: 17 });
    }

    #[test]
    fn a_place_in_a_window_is_a_place_in_the_frame() {
        let window = Window { x: 40, y: 22, width: 16, height: 16 };
        assert_eq!(window.to_frame().apply([1.5, 3.0]), [41.5, 25.0]);
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
}
