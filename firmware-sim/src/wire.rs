//! The protocol between the laptop and the board.
//!
//! In and out: little-endian words of 32 bits. The laptop writes a [`Job`], then each frame as a
//! [`FrameHeader`] and its bytes. The board answers with the sizes of its detector and of its
//! buffers, then with one [`Report`] per frame. Memory: none on the board. Cost: one access per
//! word.

use core::ffi::CStr;

use keygraph_core::{
    DETECTIONS, Detection, Frame, FrameError, Homography, PixelFormat, Stage, StageStats, heapless::Vec,
};

/// Name of the file that the board reads.
pub const FRAMES: &CStr = c"frames.bin";
/// Name of the file that the board writes.
pub const RESULTS: &CStr = c"results.bin";

/// Number of instructions per tick of the emulated board's clock, as a fraction. An instruction
/// takes 16 ns. The clock counts at 25 MHz, so that a tick takes 40 ns.
const INSTRUCTIONS_PER_TICK: (u64, u64) = (40, 16);
/// Option of the emulator for this rate: an instruction takes 2^4 ns.
pub const ICOUNT: &str = "shift=4";

/// Converts instructions to clock ticks.
#[must_use]
pub const fn ticks_of(instructions: u64) -> u32 {
    (instructions * INSTRUCTIONS_PER_TICK.1 / INSTRUCTIONS_PER_TICK.0) as u32
}

/// Converts clock ticks to instructions.
#[must_use]
pub const fn instructions(ticks: u32) -> u64 {
    ticks as u64 * INSTRUCTIONS_PER_TICK.0 / INSTRUCTIONS_PER_TICK.1
}

/// The job of the board. It holds for all frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Job {
    /// Minimum score of a detection.
    pub threshold: f32,
    /// Whether the board makes digests.
    pub digests: bool,
    /// Width and height of the part in the middle of the first frame that is learnt, px. Zero if
    /// nothing is learnt.
    pub learn: [u32; 2],
    /// Clock ticks after which a search is stopped. Zero if it has all the time.
    pub budget: u32,
}

impl Job {
    /// Number of words of a job.
    pub const WORDS: usize = 5;

    /// Encodes the job as words.
    #[must_use]
    pub const fn encode(&self) -> [u32; Self::WORDS] {
        [self.threshold.to_bits(), self.digests as u32, self.learn[0], self.learn[1], self.budget]
    }

    /// Decodes a job from words.
    #[must_use]
    pub const fn decode([threshold, digests, width, height, budget]: [u32; Self::WORDS]) -> Self {
        Self { threshold: f32::from_bits(threshold), digests: digests != 0, learn: [width, height], budget }
    }
}

/// The formats that the firmware takes, by their numbers. Its code has no room for all.
pub const FORMATS: [PixelFormat; 6] = [
    PixelFormat::Rgb8,
    PixelFormat::Gray8,
    PixelFormat::Yuyv,
    PixelFormat::Nv12,
    PixelFormat::I420,
    PixelFormat::Rgb565,
];

/// The header of a frame. It stands before the bytes of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameHeader {
    /// Pixel format of the frame.
    pub format: PixelFormat,
    /// Width and height, px.
    pub size: [u32; 2],
}

impl FrameHeader {
    /// Number of words of a header.
    pub const WORDS: usize = 3;

    /// Encodes the header as words.
    #[must_use]
    pub const fn encode(&self) -> [u32; Self::WORDS] {
        [self.format as u32, self.size[0], self.size[1]]
    }

    /// Decodes a header from words. Returns `None` if the format is none of [`FORMATS`].
    #[must_use]
    pub fn decode([format, width, height]: [u32; Self::WORDS]) -> Option<Self> {
        Some(Self { format: *FORMATS.get(format as usize)?, size: [width, height] })
    }

    /// Makes the frame of a header. A format that this function names is linked, any other is not: on
    /// a real board, whose sensor gives one format, name that one alone.
    ///
    /// # Errors
    /// Fails with [`FrameError`] if `data` is no frame of this size and format.
    pub fn frame<'a>(&self, data: &'a [u8]) -> Result<Frame<'a>, FrameError> {
        let [w, h] = self.size.map(|v| v as usize);
        match self.format {
            PixelFormat::Rgb8 => Frame::new(PixelFormat::Rgb8, w, h, data),
            PixelFormat::Gray8 => Frame::new(PixelFormat::Gray8, w, h, data),
            PixelFormat::Nv12 => Frame::new(PixelFormat::Nv12, w, h, data),
            PixelFormat::I420 => Frame::new(PixelFormat::I420, w, h, data),
            PixelFormat::Rgb565 => Frame::new(PixelFormat::Rgb565, w, h, data),
            // `decode` lets no other format through.
            _ => Frame::new(PixelFormat::Yuyv, w, h, data),
        }
    }

    /// Returns the size of the frame, bytes.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.format.bytes(self.size[0] as usize, self.size[1] as usize)
    }
}

/// The report of the board on one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Clock ticks of each stage.
    pub ticks: [u32; Stage::COUNT],
    /// Counts of each stage.
    pub stages: [StageStats; Stage::COUNT],
    /// Digest of each stage.
    pub digests: [u32; Stage::COUNT],
    /// Maximum stack use so far, bytes.
    pub stack_bytes: u32,
    /// Most ticks between two questions whether the search goes on.
    pub longest: u32,
    /// Whether the search was stopped, as a number.
    pub stopped: u32,
}

impl Report {
    /// Returns the instructions of each stage.
    #[must_use]
    pub fn instructions(&self) -> [u64; Stage::COUNT] {
        self.ticks.map(instructions)
    }

    /// Passes every word of the report and of the detections to `put`.
    pub fn encode(&self, detections: &[Detection], put: &mut impl FnMut(u32)) {
        self.ticks.iter().for_each(|&t| put(t));
        self.stages.iter().flat_map(|s| [s.seen, s.kept, s.dropped]).for_each(&mut *put);
        self.digests.iter().for_each(|&d| put(d));
        [self.stack_bytes, self.longest, self.stopped].into_iter().for_each(&mut *put);
        put(detections.len() as u32);
        for d in detections {
            let a = &d.appearance;
            put(u32::from(d.object));
            d.homography.0.iter().chain(d.corners.as_flattened()).for_each(|v| put(v.to_bits()));
            [d.score, a.visible, a.median, a.support, a.strong, a.chroma].iter().for_each(|v| put(v.to_bits()));
            [d.votes, d.agreeing, a.blocks, a.inside].iter().for_each(|&n| put(u32::from(n)));
        }
    }

    /// Reads a report and the detections from `next`, word by word. Returns `None` if the words end
    /// too early.
    pub fn decode(next: &mut impl FnMut() -> Option<u32>) -> Option<(Self, Vec<Detection, DETECTIONS>)> {
        let mut report = Self::default();
        for t in &mut report.ticks {
            *t = next()?;
        }
        for s in &mut report.stages {
            *s = StageStats { seen: next()?, kept: next()?, dropped: next()? };
        }
        for d in &mut report.digests {
            *d = next()?;
        }
        [report.stack_bytes, report.longest, report.stopped] = [next()?, next()?, next()?];
        let mut detections = Vec::new();
        for _ in 0..next()? {
            let object = next()? as u16;
            let mut float = || next().map(f32::from_bits);
            let (mut homography, mut corners) = (Homography::IDENTITY, [[0.0; 2]; 4]);
            for v in homography.0.iter_mut().chain(corners.as_flattened_mut()) {
                *v = float()?;
            }
            let mut d = Detection::new(object, &homography, [0.0; 2]);
            d.corners = corners;
            let a = &mut d.appearance;
            for v in [&mut d.score, &mut a.visible, &mut a.median, &mut a.support, &mut a.strong, &mut a.chroma] {
                *v = float()?;
            }
            for n in [&mut d.votes, &mut d.agreeing, &mut a.blocks, &mut a.inside] {
                *n = next()? as u16;
            }
            detections.push(d).ok()?;
        }
        Some((report, detections))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let mut report = Report { ticks: [64; Stage::COUNT], stack_bytes: 5000, ..Report::default() };
        report.stages[3] = StageStats { seen: 7, kept: 5, dropped: 2 };
        let homography = Homography([1.0, 0.5, 20.0, -0.5, 1.0, 30.0, 0.0, 0.001, 1.0]);
        let mut d = Detection::new(3, &homography, [0.0; 2]);
        d.corners = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]];
        (d.score, d.votes, d.agreeing) = (0.875, 12, 40);
        let a = &mut d.appearance;
        (a.blocks, a.inside, a.visible, a.median, a.support, a.strong, a.chroma) =
            (30, 36, 0.625, 0.75, 21.5, 11.5, -0.25);
        let mut words = std::vec::Vec::new();
        report.encode(&[d], &mut |w| words.push(w));
        let mut left = words.iter().copied();
        let (read, found) = Report::decode(&mut || left.next()).unwrap();
        assert!(left.next().is_none(), "all words are read");
        assert_eq!(read, report);
        assert_eq!(found, [d]);
        assert_eq!(read.instructions()[0], 160);
        let mut short = words[..words.len() - 1].iter().copied();
        assert!(Report::decode(&mut || short.next()).is_none(), "a word is missing");
    }

    #[test]
    fn every_format_has_its_number() {
        for format in PixelFormat::ALL {
            let header = FrameHeader { format, size: [32, 16] };
            let taken = FORMATS.contains(&format).then_some(header);
            assert_eq!(FrameHeader::decode(header.encode()), taken, "{format:?}");
            if taken.is_some() {
                let data = std::vec![0; header.bytes()];
                assert_eq!(header.frame(&data).map(|f| f.format()), Ok(format));
            }
        }
    }
}
