//! Finds where an object is in space: the pose of its plane before a calibrated camera.
//!
//! In: a homography from the picture to the frame, the camera's intrinsics, the picture's size in
//! px and its true width in mm. Out: a [`PlanePose`], that is rotations and translations (mm) that
//! carry object coordinates into camera coordinates.
//!
//! Camera coordinates are in mm: x to the right and y down in the frame, z away from the camera, as
//! in OpenCV. Object coordinates are in mm: x to the right and y down in the picture, z into it.
//! Their origin is the **middle of the picture**. There the errors of rotation and translation are
//! independent of each other. (With the origin at a corner, a tilt that is wrong by a degree also
//! moves the origin.) An upright object that is seen from the front has the identity as its
//! rotation.
//!
//! Method: the derivative of the map at the middle gives two columns of a rotation, seen along the
//! line of sight and divided by the distance. Orthonormality completes them in two ways.
//! Gauss-Newton steps refine each of the two poses. They reduce the reprojection error over a grid
//! of points (T. Collins, A. Bartoli, *Infinitesimal Plane-Based Pose Estimation*, IJCV 2014; G.
//! Schweighofer, A. Pinz, *Robust Pose Estimation from a Planar Target*, PAMI 2006).
//!
//! **Why there are two poses.** A plane that is tilted towards the camera and a plane that is
//! tilted away by the same angle look alike. Only perspective tells them apart: how much larger the
//! near edge appears. Take an object of size s px at distance d (in sizes of the object). A tilt of
//! angle t moves its points by some s sin(t) / (2 d) px against the mirrored tilt. For an object
//! that is small, far away, or seen almost from the front, this is less than the error of the
//! homography, and either pose may be the true one. What remains is the cosine of the tilt, which
//! hardly changes near the front: 1 % of error there is a tilt of 8 degrees. Both poses are
//! therefore given, with their errors. [`PlanePose::is_ambiguous`] says when they cannot be told
//! apart. The position and the turn within the plane are reliable in both.
//!
//! The camera is free of distortion: pass the homography of the ideal frame, [`Surface::homography`](crate::Surface),
//! where there is a lens.
//!
//! Memory: only some 400 bytes of stack. Cost: about 40,000 operations a detection, nothing a
//! frame.
//!
//! More than 600 lines: 230 of them are tests, with true poses in double precision.

use crate::base::geometry::Homography;
use crate::base::math;
use crate::base::says::says;
use crate::detect::pose::solve;

/// Number of points along each side of the grid over the picture.
const GRID: usize = 4;
const POINTS: usize = GRID * GRID;
/// Maximum number of Gauss-Newton steps. Four are enough, except in nearly flat minima.
const STEPS: usize = 12;
/// Minimum difference of reprojection errors that says something, px. Detections are about as
/// accurate as this.
const TELLING_PX: f32 = 0.5;

/// The reason why there is no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CameraError {
    /// A focal length is not above zero, or a number is not finite. Pass the intrinsics of a
    /// calibration, in px of the frame.
    Intrinsics,
    /// A side of the object is not above zero or not finite. Pass its width in mm.
    Size,
    /// The homography belongs to no pose: it shows the plane from behind, edge on, or reaching
    /// behind the camera.
    Homography,
}

says!(CameraError {
    Self::Intrinsics => ("intrinsics are four finite numbers, the focal lengths above 0: calibrate the camera"),
    Self::Size => ("the object's size must be above 0: give its width in mm"),
    Self::Homography => ("no pose has this homography: it shows the plane from behind or edge on"),
});

/// A pinhole camera. All its numbers are in px of the frame as it was given to the detector. Pixel
/// centres lie at integers, as in OpenCV.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Intrinsics {
    focal: [f32; 2],
    centre: [f32; 2],
}

impl Intrinsics {
    /// Makes a camera with the focal lengths `fx` and `fy` and the principal point `(cx, cy)`, all
    /// in px.
    ///
    /// # Errors
    /// Returns [`CameraError::Intrinsics`] when a focal length is not above zero, or when a number
    /// is not finite.
    pub fn new(fx: f32, fy: f32, cx: f32, cy: f32) -> Result<Self, CameraError> {
        let valid = fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|v| v.is_finite());
        valid.then_some(Self { focal: [fx, fy], centre: [cx, cy] }).ok_or(CameraError::Intrinsics)
    }

    /// Returns the focal lengths and the principal point, px: `fx fy cx cy`.
    #[must_use]
    pub const fn numbers(&self) -> [f32; 4] {
        [self.focal[0], self.focal[1], self.centre[0], self.centre[1]]
    }

    /// Returns where the camera sees `p`, px. `p` is in camera coordinates, in any unit. The result
    /// is not finite when the depth of `p` is zero.
    #[must_use]
    pub fn project(&self, p: [f32; 3]) -> [f32; 2] {
        [0, 1].map(|i| self.focal[i] * p[i] / p[2] + self.centre[i])
    }
}

/// A rigid motion from object to camera coordinates: `rotation * p + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Pose {
    /// Rotation matrix, row-major. Its columns are the object's axes in camera coordinates.
    pub rotation: [f32; 9],
    /// The middle of the picture in camera coordinates, mm.
    pub translation_mm: [f32; 3],
    /// Distance between the points of the homography and the points of the pose, px: root mean
    /// square over the picture.
    pub error_px: f32,
}

impl Pose {
    /// Returns `p` (object coordinates, mm) in camera coordinates, mm.
    #[must_use]
    pub fn apply(&self, p: [f32; 3]) -> [f32; 3] {
        let (r, t) = (&self.rotation, &self.translation_mm);
        core::array::from_fn(|i| r[3 * i] * p[0] + r[3 * i + 1] * p[1] + r[3 * i + 2] * p[2] + t[i])
    }
}

/// The two poses that a plane may have.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct PlanePose {
    /// The pose that fits better.
    pub best: Pose,
    /// The pose whose tilt is mirrored about the line of sight. It is the next best pose. Where the
    /// error has no second minimum, it is the mirror image of the best pose.
    pub mirrored: Pose,
}

impl PlanePose {
    /// Returns whether the mirrored pose fits almost as well, so that it may be the true one. This
    /// is so when its error is below 0.5 px, or below twice the error of the best pose.
    #[must_use]
    pub fn is_ambiguous(&self) -> bool {
        self.mirrored.error_px < TELLING_PX.max(2.0 * self.best.error_px)
    }
}

/// Returns the two poses at which the camera sees a picture as `homography` (picture px to frame
/// px) says. The picture has `size_px` (width, height) pixels, and its true width is `width_mm`.
/// The pixels of the picture are square and reach from -1/2 to width - 1/2.
///
/// # Errors
/// Returns [`CameraError::Size`] when a size is not above zero or not finite. Returns
/// [`CameraError::Homography`] when no pose has this homography.
pub fn plane_pose(
    homography: &Homography,
    intrinsics: &Intrinsics,
    size_px: [f32; 2],
    width_mm: f32,
) -> Result<PlanePose, CameraError> {
    let valid = |v: f32| v > 0.0 && v.is_finite();
    if !(valid(width_mm) && valid(size_px[0]) && valid(size_px[1])) {
        return Err(CameraError::Size);
    }
    let sight = Sight::new(homography, intrinsics, size_px)?;
    let unit_mm = width_mm / size_px[0] * sight.unit_px;
    let start = sight.first_guess().ok_or(CameraError::Homography)?;
    let [mut best, mut other] = [start, start.mirrored()].map(|p| sight.refine(p));
    if other.1 < best.1 {
        core::mem::swap(&mut best, &mut other);
    }
    // Both starts may have ended in the same minimum.
    let mirror = best.0.mirrored();
    if other.0.likeness(&mirror) <= other.0.likeness(&best.0) {
        other = (mirror, sight.error(&mirror));
    }
    let [best, mirrored] = [best, other].map(|(placed, error)| placed.pose(unit_mm, error));
    let finite = best.error_px.is_finite() && mirrored.error_px.is_finite();
    finite.then_some(PlanePose { best, mirrored }).ok_or(CameraError::Homography)
}

/// A pose. The unit of length is half the diagonal of the picture.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    /// Rows of the rotation.
    r: [[f32; 3]; 3],
    /// Middle of the picture, as the camera sees it: x/z and y/z.
    at: [f32; 2],
    /// 1 / depth of the middle.
    nearness: f32,
}

impl Placed {
    /// A pose in mm, of which `unit_mm` are the unit.
    pub(super) fn of(pose: &Pose, unit_mm: f32) -> Self {
        let ([a, b, c, d, e, f, g, h, i], [x, y, z]) = (pose.rotation, pose.translation_mm);
        Self { r: [[a, b, c], [d, e, f], [g, h, i]], at: [x / z, y / z], nearness: unit_mm / z }
    }

    /// Where a point of the object, relative to the middle, is before the camera, in depths of the middle.
    pub(super) fn apply(&self, p: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.r.map(|row| dot(row, p) * self.nearness);
        [x + self.at[0], y + self.at[1], z + 1.0]
    }

    /// Moves by a turn about the middle (3), the logarithm of the nearness (1), and the place of the middle (2).
    pub(super) fn moved(&self, &[wx, wy, wz, nearer, x, y, ..]: &[f32; 8]) -> Self {
        Self {
            r: self.turned([wx, wy, wz]),
            at: [self.at[0] + x, self.at[1] + y],
            nearness: self.nearness * math::exp(nearer),
        }
    }

    /// Returns the pose of the plane reflected along the line of sight and turned over. Its
    /// rotation is `S R D`, where S is the reflection along the line of sight and D the reflection
    /// along the object's z.
    fn mirrored(&self) -> Self {
        let v = unit([self.at[0], self.at[1], 1.0]);
        let along = [0, 1, 2].map(|c| 2.0 * dot(v, [0, 1, 2].map(|i| self.r[i][c])));
        let r = core::array::from_fn(|i| {
            let [x, y, z] = self.r[i];
            [x - along[0] * v[i], y - along[1] * v[i], along[2] * v[i] - z]
        });
        Self { r, ..*self }
    }

    /// Returns the trace of the rotation from one pose to the other. It is 3 when the rotations are
    /// equal.
    fn likeness(&self, o: &Self) -> f32 {
        self.r.iter().zip(&o.r).map(|(a, b)| dot(*a, *b)).sum()
    }

    /// Returns the object point `(x, y, 0)` relative to the middle, divided by the depth of the
    /// middle.
    fn arm(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        self.r.map(|row| (row[0] * x + row[1] * y) * self.nearness)
    }

    /// Returns the rotation turned by the vector `w` (radians) about the middle of the picture.
    fn turned(&self, w: [f32; 3]) -> [[f32; 3]; 3] {
        let angle = math::sqrt(dot(w, w));
        let (sin, cos) = math::sin_cos(angle);
        let (a, b) = if angle > 1e-4 { (sin / angle, (1.0 - cos) / (angle * angle)) } else { (1.0, 0.5) };
        let column = |c: usize| {
            let v = [0, 1, 2].map(|i| self.r[i][c]);
            let (s, d) = (cross(w, v), dot(w, v));
            [0, 1, 2].map(|i| cos * v[i] + a * s[i] + b * d * w[i])
        };
        // This keeps rounding errors from adding up.
        let x = unit(column(0));
        let z = unit(cross(x, column(1)));
        from_columns(x, cross(z, x), z)
    }

    pub(super) fn pose(&self, unit_mm: f32, error_px: f32) -> Pose {
        let depth_mm = unit_mm / self.nearness;
        let mut rotation = [0.0; 9];
        rotation.copy_from_slice(self.r.as_flattened());
        Pose { rotation, translation_mm: [self.at[0] * depth_mm, self.at[1] * depth_mm, depth_mm], error_px }
    }
}

/// Measurements that the homography gives. The unit of length is half the diagonal of the picture.
struct Sight<'a> {
    intrinsics: &'a Intrinsics,
    /// Half the diagonal, picture px.
    unit_px: f32,
    /// Half the diagonal, frame px; approximate.
    size_px: f32,
    /// Middle of the picture, as the camera sees it: x/z and y/z.
    at: [f32; 2],
    /// Derivative of x/z and y/z by the object's x and y, at the middle.
    jacobian: [[f32; 2]; 2],
    /// Points of the object, and where the homography puts them in the frame, px.
    points: [([f32; 2], [f32; 2]); POINTS],
}

impl<'a> Sight<'a> {
    fn new(h: &Homography, intrinsics: &'a Intrinsics, [w, height]: [f32; 2]) -> Result<Self, CameraError> {
        let unit_px = math::sqrt(w * w + height * height) / 2.0;
        let middle = [(w - 1.0) / 2.0, (height - 1.0) / 2.0];
        let m = h.after(&Homography::affine([unit_px, 0.0, middle[0], 0.0, unit_px, middle[1]])).0;
        let (focal, centre) = (intrinsics.focal, intrinsics.centre);
        let seen = [m[2] / m[8], m[5] / m[8]];
        let jacobian = [0, 1].map(|i| [0, 1].map(|c| (m[3 * i + c] - seen[i] * m[6 + c]) / m[8] / focal[i]));
        let half = [w / 2.0, height / 2.0];
        let step = |i: usize| (2 * i + 1) as f32 / GRID as f32 - 1.0;
        let points = core::array::from_fn(|i| {
            let offset = [step(i % GRID) * half[0], step(i / GRID) * half[1]];
            (offset.map(|v| v / unit_px), h.apply([middle[0] + offset[0], middle[1] + offset[1]]))
        });
        let determinant = jacobian[0][0] * jacobian[1][1] - jacobian[0][1] * jacobian[1][0];
        // This must have one sign all over the picture, otherwise the line at infinity crosses the
        // picture.
        let ahead = |[x, y]: [f32; 2]| (m[6] * x + m[7] * y) / m[8] > -1.0;
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let visible = corners.iter().all(|c| ahead([c[0] * half[0] / unit_px, c[1] * half[1] / unit_px]));
        if !(determinant > 0.0 && determinant.is_finite() && visible) {
            return Err(CameraError::Homography);
        }
        Ok(Self {
            intrinsics,
            unit_px,
            size_px: math::sqrt(determinant * focal[0] * focal[1]),
            at: [0, 1].map(|i| (seen[i] - centre[i]) / focal[i]),
            jacobian,
            points,
        })
    }

    /// Returns one of the two poses that have the given derivative at the middle.
    fn first_guess(&self) -> Option<Placed> {
        // These axes have the line of sight as the third.
        let [px, py] = self.at;
        let v = unit([px, py, 1.0]);
        let q0 = unit(cross([0.0, 1.0, 0.0], v));
        let q1 = cross(v, q0);
        // Motion along q0 and q1 moves x/z and y/z like this at depth 1. Motion along v does not
        // move them.
        let b = [[q0[0] - px * q0[2], q1[0] - px * q1[2]], [q0[1] - py * q0[2], q1[1] - py * q1[2]]];
        let det = b[0][0] * b[1][1] - b[0][1] * b[1][0];
        let j = &self.jacobian;
        let a = [0, 1]
            .map(|c| [(b[1][1] * j[0][c] - b[0][1] * j[1][c]) / det, (b[0][0] * j[1][c] - b[1][0] * j[0][c]) / det]);
        // These are two columns of a rotation without their part along the line of sight, divided
        // by the depth. The larger singular value is one over the depth.
        let (m00, m11) = (a[0][0] * a[0][0] + a[0][1] * a[0][1], a[1][0] * a[1][0] + a[1][1] * a[1][1]);
        let m01 = a[0][0] * a[1][0] + a[0][1] * a[1][1];
        let spread = math::sqrt((m00 - m11) * (m00 - m11) + 4.0 * m01 * m01);
        let n2 = (m00 + m11 + spread) / 2.0;
        if n2 <= 0.0 {
            return None;
        }
        let nearness = math::sqrt(n2);
        // The part that a column lacks to have length 1 lies along the line of sight.
        let along = [m00, m11].map(|m| math::sqrt((1.0 - m / n2).max(0.0)));
        let signs = [1.0, if m01 > 0.0 { -1.0 } else { 1.0 }];
        let column = |c: usize| {
            let [s, t] = a[c].map(|x| x / nearness);
            [0, 1, 2].map(|i| s * q0[i] + t * q1[i] + signs[c] * along[c] * v[i])
        };
        let x = unit(column(0));
        let z = unit(cross(x, column(1)));
        Some(Placed { r: from_columns(x, cross(z, x), z), at: self.at, nearness })
    }

    /// Returns the root mean square of the reprojection error over the grid, px.
    fn error(&self, p: &Placed) -> f32 {
        let squares = self.points.iter().map(|&(from, to)| {
            let arm = p.arm(from);
            let seen = self.intrinsics.project([arm[0] + p.at[0], arm[1] + p.at[1], arm[2] + 1.0]);
            (to[0] - seen[0]) * (to[0] - seen[0]) + (to[1] - seen[1]) * (to[1] - seen[1])
        });
        math::sqrt(squares.sum::<f32>() / POINTS as f32)
    }

    /// Takes Gauss-Newton steps for as long as the error falls. Returns the pose and its error, px.
    fn refine(&self, start: Placed) -> (Placed, f32) {
        let mut best = (start, self.error(&start));
        for _ in 0..STEPS {
            let Some(next) = self.step(&best.0) else { break };
            let error = self.error(&next);
            if error.is_nan() || error >= best.1 {
                break;
            }
            best = (next, error);
        }
        best
    }

    /// Returns the pose after one step. The unknowns are those of [`Placed::moved`].
    fn step(&self, p: &Placed) -> Option<Placed> {
        let mut normal = [[0.0f32; 9]; 8];
        for &(from, to) in &self.points {
            let arm = p.arm(from);
            let q = [arm[0] + p.at[0], arm[1] + p.at[1], arm[2] + 1.0];
            let seen = self.intrinsics.project(q);
            for i in 0..2 {
                // The unit is the size of the object, so that the elements of the matrix are near
                // 1.
                let k = self.intrinsics.focal[i] / q[2] / self.size_px;
                let mut g = [0.0, 0.0, -k * q[i] / q[2]];
                g[i] = k;
                let [wx, wy, wz] = cross(arm, g);
                let row = [wx, wy, wz, dot(g, arm), g[0], g[1]];
                let residual = (to[i] - seen[i]) / self.size_px;
                for a in 0..6 {
                    for b in a..6 {
                        normal[a][b] += row[a] * row[b];
                    }
                    normal[a][8] += row[a] * residual;
                }
            }
        }
        Some(p.moved(&solve(&mut normal, 6)?))
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = math::sqrt(dot(v, v));
    v.map(|x| x / length)
}

fn from_columns(x: [f32; 3], y: [f32; 3], z: [f32; 3]) -> [[f32; 3]; 3] {
    [0, 1, 2].map(|i| [x[i], y[i], z[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const SIZE_PX: [f32; 2] = [600.0, 400.0];
    const WIDTH_MM: f32 = 210.0;

    /// A true pose, in double precision.
    struct Truth {
        rotation: [[f64; 3]; 3],
        translation_mm: [f64; 3],
    }

    impl Truth {
        /// Makes a pose with a turn of `turn` within the plane, followed by a tilt of `tilt` away
        /// from the line of sight towards `direction`. All angles are in degrees.
        fn new(tilt: f64, direction: f64, turn: f64, translation_mm: [f64; 3]) -> Self {
            let [tilt, direction, turn] = [tilt, direction, turn].map(f64::to_radians);
            let about_z = |a: f64| [[a.cos(), -a.sin(), 0.0], [a.sin(), a.cos(), 0.0], [0.0, 0.0, 1.0]];
            let about_x = |a: f64| [[1.0, 0.0, 0.0], [0.0, a.cos(), -a.sin()], [0.0, a.sin(), a.cos()]];
            // `v` is the line of sight to the middle. The other two axes lie across it.
            let norm = translation_mm.iter().map(|v| v * v).sum::<f64>().sqrt();
            let v = translation_mm.map(|c| c / norm);
            let k = v[0].hypot(v[2]);
            let q = [[v[2] / k, -v[0] * v[1] / k, v[0]], [0.0, k, v[1]], [-v[0] / k, -v[1] * v[2] / k, v[2]]];
            let local = times(times(times(about_z(direction), about_x(tilt)), about_z(-direction)), about_z(turn));
            Self { rotation: times(q, local), translation_mm }
        }

        fn corners(&self, camera: &Intrinsics) -> [[f64; 2]; 4] {
            let (w, h) = (f64::from(WIDTH_MM) / 2.0, f64::from(WIDTH_MM * SIZE_PX[1] / SIZE_PX[0]) / 2.0);
            [[-w, -h], [w, -h], [w, h], [-w, h]].map(|[x, y]| {
                let p: [f64; 3] = core::array::from_fn(|i| {
                    self.rotation[i][0] * x + self.rotation[i][1] * y + self.translation_mm[i]
                });
                core::array::from_fn(|i| f64::from(camera.focal[i]) * p[i] / p[2] + f64::from(camera.centre[i]))
            })
        }

        /// Returns the angle between the rotations, degrees, and the distance between the positions
        /// divided by the depth.
        fn errors(&self, pose: &Pose) -> (f64, f64) {
            let trace: f64 = (0..9).map(|i| self.rotation[i / 3][i % 3] * f64::from(pose.rotation[i])).sum();
            let squares: f64 =
                (0..3).map(|i| (self.translation_mm[i] - f64::from(pose.translation_mm[i])).powi(2)).sum();
            // The angle is computed from the chord, because rounding then does not hide small
            // angles.
            let chord = ((3.0 - trace) / 2.0).max(0.0).sqrt() / 2f64.sqrt();
            (2.0 * chord.min(1.0).asin().to_degrees(), squares.sqrt() / self.translation_mm[2])
        }
    }

    fn times(a: [[f64; 3]; 3], b: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
        core::array::from_fn(|i| core::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    /// Returns the homography from the picture to four corners of its outline in the frame. It uses
    /// the map of the unit square in closed form (P. Heckbert, 1989).
    fn homography(c: [[f64; 2]; 4]) -> Homography {
        let d = |i: usize, j: usize| [c[i][0] - c[j][0], c[i][1] - c[j][1]];
        let (d1, d2) = (d(1, 2), d(3, 2));
        let s = [0, 1].map(|i| c[0][i] - c[1][i] + c[2][i] - c[3][i]);
        let det = d1[0] * d2[1] - d1[1] * d2[0];
        let g = (s[0] * d2[1] - s[1] * d2[0]) / det;
        let h = (d1[0] * s[1] - d1[1] * s[0]) / det;
        let row = |i: usize| [c[1][i] - c[0][i] + g * c[1][i], c[3][i] - c[0][i] + h * c[3][i], c[0][i]];
        let rows = [row(0), row(1), [g, h, 1.0]];
        // The square's (0, 0) is the picture's (-1/2, -1/2).
        let [w, t] = SIZE_PX.map(f64::from);
        let px = rows.map(|[a, b, e]| [a / w, b / t, e + 0.5 * (a / w + b / t)]);
        let last = px[2][2];
        Homography(core::array::from_fn(|i| (px[i / 3][i % 3] / last) as f32))
    }

    fn camera() -> Intrinsics {
        Intrinsics::new(620.0, 600.0, 325.0, 236.0).unwrap()
    }

    /// Returns a random number, evenly distributed from -1 to 1.
    fn noise(seed: &mut u32) -> f64 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*seed >> 8) / f64::from(1u32 << 23) - 1.0
    }

    /// Returns poses over the whole frame, turned and tilted in every way. The depths go from 400
    /// mm (the object fills half the frame) to 1200 mm (the object is 108 px wide).
    fn truths() -> Vec<Truth> {
        let mut truths = Vec::new();
        let mut seed = 7;
        for tilt in [0.0, 2.0, 10.0, 25.0, 40.0, 60.0] {
            for depth in [400.0, 700.0, 1200.0] {
                for turn in [0.0, 77.0, 180.0, 290.0] {
                    let direction = 180.0 * noise(&mut seed);
                    let middle = [0.3 * noise(&mut seed) * depth, 0.2 * noise(&mut seed) * depth, depth];
                    truths.push(Truth::new(tilt, direction, turn, middle));
                }
            }
        }
        truths
    }

    fn seen(truth: &Truth, noise_px: f64, seed: &mut u32) -> PlanePose {
        // The noise is evenly distributed and has this standard deviation.
        let width = noise_px * 3f64.sqrt();
        let corners = truth.corners(&camera()).map(|c| c.map(|v| v + width * noise(seed)));
        plane_pose(&homography(corners), &camera(), SIZE_PX, WIDTH_MM).unwrap()
    }

    #[test]
    fn exact_corners_give_the_exact_pose() {
        for (i, truth) in truths().iter().enumerate() {
            let pose = seen(truth, 0.0, &mut 0).best;
            let (degrees, part) = truth.errors(&pose);
            assert!(degrees < 0.1 && part < 1e-3, "pose {i}: {degrees} degrees, {part} of the depth");
            assert!(pose.error_px < 0.01, "pose {i}: {} px", pose.error_px);
        }
    }

    #[test]
    fn a_pose_is_a_rigid_motion_that_projects_onto_the_frame() {
        let truth = Truth::new(35.0, 20.0, 100.0, [60.0, -40.0, 500.0]);
        let pose = seen(&truth, 0.0, &mut 0).best;
        let r = &pose.rotation;
        for (a, b) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
            let product: f32 = (0..3).map(|k| r[3 * a + k] * r[3 * b + k]).sum();
            assert!((product - f32::from(u8::from(a == b))).abs() < 1e-5, "rows {a} and {b}: {product}");
        }
        let half = [WIDTH_MM / 2.0, WIDTH_MM * SIZE_PX[1] / SIZE_PX[0] / 2.0];
        let at = camera().project(pose.apply([half[0], -half[1], 0.0]));
        let right_top = truth.corners(&camera())[1];
        assert!(
            (f64::from(at[0]) - right_top[0]).hypot(f64::from(at[1]) - right_top[1]) < 0.01,
            "{at:?} {right_top:?}"
        );
    }

    #[test]
    fn seen_from_the_front_the_rotation_is_the_identity() {
        let truth = Truth::new(0.0, 0.0, 0.0, [0.0, 0.0, 600.0]);
        let pose = seen(&truth, 0.0, &mut 0).best;
        for (i, v) in pose.rotation.iter().enumerate() {
            assert!((v - f32::from(u8::from(i % 4 == 0))).abs() < 2e-3, "{:?}", pose.rotation);
        }
        assert!((pose.translation_mm[2] - 600.0).abs() < 0.1, "{:?}", pose.translation_mm);
    }

    /// Measures what 0.3 px of noise on each coordinate of each corner costs.
    #[test]
    #[cfg_attr(miri, ignore = "statistics over 720 poses would take minutes")]
    fn noise_of_a_third_of_a_pixel() {
        let (mut degrees, mut parts, mut seed) = (Vec::new(), Vec::new(), 3);
        let (mut wrong, mut clear) = (0, 0);
        for truth in truths() {
            for _ in 0..10 {
                let poses = seen(&truth, 0.3, &mut seed);
                // When the two poses cannot be told apart, the nearer one counts.
                let errors = [poses.best, poses.mirrored].map(|p| truth.errors(&p));
                if !poses.is_ambiguous() {
                    clear += 1;
                    wrong += usize::from(errors[1].0 < errors[0].0);
                }
                let nearer = if poses.is_ambiguous() && errors[1].0 < errors[0].0 { errors[1] } else { errors[0] };
                degrees.push(nearer.0);
                parts.push(nearer.1);
            }
        }
        degrees.sort_by(f64::total_cmp);
        parts.sort_by(f64::total_cmp);
        let at = |v: &[f64], part: f64| v[(part * (v.len() - 1) as f64) as usize];
        let figures = std::format!(
            "rotation {:.2} {:.2} {:.2} degrees, translation {:.4} {:.4} {:.4} (median, 95 %, most), {wrong} of {clear} clear ones mirrored",
            at(&degrees, 0.5),
            at(&degrees, 0.95),
            at(&degrees, 1.0),
            at(&parts, 0.5),
            at(&parts, 0.95),
            at(&parts, 1.0)
        );
        std::println!("{figures}");
        assert!(at(&degrees, 0.5) < 0.7 && at(&degrees, 0.95) < 5.0, "{figures}");
        assert!(at(&parts, 0.5) < 0.002 && at(&parts, 0.95) < 0.007, "{figures}");
        assert!(wrong == 0 && clear > 200, "{figures}");
    }

    #[test]
    fn the_second_pose_is_tilted_the_other_way() {
        for tilt in [15.0, 30.0, 50.0] {
            for direction in [-120.0, 0.0, 65.0] {
                let middle = [80.0, -50.0, 900.0];
                let other = seen(&Truth::new(tilt, direction, 40.0, middle), 0.0, &mut 0).mirrored;
                let (degrees, part) = Truth::new(-tilt, direction, 40.0, middle).errors(&other);
                assert!(degrees < 10.0 && part < 0.03, "tilt {tilt} towards {direction}: {degrees} degrees, {part}");
                assert!(other.error_px > 0.05, "tilt {tilt} towards {direction}: {} px", other.error_px);
            }
        }
    }

    #[test]
    fn small_and_nearly_frontal_is_ambiguous_and_large_and_tilted_is_not() {
        let poses = |tilt, depth| seen(&Truth::new(tilt, 30.0, 10.0, [0.0, 0.0, depth]), 0.0, &mut 0);
        assert!(poses(3.0, 1500.0).is_ambiguous());
        assert!(poses(0.0, 600.0).is_ambiguous(), "the direction of no tilt");
        assert!(!poses(40.0, 400.0).is_ambiguous());
        assert!(!poses(25.0, 700.0).is_ambiguous());
    }

    #[test]
    fn what_has_no_pose_is_refused() {
        let good = homography(Truth::new(20.0, 0.0, 0.0, [0.0, 0.0, 600.0]).corners(&camera()));
        let mut flipped = good;
        for i in 0..3 {
            flipped.0[3 * i] = -flipped.0[3 * i];
        }
        let edge_on = Homography([1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let through = Homography([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.01, 0.0, 1.0]);
        for (h, what) in [(flipped, "from behind"), (edge_on, "edge on"), (through, "behind the camera")] {
            assert_eq!(plane_pose(&h, &camera(), SIZE_PX, WIDTH_MM), Err(CameraError::Homography), "{what}");
        }
        assert_eq!(plane_pose(&Homography([f32::NAN; 9]), &camera(), SIZE_PX, 1.0), Err(CameraError::Homography));
        for width in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(plane_pose(&good, &camera(), SIZE_PX, width), Err(CameraError::Size), "{width} mm");
        }
        for [fx, fy, cx, cy] in [[0.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, f32::NAN, 1.0]] {
            assert_eq!(Intrinsics::new(fx, fy, cx, cy), Err(CameraError::Intrinsics), "{fx} {fy} {cx} {cy}");
        }
    }
}
