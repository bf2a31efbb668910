//! A board's main loop, to copy: two buffers that a camera fills in turn, the detector
//! between them, results over a serial port.
//!
//! In: frames of the emulated camera. Out: a line a detection on the serial port.
//! Memory: the detector and two raw frames. Cost: the detector's.
//!
//! What another board needs is `Camera` with its `Sensor`, and a port that implements
//! `core::fmt::Write`.
#![no_std]
#![no_main]

use core::mem::swap;

use keygraph_core::frame::{Frame, FrameError};
use keygraph_core::model::Model;
use keygraph_firmware_sim::board::{Link, Port, finish, frame_buffer, model, start_clock, ticks};
use keygraph_firmware_sim::profile::{Detector, FRAME_BYTES};
use keygraph_firmware_sim::sensor::{Sensor, serve};
use keygraph_firmware_sim::wire::FrameHeader;

/// The emulated camera. On a real one, `link` is the camera's DMA stream.
struct Camera {
    link: Link,
    /// What is being searched, and what is arriving.
    buffers: [&'static mut [u8; FRAME_BYTES]; 2],
    /// The frame that is arriving. On a real board all are of one kind.
    arriving: Option<FrameHeader>,
}

impl Camera {
    fn start(mut link: Link, buffers: [&'static mut [u8; FRAME_BYTES]; 2]) -> Self {
        // A real board: set the sensor's mode, point the DMA to buffers[1], start it.
        let arriving = link.next_frame(buffers[1]);
        Self { link, buffers, arriving }
    }
}

impl Sensor for Camera {
    fn next(&mut self) -> Option<Result<Frame<'_>, FrameError>> {
        // A real board: sleep (`wfi`) until the DMA's interrupt says that the frame is
        // whole, invalidate the data cache over it, point the DMA to the other buffer.
        let whole = self.arriving?;
        let [searched, arrived] = &mut self.buffers;
        swap(searched, arrived);
        self.arriving = self.link.next_frame(&mut **arrived);
        let [width, height] = whole.size.map(|v| v as usize);
        Some(Frame::new(whole.format, width, height, &searched[..whole.bytes()]))
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
