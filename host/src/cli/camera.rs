//! `keygraph camera`: live, in front of a camera.

use anyhow::Result;
use keygraph::camera::camera;

pub use keygraph::camera::arguments::Arguments;

/// Searches the camera's frames until it is told to stop.
///
/// # Errors
/// When a model or the source cannot be read, or the page's address cannot be bound.
pub fn run(arguments: &Arguments) -> Result<()> {
    camera(arguments)
}
