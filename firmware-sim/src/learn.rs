//! Learns an object on the board, from the middle of a frame.
//!
//! In: a raw frame with two bytes per pixel (YUYV, RGB565) and the object in its middle. Out: a
//! model. Memory: a [`Learner`]. It is needed before the detector and never beside it, so that the
//! two share their memory. The model lies in the same memory until it is written to flash. Cost:
//! the cost of training, some seconds on a Cortex-M7.

use keygraph_core::{Frame, Preset, TrainError, Trainer, chroma_bytes, luma_bytes};

use crate::wire::FrameHeader;

/// Returns the longer and the shorter side of the largest object that can be learnt, px. An object
/// of this size fits the memory that the detector uses later.
#[must_use]
pub const fn largest(qqvga: bool) -> [usize; 2] {
    if qqvga { [112, 84] } else { [240, 180] }
}

const QQVGA: bool = !cfg!(any(feature = "qvga", feature = "vga"));
const LARGEST: [usize; 2] = largest(QQVGA);
/// Maximum size of the model, bytes.
pub const MODEL_BYTES: usize = if QQVGA { 24 << 10 } else { 64 << 10 };

const PIXELS: usize = LARGEST[0] * LARGEST[1];

/// Memory for learning an object.
pub struct Learner {
    trainer: Trainer<{ luma_bytes(PIXELS) }, { chroma_bytes(PIXELS) }, { LARGEST[0] }, 640>,
    model: [u8; MODEL_BYTES],
}

impl Learner {
    /// Learns the middle `size` px of the frame in `buffer`, and returns the bytes of the model.
    /// The frame is cropped in place.
    ///
    /// # Errors
    /// Fails if training fails.
    ///
    /// # Panics
    /// Panics if the format does not have two bytes per pixel, or if `size` exceeds the frame.
    #[inline(never)]
    pub fn learn(&mut self, header: &FrameHeader, buffer: &mut [u8], size: [usize; 2]) -> Result<&[u8], TrainError> {
        let bytes = crop(header, buffer, size);
        let frame = Frame::new(header.format, size[0], size[1], &buffer[..bytes])?;
        let params = Preset::Learnt.params("learnt", false);
        let trained = self.trainer.train(&frame, (size[0] as u32, size[1] as u32), &params, &mut self.model)?;
        Ok(&self.model[..trained.bytes])
    }
}

/// Moves the middle of the frame to the start of its buffer, and returns the size of that part, bytes.
fn crop(header: &FrameHeader, buffer: &mut [u8], [cw, ch]: [usize; 2]) -> usize {
    let [w, h] = header.size.map(|v| v as usize);
    assert!(header.format.bytes(2, 1) == 4, "learning takes YUYV or RGB565");
    assert!(cw <= w && ch <= h, "the object exceeds the frame");
    // Two neighbouring pixels share chroma, so the first column must be even.
    let (x, y) = ((w - cw) / 2 & !1, (h - ch) / 2);
    for row in 0..ch {
        let from = 2 * ((y + row) * w + x);
        buffer.copy_within(from..from + 2 * cw, 2 * cw * row);
    }
    2 * cw * ch
}

#[cfg(test)]
mod tests {
    use super::*;
    use keygraph_core::PixelFormat;

    #[test]
    fn the_middle_stays() {
        // Each pixel holds its own column and row.
        let mut frame: [u8; 2 * 8 * 6] = core::array::from_fn(|i| [i / 2 % 8, i / 16][i % 2] as u8);
        let header = FrameHeader { format: PixelFormat::Rgb565, size: [8, 6] };
        assert_eq!(crop(&header, &mut frame, [4, 2]), 16);
        assert_eq!(frame[..16], [2, 2, 3, 2, 4, 2, 5, 2, 2, 3, 3, 3, 4, 3, 5, 3]);
    }
}
