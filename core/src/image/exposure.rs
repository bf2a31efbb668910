//! Brightens dark frames.
//!
//! In: some rows of luma of a frame. Out: an [`Exposure`], by which the luma of a dark frame is stretched
//! over the range of a byte. A frame in usual light keeps its bytes. In a dark frame the steps between
//! its few values become large, noise included; the pyramid's means of 2 x 2, 4 x 4 and 8 x 8 px then
//! have values between them, and less noise.
//!
//! Memory: 40 bytes of stack. Cost: one pixel in 64 is read; a dark frame is written once more.

use crate::base::pace::Pace;

/// Rows of a frame, and pixels of a row, of which one is read.
const ROWS_APART: usize = 16;
const PIXELS_APART: usize = 4;

/// A frame is dark when 99 of 100 pixels have fewer bits, and so are below 64.
const USUAL_BITS: usize = 7;

/// How the luma of a frame is stretched: what is subtracted, and the power of two by which the rest is
/// multiplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Exposure {
    floor: u8,
    shift: u8,
}

impl Exposure {
    /// Measures a frame of so many rows. `read` writes luma of a row of the frame to `row`, which is
    /// scratch memory.
    pub(crate) fn of(height: usize, row: &mut [u8], read: impl Fn(usize, &mut [u8]), pace: &mut dyn Pace) -> Self {
        let mut brightness = Brightness::NONE;
        for y in (0..height).step_by(ROWS_APART) {
            pace.goes_on();
            read(y, row);
            brightness.add(row);
        }
        brightness.exposure()
    }

    /// Stretches luma.
    pub(crate) fn apply(self, luma: &mut [u8]) {
        if self.shift > 0 {
            let most = u8::MAX >> self.shift;
            luma.iter_mut().for_each(|v| *v = v.saturating_sub(self.floor).min(most) << self.shift);
        }
    }

    /// `value` of a frame that is not dark, as it is in this frame.
    pub(crate) const fn under(self, value: i32) -> i32 {
        value >> self.shift
    }
}

/// How bright some pixels are.
pub(crate) struct Brightness {
    /// Number of pixels of each length in bits.
    lengths: [u32; 9],
    darkest: u8,
}

impl Brightness {
    pub(crate) const NONE: Self = Self { lengths: [0; 9], darkest: u8::MAX };

    /// Adds some pixels of a row.
    pub(crate) fn add(&mut self, row: &[u8]) {
        for &v in row.iter().step_by(PIXELS_APART) {
            self.lengths[length(v)] += 1;
            self.darkest = self.darkest.min(v);
        }
    }

    /// The exposure of a frame with these pixels.
    pub(crate) fn exposure(&self) -> Exposure {
        let all: u32 = self.lengths.iter().sum();
        // The bits that 99 of 100 pixels have, at most.
        let (mut bits, mut brighter) = (8, self.lengths[8]);
        while bits > 0 && 100 * brighter <= all {
            bits -= 1;
            brighter += self.lengths[bits];
        }
        if bits >= USUAL_BITS {
            return Exposure::default();
        }
        let most = u8::try_from((1u16 << bits) - 1).unwrap_or(u8::MAX);
        // As bright as the range between the darkest pixel and the most allows.
        let shift = 8 - length(most.saturating_sub(self.darkest)).max(2);
        Exposure { floor: self.darkest, shift: u8::try_from(shift).unwrap_or(0) }
    }
}

/// Number of bits of a value.
const fn length(v: u8) -> usize {
    (u8::BITS - v.leading_zeros()) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exposure_of(luma: &[u8]) -> Exposure {
        let mut brightness = Brightness::NONE;
        brightness.add(luma);
        brightness.exposure()
    }

    #[test]
    fn dark_frames_are_stretched_and_others_stay() {
        let ramp = |from: u8, to: u8| (from..to).cycle().take(4000).collect();
        let stretched = |mut luma: std::vec::Vec<u8>| {
            exposure_of(&luma).apply(&mut luma);
            (*luma.iter().min().unwrap(), *luma.iter().max().unwrap())
        };
        assert_eq!(stretched(ramp(0, 200)), (0, 199));
        assert_eq!(stretched(ramp(100, 110)), (100, 109), "bright, though flat");
        assert_eq!(stretched(ramp(0, 13)), (0, 192));
        assert_eq!(stretched(ramp(16, 31)), (0, 224), "black is 16");
        assert_eq!(stretched(std::vec![0; 4000]), (0, 0));
        assert_eq!((exposure_of(&[3; 40]).under(80), Exposure::default().under(80)), (1, 80));
    }
}
