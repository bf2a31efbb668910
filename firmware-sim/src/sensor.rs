//! The interface between a camera and the detector, and the loop that serves a camera.
//!
//! In: a [`Sensor`], whose one buffer is free again as soon as a frame has been read. Out: one line of
//! text per detection, over a serial port. Memory: one raw frame, which the sensor owns. Cost: the cost
//! of the detector. The next frame arrives during the search.

use core::fmt::Write;

use keygraph_core::{DEFAULT_THRESHOLD, Frame, FrameError, Model, Observer};

use crate::profile::Detector;

/// A camera with one buffer.
pub trait Sensor {
    /// Waits until the arriving frame is whole, and returns it. Returns `None` if the camera has
    /// stopped.
    ///
    /// # Errors
    /// Fails with [`FrameError`] if the mode of the camera does not suit the detector.
    fn wait(&mut self) -> Option<Result<Frame<'_>, FrameError>>;

    /// Lets the next frame arrive in the buffer, which has been read.
    fn go_on(&mut self);
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
    while let Some(frame) = sensor.wait() {
        // This reads the frame: from here on the detector has planes of its own.
        let search = frame.and_then(|f| detector.begin(&f, model, DEFAULT_THRESHOLD, clock));
        sensor.go_on();
        match search {
            Ok(mut search) => {
                while search.step(clock) {}
                for d in search.detections() {
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
