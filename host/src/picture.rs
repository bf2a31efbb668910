//! A picture, and how it is read from a file.
//!
//! In: a PNG, JPEG, WebP, BMP, TIFF or GIF file, or an AVIF or HEIC file by way of ffmpeg. Out: its pixels, upright,
//! 8 bits a sample, gray or RGB. Of several pictures in a file the first is read.
//! Memory: the file and the decoded picture. A picture that would need too much is refused
//! before it is decoded.

use std::io::{self, Cursor, Read, Write};
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, anyhow, bail, ensure};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

/// Maximum number of pixels of a picture that is read from a file.
const MOST_PIXELS: u64 = 100_000_000;
/// Maximum size of a decoded picture, bytes a pixel of the maximum: 8 bits of red, green, blue
/// and opacity. A picture of 16 bits a sample can have half of the pixels.
const PIXEL_BYTES: u64 = 4;

use crate::content::Content;
pub use crate::content::extension;
use crate::ffmpeg::{Ffmpeg, picture_arguments};
use crate::file::read_whole;
use crate::unfinished::temporary;

/// Pixels in rows from the top, without padding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Red, green, blue: 3 bytes per pixel.
    Rgb8(Vec<u8>),
    /// Luminance: 1 byte per pixel.
    Gray8(Vec<u8>),
    /// The Y plane, then the U and V planes of half the width and height.
    /// Width and height are even.
    I420(Vec<u8>),
}

/// A decoded picture or video frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// The pixels; their number is width x height.
    pub pixels: Pixels,
}

/// Mirrors rows of `width` px of `N` bytes each left to right.
pub fn mirror_rows<const N: usize>(bytes: &mut [u8], width: usize) {
    bytes.chunks_exact_mut(N * width).for_each(|row| row.as_chunks_mut::<N>().0.reverse());
}

impl Picture {
    /// Mirrors the picture left to right.
    pub fn mirror(&mut self) {
        let (w, n) = (self.width as usize, self.width as usize * self.height as usize);
        match &mut self.pixels {
            Pixels::Rgb8(rgb) => mirror_rows::<3>(rgb, w),
            Pixels::Gray8(gray) => mirror_rows::<1>(gray, w),
            Pixels::I420(planes) => {
                let (luma, chroma) = planes.split_at_mut(n);
                mirror_rows::<1>(luma, w);
                mirror_rows::<1>(chroma, w / 2);
            }
        }
    }

    /// A copy of a part of the picture, which must lie within it. With [`Pixels::I420`], the part has
    /// even places and sides.
    #[must_use]
    pub fn cut(&self, part: Part) -> Self {
        let size = (self.width as usize, self.height as usize);
        let of = [part.x, part.y, part.width, part.height].map(|v| v as usize);
        let pixels = match &self.pixels {
            Pixels::Rgb8(rgb) => Pixels::Rgb8(cut::<3>(rgb, size.0, of)),
            Pixels::Gray8(gray) => Pixels::Gray8(cut::<1>(gray, size.0, of)),
            Pixels::I420(planes) => {
                let (luma, chroma) = planes.split_at(size.0 * size.1);
                let halves = of.map(|v| v / 2);
                let mut bytes = cut::<1>(luma, size.0, of);
                for plane in chroma.chunks_exact(size.0 * size.1 / 4) {
                    bytes.extend(cut::<1>(plane, size.0 / 2, halves));
                }
                Pixels::I420(bytes)
            }
        };
        Self { width: part.width, height: part.height, pixels }
    }
}

/// The pixels of a part of a plane with `N` bytes a pixel and rows of `row` pixels.
fn cut<const N: usize>(plane: &[u8], row: usize, [x, y, width, height]: [usize; 4]) -> Vec<u8> {
    let start = |y: usize| N * (y * row + x);
    (y..y + height).flat_map(|y| &plane[start(y)..][..N * width]).copied().collect()
}

/// An upright rectangle of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Leftmost column, px.
    pub x: u32,
    /// Topmost row, px.
    pub y: u32,
    /// Columns, px.
    pub width: u32,
    /// Rows, px.
    pub height: u32,
}

impl Part {
    /// Whether the whole part lies in a picture of this size, px.
    fn lies_in(&self, width: u32, height: u32) -> bool {
        let end = |start: u32, length: u32| u64::from(start) + u64::from(length);
        end(self.x, self.width) <= u64::from(width) && end(self.y, self.height) <= u64::from(height)
    }
}

impl FromStr for Part {
    type Err = String;

    /// Reads a part from `x,y,width,height`, px.
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<u32>, _> = text.split(',').map(|n| n.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Self { x, y, width, height }),
            _ => Err("give four whole numbers of pixels, the last two above 0: x,y,width,height".into()),
        }
    }
}

/// The part of a picture that shows an object.
#[derive(Clone, Debug)]
pub struct Framed {
    /// The part, as a picture of its own.
    pub picture: Picture,
    /// Where the part lies in the upright picture of the file.
    pub part: Part,
    /// Width and height of the upright picture of the file, px.
    pub whole: (u32, u32),
    /// Whether a pixel of the part is not fully opaque, so that white was mixed in.
    pub transparent: bool,
}

/// Extensions of the pictures that can be written.
pub const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Decodes the file of a picture. The picture is turned upright as its EXIF orientation
/// says, mixed with white where it is transparent, and has 8 bits a sample.
///
/// # Errors
/// When the file is missing, no picture that can be read, damaged or cut off. The message
/// names the path.
pub fn read_picture(path: &Path) -> Result<Picture> {
    Ok(flatten_onto_white(open_upright(path)?).0)
}

/// Reads the part `crop` (px of the upright picture) of a picture's file. Without
/// `crop`, reads the smallest part that holds all pixels that are at least half opaque.
///
/// # Errors
/// When the file cannot be read, see [`read_picture`]; when `crop` reaches beyond the
/// picture; when no pixel is at least half opaque.
pub fn read_framed(path: &Path, crop: Option<Part>) -> Result<Framed> {
    let name = path.display();
    let image = open_upright(path)?;
    let whole = (image.width(), image.height());
    let part = match crop {
        Some(part) => {
            ensure!(
                part.lies_in(whole.0, whole.1),
                "the part {},{},{},{} reaches beyond {name}, which has {}x{} px when upright",
                part.x,
                part.y,
                part.width,
                part.height,
                whole.0,
                whole.1
            );
            part
        }
        None => opaque_part(&image)
            .with_context(|| format!("{name} is transparent everywhere: there is nothing to train on"))?,
    };
    Ok(framed(&image, part))
}

/// The smallest part of a decoded picture that holds all pixels that are at least half opaque; `None`
/// when there are none.
#[must_use]
pub fn opaque(image: &DynamicImage) -> Option<Framed> {
    opaque_part(image).map(|part| framed(image, part))
}

/// A part of a decoded picture, as a picture of its own.
fn framed(image: &DynamicImage, part: Part) -> Framed {
    let shown = image.crop_imm(part.x, part.y, part.width, part.height);
    let (picture, transparent) = flatten_onto_white(shown);
    Framed { picture, part, whole: (image.width(), image.height()), transparent }
}

/// The smallest part that holds all pixels that are at least half opaque. A soft shadow
/// is less opaque: it does not belong to the object.
fn opaque_part(image: &DynamicImage) -> Option<Part> {
    let (width, height) = (image.width(), image.height());
    if !image.color().has_alpha() {
        return Some(Part { x: 0, y: 0, width, height });
    }
    let mut bounds = None;
    for (x, y, pixel) in image.to_luma_alpha8().enumerate_pixels() {
        if pixel.0[1] >= 128 {
            let (left, top, right, bottom) = bounds.unwrap_or((x, y, x, y));
            bounds = Some((x.min(left), top, x.max(right), bottom.max(y)));
        }
    }
    bounds.map(|(x, y, right, bottom)| Part { x, y, width: right - x + 1, height: bottom - y + 1 })
}

/// Decodes the file of a picture and turns it upright.
fn open_upright(path: &Path) -> Result<DynamicImage> {
    let name = path.display();
    let bytes = read_whole(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => anyhow!("{name}: no such file"),
        // The cause stays: it may be one that passes.
        _ => anyhow::Error::new(error).context(format!("{name}: cannot be read")),
    })?;
    let foreign = || decode_upright(&by_ffmpeg(&bytes)?, MOST_PIXELS);
    let decoded = match Content::told_by(&bytes) {
        Content::Foreign => foreign(),
        // TIFF has more kinds than one decoder knows.
        Content::Picture if bytes.starts_with(b"II") || bytes.starts_with(b"MM") => {
            decode_upright(&bytes, MOST_PIXELS).or_else(|error| foreign().map_err(|_| error))
        }
        _ => decode_upright(&bytes, MOST_PIXELS),
    };
    decoded.with_context(|| name.to_string())
}

/// A picture that ffmpeg decodes, as a PNG.
pub(crate) fn by_ffmpeg(bytes: &[u8]) -> Result<Vec<u8>> {
    // A pipe cannot be read a second time, and ffmpeg must go back and forth in the file.
    let mut file = temporary().context("cannot be kept in a temporary file")?;
    file.write_all(bytes).context("cannot be kept in a temporary file")?;
    let mut png = Vec::new();
    let mut ffmpeg =
        Ffmpeg::start(&picture_arguments(file.path())).context("AVIF and HEIC pictures are read by ffmpeg")?;
    if let Some(output) = ffmpeg.output.take() {
        output.take(MOST_PIXELS * PIXEL_BYTES).read_to_end(&mut png).context("cannot read what ffmpeg decodes")?;
    }
    let old = "this ffmpeg may not know the format: AVIF needs ffmpeg 5.1, HEIC 7.1; or convert it to PNG or JPEG";
    ffmpeg.finish().context(old)?;
    ensure!(!png.is_empty(), old);
    Ok(png)
}

/// Decodes a picture that somebody sent, of at most `most` pixels, and turns it upright. No other
/// program takes part.
///
/// # Errors
/// When the bytes are no PNG, JPEG, WebP, BMP, TIFF or GIF picture, too large, damaged or cut off.
pub fn decode_sent(bytes: &[u8], most: u64) -> Result<DynamicImage> {
    ensure!(
        matches!(Content::told_by(bytes), Content::Picture) || bytes.starts_with(b"GIF8"),
        "this is no picture that can be learned: send a PNG, JPEG, WebP, BMP, TIFF or GIF picture"
    );
    decode_upright(bytes, most)
}

/// What a decoder may use for a picture of at most `most` pixels.
fn limits(most: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(most * PIXEL_BYTES);
    limits
}

/// Refuses a picture that is too large, by its header.
fn check_size(decoder: &impl ImageDecoder, most: u64) -> Result<()> {
    let (width, height) = decoder.dimensions();
    ensure!(
        u64::from(width) * u64::from(height) <= most && decoder.total_bytes() <= most * PIXEL_BYTES,
        "the picture is too large: it has {width}x{height} px ({} MB), and at most {} megapixels ({} MB) are read; make it smaller first",
        decoder.total_bytes() / 1_000_000,
        most as f64 / 1e6,
        most * PIXEL_BYTES / 1_000_000
    );
    Ok(())
}

/// Decodes the bytes of a picture's file. The flag is true when any pixel was not fully opaque.
///
/// # Errors
/// When the bytes are no PNG, JPEG, WebP, BMP, TIFF or GIF picture, too large, damaged or cut off.
pub fn decode(bytes: &[u8]) -> Result<(Picture, bool)> {
    decode_upright(bytes, MOST_PIXELS).map(flatten_onto_white)
}

fn decode_upright(bytes: &[u8], most: u64) -> Result<DynamicImage> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().context("cannot be read")?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::WebP | ImageFormat::Bmp | ImageFormat::Tiff | ImageFormat::Gif) => {}
        // The decoder fills the rest of a JPEG that is cut off with grey, without an error.
        Some(ImageFormat::Jpeg) => ensure!(jpeg_is_complete(bytes), "the JPEG picture is cut off before its end"),
        _ if bytes.is_empty() => bail!("the file is empty"),
        _ => bail!("is not a PNG, JPEG, WebP, BMP, TIFF, GIF, AVIF or HEIC picture"),
    }
    let damaged = "the picture cannot be decoded; it may be damaged or cut off";
    reader.limits(limits(most));
    let mut decoder = reader.into_decoder().context(damaged)?;
    check_size(&decoder, most)?;
    // A damaged orientation does not make the picture useless.
    let orientation = decoder.orientation();
    let mut image = DynamicImage::from_decoder(decoder).context(damaged)?;
    if let Ok(orientation) = orientation {
        image.apply_orientation(orientation);
    }
    Ok(image)
}

/// Whether a JPEG has its end-of-image marker. Walks the segments; a marker inside of a
/// segment, such as a thumbnail's, does not count.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    const END_OF_IMAGE: u8 = 0xD9;
    let mut at = 2;
    loop {
        // In entropy-coded data, FF stands before 00 or D0..D7 only.
        let Some(&[first, marker]) = bytes.get(at..at + 2) else {
            return false;
        };
        match (first, marker) {
            (0xFF, END_OF_IMAGE) => return true,
            (0xFF, 0x00 | 0x01 | 0xD0..=0xD8) => at += 2,
            (0xFF, 0xFF) => at += 1,
            (0xFF, _) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else {
                    return false;
                };
                at += 2 + usize::from(u16::from_be_bytes([high, low]));
            }
            _ => at += 1,
        }
    }
}

/// Converts an image to 8-bit gray or RGB, with transparent pixels mixed with white. The
/// flag is true when any pixel was not fully opaque.
#[must_use]
pub fn flatten_onto_white(image: DynamicImage) -> (Picture, bool) {
    let (width, height) = (image.width(), image.height());
    let gray = !image.color().has_color();
    let mut transparent = false;
    let mut mix = |sample: u8, alpha: u8| {
        transparent |= alpha != u8::MAX;
        over_white(sample, alpha)
    };
    let pixels = match (gray, image.color().has_alpha()) {
        (true, false) => Pixels::Gray8(image.into_luma8().into_raw()),
        (false, false) => Pixels::Rgb8(image.into_rgb8().into_raw()),
        (true, true) => {
            let image = image.into_luma_alpha8();
            Pixels::Gray8(image.pixels().map(|p| mix(p.0[0], p.0[1])).collect())
        }
        (false, true) => {
            let image = image.into_rgba8();
            // The room is taken once: a vector that grows takes up to three times as much.
            let mut rgb = Vec::with_capacity(3 * width as usize * height as usize);
            for &image::Rgba([r, g, b, alpha]) in image.pixels() {
                rgb.extend([r, g, b].map(|sample| mix(sample, alpha)));
            }
            Pixels::Rgb8(rgb)
        }
    };
    let picture = Picture { width, height, pixels };
    (picture, transparent)
}

fn over_white(sample: u8, alpha: u8) -> u8 {
    let (sample, alpha) = (u16::from(sample), u16::from(alpha));
    let mixed = (sample * alpha + 255 * (255 - alpha) + 127) / 255;
    u8::try_from(mixed).unwrap_or(u8::MAX)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::scratch::assert_says;
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    pub(crate) fn png(width: u32, samples: &[u8], colour: ExtendedColorType) -> Vec<u8> {
        let bytes = width as usize * usize::from(colour.bits_per_pixel()) / 8;
        let height = u32::try_from(samples.len() / bytes).expect("small");
        let mut file = Vec::new();
        PngEncoder::new(&mut file).write_image(samples, width, height, colour).expect("encodes");
        file
    }

    pub(crate) fn jpeg(side: u32) -> Vec<u8> {
        let samples: Vec<u8> = (0..side * side * 3).map(|i| (i * 7 % 251) as u8).collect();
        let mut file = Vec::new();
        JpegEncoder::new(&mut file).encode(&samples, side, side, ExtendedColorType::Rgb8).expect("encodes");
        file
    }

    #[test]
    fn gray_stays_gray_and_colour_stays_colour() {
        let (gray, _) = decode(&png(2, &[1, 2, 3, 4], ExtendedColorType::L8)).expect("gray");
        assert_eq!(gray.pixels, Pixels::Gray8(vec![1, 2, 3, 4]));
        assert_eq!((gray.width, gray.height), (2, 2));
        let (rgb, _) = decode(&png(1, &[1, 2, 3], ExtendedColorType::Rgb8)).expect("rgb");
        assert_eq!(rgb.pixels, Pixels::Rgb8(vec![1, 2, 3]));
    }

    #[test]
    fn every_format_is_read() {
        let samples: Vec<u8> = (0..48).map(|i| i * 5).collect();
        let image = image::RgbImage::from_raw(4, 4, samples.clone()).expect("16 pixels");
        for format in [ImageFormat::Png, ImageFormat::WebP, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Gif] {
            let mut file = Cursor::new(Vec::new());
            image.write_to(&mut file, format).expect("encodes");
            let (picture, transparent) = decode(&file.into_inner()).expect("decodes");
            // 16 colours fit a palette.
            assert_eq!((picture.pixels, transparent), (Pixels::Rgb8(samples.clone()), false), "{format:?}");
        }
    }

    #[test]
    fn a_part_is_cut_out_of_every_plane() {
        let part = Part { x: 2, y: 2, width: 2, height: 2 };
        let cut = |pixels| Picture { width: 6, height: 4, pixels }.cut(part).pixels;
        let bytes = |n: u8| (0..n).collect::<Vec<u8>>();
        assert_eq!(cut(Pixels::Gray8(bytes(24))), Pixels::Gray8(vec![14, 15, 20, 21]));
        let rgb = [42, 43, 44, 45, 46, 47, 60, 61, 62, 63, 64, 65];
        assert_eq!(cut(Pixels::Rgb8(bytes(72))), Pixels::Rgb8(rgb.to_vec()));
        assert_eq!(cut(Pixels::I420(bytes(36))), Pixels::I420(vec![14, 15, 20, 21, 28, 34]));
    }

    #[test]
    fn sixteen_bits_become_eight() {
        let samples: Vec<u8> = [0_u16, 0x8080, 0xFFFF].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let (gray, _) = decode(&png(3, &samples, ExtendedColorType::L16)).expect("16 bits");
        assert_eq!(gray.pixels, Pixels::Gray8(vec![0, 0x80, 0xFF]));
    }

    #[test]
    fn transparency_is_mixed_with_white_and_told() {
        let samples = [10, 20, 30, 255, 10, 20, 30, 0, 0, 0, 0, 128];
        let (picture, transparent) = decode(&png(3, &samples, ExtendedColorType::Rgba8)).expect("rgba");
        let expected = vec![10, 20, 30, 255, 255, 255, 127, 127, 127];
        assert_eq!(picture.pixels, Pixels::Rgb8(expected));
        assert!(transparent);
        let (picture, transparent) = decode(&png(1, &[9, 255], ExtendedColorType::La8)).expect("la");
        assert_eq!(picture.pixels, Pixels::Gray8(vec![9]));
        assert!(!transparent, "an alpha channel of 255 is opaque");
    }

    #[test]
    fn the_opaque_part_is_the_smallest() {
        // 4 x 3 px; only the middle two of the second row count.
        let mut samples = [7, 0].repeat(12);
        for (at, alpha) in [(1, 127), (5, 255), (6, 128)] {
            samples[2 * at + 1] = alpha;
        }
        let image = decode_upright(&png(4, &samples, ExtendedColorType::La8), MOST_PIXELS).expect("decodes");
        assert_eq!(opaque_part(&image), Some(Part { x: 1, y: 1, width: 2, height: 1 }));
        let nothing = decode_upright(&png(2, &[9, 0, 9, 0], ExtendedColorType::La8), MOST_PIXELS).expect("decodes");
        assert_eq!(opaque_part(&nothing), None);
        let opaque = decode_upright(&png(2, &[1, 2, 3, 4], ExtendedColorType::L8), MOST_PIXELS).expect("decodes");
        assert_eq!(opaque_part(&opaque), Some(Part { x: 0, y: 0, width: 2, height: 2 }));
    }

    #[test]
    fn parts_are_four_whole_numbers() {
        assert_eq!("1, 2,3,4".parse(), Ok(Part { x: 1, y: 2, width: 3, height: 4 }));
        for text in ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,0", "-1,2,3,4", "1.5,2,3,4"] {
            assert!(text.parse::<Part>().is_err_and(|e| e.contains("x,y,width,height")), "{text:?}");
        }
        let last = Part { x: 2, y: 1, width: 1, height: 1 };
        assert!(last.lies_in(3, 2) && !last.lies_in(2, 2) && !last.lies_in(3, 1));
        assert!(!Part { x: u32::MAX, width: u32::MAX, ..last }.lies_in(9, 9));
    }

    #[test]
    fn exif_orientation_is_applied() {
        // One entry: tag 0x0112 (orientation), type short, count 1, value 6:
        // the first row is the right side.
        let mut exif = b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0".to_vec();
        exif.extend([0; 4]);
        let mut file = Vec::new();
        let mut encoder = PngEncoder::new(&mut file);
        encoder.set_exif_metadata(exif).expect("takes exif");
        encoder.write_image(&[1, 2, 3, 4, 5, 6], 3, 2, ExtendedColorType::L8).expect("encodes");
        let (picture, _) = decode(&file).expect("decodes");
        assert_eq!((picture.width, picture.height), (2, 3));
        assert_eq!(picture.pixels, Pixels::Gray8(vec![4, 1, 5, 2, 6, 3]));
    }

    #[test]
    fn a_jpeg_cut_anywhere_is_refused() {
        let whole = jpeg(24);
        assert!(decode(&whole).is_ok());
        for length in 3..whole.len() {
            assert!(decode(&whole[..length]).is_err(), "cut at {length}");
        }
        assert_says(decode(&whole[..whole.len() / 2]), "cut off");
    }

    #[test]
    fn large_pictures_are_refused_by_their_header() {
        // The header is all that is read: 30000 x 30000 px of gray, and 8000 x 8000 px of 16 bits.
        let header = |side: u32, depth: u8, colour: u8| {
            let mut chunk = b"IHDR".to_vec();
            chunk.extend([side.to_be_bytes(), side.to_be_bytes()].as_flattened());
            chunk.extend([depth, colour, 0, 0, 0]);
            let mut file = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
            file.extend(&chunk);
            file.extend(crc(&chunk).to_be_bytes());
            file.extend(b"\0\0\0\0IDAT");
            file.extend(crc(b"IDAT").to_be_bytes());
            file
        };
        assert_says(decode(&header(30_000, 8, 0)), "30000x30000 px");
        assert_says(decode(&header(8_000, 16, 6)), "at most 100 megapixels (400 MB)");
        assert_says(decode(&header(100, 8, 0)), "cannot be decoded");
        assert_says(decode_sent(&jpeg(24), 500), "24x24 px");
        assert!(decode_sent(&jpeg(24), 576).is_ok());
        for wrong in [&b""[..], b"no picture", b"\0\0\0\x1cftypavif\0\0\0\0"] {
            assert_says(decode_sent(wrong, 576), "no picture that can be learned");
        }
    }

    /// The checksum of a chunk of a PNG (its specification, appendix D).
    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
        })
    }

    #[test]
    fn a_cut_png_and_what_is_no_picture_are_refused() {
        let whole = png(20, &[7; 400], ExtendedColorType::L8);
        assert_says(decode(&whole[..whole.len() / 2]), "cut off");
        assert_says(decode(b"hello"), "is not a PNG, JPEG");
        assert_says(decode(b""), "the file is empty");
        assert_says(read_picture(Path::new("/no/such.png")), "/no/such.png: no such file");
    }
}
