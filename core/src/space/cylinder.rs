//! Finds the cylinder that a label lies on: its axis, its radius, and where the label is on it.
//!
//! In: a surface, the camera's intrinsics, the picture's size in px and its true width in mm. Out: a
//! [`Cylinder`]. Any surface gives one; its error says whether the object is one. Coordinates are those of
//! `camera`.
//!
//! Levenberg and Marquardt's steps move eight numbers (the pose, the curvature, the direction of the axis in
//! the picture) to the least distance from the surface's grid, from four starts: both poses of the
//! surface's plane, bent to the camera and away from it.
//!
//! Memory: about 3 KB of stack. Cost: some two million operations.

use crate::base::lens::Lens;
use crate::base::math;
use crate::detect::bend::REACH;
use crate::detect::cells::{POINTS, SIDE};
use crate::detect::pose::solve;
use crate::detect::surface::Surface;
use crate::space::camera::{CameraError, Intrinsics, Placed, Pose, plane_pose};

/// Maximum number of steps from one start.
const STEPS: usize = 25;
/// Number of unknowns.
const UNKNOWNS: usize = 8;
/// Step of an unknown for its derivative.
const STEP: f32 = 1e-3;

/// A label on a cylinder before the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Cylinder {
    /// Radius, mm.
    pub radius_mm: f32,
    /// Whether the label is on the inside: it bends towards the camera.
    pub is_inside: bool,
    /// Direction of the axis in camera coordinates, of length 1: the one that points more to the bottom of the
    /// picture.
    pub axis: [f32; 3],
    /// The point of the axis behind the middle of the label (before it, on the inside), camera coordinates, mm.
    pub centre_mm: [f32; 3],
    /// Pose of the plane that touches the cylinder at the middle of the label. Its error is the distance of the
    /// surface's grid from the cylinder, px: root mean square.
    pub pose: Pose,
}

/// A label on a cylinder. The unit of length is half the diagonal of the picture.
#[derive(Clone, Copy)]
struct Rolled {
    placed: Placed,
    /// Reciprocal of the radius: above 0 when the label bends away from the camera.
    curvature: f32,
    /// Direction along which the label bends, in the picture, radians from its x axis.
    angle: f32,
}

impl Rolled {
    /// Where a place of the label is, relative to its middle.
    fn place(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let (sin, cos) = math::sin_cos(self.angle);
        let (q, r) = (x * cos + y * sin, y * cos - x * sin);
        let turn = self.curvature * q;
        let (s, c) = math::sin_cos(turn);
        // Of a small curvature: what the series have left.
        let (along, deep) = if self.curvature.abs() > 1e-3 {
            (s / self.curvature, (1.0 - c) / self.curvature)
        } else {
            (q, self.curvature * q * q / 2.0)
        };
        [along * cos - r * sin, along * sin + r * cos, deep]
    }

    fn moved(&self, d: &[f32; UNKNOWNS]) -> Self {
        Self { placed: self.placed.moved(d), curvature: self.curvature + d[6], angle: self.angle + d[7] }
    }
}

/// The grid of a surface, and where the camera shows it.
struct Grid<'a> {
    intrinsics: &'a Intrinsics,
    /// Places of the picture, and of the frame, px.
    points: [([f32; 2], [f32; 2]); POINTS],
}

impl Grid<'_> {
    /// Where the camera shows a place of the label, px.
    fn seen(&self, rolled: &Rolled, place: [f32; 2]) -> [f32; 2] {
        self.intrinsics.project(rolled.placed.apply(rolled.place(place)))
    }

    /// Root mean square distance of the grid, px.
    fn error(&self, rolled: &Rolled) -> f32 {
        let squares = self.points.iter().map(|&(from, to)| {
            let seen = self.seen(rolled, from);
            (to[0] - seen[0]) * (to[0] - seen[0]) + (to[1] - seen[1]) * (to[1] - seen[1])
        });
        math::sqrt(squares.sum::<f32>() / POINTS as f32)
    }

    /// The normal equations at `rolled`, without damping.
    fn equations(&self, rolled: &Rolled) -> [[f32; UNKNOWNS + 1]; UNKNOWNS] {
        let mut others = [*rolled; UNKNOWNS];
        for (k, other) in others.iter_mut().enumerate() {
            let mut d = [0.0; UNKNOWNS];
            d[k] = STEP;
            *other = rolled.moved(&d);
        }
        let mut equations = [[0.0; UNKNOWNS + 1]; UNKNOWNS];
        for &(from, to) in &self.points {
            let seen = self.seen(rolled, from);
            let slopes = others.map(|o| {
                let p = self.seen(&o, from);
                [0, 1].map(|i| (p[i] - seen[i]) / STEP)
            });
            for (i, a) in slopes.iter().enumerate() {
                for (j, b) in slopes.iter().enumerate().skip(i) {
                    equations[i][j] += a[0] * b[0] + a[1] * b[1];
                }
                equations[i][UNKNOWNS] += a[0] * (to[0] - seen[0]) + a[1] * (to[1] - seen[1]);
            }
        }
        equations
    }

    /// The nearest cylinder that is reached from a start, and its error.
    fn refine(&self, start: Rolled) -> (Rolled, f32) {
        let (mut best, mut damping) = ((start, self.error(&start)), 1e-3);
        for _ in 0..STEPS {
            let mut equations = self.equations(&best.0);
            for (i, row) in equations.iter_mut().enumerate() {
                row[i] *= 1.0 + damping;
            }
            let Some(d) = solve(&mut equations, UNKNOWNS) else { break };
            let next = best.0.moved(&d);
            let error = self.error(&next);
            // A comparison with NaN is false.
            if error < best.1 {
                let gained = best.1 - error;
                (best, damping) = ((next, error), damping * 0.2);
                if gained < 1e-4 * error {
                    break;
                }
            } else {
                damping *= 10.0;
            }
        }
        best
    }
}

/// The cylinder that a surface lies on, seen by a camera, through `lens` if there is one. The picture has `size_px`
/// (width, height) pixels, and its true width is `width_mm`.
///
/// # Errors
/// [`CameraError::Size`] when a size is not above zero or not finite. [`CameraError::Homography`] when the
/// surface's plane has no pose, or a point has no place.
pub fn cylinder(
    surface: &Surface,
    intrinsics: &Intrinsics,
    lens: Option<&Lens>,
    size_px: [f32; 2],
    width_mm: f32,
) -> Result<Cylinder, CameraError> {
    let poses = plane_pose(&surface.homography, intrinsics, size_px, width_mm)?;
    let [w, h] = size_px;
    let unit_px = math::sqrt(w * w + h * h) / 2.0;
    let unit_mm = width_mm / w * unit_px;
    let mut grid = Grid { intrinsics, points: [([0.0; 2], [0.0; 2]); POINTS] };
    for (i, (from, to)) in grid.points.iter_mut().enumerate() {
        let at = |i: usize, side: f32| (i as f32 / (SIDE - 1) as f32 - 0.5) * side / unit_px;
        *from = [at(i % SIDE, w), at(i / SIDE, h)];
        let seen = surface.points[i];
        *to = lens.map_or(Some(seen), |lens| lens.undistort(seen)).ok_or(CameraError::Homography)?;
    }
    let [angle, turn] = surface.direction_and_turn();
    // The turn is that at a distance from the middle, in longer sides of the picture.
    let curvature = turn / (REACH * w.max(h) / unit_px);
    let starts = [(poses.best, 1.0), (poses.best, -1.0), (poses.mirrored, 1.0), (poses.mirrored, -1.0)];
    let fits = starts.map(|(pose, sign)| {
        grid.refine(Rolled { placed: Placed::of(&pose, unit_mm), curvature: sign * curvature, angle })
    });
    let better = |a: (Rolled, f32), b: (Rolled, f32)| if b.1 < a.1 { b } else { a };
    let (found, error_px) = fits.into_iter().fold(fits[0], better);
    let pose = found.placed.pose(unit_mm, error_px);
    let radius = unit_mm / found.curvature;
    let (sin, cos) = math::sin_cos(found.angle);
    let sign = if cos < 0.0 { -1.0 } else { 1.0 };
    let ([x, y], r) = ([-sin * sign, cos * sign], &pose.rotation);
    let axis = [0, 1, 2].map(|i| r[3 * i] * x + r[3 * i + 1] * y);
    let centre_mm = pose.apply([0.0, 0.0, radius]);
    let is_finite = error_px.is_finite() && centre_mm.iter().all(|v| v.is_finite());
    let found = Cylinder { radius_mm: radius.abs(), is_inside: radius < 0.0, axis, centre_mm, pose };
    is_finite.then_some(found).ok_or(CameraError::Homography)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Homography;

    #[test]
    fn a_can_has_its_axis_and_its_radius() {
        let camera = Intrinsics::new(700.0, 700.0, 320.0, 240.0).unwrap();
        let (size, width_mm) = ([300.0, 400.0], 90.0);
        let unit_px = 250.0;
        for (curvature, tilt) in [(0.9, 0.3), (0.5, -0.4), (-0.7, 0.2)] {
            // A can with its axis along y of the picture, turned about x.
            let (sin, cos) = math::sin_cos(tilt);
            let rotation = [1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos];
            let pose = Pose { rotation, translation_mm: [20.0, -10.0, 300.0], error_px: 0.0 };
            let unit_mm = width_mm / size[0] * unit_px;
            let rolled = Rolled { placed: Placed::of(&pose, unit_mm), curvature, angle: 0.0 };
            let at = |i: usize, side: f32| (i as f32 / (SIDE - 1) as f32 - 0.5) * side / unit_px;
            let plane = |x: f32, y: f32| {
                let p = [(x / size[0] - 0.5) * size[0] / unit_px, (y / size[1] - 0.5) * size[1] / unit_px];
                camera.project(rolled.placed.apply([p[0], p[1], 0.0]))
            };
            let corners = [plane(0.0, 0.0), plane(size[0], 0.0), plane(size[0], size[1]), plane(0.0, size[1])];
            let mut surface = Surface::plane(&Homography::onto(&corners, size), size);
            for (i, p) in surface.points.iter_mut().enumerate() {
                let place = [at(i % SIDE, size[0]), at(i / SIDE, size[1])];
                *p = camera.project(rolled.placed.apply(rolled.place(place)));
            }
            let surface = surface.with_turn(0.0, 0.6);
            let found = cylinder(&surface, &camera, None, size, width_mm).unwrap();
            let radius = unit_mm / curvature;
            assert!((found.radius_mm - radius.abs()).abs() < 0.02 * radius.abs(), "{} for {radius}", found.radius_mm);
            assert_eq!(found.is_inside, curvature < 0.0);
            assert!(found.pose.error_px < 0.05, "{}", found.pose.error_px);
            let likeness: f32 = found.axis.iter().zip([0.0, cos, sin]).map(|(a, b)| a * b).sum();
            assert!(likeness > 0.999, "{:?}", found.axis);
            assert!((found.centre_mm[2] - (300.0 + cos * radius)).abs() < 5.0, "{:?}", found.centre_mm);
        }
    }
}
