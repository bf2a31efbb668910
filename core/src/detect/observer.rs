//! Watching the stages: what each made of a frame, how much of it, and how long it took.
//!
//! In: what the stages hand over. Out: [`Stats`], and calls of an [`Observer`]. Memory: a
//! reference; [`Stats`] has 220 bytes. Cost: two readings of a clock a call.

use crate::base::capacity::{Buffer, Stage, StageStats, count};
use crate::base::geometry::Point;
use crate::detect::classify::Match;
use crate::detect::detection::Detection;
use crate::detect::hough::Candidate;
use crate::detect::vote::Vote;
use crate::extract::delaunay::Triple;
use crate::extract::feature::Feature;
use crate::extract::keygraph::Keygraph;
use crate::image::pyramid::PyramidView;

/// What the stages did with one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Stats {
    /// Counts by stage, in the order of [`Stage::ALL`].
    pub stages: [StageStats; Stage::COUNT],
    /// Clock ticks by stage, in the same order.
    pub ticks: [u64; Stage::COUNT],
}

impl Stats {
    /// Nothing done yet.
    pub(crate) const EMPTY: Self =
        Self { stages: [StageStats { seen: 0, kept: 0, dropped: 0 }; Stage::COUNT], ticks: [0; Stage::COUNT] };

    /// Adds what was done besides.
    pub(crate) fn add(&mut self, more: &Self) {
        self.stages.iter_mut().zip(more.stages).for_each(|(s, m)| add(s, m));
        self.ticks.iter_mut().zip(more.ticks).for_each(|(t, m)| *t += m);
    }
}

/// What is counted while one frame is searched.
#[derive(Clone, Copy, Debug)]
pub struct Tally {
    pub(super) stats: Stats,
    /// Maximum number of elements in each buffer, in the order of [`Buffer::ALL`].
    pub(super) high_water: [u32; Buffer::COUNT],
}

impl Tally {
    pub(super) const EMPTY: Self = Self { stats: Stats::EMPTY, high_water: [0; Buffer::COUNT] };

    /// Notes that a buffer holds so many elements.
    pub(super) fn mark(&mut self, buffer: Buffer, held: usize) {
        let most = &mut self.high_water[buffer as usize];
        *most = (*most).max(count(held));
    }

    /// The counts of a stage.
    pub(super) fn of(&mut self, stage: Stage) -> &mut StageStats {
        &mut self.stats.stages[stage as usize]
    }

    /// Adds to the counts of a stage.
    pub(super) fn add(&mut self, stage: Stage, more: StageStats) {
        add(self.of(stage), more);
    }
}

/// What a stage has just made, for an [`Observer`]. Buffers are used again within a
/// frame: levels, chunks of keygraphs and candidates come one after the other.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Output<'a> {
    /// Level 0 of luma and chroma.
    Planes(PyramidView<'a>),
    /// The levels above it.
    Levels(PyramidView<'a>),
    /// Keypoints of a level, 1/16 px of that level, best first.
    Corners(&'a [Point]),
    /// Triples of indices into these keypoints.
    Triangles(&'a [Triple]),
    /// The keygraphs among them.
    Keygraphs(&'a [Keygraph]),
    /// Features of all keygraphs, of so many bytes each.
    Features(&'a [Feature], usize),
    /// Matches of a chunk of keygraphs, each with the index of its keygraph.
    Matches(&'a [(u16, Match)]),
    /// The votes that came of these matches.
    Votes(&'a [Vote]),
    /// The poses with most votes, heaviest first.
    Candidates(&'a [Candidate]),
    /// What a candidate grew to, if anything.
    Grown(Option<&'a Detection>),
    /// The same, aligned to the frame.
    Aligned(Option<&'a Detection>),
    /// All that has been found, best score first, after each candidate.
    Detections(&'a [Detection]),
}

impl Output<'_> {
    /// The stage that made it.
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
            Self::Aligned(_) | Self::Detections(_) => Stage::Accept,
        }
    }
}

/// Who watches the stages. A closure that returns ticks is one that only times them.
pub trait Observer {
    /// Ticks of a clock that counts up; read between the stages.
    fn now(&mut self) -> u64;

    /// Told what each stage made, outside the time that is counted for it.
    fn saw(&mut self, output: Output<'_>) {
        let _ = output;
    }
}

impl<F: FnMut() -> u64> Observer for F {
    fn now(&mut self) -> u64 {
        self()
    }
}

/// Counts the time of the stages.
pub(crate) struct Laps<'a> {
    observer: &'a mut dyn Observer,
    last: u64,
}

impl<'a> Laps<'a> {
    pub(crate) fn new(observer: &'a mut dyn Observer) -> Self {
        let last = observer.now();
        Self { observer, last }
    }

    /// Ends the work of a stage, and shows what it made.
    #[inline(never)]
    pub(crate) fn end(&mut self, tally: &mut Tally, output: Output<'_>) {
        let now = self.observer.now();
        let ticks = now.wrapping_sub(self.last);
        tally.stats.ticks[output.stage() as usize] += ticks;
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
