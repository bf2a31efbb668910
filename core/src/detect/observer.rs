//! Observation of the stages: what each stage made of a frame, how much, and in what time.
//!
//! In: the outputs of the stages. Out: [`Stats`], and calls of an [`Observer`]. Memory: a
//! reference; [`Stats`] has 224 bytes. Cost: two readings of the clock for each output.

use crate::base::capacity::{Buffer, Stage, StageStats, count};
use crate::base::geometry::Point;
use crate::base::pace::Pace;
use crate::detect::classify::Match;
use crate::detect::detection::Detection;
use crate::detect::hough::Candidate;
use crate::detect::scrutiny::Scrutiny;
use crate::detect::vote::Vote;
use crate::extract::delaunay::Triple;
use crate::extract::feature::Feature;
use crate::extract::keygraph::Keygraph;
use crate::image::pyramid::PyramidView;

/// Counts and times of the stages for one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Stats {
    /// Counts of each stage, in the order of [`Stage::ALL`].
    pub stages: [StageStats; Stage::COUNT],
    /// Clock ticks of each stage, in the order of [`Stage::ALL`].
    pub ticks: [u64; Stage::COUNT],
    /// Number of times that a tile of the frame was searched, [`Depth::Usual`](crate::Depth::Usual).
    pub tiles: u8,
    /// Whether the search was told to stop, [`Observer::goes_on`], and is not complete.
    pub stopped: bool,
}

impl Stats {
    /// Counts and ticks before any stage has run: all zero.
    pub(crate) const EMPTY: Self = Self {
        stages: [StageStats { seen: 0, kept: 0, dropped: 0 }; Stage::COUNT],
        ticks: [0; Stage::COUNT],
        tiles: 0,
        stopped: false,
    };

    /// Adds the counts and ticks of `more`.
    pub fn add(&mut self, more: &Self) {
        self.stages.iter_mut().zip(more.stages).for_each(|(s, m)| add(s, m));
        self.ticks.iter_mut().zip(more.ticks).for_each(|(t, m)| *t = t.wrapping_add(m));
        self.tiles = self.tiles.saturating_add(more.tiles);
        self.stopped |= more.stopped;
    }
}

/// Counters of one search of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Tally {
    pub(super) stats: Stats,
    /// Maximum number of elements held by each buffer, in the order of [`Buffer::ALL`].
    pub(super) high_water: [u32; Buffer::COUNT],
}

impl Tally {
    pub(super) const EMPTY: Self = Self { stats: Stats::EMPTY, high_water: [0; Buffer::COUNT] };

    /// Records that a buffer holds `held` elements.
    #[inline(never)]
    pub(super) fn mark(&mut self, buffer: Buffer, held: usize) {
        let most = &mut self.high_water[buffer as usize];
        *most = (*most).max(count(held));
    }

    /// Counts of a stage.
    pub(super) fn of(&mut self, stage: Stage) -> &mut StageStats {
        &mut self.stats.stages[stage as usize]
    }

    /// Adds `more` to the counts of a stage.
    pub(super) fn add(&mut self, stage: Stage, more: StageStats) {
        add(self.of(stage), more);
    }
}

/// Output that a stage has just made, for an [`Observer`]. A stage can make several outputs in a
/// frame, one for each level, chunk of keygraphs or candidate. The buffers are reused in between.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Output<'a> {
    /// Level 0 of luma and chroma.
    Planes(PyramidView<'a>),
    /// The pyramid levels of luma and chroma above level 0.
    Levels(PyramidView<'a>),
    /// Keypoints of a level, 1/16 px of that level, best first.
    Corners(&'a [Point]),
    /// Triples of indices into the keypoints of the level.
    Triangles(&'a [Triple]),
    /// Keygraphs among the triples of the level.
    Keygraphs(&'a [Keygraph]),
    /// Features of the keygraphs, and the number of bytes that each feature uses.
    Features(&'a [Feature], usize),
    /// Matches of a chunk of keygraphs, each with the index of its keygraph.
    Matches(&'a [(u16, Match)]),
    /// Votes cast by the matches of a chunk.
    Votes(&'a [Vote]),
    /// Poses with the most votes, heaviest first.
    Candidates(&'a [Candidate]),
    /// Homography grown from a candidate, if any.
    Grown(Option<&'a Detection>),
    /// Homography aligned to the frame, if any.
    Aligned(Option<&'a Detection>),
    /// A pose with a good first impression, with its score and what was seen of it; not of one that was refused at once.
    Scrutinised(&'a Detection, &'a Scrutiny),
    /// All detections so far, best score first; shown after each candidate.
    Detections(&'a [Detection]),
}

impl Output<'_> {
    /// The stage that made the output.
    #[must_use]
    pub const fn stage(&self) -> Stage {
        match self {
            Self::Planes(_) => Stage::Convert,
            Self::Levels(_) => Stage::Pyramid,
            Self::Corners(_) => Stage::Corners,
            Self::Triangles(_) => Stage::Delaunay,
            Self::Keygraphs(_) => Stage::Keygraphs,
            Self::Features(..) => Stage::Features,
            Self::Matches(_) => Stage::Classify,
            Self::Votes(_) => Stage::Verify,
            Self::Candidates(_) => Stage::Vote,
            Self::Grown(_) => Stage::Pose,
            Self::Aligned(_) | Self::Scrutinised(..) | Self::Detections(_) => Stage::Accept,
        }
    }
}

/// Observes the stages. A closure that returns ticks is an observer that only times them.
pub trait Observer {
    /// Returns the ticks of a clock that counts up. It is called between the stages. A clock of 32
    /// bits may start again at 0.
    fn now(&mut self) -> u64;

    /// Returns whether the search goes on. It is asked every 200,000 instructions or more often (by one
    /// core; every 250,000 with the vectors of a Cortex-M55; less often with a crew), so that others can be given their turn, and a search can be told to stop. A search that is
    /// stopped returns what it has found, [`Stats::stopped`], and does not ask again.
    fn goes_on(&mut self) -> bool {
        true
    }

    /// Receives what a stage made. The time of this call is not counted for any stage.
    fn saw(&mut self, output: Output<'_>) {
        let _ = output;
    }
}

impl<F: FnMut() -> u64> Observer for F {
    fn now(&mut self) -> u64 {
        self()
    }
}

/// The ticks between two readings of a clock, which may have 32 bits and start again at 0.
pub(crate) const fn passed(start: u64, end: u64) -> u64 {
    let ticks = end.wrapping_sub(start);
    if end < start { ticks & 0xffff_ffff } else { ticks }
}

/// Measures the time of the stages.
pub(crate) struct Laps<'a> {
    observer: &'a mut dyn Observer,
    last: u64,
    /// Whether the observer has told the search to stop.
    pub(crate) stopped: bool,
}

impl Pace for Laps<'_> {
    #[inline(never)]
    fn goes_on(&mut self) -> bool {
        self.stopped = self.stopped || !self.observer.goes_on();
        !self.stopped
    }
}

impl<'a> Laps<'a> {
    pub(crate) fn new(observer: &'a mut dyn Observer) -> Self {
        let last = observer.now();
        Self { observer, last, stopped: false }
    }

    /// Ends the work of a stage: adds its ticks, and shows its output.
    #[inline(never)]
    pub(crate) fn end(&mut self, tally: &mut Tally, output: Output<'_>) {
        let now = self.observer.now();
        let ticks = passed(self.last, now);
        let total = &mut tally.stats.ticks[output.stage() as usize];
        *total = total.wrapping_add(ticks);
        #[cfg(feature = "defmt")]
        defmt::trace!("{}: {} ticks", output.stage(), ticks);
        self.observer.saw(output);
        self.last = self.observer.now();
    }
}

fn add(total: &mut StageStats, s: StageStats) {
    total.seen += s.seen;
    total.kept += s.kept;
    total.dropped += s.dropped;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_of_32_bits_may_start_again() {
        assert_eq!(passed(5, 12), 7);
        assert_eq!(passed(0xffff_fff0, 0x10), 0x20);
        assert_eq!(passed(1 << 40, (1 << 40) + 3), 3);
        let mut stats = Stats::EMPTY;
        stats.ticks[0] = u64::MAX;
        let mut sum = stats;
        sum.add(&stats);
        assert_eq!(sum.ticks[0], u64::MAX - 1, "no panic");
    }
}
