//! The loop that serves a camera: the next frame arrives while one is searched.
//!
//! In: a [`Camera`], and its one buffer. Out: a line of text per detection. Memory: that of the detector. Cost:
//! that of the detector.

use core::fmt::{self, Write};

use embassy_futures::join::join;
use embassy_futures::yield_now;
use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, Observer, Ongoing, Qvga, QvgaDetector};
use zerocopy::IntoBytes;

use crate::sensor::{HEIGHT, Sensor, WIDTH};

/// A camera that fills a buffer of the caller.
pub trait Camera {
    /// Waits for the next frame. Returns whether it is whole.
    #[allow(async_fn_in_trait, reason = "these firmwares alone implement it, on one core")]
    async fn capture(&mut self, buffer: &mut [u32]) -> bool;

    /// Makes the processor see what the DMA wrote.
    fn refresh(&mut self, buffer: &mut [u32]);
}

/// Searches every frame of `camera`, a sensor of the kind `S`, and writes the results to `port`. The format of the
/// pixels is a constant of the kind, so that no other is linked.
///
/// # Panics
/// Panics if the buffer is shorter than a frame.
pub async fn serve<S: Sensor>(
    camera: &mut impl Camera,
    buffer: &mut [u32],
    (detector, model): (&mut QvgaDetector, &Model<'_>),
    port: &mut impl Write,
    clock: &mut dyn Observer,
) {
    let mut is_whole = camera.capture(buffer).await;
    for number in 0_u32.. {
        if !is_whole {
            // The next frame is a new chance.
            let _ = writeln!(port, "{number} lost\r");
            is_whole = camera.capture(buffer).await;
            continue;
        }
        camera.refresh(buffer);
        let frame = Frame::new(S::FORMAT, WIDTH, HEIGHT, buffer.as_bytes()).expect("the buffer holds a frame");
        let search = detector.begin(&frame, model, DEFAULT_THRESHOLD, clock);
        let mut search = search.expect("320x240 px fit the profile");
        // The frame has been read: the next one arrives in its buffer.
        (is_whole, ()) = join(camera.capture(buffer), finish(&mut search, clock)).await;
        // Nobody listens if this fails.
        let _ = report(port, number, model, &search);
    }
}

/// Says what is wrong.
pub fn complain(port: &mut impl Write, error: &dyn fmt::Display) {
    // Nobody listens if this fails.
    let _ = writeln!(port, "error: {error}\r");
}

/// Does all pieces of a search; between them other tasks have their turn.
async fn finish(search: &mut Ongoing<'_, Qvga>, clock: &mut dyn Observer) {
    while search.step(clock) {
        yield_now().await;
    }
}

/// Writes a line per detection: number of the frame, object, score in percent, and the corners of the
/// outline in px.
fn report(port: &mut impl Write, number: u32, model: &Model<'_>, search: &Ongoing<'_, Qvga>) -> fmt::Result {
    for d in search.detections() {
        let name = model.object(usize::from(d.object)).name;
        // Whole numbers, because printing floats costs 12 KB of code.
        let (percent, corners) = ((100.0 * d.score) as u32, d.corners.map(|p| p.map(|v| v as i32)));
        writeln!(port, "{number} {name} {percent} % {corners:?}\r")?;
    }
    Ok(())
}
