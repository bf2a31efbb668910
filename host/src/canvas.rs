//! A picture to draw on.
//!
//! In: a [`Picture`] in any pixel format. Out: a [`Canvas`] of RGB bytes, which is an
//! embedded-graphics draw target and can be saved as PNG or JPEG. Memory: 3 bytes a
//! pixel. Cost: one pass over the pixels to make the canvas.

use std::convert::Infallible;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Result, bail};
use embedded_graphics::Pixel;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::Rectangle;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageResult};

use crate::output::write_file;
use crate::picture::{Picture, Pixels, extension};

const JPEG_QUALITY: u8 = 92;

/// A picture to draw on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    width: u32,
    height: u32,
    /// 3 x `width` x `height` bytes, rows from the top.
    rgb: Vec<u8>,
}

impl Canvas {
    /// Copies a picture. Bytes that are missing at its end become black.
    #[must_use]
    pub fn from_picture(picture: &Picture) -> Self {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let mut rgb = match &picture.pixels {
            Pixels::Rgb8(rgb) => rgb.clone(),
            Pixels::Gray8(gray) => gray.iter().flat_map(|&y| [y, y, y]).collect(),
            Pixels::I420(planes) => i420_to_rgb(planes, width, height),
        };
        rgb.resize(3 * width * height, 0);
        Self { width: picture.width, height: picture.height, rgb }
    }

    /// A white canvas.
    #[must_use]
    pub fn plain(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![255; 3 * width as usize * height as usize] }
    }

    /// A gray copy of half the contrast, on which colours stand out.
    #[must_use]
    pub fn dimmed(&self) -> Self {
        let gray = |p: &[u8; 3]| {
            [40 + (u8::try_from((u16::from(p[0]) + 2 * u16::from(p[1]) + u16::from(p[2])) / 4).unwrap_or(255) / 2); 3]
        };
        Self { rgb: self.rgb.as_chunks::<3>().0.iter().flat_map(gray).collect(), ..*self }
    }

    /// The pixels, in rows from the top.
    pub(crate) fn pixels_mut(&mut self) -> &mut [[u8; 3]] {
        self.rgb.as_chunks_mut().0
    }

    /// Copies a canvas that is not higher into this one, from column `left` on. What does not fit is left out.
    pub(crate) fn paste(&mut self, part: &Self, left: u32) {
        let width = part.width.min(self.width.saturating_sub(left));
        for y in 0..part.height.min(self.height) {
            let from = 3 * (y as usize * part.width as usize);
            self.row_mut(left..left + width, y).copy_from_slice(&part.rgb[from..from + 3 * width as usize]);
        }
    }

    /// Pixels per row.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Number of rows.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels: red, green and blue bytes, in rows from the top.
    #[must_use]
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// Saves the canvas as PNG or JPEG; the extension of `path` chooses.
    ///
    /// # Errors
    /// When the extension is neither, or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        match extension(path).as_str() {
            "png" => self.save_png(path),
            "jpg" | "jpeg" => self.write(path, |file| {
                JpegEncoder::new_with_quality(file, JPEG_QUALITY).encode(
                    &self.rgb,
                    self.width,
                    self.height,
                    ExtendedColorType::Rgb8,
                )
            }),
            _ => bail!("cannot save {}: its name must end with .png, .jpg or .jpeg", path.display()),
        }
    }

    /// Saves the canvas as PNG; the extension of `path` does not matter.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save_png(&self, path: &Path) -> Result<()> {
        self.write(path, |file| {
            PngEncoder::new(file).write_image(&self.rgb, self.width, self.height, ExtendedColorType::Rgb8)
        })
    }

    fn write(&self, path: &Path, encode: impl FnOnce(&mut BufWriter<&mut File>) -> ImageResult<()>) -> Result<()> {
        write_file(path, |file| {
            let mut buffered = BufWriter::new(file);
            encode(&mut buffered)?;
            Ok(buffered.flush()?)
        })
    }

    /// The longer of width and height, px.
    pub(crate) fn longer_side(&self) -> u32 {
        self.width.max(self.height)
    }

    /// The bytes of the pixels `x` in row `y`.
    fn row_mut(&mut self, x: Range<u32>, y: u32) -> &mut [u8] {
        let pixel = |x: u32| 3 * (y as usize * self.width as usize + x as usize);
        let (start, end) = (pixel(x.start), pixel(x.end));
        &mut self.rgb[start..end]
    }
}

/// Converts I420 to RGB by ITU-R BT.601 in steps of 1/256; luma has the limited range
/// of video, 16 to 235. Bytes that `planes` lacks count as 128.
pub(crate) fn i420_to_rgb(planes: &[u8], width: usize, height: usize) -> Vec<u8> {
    let (luma, half) = (width * height, width / 2);
    let sample = |at: usize| i32::from(planes.get(at).copied().unwrap_or(128));
    let mut rgb = Vec::with_capacity(3 * luma);
    for y in 0..height {
        for x in 0..width {
            let chroma = luma + (y / 2) * half + x / 2;
            let c = 298 * (sample(y * width + x) - 16) + 128;
            let u = sample(chroma) - 128;
            let v = sample(chroma + luma / 4) - 128;
            for value in [c + 409 * v, c - 100 * u - 208 * v, c + 516 * u] {
                rgb.push(u8::try_from((value >> 8).clamp(0, 255)).unwrap_or(0));
            }
        }
    }
    rgb
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = Pixel<Rgb888>>,
    {
        for Pixel(Point { x, y }, colour) in pixels {
            if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
                && x < self.width
                && y < self.height
            {
                self.row_mut(x..x + 1, y).copy_from_slice(&[colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }

    fn fill_solid(&mut self, area: &Rectangle, colour: Rgb888) -> Result<(), Infallible> {
        let area = area.intersection(&self.bounding_box());
        let (Ok(left), Ok(top)) = (u32::try_from(area.top_left.x), u32::try_from(area.top_left.y)) else {
            return Ok(());
        };
        for y in top..top + area.size.height {
            for pixel in self.row_mut(left..left + area.size.width, y).chunks_exact_mut(3) {
                pixel.copy_from_slice(&[colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::read_picture;
    use crate::scratch::Folder;

    #[test]
    fn video_colours_become_rgb() {
        // Black, white, and the red of BT.601 bars: 81, 90, 240.
        for ([y, u, v], expected) in
            [([16, 128, 128], [0, 0, 0]), ([235, 128, 128], [255, 255, 255]), ([81, 90, 240], [255, 0, 0])]
        {
            let picture = Picture { width: 2, height: 2, pixels: Pixels::I420(vec![y, y, y, y, u, v]) };
            let canvas = Canvas::from_picture(&picture);
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let close = |(a, b): (u8, u8)| a.abs_diff(b) <= 1;
                let at = 3 * (y * canvas.width + x) as usize;
                let actual = [canvas.rgb[at], canvas.rgb[at + 1], canvas.rgb[at + 2]];
                assert!(actual.into_iter().zip(expected).all(close), "{actual:?} {expected:?}");
            }
        }
    }

    #[test]
    fn missing_bytes_are_black() {
        for pixels in [Pixels::Rgb8(vec![]), Pixels::Gray8(vec![9]), Pixels::I420(vec![])] {
            let canvas = Canvas::from_picture(&Picture { width: 4, height: 2, pixels });
            assert_eq!(canvas.rgb().len(), 4 * 2 * 3);
        }
    }

    #[test]
    fn a_saved_picture_is_read_back() {
        let folder = Folder::new("saved");
        let mut canvas =
            Canvas::from_picture(&Picture { width: 40, height: 30, pixels: Pixels::Gray8(vec![200; 1200]) });
        let Ok(()) = canvas.fill_solid(&Rectangle::new(Point::new(17, 12), Size::new(6, 6)), Rgb888::RED);
        for name in ["a.png", "a.JPG"] {
            let path = folder.0.join(name);
            canvas.save(&path).expect("saves");
            let picture = read_picture(&path).expect("reads");
            assert_eq!((picture.width, picture.height), (40, 30));
        }
        let png = read_picture(&folder.0.join("a.png")).expect("reads");
        assert_eq!(Canvas::from_picture(&png), canvas);
        let error = canvas.save(&folder.0.join("a.bmp")).expect_err("no bmp");
        assert!(error.to_string().contains("must end with .png"), "{error}");
    }
}
