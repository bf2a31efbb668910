//! Raw camera buffers, checked once, and their conversion to luma and chroma.
//!
//! In: a borrowed buffer in one of six pixel formats. Out: full-size luma
//! (`u8`) and two half-size planes of normalised chroma (`i8`).
//!
//! Luma is Y itself, or (4899 R + 9617 G + 1868 B) / 16384 (ITU-R BT.601, the
//! rounding of the field). Chroma of a 2x2 block is the vector
//! `(R - (G+B)/2, sqrt(3)/2 (G-B)) / max(R,G,B)`, scaled by 127: its angle is
//! the hue, its length the saturation of HSV (to within the difference between
//! hexagon and circle), and a change of brightness leaves it alone. A block
//! darker than [`DARK`] has no chroma: both planes then hold [`NO_CHROMA`].
//!
//! Memory: none beyond the planes. Cost: one pass over the pixels.

/// Value in both chroma planes where a block has no chroma (too dark, or the
/// frame is gray).
pub const NO_CHROMA: i8 = -128;

/// Blocks whose brightest channel is below this (of 255) have no chroma.
pub const DARK: i32 = 20;

/// Smallest accepted side of a frame, px.
pub const MIN_SIDE: usize = 16;

/// Longest side of any frame, px, so that its size in bytes fits 32 bits. Detectors
/// take less.
pub const MAX_SIDE: usize = 1 << 15;

/// How the pixels of a [`Frame`] lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PixelFormat {
    /// 3 bytes a pixel: red, green, blue.
    Rgb8,
    /// 1 byte a pixel.
    Gray8,
    /// 4:2:2 packed, `Y0 U Y1 V`, 2 bytes a pixel; even width.
    Yuyv,
    /// 4:2:0, a Y plane, then interleaved U and V of half size; even sides.
    Nv12,
    /// 4:2:0, a Y plane, then a U and a V plane of half size; even sides.
    I420,
    /// 2 bytes a pixel, little endian, red in the top five bits.
    Rgb565,
}

impl PixelFormat {
    /// Every format, in the order of their declaration: `ALL[f as usize] == f`.
    pub const ALL: [Self; 6] = [Self::Rgb8, Self::Gray8, Self::Yuyv, Self::Nv12, Self::I420, Self::Rgb565];

    /// Bytes of a frame of `width` x `height` px, without padding.
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

/// Why a frame was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// The buffer does not hold exactly one frame: pass `expected` bytes
    /// (rows without padding).
    WrongLength {
        /// Bytes that a frame of this size and format has.
        expected: usize,
        /// Bytes that were given.
        given: usize,
    },
    /// The format shares chroma between columns: crop to an even width.
    OddWidth {
        /// The width that was given.
        width: usize,
    },
    /// The format shares chroma between rows: crop to an even height.
    OddHeight {
        /// The height that was given.
        height: usize,
    },
    /// A side is shorter than [`MIN_SIDE`]: pass a larger frame.
    TooSmall {
        /// Width given, px.
        width: usize,
        /// Height given, px.
        height: usize,
    },
    /// The frame does not fit the profile's buffers: scale it down, or use a
    /// larger profile.
    TooLarge {
        /// Pixels given.
        pixels: usize,
        /// Most pixels that fit.
        max_pixels: usize,
        /// Longer side given, px.
        side: usize,
        /// Longest side that fits, px.
        max_side: usize,
    },
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::WrongLength { expected, given } => {
                write!(f, "the buffer has {given} bytes; a frame of this size and format has {expected}")
            }
            Self::OddWidth { width } => write!(f, "width {width} is odd; this format needs an even width"),
            Self::OddHeight { height } => write!(f, "height {height} is odd; this format needs an even height"),
            Self::TooSmall { width, height } => {
                write!(f, "{width}x{height} is too small; each side must have at least {MIN_SIDE} px")
            }
            Self::TooLarge { pixels, max_pixels, side, max_side } => write!(
                f,
                "{pixels} pixels with a longer side of {side} px do not fit: at most {max_pixels} pixels and {max_side} px; scale it down, or use a larger profile"
            ),
        }
    }
}

impl core::error::Error for FrameError {}

/// One frame as the camera gave it: a view that exists is valid.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    format: PixelFormat,
    width: usize,
    height: usize,
    data: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Checks size and length once.
    ///
    /// # Errors
    /// [`FrameError`] when a side is too small or odd where the format forbids
    /// it, or when `data` is not exactly one frame.
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

    /// Width, px.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// How the pixels lie in memory.
    #[must_use]
    pub const fn format(&self) -> PixelFormat {
        self.format
    }

    /// Luma alone: one pass over the pixels into `luma` (`width * height`).
    ///
    /// # Panics
    /// Never for a slice of this length or longer.
    pub fn convert_luma(&self, luma: &mut [u8]) {
        let (n, data) = (self.width * self.height, self.data);
        let luma = &mut luma[..n];
        match self.format {
            PixelFormat::Gray8 | PixelFormat::Nv12 | PixelFormat::I420 => luma.copy_from_slice(&data[..n]),
            PixelFormat::Yuyv => luma.iter_mut().zip(data.chunks_exact(2)).for_each(|(y, p)| *y = p[0]),
            PixelFormat::Rgb8 => luma_from_rgb(luma, data.as_chunks().0, rgb8),
            PixelFormat::Rgb565 => luma_from_rgb(luma, data.as_chunks().0, rgb565),
        }
    }

    /// One pass over the pixels into `luma` (`width * height`) and the chroma
    /// planes `a` and `b` (`(width / 2) * (height / 2)` each).
    ///
    /// # Panics
    /// Never for slices of these lengths or longer.
    pub fn convert(&self, luma: &mut [u8], a: &mut [i8], b: &mut [i8]) {
        let (w, h, data) = (self.width, self.height, self.data);
        let n = w * h;
        self.convert_luma(luma);
        match self.format {
            PixelFormat::Gray8 => {
                let c = (w / 2) * (h / 2);
                a[..c].fill(NO_CHROMA);
                b[..c].fill(NO_CHROMA);
            }
            PixelFormat::Rgb8 => chroma_from_rgb(w, a, b, data.as_chunks().0, rgb8),
            PixelFormat::Rgb565 => chroma_from_rgb(w, a, b, data.as_chunks().0, rgb565),
            PixelFormat::Yuyv => {
                let at = |x: usize, y: usize| &data[2 * (y * w + 2 * x)..][..4];
                chroma_from_yuv(w, h, a, b, |x, y| {
                    let (p, q) = (at(x, 2 * y), at(x, 2 * y + 1));
                    let sum = |i: usize| i32::from(p[i]) + i32::from(q[i]);
                    (sum(0) + sum(2), sum(1) * 2, sum(3) * 2)
                });
            }
            PixelFormat::Nv12 | PixelFormat::I420 => {
                let uv = &data[n..];
                // Distance between neighbours of one plane, and of U and V.
                let (step, v) = if self.format == PixelFormat::Nv12 { (2, 1) } else { (1, n / 4) };
                chroma_from_yuv(w, h, a, b, |x, y| {
                    let i = 2 * y * w + 2 * x;
                    let sum = [i, i + 1, i + w, i + w + 1].iter().map(|&i| i32::from(data[i])).sum();
                    let c = (y * (w / 2) + x) * step;
                    (sum, i32::from(uv[c]) * 4, i32::from(uv[c + v]) * 4)
                });
            }
        }
    }
}

/// Red, green and blue of a pixel.
fn rgb8(pixel: [u8; 3]) -> [i32; 3] {
    pixel.map(i32::from)
}

fn rgb565(pixel: [u8; 2]) -> [i32; 3] {
    let v = i32::from(u16::from_le_bytes(pixel));
    let (r, g, b) = (v >> 11, v >> 5 & 63, v & 31);
    [r << 3 | r >> 2, g << 2 | g >> 4, b << 3 | b >> 2]
}

fn luma_from_rgb<const N: usize>(luma: &mut [u8], pixels: &[[u8; N]], rgb: impl Fn([u8; N]) -> [i32; 3]) {
    for (y, &pixel) in luma.iter_mut().zip(pixels) {
        let [r, g, b] = rgb(pixel);
        *y = narrow((4899 * r + 9617 * g + 1868 * b + 8192) >> 14);
    }
}

fn chroma_from_rgb<const N: usize>(
    w: usize,
    a: &mut [i8],
    b: &mut [i8],
    pixels: &[[u8; N]],
    rgb: impl Fn([u8; N]) -> [i32; 3],
) {
    let planes = a.chunks_exact_mut(w / 2).zip(b.chunks_exact_mut(w / 2));
    for (rows, (a, b)) in pixels.chunks_exact(2 * w).zip(planes) {
        let (top, low) = rows.split_at(w);
        let blocks = top.as_chunks::<2>().0.iter().zip(low.as_chunks::<2>().0);
        for (([p, q], [r, s]), (a, b)) in blocks.zip(a.iter_mut().zip(b)) {
            let [p, q, r, s] = [*p, *q, *r, *s].map(&rgb);
            [*a, *b] = chroma([0, 1, 2].map(|c| p[c] + q[c] + r[c] + s[c]));
        }
    }
}

/// `sums(x, y)` gives four times Y, U and V of a 2x2 block (BT.601, limited range).
fn chroma_from_yuv(w: usize, h: usize, a: &mut [i8], b: &mut [i8], sums: impl Fn(usize, usize) -> (i32, i32, i32)) {
    let cw = w / 2;
    for y in 0..h / 2 {
        for x in 0..cw {
            let (luma, u, v) = sums(x, y);
            let (c, u, v) = ((luma - 64) * 298, u - 512, v - 512);
            let s = [c + 409 * v, c - 100 * u - 208 * v, c + 516 * u].map(|t| (t >> 8).clamp(0, 1020));
            [a[y * cw + x], b[y * cw + x]] = chroma(s);
        }
    }
}

/// `127 * 65536 / (2 * 4 m)`: turns a difference of sums over four pixels into
/// 127 times its ratio to twice the brightest sum, 16 bits behind the point.
#[allow(clippy::cast_possible_truncation, reason = "below 256")]
const RECIPROCAL: [i32; 256] = {
    let mut t = [0; 256];
    let mut m = 1;
    while m < 256 {
        t[m] = 127 * 65536 / (8 * m as i32);
        m += 1;
    }
    t
};

/// Normalised chroma of a block from its sums (four pixels) of R, G and B.
fn chroma([r, g, b]: [i32; 3]) -> [i8; 2] {
    let m = r.max(g).max(b) / 4;
    if m < DARK {
        return [NO_CHROMA; 2];
    }
    #[allow(clippy::cast_sign_loss, reason = "DARK <= m <= 255")]
    let k = RECIPROCAL[m as usize];
    // sqrt(3) = 222 / 128
    [2 * r - g - b, (g - b) * 222 / 128].map(|d| signed((d * k) >> 16))
}

#[allow(clippy::cast_possible_truncation, reason = "clamped")]
fn signed(v: i32) -> i8 {
    v.clamp(-127, 127) as i8
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a weighted mean of bytes")]
fn narrow(v: i32) -> u8 {
    v as u8
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

    /// The same solid colour in every format gives the same luma and chroma,
    /// within what the narrower formats can hold.
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
        // The last of the declaration.
        assert_eq!(PixelFormat::Rgb565 as usize + 1, PixelFormat::ALL.len());
    }

    #[test]
    fn brightness_leaves_chroma_alone() {
        let at = |k: i32| chroma([200 * k, 80 * k, 40 * k]);
        let [a, b] = at(4);
        for k in [1, 2, 3] {
            let [a2, b2] = at(k);
            assert!(a.abs_diff(a2) <= 2 && b.abs_diff(b2) <= 2, "{k}: {a2} {b2} for {a} {b}");
        }
    }

    #[test]
    fn dark_and_gray_say_so() {
        assert_eq!(chroma([40, 10, 10]), [NO_CHROMA; 2]);
        assert_eq!(chroma([400, 400, 400]), [0, 0]);
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
}
