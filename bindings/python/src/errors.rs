//! Errors and warnings, as Python has them.
//!
//! In: errors of the host and the core. Out: exceptions, whose words are those of Python arguments.

use std::io;

use keygraph_core::{CameraError, FrameError, ModelError, PackError, TrainError};
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyRuntimeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::{PyErr, create_exception};

create_exception!(
    keygraph,
    TrainingError,
    PyValueError,
    "A picture that no model can be made of; the message says why."
);
create_exception!(keygraph, ModelFileError, PyValueError, "Bytes that are no model, or a damaged one.");
create_exception!(keygraph, TrainingWarning, PyUserWarning, "What makes a model less useful than it looks.");

/// Sentences of the command line with the names of Python arguments.
const WORDS: [(&str, &str); 7] = [
    ("raise --threshold in `keygraph detect`", "raise threshold"),
    ("raise --min-visible in `keygraph detect`", "raise min_visible"),
    ("--profile hd", "profile=\"hd\""),
    ("--crop ", "crop="),
    ("--min-visible", "min_visible"),
    ("--profile", "profile"),
    ("--roi", "roi"),
];

/// A sentence of the command line, with the names of Python arguments.
pub fn in_python(text: &str) -> String {
    WORDS.iter().fold(text.to_string(), |text, (ours, python)| text.replace(ours, python))
}

/// A `ValueError`.
pub fn value_error(text: impl AsRef<str>) -> PyErr {
    PyValueError::new_err(in_python(text.as_ref()))
}

/// The exception of an error of the host: `OSError` where the system refused, `TrainingError` and
/// `ModelFileError` where training or a model did, `ValueError` for other input.
pub fn exception(error: &anyhow::Error) -> PyErr {
    let text = in_python(&format!("{error:#}"));
    if error.chain().any(|e| e.is::<TrainError>()) {
        return TrainingError::new_err(text);
    }
    if error.chain().any(|e| e.is::<ModelError>() || e.is::<PackError>()) {
        return ModelFileError::new_err(text);
    }
    match error.chain().find_map(|e| e.downcast_ref::<io::Error>()).map(io::Error::kind) {
        Some(io::ErrorKind::NotFound) => PyFileNotFoundError::new_err(text),
        Some(_) => PyOSError::new_err(text),
        None if text.ends_with("no such file") => PyFileNotFoundError::new_err(text),
        None => PyValueError::new_err(text),
    }
}

/// The exception of a frame that was refused.
pub fn frame_error(error: FrameError) -> PyErr {
    PyValueError::new_err(format!("the frame: {error}"))
}

/// The exception of a camera that cannot be.
pub fn camera_error(error: CameraError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A defect of this package.
pub fn defect(text: &str) -> PyErr {
    PyRuntimeError::new_err(format!("{text}; please report this frame"))
}

/// Warns in the place that called the package.
pub fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let text = std::ffi::CString::new(in_python(text).replace('\0', " ")).unwrap_or_default();
    PyErr::warn(py, &py.get_type::<TrainingWarning>(), &text, 1)
}
