//! The pixel formats, and how rows of each become luma and chroma.
//!
//! In: rows of raw bytes in one of eight pixel formats. Out: full-size luma (`u8`) and two half-size
//! planes of normalised chroma (`i8`).
//!
//! Luma is Y itself, or (4899 R + 9617 G + 1868 B) / 16384 (ITU-R BT.601, with the rounding that is
//! usual in the field). Chroma of a 2x2 block is the vector
//! `(R - (G+B)/2, sqrt(3)/2 (G-B)) / max(R,G,B)`, scaled by 127. The angle of the vector is the
//! hue. Its length is the saturation of HSV (up to the difference between hexagon and circle). A
//! change of brightness does not change the vector. A block darker than [`DARK`], in a dark frame less,
//! has no chroma: both planes then hold [`NO_CHROMA`].
//!
//! Each format has its own code, which [`PixelFormat::code`] names. A program links the code of
//! those formats alone that it names where it makes its frames.
//!
//! Memory: none beyond the planes. Cost: one pass over the pixels.

use crate::base::math::{self, VECTORS};

/// Value in both chroma planes where a block has no chroma: the block is too dark, or the frame is
/// gray.
pub const NO_CHROMA: i8 = -128;

/// Minimum value (of 255) of the brightest channel of a block that has chroma.
pub const DARK: i32 = 20;

/// Layout of the pixels of a frame in memory.
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
    /// 4:2:2 packed, `U Y0 V Y1`, 2 bytes a pixel. The width must be even.
    Uyvy,
    /// 2 bytes a pixel, big endian, red in the top five bits: the order in which many sensors send
    /// their bytes.
    Rgb565Be,
}

impl PixelFormat {
    /// All formats, in the order of their declaration: `ALL[f as usize] == f`.
    pub const ALL: [Self; 8] =
        [Self::Rgb8, Self::Gray8, Self::Yuyv, Self::Nv12, Self::I420, Self::Rgb565, Self::Uyvy, Self::Rgb565Be];

    /// Returns the number of bytes of a frame of `width` x `height` px, without padding.
    #[must_use]
    pub const fn bytes(self, width: usize, height: usize) -> usize {
        let first = self.row_bytes(width) * height;
        if self.has_planes() { first + first / 2 } else { first }
    }

    /// Returns the number of bytes of a row of `width` px, without padding. Of a format with planes,
    /// it is a row of the first plane.
    #[must_use]
    pub const fn row_bytes(self, width: usize) -> usize {
        match self {
            Self::Rgb8 => 3 * width,
            Self::Gray8 | Self::Nv12 | Self::I420 => width,
            Self::Yuyv | Self::Rgb565 | Self::Uyvy | Self::Rgb565Be => 2 * width,
        }
    }

    /// Whether chroma has planes of its own.
    pub(crate) const fn has_planes(self) -> bool {
        matches!(self, Self::Nv12 | Self::I420)
    }

    /// Whether columns, and whether rows, share chroma in pairs.
    pub(crate) const fn shares(self) -> (bool, bool) {
        let rows = self.has_planes();
        (rows || matches!(self, Self::Yuyv | Self::Uyvy), rows)
    }

    /// The code of the format. Where the format is known when the program is compiled, no other code
    /// is linked.
    #[inline(always)]
    pub(crate) const fn code(self) -> &'static Code {
        match self {
            Self::Rgb8 => &Code { luma: luma_of_rgb8, chroma: chroma_of_rgb8 },
            Self::Gray8 => &Code { luma: luma_alone, chroma: no_chroma },
            Self::Yuyv => &Code { luma: luma_of_yuyv, chroma: chroma_of_yuyv },
            Self::Nv12 | Self::I420 => &Code { luma: luma_alone, chroma: chroma_of_planes },
            Self::Rgb565 => &Code { luma: luma_of_rgb565, chroma: chroma_of_rgb565 },
            Self::Uyvy => &Code { luma: luma_of_uyvy, chroma: chroma_of_uyvy },
            Self::Rgb565Be => &Code { luma: luma_of_rgb565_be, chroma: chroma_of_rgb565_be },
        }
    }
}

/// Raw bytes of a frame, from its first pixel on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Raster<'a> {
    pub(crate) data: &'a [u8],
    /// Number of pixels of a row.
    pub(crate) width: usize,
    /// Number of bytes from a row to the next; of a format with planes, in the first plane.
    pub(crate) stride: usize,
    /// Of a format with planes: number of bytes from the first pixel to its U.
    pub(crate) to_u: usize,
    /// Of a format with planes: number of bytes from a U to its V. It is 1 when they take turns.
    pub(crate) to_v: usize,
}

impl Raster<'_> {
    /// Of a format with planes: number of bytes from a U to the next, and from a row of U to the
    /// next.
    pub(crate) const fn chroma_steps(&self) -> (usize, usize) {
        if self.to_v == 1 { (2, self.stride) } else { (1, self.stride / 2) }
    }
}

/// Writes the luma of pixels that lie one after the other. Both slices have the same number of
/// pixels.
type LumaCode = fn(&[u8], &mut [u8]);

/// Fills row `y` of both chroma planes: `a` and `b` are that row. A block whose brightest channel is
/// below `dark`, over its four pixels, has no chroma.
type ChromaCode = fn(&Raster<'_>, usize, i32, &mut [i8], &mut [i8]);

/// The code of a pixel format.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Code {
    pub(crate) luma: LumaCode,
    pub(crate) chroma: ChromaCode,
}

/// Copies luma that lies by itself.
fn luma_alone(data: &[u8], luma: &mut [u8]) {
    luma.copy_from_slice(&data[..luma.len()]);
}

fn no_chroma(_: &Raster<'_>, _: usize, _: i32, a: &mut [i8], b: &mut [i8]) {
    a.fill(NO_CHROMA);
    b.fill(NO_CHROMA);
}

/// Defines the code of formats: functions that are compiled for AVX2 too.
macro_rules! code {
    ($($luma:ident: $luma_by:expr, $chroma:ident: $chroma_by:expr;)+) => {$(
        #[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
        fn $luma(data: &[u8], luma: &mut [u8]) {
            $luma_by(data, luma);
        }

        #[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
        fn $chroma(raster: &Raster<'_>, y: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
            $chroma_by(raster, y, dark, a, b);
        }
    )+};
}

code! {
    luma_of_rgb8: luma_by_rgb8, chroma_of_rgb8: chroma_by_rgb8;
    luma_of_yuyv: luma_by_yuv::<0>, chroma_of_yuyv: chroma_by_yuv::<0>;
    luma_of_uyvy: luma_by_yuv::<1>, chroma_of_uyvy: chroma_by_yuv::<8>;
    luma_of_rgb565: luma_by_rgb565::<false>, chroma_of_rgb565: chroma_by_rgb565::<false>;
    luma_of_rgb565_be: luma_by_rgb565::<true>, chroma_of_rgb565_be: chroma_by_rgb565::<true>;
}

#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
fn chroma_of_planes(raster: &Raster<'_>, y: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
    let [top, low] = blocks(raster, y, a);
    let (step, row) = raster.chroma_steps();
    let u = &raster.data[raster.to_u + y * row..];
    let v = &u[raster.to_v..];
    fill_chroma(dark, a, b, |x| {
        let [[p, q], [r, s]] = [top[x], low[x]].map(|pair| pair.map(i32::from));
        rgb_of_yuv([p + q + r + s, i32::from(u[step * x]) * 4, i32::from(v[step * x]) * 4])
    });
}

#[inline(always)]
fn chroma_by_rgb8(raster: &Raster<'_>, y: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
    let [top, low] = blocks(raster, y, a);
    fill_chroma(dark, a, b, |x| sums_of_rgb8([&top[x], &low[x]]));
}

#[inline(always)]
fn chroma_by_rgb565<const BIG: bool>(raster: &Raster<'_>, y: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
    let [top, low] = blocks(raster, y, a);
    fill_chroma(dark, a, b, |x| {
        let ([a, b, c, d], [e, f, g, h]) = (top[x], low[x]);
        let [p, q, r, s] = [[a, b], [c, d], [e, f], [g, h]].map(rgb565::<BIG>);
        [0, 1, 2].map(|c| p[c] + q[c] + r[c] + s[c])
    });
}

/// Fills a row of chroma from 4:2:2. `LUMA` is the number of bits before the first luma of a word.
#[inline(always)]
fn chroma_by_yuv<const LUMA: u32>(raster: &Raster<'_>, y: usize, dark: i32, a: &mut [i8], b: &mut [i8]) {
    let [top, low] = blocks(raster, y, a);
    fill_chroma(dark, a, b, |x| {
        // Each sum holds the values of two pixels: Y and Y, or U and V.
        let [top, low] = [top[x], low[x]].map(u32::from_le_bytes);
        let [luma, uv] = [LUMA, 8 - LUMA].map(|at| (top >> at & EVEN) + (low >> at & EVEN));
        let halves = [luma & 0xffff, luma >> 16, uv & 0xffff, uv >> 16];
        let [y0, y1, u, v] = halves.map(u32::cast_signed);
        rgb_of_yuv([y0 + y1, 2 * u, 2 * v])
    });
}

/// Returns red, green and blue of a pixel, 0 to 255 each.
#[inline(always)]
fn rgb565<const BIG: bool>(pixel: [u8; 2]) -> [i32; 3] {
    let v = i32::from(if BIG { u16::from_be_bytes(pixel) } else { u16::from_le_bytes(pixel) });
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
fn luma_by_rgb8(data: &[u8], luma: &mut [u8]) {
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

/// Copies every second byte from number `LUMA` on, four at a time.
#[inline(always)]
fn luma_by_yuv<const LUMA: usize>(data: &[u8], luma: &mut [u8]) {
    let (groups, rest) = luma.as_chunks_mut::<4>();
    let (pixels, last) = data.as_chunks::<8>();
    for (y, p) in groups.iter_mut().zip(pixels) {
        *y = [0, 2, 4, 6].map(|i| p[i + LUMA]);
    }
    for (y, p) in rest.iter_mut().zip(last.as_chunks::<2>().0) {
        *y = p[LUMA];
    }
}

#[inline(always)]
fn luma_by_rgb565<const BIG: bool>(data: &[u8], luma: &mut [u8]) {
    for (y, &p) in luma.iter_mut().zip(data.as_chunks::<2>().0) {
        *y = luma_of(rgb565::<BIG>(p));
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

/// Returns the bytes of the blocks of row `y`: of each block `N` bytes from each of its two rows. There
/// are as many as elements of `row`.
#[inline(always)]
fn blocks<'a, const N: usize>(raster: &Raster<'a>, y: usize, row: &[i8]) -> [&'a [[u8; N]]; 2] {
    [2 * y, 2 * y + 1].map(|y| &raster.data[y * raster.stride..].as_chunks().0[..row.len()])
}

/// Fills a row of both chroma planes. `sums(x)` gives the sums of red, green and blue over the four
/// pixels of block `x`.
#[inline(always)]
fn fill_chroma(dark: i32, a: &mut [i8], b: &mut [i8], sums: impl Fn(usize) -> [i32; 3]) {
    let b = &mut b[..a.len()];
    if VECTORS { fill_by_strips(dark, a, b, sums) } else { fill_one_by_one(dark, a, b, sums) }
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

    #[test]
    fn all_formats_are_listed_in_order() {
        for (i, format) in PixelFormat::ALL.into_iter().enumerate() {
            assert_eq!(format as usize, i, "{format:?}");
        }
        // `Rgb565Be` is the last format of the declaration.
        assert_eq!(PixelFormat::Rgb565Be as usize + 1, PixelFormat::ALL.len());
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
        let (mut a, mut b) = ([0; 8], [0; 8]);
        let raster = Raster { data: &[200; 16 * 2], width: 16, stride: 16, to_u: 0, to_v: 0 };
        (PixelFormat::Gray8.code().chroma)(&raster, 0, 4 * DARK, &mut a, &mut b);
        assert!(a.iter().chain(&b).all(|&c| c == NO_CHROMA));
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
