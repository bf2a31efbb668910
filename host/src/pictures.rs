//! Pictures one after the other in one stream, as `rpicam-vid --codec mjpeg` and `ffmpeg -f image2pipe` write them.
//!
//! In: bytes. Out: the bytes of one picture at a time: JPEG by its markers (ITU-T T.81, annex B), PNG by its
//! chunks (its specification, 5.3), BMP and WebP by the sizes in their headers. A picture of another format is the only
//! one of its stream. Bytes between pictures are passed over.
//!
//! Memory: one picture of at most [`MAX_BYTES`]. Cost: a copy of the bytes.

use std::io::{BufRead, BufReader, Read};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};

use crate::content::{JPEG, PNG};
use crate::ffmpeg::Patient;

/// Maximum size of a picture in a stream, bytes.
const MAX_BYTES: usize = 400_000_000;
/// Time in which the end of a stream is waited for, so that one picture is known to be the only one.
const END: Duration = Duration::from_millis(250);

/// What a picture that ends too early is called.
const CUT: &str = "the stream ends inside a picture";

/// What a picture that has no end is called.
const TOO_LARGE: &str = "a picture of the stream has more than 400 MB";

/// Takes pictures off a stream.
#[derive(Debug)]
pub(crate) struct Pictures {
    reader: BufReader<Patient>,
    /// Whether no picture was read yet.
    is_first: bool,
}

impl Pictures {
    pub(crate) fn new(stream: impl Read + Send + 'static) -> Self {
        Self { reader: BufReader::new(Patient::without_end(stream)), is_first: true }
    }

    /// Whether it is known that nothing comes after the pictures that were read. Nobody waits for the next picture
    /// of a camera.
    pub(crate) fn is_at_end(&mut self) -> bool {
        self.reader.buffer().is_empty() && self.reader.get_mut().ends_within(END)
    }

    /// The bytes of the next picture; `None` at the end of the stream. Do not call this again after an
    /// error: the place in the stream is lost.
    ///
    /// # Errors
    /// When the stream cannot be read, is damaged, or ends inside the picture.
    pub(crate) fn next(&mut self) -> Result<Option<Vec<u8>>> {
        let Some(mut picture) = self.start()? else { return Ok(None) };
        match &picture[..] {
            JPEG => self.jpeg(&mut picture)?,
            [b'B', b'M', ..] => self.sized(&mut picture, 2, 0)?,
            b"RIF" => self.sized(&mut picture, 4, 8)?,
            start if *start == PNG[..3] => self.png(&mut picture)?,
            // A picture whose end is not told in it is the only one.
            _ => {
                self.reader
                    .by_ref()
                    .take(MAX_BYTES as u64)
                    .read_to_end(&mut picture)
                    .context("cannot read the picture")?;
            }
        }
        self.is_first = false;
        Ok(Some(picture))
    }

    /// Reads the first three bytes of the next picture. Behind the first picture, bytes that start none are passed
    /// over: cameras and phones write such. `None` at the end of the stream.
    fn start(&mut self) -> Result<Option<Vec<u8>>> {
        let mut start = Vec::new();
        while let Some(byte) = self.byte_or_end()? {
            start.push(byte);
            let is_start = start == JPEG || start == PNG[..3] || start == b"RIF" || start.starts_with(b"BM");
            match start.len() {
                3 if is_start || self.is_first => return Ok(Some(start)),
                3 => drop(start.remove(0)),
                _ => {}
            }
        }
        ensure!(!self.is_first || start.is_empty(), CUT);
        Ok(None)
    }

    /// Reads a BMP or WebP to its end, from behind its first three bytes. Its size stands at byte `at`, and counts
    /// all bytes but `more`.
    fn sized(&mut self, picture: &mut Vec<u8>, at: usize, more: usize) -> Result<()> {
        self.take(picture, at + 4 - picture.len())?;
        let [.., a, b, c, d] = picture[..] else { bail!(CUT) };
        let size = (u32::from_le_bytes([a, b, c, d]) as usize).saturating_add(more);
        self.take(picture, size.saturating_sub(picture.len()))
    }

    /// Reads a JPEG to its end, from behind its first three bytes.
    fn jpeg(&mut self, picture: &mut Vec<u8>) -> Result<()> {
        // The last byte that was read is FF, the first of a marker.
        loop {
            let marker = self.byte(picture)?;
            match marker {
                // End of the picture.
                0xD9 => return Ok(()),
                // Filling before a marker: it is left out.
                0xFF => {
                    picture.pop();
                    continue;
                }
                // Markers alone, and a byte FF of the coded data.
                0x00 | 0x01 | 0xD0..=0xD8 => {}
                _ => {
                    let length = [self.byte(picture)?, self.byte(picture)?];
                    let length = usize::from(u16::from_be_bytes(length));
                    ensure!(length >= 2, "the stream is damaged: a JPEG has a segment of {length} bytes");
                    self.take(picture, length - 2)?;
                }
            }
            // Coded data goes on to the next FF.
            let read =
                self.reader.by_ref().take(MAX_BYTES.saturating_sub(picture.len()) as u64).read_until(0xFF, picture);
            read.context("cannot read the picture")?;
            ensure!(picture.len() < MAX_BYTES, TOO_LARGE);
            ensure!(picture.last() == Some(&0xFF), CUT);
        }
    }

    /// Reads a PNG to its end, from behind its first three bytes.
    fn png(&mut self, picture: &mut Vec<u8>) -> Result<()> {
        self.take(picture, PNG.len() - 3)?;
        loop {
            let start = picture.len();
            self.take(picture, 8)?;
            let [a, b, c, d, ref name @ ..] = picture[start..] else { bail!(CUT) };
            let is_last = name == b"IEND";
            // The data, and four bytes of a checksum.
            self.take(picture, u32::from_be_bytes([a, b, c, d]) as usize + 4)?;
            if is_last {
                return Ok(());
            }
        }
    }

    /// Reads `n` bytes more of a picture.
    fn take(&mut self, picture: &mut Vec<u8>, n: usize) -> Result<()> {
        ensure!(
            n <= MAX_BYTES - picture.len().min(MAX_BYTES),
            "a picture of the stream has more than {MAX_BYTES} bytes"
        );
        let read = self.reader.by_ref().take(n as u64).read_to_end(picture).context("cannot read the picture")?;
        ensure!(read == n, CUT);
        Ok(())
    }

    /// Reads one byte more of a picture.
    fn byte(&mut self, picture: &mut Vec<u8>) -> Result<u8> {
        let byte = self.byte_or_end()?.context(CUT)?;
        picture.push(byte);
        Ok(byte)
    }

    fn byte_or_end(&mut self) -> Result<Option<u8>> {
        let mut byte = [0];
        let read = self.reader.by_ref().take(1).read(&mut byte).context("cannot read the stream")?;
        Ok((read == 1).then_some(byte[0]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::decode;
    use crate::picture::tests::{jpeg, png};
    use crate::scratch::assert_says;
    use image::ExtendedColorType;

    fn all(stream: &[u8]) -> Vec<Result<Vec<u8>>> {
        let mut pictures = Pictures::new(std::io::Cursor::new(stream.to_vec()));
        let mut found = Vec::new();
        loop {
            match pictures.next() {
                Ok(None) => return found,
                Ok(Some(picture)) => found.push(Ok(picture)),
                Err(error) => {
                    found.push(Err(error));
                    return found;
                }
            }
        }
    }

    #[test]
    fn pictures_are_taken_apart() {
        let pictures = [jpeg(24), png(3, &[1, 2, 3, 4, 5, 6], ExtendedColorType::L8), jpeg(40), jpeg(8)];
        let mut stream = pictures[0].clone();
        stream.extend([0; 9]);
        stream.extend(pictures[1..].concat());
        stream.extend(b"\0\0\0\0ftyp of a motion photo\n");
        let found: Vec<_> = all(&stream).into_iter().map(|p| p.expect("a picture")).collect();
        assert_eq!(found, pictures);
        assert!(found.iter().all(|p| decode(p).is_ok()));
    }

    #[test]
    fn pictures_with_a_size_are_taken_apart_and_others_take_the_rest() {
        let image = image::RgbImage::new(5, 3);
        for format in [image::ImageFormat::Bmp, image::ImageFormat::WebP] {
            let mut file = std::io::Cursor::new(Vec::new());
            image.write_to(&mut file, format).expect("encodes");
            let one = file.into_inner();
            let found: Vec<_> = all(&[one.clone(), one.clone()].concat()).into_iter().map(Result::ok).collect();
            assert_eq!(found, [Some(one.clone()), Some(one)]);
        }
        let found = all(b"II*\0 and all that follows");
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].as_ref().expect("bytes"), b"II*\0 and all that follows");
    }

    #[test]
    fn filling_without_an_end_takes_no_memory() {
        let mut stream = jpeg(8)[..2].to_vec();
        stream.extend(std::iter::repeat_n(0xFF, 5_000_000));
        assert_says(all(&stream).pop().expect("an error"), "ends inside a picture");
        let mut picture = Vec::new();
        let mut pictures = Pictures::new(std::io::Cursor::new(stream));
        assert!(pictures.start().is_ok() && pictures.jpeg(&mut picture).is_err());
        assert!(picture.capacity() < 100, "{} bytes", picture.capacity());
    }

    #[test]
    fn a_cut_stream_is_told_wherever_it_is_cut() {
        for whole in [jpeg(24), png(3, &[1, 2, 3, 4, 5, 6], ExtendedColorType::L8)] {
            for length in 1..whole.len() {
                let found = all(&whole[..length]);
                assert_eq!(found.len(), 1, "cut at {length}");
                assert_says(found.into_iter().next().expect("one"), "ends inside a picture");
            }
        }
    }

    #[test]
    fn the_end_is_known_behind_the_last_picture() {
        let stream = [jpeg(8), jpeg(8)].concat();
        let mut pictures = Pictures::new(std::io::Cursor::new(stream));
        pictures.next().expect("reads");
        assert!(!pictures.is_at_end());
        pictures.next().expect("reads");
        assert!(pictures.is_at_end());
    }
}
