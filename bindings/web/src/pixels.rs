//! Bytes of a message as pictures.
//!
//! In: pixels in rows without padding, as browsers give them. Out: pictures of the host. Memory: a copy.
//! Cost: a pass over the pixels.

use anyhow::{Context, Result, ensure};
use image::{DynamicImage, RgbaImage};
use keygraph::picture::{Framed, Part, Picture, Pixels, opaque};

use crate::message::{self, Format};

/// Maximum number of pixels of a picture, as for files.
const MOST: u64 = 100_000_000;

/// Checks that the bytes are the pixels that the head tells of.
fn check(pixels: &message::Pixels, bytes: &[u8]) -> Result<()> {
    let message::Pixels { format, width, height } = *pixels;
    let px = u64::from(width) * u64::from(height);
    ensure!(px > 0 && px <= MOST, "a picture has 1 to {MOST} pixels, and this one {width}x{height}");
    let expected = match format {
        Format::Rgba => px * 4,
        Format::Rgb => px * 3,
        Format::Gray => px,
        Format::I420 => {
            ensure!(width % 2 == 0 && height % 2 == 0, "i420: width and height must be even, and are {width}x{height}");
            px * 3 / 2
        }
    };
    ensure!(
        bytes.len() as u64 == expected,
        "{width}x{height} pixels of this format have {expected} bytes, and {} were given",
        bytes.len()
    );
    Ok(())
}

/// A frame. Its opacity is left out: frames of cameras and videos have none.
pub fn frame(pixels: &message::Pixels, bytes: &[u8]) -> Result<Picture> {
    check(pixels, bytes)?;
    let own = match pixels.format {
        Format::Rgba => Pixels::Rgb8(bytes.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect()),
        Format::Rgb => Pixels::Rgb8(bytes.into()),
        Format::Gray => Pixels::Gray8(bytes.into()),
        Format::I420 => Pixels::I420(bytes.into()),
    };
    Ok(Picture { width: pixels.width, height: pixels.height, pixels: own })
}

/// A picture to train on: the part of it that is opaque, as for files.
pub fn picture(pixels: &message::Pixels, bytes: &[u8]) -> Result<Framed> {
    if !matches!(pixels.format, Format::Rgba) {
        let picture = frame(pixels, bytes)?;
        let (width, height) = (picture.width, picture.height);
        let part = Part { x: 0, y: 0, width, height };
        return Ok(Framed { picture, part, whole: (width, height), transparent: false });
    }
    check(pixels, bytes)?;
    let image = RgbaImage::from_raw(pixels.width, pixels.height, bytes.into()).context("the picture")?;
    opaque(&DynamicImage::from(image)).context("the picture is transparent everywhere: there is nothing to train on")
}
