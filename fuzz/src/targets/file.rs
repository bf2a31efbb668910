//! Any bytes as a PNG or JPEG file, and as a frame of Motion-JPEG. Both must be refused, or decode to
//! a whole picture.
//!
//! In: bytes. Out: nothing. Files that say that they hold more than [`MOST`] pixels are left out: the
//! decoder alone limits these. Cost: decoding, twice for a JPEG.

use std::io::Cursor;

use image::ImageReader;
use keygraph::camera::mjpeg::to_jpeg;
use keygraph::picture::{Pixels, decode};

/// Maximum number of pixels of a file.
const MOST: u64 = 1 << 20;

/// Runs the target on one input.
pub fn file(data: &[u8]) {
    check(data);
    if let Ok(jpeg) = to_jpeg(data) {
        assert!(jpeg.starts_with(&[0xff, 0xd8]) && jpeg.ends_with(&[0xff, 0xd9]));
        assert_eq!(to_jpeg(&jpeg).ok(), Some(jpeg.clone()), "a whole JPEG stays as it is");
        check(&jpeg);
    }
}

fn check(data: &[u8]) {
    let size = ImageReader::new(Cursor::new(data)).with_guessed_format().map(ImageReader::into_dimensions);
    if let Ok(Ok((width, height))) = size
        && u64::from(width) * u64::from(height) > MOST
    {
        return;
    }
    match decode(data) {
        Ok((picture, _)) => {
            let pixels = picture.width as usize * picture.height as usize;
            assert!(pixels > 0);
            match picture.pixels {
                Pixels::Gray8(bytes) => assert_eq!(bytes.len(), pixels),
                Pixels::Rgb8(bytes) => assert_eq!(bytes.len(), 3 * pixels),
                Pixels::I420(_) => unreachable!("files are gray or RGB"),
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
