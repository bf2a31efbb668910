//! The detector: owns every buffer and runs the stages in order.
//!
//! In: a frame and a model. Out: where the model's objects are. The pipeline can
//! be read top to bottom in [`Detector::detect_with`].
//!
//! Memory: the size of [`Detector`], asserted below for each profile; it lives in
//! a `static` through `const fn new()` and is all zero there. Cost: the sum of
//! the stages, timed by the caller's clock. Full: each stage counts what it
//! dropped in [`Stats`].

use core::mem::size_of;
use core::ops::Range;

use heapless::Vec;

use crate::align::{appearance, is_plausible, refine};
use crate::capacity::{
    Buffer, CANDIDATES, DETECTIONS, FEATURE_BYTES, LEVELS, Room, Stage, StageStats, chroma_bytes, count, luma_bytes,
};
use crate::classify::{Match, NEIGHBOURS, classify};
use crate::corners::{Corner, SCRATCH_ROWS};
use crate::delaunay::{Triangulation, Triple};
use crate::detection::{Agreement, Evidence, score};
use crate::feature::{Feature, FeatureKind, extract};
use crate::finder::Corners;
use crate::frame::{Frame, FrameError, Part};
use crate::geometry::{Homography, Point, contains};
use crate::keygraph::{Keygraph, collect_keygraphs};
use crate::math;
use crate::method::{Lists, Parameters, Sure};
use crate::model::{Model, Object, Tier, View};
use crate::observer::{Laps, add};
use crate::pose::{MAX_CORNERS, Normalised, PRIORS, Pair, Prior, collect_pairs, count_agreeing, grow, start};
use crate::pyramid::{Pyramid, PyramidView, to_level0};
use crate::sort::sort_by_key;
use crate::verify::likeness;
use crate::vote::{Bin, Candidate, Vote, cast, vote};

pub use crate::detection::Detection;
pub use crate::finder::Finder;
pub use crate::observer::{Observer, Output, Stats};

/// Detections below this score are not reported unless the caller asks for them: the score
/// is a probability, and the wrong ones above it are counted in the README.
pub const DEFAULT_THRESHOLD: f32 = 0.8;

/// Everything that a detector owns, sized at compile time. Use a profile:
/// [`QqvgaDetector`], [`QvgaDetector`], [`VgaDetector`], [`HdDetector`].
///
/// `LUMA` and `CHROMA` are bytes of the pyramids, `SIDE` the longest side of a
/// frame, `CORNERS` candidates for corners, `POINTS` corners on a level,
/// `KEYGRAPHS` triples, keygraphs, votes and vertex pairs, `BINS` bins of votes.
#[derive(Debug)]
pub struct Detector<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> {
    finder: Corners<SIDE, POINTS>,
    thorough: bool,
    stages: Stages<LUMA, CHROMA, CORNERS, KEYGRAPHS, BINS>,
}

/// Frames of up to 160 x 120 px.
pub type QqvgaDetector = Detector<{ luma_bytes(160 * 120) }, { chroma_bytes(160 * 120) }, 160, 420, 160, 448, 768>;
/// Frames of up to 320 x 240 px.
pub type QvgaDetector = Detector<{ luma_bytes(320 * 240) }, { chroma_bytes(320 * 240) }, 320, 800, 256, 1024, 2048>;
/// Frames of up to 640 x 480 px.
pub type VgaDetector = Detector<{ luma_bytes(640 * 480) }, { chroma_bytes(640 * 480) }, 640, 2000, 512, 4096, 6144>;
/// Frames of up to 1280 x 720 px.
pub type HdDetector = Detector<{ luma_bytes(1280 * 720) }, { chroma_bytes(1280 * 720) }, 1280, 4000, 1024, 8192, 12288>;

/// The budgets hold the detector and one raw frame of two bytes a pixel.
const fn with_frame(detector: usize, pixels: usize) -> usize {
    detector + 2 * pixels
}
const _: () = assert!(with_frame(size_of::<QqvgaDetector>(), 160 * 120) <= 160 << 10, "qqvga exceeds 160 KB");
const _: () = assert!(with_frame(size_of::<QvgaDetector>(), 320 * 240) <= 480 << 10, "qvga exceeds 480 KB");
const _: () = assert!(with_frame(size_of::<VgaDetector>(), 640 * 480) <= 4 << 20, "vga exceeds 4 MB");
const _: () = assert!(with_frame(size_of::<HdDetector>(), 1280 * 720) <= 12 << 20, "hd exceeds 12 MB");

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Default for Detector<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Detector<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>
{
    /// Longest side of a frame, px.
    pub const MAX_SIDE: usize = {
        assert!(SIDE <= 2047, "positions are 16 bits of 1/16 px: lower SIDE");
        SIDE
    };
    /// Most pixels of a frame.
    pub const MAX_PIXELS: usize = LUMA / 85 * 64;

    /// The buffers, in the order of [`Buffer::ALL`]; the rest of a detector is under 1 KB.
    pub const BUFFERS: [Room; Buffer::COUNT] = [
        Room { bytes: LUMA, capacity: LUMA },
        Room { bytes: 2 * CHROMA, capacity: 2 * CHROMA },
        Room { bytes: size_of::<[[f32; SIDE]; SCRATCH_ROWS]>(), capacity: SIDE * SCRATCH_ROWS },
        Room { bytes: size_of::<Vec<Corner, CORNERS>>(), capacity: CORNERS },
        Room { bytes: size_of::<Vec<Point, CORNERS>>(), capacity: CORNERS },
        Room { bytes: size_of::<Triangulation<POINTS>>(), capacity: POINTS },
        Room { bytes: size_of::<Vec<Triple, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<Vec<Keygraph, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<[Feature; KEYGRAPHS]>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<Vec<Vote, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<[Bin; BINS]>(), capacity: BINS },
        Room { bytes: size_of::<Vec<Pair, KEYGRAPHS>>(), capacity: KEYGRAPHS },
    ];

    /// An idle detector, all zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { finder: Corners::new(), thorough: false, stages: Stages::new() }
    }

    /// Whether to search all of a frame for all of a model. Otherwise the search goes on only
    /// while something is in doubt, which takes a fifth of the time where an object is seen
    /// plainly: each object of a model of many is sought by the likeliest of its keygraphs, and
    /// of more than 16, once one has been found, only those that much speaks for; beside a large
    /// copy of an object one under half its size may be missed.
    pub const fn set_thorough(&mut self, thorough: bool) {
        self.thorough = thorough;
    }

    /// Looks for the model's objects in `frame`: all that score at least
    /// `threshold`, best first. `observer` is asked for the time between the stages,
    /// and shown what they make.
    ///
    /// # Errors
    /// [`FrameError::TooLarge`] when the frame exceeds the profile.
    pub fn detect(
        &mut self,
        frame: &Frame<'_>,
        model: &Model<'_>,
        threshold: f32,
        observer: &mut dyn Observer,
    ) -> Result<&[Detection], FrameError> {
        self.stages.clear();
        Self::check(frame)?;
        self.finder.set_rules(model.method().parameters());
        let wish = Wish { threshold, thorough: self.thorough };
        self.stages.detect(frame, model, wish, observer, &mut self.finder)
    }

    /// The same with keypoints and triples from elsewhere.
    ///
    /// # Errors
    /// [`FrameError::TooLarge`] when the frame exceeds the profile.
    pub fn detect_with(
        &mut self,
        frame: &Frame<'_>,
        model: &Model<'_>,
        threshold: f32,
        observer: &mut dyn Observer,
        finder: &mut impl Finder,
    ) -> Result<&[Detection], FrameError> {
        self.stages.clear();
        Self::check(frame)?;
        self.stages.detect(frame, model, Wish { threshold, thorough: self.thorough }, observer, finder)
    }

    /// Takes in the luma of a part of `frame`, which becomes the [`Detector::frame`], and looks
    /// for nothing; `observer` is asked for the time between the stages.
    pub(crate) fn load_luma(
        &mut self,
        frame: &Frame<'_>,
        part: &Part,
        observer: &mut dyn Observer,
    ) -> Result<(), FrameError> {
        self.stages.clear();
        Self::check(frame)?;
        let start = observer.now();
        self.stages.pyramid.load_luma(frame, part);
        let loaded = observer.now();
        self.stages.pyramid.reduce_luma();
        let ticks = &mut self.stages.stats.ticks;
        ticks[Stage::Convert as usize] = loaded.wrapping_sub(start);
        ticks[Stage::Pyramid as usize] = observer.now().wrapping_sub(loaded);
        Ok(())
    }

    /// The last frame, or the part of it that was taken in.
    pub(crate) fn frame(&self) -> PyramidView<'_> {
        self.stages.pyramid.view()
    }

    fn check(frame: &Frame<'_>) -> Result<(), FrameError> {
        let (w, h) = (frame.width(), frame.height());
        if w.max(h) > Self::MAX_SIDE || !Pyramid::<LUMA, CHROMA>::fits(w, h) {
            let (pixels, side) = (w * h, w.max(h));
            return Err(FrameError::TooLarge { pixels, max_pixels: Self::MAX_PIXELS, side, max_side: SIDE });
        }
        Ok(())
    }

    /// What was found in the last frame.
    #[must_use]
    pub fn detections(&self) -> &[Detection] {
        &self.stages.detections
    }

    /// What the stages did with the last frame.
    #[must_use]
    pub const fn stats(&self) -> &Stats {
        &self.stages.stats
    }

    /// Most elements that each buffer held while the last frame was searched, in the order
    /// of [`Buffer::ALL`].
    #[must_use]
    pub const fn high_water(&self) -> &[u32; Buffer::COUNT] {
        &self.stages.high_water
    }

    /// The corners of the last frame, frame px.
    pub fn corners(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        let s = &self.stages;
        (0..LEVELS).flat_map(|l| s.points[s.range(l)].iter().map(move |&p| to_level0(p, l)))
    }

    /// The triangles of the last frame that were classified, frame px.
    pub fn keygraphs(&self) -> impl Iterator<Item = [[f32; 2]; 3]> + '_ {
        self.stages.keygraphs.iter().map(|k| self.stages.vertices(k).map(|(_, p)| p))
    }

    /// The triangles of the last frame that agree with a detection, frame px.
    pub fn supporters<'a>(
        &'a self,
        model: &'a Model<'_>,
        detection: &'a Detection,
    ) -> impl Iterator<Item = [[f32; 2]; 3]> + 'a {
        let agrees = Agreement::new(detection);
        self.stages.votes.iter().filter_map(move |v| {
            let to = self.stages.vertices(&self.stages.keygraphs[usize::from(v.frame_keygraph)]).map(|(_, p)| p);
            agrees.holds(model, v, to).then_some(to)
        })
    }
}

/// Blocks that agree from which on a pose is not grown a second time.
const CONVINCING: f32 = 8.0;

/// Least area of an outline, px, and most that a side may be shrunk against its
/// opposite.
pub(crate) const MIN_AREA_PX: f32 = 144.0;
pub(crate) const MAX_RATIO: f32 = 4.0;

/// Keygraphs that are matched before their matches are verified.
const CHUNK: usize = 16;

/// The level whose pixels are three in four of all: searched last.
const FINEST: usize = 0;

/// What is wanted of a search.
#[derive(Clone, Copy)]
struct Wish {
    threshold: f32,
    thorough: bool,
}

/// What the search of a frame needs besides the buffers.
struct Search<'a, 'o, F> {
    model: &'a Model<'a>,
    finder: &'a mut F,
    wish: Wish,
    /// Keygraphs of the levels above the finest, which come first.
    coarse: usize,
    /// Whether those of the finest are there.
    looked_closer: bool,
    laps: Laps<'o>,
}

/// The buffers between the stages.
#[derive(Debug)]
struct Stages<const LUMA: usize, const CHROMA: usize, const CORNERS: usize, const KEYGRAPHS: usize, const BINS: usize> {
    pyramid: Pyramid<LUMA, CHROMA>,
    corners: Vec<Corner, CORNERS>,
    /// Keypoints of all levels, in the order in which these are searched.
    points: Vec<Point, CORNERS>,
    /// Where the keypoints of each level start and end.
    spans: [(u16, u16); LEVELS],
    triples: Vec<Triple, KEYGRAPHS>,
    keygraphs: Vec<Keygraph, KEYGRAPHS>,
    features: [Feature; KEYGRAPHS],
    /// Matches of a chunk of keygraphs, each with its keygraph.
    matches: Vec<(u16, Match), { CHUNK * NEIGHBOURS }>,
    votes: Vec<Vote, KEYGRAPHS>,
    bins: [Bin; BINS],
    candidates: Vec<Candidate, CANDIDATES>,
    pairs: Vec<Pair, KEYGRAPHS>,
    detections: Vec<Detection, DETECTIONS>,
    stats: Stats,
    high_water: [u32; Buffer::COUNT],
}

impl<const LUMA: usize, const CHROMA: usize, const CORNERS: usize, const KEYGRAPHS: usize, const BINS: usize>
    Stages<LUMA, CHROMA, CORNERS, KEYGRAPHS, BINS>
{
    const FITS: () = assert!(
        CORNERS <= MAX_CORNERS && KEYGRAPHS < u16::MAX as usize,
        "ids are u16 and corners are counted in a bit set: lower CORNERS or KEYGRAPHS"
    );

    const fn new() -> Self {
        let () = Self::FITS;
        Self {
            pyramid: Pyramid::new(),
            corners: Vec::new(),
            points: Vec::new(),
            spans: [(0, 0); LEVELS],
            triples: Vec::new(),
            keygraphs: Vec::new(),
            features: [[0; FEATURE_BYTES]; KEYGRAPHS],
            matches: Vec::new(),
            votes: Vec::new(),
            bins: [Bin::FREE; BINS],
            candidates: Vec::new(),
            pairs: Vec::new(),
            detections: Vec::new(),
            stats: Stats::EMPTY,
            high_water: [0; Buffer::COUNT],
        }
    }

    /// Forgets the frame before.
    fn clear(&mut self) {
        self.stats = Stats::default();
        self.high_water = [0; Buffer::COUNT];
        self.detections.clear();
        self.points.clear();
        self.spans = [(0, 0); LEVELS];
        self.keygraphs.clear();
        self.votes.clear();
    }

    /// Notes that a buffer holds so many elements.
    fn mark(&mut self, buffer: Buffer, held: usize) {
        let most = &mut self.high_water[buffer as usize];
        *most = (*most).max(count(held));
    }

    fn vertices(&self, k: &Keygraph) -> [(u16, [f32; 2]); 3] {
        vertices(&self.points, k)
    }

    /// The keypoints of a level.
    fn range(&self, level: usize) -> Range<usize> {
        let (start, end) = self.spans[level];
        usize::from(start)..usize::from(end)
    }

    /// Runs the stages. None of them is inlined, so that the stack holds what one of
    /// them needs, not what they need together.
    fn detect(
        &mut self,
        frame: &Frame<'_>,
        model: &Model<'_>,
        wish: Wish,
        observer: &mut dyn Observer,
        finder: &mut impl Finder,
    ) -> Result<&[Detection], FrameError> {
        let rules = model.method().parameters();
        let mut laps = Laps::new(observer);
        self.pyramid.load(frame)?;
        laps.end(&mut self.stats, Output::Planes(self.pyramid.view()));
        self.pyramid.reduce();
        let view = self.pyramid.view();
        let luma = (0..LEVELS).map(|l| view.luma(l).width() * view.luma(l).height()).sum();
        let chroma = (0..LEVELS).flat_map(|l| view.chroma(l)).map(|c| c.width() * c.height()).sum();
        self.mark(Buffer::Luma, luma);
        self.mark(Buffer::Chroma, chroma);
        self.mark(Buffer::CornerRows, SCRATCH_ROWS * frame.width());
        laps.end(&mut self.stats, Output::Levels(self.pyramid.view()));

        for level in FINEST + 1..LEVELS {
            self.find_level(level, rules, finder, &mut laps);
        }
        self.extract_features(model, 0, &mut laps);
        let coarse = self.keygraphs.len();
        let mut search = Search { model, finder, wish, coarse, looked_closer: false, laps };
        if let Some(lists) = rules.lists.as_ref().filter(|_| model.has_lists() && !wish.thorough) {
            self.seek_all(&mut search, lists);
        } else {
            for object in 0..model.objects() {
                self.seek(&mut search, u16::try_from(object).unwrap_or(u16::MAX));
            }
        }
        #[cfg(feature = "defmt")]
        self.log(model);
        Ok(&self.detections)
    }

    /// Finds the keygraphs of a level.
    fn find_level(&mut self, level: usize, rules: &Parameters, finder: &mut impl Finder, laps: &mut Laps<'_>) {
        self.find_keypoints(level, finder);
        let range = self.range(level);
        laps.end(&mut self.stats, Output::Corners(&self.points[range]));
        self.find_triples(level, finder);
        laps.end(&mut self.stats, Output::Triangles(&self.triples));
        let first = self.keygraphs.len();
        self.find_keygraphs(level, rules);
        laps.end(&mut self.stats, Output::Keygraphs(&self.keygraphs[first..]));
    }

    /// Finds the keygraphs of the finest level, unless that has been done.
    fn look_closer(&mut self, s: &mut Search<'_, '_, impl Finder>) {
        if !s.looked_closer {
            s.looked_closer = true;
            self.find_level(FINEST, s.model.method().parameters(), s.finder, &mut s.laps);
            self.extract_features(s.model, s.coarse, &mut s.laps);
        }
    }

    /// Finds the matches, in a tier, of the keygraphs of the coarse levels or of the finest, and
    /// casts their votes.
    fn search(&mut self, s: &mut Search<'_, '_, impl Finder>, tier: Tier, finest: bool) {
        if finest {
            self.look_closer(s);
        }
        let keygraphs = if finest { s.coarse..self.keygraphs.len() } else { 0..s.coarse };
        for first in keygraphs.clone().step_by(CHUNK) {
            self.find_matches(s.model, tier, first..keygraphs.end.min(first + CHUNK));
            s.laps.end(&mut self.stats, Output::Matches(&self.matches));
            let first = self.votes.len();
            self.cast_votes(s.model);
            s.laps.end(&mut self.stats, Output::Votes(&self.votes[first..]));
        }
    }

    /// Finds the poses that most votes from `first` on speak for.
    #[inline(never)]
    fn find_candidates(&mut self, rules: &Parameters, first: usize) {
        let candidates = &mut self.candidates;
        add(stage(&mut self.stats, Stage::Vote), vote(&self.votes[first..], &rules.voting, &mut self.bins, candidates));
        candidates.truncate(rules.candidates);
        let bins = self.bins.iter().filter(|b| !b.is_free()).count();
        self.mark(Buffer::Bins, bins);
    }

    /// Looks for all objects at once, by more and more of the lists and of the frame. Of many
    /// objects, once one has been found, others are only looked for where much speaks for them.
    fn seek_all(&mut self, s: &mut Search<'_, '_, impl Finder>, lists: &Lists) {
        let rules = s.model.method().parameters();
        let wanted = s.wish.threshold;
        let odds = (lists.odds * s.model.objects() as f32).max(1.0);
        let score = odds * wanted / (1.0 + (odds - 1.0) * wanted);
        let last_pass = Sure { weight: rules.voting.min_weight, score, heavy: 0, support: 0.0 };
        let mut settled = 0;
        for tier in [Tier::Shortlist, Tier::Longlist] {
            for finest in [false, true] {
                let go_on = s.model.objects() <= lists.few || self.detections.is_empty();
                if !go_on && !self.leaves_doubt(lists.doubt) {
                    return;
                }
                self.search(s, tier, finest);
                let sure = if finest && tier == Tier::Longlist { &last_pass } else { &rules.first_pass };
                loop {
                    let known = self.detections.len();
                    self.decide(s, settled, Some(sure));
                    settled = self.settle(s.model);
                    if self.detections.len() <= known {
                        break;
                    }
                }
            }
        }
    }

    /// Looks for an object, by more and more of the frame and the model until nothing is left in
    /// doubt: by the keygraphs of the coarse levels, first among those that are likeliest to be
    /// seen again, then among the others; then by those of the finest level.
    fn seek(&mut self, s: &mut Search<'_, '_, impl Finder>, object: u16) {
        let (model, rules) = (s.model, s.model.method().parameters());
        // Before them are the supporters of what has been found.
        let votes = self.votes.len();
        let [first, second] = [Tier::First(object), Tier::Second(object)];
        let steps = [(false, first), (false, second), (true, first), (true, second)];
        let steps = steps.into_iter().filter(|&(_, tier)| tier == first || model.has_second_tiers());
        for (i, (finest, tier)) in steps.enumerate() {
            let doubt = rules.doubt[usize::from(finest)];
            let go_on = s.wish.thorough || !self.has_found(object) || self.leaves_doubt(doubt);
            if i > 0 && !go_on {
                break;
            }
            self.search(s, tier, finest);
            let last = finest && (tier == second || !model.has_second_tiers());
            if last || !s.wish.thorough {
                self.decide(s, votes, (!last).then_some(&rules.first_pass));
            }
        }
        if model.objects() > 1 {
            let supporters = self.settle(model);
            self.votes.truncate(supporters);
        }
    }

    /// Finds the poses that most votes from `first` on speak for, and examines them where
    /// nothing has been found; keeps only what is sure, if so asked.
    fn decide(&mut self, s: &mut Search<'_, '_, impl Finder>, first: usize, sure: Option<&Sure>) {
        // A keygraph counts once in a bin: its votes have to stand together.
        sort_by_key(&mut self.votes[first..], |v| (v.frame_keygraph, v.model_keygraph));
        self.find_candidates(s.model.method().parameters(), first);
        s.laps.end(&mut self.stats, Output::Candidates(&self.candidates));
        let Self { candidates, detections, .. } = self;
        candidates.retain(|c| !is_found(detections, c.object, c.pose.centre));
        self.examine(s, sure);
    }

    fn has_found(&self, object: u16) -> bool {
        self.detections.iter().any(|d| d.object == object)
    }

    /// Whether a candidate of at least this weight may be the object last sought, or a copy of
    /// it, where none has been found.
    fn leaves_doubt(&self, weight: u32) -> bool {
        let found = |c: &Candidate| is_found(&self.detections, c.object, c.pose.centre);
        self.candidates.iter().any(|c| c.weight >= weight && !found(c))
    }

    /// Puts the votes that support what has been found first, and says how many they are.
    /// Others for an object that lie in its outline are forgotten.
    #[inline(never)]
    fn settle(&mut self, model: &Model<'_>) -> usize {
        let Self { votes, keygraphs, points, detections, .. } = self;
        let found: Vec<_, DETECTIONS> = detections.iter().map(Agreement::new).collect();
        let at = |v: &Vote| vertices(points, &keygraphs[usize::from(v.frame_keygraph)]).map(|(_, p)| p);
        let mut supporters = 0;
        for i in 0..votes.len() {
            let v = votes[i];
            if found.iter().any(|a| a.holds(model, &v, at(&v))) {
                votes.swap(i, supporters);
                supporters += 1;
            }
        }
        let mut i = 0;
        votes.retain(|v| {
            i += 1;
            i <= supporters || !is_found(detections, v.object, at(v)[0])
        });
        supporters
    }

    /// Grows and aligns the candidates, and keeps those that score enough; only what is
    /// sure, if so asked.
    fn examine(&mut self, s: &mut Search<'_, '_, impl Finder>, sure: Option<&Sure>) {
        let (model, laps) = (s.model, &mut s.laps);
        let threshold = sure.map_or(s.wish.threshold, |sure| s.wish.threshold.max(sure.score));
        for i in 0..self.candidates.len() {
            let candidate = self.candidates[i];
            if sure.is_some_and(|sure| candidate.weight < sure.weight) {
                break;
            }
            if model.method().parameters().grow {
                let (map, start) = self.find_pairs(model, &candidate);
                let mut best: Option<Detection> = None;
                for prior in PRIORS {
                    let grown = self.grow(model, candidate.object, &map, &start, prior);
                    laps.end(&mut self.stats, Output::Grown(grown.as_ref()));
                    let aligned = grown.and_then(|d| self.align(model, d));
                    laps.end(&mut self.stats, Output::Aligned(aligned.as_ref()));
                    let support = |d: &Option<Detection>| d.map_or(-1.0, |d| d.appearance.support);
                    if support(&aligned) > support(&best) {
                        best = aligned;
                    }
                    if support(&best) >= CONVINCING {
                        break;
                    }
                }
                let enough = |d: &Detection| {
                    sure.is_none_or(|s| candidate.weight >= s.heavy || d.appearance.support >= s.support)
                };
                if let Some(d) = best.filter(enough) {
                    let d = self.weigh_evidence(model, &map, d);
                    self.accept(d, threshold);
                }
            } else {
                self.accept(similar(model, &candidate), threshold);
            }
            laps.end(&mut self.stats, Output::Detections(&self.detections));
        }
    }

    /// One line a stage, and one a detection.
    #[cfg(feature = "defmt")]
    fn log(&self, model: &Model<'_>) {
        for (stage, s) in Stage::ALL.iter().zip(&self.stats.stages) {
            defmt::debug!("{=str}: seen {} kept {} dropped {}", stage.name(), s.seen, s.kept, s.dropped);
        }
        for d in &self.detections {
            let name = model.object(usize::from(d.object)).name;
            defmt::debug!("found {=str}, score {}, corners {}", name, d.score, d.corners);
        }
    }

    #[inline(never)]
    fn find_keypoints(&mut self, level: usize, finder: &mut impl Finder) {
        self.corners.clear();
        let start = self.points.len();
        let luma = self.pyramid.view().luma(level);
        if luma.width().min(luma.height()) >= 8 {
            let mut stats = finder.keypoints(luma, level, &mut self.corners);
            self.mark(Buffer::Corners, CORNERS.min(stats.seen as usize).max(self.corners.len()));
            self.mark(Buffer::Triangulation, self.corners.len());
            let room = self.points.capacity() - self.points.len();
            let lost = self.corners.len().saturating_sub(room);
            // As many as fit.
            self.points.extend(self.corners.iter().take(room).map(|c| c.point));
            stats.kept = stats.kept.saturating_sub(count(lost));
            stats.dropped += count(lost);
            add(stage(&mut self.stats, Stage::Corners), stats);
        }
        self.mark(Buffer::Keypoints, self.points.len());
        // Fewer than MAX_CORNERS.
        self.spans[level] = [start, self.points.len()].map(|n| u16::try_from(n).unwrap_or(u16::MAX)).into();
    }

    #[inline(never)]
    fn find_triples(&mut self, level: usize, finder: &mut impl Finder) {
        self.triples.clear();
        let points = &self.points[self.range(level)];
        let stats = finder.triples(points, &mut self.triples);
        self.mark(Buffer::Triples, self.triples.len());
        add(stage(&mut self.stats, Stage::Delaunay), stats);
    }

    fn find_keygraphs(&mut self, level: usize, rules: &Parameters) {
        let range = self.range(level);
        let n = u16::try_from(range.len()).unwrap_or(0);
        // A foreign finder may err; a triple of what is not there is no triple.
        self.triples.retain(|t| t.iter().all(|&v| v < n));
        let first = u16::try_from(range.start).unwrap_or(0);
        let level = u8::try_from(level).unwrap_or(0);
        let points = &self.points[range];
        let stats = collect_keygraphs(points, &self.triples, &rules.scalene, first, level, &mut self.keygraphs);
        self.mark(Buffer::Keygraphs, self.keygraphs.len());
        self.mark(Buffer::Features, self.keygraphs.len());
        add(stage(&mut self.stats, Stage::Keygraphs), stats);
    }

    #[inline(never)]
    fn extract_features(&mut self, model: &Model<'_>, first: usize, laps: &mut Laps<'_>) {
        let view = self.pyramid.view();
        for (k, f) in self.keygraphs.iter().zip(&mut self.features).skip(first) {
            let points = k.vertices.map(|v| self.points[usize::from(v)]);
            *f = extract(&view, usize::from(k.level), points, k.size, model.feature(), model.method().sampling());
        }
        let n = count(self.keygraphs.len() - first);
        add(stage(&mut self.stats, Stage::Features), StageStats { seen: n, kept: n, dropped: 0 });
        let features = &self.features[first..self.keygraphs.len()];
        laps.end(&mut self.stats, Output::Features(features, model.feature_bytes()));
    }

    /// Matches these keygraphs, at most a chunk of them.
    #[inline(never)]
    fn find_matches(&mut self, model: &Model<'_>, tier: Tier, chunk: Range<usize>) {
        let rules = model.method().parameters();
        let mut matching = rules.matching;
        if let (Some(list), Some(lists)) = (tier.list(), &rules.lists)
            && model.objects() > lists.few
        {
            let many = model.objects() > lists.many;
            matching.max_bits = lists.shares[list].max_bits[usize::from(many)];
            matching.max_marks = lists.shares[list].max_marks;
        }
        self.matches.clear();
        let seen = count(chunk.len());
        for i in chunk {
            let k = &self.keygraphs[i];
            if tier.object().is_some_and(|o| is_found(&self.detections, o, self.vertices(k)[0].1)) {
                continue;
            }
            let id = u16::try_from(i).unwrap_or(0);
            let nearest = classify(model, tier, k, &self.features[i], &matching);
            // They fit: a keygraph has at most NEIGHBOURS of them.
            self.matches.extend(nearest.into_iter().flatten().map(|m| (id, m)));
        }
        let stats = StageStats { seen, kept: count(self.matches.len()), dropped: 0 };
        add(stage(&mut self.stats, Stage::Classify), stats);
    }

    /// Casts the votes of the matches whose surroundings look alike.
    #[inline(never)]
    fn cast_votes(&mut self, model: &Model<'_>) {
        let rules = model.method().parameters();
        let frame = self.pyramid.view();
        let gray = model.feature() == FeatureKind::Luma;
        let mut stats = StageStats { seen: count(self.matches.len()), ..StageStats::default() };
        for &(i, m) in &self.matches {
            let to = vertices(&self.points, &self.keygraphs[usize::from(i)]).map(|(_, p)| p);
            let (v, from) = model.keygraph(m.keygraph as usize);
            let (v, from) = (model.view(v), from.map(Point::px));
            let o = model.object(usize::from(v.object));
            let weight = match rules.verify {
                Some(least) => weigh(&frame, &o, &v, &from, &to, gray, least),
                None => Some(1),
            };
            let Some(v) = weight.and_then(|w| cast(&o, &v, m, i, from, to, w)) else { continue };
            match self.votes.push(v) {
                Ok(()) => stats.kept += 1,
                Err(_) => stats.dropped += 1,
            }
        }
        self.mark(Buffer::Votes, self.votes.len());
        add(stage(&mut self.stats, Stage::Verify), stats);
    }

    /// Gathers the vertex pairs near a candidate; gives the coordinates that they are in, and
    /// where to grow from.
    #[inline(never)]
    fn find_pairs(&mut self, model: &Model<'_>, candidate: &Candidate) -> (Normalised, Homography) {
        let Self { keygraphs, points, votes, pairs, .. } = self;
        let corners = |i: u16| vertices(points, &keygraphs[usize::from(i)]);
        let start = start(model, candidate, votes);
        let (map, lost) = collect_pairs(model, candidate, &start, votes, corners, pairs);
        let stats = stage(&mut self.stats, Stage::Pose);
        stats.seen += 1;
        stats.dropped += lost.dropped;
        self.mark(Buffer::Pairs, self.pairs.len());
        (map, start)
    }

    /// Grows a candidate over its pairs; `None` when that leads nowhere, or to what
    /// has been found.
    #[inline(never)]
    fn grow(
        &mut self,
        model: &Model<'_>,
        object: u16,
        map: &Normalised,
        start: &Homography,
        prior: Prior,
    ) -> Option<Detection> {
        let homography = grow(start, map, &self.pairs, prior)?;
        stage(&mut self.stats, Stage::Pose).kept += 1;
        let d = Detection {
            agreeing: count_agreeing(map, &self.pairs, &homography),
            ..Detection::at(model, object, &homography)
        };
        let known = self.detections.iter().any(|t| d.is_twin(t) && t.agreeing >= d.agreeing);
        (is_plausible(&d.corners, MIN_AREA_PX, MAX_RATIO) && !known).then_some(d)
    }

    /// Aligns a grown pose with the frame; `None` when that is hopeless.
    #[inline(never)]
    fn align(&mut self, model: &Model<'_>, d: Detection) -> Option<Detection> {
        stage(&mut self.stats, Stage::Accept).seen += 1;
        let o = model.object(usize::from(d.object));
        let (view, w, h) = (self.pyramid.view(), o.width as f32, o.height as f32);
        let aligned = refine(&view, &o.template, &d.homography, w, h)?;
        let appearance = appearance(&view, &o.template, &aligned, w, h);
        Some(Detection { appearance, ..Detection::at(model, d.object, &aligned) })
    }

    /// Counts what speaks for a detection, and scores it.
    #[inline(never)]
    fn weigh_evidence(&self, model: &Model<'_>, map: &Normalised, mut d: Detection) -> Detection {
        d.agreeing = count_agreeing(map, &self.pairs, &d.homography);
        let mut inside = [0u32; MAX_CORNERS / 32];
        for level in 0..LEVELS {
            for i in self.range(level) {
                let within = contains(&d.corners, to_level0(self.points[i], level));
                inside[i / 32] |= u32::from(within) << (i % 32);
            }
        }
        let within = |k: &Keygraph| k.vertices.iter().all(|&v| inside[usize::from(v) / 32] >> (v % 32) & 1 == 1);
        let agrees = Agreement::new(&d);
        let mut evidence = Evidence::default();
        for v in self.votes.iter().filter(|v| v.object == d.object) {
            let k = &self.keygraphs[usize::from(v.frame_keygraph)];
            evidence.votes += u16::from(within(k));
            if agrees.holds(model, v, vertices(&self.points, k).map(|(_, p)| p)) {
                d.votes += 1;
                evidence.agreeing += u32::from(v.weight);
            }
        }
        // They fit: there are fewer keygraphs than 65,536.
        evidence.keygraphs = u16::try_from(self.keygraphs.iter().filter(|k| within(k)).count()).unwrap_or(u16::MAX);
        d.score = score(&d.appearance, &evidence);
        d
    }

    /// Keeps a detection if it is likely enough and the best at its place.
    #[inline(never)]
    fn accept(&mut self, d: Detection, threshold: f32) {
        let beaten = self.detections.iter().any(|t| d.is_twin(t) && t.score >= d.score);
        if d.score < threshold || !is_plausible(&d.corners, MIN_AREA_PX, MAX_RATIO) || beaten {
            return;
        }
        self.detections.retain(|t| !d.is_twin(t));
        let worse = |t: &Detection| t.score.total_cmp(&d.score).is_lt();
        let place = self.detections.iter().position(worse).unwrap_or(self.detections.len());
        let full = self.detections.insert(place, d).is_err();
        let stats = stage(&mut self.stats, Stage::Accept);
        stats.dropped += u32::from(full);
        stats.kept = count(self.detections.len());
    }
}

/// Whether an object has been found at a place, frame px.
fn is_found(detections: &[Detection], object: u16, at: [f32; 2]) -> bool {
    detections.iter().any(|d| d.object == object && contains(&d.corners, at))
}

/// A candidate as it is: the paper.
fn similar(model: &Model<'_>, c: &Candidate) -> Detection {
    let o = model.object(usize::from(c.object));
    let map = Normalised::new(o.width as f32, o.height as f32, c.pose.centre, c.pose.size_px());
    Detection {
        votes: u16::try_from(c.weight).unwrap_or(u16::MAX),
        score: 1.0 - 1.0 / (c.weight as f32 + 1.0),
        ..Detection::at(model, c.object, &map.to_px(&c.pose.turn()))
    }
}

/// How much the vote of a match counts, 1 to 16; `None` when its surroundings are
/// less than `least` alike.
fn weigh(
    frame: &PyramidView<'_>,
    object: &Object<'_>,
    view: &View,
    from: &[[f32; 2]; 3],
    to: &[[f32; 2]; 3],
    gray: bool,
    least: f32,
) -> Option<u8> {
    let to_template = object.template.from_picture(object.width as f32, object.height as f32).after(&view.to_picture);
    let l = likeness(frame, &object.template, &from.map(|p| to_template.apply_affine(p)), to, gray);
    (l >= least).then(|| u8::try_from(math::round(1.0 + 15.0 * (l - least) / (2.0 - least))).unwrap_or(1))
}

/// The vertices of a keygraph: their indices and places in level 0, px.
fn vertices(points: &[Point], k: &Keygraph) -> [(u16, [f32; 2]); 3] {
    k.vertices.map(|v| (v, to_level0(points[usize::from(v)], usize::from(k.level))))
}

fn stage(stats: &mut Stats, s: Stage) -> &mut StageStats {
    &mut stats.stages[s as usize]
}
