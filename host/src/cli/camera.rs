//! `keygraph camera`: live, in front of a camera.

use anyhow::Result;
use clap::error::ErrorKind;
use keygraph::camera::camera;
use keygraph::region::Unsuitable;

use super::model_files::expanded;
use super::usage_error;
pub use keygraph::camera::arguments::Arguments;

/// Searches the camera's frames until it is told to stop.
///
/// # Errors
/// When a model or the source cannot be read, or the page's address cannot be bound.
pub fn run(arguments: &Arguments) -> Result<()> {
    let arguments = Arguments { models: expanded(&arguments.models)?, ..arguments.clone() };
    match camera(&arguments) {
        Err(e) if e.is::<Unsuitable>() => usage_error(ErrorKind::ValueValidation, format!("{e:#}")),
        ended => ended,
    }
}
