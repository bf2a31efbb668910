//! The Python package `keygraph`: the core and the host for arrays of numpy.
//!
//! A file uses only files above it:
//!
//! - [`errors`]: errors and warnings, as Python has them
//! - [`json`]: JSON values as objects of Python
//! - [`frame`]: arrays, images, paths and bytes as pixels
//! - [`sensor`]: frames of any format as pictures
//! - [`model`]: training, packing, loading, saving
//! - [`result`]: detections, and the line of a frame
//! - [`search`]: one frame through a detector of the core
//! - [`detector`]: detectors and trackers
//! - [`space`]: poses in space
//! - [`drawing`]: pictures of results
//! - [`assessment`]: how well a picture will be found

mod errors;
mod json;
mod frame;
mod sensor;
mod model;
mod result;
mod search;
mod detector;
mod space;
mod drawing;
mod assessment;

/// What `keygraph/__init__.py` offers, and what it uses.
#[pyo3::pymodule]
mod _keygraph {
    #[pymodule_export]
    use crate::assessment::{Assessment, assess};
    #[pymodule_export]
    use crate::detector::{Detector, Tracker};
    #[pymodule_export]
    use crate::drawing::{draw, imread, imwrite, png};
    #[pymodule_export]
    use crate::errors::{ModelFileError, TrainingError, TrainingWarning};
    #[pymodule_export]
    use crate::model::{Model, ModelObject, pack, restore, train};
    #[pymodule_export]
    use crate::result::{Answer, Detection};
    #[pymodule_export]
    use crate::space::{Pose, pose};

    #[allow(non_upper_case_globals, reason = "the name that Python expects")]
    #[pymodule_export]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
