//! Frames of any format as pictures of the host: for frames that are scaled down or mirrored.
//!
//! In: a frame of the core's formats. Out: a [`Picture`]: RGB and gray as they are, video as I420, RGB565
//! as RGB. Memory: the picture. Cost: one pass over the pixels.

use keygraph::picture::{Picture, Pixels};
use keygraph_core::{Frame, FrameError, PixelFormat};

use crate::frame::{Layout, View};

/// The picture that a view shows.
///
/// # Errors
/// When size, stride or length do not fit together.
pub fn picture(view: &View<'_>) -> Result<Picture, FrameError> {
    let (width, height) = view.size();
    if let View::Picture(picture) = view {
        return Ok((*picture).clone());
    }
    let mut bytes = Vec::new();
    let pixels = match (view, view.gather(&mut bytes)) {
        (View::Raw(layout, data), _) => {
            checked(layout, data)?;
            of_raw(layout, data)
        }
        (_, Some(PixelFormat::Rgb8)) => Pixels::Rgb8(bytes),
        _ => Pixels::Gray8(bytes),
    };
    let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
    let height = if matches!(pixels, Pixels::I420(_)) { height & !1 } else { height };
    Ok(Picture { width: side(width), height: side(height), pixels })
}

/// The frame of raw bytes.
///
/// # Errors
/// When size, stride or length do not fit together.
pub fn checked<'a>(layout: &Layout, data: &'a [u8]) -> Result<Frame<'a>, FrameError> {
    let Layout { format, width, height, stride } = *layout;
    match stride {
        Some(stride) => Frame::with_stride(format, width, height, stride, data),
        None => Frame::new(format, width, height, data),
    }
}

/// The pixels of raw bytes that have been checked.
fn of_raw(layout: &Layout, data: &[u8]) -> Pixels {
    let Layout { format, width, height, stride } = *layout;
    let stride = stride.unwrap_or(format.row_bytes(width));
    let row = |y: usize| &data[y * stride..][..format.row_bytes(width)];
    let packed = || (0..height).flat_map(row).copied().collect();
    let chroma = &data[if matches!(format, PixelFormat::Nv12 | PixelFormat::I420) { height * stride } else { 0 }..];
    match format {
        PixelFormat::Rgb8 => Pixels::Rgb8(packed()),
        PixelFormat::Gray8 => Pixels::Gray8(packed()),
        PixelFormat::Rgb565 | PixelFormat::Rgb565Be => {
            let word = if format == PixelFormat::Rgb565 { u16::from_le_bytes } else { u16::from_be_bytes };
            Pixels::Rgb8(
                (0..height)
                    .flat_map(row)
                    .copied()
                    .collect::<Vec<u8>>()
                    .as_chunks::<2>()
                    .0
                    .iter()
                    .flat_map(|&b| rgb(word(b)))
                    .collect(),
            )
        }
        PixelFormat::Nv12 => {
            let part = |i: usize| {
                (0..height / 2).flat_map(move |y| chroma[y * stride..][..width].iter().skip(i).step_by(2).copied())
            };
            Pixels::I420((0..height).flat_map(row).copied().chain(part(0)).chain(part(1)).collect())
        }
        PixelFormat::I420 => {
            let rows = chroma.chunks(stride / 2).take(height).flat_map(|row| &row[..width / 2]);
            Pixels::I420((0..height).flat_map(row).chain(rows).copied().collect())
        }
        PixelFormat::Yuyv => video(height & !1, row, 0),
        PixelFormat::Uyvy => video(height & !1, row, 1),
    }
}

/// Packed video as I420, with the mean chroma of two rows. `luma` is the place of the first luma.
fn video<'a>(height: usize, row: impl Fn(usize) -> &'a [u8] + Copy, luma: usize) -> Pixels {
    let mut out: Vec<u8> = (0..height).flat_map(|y| row(y).iter().skip(luma).step_by(2).copied()).collect();
    for first in [1 - luma, 3 - luma] {
        for y in (0..height).step_by(2) {
            let (above, below) = (row(y), row(y + 1));
            let pairs = above.iter().zip(below).skip(first).step_by(4);
            out.extend(pairs.map(|(&a, &b)| a.midpoint(b)));
        }
    }
    Pixels::I420(out)
}

/// The bytes of a pixel of RGB565.
fn rgb(word: u16) -> [u8; 3] {
    let [r, g, b] = [word >> 11, word >> 5 & 63, word & 31].map(|v| u8::try_from(v).unwrap_or(0));
    [r << 3 | r >> 2, g << 2 | g >> 4, b << 3 | b >> 2]
}
