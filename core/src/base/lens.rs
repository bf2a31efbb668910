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
//! Memory: 56 bytes. Cost: some 30 operations for a place, ten times as many back; a lens is tried at 96 angles when it is
//! made.

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
    /// Distance of the axis, at depth 1, up to which the lens shows more the farther out it is. Beyond it the numbers of
    /// the calibration say nothing.
    reach: f32,
}

/// Maximum number of steps back through a lens.
const STEPS: usize = 20;
/// Largest angle from the axis that is looked for, radians: 84 degrees; its tangent is 9.5.
const WIDEST: f32 = 1.466;
/// Number of angles at which a lens is tried for its reach.
const TRIALS: u8 = 96;
/// Slope of what lies beyond the reach, beside that of the middle: little, so that nothing comes back into the frame.
const BEYOND: f32 = 0.1;

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
        if !is_finite || fx == 0.0 || fy == 0.0 {
            return Err(LensError::Numbers);
        }
        let mut lens = Self { focal: [fx, fy], centre: [cx, cy], distortion, reach: f32::MAX };
        let mut last = [0.0; 2];
        for i in 1..=TRIALS {
            let (sin, cos) = math::sin_cos(WIDEST * f32::from(i) / f32::from(TRIALS));
            let at = [sin / cos, lens.along(sin / cos)];
            // A comparison with NaN is false.
            let goes_on = at[1] > last[1];
            if !goes_on {
                break;
            }
            last = at;
        }
        lens.reach = last[0];
        Ok(lens)
    }

    /// How far from the axis the lens shows what is at the distance `r` of it, at depth 1, without what it moves across
    /// the radius.
    fn along(&self, r: f32) -> f32 {
        match &self.distortion {
            Distortion::None => r,
            Distortion::Brown(k) => r * radial(k, r * r),
            Distortion::Fisheye(k) => distance_of(k, math::atan(r)),
        }
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

    /// Returns the lens in px of a copy of its frame. `map` is the map from the frame to the copy: a scale along each
    /// axis, negative where the copy is mirrored, and a shift.
    #[must_use]
    pub fn mapped(&self, map: &Homography) -> Self {
        let [x, _, left, _, y, top, ..] = map.0;
        let [fx, fy] = self.focal;
        let [cx, cy] = self.centre;
        Self { focal: [x * fx, y * fy], centre: [x * cx + left, y * cy + top], ..*self }
    }

    /// Returns the lens in px of a part or a copy of its frame. `to_frame` is the map from it to the frame, as
    /// [`Window::to_frame`](crate::Window::to_frame) gives it for a window.
    #[must_use]
    pub fn within(&self, to_frame: &Homography) -> Self {
        let [x, _, left, _, y, top, ..] = to_frame.0;
        self.mapped(&Homography::affine([1.0 / x, 0.0, -left / x, 0.0, 1.0 / y, -top / y]))
    }

    /// Where the lens shows a place of the ideal frame, px. What lies farther out than the calibration can say is put
    /// outside of all that it can.
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
            let angle = angle_of(k, math::atan(self.reach), far)?;
            let (sin, cos) = math::sin_cos(angle);
            let scale = if far > 1e-6 { sin / cos / far } else { 1.0 };
            at = to.map(|v| v * scale);
        }
        for _ in 0..STEPS {
            let seen = self.bend(at);
            let off = [to[0] - seen[0], to[1] - seen[1]];
            let error = off[0] * off[0] + off[1] * off[1];
            if error < 1e-13 {
                break;
            }
            // A step of Newton's method; slopes by differences.
            let h = 1e-3;
            let (x, y) = (self.bend([at[0] + h, at[1]]), self.bend([at[0], at[1] + h]));
            let [a, b, c, d] = [(x[0] - seen[0]) / h, (y[0] - seen[0]) / h, (x[1] - seen[1]) / h, (y[1] - seen[1]) / h];
            let det = a * d - b * c;
            at = [at[0] + (d * off[0] - b * off[1]) / det, at[1] + (a * off[1] - c * off[0]) / det];
            // A lens that folds shows no more beyond the fold. A comparison with NaN is false.
            let goes_on = det > 1e-4 && at[0] * at[0] + at[1] * at[1] < 2.0 * self.reach * self.reach;
            if !goes_on {
                return None;
            }
        }
        let seen = self.bend(at);
        let is_near = [0, 1].iter().all(|&i| (to[i] - seen[i]).abs() * self.focal[i].abs() < 0.05);
        let is_shown = is_near && at[0] * at[0] + at[1] * at[1] <= self.reach * self.reach;
        is_shown.then(|| [0, 1].map(|i| at[i] * self.focal[i] + self.centre[i]))
    }

    /// Bends a place at depth 1.
    fn bend(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let r = math::sqrt(x * x + y * y);
        if r > self.reach {
            let scale = self.reach / r;
            let edge = self.bend_within([x * scale, y * scale]);
            let more = BEYOND * (r - self.reach) / r;
            return [edge[0] + x * more, edge[1] + y * more];
        }
        self.bend_within([x, y])
    }

    fn bend_within(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        match &self.distortion {
            Distortion::None => [x, y],
            Distortion::Brown(k) => {
                let ([_, _, p1, p2, ..], r2) = (k, x * x + y * y);
                let radial = radial(k, r2);
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

/// The factor by which a lens of Brown and Conrady moves a place along the radius; `r2` is the square of its distance.
fn radial(&[k1, k2, _, _, k3, k4, k5, k6]: &[f32; 8], r2: f32) -> f32 {
    (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
}

/// The distance of the axis at which a fisheye lens shows what comes at the angle `t` from it.
fn distance_of(&[k1, k2, k3, k4]: &[f32; 4], t: f32) -> f32 {
    let t2 = t * t;
    t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
}

/// The angle, up to `most`, at which comes what a fisheye lens shows at a distance of the axis. `None` when it comes from
/// farther out.
fn angle_of(k: &[f32; 4], most: f32, distance: f32) -> Option<f32> {
    let mut ends = [0.0, most];
    let is_shown = distance_of(k, most) >= distance;
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
    fn a_lens_that_folds_shows_nothing_twice() {
        // Beyond 44 degrees the first turns back, and the second beyond 69.
        for (distortion, focal, reach) in [
            (Distortion::Brown([-0.36, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 450.0, 43.9f32),
            (Distortion::Fisheye([0.08, -0.15, 0.2, -0.1]), 300.0, 69.3),
        ] {
            let lens = Lens::new([focal, focal, 320.0, 240.0], distortion).unwrap();
            let mut last = -1.0;
            for degrees in 0..84u8 {
                let x = lens.distort([320.0 + focal * f32::from(degrees).to_radians().tan(), 240.0])[0];
                assert!(x > last, "{distortion:?}: {degrees} degrees are shown at {x}, and those before at {last}");
                last = x;
                let (back, beyond) = (lens.undistort([x, 240.0]), f32::from(degrees) - reach);
                // Near the fold a degree is less than a tenth of a pixel.
                assert!(back.is_some() || beyond > -2.0, "{distortion:?}: {degrees} degrees are not shown");
                assert!(back.is_none() || beyond < 0.5, "{distortion:?}: {degrees} degrees are shown");
            }
        }
    }

    #[test]
    fn a_lens_of_a_smaller_or_moved_frame_shows_the_same() {
        let lens = Lens::new([480.0, 480.0, 320.0, 240.0], WIDE).unwrap();
        let map = Homography::affine([0.5, 0.0, -30.25, 0.0, 0.5, -10.25]);
        let p = map.apply(lens.distort([600.0, 50.0]));
        for lens in [lens.mapped(&map), lens.within(&map.inverse().unwrap())] {
            let q = lens.distort(map.apply([600.0, 50.0]));
            assert!((p[0] - q[0]).hypot(p[1] - q[1]) < 1e-3, "{p:?} {q:?}");
        }
        assert_eq!(Lens::new([0.0, 1.0, 0.0, 0.0], WIDE), Err(LensError::Numbers));
        assert_eq!(Lens::new([1.0, 1.0, 0.0, f32::NAN], WIDE), Err(LensError::Numbers));
    }
}
