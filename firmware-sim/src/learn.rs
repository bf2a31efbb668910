//! Learns an object on the board, from the middle of a frame.
//!
//! In: a raw frame with the object in its middle, of which a window is learnt. Out: a model. Memory:
//! a [`Learner`]. It is needed before the detector and never beside it, so that the two share their
//! memory. The model lies in the same memory until it is written to flash. Cost: the cost of
//! training, some seconds on a Cortex-M7.

use keygraph_core::{Preset, TrainError, Trainer, Window, chroma_bytes, luma_bytes};

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
    ///
    /// # Errors
    /// Fails if `size` exceeds the frame, or if training fails.
    #[inline(never)]
    pub fn learn(&mut self, header: &FrameHeader, buffer: &[u8], size: [usize; 2]) -> Result<&[u8], TrainError> {
        let frame = header.frame(&buffer[..header.bytes()])?.window(middle(header.size, size))?;
        let params = Preset::Learnt.params("learnt", false);
        let trained = self.trainer.train(&frame, (size[0] as u32, size[1] as u32), &params, &mut self.model)?;
        Ok(&self.model[..trained.bytes])
    }
}

/// Returns the middle of a frame. Two neighbouring pixels may share chroma, so the first column is
/// even.
fn middle(frame: [u32; 2], [width, height]: [usize; 2]) -> Window {
    let [w, h] = frame.map(|v| v as usize);
    Window { x: w.saturating_sub(width) / 2 & !1, y: h.saturating_sub(height) / 2, width, height }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_begins_at_an_even_column() {
        assert_eq!(middle([160, 120], [106, 90]), Window { x: 26, y: 15, width: 106, height: 90 });
        assert_eq!(middle([100, 100], [200, 50]), Window { x: 0, y: 25, width: 200, height: 50 });
    }
}
