//! YUV4MPEG2 streams: uncompressed video that any program can pipe into another.
//!
//! In: a line of text about the stream, then for every frame a line of text and its Y, U
//! and V planes, as the manual page yuv4mpeg(5) of mjpegtools describes. Out: [`Picture`]s.
//! Memory: one frame of at most [`MAX_FRAME_PIXELS`]. Cost: a copy of the bytes.
//!
//! The y4m crate is not used: it reports the same end for a complete stream and for one
//! that is cut off, does not name a colour space that it refuses, and multiplies the sizes
//! in the header without a check.

use std::io::{BufRead, BufReader, Read};

use anyhow::{Context, Result, anyhow, bail, ensure};

use crate::content::YUV4MPEG2_MAGIC;
use crate::ffmpeg::CROP_TO_EVEN;
use crate::picture::{Picture, Pixels};

/// Maximum number of pixels in a frame of a stream. A header that asks for more is refused
/// before memory is allocated for it.
pub const MAX_FRAME_PIXELS: u64 = 100_000_000;

/// Frames per second of a video that does not give its rate, as in ffmpeg.
pub(crate) const UNKNOWN_FPS: (u32, u32) = (25, 1);

/// Maximum length of the header line of a stream or frame, bytes.
const MAX_HEADER_BYTES: u64 = 1024;

const WANTED_STREAM: &str = "is not a YUV4MPEG2 stream; make one with \
                             `ffmpeg -i FILE -f yuv4mpegpipe -pix_fmt yuv420p -strict -1 -`";

/// Layout of the samples of a frame, 8 bits each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Chroma {
    Mono,
    C420,
    C422,
    C444,
}

/// Reads frames off a stream.
#[derive(Debug)]
pub struct Yuv4MpegReader<R> {
    reader: BufReader<R>,
    width: u32,
    height: u32,
    /// Frames per second as numerator and denominator; 25/1 if unknown.
    pub fps: (u32, u32),
    chroma: Chroma,
}

impl<R: Read> Yuv4MpegReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// When it is no header of a stream, or of one that cannot be read here.
    pub fn new(stream: R) -> Result<Self> {
        let mut reader = BufReader::new(stream);
        let Some(header) = read_header_line(&mut reader, YUV4MPEG2_MAGIC)? else {
            bail!("is empty; expected a YUV4MPEG2 stream");
        };
        let (mut width, mut height, mut fps, mut chroma) = (0, 0, None, Chroma::C420);
        for field in header.split(' ').filter(|field| !field.is_empty()) {
            let mut rest = field.chars();
            match (rest.next(), rest.as_str()) {
                (Some('W'), value) => width = parse_size(value)?,
                (Some('H'), value) => height = parse_size(value)?,
                (Some('F'), value) => fps = parse_fps(value),
                (Some('C'), value) => chroma = parse_chroma(value)?,
                // Interlacing, pixel aspect and comments do not matter here.
                _ => {}
            }
        }
        ensure!(width > 0 && height > 0, "the YUV4MPEG2 header gives no width and height");
        ensure!(
            u64::from(width) * u64::from(height) <= MAX_FRAME_PIXELS,
            "frames of {width} x {height} pixels are too large: \
             the limit is {MAX_FRAME_PIXELS} pixels"
        );
        ensure!(
            chroma == Chroma::Mono || (width % 2 == 0 && height % 2 == 0),
            "frames of {width} x {height} pixels have an odd size: \
             add `-vf \"{CROP_TO_EVEN}\"` to the ffmpeg command"
        );
        Ok(Self { reader, width, height, fps: fps.unwrap_or(UNKNOWN_FPS), chroma })
    }

    /// The next frame; `None` at the end of the stream. Do not call this again after an
    /// error: the place in the stream is lost.
    ///
    /// # Errors
    /// When the stream is damaged or ends inside the frame.
    pub fn next_frame(&mut self) -> Result<Option<Picture>> {
        if read_header_line(&mut self.reader, b"FRAME")?.is_none() {
            return Ok(None);
        }
        let (width, height) = (self.width as usize, self.height as usize);
        let luma = width * height;
        let whole = match self.chroma {
            Chroma::Mono => luma,
            Chroma::C420 => luma + luma / 2,
            Chroma::C422 => luma * 2,
            Chroma::C444 => luma * 3,
        };
        let mut planes = Vec::with_capacity(whole);
        self.reader.by_ref().take(whole as u64).read_to_end(&mut planes).context("cannot read the frame")?;
        ensure!(planes.len() == whole, "the stream ends inside the frame: {} of {whole} bytes", planes.len());
        let pixels = match self.chroma {
            Chroma::Mono => Pixels::Gray8(planes),
            Chroma::C420 => Pixels::I420(planes),
            Chroma::C422 => Pixels::I420(average_chroma(planes, luma, width / 2, 1)),
            Chroma::C444 => Pixels::I420(average_chroma(planes, luma, width, 2)),
        };
        Ok(Some(Picture { width: self.width, height: self.height, pixels }))
    }
}

/// Reads a line that starts with `magic` and returns the rest of the line. `None` when the
/// stream ends before the line begins.
fn read_header_line(reader: &mut impl BufRead, magic: &[u8]) -> Result<Option<String>> {
    let mut line = Vec::new();
    reader.take(MAX_HEADER_BYTES).read_until(b'\n', &mut line).context("cannot read the stream")?;
    if line.is_empty() {
        return Ok(None);
    }
    let Some(rest) = line.strip_prefix(magic) else {
        ensure!(magic == YUV4MPEG2_MAGIC, "the stream is damaged: no frame where one should begin");
        bail!(WANTED_STREAM);
    };
    let Some(rest) = rest.strip_suffix(b"\n") else {
        bail!("the stream ends inside a header, or the header is too long");
    };
    Ok(Some(String::from_utf8_lossy(rest).into_owned()))
}

fn parse_size(value: &str) -> Result<u32> {
    value.parse().map_err(|_| anyhow!("the YUV4MPEG2 header has a size that is no number: {value:?}"))
}

/// `None` for 0:0, which means unknown, and for what cannot be read.
fn parse_fps(value: &str) -> Option<(u32, u32)> {
    let (numerator, denominator) = value.split_once(':')?;
    let fps: (u32, u32) = (numerator.parse().ok()?, denominator.parse().ok()?);
    (fps.0 > 0 && fps.1 > 0).then_some(fps)
}

fn parse_chroma(value: &str) -> Result<Chroma> {
    match value {
        // They differ in where the colour samples lie, by half a pixel.
        "420" | "420jpeg" | "420mpeg2" | "420paldv" => Ok(Chroma::C420),
        "422" => Ok(Chroma::C422),
        "444" => Ok(Chroma::C444),
        "mono" => Ok(Chroma::Mono),
        _ => bail!(
            "the colour space C{value} is not supported: \
             add `-pix_fmt yuv420p` to the ffmpeg command for 8-bit 4:2:0"
        ),
    }
}

/// Turns 4:2:2 or 4:4:4 planes into 4:2:0: `columns` x 2 colour samples become
/// their mean. `luma` is the length of the Y plane, `width` that of a row of
/// the U and V planes as stored.
fn average_chroma(mut planes: Vec<u8>, luma: usize, width: usize, columns: usize) -> Vec<u8> {
    let mut averaged = Vec::with_capacity(luma / 2);
    // The height is even, so no pair of rows reaches from U into V.
    for rows in planes[luma..].chunks_exact(2 * width) {
        let (upper, lower) = rows.split_at(width);
        for (a, b) in upper.chunks_exact(columns).zip(lower.chunks_exact(columns)) {
            let sum: usize = a.iter().chain(b).map(|&sample| usize::from(sample)).sum();
            averaged.push(u8::try_from((sum + columns) / (2 * columns)).unwrap_or(u8::MAX));
        }
    }
    planes.truncate(luma);
    planes.extend(averaged);
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::assert_says;

    fn header(text: &str) -> Result<Yuv4MpegReader<&[u8]>> {
        Yuv4MpegReader::new(text.as_bytes())
    }

    #[test]
    fn headers_that_cannot_be_used_say_why() {
        for (text, part) in [
            ("", "is empty"),
            ("\u{89}PNG", "is not a YUV4MPEG2 stream"),
            ("YUV4MPEG2 W2 H2", "ends inside a header"),
            ("YUV4MPEG2 W2\n", "no width and height"),
            ("YUV4MPEG2 W-2 H2\n", "no number: \"-2\""),
            ("YUV4MPEG2 W60000 H60000\n", "too large"),
            ("YUV4MPEG2 W3 H2\n", "-vf \"crop=trunc(iw/2)*2:trunc(ih/2)*2\""),
            ("YUV4MPEG2 W2 H2 C420p10\n", "-pix_fmt yuv420p"),
            ("YUV4MPEG2 W2 H2 C411\n", "C411 is not supported"),
        ] {
            assert_says(header(text), part);
        }
        let long = format!("YUV4MPEG2 W2 H2 X{}\n", "x".repeat(2000));
        assert_says(header(&long), "too long");
    }

    #[test]
    fn an_unknown_frame_rate_is_25() {
        for text in ["YUV4MPEG2 W2 H2\n", "YUV4MPEG2 W2 H2 F0:0\n"] {
            assert_eq!(header(text).expect("valid").fps, (25, 1));
        }
    }
}
