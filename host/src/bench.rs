//! The detector as a benchmark: searches the same frames again and again, one after the other.
//!
//! In: decoded frames and a model. Out: the time and the memory of each stage, and a digest
//! of all results, which is the same on every machine. The first pass is not timed; each
//! later pass must give the same results. For stages that read every pixel, the same run
//! also times a plain copy of as many bytes.
//!
//! Memory: all frames. Cost: a search a frame and pass.

use std::hint::black_box;
use std::time::Instant;

use anyhow::{Result, ensure};
use keygraph_core::stages::digest::Digest;
use keygraph_core::{Buffer, Detection, Model, Room, Stage};

use crate::input::Picture;
use crate::search::{Follower, Found, Request, follow, prepare, search_for};

/// Times over all frames, ms. The time of a frame is the median of its passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// Median of the frames.
    pub median: f64,
    /// 95th percentile of the frames.
    pub p95: f64,
}

impl Times {
    /// Times from nanoseconds, by frame and pass.
    fn new(frames: &mut [Vec<u64>]) -> Self {
        let mut medians: Vec<u64> = frames.iter_mut().filter_map(|f| at(f, 0.5)).collect();
        let mut ms = |part| at(&mut medians, part).unwrap_or(0) as f64 / 1e6;
        Self { median: ms(0.5), p95: ms(0.95) }
    }
}

/// The quantile `part` (0 to 1) of some values; `None` when there is no value. Sorts them.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
fn at(values: &mut [u64], part: f64) -> Option<u64> {
    values.sort_unstable();
    values.get(((values.len() as f64 * part) as usize).min(values.len().saturating_sub(1))).copied()
}

/// The cost of one stage.
#[derive(Clone, Copy, Debug)]
pub struct StageCost {
    /// The stage.
    pub stage: Stage,
    /// Times of the stage.
    pub times: Times,
    /// Number of elements that full buffers dropped in all frames.
    pub dropped: u64,
    /// Bytes read and written in the largest frame; `None` for a stage that does not read
    /// every pixel.
    pub moved: Option<usize>,
    /// Median time of a plain copy that moves as many bytes, ms.
    pub copy_ms: Option<f64>,
}

/// The use of one buffer.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// The buffer.
    pub buffer: Buffer,
    /// Bytes and capacity of the buffer.
    pub room: Room,
    /// Maximum number of elements that it held in any frame.
    pub high_water: u32,
}

/// Times of the frames as a sequence, with a tracker.
#[derive(Clone, Copy, Debug)]
pub struct Tracking {
    /// Number of frames in which objects were only followed.
    pub followed: usize,
    /// Times of the frames in which objects were only followed.
    pub times: Times,
    /// Times of the frames that were searched too.
    pub searched: Times,
}

/// The result of a benchmark.
#[derive(Clone, Debug)]
pub struct Bench {
    /// Number of frames of a pass.
    pub frames: usize,
    /// Number of threads that searched each frame.
    pub threads: usize,
    /// Number of passes that were timed.
    pub passes: usize,
    /// Number of detections in a pass.
    pub detections: usize,
    /// Digest of the output of all stages in all frames.
    pub digest: u32,
    /// Times from decoded pixels to detections.
    pub total: Times,
    /// Time of each frame from decoded pixels to detections, ms: the median of its passes.
    pub each: Vec<f64>,
    /// The cost of each stage.
    pub stages: Vec<StageCost>,
    /// Size of the detector in bytes.
    pub detector_bytes: usize,
    /// The use of each buffer.
    pub buffers: Vec<Held>,
    /// Times of the same frames as a sequence; `None` unless asked for.
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

/// Searches `pictures` once, and then as often as `plan` says.
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
    let sizes = pictures.iter().map(|p| frame_size(p, request)).collect::<Result<Vec<_>>>()?;
    let largest = sizes.into_iter().max().unwrap_or_default();
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
        threads: request.threads,
        passes: *passes,
        detections: first.iter().map(|f| f.detections.len()).sum(),
        digest: digest(&first),
        stages: stages.collect(),
        total: Times::new(&mut total),
        each: total.iter_mut().map(|passes| at(passes, 0.5).unwrap_or(0) as f64 / 1e6).collect(),
        detector_bytes,
        buffers: buffers.collect(),
        tracking: track.then(|| tracked(pictures, model, request)).transpose()?,
    })
}

/// The results that must be equal in all passes, bit by bit.
fn outcome(found: &Found) -> Vec<(u16, [u32; 9], u32)> {
    let bits = |d: &Detection| (d.object, d.homography.0.map(f32::to_bits), d.score.to_bits());
    found.detections.iter().map(bits).collect()
}

/// One digest of the digests of all frames.
fn digest(found: &[Found]) -> u32 {
    let mut all = Digest::new();
    for digests in found.iter().filter_map(|f| f.digests) {
        Stage::ALL.iter().for_each(|&s| all.bytes(&digests.of(s).to_le_bytes()));
    }
    all.value()
}

/// Times the frames as a sequence, with a tracker.
fn tracked(pictures: &[Picture], model: &Model<'_>, request: &Request) -> Result<Tracking> {
    let mut follower = Follower::default();
    let (mut followed, mut searched) = (Vec::new(), Vec::new());
    for picture in pictures {
        let found = follow(picture, model, request, 0, &mut follower)?;
        let searches = found.tracking.is_some_and(|t| t.searched);
        if searches { &mut searched } else { &mut followed }.push(vec![found.total_ns]);
    }
    Ok(Tracking { followed: followed.len(), times: Times::new(&mut followed), searched: Times::new(&mut searched) })
}

/// Number of pixels and bytes of a picture as the detector takes it.
fn frame_size(picture: &Picture, request: &Request) -> Result<(usize, usize)> {
    let frame = prepare(picture, request)?;
    Ok((frame.width * frame.height, frame.data.len()))
}

/// Bytes that a stage reads and writes; `None` for a stage that does not read every pixel.
/// `luma` is the number of pixels of the frame, `bytes` its size.
fn bytes_moved((luma, bytes): (usize, usize), stage: Stage) -> Option<usize> {
    let planes = luma + luma / 2;
    match stage {
        Stage::Convert => Some(bytes + planes),
        // Each level is read to make the next one, which has a quarter of its pixels.
        Stage::Pyramid => Some(planes * 21 / 16 + planes * 21 / 64),
        // Three levels are read for corners.
        Stage::Corners => Some(luma * 21 / 16),
        _ => None,
    }
}

/// Median time, ms, of a copy that reads and writes `moved` bytes together.
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
