//! Pixels in the format of a camera's sensor.
//!
//! In: pixels as they were decoded (RGB, gray, I420). Out: the buffer that a sensor of the
//! wanted format would give, so that a laptop and a board can search the same bytes. A
//! column or row that the format cannot hold is cropped at the right or at the bottom, so
//! that coordinates stay the same. Luma and chroma are ITU-R BT.601, limited
//! range, in integers; a chroma sample is the mean of the pixels that share it.
//!
//! Memory: the pixels as RGB, and the new buffer. Cost: a pass over the pixels.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use keygraph_core::PixelFormat;

use crate::canvas::i420_to_rgb;

/// A format that the detector takes, as the command line names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorFormat(pub PixelFormat);

const ALL: [SensorFormat; PixelFormat::ALL.len()] = {
    let mut all = [SensorFormat(PixelFormat::Rgb8); PixelFormat::ALL.len()];
    let mut i = 0;
    while i < all.len() {
        all[i] = SensorFormat(PixelFormat::ALL[i]);
        i += 1;
    }
    all
};

impl ValueEnum for SensorFormat {
    fn value_variants<'a>() -> &'a [Self] {
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (name, help) = match self.0 {
            PixelFormat::Rgb8 => ("rgb8", "3 bytes a pixel: red, green, blue"),
            PixelFormat::Gray8 => ("gray8", "1 byte a pixel: no colour"),
            PixelFormat::Yuyv => ("yuyv", "4:2:2 packed, Y U Y V"),
            PixelFormat::Nv12 => ("nv12", "4:2:0, a plane of Y, one of U and V in turn"),
            PixelFormat::I420 => ("i420", "4:2:0, planes of Y, U and V"),
            PixelFormat::Rgb565 => ("rgb565", "2 bytes a pixel, little endian, red in the top five bits"),
            PixelFormat::Uyvy => ("uyvy", "4:2:2 packed, U Y V Y"),
            PixelFormat::Rgb565Be => ("rgb565be", "rgb565, big endian"),
        };
        Some(PossibleValue::new(name).help(help))
    }
}

/// Converts `data`, a frame of `width` x `height` px in format `from`, to format `to`.
/// Returns width, height and bytes. A frame in that format already is copied unchanged.
#[must_use]
pub fn sense(
    from: PixelFormat,
    (width, height): (usize, usize),
    data: &[u8],
    to: PixelFormat,
) -> (usize, usize, Vec<u8>) {
    if from == to {
        return (width, height, data.to_vec());
    }
    let rgb = match from {
        PixelFormat::I420 => i420_to_rgb(data, width, height),
        PixelFormat::Gray8 => data.iter().flat_map(|&y| [y; 3]).collect(),
        _ => data.to_vec(),
    };
    let at = |x: usize, y: usize| {
        let i = 3 * (y * width + x);
        [rgb[i], rgb[i + 1], rgb[i + 2]].map(i32::from)
    };
    let (w, h) = match to {
        PixelFormat::Yuyv | PixelFormat::Uyvy => (width & !1, height),
        PixelFormat::Nv12 | PixelFormat::I420 => (width & !1, height & !1),
        _ => (width, height),
    };
    let pixels = || (0..h).flat_map(|y| (0..w).map(move |x| (x, y)));
    let lumas = || pixels().map(|(x, y)| luma(at(x, y)));
    let blocks = || (0..h / 2).flat_map(|y| (0..w / 2).map(move |x| (2 * x, 2 * y)));
    let block = |(x, y): (usize, usize)| chroma(&[at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)]);
    let yuv = |(x, y): (usize, usize)| [luma(at(x, y)), chroma(&[at(x & !1, y), at(x | 1, y)])[x & 1]];
    let rgb565 = |(x, y): (usize, usize)| {
        let [r, g, b] = at(x, y);
        [(g >> 2 & 7) << 5 | b >> 3, r >> 3 << 3 | g >> 5].map(byte)
    };
    let swapped = |[a, b]: [u8; 2]| [b, a];
    let bytes = match to {
        PixelFormat::Rgb8 => rgb,
        PixelFormat::Gray8 => pixels()
            .map(|(x, y)| at(x, y))
            .map(|[r, g, b]| byte((4899 * r + 9617 * g + 1868 * b + 8192) >> 14))
            .collect(),
        PixelFormat::Yuyv => pixels().flat_map(yuv).collect(),
        PixelFormat::Uyvy => pixels().map(yuv).flat_map(swapped).collect(),
        PixelFormat::Nv12 => lumas().chain(blocks().flat_map(block)).collect(),
        PixelFormat::I420 => {
            lumas().chain(blocks().map(|p| block(p)[0])).chain(blocks().map(|p| block(p)[1])).collect()
        }
        PixelFormat::Rgb565 => pixels().flat_map(rgb565).collect(),
        PixelFormat::Rgb565Be => pixels().map(rgb565).flat_map(swapped).collect(),
    };
    (w, h, bytes)
}

/// Luma of a colour, limited range.
fn luma([r, g, b]: [i32; 3]) -> u8 {
    byte(((66 * r + 129 * g + 25 * b + 128) >> 8) + 16)
}

/// U and V of pixels that share one chroma sample.
fn chroma<const N: usize>(pixels: &[[i32; 3]; N]) -> [u8; 2] {
    let n = i32::try_from(N).unwrap_or(1);
    let [r, g, b] = [0, 1, 2].map(|c| pixels.iter().map(|p| p[c]).sum::<i32>() / n);
    [(112 * b - 38 * r - 74 * g + 128) >> 8, (112 * r - 94 * g - 18 * b + 128) >> 8].map(|v| byte(v + 128))
}

fn byte(v: i32) -> u8 {
    u8::try_from(v.clamp(0, 255)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use keygraph_core::Frame;

    /// The core takes the frame of every format, even of a picture with odd sides, and sees
    /// the luma of the picture in it.
    #[test]
    fn frames_are_whole_and_look_alike() {
        let (w, h) = (35, 17);
        let ramp = |step: usize, i: usize| u8::try_from(step * i % 64 + 90).unwrap_or(0);
        let rgb: Vec<u8> = (0..w * h).flat_map(|i| [7, 5, 3].map(|step| ramp(step, i))).collect();
        let luma_of = |format: PixelFormat, w: usize, h: usize, data: &[u8]| {
            let (mut luma, mut a, mut b) = (vec![0; w * h], vec![0; w * h], vec![0; w * h]);
            Frame::new(format, w, h, data).expect("one frame").convert(&mut luma, &mut a, &mut b);
            luma
        };
        let whole = luma_of(PixelFormat::Rgb8, w, h, &rgb);
        for format in PixelFormat::ALL {
            let (sw, sh, data) = sense(PixelFormat::Rgb8, (w, h), &rgb, format);
            let luma = luma_of(format, sw, sh, &data);
            assert!(sw >= w - 1 && sh >= h - 1, "{format:?} crops to {sw}x{sh}");
            for (i, &l) in luma.iter().enumerate() {
                let full = whole[i / sw * w + i % sw];
                // Limited range holds 219 of 255 steps; RGB565 drops three bits.
                assert!(full.abs_diff(l) <= 12, "{format:?} at {i}: {l} for {full}");
            }
        }
    }

    /// The values on the command line are the names of the formats.
    #[test]
    fn every_format_has_its_name() {
        for format in SensorFormat::value_variants() {
            let name = format.to_possible_value().map(|v| v.get_name().to_string()).unwrap_or_default();
            assert_eq!(name, format!("{:?}", format.0).to_lowercase());
            assert_eq!(SensorFormat::from_str(&name, false), Ok(*format));
        }
    }

    #[test]
    fn a_red_pixel_by_hand() {
        let red: Vec<u8> = [255, 0, 0].repeat(16 * 16);
        let start = |format| sense(PixelFormat::Rgb8, (16, 16), &red, format).2[..4].to_vec();
        assert_eq!(start(PixelFormat::Yuyv), [82, 90, 82, 240]);
        assert_eq!(start(PixelFormat::Uyvy), [90, 82, 240, 82]);
        assert_eq!(start(PixelFormat::Rgb565), [0x00, 0xf8, 0x00, 0xf8]);
        assert_eq!(start(PixelFormat::Rgb565Be), [0xf8, 0x00, 0xf8, 0x00]);
        assert_eq!(start(PixelFormat::Gray8), [76, 76, 76, 76]);
        assert_eq!(start(PixelFormat::I420), [82, 82, 82, 82]);
    }
}
