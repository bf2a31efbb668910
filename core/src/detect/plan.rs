//! Plans the search: the order of its steps, and when it may stop.
//!
//! In: what a model holds, its method, and what the caller wishes. Out: steps, in rounds. A step
//! names a part of the model (a tier) and a part of the frame (some levels). It also names the
//! condition under which it is taken, and the minimum evidence for a detection after it. A plan
//! does not depend on the frame: it is a pure function, computed step by step.
//!
//! A model with lists is searched in one round, for all objects at once. Any other model is
//! searched in one round for each object, and so is every model in a thorough search, but one that is slim: it has
//! its lists alone.
//!
//! Memory: [`Plan`], 40 bytes, and one [`Step`] at a time. Cost: a few operations for each step.

use crate::base::capacity::id;
use crate::model::format::Tier;
use crate::model::method::{Bar, Lists, MatchRule, Parameters};
use crate::model::parse::Model;

/// Properties of a model that a plan depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scope {
    /// Number of objects in the model.
    pub objects: usize,
    /// Whether the model has lists of the most likely keygraphs of all objects.
    pub lists: bool,
    /// Whether the objects of the model have second tiers.
    pub second_tiers: bool,
    /// Whether the model holds lists alone.
    pub slim: bool,
}

impl From<&Model<'_>> for Scope {
    fn from(model: &Model<'_>) -> Self {
        Self {
            objects: model.objects(),
            lists: model.has_lists(),
            second_tiers: model.has_second_tiers(),
            slim: model.is_slim(),
        }
    }
}

/// How much of a frame is searched, and for how much of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Depth {
    /// The search stops when nothing is in doubt. That takes a fifth of the time for an object that is
    /// seen plainly. Where at least two instances have been found, the frame is searched again in
    /// nine tiles that overlap, since small objects in a crowd are found only there. In a model of
    /// many objects, each object is searched for only by its most likely keygraphs. With more than 16
    /// objects, the search goes on after the first detections while a heavy candidate speaks for
    /// another instance, or while the detections cover less than a sixth of the frame.
    #[default]
    Usual,
    /// As [`Depth::Usual`], but never in tiles: the hardest frame then takes at most about twice as long
    /// as an ordinary one that shows nothing. Small objects in a crowd are missed.
    Once,
    /// All of the frame is searched for all of the model in every case, and then again in tiles.
    Thorough,
}

/// What the caller wishes of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wish {
    /// Minimum score of a detection.
    pub threshold: f32,
    /// Minimum share of the object that must be seen, [`Appearance::visible`].
    ///
    /// [`Appearance::visible`]: crate::Appearance::visible
    pub visible: f32,
    /// How much of the frame is searched, and for how much of the model.
    pub depth: Depth,
}

/// Pyramid levels of the frame that a step compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Levels {
    /// All levels above the finest: they have a quarter of the pixels.
    Coarse,
    /// The finest level.
    Finest,
}

/// Condition under which a step is taken. When the condition fails, the round ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum When {
    /// The step is always taken.
    Always,
    /// The step is taken while nothing has been found that it looks for, or while a candidate of at
    /// least this weight is open. An open candidate lies where nothing has been found.
    InDoubt(u32),
    /// The step is taken as with [`When::InDoubt`], and also while the detections cover less than a
    /// sixth of the frame: more of their size may be shown.
    InDoubtOrOpen(u32),
}

/// Time at which votes become supporters of the detections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Settle {
    /// Votes are never settled: nothing else is searched for.
    Never,
    /// Votes are settled after each round. The round's open votes are then dropped.
    AfterRound,
    /// Votes are settled after each decision. The decision is repeated with the open votes for as
    /// long as it finds something.
    AfterDecision,
}

/// One step of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Step {
    /// Tier of the model whose keygraphs are compared.
    pub tier: Tier,
    /// Levels of the frame whose keygraphs are compared.
    pub levels: Levels,
    /// Condition under which the step is taken.
    pub when: When,
    /// Rule that says what a match is.
    pub matching: MatchRule,
    /// Minimum evidence for a detection in the decision after the step's votes are cast; `None`
    /// when there is no decision.
    pub decide: Option<Bar>,
    /// Whether all keygraphs of an object are asked about a pose in doubt. The step compares a part of them.
    pub counts: bool,
}

/// Order of the steps of a search for all objects at once.
const LISTED: [(Tier, Levels); 4] = [
    (Tier::Shortlist, Levels::Coarse),
    (Tier::Shortlist, Levels::Finest),
    (Tier::Longlist, Levels::Coarse),
    (Tier::Longlist, Levels::Finest),
];

/// Plan of a search.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    scope: Scope,
    rules: &'static Parameters,
    wish: Wish,
}

impl Plan {
    /// Creates the plan for a model of this scope, searched by these rules.
    #[must_use]
    pub const fn new(scope: Scope, rules: &'static Parameters, wish: Wish) -> Self {
        Self { scope, rules, wish }
    }

    /// Rules of the lists; `None` when the lists are not searched.
    const fn lists(&self) -> Option<&'static Lists> {
        if self.scope.lists && (self.scope.slim || !self.is_thorough()) { self.rules.lists.as_ref() } else { None }
    }

    const fn is_thorough(&self) -> bool {
        matches!(self.wish.depth, Depth::Thorough)
    }

    /// Whether the frame is searched again in tiles, when this many instances have been found.
    #[must_use]
    pub(crate) const fn wants_tiles(&self, found: usize) -> bool {
        match (self.wish.depth, self.rules.crowd) {
            (Depth::Once, _) | (_, None) => false,
            (Depth::Usual, Some(crowd)) => found >= crowd,
            (Depth::Thorough, Some(_)) => true,
        }
    }

    /// Maximum number of corners of a tile, in thirds of that of the whole frame.
    pub(crate) const fn thirds_of_corners(&self) -> usize {
        if self.is_thorough() { 3 } else { 1 }
    }

    /// Minimum share of an object that must be seen.
    pub(crate) const fn visible(&self) -> f32 {
        self.wish.visible
    }

    /// Number of rounds. A round knows what the rounds before it have found.
    #[must_use]
    pub const fn rounds(&self) -> usize {
        if self.lists().is_some() { 1 } else { self.scope.objects }
    }

    /// Time at which votes become supporters.
    #[must_use]
    pub const fn settle(&self) -> Settle {
        match self.lists() {
            Some(_) => Settle::AfterDecision,
            None if self.scope.objects > 1 => Settle::AfterRound,
            None => Settle::Never,
        }
    }

    /// Step `i` of a round; `None` when the round has no more steps.
    #[inline(never)]
    #[must_use]
    pub fn step(&self, round: usize, i: usize) -> Option<Step> {
        match self.lists() {
            Some(lists) => self.step_over_all(lists, i),
            None => self.step_for_one(id(round), i),
        }
    }

    /// Step `i` of a search for all objects at once. The steps cover more and more of the lists and
    /// of the frame. With more than [`Lists::few`] objects, once one has been found, the search
    /// goes on only while a heavy candidate is open.
    fn step_over_all(&self, lists: &Lists, i: usize) -> Option<Step> {
        let &(tier, levels) = LISTED.get(i)?;
        let objects = self.scope.objects;
        let mut matching = self.rules.matching;
        if let Some(list) = tier.list()
            && objects > lists.few
        {
            matching.max_bits = lists.shares[list].max_bits[usize::from(objects > lists.many)];
            matching.max_marks = lists.shares[list].max_marks;
        }
        let last = i + 1 == LISTED.len();
        let bar = if last { self.bar_of_lists(lists) } else { self.first_bar() };
        let always = i == 0 || objects <= lists.few || self.is_thorough();
        let when = if always { When::Always } else { When::InDoubtOrOpen(lists.doubt) };
        Some(Step { tier, levels, when, matching, decide: Some(bar), counts: last })
    }

    /// Step `i` of a search for one object. The steps cover more and more of the model and of the
    /// frame.
    fn step_for_one(&self, object: u16, i: usize) -> Option<Step> {
        let (first, second) = (Tier::First(object), Tier::Second(object));
        let (tiers, n) = if self.scope.second_tiers { ([first, second], 2) } else { ([first; 2], 1) };
        let levels = *[Levels::Coarse, Levels::Finest].get(i / n)?;
        let last = i + 1 == 2 * n;
        let thorough = self.is_thorough();
        let when = if i == 0 || thorough { When::Always } else { When::InDoubt(self.rules.doubt[i / n]) };
        let decide = match last {
            true => Some(Bar { impression: self.rules.impression, score: self.wish.threshold, ..Bar::NONE }),
            false => (!thorough).then(|| self.first_bar()),
        };
        Some(Step { tier: tiers[i % n], levels, when, matching: self.rules.matching, decide, counts: false })
    }

    /// Minimum evidence for a detection while parts of the model or the frame are still unsearched.
    fn first_bar(&self) -> Bar {
        let bar = self.rules.first_pass;
        Bar { score: self.wish.threshold, ..bar }
    }

    /// Minimum evidence for a detection after the last of the lists. The odds of the minimum first
    /// impression are multiplied by a factor that grows with the number of objects: a search for
    /// many objects has more chances to be wrong.
    fn bar_of_lists(&self, lists: &Lists) -> Bar {
        let least = self.rules.impression;
        let odds = (lists.odds * self.scope.objects as f32).max(1.0);
        let impression = odds * least / (1.0 + (odds - 1.0) * least);
        Bar { weight: self.rules.voting.min_weight, impression, score: self.wish.threshold, ..Bar::NONE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::method::Method;
    use std::format;
    use std::string::String;
    use std::vec::Vec;

    const ONE: Scope = Scope { objects: 1, lists: false, second_tiers: true, slim: false };
    const MANY: Scope = Scope { objects: 3, lists: true, ..ONE };

    /// The steps of a round as a table, one line for each step. A line holds tier, levels and
    /// condition, then the bits and marks that may differ, then minimum weight, score, heavy weight
    /// and support, and whether a pose in doubt is asked about.
    fn table(scope: Scope, method: Method, wish: Wish, round: usize) -> Vec<String> {
        let plan = Plan::new(scope, method.parameters(), wish);
        let line = |s: Step| {
            let bar = s.decide.map_or("-".into(), |b| {
                format!("{} {:.3} {:.3} {} {}", b.weight, b.impression, b.score, b.heavy, b.support)
            });
            let MatchRule { max_bits, max_marks, .. } = s.matching;
            let counts = if s.counts { ", counts" } else { "" };
            format!("{:?} {:?} {:?} | {max_bits} {max_marks} | {bar}{counts}", s.tier, s.levels, s.when)
        };
        (0..).map_while(|i| plan.step(round, i)).map(line).collect()
    }

    fn plan(scope: Scope, depth: Depth) -> Plan {
        Plan::new(scope, Method::Keygraph.parameters(), Wish { threshold: 0.8, visible: 0.0, depth })
    }

    const WISH: Wish = Wish { threshold: 0.8, visible: 0.0, depth: Depth::Usual };
    const THOROUGH: Wish = Wish { depth: Depth::Thorough, ..WISH };

    #[test]
    fn one_object_is_searched_by_more_and_more_while_in_doubt() {
        assert_eq!(
            table(ONE, Method::Keygraph, WISH, 0),
            [
                "First(0) Coarse Always | 6 18 | 12 0.990 0.800 100 16",
                "Second(0) Coarse InDoubt(12) | 6 18 | 12 0.990 0.800 100 16",
                "First(0) Finest InDoubt(24) | 6 18 | 12 0.990 0.800 100 16",
                "Second(0) Finest InDoubt(24) | 6 18 | 0 0.600 0.800 0 0",
            ]
        );
        assert_eq!(
            table(Scope { second_tiers: false, ..ONE }, Method::Keygraph, Wish { threshold: 0.995, ..WISH }, 0),
            [
                "First(0) Coarse Always | 6 18 | 12 0.990 0.995 100 16",
                "First(0) Finest InDoubt(24) | 6 18 | 0 0.600 0.995 0 0",
            ]
        );
    }

    #[test]
    fn a_thorough_search_takes_every_step_and_decides_once() {
        assert_eq!(
            table(MANY, Method::Keygraph, THOROUGH, 2),
            [
                "First(2) Coarse Always | 6 18 | -",
                "Second(2) Coarse Always | 6 18 | -",
                "First(2) Finest Always | 6 18 | -",
                "Second(2) Finest Always | 6 18 | 0 0.600 0.800 0 0",
            ]
        );
    }

    #[test]
    fn a_thorough_search_of_a_slim_model_takes_every_step_of_its_lists() {
        let slim = Scope { objects: 100, second_tiers: false, slim: true, ..MANY };
        assert_eq!(
            table(slim, Method::Keygraph, THOROUGH, 0),
            [
                "Shortlist Coarse Always | 3 16 | 12 0.990 0.800 100 16",
                "Shortlist Finest Always | 3 16 | 12 0.990 0.800 100 16",
                "Longlist Coarse Always | 4 16 | 12 0.990 0.800 100 16",
                "Longlist Finest Always | 4 16 | 8 0.863 0.800 0 0, counts",
            ]
        );
        assert_eq!(plan(slim, Depth::Thorough).rounds(), 1);
    }

    #[test]
    fn the_paper_looks_at_the_finest_level_and_believes_the_fullest_bin() {
        assert_eq!(
            table(Scope { second_tiers: false, ..ONE }, Method::Paper, WISH, 0),
            [
                "First(0) Coarse Always | 24 64 | 0 0.000 0.800 0 0",
                "First(0) Finest InDoubt(0) | 24 64 | 0 0.000 0.800 0 0",
            ]
        );
    }

    #[test]
    fn few_objects_are_all_searched_for_to_the_end() {
        assert_eq!(
            table(Scope { objects: 16, ..MANY }, Method::Keygraph, WISH, 0),
            [
                "Shortlist Coarse Always | 6 18 | 12 0.990 0.800 100 16",
                "Shortlist Finest Always | 6 18 | 12 0.990 0.800 100 16",
                "Longlist Coarse Always | 6 18 | 12 0.990 0.800 100 16",
                "Longlist Finest Always | 6 18 | 8 0.600 0.800 0 0, counts",
            ]
        );
    }

    #[test]
    fn of_many_objects_the_rest_is_searched_for_while_in_doubt() {
        let scope = |objects| Scope { objects, ..MANY };
        assert_eq!(
            table(scope(17), Method::Keygraph, WISH, 0),
            [
                "Shortlist Coarse Always | 3 16 | 12 0.990 0.800 100 16",
                "Shortlist Finest InDoubtOrOpen(20) | 3 16 | 12 0.990 0.800 100 16",
                "Longlist Coarse InDoubtOrOpen(20) | 4 16 | 12 0.990 0.800 100 16",
                "Longlist Finest InDoubtOrOpen(20) | 4 16 | 8 0.600 0.800 0 0, counts",
            ]
        );
        let thousand = table(scope(1000), Method::Keygraph, WISH, 0);
        assert_eq!(thousand[0], "Shortlist Coarse Always | 2 16 | 12 0.990 0.800 100 16");
        assert_eq!(thousand[3], "Longlist Finest InDoubtOrOpen(20) | 4 16 | 8 0.984 0.800 0 0, counts");
    }

    #[test]
    fn a_crowd_is_searched_in_tiles() {
        let wants = |depth, found| plan(ONE, depth).wants_tiles(found);
        assert_eq!([0, 1, 2, 9].map(|n| wants(Depth::Usual, n)), [false, false, true, true]);
        assert_eq!([0, 9].map(|n| wants(Depth::Once, n)), [false; 2]);
        assert_eq!([0, 9].map(|n| wants(Depth::Thorough, n)), [true; 2]);
        assert!(!Plan::new(ONE, Method::Paper.parameters(), THOROUGH).wants_tiles(9), "not in the paper");
    }

    #[test]
    fn rounds_and_settling_follow_from_the_scope() {
        let scope = |objects, lists| Scope { objects, lists, ..MANY };
        let of = |scope, depth| (plan(scope, depth).rounds(), plan(scope, depth).settle());
        assert_eq!(of(scope(1, false), Depth::Usual), (1, Settle::Never));
        assert_eq!(of(scope(5, false), Depth::Usual), (5, Settle::AfterRound));
        assert_eq!(of(scope(5, true), Depth::Usual), (1, Settle::AfterDecision));
        assert_eq!(
            of(scope(5, true), Depth::Thorough),
            (5, Settle::AfterRound),
            "a thorough search leaves the lists alone"
        );
    }
}
