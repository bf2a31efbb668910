//! The interface between a camera and the detector, and the loop that serves a camera.
//!
//! In: a [`Sensor`], which fills one buffer while the other is searched. Out: one line of text per
//! detection, over a serial port. Memory: two raw frames, which the sensor owns. Cost: the cost of
//! the detector. The next frame arrives during the search.

use core::fmt::Write;

use keygraph_core::{DEFAULT_THRESHOLD, Frame, FrameError, Model, Observer};

use crate::profile::Detector;

/// A camera with two buffers.
pub trait Sensor {
    /// Waits until the arriving frame is whole, lets the next frame arrive in the other buffer, and
    /// returns the whole frame. That frame stays valid until the next call. Returns `None` if the
    /// camera has stopped.
    ///
    /// # Errors
    /// Fails with [`FrameError`] if the mode of the camera does not suit the detector.
    fn next(&mut self) -> Option<Result<Frame<'_>, FrameError>>;
}

/// Searches every frame of `sensor`. Writes one line per detection: number of the frame, object,
/// score in percent, and the corners of the outline in px.
///
/// # Errors
/// Fails if the port fails.
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
                    // Whole numbers, because printing floats costs 12 KB of code.
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
