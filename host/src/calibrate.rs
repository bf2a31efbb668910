//! A camera's intrinsics and lens, from a trained picture that is moved before it.
//!
//! In: views: for each, places of the picture and where the frame shows them. Out: focal lengths, principal point and
//! distortion, with the uncertainty of each, and what each view says. Scale plays no part: any picture does.
//!
//! The start comes from the homographies of the views, with the principal point in the middle (Z. Zhang, *A Flexible
//! New Technique for Camera Calibration*, PAMI 2000). Levenberg and Marquardt's steps then move everything, the pose of
//! each view too, to the least sum of squared distances; a distance counts less the larger it is beside the others.
//!
//! Memory: a matrix of (9 + 6 n)^2 numbers for n views. Cost: some 20 ms for 20 views.

use anyhow::{Result, ensure};
use keygraph_core::{CellMatch, Distortion, Homography, Intrinsics, Lens, plane_pose};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};

/// Minimum number of views.
pub const LEAST_VIEWS: usize = 5;
/// Number of views that are enough: more take time and tell little.
pub const MOST_VIEWS: usize = 60;
/// Minimum number of places of a view.
const LEAST_PLACES: usize = 12;
/// A view whose error is this many times that of the median view is left out.
const FOREIGN: f64 = 3.0;
/// Maximum uncertainty of the focal length, as a share of it.
const UNCERTAIN: f64 = 0.02;
/// Maximum number of steps.
const STEPS: usize = 60;
/// Number of intrinsics, which come before the coefficients.
const INTRINSICS: usize = 4;

/// A kind of lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Brown and Conrady: k1, k2, p1, p2, k3.
    Brown,
    /// Kannala and Brandt: k1 to k4.
    Fisheye,
}

impl Kind {
    /// Names of the numbers, in their order.
    #[must_use]
    pub const fn names(self) -> &'static [&'static str] {
        match self {
            Self::Brown => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"],
            Self::Fisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"],
        }
    }

    const fn numbers(self) -> usize {
        self.names().len()
    }
}

/// A view of the picture.
#[derive(Clone, Debug)]
pub struct View {
    /// From picture px to px of the frame, or of the ideal frame once there is a lens.
    pub homography: Homography,
    /// Width and height of the picture, px.
    pub size: [f32; 2],
    /// Matched places.
    pub matches: Vec<CellMatch>,
}

/// A calibrated camera.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Kind of its lens.
    pub kind: Kind,
    /// The numbers, in the order of [`Kind::names`].
    pub numbers: Vec<f64>,
    /// Standard deviation of each; 0 for one that is held.
    pub uncertainty: Vec<f64>,
    /// Distance of places from where the camera shows them, px: root mean square over the views that count.
    pub error_px: f64,
    /// Distance of the places of each view, px, root mean square; `None` for a view that was left out.
    pub views: Vec<Option<f64>>,
    /// How far from the middle of the frame places were seen, as a share of its half diagonal.
    pub reach: f64,
}

impl Calibrated {
    /// The lens.
    ///
    /// # Errors
    /// When the numbers are those of no lens.
    #[allow(clippy::cast_possible_truncation, reason = "single precision is enough")]
    pub fn lens(&self) -> Result<Lens> {
        let n: Vec<f32> = self.numbers.iter().map(|&v| v as f32).collect();
        let distortion = match self.kind {
            Kind::Brown => Distortion::Brown([n[4], n[5], n[6], n[7], n[8], 0.0, 0.0, 0.0]),
            Kind::Fisheye => Distortion::Fisheye([n[4], n[5], n[6], n[7]]),
        };
        Ok(Lens::new([n[0], n[1], n[2], n[3]], distortion)?)
    }
}

/// A place of the picture in units of its width, where it is seen, px, and its weight.
type Place = ([f64; 2], [f64; 2], f64);

/// What is to be solved: views with their places.
struct Problem {
    kind: Kind,
    views: Vec<Vec<Place>>,
    /// Whether the last coefficient is held at 0.
    holds_last: bool,
}

/// Where a camera shows a point, px: as [`Lens::distort`] does, in double precision, since slopes are differences.
fn project(kind: Kind, n: &[f64], p: Vector3<f64>) -> [f64; 2] {
    let (x, y) = (p.x / p.z, p.y / p.z);
    let [u, v] = match (kind, &n[INTRINSICS..]) {
        (Kind::Brown, &[k1, k2, p1, p2, k3]) => {
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let xy = 2.0 * x * y;
            [x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy]
        }
        (Kind::Fisheye, &[k1, k2, k3, k4]) => {
            let r = x.hypot(y);
            let t = r.atan();
            let t2 = t * t;
            let bent = t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
            let scale = if r > 1e-9 { bent / r } else { 1.0 };
            [x * scale, y * scale]
        }
        _ => [x, y],
    };
    [n[0] * u + n[2], n[1] * v + n[3]]
}

impl Problem {
    /// Distances of the places of a view from where the camera shows them, px: x and y of each.
    fn residuals(&self, view: usize, camera: &[f64], pose: &[f64]) -> Vec<f64> {
        let turn = Rotation3::new(Vector3::new(pose[0], pose[1], pose[2]));
        let middle = Vector3::new(pose[3], pose[4], pose[5]);
        let off = |&([x, y], seen, _): &Place| {
            let at = project(self.kind, camera, turn * Vector3::new(x, y, 0.0) + middle);
            [at[0] - seen[0], at[1] - seen[1]]
        };
        self.views[view].iter().flat_map(off).collect()
    }

    /// The sum of all squared distances, each weighted by `weights`.
    fn cost(&self, x: &DVector<f64>, weights: &[Vec<f64>]) -> f64 {
        let n = self.kind.numbers();
        let of = |view: usize| {
            let r = self.residuals(view, &x.as_slice()[..n], &x.as_slice()[n + 6 * view..][..6]);
            r.iter().zip(&weights[view]).map(|(r, w)| w * r * r).sum::<f64>()
        };
        (0..self.views.len()).map(of).sum()
    }

    /// Weights of the distances: small for those that are large beside the others.
    fn weights(&self, x: &DVector<f64>) -> Vec<Vec<f64>> {
        let n = self.kind.numbers();
        let camera = &x.as_slice()[..n];
        let all: Vec<Vec<f64>> =
            (0..self.views.len()).map(|v| self.residuals(v, camera, &x.as_slice()[n + 6 * v..][..6])).collect();
        let mut sizes: Vec<f64> = all.iter().flatten().map(|r| r.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let scale = (3.0 * sizes.get(sizes.len() / 2).copied().unwrap_or(1.0)).max(0.05);
        let weigh = |(view, r): (usize, Vec<f64>)| {
            let weight = |(i, xy): (usize, &[f64])| {
                let far = (xy[0] * xy[0] + xy[1] * xy[1]) / (scale * scale);
                [self.views[view][i].2 / ((1.0 + far) * (1.0 + far)); 2]
            };
            r.chunks_exact(2).enumerate().flat_map(weight).collect()
        };
        all.into_iter().enumerate().map(weigh).collect()
    }

    /// The normal equations at `x`: matrix and right side.
    fn equations(&self, x: &DVector<f64>, weights: &[Vec<f64>]) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.kind.numbers();
        let mut matrix = DMatrix::zeros(x.len(), x.len());
        let mut right = DVector::zeros(x.len());
        for (view, weights) in weights.iter().enumerate() {
            let own: Vec<f64> = x.as_slice()[..n].iter().chain(&x.as_slice()[n + 6 * view..][..6]).copied().collect();
            let at = |own: &[f64]| self.residuals(view, &own[..n], &own[n..]);
            let place = |k: usize| if k < n { k } else { n + 6 * view + k - n };
            let r = at(&own);
            let slopes: Vec<Vec<f64>> = (0..own.len())
                .map(|k| {
                    let step = 1e-6 * own[k].abs().max(1.0);
                    let [more, less] = [step, -step].map(|step| {
                        let mut moved = own.clone();
                        moved[k] += step;
                        at(&moved)
                    });
                    more.iter().zip(less).map(|(a, b)| (a - b) / (2.0 * step)).collect()
                })
                .collect();
            for (i, a) in slopes.iter().enumerate() {
                for (j, b) in slopes.iter().enumerate().skip(i) {
                    let sum: f64 = a.iter().zip(b).zip(weights).map(|((a, b), w)| w * a * b).sum();
                    matrix[(place(i), place(j))] += sum;
                    if i != j {
                        matrix[(place(j), place(i))] += sum;
                    }
                }
                right[place(i)] -= a.iter().zip(&r).zip(weights).map(|((a, r), w)| w * a * r).sum::<f64>();
            }
        }
        if self.holds_last {
            let last = n - 1;
            matrix.row_mut(last).fill(0.0);
            matrix.column_mut(last).fill(0.0);
            matrix[(last, last)] = 1.0;
            right[last] = 0.0;
        }
        (matrix, right)
    }

    /// The least sum of squares from `x` on.
    fn solve(&self, mut x: DVector<f64>) -> DVector<f64> {
        let mut damping = 1e-3;
        let mut weights = self.weights(&x);
        for _ in 0..STEPS {
            let (matrix, right) = self.equations(&x, &weights);
            let before = self.cost(&x, &weights);
            let mut damped = matrix.clone();
            for i in 0..x.len() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&right)) else {
                damping *= 10.0;
                continue;
            };
            let next = &x + &step;
            let after = self.cost(&next, &weights);
            // A comparison with NaN is false.
            if after < before {
                x = next;
                damping = (damping / 5.0).max(1e-12);
                weights = self.weights(&x);
                if before - after < 1e-9 * before {
                    break;
                }
            } else if damping > 1e6 {
                break;
            } else {
                damping *= 10.0;
            }
        }
        x
    }
}

/// The focal length that the homographies of the views agree with best, for a principal point in the middle of the
/// frame.
fn first_focal(views: &[View], [width, height]: [u32; 2]) -> f64 {
    let centre = [width as f32 / 2.0 - 0.5, height as f32 / 2.0 - 0.5];
    let (mut num, mut den) = (0.0, 0.0);
    for view in views {
        let unit = Homography::affine([view.size[0], 0.0, 0.0, 0.0, view.size[0], 0.0]);
        let shift = Homography::affine([1.0, 0.0, -centre[0], 0.0, 1.0, -centre[1]]);
        let h = shift.after(&view.homography).after(&unit).0.map(f64::from);
        let scale = (h[0] * h[0] + h[3] * h[3] + h[1] * h[1] + h[4] * h[4]).max(1e-9);
        let rows = [
            [h[0] * h[1] + h[3] * h[4], h[6] * h[7]],
            [h[0] * h[0] + h[3] * h[3] - h[1] * h[1] - h[4] * h[4], h[6] * h[6] - h[7] * h[7]],
        ];
        for [a, b] in rows {
            num -= a * b / (scale * scale);
            den += a * a / (scale * scale);
        }
    }
    let usual = f64::from(width.max(height));
    // Of 1 / f^2.
    let found = (num / den).recip().sqrt();
    if found.is_finite() { found.clamp(usual / 4.0, usual * 4.0) } else { usual }
}

/// Calibrates a camera whose frames have `size` px. `start` is what is known of it.
///
/// # Errors
/// When there are too few views, or they are too alike.
pub fn calibrate(kind: Kind, views: &[View], size: [u32; 2], start: Option<&Calibrated>) -> Result<Calibrated> {
    let mut camera = start.map_or_else(|| first(kind, views, size), |known| known.numbers.clone());
    let last = kind.numbers() - 1;
    if kind == Kind::Brown {
        camera[last] = 0.0;
    }
    // Once to find the views that do not fit, and once without them.
    let used = (0..views.len()).filter(|&i| views[i].matches.len() >= LEAST_PLACES).collect();
    let Fitted { camera, used, errors, .. } = fitted(kind, views, used, camera, kind == Kind::Brown)?;
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let most = FOREIGN * sorted[sorted.len() / 2].max(0.1);
    let used = used.into_iter().zip(errors).filter(|(_, error)| *error <= most).map(|(i, _)| i).collect();
    let mut found = fitted(kind, views, used, camera, false)?;
    if kind == Kind::Brown && found.camera[last].abs() < 2.0 * found.uncertainty[last] {
        // What cannot be told from nothing is nothing: it would bend the corners of the frame.
        found.camera[last] = 0.0;
        found = fitted(kind, views, found.used, found.camera, true)?;
    }
    let Fitted { camera, uncertainty, used, errors } = found;
    let doubts = [0, 1].map(|i| uncertainty[i] / camera[i].abs());
    let doubt = doubts.into_iter().fold(0.0, f64::max);
    // A comparison with NaN is false.
    ensure!(
        doubts.iter().all(|&doubt| doubt < UNCERTAIN),
        "the views are too alike: the focal length is uncertain by {:.0} %; show the picture tilted by 30 degrees to each side",
        100.0 * doubt
    );
    let error_px = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    let mut per_view = vec![None; views.len()];
    used.iter().zip(&errors).for_each(|(&i, &e)| per_view[i] = Some(e));
    Ok(Calibrated {
        kind,
        numbers: camera,
        uncertainty,
        error_px,
        views: per_view,
        reach: reach(used.iter().map(|&i| &views[i]), size),
    })
}

/// A camera that fits views.
struct Fitted {
    camera: Vec<f64>,
    uncertainty: Vec<f64>,
    /// The views that it was fitted to, and the error of each, px.
    used: Vec<usize>,
    errors: Vec<f64>,
}

/// Fits a camera to those of the views `used` that have a pose, from `camera` on.
fn fitted(kind: Kind, views: &[View], used: Vec<usize>, camera: Vec<f64>, holds_last: bool) -> Result<Fitted> {
    let poses = used.into_iter().filter_map(|i| Some((i, pose(&views[i], &camera).ok()?)));
    let (used, poses): (Vec<usize>, Vec<[f64; 6]>) = poses.unzip();
    ensure!(
        used.len() >= LEAST_VIEWS,
        "{} views can be used, and {LEAST_VIEWS} are needed: show the picture from the front and tilted by 30 degrees to each \
         side, near and far, in the middle and in the corners of the frame",
        used.len()
    );
    let problem = Problem { kind, views: used.iter().map(|&i| places(&views[i])).collect(), holds_last };
    let (n, mut x) = (kind.numbers(), camera);
    x.extend(poses.as_flattened());
    let x = problem.solve(DVector::from_vec(x));
    let camera = x.as_slice()[..n].to_vec();
    let error = |view: usize| {
        let r = problem.residuals(view, &camera, &x.as_slice()[n + 6 * view..][..6]);
        (r.iter().map(|r| r * r).sum::<f64>() * 2.0 / r.len() as f64).sqrt()
    };
    let errors = (0..used.len()).map(error).collect();
    let weights = problem.weights(&x);
    let (matrix, _) = problem.equations(&x, &weights);
    let total: f64 = weights.iter().flatten().sum();
    let unknowns = x.len() - usize::from(holds_last);
    let variance = problem.cost(&x, &weights) / (total - unknowns as f64).max(1.0);
    // Of what the views leave open, nothing is known.
    let inverse = matrix.cholesky().map(|c| c.inverse());
    let of = |i: usize| inverse.as_ref().map_or(f64::INFINITY, |m| (m[(i, i)] * variance).sqrt());
    let mut uncertainty: Vec<f64> = (0..n).map(of).collect();
    if holds_last {
        uncertainty[n - 1] = 0.0;
    }
    Ok(Fitted { camera, uncertainty, used, errors })
}

/// The numbers that a calibration starts from.
fn first(kind: Kind, views: &[View], size: [u32; 2]) -> Vec<f64> {
    let focal = first_focal(views, size);
    let centre = size.map(|v| f64::from(v) / 2.0 - 0.5);
    let mut numbers = vec![focal, focal, centre[0], centre[1]];
    numbers.resize(kind.numbers(), 0.0);
    numbers
}

/// How far from the middle of the frame places were seen, as a share of its half diagonal.
fn reach<'a>(views: impl Iterator<Item = &'a View>, [width, height]: [u32; 2]) -> f64 {
    let half = [width as f32 / 2.0, height as f32 / 2.0];
    let far = |m: &CellMatch| (m.frame[0] - half[0]).hypot(m.frame[1] - half[1]);
    f64::from(views.flat_map(|v| &v.matches).map(far).fold(0.0, f32::max) / half[0].hypot(half[1]))
}

fn places(view: &View) -> Vec<Place> {
    let [w, h] = view.size;
    let of = |m: &CellMatch| {
        let at = [(m.picture[0] - w / 2.0) / w, (m.picture[1] - h / 2.0) / w];
        (at.map(f64::from), m.frame.map(f64::from), f64::from(m.weight))
    };
    view.matches.iter().map(of).collect()
}

/// The pose of a view: a rotation vector, and the middle of the picture in widths of it.
#[allow(clippy::cast_possible_truncation, reason = "a start")]
fn pose(view: &View, camera: &[f64]) -> Result<[f64; 6]> {
    let intrinsics = Intrinsics::new(camera[0] as f32, camera[1] as f32, camera[2] as f32, camera[3] as f32)?;
    let found = plane_pose(&view.homography, &intrinsics, view.size, 1.0)?.best;
    let turn = Rotation3::from_matrix(&Matrix3::from_row_slice(&found.rotation.map(f64::from))).scaled_axis();
    let [x, y, z] = found.translation_mm.map(f64::from);
    Ok([turn.x, turn.y, turn.z, x, y, z])
}
