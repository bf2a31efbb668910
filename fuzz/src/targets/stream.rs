//! Any bytes as a YUV4MPEG2 stream. The reader must refuse them, or give whole frames.
//!
//! In: bytes. Out: nothing. A header may ask for a large frame: its memory is taken, but not filled.
//! Cost: a copy of the bytes.

use keygraph::picture::Pixels;
use keygraph::yuv4mpeg::{MAX_FRAME_PIXELS, Yuv4MpegReader};

/// Runs the target on one input.
pub fn stream(data: &[u8]) {
    let mut reader = match Yuv4MpegReader::new(data) {
        Ok(reader) => reader,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    assert!(reader.fps.0 > 0 && reader.fps.1 > 0, "{:?}", reader.fps);
    while let Ok(Some(picture)) = reader.next_frame() {
        let pixels = u64::from(picture.width) * u64::from(picture.height);
        assert!(pixels > 0 && pixels <= MAX_FRAME_PIXELS);
        let (bytes, expected) = match &picture.pixels {
            Pixels::Gray8(bytes) => (bytes, pixels),
            Pixels::I420(bytes) => (bytes, pixels / 2 * 3),
            Pixels::Rgb8(bytes) => (bytes, pixels * 3),
        };
        assert_eq!(bytes.len() as u64, expected, "{} x {}", picture.width, picture.height);
    }
}
