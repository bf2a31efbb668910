//! Poses of detections in space.
//!
//! In: a detection, the intrinsics of the camera, the true width. Out: a [`Pose`]. Memory: some numbers.
//! Cost: some microseconds.

use keygraph::lens::distortion as distortion_of;
use keygraph::report::plane_pose_object;
use keygraph_core::{Intrinsics, Lens, PlanePose, plane_pose};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::errors::camera_error;
use crate::json::object;
use crate::result::Detection;

/// Where an object is in space.
#[pyclass(frozen, module = "keygraph")]
#[derive(Debug)]
pub struct Pose {
    poses: PlanePose,
    /// Whether this is the mirrored one of the poses.
    is_mirrored: bool,
    intrinsics: Intrinsics,
    width_mm: f32,
    /// The lens that the frame was seen through.
    lens: Option<Lens>,
}

impl Pose {
    fn own(&self) -> &keygraph_core::Pose {
        if self.is_mirrored { &self.poses.mirrored } else { &self.poses.best }
    }

    /// The centre of the object, and the ends of its axes, px of the frame.
    pub fn ends(&self) -> [[f32; 2]; 4] {
        let arm = self.width_mm / 2.0;
        let points = [[0.0; 3], [arm, 0.0, 0.0], [0.0, arm, 0.0], [0.0, 0.0, arm]];
        points.map(|p| {
            let p = self.intrinsics.project(self.own().apply(p));
            self.lens.map_or(p, |lens| lens.distort(p))
        })
    }
}

#[pymethods]
impl Pose {
    /// Array of shape (3, 3), float64: from object to camera coordinates.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.own().rotation.map(f64::from)).reshape([3, 3])
    }

    /// Array of shape (3,), float64: the middle of the picture in camera coordinates, mm.
    #[getter]
    fn translation_mm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.own().translation_mm.map(f64::from))
    }

    /// Root mean square distance between the homography and the pose's projection, px.
    #[getter]
    fn error_px(&self) -> f32 {
        self.own().error_px
    }

    /// Whether the mirrored pose may be the true one.
    #[getter]
    fn ambiguous(&self) -> bool {
        self.poses.is_ambiguous()
    }

    /// The pose whose tilt is mirrored.
    #[getter]
    fn mirrored(&self) -> Self {
        Self { is_mirrored: !self.is_mirrored, ..*self }
    }

    /// Array of shape (4, 2), float32: the centre, and the ends of x, y and z, px of the frame.
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        PyArray1::from_slice(py, self.ends().as_flattened()).reshape([4, 2])
    }

    /// The `pose` of the line that `keygraph detect --json` prints.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &plane_pose_object(Some(&self.poses)))
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.own().translation_mm;
        format!(
            "Pose(translation_mm=[{x:.1}, {y:.1}, {z:.1}], error_px={:.3}, ambiguous={})",
            self.own().error_px,
            if self.ambiguous() { "True" } else { "False" }
        )
    }
}

/// Focal lengths and principal point: four numbers, or a camera matrix of shape (3, 3).
pub fn intrinsics_of(given: &Bound<'_, PyAny>) -> PyResult<Intrinsics> {
    let [fx, fy, cx, cy] = match given.extract::<[[f64; 3]; 3]>() {
        Ok([[fx, skew, cx], [zero, fy, cy], last]) => {
            if skew != 0.0 || zero != 0.0 || last != [0.0, 0.0, 1.0] {
                return Err(PyValueError::new_err(
                    "intrinsics: expected a camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew",
                ));
            }
            [fx, fy, cx, cy]
        }
        Err(_) => given.extract::<[f64; 4]>().map_err(|_| {
            PyTypeError::new_err("intrinsics: expected (fx, fy, cx, cy), px, or a camera matrix of shape (3, 3)")
        })?,
    };
    #[allow(clippy::cast_possible_truncation, reason = "px, which f32 holds")]
    Intrinsics::new(fx as f32, fy as f32, cx as f32, cy as f32).map_err(camera_error)
}

/// The camera's lens: intrinsics, coefficients as OpenCV has them, and whether they are those of a fisheye lens.
pub fn lens_of(
    intrinsics: Option<&Bound<'_, PyAny>>,
    distortion: Option<&Bound<'_, PyAny>>,
    fisheye: bool,
) -> PyResult<Option<Lens>> {
    let (Some(intrinsics), Some(given)) = (intrinsics, distortion) else {
        if intrinsics.is_some() || distortion.is_some() || fisheye {
            return Err(PyValueError::new_err("a lens needs both intrinsics and distortion"));
        }
        return Ok(None);
    };
    let numbers = intrinsics_of(intrinsics)?.numbers();
    // OpenCV gives a matrix of one row or one column.
    let rows = || given.extract::<Vec<Vec<f32>>>().map(|rows| rows.concat());
    let k = given.extract::<Vec<f32>>().or_else(|_| rows()).map_err(|_| {
        PyTypeError::new_err("distortion: expected a list of numbers in OpenCV's order, or an array of them")
    })?;
    let distortion = distortion_of(fisheye, &k).ok_or_else(|| {
        let known =
            if fisheye { "4 coefficients of a fisheye lens" } else { "4, 5 or 8 coefficients in OpenCV's order" };
        PyValueError::new_err(format!("distortion: expected {known}, got {}", k.len()))
    })?;
    Lens::new(numbers, distortion).map(Some).map_err(|e| PyValueError::new_err(format!("distortion: {e}")))
}

/// Where a detection is in space: six degrees of freedom.
///
/// Both coordinate systems have x to the right, y down and z away from the viewer. The origin of the
/// object is the middle of its picture. Give the lens to the detector, if it is not free of distortion.
///
/// Args:
///     detection: A detection, whose frame was not mirrored.
///     intrinsics: (fx, fy, cx, cy), px of the frame, or a camera matrix of shape (3, 3).
///     width_mm: True width of the object, mm.
///
/// Returns:
///     The pose that fits best; None when no pose gives this homography, and when the object is bent. Near the front two poses look
///     alike: see `Pose.ambiguous` and `Pose.mirrored`.
#[pyfunction]
pub fn pose(detection: &Bound<'_, Detection>, intrinsics: &Bound<'_, PyAny>, width_mm: f32) -> PyResult<Option<Pose>> {
    let detection = detection.get();
    let intrinsics = intrinsics_of(intrinsics)?;
    if !(width_mm > 0.0 && width_mm.is_finite()) {
        return Err(PyValueError::new_err(format!("width_mm: expected a number of mm above 0, got {width_mm}")));
    }
    if detection.is_mirrored() {
        return Err(PyValueError::new_err("a detection of mirrored frames has no pose: leave mirror=True out"));
    }
    let core = detection.core();
    let object = detection.model().view().object(usize::from(core.object));
    let size_px = [object.width as f32, object.height as f32];
    let (surface, lens) = (detection.bent(), detection.lens());
    if surface.map_or(lens.is_some(), |s| s.is_bent) {
        return Ok(None);
    }
    let homography = surface.map_or(&core.homography, |s| &s.homography);
    let poses = plane_pose(homography, &intrinsics, size_px, width_mm).ok();
    Ok(poses.map(|poses| Pose { poses, is_mirrored: false, intrinsics, width_mm, lens }))
}
