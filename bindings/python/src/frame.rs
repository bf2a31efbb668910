//! Frames of Python: numpy arrays, PIL images, paths and bytes.
//!
//! In: an object of Python. Out: a [`Given`], whose pixels can be read while the interpreter is
//! released. Memory: none for rows whose pixels stand one after the other in RGB, gray or a camera's
//! format. Other arrays are copied, and so are pictures that are read or converted. Cost: at most one
//! pass over the pixels.

use std::path::PathBuf;
use std::slice;

use image::{DynamicImage, RgbaImage};
use keygraph::picture::{Picture, Pixels, flatten_onto_white, read_picture};
use keygraph_core::PixelFormat;
use numpy::ndarray::{ArrayView2, ArrayView3, Axis};
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods, prelude::*};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyMemoryView, PyString};

use crate::errors::exception;

/// The formats of raw bytes, by name.
const FORMATS: [(&str, PixelFormat); 8] = [
    ("rgb", PixelFormat::Rgb8),
    ("gray", PixelFormat::Gray8),
    ("yuyv", PixelFormat::Yuyv),
    ("uyvy", PixelFormat::Uyvy),
    ("nv12", PixelFormat::Nv12),
    ("i420", PixelFormat::I420),
    ("rgb565", PixelFormat::Rgb565),
    ("rgb565be", PixelFormat::Rgb565Be),
];

/// How the arguments of a call say that pixels are to be read.
#[derive(Debug)]
pub struct Reading {
    /// Whether arrays have blue first.
    bgr: bool,
    format: Option<PixelFormat>,
    size: Option<(usize, usize)>,
    stride: Option<usize>,
}

impl Reading {
    /// Checks the arguments `order`, `format`, `size` and `stride`.
    pub fn new(
        order: &str,
        format: Option<&str>,
        size: Option<(usize, usize)>,
        stride: Option<usize>,
    ) -> PyResult<Self> {
        let bgr = match order {
            "rgb" => false,
            "bgr" => true,
            _ => return Err(PyValueError::new_err(format!("order: expected \"rgb\" or \"bgr\", got \"{order}\""))),
        };
        let format = format.map(named).transpose()?;
        if format.is_none() && (size.is_some() || stride.is_some()) {
            return Err(PyValueError::new_err("size and stride go with format: give format=\"yuyv\" or another"));
        }
        if format.is_some() && bgr {
            return Err(PyValueError::new_err(
                "order=\"bgr\" goes with arrays of shape (H, W, 3), and not with format",
            ));
        }
        Ok(Self { bgr, format, size, stride })
    }
}

impl Reading {
    /// The arguments that are not the usual ones, to read the frame once more.
    pub fn arguments<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let arguments = PyDict::new(py);
        if self.bgr {
            arguments.set_item("order", "bgr")?;
        }
        if let Some((name, _)) = FORMATS.iter().find(|(_, format)| Some(*format) == self.format) {
            arguments.set_item("format", name)?;
            arguments.set_item("size", self.size)?;
            arguments.set_item("stride", self.stride)?;
        }
        Ok(arguments)
    }
}

/// The format with a name.
fn named(name: &str) -> PyResult<PixelFormat> {
    let found = FORMATS.iter().find(|(known, _)| *known == name).map(|(_, format)| *format);
    found.ok_or_else(|| {
        let all: Vec<String> = FORMATS.iter().map(|(known, _)| format!("\"{known}\"")).collect();
        PyValueError::new_err(format!("format: expected one of {}, got \"{name}\"", all.join(", ")))
    })
}

/// A frame as it was given. It keeps the object of Python alive.
pub enum Given<'py> {
    /// A picture that was read or converted.
    Picture(Picture),
    /// An array of pixels.
    Array(PyReadonlyArrayDyn<'py, u8>, bool),
    /// Raw bytes.
    Bytes(Bound<'py, PyBytes>, Layout),
    /// An array of raw bytes.
    RawArray(PyReadonlyArrayDyn<'py, u8>, Layout),
}

/// How raw bytes are laid out.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Bytes from a row to the next; `None` without anything between rows.
    pub stride: Option<usize>,
}

/// Pixels that can be read without the interpreter.
#[derive(Debug)]
pub enum View<'a> {
    /// Bytes that the core reads as they are.
    Raw(Layout, &'a [u8]),
    /// A picture of its own.
    Picture(&'a Picture),
    /// Colour whose samples are not one after the other, or not in the order of RGB; the flag says that
    /// blue comes first.
    Colour(ArrayView3<'a, u8>, bool),
    /// Gray whose samples are not one after the other.
    Gray(ArrayView2<'a, u8>),
}

/// Reads an argument as a frame.
pub fn frame<'py>(object: &Bound<'py, PyAny>, reading: &Reading) -> PyResult<Given<'py>> {
    if let Ok(array) = object.cast::<PyUntypedArray>() {
        return of_array(array, reading);
    }
    if let Ok(bytes) = object.cast::<PyBytes>() {
        let layout = layout(reading, None)?;
        return Ok(Given::Bytes(bytes.clone(), layout));
    }
    if object.is_instance_of::<PyByteArray>() || object.is_instance_of::<PyMemoryView>() {
        layout(reading, None)?;
        let array = object.py().import("numpy")?.call_method1("frombuffer", (object, "uint8"))?;
        return of_array(array.cast::<PyUntypedArray>()?, reading);
    }
    if let Some(path) = path_of(object)? {
        no_format(reading, "a path")?;
        let read = object.py().detach(|| read_picture(&path));
        return read.map(Given::Picture).map_err(|e| exception(&e));
    }
    if object.hasattr("mode")? && object.hasattr("tobytes")? && object.hasattr("convert")? {
        no_format(reading, "a PIL image")?;
        return of_image(object);
    }
    let class = object.get_type().name()?;
    Err(PyTypeError::new_err(format!(
        "expected a numpy array of uint8, a PIL image, a path, or bytes with format= and size=; got {class}"
    )))
}

/// The path that an object stands for: a string or a `os.PathLike`.
pub fn path_of(object: &Bound<'_, PyAny>) -> PyResult<Option<PathBuf>> {
    if object.is_instance_of::<PyString>() || object.hasattr("__fspath__")? {
        return object.extract().map(Some);
    }
    Ok(None)
}

fn no_format(reading: &Reading, what: &str) -> PyResult<()> {
    match reading.format {
        Some(_) => {
            Err(PyValueError::new_err(format!("format= goes with bytes and arrays of bytes, and not with {what}")))
        }
        None => Ok(()),
    }
}

/// A PIL image. What is transparent is mixed with white, as in files.
fn of_image<'py>(image: &Bound<'py, PyAny>) -> PyResult<Given<'py>> {
    let (width, height): (u32, u32) = image.getattr("size")?.extract()?;
    let mode: String = image.getattr("mode")?.extract()?;
    let transparent = mode.ends_with('A') || mode.ends_with('a') || image.getattr("info")?.contains("transparency")?;
    let target = match &mode[..] {
        _ if transparent => "RGBA",
        "1" | "L" => "L",
        "I" | "I;16" | "F" => {
            return Err(PyValueError::new_err(format!(
                "a PIL image of mode \"{mode}\" has more than 8 bits a sample: convert it to \"L\" or \"RGB\" first"
            )));
        }
        _ => "RGB",
    };
    let bytes = image.call_method1("convert", (target,))?.call_method0("tobytes")?;
    let bytes = bytes.cast::<PyBytes>()?.as_bytes().to_vec();
    let pixels = match target {
        "L" => Pixels::Gray8(bytes),
        "RGB" => Pixels::Rgb8(bytes),
        _ => {
            let image = RgbaImage::from_raw(width, height, bytes)
                .ok_or_else(|| PyValueError::new_err("the PIL image has another number of bytes than its size says"))?;
            return Ok(Given::Picture(flatten_onto_white(DynamicImage::ImageRgba8(image)).0));
        }
    };
    Ok(Given::Picture(Picture { width, height, pixels }))
}

/// An array of pixels, or of raw bytes.
fn of_array<'py>(array: &Bound<'py, PyUntypedArray>, reading: &Reading) -> PyResult<Given<'py>> {
    let Ok(bytes) = array.cast::<PyArrayDyn<u8>>() else {
        return Err(PyTypeError::new_err(format!(
            "expected an array of dtype uint8, got {}: for values from 0 to 1 pass (frame * 255).astype(np.uint8)",
            array.dtype()
        )));
    };
    let shape = array.shape();
    if reading.format.is_some() {
        let layout = layout(reading, Some((shape, array.strides())))?;
        return Ok(Given::RawArray(bytes.try_readonly()?, layout));
    }
    match *shape {
        [_, _] | [_, _, 1] if reading.bgr => Err(PyValueError::new_err(format!(
            "order=\"bgr\" expects an array of shape (H, W, 3), got {}",
            tuple(shape)
        ))),
        [_, _] | [_, _, 1 | 3] => Ok(Given::Array(bytes.try_readonly()?, reading.bgr)),
        _ => Err(PyValueError::new_err(format!(
            "expected an array of shape (H, W, 3), (H, W) or (H, W, 1), got {}{}",
            tuple(shape),
            hint(shape)
        ))),
    }
}

/// What may be wrong with a shape.
fn hint(shape: &[usize]) -> &'static str {
    match *shape {
        [_, _, 4] => ": leave opacity out, frame[..., :3]",
        [_, _, 2] => ": for frames of two bytes a pixel give format=\"yuyv\" or another",
        [1 | 3, _, _] => ": channels come last, frame.transpose(1, 2, 0)",
        [_, _, _, _] => ": pass the frames one by one",
        [_] => ": give format= and size= for raw bytes",
        _ => "",
    }
}

fn tuple(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    if shape.len() == 1 { format!("({},)", sides[0]) } else { format!("({})", sides.join(", ")) }
}

/// The layout of raw bytes, by the arguments, or else by the shape of their array (shape and strides).
fn layout(reading: &Reading, array: Option<(&[usize], &[isize])>) -> PyResult<Layout> {
    let Some(format) = reading.format else {
        return Err(PyValueError::new_err(
            "bytes have no shape: give format=\"yuyv\" (or another) and size=(width, height)",
        ));
    };
    let whole = |(width, height): (usize, usize)| Layout { format, width, height, stride: reading.stride };
    if let Some(size) = reading.size {
        return Ok(whole(size));
    }
    let pixel = format.row_bytes(2) / 2;
    match array {
        // Rows of pixels, perhaps with something between the rows.
        Some((&[height, width, depth], &[row, step, 1]))
            if depth == pixel && step.unsigned_abs() == pixel && row > 0 =>
        {
            Ok(Layout { stride: Some(row.unsigned_abs()), ..whole((width, height)) })
        }
        Some((&[rows, row], _)) => {
            let planes = matches!(format, PixelFormat::Nv12 | PixelFormat::I420);
            Ok(whole((row / pixel, if planes { rows * 2 / 3 } else { rows })))
        }
        _ => Err(PyValueError::new_err(
            "size is missing: give size=(width, height), px, or an array of shape (H, W, 2) for formats of two bytes a pixel, or of shape (rows, bytes of a row)",
        )),
    }
}

impl Given<'_> {
    /// The pixels, without a copy.
    pub fn view(&self) -> PyResult<View<'_>> {
        match self {
            Self::Picture(picture) => Ok(View::Picture(picture)),
            Self::Bytes(bytes, layout) => Ok(View::Raw(*layout, bytes.as_bytes())),
            Self::RawArray(array, layout) => raw(array, layout),
            Self::Array(array, bgr) => pixels(array, *bgr),
        }
    }
}

/// Raw bytes of an array.
fn raw<'a>(array: &'a PyReadonlyArrayDyn<'_, u8>, layout: &Layout) -> PyResult<View<'a>> {
    if let Ok(bytes) = array.as_slice() {
        return Ok(View::Raw(*layout, bytes));
    }
    match (array.shape(), layout.stride) {
        (&[_, width, depth], Some(stride)) => Ok(View::Raw(*layout, span(array, stride, width * depth))),
        _ => Err(PyValueError::new_err("an array of raw bytes must be contiguous: pass np.ascontiguousarray(frame)")),
    }
}

/// The pixels of an array of shape (H, W), (H, W, 1) or (H, W, 3).
fn pixels<'a>(array: &'a PyReadonlyArrayDyn<'_, u8>, bgr: bool) -> PyResult<View<'a>> {
    let (shape, strides) = (array.shape(), array.strides());
    let (height, width) = (shape[0], shape[1]);
    let depth = shape.get(2).copied().unwrap_or(1);
    let format = if depth == 3 { PixelFormat::Rgb8 } else { PixelFormat::Gray8 };
    let row = width * depth;
    let together = usize::try_from(strides[1]) == Ok(depth) && (depth == 1 || strides[2] == 1);
    if !bgr
        && together
        && height > 0
        && let Ok(stride) = usize::try_from(strides[0])
        && stride >= row
    {
        let layout = Layout { format, width, height, stride: Some(stride) };
        return Ok(View::Raw(layout, span(array, stride, row)));
    }
    let wrong = |e: numpy::ndarray::ShapeError| PyValueError::new_err(e.to_string());
    let view = array.as_array();
    if depth == 3 {
        return Ok(View::Colour(view.into_dimensionality().map_err(wrong)?, bgr));
    }
    let flat = if view.ndim() == 3 { view.index_axis_move(Axis(2), 0) } else { view };
    Ok(View::Gray(flat.into_dimensionality().map_err(wrong)?))
}

/// The bytes from the first pixel of an array to the last, with what lies between its rows. `row` is
/// the number of bytes of a row, and `stride` that from a row to the next, which is at least `row`.
/// Within a row, the bytes stand one after the other.
fn span<'a>(array: &'a PyReadonlyArrayDyn<'_, u8>, stride: usize, row: usize) -> &'a [u8] {
    let height = array.shape()[0];
    if height == 0 || row == 0 {
        return &[];
    }
    // SAFETY: The first and the last byte are elements of the array, and the strides are positive, so
    // that all bytes between them lie in the one allocation that the array is a view of. They are
    // initialised: numpy's allocations of bytes may be read as a whole. The array is borrowed for
    // reading while the slice lives, and holds its memory. As with any array that the interpreter is
    // released for, other threads of Python must not write to it meanwhile; if they do, the values of
    // pixels are those of either time, and nothing but pixels depends on them.
    #[allow(unsafe_code)]
    unsafe {
        slice::from_raw_parts(array.as_array().as_ptr(), stride * (height - 1) + row)
    }
}

impl View<'_> {
    /// Width and height, px.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Raw(layout, _) => (layout.width, layout.height),
            Self::Picture(picture) => (picture.width as usize, picture.height as usize),
            Self::Colour(view, _) => (view.shape()[1], view.shape()[0]),
            Self::Gray(view) => (view.shape()[1], view.shape()[0]),
        }
    }

    /// Puts the samples of RGB or gray one after the other into `out`. Returns their format; `None` when
    /// they are elsewhere already.
    pub fn gather(&self, out: &mut Vec<u8>) -> Option<PixelFormat> {
        match self {
            Self::Colour(view, bgr) => {
                gather(view.reborrow(), *bgr, out);
                Some(PixelFormat::Rgb8)
            }
            Self::Gray(view) => {
                out.clear();
                out.extend(view.iter());
                Some(PixelFormat::Gray8)
            }
            _ => None,
        }
    }
}

/// Copies colour in the order of RGB into `out`; `bgr` says that blue comes first.
fn gather(mut view: ArrayView3<'_, u8>, bgr: bool, out: &mut Vec<u8>) {
    let mut swap = bgr;
    if view.strides()[2] < 0 {
        view.invert_axis(Axis(2));
        swap = !swap;
    }
    // What is there from the frame before is overwritten.
    out.resize(view.len(), 0);
    let width = view.shape()[1];
    if width == 0 {
        return;
    }
    for (to, from) in out.chunks_exact_mut(3 * width).zip(view.outer_iter()) {
        let to = to.as_chunks_mut::<3>().0;
        match from.as_slice() {
            Some(from) if swap => reverse(from.as_chunks::<3>().0, to),
            Some(from) => to.as_flattened_mut().copy_from_slice(from),
            None => {
                for channel in 0..3 {
                    let at = if swap { 2 - channel } else { channel };
                    to.iter_mut().zip(from.index_axis(Axis(1), channel)).for_each(|(pixel, &v)| pixel[at] = v);
                }
            }
        }
    }
}

/// Turns BGR into RGB, with the vectors of AVX2 where the processor has them.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn reverse(from: &[[u8; 3]], to: &mut [[u8; 3]]) {
    to.iter_mut().zip(from).for_each(|(to, &[b, g, r])| *to = [r, g, b]);
}
