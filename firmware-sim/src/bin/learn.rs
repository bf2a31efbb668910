//! Firmware that learns the object in the middle of the first frame, and finds it in the other frames.
//!
//! In: a job and frames. Out: the cost and the result of learning, then one report per frame.
//! Memory: a raw frame, and one block of memory that the learner uses first and the detector uses
//! next. Cost: the output gives it, for learning as a whole and for detection by stage.
#![no_std]
#![no_main]

use keygraph_core::Model;
use keygraph_firmware_sim::board::{Arena, Link, fail, finish, frame_buffer, program, stack_bytes, start_clock, ticks};
use keygraph_firmware_sim::learn::Learner;
use keygraph_firmware_sim::profile::Detector;
use keygraph_firmware_sim::search::search_all;

const SHARED: usize = {
    let (learner, detector) = (size_of::<Learner>(), size_of::<Detector>());
    if learner > detector { learner } else { detector }
};

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut SPACE: Arena<SHARED> = Arena::new();
    start_clock();
    let (mut link, job) = Link::open();
    let buffer = frame_buffer();
    let header = link.next_frame(buffer).expect("there is a frame to learn from");
    let start = ticks();
    let size = job.learn.map(|v| v as usize);
    let learnt = SPACE.make::<Learner>().learn(&header, buffer, size).map(program);
    let taken = ticks() - start;
    let model = match learnt.map(Model::parse) {
        Ok(Ok(model)) => model,
        Ok(Err(e)) => fail("the model that was learnt", e),
        Err(e) => fail("cannot learn", e),
    };
    defmt::info!("learnt {} keygraphs, {} bytes", model.keygraphs(), model.bytes().len());
    for word in [taken as u32, model.bytes().len() as u32, model.keygraphs() as u32, stack_bytes()] {
        link.put(word);
    }
    for bytes in model.bytes().chunks(4) {
        let mut word = [0; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        link.put(u32::from_le_bytes(word));
    }
    search_all(SPACE.make::<Detector>(), &model, &job, &mut link, buffer);
    finish()
}
