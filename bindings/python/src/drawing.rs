//! Pictures of results.
//!
//! In: a frame, detections, poses. Out: the frame with outlines, names and axes, as an array or a PNG.
//! Memory: a copy of the frame. Cost: a pass over the pixels, and the lines.

use std::path::PathBuf;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use keygraph::annotate::{Outline, draw_axes, draw_label, draw_outline};
use keygraph::canvas::Canvas;
use keygraph::output::plain;
use keygraph::picture::{EXTENSIONS, Picture, Pixels, extension, read_picture};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{exception, frame_error};
use crate::frame::{Reading, frame};
use crate::result::Detection;
use crate::sensor::picture;
use crate::space::Pose;

/// The pixels of RGB or gray as an array.
pub fn array<'py>(py: Python<'py>, picture: &Picture) -> PyResult<Bound<'py, PyAny>> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    match &picture.pixels {
        Pixels::Gray8(bytes) => Ok(PyArray1::from_slice(py, bytes).reshape([height, width])?.into_any()),
        Pixels::Rgb8(bytes) => Ok(PyArray1::from_slice(py, bytes).reshape([height, width, 3])?.into_any()),
        Pixels::I420(_) => rgb(py, &Canvas::from_picture(picture)),
    }
}

/// A canvas as an array of shape (H, W, 3).
pub fn rgb<'py>(py: Python<'py>, canvas: &Canvas) -> PyResult<Bound<'py, PyAny>> {
    let shape = [canvas.height() as usize, canvas.width() as usize, 3];
    Ok(PyArray1::from_slice(py, canvas.rgb()).reshape(shape)?.into_any())
}

/// Reads a picture (PNG, JPEG, WebP, BMP, TIFF, GIF; AVIF and HEIC by ffmpeg) as an array of uint8, as the command line sees it.
#[pyfunction]
pub fn imread(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let picture = py.detach(|| read_picture(&path)).map_err(|e| exception(&e))?;
    array(py, &picture)
}

/// Writes a frame as a PNG or JPEG picture, whole or not at all; the extension of `path` chooses.
///
/// Args:
///     path: The file to write: `.png`, `.jpg` or `.jpeg`.
///     frame: As for Detector.detect.
///     order: `"rgb"`, or `"bgr"` as OpenCV has it.
///
/// Raises:
///     ValueError: The extension is another one.
///     OSError: The file cannot be written.
#[pyfunction]
#[pyo3(signature = (path, frame, *, order="rgb"))]
pub fn imwrite(path: PathBuf, frame: &Bound<'_, PyAny>, order: &str) -> PyResult<()> {
    if !EXTENSIONS.contains(&extension(&path).as_str()) {
        let path = path.display();
        return Err(PyValueError::new_err(format!("path: expected a name with .png, .jpg or .jpeg, got {path}")));
    }
    let given = self::frame(frame, &Reading::new(order, None, None, None)?)?;
    let view = given.view()?;
    let canvas = frame.py().detach(|| picture(&view).map(|p| Canvas::from_picture(&p))).map_err(frame_error)?;
    frame.py().detach(|| canvas.save(&path)).map_err(|e| PyOSError::new_err(format!("{e:#}")))
}

/// Draws outlines, names and scores into a copy of a frame, and the axes of poses: x red, y green, z blue.
///
/// Args:
///     frame: As for Detector.detect.
///     detections: What is drawn. The white line is the top of the object.
///     poses: Poses, or None, whose axes are drawn.
///     order, format, size, stride: How the frame is read, as for Detector.detect.
///
/// Returns:
///     An array of uint8 of shape (H, W, 3), in the order of RGB.
#[pyfunction]
#[pyo3(signature = (frame, detections, *, poses=None, order="rgb", format=None, size=None, stride=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
pub fn draw<'py>(
    frame: &Bound<'py, PyAny>,
    detections: Vec<Py<Detection>>,
    poses: Option<Vec<Option<Py<Pose>>>>,
    order: &str,
    format: Option<&str>,
    size: Option<(usize, usize)>,
    stride: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = frame.py();
    let reading = Reading::new(order, format, size, stride)?;
    let given = self::frame(frame, &reading)?;
    let view = given.view()?;
    let outlines: Vec<Outline> = detections.iter().map(|d| outline(d.get())).collect();
    let axes: Vec<[[f32; 2]; 4]> = poses.iter().flatten().flatten().map(|p| p.get().ends()).collect();
    let canvas = py.detach(|| {
        let mut canvas = Canvas::from_picture(&picture(&view)?);
        outlines.iter().for_each(|o| draw_outline(&mut canvas, o));
        outlines.iter().for_each(|o| draw_label(&mut canvas, o));
        axes.iter().for_each(|&ends| draw_axes(&mut canvas, ends));
        Ok(canvas)
    });
    rgb(py, &canvas.map_err(frame_error)?)
}

fn outline(detection: &Detection) -> Outline {
    let core = detection.core();
    Outline {
        corners: core.corners,
        surface: detection.bent().copied(),
        label: plain(&detection.label()).into_owned(),
        colour_index: usize::from(core.object),
    }
}

/// An array of pixels as a PNG.
#[pyfunction]
#[pyo3(name = "_png")]
pub fn png<'py>(frame: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
    let py = frame.py();
    let given = self::frame(frame, &Reading::new("rgb", None, None, None)?)?;
    let view = given.view()?;
    let bytes = py.detach(|| {
        let canvas = Canvas::from_picture(&picture(&view).map_err(|e| e.to_string())?);
        encoded(&canvas).map_err(|e| e.to_string())
    });
    Ok(PyBytes::new(py, &bytes.map_err(PyValueError::new_err)?))
}

/// A canvas as the bytes of a PNG.
pub fn encoded(canvas: &Canvas) -> image::ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(canvas.rgb(), canvas.width(), canvas.height(), ExtendedColorType::Rgb8)?;
    Ok(bytes)
}
