//! What a camera has to offer to the detector, and the loop that serves it.
//!
//! In: a [`Sensor`], which fills one buffer while the other is searched. Out: one line
//! of text a detection over a serial port. Memory: two raw frames, which the sensor
//! owns. Cost: the detector's; the next frame arrives meanwhile.

use core::fmt::Write;

use keygraph_core::detect::{DEFAULT_THRESHOLD, Observer};
use keygraph_core::frame::{Frame, FrameError};
use keygraph_core::model::Model;

use crate::profile::Detector;

/// A camera with two buffers.
pub trait Sensor {
    /// Waits until the frame that is arriving is whole, lets the next one arrive in the
    /// other buffer, and gives the whole one, which stays until the next call. `None`
    /// when the camera has stopped.
    ///
    /// # Errors
    /// [`FrameError`] when the camera's mode does not suit the detector.
    fn next(&mut self) -> Option<Result<Frame<'_>, FrameError>>;
}

/// Searches every frame of `sensor`, and tells what was found: frame, object, score in
/// percent, and the corners of its outline, px.
///
/// # Errors
/// When the port fails.
pub fn serve(
    sensor: &mut impl Sensor,
    detector: &mut Detector,
    model: &Model<'_>,
    port: &mut impl Write,
    clock: &mut dyn Observer,
) -> core::fmt::Result {
    let mut number = 0u32;
    while let Some(frame) = sensor.next() {
        match frame.and_then(|f| detector.detect(&f, model, DEFAULT_THRESHOLD, clock)) {
            Ok(found) => {
                for d in found {
                    let name = model.object(usize::from(d.object)).name;
                    // Whole numbers: printing floats costs 12 KB of code.
                    let (percent, corners) = ((100.0 * d.score) as u32, d.corners.map(|p| p.map(|v| v as i32)));
                    writeln!(port, "{number} {name} {percent} % {corners:?}")?;
                }
            }
            Err(e) => writeln!(port, "{number} error: {e}")?,
        }
        number = number.wrapping_add(1);
    }
    Ok(())
}
