//! The detector: finds the objects of a model in a frame.
//!
//! In: a frame and a model. Out: where the model's objects are. [`Detector`] checks the frame,
//! makes its pyramid, and searches it as the plan says.
//!
//! Memory: the buffers of the profile, and a flag. A detector fits a `static`, because `new` is a
//! `const fn`, and is all zero there. Cost: the sum of the stages, timed by the caller's clock.
//! Full: each stage counts what it dropped in [`Stats`].

use crate::base::capacity::{Buffer, LEVELS, Room, Stage};
#[cfg(feature = "crew")]
use crate::base::crew::Crew;
use crate::base::pace::Steady;
use crate::detect::buffers::{Buffers, Hd, Lent, Limits, Profile, Qqvga, Qvga, Vga};
use crate::detect::detection::Detection;
use crate::detect::evidence::Agreement;
use crate::detect::finder::{Corners, Finder};
use crate::detect::help::Foresight;
use crate::detect::matches::{CellMatch, matches};
use crate::detect::observer::{Laps, Observer, Output, Stats, Tally, passed};
use crate::detect::plan::{Depth, Plan, Scope, Wish};
use crate::detect::scene::{Context, FINEST, Scene, span, vertices};
use crate::detect::search::{Place, Search};
use crate::detect::surface::{self, Eye, Known, Surface};
use crate::extract::corners::SCRATCH_ROWS;
use crate::image::frame::{Frame, FrameError, MIN_SIDE, Window};
use crate::image::pyramid::{PyramidMut, PyramidView, to_level0};
use crate::model::parse::Model;

/// Default minimum score of a detection. A score is the estimated probability that the detection is
/// right. `docs/measured.md` counts the wrong detections above this threshold.
pub const DEFAULT_THRESHOLD: f32 = 0.8;

/// Finds the objects of a model in frames of one profile: [`QqvgaDetector`], [`QvgaDetector`],
/// [`VgaDetector`], [`HdDetector`]. `Detector<dyn Profile>` stands for any of them behind a
/// reference.
#[derive(Debug)]
pub struct Detector<P: Profile + ?Sized> {
    depth: Depth,
    visible: f32,
    /// Number of frames, and parts of frames, that have been loaded.
    loads: u32,
    buffers: P,
}

/// Detector for frames of up to 160 x 120 px.
pub type QqvgaDetector = Detector<Qqvga>;
/// Detector for frames of up to 320 x 240 px.
pub type QvgaDetector = Detector<Qvga>;
/// Detector for frames of up to 640 x 480 px.
pub type VgaDetector = Detector<Vga>;
/// Detector for frames of up to 1280 x 720 px.
pub type HdDetector = Detector<Hd>;

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Detector<Buffers<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>>
{
    /// Creates an idle detector; all its bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self { depth: Depth::Usual, visible: 0.0, loads: 0, buffers: Buffers::new() }
    }
}

impl<P: Profile + Default> Default for Detector<P> {
    fn default() -> Self {
        Self { depth: Depth::Usual, visible: 0.0, loads: 0, buffers: P::default() }
    }
}

impl<P: Profile + ?Sized> Detector<P> {
    /// Sets how much of a frame is searched, and for how much of a model.
    pub const fn set_depth(&mut self, depth: Depth) {
        self.depth = depth;
    }

    /// Sets the minimum share of an object that must be seen, 0 to 1: [`Appearance::visible`]. 0, the
    /// default, leaves the decision to the score.
    ///
    /// [`Appearance::visible`]: crate::Appearance::visible
    pub const fn set_min_visible(&mut self, visible: f32) {
        self.visible = visible;
    }

    /// Sets the cores that share a search. The results do not depend on them. While others help, the caller's core asks
    /// [`Observer::goes_on`] once for every sixteen keygraphs, and another core that has begun with the finest level or
    /// with half of the features comes to its end. The time of `verify` counts as `classify`.
    #[cfg(feature = "crew")]
    pub fn set_crew(&mut self, crew: Option<&'static dyn Crew>) {
        self.buffers.set_crew(crew);
    }

    /// Searches `frame` for the objects of `model`. Returns the detections that score at least
    /// `threshold`, best first. `observer` is asked for the time between the stages, and is shown
    /// what they make. It may also tell the search to stop, [`Observer::goes_on`]: the detections are
    /// then those of what has been searched, [`Stats::stopped`].
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
        self.run(frame, model, threshold, observer, None)
    }

    /// Searches `frame` for the objects of `model`, by keypoints and triples from `finder`. The
    /// rest is as in [`Detector::detect`].
    ///
    /// # Errors
    /// [`FrameError::TooLarge`] when the frame exceeds the profile.
    pub fn detect_with(
        &mut self,
        frame: &Frame<'_>,
        model: &Model<'_>,
        threshold: f32,
        observer: &mut dyn Observer,
        finder: &mut dyn Finder,
    ) -> Result<&[Detection], FrameError> {
        self.run(frame, model, threshold, observer, Some(finder))
    }

    /// Begins to search `frame` for the objects of `model`, for a task that must give others their turn
    /// between the pieces of a search, such as one of an async executor. The frame is read here; its
    /// buffer may be used again. The rest is as in [`Detector::detect`].
    ///
    /// # Errors
    /// [`FrameError::TooLarge`] when the frame exceeds the profile.
    pub fn begin<'a>(
        &'a mut self,
        frame: &Frame<'_>,
        model: &'a Model<'a>,
        threshold: f32,
        observer: &mut dyn Observer,
    ) -> Result<Ongoing<'a, P>, FrameError> {
        self.load(frame, &mut Laps::new(observer))?;
        let plan = self.plan(model, threshold);
        Ok(Ongoing { detector: self, model, plan, place: Place::START })
    }

    /// Begins to search the frame that was read last for the objects of another model, such as one that lies
    /// elsewhere in flash: models need not be merged, and the caller's buffer may hold the next frame by now. What
    /// was found so far is given up: take it before. A detector that has read no frame finds nothing.
    pub fn begin_again<'a>(&'a mut self, model: &'a Model<'a>, threshold: f32) -> Ongoing<'a, P> {
        // A search that a tracker has kept does not go on in these buffers.
        self.loads = self.loads.wrapping_add(1);
        cleared(self.buffers.lend());
        let plan = self.plan(model, threshold);
        Ongoing { detector: self, model, plan, place: Place::START }
    }

    /// What a search with this threshold looks for.
    pub(crate) const fn wish(&self, threshold: f32) -> Wish {
        Wish { threshold, visible: self.visible, depth: self.depth }
    }

    pub(crate) fn plan(&self, model: &Model<'_>, threshold: f32) -> Plan {
        Plan::new(Scope::from(model), model.method().parameters(), self.wish(threshold))
    }

    /// Number of frames that have been loaded: it tells whether a search can still go on.
    pub(crate) const fn loads(&self) -> u32 {
        self.loads
    }

    /// Checks that a frame fits the profile.
    pub(crate) fn check(&mut self, frame: &Frame<'_>) -> Result<(), FrameError> {
        let limits = self.buffers.limits();
        check(frame, limits, &self.buffers.lend().pyramid)
    }

    /// Loads a frame for [`Detector::go_on`].
    pub(crate) fn load_frame(&mut self, frame: &Frame<'_>, observer: &mut dyn Observer) -> Result<(), FrameError> {
        let mut whole = Whole { observer, stopped: false };
        self.load(frame, &mut Laps::new(&mut whole))?;
        self.buffers.lend().tally.stats.stopped = whole.stopped;
        Ok(())
    }

    /// Goes on with a search until `observer` stops it; the piece that it is in then comes to its end.
    /// Returns whether the search is over.
    pub(crate) fn go_on(
        &mut self,
        model: &Model<'_>,
        (plan, place): (&Plan, &mut Place),
        observer: &mut dyn Observer,
    ) -> bool {
        let mut whole = Whole { observer, stopped: self.stats().stopped };
        loop {
            whole.goes_on();
            if whole.stopped {
                self.buffers.lend().tally.stats.stopped = true;
                return false;
            }
            if !advance(self.buffers.lend(), model, (plan, place), &mut Laps::new(&mut whole), None, false) {
                return true;
            }
        }
    }

    /// Ends a search that is not over. Returns whether it has found something.
    pub(crate) fn finish(
        &mut self,
        model: &Model<'_>,
        (plan, place): (&Plan, &mut Place),
        observer: &mut dyn Observer,
    ) -> bool {
        if self.buffers.show().findings.detections.is_empty() {
            return false;
        }
        let mut laps = Laps::new(observer);
        laps.stopped = true;
        advance(self.buffers.lend(), model, (plan, place), &mut laps, None, true);
        true
    }

    /// Sets the counts and times of the stages to 0, before a search goes on.
    pub(crate) fn restart_stats(&mut self) {
        self.buffers.lend().tally.stats = Stats::EMPTY;
    }

    /// Makes the pyramid of a frame, and empties the other buffers.
    fn load(&mut self, frame: &Frame<'_>, laps: &mut Laps<'_>) -> Result<(), FrameError> {
        let limits = self.buffers.limits();
        self.loads = self.loads.wrapping_add(1);
        let Lent { pyramid, tally, .. } = cleared(self.buffers.lend());
        check(frame, limits, &pyramid)?;
        load(pyramid, tally, frame, laps)
    }

    fn run(
        &mut self,
        frame: &Frame<'_>,
        model: &Model<'_>,
        threshold: f32,
        observer: &mut dyn Observer,
        finder: Option<&mut dyn Finder>,
    ) -> Result<&[Detection], FrameError> {
        let mut laps = Laps::new(observer);
        self.load(frame, &mut laps)?;
        let (plan, mut place) = (self.plan(model, threshold), Place::START);
        advance(self.buffers.lend(), model, (&plan, &mut place), &mut laps, finder, true);
        #[cfg(feature = "defmt")]
        self.log(model);
        Ok(self.detections())
    }

    /// Loads the luma of a part of `frame`, which becomes the [`Detector::frame`]. It does not
    /// search the part. `observer` is asked for the time between the stages.
    pub(crate) fn load_luma(
        &mut self,
        frame: &Frame<'_>,
        part: Window,
        observer: &mut dyn Observer,
    ) -> Result<(), FrameError> {
        let limits = self.buffers.limits();
        self.loads = self.loads.wrapping_add(1);
        let Lent { mut pyramid, tally, .. } = cleared(self.buffers.lend());
        check(frame, limits, &pyramid)?;
        let start = observer.now();
        pyramid.load_luma(frame, part);
        let loaded = observer.now();
        pyramid.reduce_luma(&mut Steady);
        let ticks = &mut tally.stats.ticks;
        ticks[Stage::Convert as usize] = passed(start, loaded);
        ticks[Stage::Pyramid as usize] = passed(loaded, observer.now());
        Ok(())
    }

    /// Pyramid of the last frame, or of the part of it that was loaded.
    pub(crate) fn frame(&self) -> PyramidView<'_> {
        self.buffers.show().pyramid
    }

    /// Size of the largest frame that fits.
    #[must_use]
    pub fn limits(&self) -> Limits {
        self.buffers.limits()
    }

    /// Bytes and capacity of each buffer, in the order of [`Buffer::ALL`].
    #[must_use]
    pub fn rooms(&self) -> [Room; Buffer::COUNT] {
        self.buffers.rooms()
    }

    /// Detections in the last frame, best score first: the best name at each place.
    #[must_use]
    pub fn detections(&self) -> &[Detection] {
        self.buffers.show().findings.by_place().0
    }

    /// Detections of other objects that lie where a better one lies, in no order.
    #[must_use]
    pub fn beaten(&self) -> &[Detection] {
        self.buffers.show().findings.by_place().1
    }

    /// The detections that `detection` has beaten, in no order.
    pub fn rivals<'a>(&'a self, detection: &'a Detection) -> impl Iterator<Item = &'a Detection> {
        self.beaten().iter().filter(|d| d.is_rival(detection))
    }

    /// The surface on which the object of a detection in the last frame lies. `None` when a plane explains what is seen as
    /// well. Through a lens straight lines are not straight, and a plane is a surface, too. `None` also when nothing is
    /// seen through the lens where the object is, and when `observer` says to stop. It takes about as long as a
    /// search that finds an object; where the object is seen wholly on a plane, no time, and through a lens
    /// half of it. After a [`Tracker`](crate::Tracker) has followed its objects, ask [`Surfaces`](crate::Surfaces).
    ///
    /// # Panics
    /// When `model` has no such object.
    pub fn surface(
        &self,
        model: &Model<'_>,
        d: &Detection,
        known: Known<'_>,
        observer: &mut dyn Observer,
    ) -> Option<Surface> {
        let object = model.object(usize::from(d.object));
        let frame = self.frame();
        let eye = Eye::of_frame([frame.luma(0).width(), frame.luma(0).height()], [0.0; 2]);
        surface::fit(&frame, &object, d, (known, None, &eye), &mut Laps::new(observer))
    }

    /// Matches the cells of an object's picture one by one with the last frame, near where `surface` has them: for
    /// the calibration of a camera. A cell is an eighth of a side.
    ///
    /// # Panics
    /// When `model` has no such object.
    #[must_use]
    pub fn matches(&self, model: &Model<'_>, d: &Detection, surface: &Surface) -> heapless::Vec<CellMatch, 64> {
        matches(&self.frame(), &model.object(usize::from(d.object)), surface)
    }

    /// Writes what the last frame shows on a surface as it looks flat: `width` x `height` px of luma, row by row, to
    /// the start of `out`. What lies outside of the frame is white. After a [`Tracker`](crate::Tracker) has followed
    /// its objects, the last frame is the part of one.
    ///
    /// # Panics
    /// When `out` is too short.
    pub fn flatten(&self, surface: &Surface, [width, height]: [usize; 2], out: &mut [u8]) {
        // A product that wraps is no length of `out`.
        let pixels = width.saturating_mul(height);
        surface::flatten(&self.frame().luma(0), surface, [width, height], &mut out[..pixels]);
    }

    /// Counts and times of the stages for the last frame.
    #[must_use]
    pub fn stats(&self) -> &Stats {
        &self.buffers.show().tally.stats
    }

    /// Maximum number of elements that each buffer held while the last frame was searched, in the
    /// order of [`Buffer::ALL`].
    #[must_use]
    pub fn high_water(&self) -> &[u32; Buffer::COUNT] {
        &self.buffers.show().tally.high_water
    }

    /// Corners of the last frame, frame px. After a search in tiles, those of the last tile.
    pub fn corners(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        let s = self.buffers.show();
        (0..LEVELS).flat_map(move |l| s.points[span(s.spans, l)].iter().map(move |&p| to_level0(p, l)))
    }

    /// Triangles of the last frame that are keygraphs, frame px. After a search in tiles, those of the
    /// last tile.
    pub fn keygraphs(&self) -> impl Iterator<Item = [[f32; 2]; 3]> + '_ {
        let s = self.buffers.show();
        s.keygraphs.iter().map(move |k| vertices(s.points, k).map(|(_, p)| p))
    }

    /// Triangles of the last frame that agree with a detection, frame px. After a search in tiles, those
    /// of the last tile.
    pub fn supporters<'a>(
        &'a self,
        model: &'a Model<'_>,
        detection: &'a Detection,
    ) -> impl Iterator<Item = [[f32; 2]; 3]> + 'a {
        let (s, agrees) = (self.buffers.show(), Agreement::new(detection));
        s.votes.iter().filter_map(move |v| {
            let to = vertices(s.points, &s.keygraphs[usize::from(v.frame_keygraph)]).map(|(_, p)| p);
            agrees.holds(model, v, to).then_some(to)
        })
    }

    /// Logs one line for each stage, and one for each detection.
    #[cfg(feature = "defmt")]
    fn log(&self, model: &Model<'_>) {
        for (stage, s) in Stage::ALL.iter().zip(&self.stats().stages) {
            defmt::debug!("{=str}: seen {} kept {} dropped {}", stage.name(), s.seen, s.kept, s.dropped);
        }
        for d in self.detections() {
            let name = model.object(usize::from(d.object)).name;
            defmt::debug!("found {=str}, score {}, corners {}", name, d.score, d.corners);
        }
    }
}

/// A search in pieces, [`Detector::begin`].
///
/// ```
/// # use keygraph_core::{Detector, Frame, FrameError, Model, Observer, Profile};
/// # fn turn_of_others() {}
/// # fn search<P: Profile>(detector: &mut Detector<P>, frame: &Frame<'_>, model: &Model<'_>, clock: &mut dyn Observer)
/// #     -> Result<(), FrameError> {
/// let mut search = detector.begin(frame, model, 0.8, clock)?;
/// while search.step(clock) {
///     turn_of_others(); // in an async task: `yield_now().await`
/// }
/// for detection in search.detections() { /* ... */ }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Ongoing<'a, P: Profile + ?Sized> {
    detector: &'a mut Detector<P>,
    model: &'a Model<'a>,
    plan: Plan,
    place: Place,
}

impl<P: Profile + ?Sized> Ongoing<'_, P> {
    /// Does the next piece. Returns whether there is more. The longest piece finds the corners and
    /// triangles of the finest level; with a crew the first piece does all up to the first decision, meanwhile.
    pub fn step(&mut self, observer: &mut dyn Observer) -> bool {
        let lent = self.detector.buffers.lend();
        let mut laps = Laps::new(observer);
        laps.stopped = lent.tally.stats.stopped;
        advance(lent, self.model, (&self.plan, &mut self.place), &mut laps, None, false)
    }

    /// Detections so far, best score first. After the last piece, those of [`Detector::detections`].
    #[must_use]
    pub fn detections(&self) -> &[Detection] {
        let findings = self.detector.buffers.show().findings;
        if self.place.is_end() { findings.by_place().0 } else { &findings.detections }
    }
}

/// An observer that is asked as often as any, and lets a piece of a search come to its end all the same.
struct Whole<'a> {
    observer: &'a mut dyn Observer,
    /// Whether the observer has told the search to stop.
    stopped: bool,
}

impl Observer for Whole<'_> {
    fn now(&mut self) -> u64 {
        self.observer.now()
    }

    fn goes_on(&mut self) -> bool {
        self.stopped = self.stopped || !self.observer.goes_on();
        true
    }

    fn saw(&mut self, output: Output<'_>) {
        self.observer.saw(output);
    }
}

/// Empties the buffers of what the last frame left in them.
fn cleared(mut lent: Lent<'_>) -> Lent<'_> {
    *lent.tally = Tally::EMPTY;
    lent.findings.detections.clear();
    lent.findings.named = 0;
    lent.points.clear();
    *lent.spans = [(0, 0); LEVELS];
    lent.keygraphs.clear();
    lent.votes.clear();
    if let Some(help) = &mut lent.help {
        *help.ahead.foreseen = None;
        help.block.clear();
    }
    lent
}

/// Checks that a frame fits the profile.
fn check(frame: &Frame<'_>, limits: Limits, pyramid: &PyramidMut<'_>) -> Result<(), FrameError> {
    let (w, h) = (frame.width(), frame.height());
    let (pixels, side) = (w * h, w.max(h));
    if side > limits.side || !pyramid.fits(w, h) {
        return Err(FrameError::TooLarge { pixels, max_pixels: limits.pixels, side, max_side: limits.side });
    }
    Ok(())
}

/// Makes luma and chroma of a frame, and their pyramid.
#[inline(never)]
fn load(
    mut pyramid: PyramidMut<'_>,
    tally: &mut Tally,
    frame: &Frame<'_>,
    laps: &mut Laps<'_>,
) -> Result<(), FrameError> {
    pyramid.load_at(frame, laps)?;
    laps.end(tally, Output::Planes(pyramid.view()));
    pyramid.reduce_at(laps);
    let pyramid = pyramid.into_view();
    let luma = (0..LEVELS).map(|l| pyramid.luma(l).width() * pyramid.luma(l).height()).sum();
    let chroma = (0..LEVELS).flat_map(|l| pyramid.chroma(l)).map(|c| c.width() * c.height()).sum();
    tally.mark(Buffer::Luma, luma);
    tally.mark(Buffer::Chroma, chroma);
    tally.mark(Buffer::CornerRows, SCRATCH_ROWS * frame.width());
    laps.end(tally, Output::Levels(pyramid));
    tally.stats.stopped = laps.stopped;
    Ok(())
}

/// Does the next piece of a search, or all that is left. Returns whether there is more.
#[inline(never)]
fn advance(
    lent: Lent<'_>,
    model: &Model<'_>,
    (plan, place): (&Plan, &mut Place),
    laps: &mut Laps<'_>,
    finder: Option<&mut dyn Finder>,
    all: bool,
) -> bool {
    let Lent { pyramid, scratch, mesh, corners, points, triples, keygraphs, features, spans, .. } = lent;
    let Lent { votes, bins, pairs, findings, tally, help, .. } = lent;
    let pyramid = pyramid.into_view();
    let tile = place.tile(&pyramid);
    let scene = Scene { pyramid, tile, points, spans, keygraphs, features, corners, triples };
    let context = Context { model, tally, laps };
    let (hands, mut ahead) = help.map_or((None, None), |h| (Some((h.ahead.team, h.block)), Some(h.ahead)));
    let mut search = Search { context, scene, votes, bins, pairs, findings, hands };
    let rules = model.method().parameters();
    let mut ours = Corners { rules, scratch, mesh };
    // The levels above the finest here, the finest one on another core meanwhile.
    let finest = pyramid.luma(FINEST.into());
    if let Some(ahead) = &mut ahead
        && place.is_start()
        && finder.is_none()
        && finest.width().min(finest.height()) >= MIN_SIDE
        && !search.context.laps.stopped
        && ahead.team.crew.is_free()
    {
        let mut more = true;
        let mut mine = || {
            more = search.advance(plan, place, &mut ours);
            // Of a tile nothing is known before.
            while more && !place.needs_finest() && place.tiles() == 0 && (all || !place.decides()) {
                more = search.advance(plan, place, &mut ours);
            }
        };
        ahead.team.crew.both(&mut mine, &mut || ahead.look(finest, FINEST.into(), rules));
        if !more || !all {
            return more;
        }
    }
    let mut ours = Foresight { ours, ahead, level: FINEST.into() };
    let finder: &mut dyn Finder = match finder {
        Some(other) => other,
        None => &mut ours,
    };
    while search.advance(plan, place, finder) {
        if !all {
            return true;
        }
    }
    false
}
