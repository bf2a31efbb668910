//! The main loop of a board, to be copied: a camera fills two buffers in turn, the detector
//! searches them, and the results go out over a serial port.
//!
//! In: frames of the emulated camera. Out: one line per detection on the serial port. Memory: the
//! detector and two raw frames. Cost: the cost of the detector.
//!
//! Another board needs its own `Camera` with an implementation of `Sensor`, and a port that
//! implements `core::fmt::Write`.
#![no_std]
#![no_main]

use core::mem::swap;

use keygraph_core::{Frame, FrameError, Model};
use keygraph_firmware_sim::board::{Link, Port, finish, frame_buffer, model, start_clock, ticks};
use keygraph_firmware_sim::profile::{Detector, FRAME_BYTES};
use keygraph_firmware_sim::sensor::{Sensor, serve};
use keygraph_firmware_sim::wire::FrameHeader;

/// The emulated camera. On a real board, the camera's DMA stream takes the place of `link`.
struct Camera {
    link: Link,
    /// The frame that is being searched, and the frame that is arriving.
    buffers: [&'static mut [u8; FRAME_BYTES]; 2],
    /// Header of the frame that is arriving. On a real board all frames have the same header.
    arriving: Option<FrameHeader>,
}

impl Camera {
    fn start(mut link: Link, buffers: [&'static mut [u8; FRAME_BYTES]; 2]) -> Self {
        // On a real board: set the mode of the sensor, point the DMA to buffers[1], start it.
        let arriving = link.next_frame(buffers[1]);
        Self { link, buffers, arriving }
    }
}

impl Sensor for Camera {
    fn next(&mut self) -> Option<Result<Frame<'_>, FrameError>> {
        // On a real board: sleep (`wfi`) until the DMA interrupt reports a whole frame, invalidate the
        // data cache over it, point the DMA to the other buffer.
        let whole = self.arriving?;
        let [searched, arrived] = &mut self.buffers;
        swap(searched, arrived);
        self.arriving = self.link.next_frame(&mut **arrived);
        // On a real board: `Frame::new` with the one format of its sensor, so that no other is linked.
        Some(whole.frame(&searched[..whole.bytes()]))
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut DETECTOR: Detector = Detector::new();
    static mut SECOND: [u8; FRAME_BYTES] = [0; FRAME_BYTES];
    start_clock();
    let (link, _) = Link::open();
    let model = Model::parse(model()).unwrap_or_else(|e| panic!("the model in flash: {e}"));
    let mut camera = Camera::start(link, [frame_buffer(), SECOND]);
    serve(&mut camera, DETECTOR, &model, &mut Port::open(), &mut ticks).expect("the port takes text");
    finish()
}
