//! The detector as a benchmark: the same frames again and again, on one thread.
//!
//! In: decoded frames and a model. Out: what each stage takes, in time and in memory,
//! and a digest of all results, the same on every machine. Each pass must give what the
//! first gave, which is not timed. Beside the stages that read every pixel stands the
//! time of a plain copy of as many bytes in the same run.

use std::hint::black_box;
use std::time::Instant;

use anyhow::{Result, ensure};
use keygraph_core::capacity::{Buffer, Room, Stage};
use keygraph_core::detect::Detection;
use keygraph_core::digest::Digest;
use keygraph_core::model::Model;
use keygraph_core::track::Tracker;

use crate::input::Picture;
use crate::search::{Found, Request, follow, prepare, search_for};

/// Milliseconds of one thing over all frames; of each frame the median pass counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Median.
    pub median: f64,
    /// What 95 of 100 frames stay under.
    pub p95: f64,
}

impl Times {
    /// Of nanoseconds: passes within frames.
    fn new(frames: &mut [Vec<u64>]) -> Self {
        let mut medians: Vec<u64> = frames.iter_mut().filter_map(|f| at(f, 0.5)).collect();
        let mut ms = |part| at(&mut medians, part).unwrap_or(0) as f64 / 1e6;
        Self { median: ms(0.5), p95: ms(0.95) }
    }
}

/// The value that this part of all values lies under.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
fn at(values: &mut [u64], part: f64) -> Option<u64> {
    values.sort_unstable();
    values.get(((values.len() as f64 * part) as usize).min(values.len().saturating_sub(1))).copied()
}

/// What one stage did.
#[derive(Clone, Copy, Debug)]
pub struct StageCost {
    /// The stage.
    pub stage: Stage,
    /// How long it took.
    pub times: Times,
    /// What it lost to full buffers in all frames.
    pub dropped: u64,
    /// Bytes read and written, where every pixel is, in the largest frame.
    pub moved: Option<usize>,
    /// Median of a plain copy that moves as many, ms.
    pub copy_ms: Option<f64>,
}

/// What one buffer holds.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// The buffer.
    pub buffer: Buffer,
    /// Its bytes and its capacity.
    pub room: Room,
    /// Most elements it held in any frame.
    pub high_water: u32,
}

/// How long frames of a sequence take when what was found is followed.
#[derive(Clone, Copy, Debug)]
pub struct Tracking {
    /// Frames that were only followed.
    pub followed: usize,
    /// What they took.
    pub times: Times,
    /// What frames took that were searched too.
    pub searched: Times,
}

/// What a benchmark found out.
#[derive(Clone, Debug)]
pub struct Bench {
    /// Frames of a pass.
    pub frames: usize,
    /// Passes that were timed.
    pub passes: usize,
    /// Detections in a pass.
    pub detections: usize,
    /// A number that stands for all that every stage made.
    pub digest: u32,
    /// From decoded pixels to detections.
    pub total: Times,
    /// By stage.
    pub stages: Vec<StageCost>,
    /// Bytes of the detector.
    pub detector_bytes: usize,
    /// By buffer.
    pub buffers: Vec<Held>,
    /// The same frames as a sequence.
    pub tracking: Option<Tracking>,
}

/// What a benchmark does.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// How frames are searched.
    pub request: Request,
    /// Number of passes that are timed.
    pub passes: usize,
    /// Whether the frames are also followed as a sequence.
    pub track: bool,
}

/// Searches `pictures` once, and then as often as `plan` says, on this thread.
///
/// # Errors
/// When there is no picture, a picture is too small, or a pass differs from the first.
pub fn bench(pictures: &[Picture], model: &Model<'_>, plan: &Plan) -> Result<Bench> {
    let Plan { request, passes, track } = plan;
    ensure!(!pictures.is_empty(), "no frame could be read");
    let told = Request { digests: true, ..*request };
    let first = pictures.iter().map(|p| search_for(p, model, &told, 0)).collect::<Result<Vec<Found>>>()?;

    let mut total = vec![Vec::new(); pictures.len()];
    let mut ticks = vec![vec![Vec::new(); pictures.len()]; Stage::COUNT];
    for pass in 1..=*passes {
        for (i, (picture, first)) in pictures.iter().zip(&first).enumerate() {
            let found = search_for(picture, model, request, 0)?;
            let same = outcome(&found) == outcome(first);
            ensure!(same, "frame {i} of pass {pass} is not what it was before: please report this");
            total[i].push(found.total_ns);
            ticks.iter_mut().zip(found.stats.ticks).for_each(|(stage, ns)| stage[i].push(ns));
        }
    }
    let largest = pictures.iter().map(|p| frame_size(p, request)).max().unwrap_or_default();
    let stages = Stage::ALL.iter().zip(&mut ticks).map(|(&stage, ticks)| {
        let moved = bytes_moved(largest, stage);
        StageCost {
            stage,
            times: Times::new(ticks),
            dropped: first.iter().map(|f| u64::from(f.stats.stages[stage as usize].dropped)).sum(),
            moved,
            copy_ms: moved.map(copy_ms),
        }
    });
    let (detector_bytes, rooms) = request.profile.memory();
    let buffers = Buffer::ALL.iter().zip(rooms).map(|(&buffer, room)| Held {
        buffer,
        room,
        high_water: first.iter().map(|f| f.high_water[buffer as usize]).max().unwrap_or(0),
    });
    Ok(Bench {
        frames: pictures.len(),
        passes: *passes,
        detections: first.iter().map(|f| f.detections.len()).sum(),
        digest: digest(&first),
        stages: stages.collect(),
        total: Times::new(&mut total),
        detector_bytes,
        buffers: buffers.collect(),
        tracking: track.then(|| tracked(pictures, model, request)).transpose()?,
    })
}

/// What must not differ between passes, bit by bit.
fn outcome(found: &Found) -> Vec<(u16, [u32; 9], u32)> {
    let bits = |d: &Detection| (d.object, d.homography.0.map(f32::to_bits), d.score.to_bits());
    found.detections.iter().map(bits).collect()
}

/// One number of the digests of all frames.
fn digest(found: &[Found]) -> u32 {
    let mut all = Digest::new();
    for digests in found.iter().filter_map(|f| f.digests) {
        Stage::ALL.iter().for_each(|&s| all.bytes(&digests.of(s).to_le_bytes()));
    }
    all.value()
}

/// The frames as a sequence, followed.
fn tracked(pictures: &[Picture], model: &Model<'_>, request: &Request) -> Result<Tracking> {
    let mut tracker = Tracker::new();
    let (mut followed, mut searched) = (Vec::new(), Vec::new());
    for picture in pictures {
        let found = follow(picture, model, request, 0, &mut tracker)?;
        let searches = found.tracking.is_some_and(|t| t.searched);
        if searches { &mut searched } else { &mut followed }.push(vec![found.total_ns]);
    }
    Ok(Tracking { followed: followed.len(), times: Times::new(&mut followed), searched: Times::new(&mut searched) })
}

/// Pixels and bytes of a picture as the detector takes it.
fn frame_size(picture: &Picture, request: &Request) -> (usize, usize) {
    let frame = prepare(picture, request.profile, request.format);
    (frame.width * frame.height, frame.data.len())
}

/// Bytes that a stage reads and writes where it looks at every pixel of a frame.
fn bytes_moved((luma, bytes): (usize, usize), stage: Stage) -> Option<usize> {
    let planes = luma + luma / 2;
    match stage {
        Stage::Convert => Some(bytes + planes),
        // Each level is read to make the next, a quarter of it.
        Stage::Pyramid => Some(planes * 21 / 16 + planes * 21 / 64),
        // The three levels that corners are looked for on, read.
        Stage::Corners => Some(luma * 21 / 16),
        _ => None,
    }
}

/// Milliseconds that a copy takes which reads and writes so many bytes together.
fn copy_ms(moved: usize) -> f64 {
    const TIMES: usize = 31;
    let (source, mut copy) = (vec![1u8; moved / 2], vec![0u8; moved / 2]);
    let mut once = || {
        let start = Instant::now();
        copy.copy_from_slice(black_box(&source));
        black_box(&mut copy);
        u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    };
    let mut times: Vec<u64> = (0..TIMES).map(|_| once()).collect();
    at(&mut times, 0.5).unwrap_or(0) as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_pass_of_each_frame_counts() {
        let mut frames: Vec<Vec<u64>> = (1..=100).map(|i| vec![i * 1_000_000, 900_000_000, 0]).collect();
        let times = Times::new(&mut frames);
        assert_eq!((times.median, times.p95), (51.0, 96.0));
    }

    #[test]
    fn no_time_is_nothing() {
        assert_eq!(Times::new(&mut []), Times::default());
    }
}
