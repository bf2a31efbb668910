//! Firmware that finds the objects of the model in flash.
//!
//! In: the model, a job and frames. Out: one report per frame. Memory: the detector and a raw
//! frame. Cost: the reports give it by stage.
#![no_std]
#![no_main]

use keygraph_core::Model;
use keygraph_firmware_sim::board::{Link, fail, finish, frame_buffer, model, start_clock};
use keygraph_firmware_sim::profile::Detector;
use keygraph_firmware_sim::search::search_all;

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut DETECTOR: Detector = Detector::new();
    start_clock();
    let (mut link, job) = Link::open();
    match Model::parse(model()) {
        Ok(model) => search_all(DETECTOR, &model, &job, &mut link, frame_buffer()),
        Err(e) => fail("the model in flash", e),
    }
    finish()
}
