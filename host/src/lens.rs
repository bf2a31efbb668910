//! The camera's lens, for frames of any size.
//!
//! In: a lens, and the size of the frames that it belongs to. Out: the lens for frames of another size. Memory and
//! cost: none.

use anyhow::{Result, ensure};
use keygraph_core::{Distortion, Homography, Lens};

/// The distortion of these coefficients, in OpenCV's order: 4, 5 or 8 of Brown and Conrady, or 4 of a fisheye lens.
#[must_use]
pub fn distortion(is_fisheye: bool, k: &[f32]) -> Option<Distortion> {
    match (is_fisheye, k) {
        (true, &[a, b, c, d]) => Some(Distortion::Fisheye([a, b, c, d])),
        (false, k) if matches!(k.len(), 4 | 5 | 8) => {
            let mut all = [0.0; 8];
            all[..k.len()].copy_from_slice(k);
            Some(Distortion::Brown(all))
        }
        _ => None,
    }
}

/// A lens, and the frames that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    lens: Lens,
    /// Width and height of the frames of the calibration, px, where they are known.
    size: Option<[u32; 2]>,
}

impl Optics {
    /// A lens for frames of this size, px; of any size without one.
    #[must_use]
    pub const fn new(lens: Lens, size: Option<[u32; 2]>) -> Self {
        Self { lens, size }
    }

    /// The lens for frames of this size, px.
    ///
    /// # Errors
    /// When the calibration is of frames with other proportions.
    pub fn of_size(&self, width: u32, height: u32) -> Result<Lens> {
        let Some([w, h]) = self.size.filter(|&size| size != [width, height]) else { return Ok(self.lens) };
        let [x, y] = [width as f32 / w as f32, height as f32 / h as f32];
        ensure!(
            (x / y - 1.0).abs() < 0.01,
            "--lens: the calibration is of frames of {w}x{h} px, and this one has {width}x{height}: calibrate at this size"
        );
        Ok(self.lens.mapped(&Homography::scaling([x, y])))
    }

    /// The lens, px of the frames of the calibration.
    #[must_use]
    pub const fn lens(&self) -> &Lens {
        &self.lens
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_is_scaled_to_the_frame() {
        let lens = Lens::new([500.0, 500.0, 319.5, 239.5], Distortion::None).expect("a lens");
        let optics = Optics::new(lens, Some([640, 480]));
        assert_eq!(optics.of_size(1280, 960).expect("scales").intrinsics(), [1000.0, 1000.0, 639.5, 479.5]);
        assert!(optics.of_size(1280, 720).is_err_and(|e| e.to_string().contains("calibrate at this size")));
        assert_eq!(Optics::new(lens, None).of_size(9, 5).expect("any size"), lens);
    }
}
