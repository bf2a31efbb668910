//! The main loop of a board, to be copied: a camera fills a buffer, the detector reads it, and searches
//! while the next frame arrives; the results go out over a serial port.
//!
//! In: frames of the emulated camera. Out: one line per detection on the serial port. Memory: the
//! detector and one raw frame. Cost: the cost of the detector.
//!
//! Another board needs its own `Camera` with an implementation of `Sensor`, and a port that
//! implements `core::fmt::Write`.
#![no_std]
#![no_main]

use keygraph_core::{Frame, FrameError, Model};
use keygraph_firmware_sim::board::{Link, Port, fail, finish, frame_buffer, model, start_clock, ticks};
use keygraph_firmware_sim::profile::{Detector, FRAME_BYTES};
use keygraph_firmware_sim::sensor::{Sensor, serve};
use keygraph_firmware_sim::wire::FrameHeader;

/// The emulated camera. On a real board, the camera's DMA stream takes the place of `link`.
struct Camera {
    link: Link,
    /// The frame that is arriving, or has arrived.
    buffer: &'static mut [u8; FRAME_BYTES],
    /// Header of the frame that is arriving. On a real board all frames have the same header.
    arriving: Option<FrameHeader>,
}

impl Camera {
    fn start(mut link: Link, buffer: &'static mut [u8; FRAME_BYTES]) -> Self {
        // On a real board: set the mode of the sensor, point the DMA to the buffer, start it.
        let arriving = link.next_frame(buffer);
        Self { link, buffer, arriving }
    }
}

impl Sensor for Camera {
    fn wait(&mut self) -> Option<Result<Frame<'_>, FrameError>> {
        // On a real board: sleep (`wfi`) until the DMA interrupt reports a whole frame, invalidate the
        // data cache over it.
        let whole = self.arriving?;
        // On a real board: `Frame::new` with the one format of its sensor, so that no other is linked.
        Some(whole.frame(&self.buffer[..whole.bytes()]))
    }

    fn go_on(&mut self) {
        // On a real board: start the DMA again, for one frame.
        self.arriving = self.link.next_frame(&mut *self.buffer);
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut DETECTOR: Detector = Detector::new();
    start_clock();
    let (link, _) = Link::open();
    let model = Model::parse(model()).unwrap_or_else(|e| fail("the model in flash", e));
    let mut camera = Camera::start(link, frame_buffer());
    serve(&mut camera, DETECTOR, &model, &mut Port::open(), &mut ticks).expect("the port takes text");
    finish()
}
