//! A frame of Motion-JPEG as a JPEG that any decoder reads.
//!
//! In: the bytes of a buffer. Out: the complete JPEG in it. Cameras fill the buffer after
//! the end of the picture. Most leave out the Huffman tables, which are always those of
//! ITU-T T.81, annex K.3. When part of a frame was lost, the end of the picture is missing;
//! a decoder would return gray below the gap.
//!
//! Memory: the frame. Cost: a copy.

use std::sync::LazyLock;

use anyhow::{Context, Result, ensure};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

/// Second bytes of markers: start of the picture, end of the picture, Huffman tables, and
/// start of a scan. No tables follow after the start of a scan.
const START: u8 = 0xD8;
const END: u8 = 0xD9;
const TABLES: u8 = 0xC4;
const SCAN: u8 = 0xDA;

/// Returns the JPEG in a buffer, with Huffman tables.
///
/// # Errors
/// When the buffer does not start or end as a JPEG does.
pub fn to_jpeg(buffer: &[u8]) -> Result<Vec<u8>> {
    ensure!(buffer.starts_with(&[0xFF, START]), "a frame of {} bytes is no JPEG", buffer.len());
    let end = buffer.iter().rposition(|&b| b != 0 && b != 0xFF).map_or(0, |last| last + 1);
    let jpeg = &buffer[..end];
    ensure!(jpeg.ends_with(&[0xFF, END]), "a JPEG of {end} bytes has no end: part of the frame was lost");
    let has_tables = segments(jpeg).any(|(marker, _)| marker == TABLES);
    let tables: &[u8] = if has_tables { &[] } else { &USUAL_TABLES };
    Ok([&jpeg[..2], tables, &jpeg[2..]].concat())
}

/// The segments from the start of a JPEG to its first scan: the marker and all bytes of
/// each.
fn segments(jpeg: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    let mut rest = jpeg.get(2..).unwrap_or_default();
    std::iter::from_fn(move || {
        let &[0xFF, marker, high, low, ..] = rest else { return None };
        let (segment, after) = rest.split_at_checked(2 + usize::from(u16::from_be_bytes([high, low])))?;
        rest = if marker == SCAN { &[] } else { after };
        Some((marker, segment))
    })
}

/// The usual Huffman tables as segments. Every JPEG that the crate `image` writes has them.
static USUAL_TABLES: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut jpeg = Vec::new();
    let written = JpegEncoder::new(&mut jpeg).encode(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
    written.context("a pixel as JPEG").map_or_else(
        |error| {
            tracing::error!("{error:#}");
            Vec::new()
        },
        |()| segments(&jpeg).filter(|s| s.0 == TABLES).flat_map(|s| s.1.to_vec()).collect(),
    )
});

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Vec<u8> {
        let mut jpeg = Vec::new();
        let rgb: Vec<u8> = (0..32 * 16 * 3).map(|i| [200, 90, 20][i % 3] ^ u8::from(i % 7 < 3)).collect();
        JpegEncoder::new_with_quality(&mut jpeg, 90).encode(&rgb, 32, 16, ExtendedColorType::Rgb8).expect("encodes");
        jpeg
    }

    fn without_tables(jpeg: &[u8]) -> Vec<u8> {
        let kept = segments(jpeg).filter(|s| s.0 != TABLES).flat_map(|s| s.1.to_vec());
        let header: usize = segments(jpeg).map(|s| s.1.len()).sum();
        let kept: Vec<u8> = kept.collect();
        [&jpeg[..2], &kept, &jpeg[2 + header..]].concat()
    }

    #[test]
    fn a_jpeg_stays_as_it_is_and_what_fills_the_buffer_goes() {
        let jpeg = picture();
        assert_eq!(to_jpeg(&jpeg).expect("whole"), jpeg);
        assert_eq!(to_jpeg(&[&jpeg[..], &[0; 100], &[0xFF; 3]].concat()).expect("whole"), jpeg);
    }

    #[test]
    fn a_frame_without_tables_decodes_to_the_same_pixels() {
        let (jpeg, bare) = (picture(), without_tables(&picture()));
        assert!(bare.len() + 400 < jpeg.len(), "{} bytes with tables, {} without", jpeg.len(), bare.len());
        assert!(image::load_from_memory(&bare).is_err(), "it decodes without tables: nothing to do here");
        let pixels = |jpeg: &[u8]| image::load_from_memory(jpeg).expect("decodes").into_rgb8().into_raw();
        assert_eq!(pixels(&to_jpeg(&bare).expect("whole")), pixels(&jpeg));
    }

    #[test]
    fn what_was_cut_or_is_something_else_is_refused() {
        let jpeg = picture();
        for length in [0, 1, 2, 3, 100, jpeg.len() - 2, jpeg.len() - 1] {
            assert!(to_jpeg(&jpeg[..length]).is_err(), "{length} of {} bytes", jpeg.len());
        }
        let error = to_jpeg(&jpeg[..jpeg.len() / 2]).expect_err("half").to_string();
        assert!(error.contains("part of the frame was lost"), "{error}");
        assert!(to_jpeg(&[0; 64]).expect_err("zeros").to_string().contains("no JPEG"));
        // A segment that says it is longer than the frame.
        assert!(to_jpeg(&[0xFF, START, 0xFF, 0xE0, 0xFF, 0xFE, 1, 0xFF, END]).is_ok_and(|j| j.len() > 400));
    }
}
