//! Lenses: from the px of an ideal camera, whose straight lines are straight, to those of a real one.
//!
//! In: a camera's intrinsics and the coefficients of its lens, as OpenCV's calibration gives them. Out: where a
//! place of the ideal frame is in the real frame, and back. Both frames have the same intrinsics; px centres
//! lie at integers.
//!
//! A lens of Brown and Conrady moves a place at the distance r of the axis (of depth 1) along the radius by the
//! factor (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), and a little across it (p1, p2). A
//! fisheye lens, of Kannala and Brandt, shows what comes at the angle t from the axis at the distance
//! t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8).
//!
//! Memory: 64 bytes. Cost: some 30 operations for a place, ten times as many back.

use crate::base::geometry::Homography;
use crate::base::math;
use crate::base::says::says;

/// What bends the rays.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Distortion {
    /// Nothing.
    None,
    /// Coefficients in OpenCV's order: `k1 k2 p1 p2 k3 k4 k5 k6`.
    Brown([f32; 8]),
    /// Coefficients of OpenCV's fisheye model: `k1 k2 k3 k4`.
    Fisheye([f32; 4]),
}

/// The reason why there is no such lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LensError {
    /// A focal length is zero, or a number is not finite.
    Numbers,
}

says!(LensError { Self::Numbers => ("a lens has finite numbers, and focal lengths other than 0: calibrate the camera") });

/// A camera with a lens. All its numbers but the coefficients are in px of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lens {
    focal: [f32; 2],
    centre: [f32; 2],
    distortion: Distortion,
}

/// Maximum number of steps back through a lens; and the distance of the axis, at depth 1, beyond which nothing is
/// looked for: 84 degrees.
const STEPS: usize = 20;
const FARTHEST: f32 = 9.5;

impl Lens {
    /// A camera with the focal lengths `fx` and `fy`, the principal point `(cx, cy)`, all px, and this distortion.
    ///
    /// # Errors
    /// [`LensError::Numbers`].
    pub fn new([fx, fy, cx, cy]: [f32; 4], distortion: Distortion) -> Result<Self, LensError> {
        let of_lens: &[f32] = match &distortion {
            Distortion::None => &[],
            Distortion::Brown(k) => k,
            Distortion::Fisheye(k) => k,
        };
        let is_finite = [fx, fy, cx, cy].iter().chain(of_lens).all(|v| v.is_finite());
        let valid = is_finite && fx != 0.0 && fy != 0.0;
        valid.then_some(Self { focal: [fx, fy], centre: [cx, cy], distortion }).ok_or(LensError::Numbers)
    }

    /// Focal lengths and principal point, px: `fx fy cx cy`.
    #[must_use]
    pub const fn intrinsics(&self) -> [f32; 4] {
        [self.focal[0], self.focal[1], self.centre[0], self.centre[1]]
    }

    /// What bends the rays.
    #[must_use]
    pub const fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// The same lens over px that `map` makes of its own: a scale along each axis and a shift, such as those of a
    /// window of the frame or of a smaller copy of it. A mirrored frame has a negative scale.
    #[must_use]
    pub fn mapped(&self, map: &Homography) -> Self {
        let [x, _, left, _, y, top, ..] = map.0;
        let [fx, fy] = self.focal;
        let [cx, cy] = self.centre;
        Self { focal: [x * fx, y * fy], centre: [x * cx + left, y * cy + top], ..*self }
    }

    /// Where the lens shows a place of the ideal frame, px.
    #[must_use]
    pub fn distort(&self, p: [f32; 2]) -> [f32; 2] {
        let p = [0, 1].map(|i| (p[i] - self.centre[i]) / self.focal[i]);
        let p = self.bend(p);
        [0, 1].map(|i| p[i] * self.focal[i] + self.centre[i])
    }

    /// The place of the ideal frame, px, that the lens shows at `p`, px. `None` where no place is shown there.
    #[must_use]
    pub fn undistort(&self, p: [f32; 2]) -> Option<[f32; 2]> {
        let to = [0, 1].map(|i| (p[i] - self.centre[i]) / self.focal[i]);
        let far = math::sqrt(to[0] * to[0] + to[1] * to[1]);
        let mut at = to;
        if let Distortion::Fisheye(k) = &self.distortion {
            let angle = angle_of(k, far)?;
            let (sin, cos) = math::sin_cos(angle);
            let scale = if far > 1e-6 { sin / cos / far } else { 1.0 };
            at = to.map(|v| v * scale);
        }
        for _ in 0..STEPS {
            let seen = self.bend(at);
            let off = [to[0] - seen[0], to[1] - seen[1]];
            let error = off[0] * off[0] + off[1] * off[1];
            if error < 1e-13 {
                return Some([0, 1].map(|i| at[i] * self.focal[i] + self.centre[i]));
            }
            // A step of Newton's method; slopes by differences.
            let h = 1e-3;
            let (x, y) = (self.bend([at[0] + h, at[1]]), self.bend([at[0], at[1] + h]));
            let [a, b, c, d] = [(x[0] - seen[0]) / h, (y[0] - seen[0]) / h, (x[1] - seen[1]) / h, (y[1] - seen[1]) / h];
            let det = a * d - b * c;
            at = [at[0] + (d * off[0] - b * off[1]) / det, at[1] + (a * off[1] - c * off[0]) / det];
            // A lens that folds shows no more beyond the fold. A comparison with NaN is false.
            let goes_on = det > 1e-4 && at[0] * at[0] + at[1] * at[1] < FARTHEST * FARTHEST;
            if !goes_on {
                return None;
            }
        }
        let seen = self.bend(at);
        let is_near = [0, 1].iter().all(|&i| (to[i] - seen[i]).abs() * self.focal[i].abs() < 0.05);
        is_near.then(|| [0, 1].map(|i| at[i] * self.focal[i] + self.centre[i]))
    }

    /// Bends a place at depth 1.
    fn bend(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        match &self.distortion {
            Distortion::None => [x, y],
            Distortion::Brown([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let r2 = x * x + y * y;
                let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
                let xy = 2.0 * x * y;
                [x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy]
            }
            Distortion::Fisheye(k) => {
                let r = math::sqrt(x * x + y * y);
                let scale = if r > 1e-6 { distance_of(k, math::atan(r)) / r } else { 1.0 };
                [x * scale, y * scale]
            }
        }
    }
}

/// The distance of the axis at which a fisheye lens shows what comes at the angle `t` from it.
fn distance_of(&[k1, k2, k3, k4]: &[f32; 4], t: f32) -> f32 {
    let t2 = t * t;
    t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
}

/// The angle at which comes what a fisheye lens shows at a distance of the axis. `None` beyond 84 degrees.
fn angle_of(k: &[f32; 4], distance: f32) -> Option<f32> {
    const LARGEST: f32 = 1.466;
    let mut ends = [0.0, LARGEST];
    let is_shown = distance_of(k, LARGEST) >= distance;
    if !is_shown {
        return None;
    }
    for _ in 0..24 {
        let middle = (ends[0] + ends[1]) / 2.0;
        ends[usize::from(distance_of(k, middle) >= distance)] = middle;
    }
    Some((ends[0] + ends[1]) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDE: Distortion = Distortion::Brown([-0.32, 0.13, 1e-3, -5e-4, -0.02, 0.0, 0.0, 0.0]);
    const RATIONAL: Distortion = Distortion::Brown([0.6, 0.1, 1e-4, 2e-4, 0.01, 0.9, 0.25, 0.02]);
    const ACTION: Distortion = Distortion::Fisheye([0.03, -0.01, 0.004, -0.001]);

    /// Of cv2.projectPoints and cv2.fisheye.projectPoints (OpenCV 4): the point (0.4, -0.3, 1).
    const OPENCV: [[f32; 2]; 3] = [[505.3, 98.325_19], [506.421_23, 97.419_64], [506.576_35, 97.269_09]];

    #[test]
    fn a_place_comes_back_through_every_lens() {
        for (distortion, focal) in [(Distortion::None, 600.0), (WIDE, 480.0), (RATIONAL, 600.0), (ACTION, 260.0)] {
            let lens = Lens::new([focal, focal * 1.01, 315.0, 242.0], distortion).unwrap();
            for (x, y) in (0..=12u8).flat_map(|x| (0..=9u8).map(move |y| (f32::from(x) * 53.0, f32::from(y) * 53.0))) {
                let Some(ideal) = lens.undistort([x, y]) else {
                    assert!(distortion == ACTION && (x - 315.0).hypot(y - 242.0) > 380.0, "{distortion:?} {x} {y}");
                    continue;
                };
                let back = lens.distort(ideal);
                assert!((back[0] - x).hypot(back[1] - y) < 0.02, "{distortion:?}: {x} {y} became {back:?}");
            }
        }
    }

    #[test]
    fn lenses_bend_as_those_of_opencv() {
        for (distortion, [x, y]) in [WIDE, RATIONAL, ACTION].into_iter().zip(OPENCV) {
            let lens = Lens::new([500.0, 510.0, 320.0, 240.0], distortion).unwrap();
            let p = lens.distort([320.0 + 0.4 * 500.0, 240.0 - 0.3 * 510.0]);
            assert!((p[0] - x).hypot(p[1] - y) < 2e-3, "{distortion:?}: {p:?}");
        }
    }

    #[test]
    fn a_lens_of_a_smaller_or_moved_frame_shows_the_same() {
        let lens = Lens::new([480.0, 480.0, 320.0, 240.0], WIDE).unwrap();
        let map = Homography::affine([0.5, 0.0, -30.25, 0.0, 0.5, -10.25]);
        let (p, q) = (lens.distort([600.0, 50.0]), lens.mapped(&map).distort(map.apply([600.0, 50.0])));
        let p = map.apply(p);
        assert!((p[0] - q[0]).hypot(p[1] - q[1]) < 1e-3, "{p:?} {q:?}");
        assert_eq!(Lens::new([0.0, 1.0, 0.0, 0.0], WIDE), Err(LensError::Numbers));
        assert_eq!(Lens::new([1.0, 1.0, 0.0, f32::NAN], WIDE), Err(LensError::Numbers));
    }
}
