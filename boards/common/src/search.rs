//! A search that gives others their turn, and its report.
//!
//! In: a frame. Out: a line of text per detection. Memory: that of the detector. Cost: that of the
//! detector.

use core::fmt::{self, Write};

use embassy_futures::yield_now;
use keygraph_core::{DEFAULT_THRESHOLD, Frame, FrameError, Model, Observer, Ongoing, Qvga, QvgaDetector};

/// Reads a frame, whose buffer is free then, and begins to search it.
///
/// # Errors
/// When the frame is larger than 320x240 px.
pub fn begin<'a>(
    detector: &'a mut QvgaDetector,
    model: &'a Model<'a>,
    frame: &Frame<'_>,
    clock: &mut dyn Observer,
) -> Result<Ongoing<'a, Qvga>, FrameError> {
    detector.begin(frame, model, DEFAULT_THRESHOLD, clock)
}

/// Does all pieces of a search; between them other tasks have their turn.
pub async fn finish(search: &mut Ongoing<'_, Qvga>, clock: &mut dyn Observer) {
    while search.step(clock) {
        yield_now().await;
    }
}

/// Writes a line per detection: number of the frame, object, score in percent, and the corners of the
/// outline in px.
///
/// # Errors
/// When `out` fails.
pub fn report(out: &mut impl Write, number: u32, model: &Model<'_>, search: &Ongoing<'_, Qvga>) -> fmt::Result {
    for d in search.detections() {
        let name = model.object(usize::from(d.object)).name;
        // Whole numbers, because printing floats costs 12 KB of code.
        let (percent, corners) = ((100.0 * d.score) as u32, d.corners.map(|p| p.map(|v| v as i32)));
        writeln!(out, "{number} {name} {percent} % {corners:?}\r")?;
    }
    Ok(())
}
