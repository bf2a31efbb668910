//! Pictures one after the other in one stream, as `rpicam-vid --codec mjpeg` and `ffmpeg -f image2pipe` write them.
//!
//! In: bytes. Out: the bytes of one picture at a time: JPEG by its markers (ITU-T T.81, annex B), PNG by its
//! chunks (its specification, 5.3). A picture of another format is the last of its stream. Bytes between pictures are
//! passed over: cameras fill them with zeros.
//!
//! Memory: one picture of at most [`MAX_BYTES`]. Cost: a copy of the bytes.

use std::io::{BufRead, BufReader, Read};

use anyhow::{Context, Result, bail, ensure};

use crate::content::{JPEG, PNG};

/// Maximum size of a picture in a stream, bytes.
const MAX_BYTES: usize = 400_000_000;
/// Maximum number of bytes between two pictures.
const MAX_GAP: usize = 1 << 20;

/// What a picture that ends too early is called.
const CUT: &str = "the stream ends inside a picture";

/// Takes pictures off a stream.
#[derive(Debug)]
pub(crate) struct Pictures<R> {
    reader: BufReader<R>,
}

impl<R: Read> Pictures<R> {
    pub(crate) fn new(stream: R) -> Self {
        Self { reader: BufReader::new(stream) }
    }

    /// Whether nothing comes after the pictures that were read. Waits until that is known.
    pub(crate) fn is_at_end(&mut self) -> bool {
        self.reader.fill_buf().is_ok_and(<[u8]>::is_empty)
    }

    /// The bytes of the next picture; `None` at the end of the stream. Do not call this again after an
    /// error: the place in the stream is lost.
    ///
    /// # Errors
    /// When the stream cannot be read, is damaged, or ends inside the picture.
    pub(crate) fn next(&mut self) -> Result<Option<Vec<u8>>> {
        let mut picture = Vec::new();
        for _ in 0..MAX_GAP {
            let Some(first) = self.byte_or_end()? else { return Ok(None) };
            // The first byte of a picture is never 0.
            if first != 0 {
                picture.push(first);
                break;
            }
        }
        self.take(&mut picture, 2)?;
        if picture == JPEG {
            self.jpeg(&mut picture)?;
        } else if picture == PNG[..3] {
            self.png(&mut picture)?;
        } else if picture.is_empty() {
            bail!("the stream has {MAX_GAP} bytes that belong to no picture");
        } else {
            self.reader.by_ref().take(MAX_BYTES as u64).read_to_end(&mut picture).context("cannot read the picture")?;
        }
        Ok(Some(picture))
    }

    /// Reads a JPEG to its end, from behind its first three bytes.
    fn jpeg(&mut self, picture: &mut Vec<u8>) -> Result<()> {
        // The last byte that was read is FF, the first of a marker.
        loop {
            let marker = self.byte(picture)?;
            match marker {
                // End of the picture.
                0xD9 => return Ok(()),
                // Filling before a marker.
                0xFF => continue,
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
            let read = self.reader.by_ref().take((MAX_BYTES - picture.len()) as u64).read_until(0xFF, picture);
            read.context("cannot read the picture")?;
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
        let mut pictures = Pictures::new(stream);
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
        stream.extend([0; 5]);
        let found: Vec<_> = all(&stream).into_iter().map(|p| p.expect("a picture")).collect();
        assert_eq!(found, pictures);
        assert!(found.iter().all(|p| decode(p).is_ok()));
    }

    #[test]
    fn a_picture_of_another_format_takes_the_rest() {
        let found = all(b"BM and all that follows");
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].as_ref().expect("bytes"), b"BM and all that follows");
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
        let mut pictures = Pictures::new(&stream[..]);
        pictures.next().expect("reads");
        assert!(!pictures.is_at_end());
        pictures.next().expect("reads");
        assert!(pictures.is_at_end());
    }
}
