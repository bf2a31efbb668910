//! Searches the frames that come from the laptop.
//!
//! In: a detector, a model, frames from the [`Link`]. Out: one [`Report`] per frame. Memory: 300
//! bytes of stack for a report. Cost: the cost of the detector. Digests and reports are not part of
//! the counted time.

use keygraph_core::stages::digest::Digests;
use keygraph_core::{Model, Observer, Output, Stage};

use crate::board::{Link, fail, stack_bytes, ticks};
use crate::profile::Detector;
use crate::wire::{FrameHeader, Job, Report};

/// An observer that reads the board's clock, and makes digests if the job asks for them.
struct Watch {
    digests: Option<Digests>,
    start: u64,
    budget: u32,
    /// Time of the last question whether the search goes on, and the longest time between two.
    asked: u64,
    longest: u64,
}

impl Observer for Watch {
    fn now(&mut self) -> u64 {
        ticks()
    }

    fn goes_on(&mut self) -> bool {
        let now = ticks();
        self.longest = self.longest.max(now - self.asked);
        self.asked = now;
        self.budget == 0 || now - self.start < u64::from(self.budget)
    }

    fn saw(&mut self, output: Output<'_>) {
        if let Some(digests) = &mut self.digests {
            digests.add(output);
            // Digests are not part of a search.
            self.asked = ticks();
        }
    }
}

/// Searches all frames that are left, and reports each of them.
///
/// # Panics
/// Panics if the detector refuses a frame.
#[inline(never)]
pub fn search_all(detector: &mut Detector, model: &Model<'_>, job: &Job, link: &mut Link, buffer: &mut [u8]) {
    link.put(size_of::<Detector>() as u32);
    detector.rooms().iter().for_each(|room| link.put(room.bytes as u32));
    while let Some(header) = link.next_frame(buffer) {
        search(detector, model, job, link, &header, &buffer[..header.bytes()]);
    }
}

#[inline(never)]
fn search(d: &mut Detector, model: &Model<'_>, job: &Job, link: &mut Link, header: &FrameHeader, data: &[u8]) {
    let (digests, start) = (job.digests.then(Digests::new), ticks());
    let mut watch = Watch { digests, start, budget: job.budget, asked: start, longest: 0 };
    let frame = header.frame(data).unwrap_or_else(|e| fail("the frame", e));
    if let Err(e) = d.detect(&frame, model, job.threshold, &mut watch) {
        fail("the frame", e);
    }
    let [width, height] = header.size;
    defmt::info!("{} px x {} px: {} found", width, height, d.detections().len());
    let stats = d.stats();
    let report = Report {
        ticks: stats.ticks.map(|t| t as u32),
        stages: stats.stages,
        digests: watch.digests.map_or([0; Stage::COUNT], |d| Stage::ALL.map(|s| d.of(s))),
        stack_bytes: stack_bytes(),
        longest: watch.longest as u32,
        stopped: u32::from(stats.stopped),
    };
    report.encode(d.detections(), &mut |word| link.put(word));
}
