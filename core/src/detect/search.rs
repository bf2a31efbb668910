//! The search of a frame: the steps of a plan, in pieces that end soon.
//!
//! In: a frame's pyramid, a model, a [`Plan`]. Out: detections, best score first. A step gathers
//! votes: it compares some keygraphs of the frame with some keygraphs of the model. A decision
//! turns the open votes into candidates, grows and aligns each, and keeps those with enough
//! evidence. Settling separates the votes that support a detection from the open ones. In a crowd, the
//! frame is then searched again tile by tile.
//!
//! Memory: borrowed buffers. No stage is inlined, so that the stack holds what one stage needs and
//! not what all need together. Cost: the sum of the stages. Full: each stage counts what it
//! dropped.

use core::ops::Range;

use heapless::{Vec, VecView};

use crate::base::capacity::{Buffer, CANDIDATES, LEVELS, Stage, StageStats, count, id};
use crate::base::crew::Team;
use crate::base::geometry::{Homography, area};
use crate::base::pace::Pace;
use crate::base::sort::sort_by_key;
use crate::detect::align::refine;
use crate::detect::appearance::appearance;
use crate::detect::belief::believe;
use crate::detect::classify::{Match, NEIGHBOURS, Nearest, classify};
use crate::detect::detection::{Detection, Detections};
use crate::detect::evidence::{self, ENOUGH, is_found, weigh};
use crate::detect::finder::Finder;
use crate::detect::help::Block;
use crate::detect::hough::{self, Bin, Candidate};
use crate::detect::observer::Output;
use crate::detect::pairing::Pairing;
use crate::detect::plan::{Levels, Plan, Settle, Step, When};
use crate::detect::pose::{self, Normalised, PRIORS, Pair, Prior, collect_pairs, count_agreeing};
use crate::detect::scene::{Context, FINEST, Scene, vertices};
use crate::detect::scrutiny::scrutinise;
use crate::detect::tile::Tile;
use crate::detect::vote::{Vote, Votes};
use crate::image::pyramid::PyramidView;
use crate::model::method::Bar;
use crate::model::parse::Model;

/// Minimum support of a pose that is not grown a second time, in blocks that agree.
const CONVINCING: f32 = 8.0;

/// Score below which a pose is in doubt.
const SURE: f32 = 0.95;

/// Number of keygraphs that are matched before their matches are verified.
pub(crate) const CHUNK: usize = 16;

/// Matches of a chunk of keygraphs, each with the index of its keygraph.
pub(crate) type Matches = Vec<(u16, Match), { CHUNK * NEIGHBOURS }>;

/// Buffers that have the same size in every profile.
#[derive(Debug)]
pub struct Findings {
    pub(crate) matches: Matches,
    pub(crate) candidates: Vec<Candidate, CANDIDATES>,
    /// Detections; after a search, those that are the best at their place come first.
    pub(crate) detections: Detections,
    /// Number of detections that are the best at their place.
    pub(crate) named: usize,
}

impl Findings {
    pub(crate) const EMPTY: Self =
        Self { matches: Vec::new(), candidates: Vec::new(), detections: Vec::new(), named: 0 };

    /// The detections that are the best at their place, and the others.
    pub(crate) fn by_place(&self) -> (&[Detection], &[Detection]) {
        self.detections.split_at_checked(self.named).unwrap_or_default()
    }
}

/// The piece of a search that comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Piece {
    /// Corners and keygraphs of this level.
    Level(u8),
    /// Features of the keygraphs that have none yet.
    Features,
    /// The step's condition.
    Step,
    /// Matches and votes of a chunk of keygraphs, from this one on.
    Chunk(u16),
    /// Candidates of the open votes.
    Candidates,
    /// This candidate.
    Candidate(u8),
    /// The next tile of the frame.
    Tile,
    /// The best name at each place.
    Names,
    /// Nothing: the search is over.
    End,
}

/// Where a search stands between two of its pieces. It has 24 bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    next: Piece,
    /// Number of tiles that have been taken up.
    tiles: u8,
    /// Number of detections before the tile was searched.
    before: u16,
    round: u16,
    step: u16,
    /// Weight of the heaviest candidate that the last decision of the round left open.
    open: Option<u32>,
    /// Number of detections before the decision.
    known: u16,
    /// Number of keygraphs on the levels above the finest, which come first.
    coarse: u16,
    /// Whether the finest level has been searched.
    has_finest: bool,
}

impl Place {
    /// The start of a search: the first level above the finest.
    pub(crate) const START: Self = Self { next: Piece::Level(FINEST + 1), ..Self::ZERO };

    /// All zero, for memory that holds no search.
    pub(crate) const ZERO: Self = Self {
        next: Piece::Level(0),
        tiles: 0,
        before: 0,
        round: 0,
        step: 0,
        open: None,
        known: 0,
        coarse: 0,
        has_finest: false,
    };

    /// The start of a search that begins with a tile, counted from 1; 0 is the start of a search of the
    /// whole frame.
    pub(crate) const fn at_tile(tile: u8) -> Self {
        Self { tiles: tile, ..Self::START }
    }

    /// Number of tiles that have been taken up.
    pub(crate) const fn tiles(&self) -> u8 {
        self.tiles
    }

    /// The tile that is searched; `None` for the whole frame.
    pub(crate) fn tile(&self, frame: &PyramidView<'_>) -> Option<Tile> {
        Tile::nth(self.tiles.checked_sub(1)?, frame.width(), frame.height())
    }

    /// Whether the search is over.
    pub(crate) fn is_end(&self) -> bool {
        self.next == Piece::End
    }

    /// Whether a search of the whole frame begins.
    pub(crate) fn is_start(&self) -> bool {
        self.next == Self::START.next && self.tiles == 0
    }

    /// Whether a decision comes next.
    pub(crate) fn decides(&self) -> bool {
        self.next == Piece::Candidates
    }

    /// Whether the finest level comes next.
    pub(crate) fn needs_finest(&self) -> bool {
        self.next == Piece::Level(FINEST)
    }
}

/// State of a search.
pub(crate) struct Search<'a, 'o> {
    pub(crate) context: Context<'a, 'o>,
    pub(crate) scene: Scene<'a>,
    pub(crate) votes: &'a mut Votes<VecView<Vote>>,
    pub(crate) bins: &'a mut [Bin],
    pub(crate) pairs: &'a mut VecView<Pair>,
    pub(crate) findings: &'a mut Findings,
    /// Other cores, and the keygraphs that they work at; without the feature `crew` none.
    pub(crate) hands: Option<(Team, &'a mut Block)>,
}

impl Search<'_, '_> {
    /// Does the piece of a search that comes next. Returns whether there is another.
    #[inline(never)]
    pub(crate) fn advance(&mut self, plan: &Plan, at: &mut Place, finder: &mut dyn Finder) -> bool {
        let step = || plan.step(usize::from(at.round), usize::from(at.step));
        if at.next == Piece::Step
            && let Some((_, block)) = &mut self.hands
        {
            block.clear();
        }
        at.next = match at.next {
            Piece::Level(level) => {
                let found = (&self.findings.detections[..], plan.thirds_of_corners());
                self.scene.find_level(level, found, finder, &mut self.context);
                let more = level != FINEST && usize::from(level) + 1 < LEVELS;
                if more { Piece::Level(level + 1) } else { Piece::Features }
            }
            Piece::Features => {
                let team = self.hands.as_ref().map(|hands| hands.0);
                self.scene.extract_features(usize::from(at.coarse), team, &mut self.context);
                if at.has_finest {
                    Piece::Chunk(at.coarse)
                } else {
                    at.coarse = id(self.scene.keygraphs.len());
                    Piece::Step
                }
            }
            Piece::Step => match step().filter(|s| !self.context.laps.stopped && self.is_wanted(s, at.open)) {
                Some(Step { levels: Levels::Coarse, .. }) => Piece::Chunk(0),
                Some(_) if at.has_finest => Piece::Chunk(at.coarse),
                Some(_) => {
                    at.has_finest = true;
                    Piece::Level(FINEST)
                }
                None => self.end_round(plan, at),
            },
            Piece::Chunk(first) => match step() {
                Some(s) if self.gather_votes(&s, first, at.coarse) => Piece::Chunk(first + id(CHUNK)),
                Some(Step { decide: Some(_), .. }) => Piece::Candidates,
                _ => {
                    at.step += 1;
                    Piece::Step
                }
            },
            Piece::Candidates => {
                at.known = id(self.findings.detections.len());
                self.find_candidates();
                Piece::Candidate(0)
            }
            Piece::Candidate(i) => {
                let (bar, counts) = step().map_or((Bar::NONE, false), |s| (s.decide.unwrap_or(Bar::NONE), s.counts));
                if self.examine(usize::from(i), &bar, (plan.visible(), counts)) {
                    Piece::Candidate(i + 1)
                } else {
                    self.end_decision(plan, at)
                }
            }
            Piece::Tile => match self.next_tile(plan, at) {
                Some(tile) => {
                    self.scene.turn_to(tile);
                    self.votes.clear();
                    self.context.tally.stats.tiles += 1;
                    *at = Place { tiles: at.tiles, before: at.before, ..Place::START };
                    at.next
                }
                None => Piece::Names,
            },
            Piece::Names => {
                self.findings.named = evidence::name(&mut self.findings.detections, self.context.laps);
                let named = &self.findings.detections[..self.findings.named];
                self.context.laps.end(self.context.tally, Output::Detections(named));
                Piece::End
            }
            Piece::End => Piece::End,
        };
        self.context.tally.stats.stopped = self.context.laps.stopped;
        at.next != Piece::End
    }

    /// Ends a round. Returns what comes next.
    fn end_round(&mut self, plan: &Plan, at: &mut Place) -> Piece {
        if plan.settle() == Settle::AfterRound {
            self.settle();
            self.votes.drop_open();
        }
        (at.round, at.step, at.open) = (at.round + 1, 0, None);
        if usize::from(at.round) < plan.rounds() { Piece::Step } else { Piece::Tile }
    }

    /// Takes up the next tile in which something may be found, or the same one again while something
    /// new is found in it.
    #[inline(never)]
    fn next_tile(&mut self, plan: &Plan, at: &mut Place) -> Option<Tile> {
        let found = &self.findings.detections;
        // Several names for one place are one instance.
        if at.tiles == 0 && !plan.wants_tiles(evidence::places(found, self.context.laps).count()) {
            return None;
        }
        if self.context.laps.stopped {
            return None;
        }
        let again = at.tiles > 0 && found.len() > usize::from(at.before);
        at.before = id(found.len());
        at.tiles += u8::from(!again);
        loop {
            let tile = at.tile(&self.scene.pyramid)?;
            if !tile.is_explained(found, self.context.laps) {
                return Some(tile);
            }
            at.tiles += 1;
        }
    }

    /// Ends a decision. Returns what comes next.
    fn end_decision(&mut self, plan: &Plan, at: &mut Place) -> Piece {
        if plan.settle() == Settle::AfterDecision {
            self.settle();
            if self.findings.detections.len() > usize::from(at.known) {
                return Piece::Candidates;
            }
        }
        let Findings { candidates, detections, .. } = &*self.findings;
        let open = candidates.iter().filter(|c| !is_found(detections, c.object, c.pose.centre));
        at.open = open.map(|c| c.weight).max();
        at.step += 1;
        Piece::Step
    }

    /// Whether a step is to be taken. `open` is the weight of the heaviest candidate that the last
    /// decision left open.
    fn is_wanted(&mut self, step: &Step, open: Option<u32>) -> bool {
        let found = &self.findings.detections;
        let sought = |d: &Detection| step.tier.object().is_none_or(|o| o == d.object);
        let is_doubtful = |weight| !found.iter().any(sought) || open.is_some_and(|open| open >= weight);
        match step.when {
            When::Always => true,
            // What has been found elsewhere says nothing of a tile.
            _ if self.scene.tile.is_some() => true,
            When::InDoubt(weight) => is_doubtful(weight),
            When::InDoubtOrOpen(weight) => is_doubtful(weight) || self.is_open(),
        }
    }

    /// Whether the detections cover less than a sixth of the frame.
    fn is_open(&mut self) -> bool {
        let found = evidence::places(&self.findings.detections, self.context.laps);
        let covered: f32 = found.map(|d| area(&d.corners).abs()).sum();
        6.0 * covered < (self.scene.pyramid.width() * self.scene.pyramid.height()) as f32
    }

    /// Finds the matches of a chunk of keygraphs, and casts their votes. Returns whether the step has
    /// another chunk.
    fn gather_votes(&mut self, step: &Step, first: u16, coarse: u16) -> bool {
        let end = if step.levels == Levels::Coarse { usize::from(coarse) } else { self.scene.keygraphs.len() };
        let (first, next) = (usize::from(first), usize::from(first) + CHUNK);
        if first < end && !self.context.laps.stopped {
            if self.hands.is_some() {
                self.share_matches(step, first, end);
            }
            self.find_matches(step, first..end.min(next));
            self.context.laps.end(self.context.tally, Output::Matches(&self.findings.matches));
            let first = self.votes.all().len();
            self.cast_votes();
            self.context.laps.end(self.context.tally, Output::Votes(&self.votes.all()[first..]));
        }
        next < end && !self.context.laps.stopped
    }

    /// Has all cores find the matches of the keygraphs from `first` on, as far as a block goes.
    fn share_matches(&mut self, step: &Step, first: usize, end: usize) {
        let (scene, model, found) = (&self.scene, self.context.model, &self.findings.detections);
        let Some((team, block)) = &mut self.hands else { return };
        block.hold(*team, (id(first), id(end)), self.context.laps, &|i| {
            let weighed = |m| (m, Pairing::new(scene, model, i, m).weight(scene, model));
            nearest(scene, model, step, found, i).map(|m| m.map(weighed))
        });
    }

    /// Finds the matches of a chunk of keygraphs.
    #[inline(never)]
    fn find_matches(&mut self, step: &Step, chunk: Range<usize>) {
        let Self { scene, findings: Findings { matches, detections, .. }, context, hands, .. } = self;
        matches.clear();
        let seen = count(chunk.len());
        for i in chunk.map(id) {
            if !context.laps.goes_on() {
                continue;
            }
            let nearest = match hands {
                Some((_, block)) => block.get(i).map(|m| m.map(|(m, _)| m)),
                None => nearest(scene, context.model, step, detections, i),
            };
            // All matches fit: a keygraph has at most NEIGHBOURS of them.
            matches.extend(nearest.into_iter().flatten().map(|m| (i, m)));
        }
        context.tally.add(Stage::Classify, StageStats { seen, kept: count(matches.len()), dropped: 0 });
    }

    /// Casts the votes of the matches whose surroundings are alike.
    #[inline(never)]
    fn cast_votes(&mut self) {
        let Self { scene, votes, findings: Findings { matches, .. }, context, hands, .. } = self;
        let model = context.model;
        let mut stats = StageStats { seen: count(matches.len()), ..StageStats::default() };
        for &(i, m) in matches.iter() {
            if !context.laps.goes_on() {
                break;
            }
            let pairing = Pairing::new(scene, model, i, m);
            let weight = match hands {
                Some((_, block)) => block.get(i).into_iter().flatten().find(|w| w.0 == m).and_then(|w| w.1),
                None => pairing.weight(scene, model),
            };
            let Some(v) = weight.and_then(|w| pairing.vote(w)) else { continue };
            match votes.cast(v) {
                Ok(()) => stats.kept += 1,
                Err(_) => stats.dropped += 1,
            }
        }
        context.tally.mark(Buffer::Votes, votes.all().len());
        context.tally.add(Stage::Verify, stats);
    }

    /// Finds the poses with the most open votes, where nothing has been found.
    #[inline(never)]
    fn find_candidates(&mut self) {
        // A keygraph counts once in a bin: its votes must be next to each other.
        sort_by_key(self.votes.open_mut(), |v| (v.frame_keygraph, v.model_keygraph), self.context.laps);
        let rules = self.context.model.method().parameters();
        let candidates = &mut self.findings.candidates;
        let stats = hough::find_candidates(self.votes.open(), &rules.voting, self.bins, candidates, self.context.laps);
        candidates.truncate(rules.candidates);
        self.context.tally.add(Stage::Vote, stats);
        self.context.tally.mark(Buffer::Bins, self.bins.iter().filter(|b| !b.is_free()).count());
        self.context.laps.end(self.context.tally, Output::Candidates(&self.findings.candidates));
        let Findings { candidates, detections, .. } = &mut *self.findings;
        candidates.retain(|c| !is_found(detections, c.object, c.pose.centre));
    }

    /// Turns candidate `i` into a pose, and keeps it if there is enough evidence: at least `visible` of its object must
    /// be seen, and with `counts` all keygraphs of its object are asked when it is in doubt. Returns whether there is
    /// another one to look at.
    #[inline(never)]
    fn examine(&mut self, i: usize, bar: &Bar, (visible, counts): (f32, bool)) -> bool {
        let (model, rules) = (self.context.model, self.context.model.method().parameters());
        let Some(&candidate) = self.findings.candidates.get(i) else { return false };
        if self.context.laps.stopped || candidate.weight < bar.weight {
            return false;
        }
        if rules.grow {
            let (map, start) = self.find_pairs(&candidate);
            if let Some(mut d) = self.find_pose(&candidate, &map, &start)
                && (candidate.weight >= bar.heavy || d.appearance.support >= bar.support)
            {
                d.agreeing = count_agreeing(&map, self.pairs, &d.homography);
                weigh(&self.scene, self.votes, model, &mut d, self.context.laps);
                if d.score >= bar.impression
                    && d.appearance.visible >= visible
                    && self.scrutinise(&mut d, bar.score, counts)
                {
                    self.accept(&d, bar.score);
                }
            }
        } else {
            self.accept(&similar(model, &candidate), bar.score);
        }
        self.context.laps.end(self.context.tally, Output::Detections(&self.findings.detections));
        true
    }

    /// Looks at a pose again, and scores it. With `counts` all votes for a pose in doubt are counted, if they can bring its
    /// score to `least`. Returns whether it was looked at whole: what was not is not believed.
    #[inline(never)]
    fn scrutinise(&mut self, d: &mut Detection, least: f32, counts: bool) -> bool {
        let Self { scene, context, findings, .. } = self;
        let Some(mut seen) = scrutinise(&scene.pyramid, context.model, d, context.laps) else { return false };
        d.score = believe(&seen);
        if counts
            && d.score < SURE
            && believe(&seen.with_votes(ENOUGH)) >= least
            && !findings.detections.iter().any(|other| other.beats(d))
        {
            d.votes = d.votes.max(evidence::count_votes(scene, context.model, d, context.laps));
            seen = seen.with_votes(d.votes);
            d.score = believe(&seen);
        }
        if !context.laps.stopped {
            context.laps.end(context.tally, Output::Scrutinised(d, &seen));
        }
        !context.laps.stopped
    }

    /// Grows and aligns a candidate with each prior until a pose is convincing. Returns the pose
    /// that most blocks agree with.
    #[inline(never)]
    fn find_pose(&mut self, candidate: &Candidate, map: &Normalised, start: &Homography) -> Option<Detection> {
        let support = |d: &Option<Detection>| d.map_or(-1.0, |d| d.appearance.support);
        let mut best: Option<Detection> = None;
        for prior in PRIORS {
            let grown = self.grow(candidate.object, map, start, prior);
            self.context.laps.end(self.context.tally, Output::Grown(grown.as_ref()));
            let aligned = grown.as_ref().and_then(|d| self.align(d));
            self.context.laps.end(self.context.tally, Output::Aligned(aligned.as_ref()));
            if support(&aligned) > support(&best) {
                best = aligned;
            }
            if support(&best) >= CONVINCING {
                break;
            }
        }
        best
    }

    /// Gathers the vertex pairs near a candidate. Returns the maps to the pairs' coordinates, and
    /// the map from which the candidate is grown.
    #[inline(never)]
    fn find_pairs(&mut self, candidate: &Candidate) -> (Normalised, Homography) {
        let (scene, model, votes) = (&self.scene, self.context.model, self.votes.all());
        let corners = |i: u16| vertices(scene.points, &scene.keygraphs[usize::from(i)]);
        let start = pose::start(model, candidate, votes);
        let (map, lost) = collect_pairs(model, candidate, &start, votes, corners, self.pairs, self.context.laps);
        let stats = self.context.tally.of(Stage::Pose);
        stats.seen += 1;
        stats.dropped += lost.dropped;
        self.context.tally.mark(Buffer::Pairs, self.pairs.len());
        (map, start)
    }

    /// Grows a candidate over its pairs. `None` when the fit fails, when the pose is not plausible,
    /// or when the instance has been found already with at least as many agreeing corners.
    #[inline(never)]
    fn grow(&mut self, object: u16, map: &Normalised, start: &Homography, prior: Prior) -> Option<Detection> {
        let homography = pose::grow(start, map, self.pairs, prior, self.context.laps)?;
        self.context.tally.of(Stage::Pose).kept += 1;
        let d = Detection {
            agreeing: count_agreeing(map, self.pairs, &homography),
            ..Detection::at(self.context.model, object, &homography)
        };
        let known = self.findings.detections.iter().any(|t| d.is_twin(t) && t.agreeing >= d.agreeing);
        (d.is_plausible() && !known).then_some(d)
    }

    /// Aligns a grown pose to the frame; `None` when too few blocks agree.
    #[inline(never)]
    fn align(&mut self, d: &Detection) -> Option<Detection> {
        self.context.tally.of(Stage::Accept).seen += 1;
        let o = self.context.model.object(usize::from(d.object));
        let (view, w, h) = (&self.scene.pyramid, o.width as f32, o.height as f32);
        let aligned = refine(view, &o.template, (&d.homography, d.agreeing), [w, h], self.context.laps)?;
        let appearance = appearance(view, &o.template, &aligned, [w, h], self.context.laps);
        Some(Detection { appearance, ..Detection::at(self.context.model, d.object, &aligned) })
    }

    /// Keeps a detection if it scores at least `threshold` and is the best at its place.
    fn accept(&mut self, d: &Detection, threshold: f32) {
        let lost = evidence::accept(&mut self.findings.detections, d, threshold, self.context.laps);
        let stats = self.context.tally.of(Stage::Accept);
        stats.dropped += u32::from(lost);
        stats.kept = count(self.findings.detections.len());
    }

    fn settle(&mut self) {
        evidence::settle(self.votes, &self.scene, &self.findings.detections, self.context.model, self.context.laps);
    }
}

/// Turns a candidate into a detection as it is, as in the paper.
fn similar(model: &Model<'_>, c: &Candidate) -> Detection {
    let o = model.object(usize::from(c.object));
    let map = Normalised::new(o.width as f32, o.height as f32, c.pose.centre, c.pose.size_px());
    Detection {
        votes: u16::try_from(c.weight).unwrap_or(u16::MAX),
        score: 1.0 - 1.0 / (c.weight as f32 + 1.0),
        ..Detection::at(model, c.object, &map.to_px(&c.pose.turn()))
    }
}

/// The nearest neighbours of keygraph `i` of the frame; none where the object that the step looks for has been
/// found.
fn nearest(scene: &Scene<'_>, model: &Model<'_>, step: &Step, found: &Detections, i: u16) -> Nearest {
    let k = &scene.keygraphs[usize::from(i)];
    let at = vertices(scene.points, k)[0].1;
    if step.tier.object().is_some_and(|o| is_found(found, o, at)) {
        return [None; NEIGHBOURS];
    }
    classify(model, step.tier, k, &scene.features[usize::from(i)], &step.matching)
}
