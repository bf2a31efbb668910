//! The two methods as constants: every threshold of the pipeline in one place.
//!
//! In: a model's [`Method`]. Out: its [`Parameters`]. Memory: none. Cost: none.

use crate::base::capacity::LEVELS;
use crate::extract::corners::CornerParams;
use crate::extract::feature::Sampling;
use crate::extract::keygraph::Scalene;
use crate::extract::rank::Ranking;

/// Method by which a model's keygraphs were made and by which frames are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Method {
    /// Several views and scales, nested triangulations, normalised features.
    Keygraph,
    /// The method of the paper as written.
    Paper,
}

impl Method {
    /// Name of the method in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Keygraph => "keygraph",
            Self::Paper => "paper",
        }
    }

    /// Points at which the features of the method are sampled.
    #[must_use]
    pub const fn sampling(self) -> Sampling {
        match self {
            Self::Keygraph => Sampling::Patch,
            Self::Paper => Sampling::Segments,
        }
    }
}

/// Rule that says when a keygraph of the frame and one of the model match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MatchRule {
    /// Tolerance of the two largest angles, half-degrees, for a triangle with long sides. A larger
    /// value finds more objects under tilt and reads more of the model.
    pub tolerance: u8,
    /// Additional tolerance for short sides, half-degrees times px: this value divided by the
    /// shortest side in px is added to `tolerance`. A pixel of noise turns a short side further
    /// than a long one.
    pub tolerance_px: u16,
    /// Maximum difference between the size in the frame and the size in the view, sixteenths of an
    /// octave. Corners reappear at the scale at which they were trained, so a triangle of another
    /// size is another triangle.
    pub size_window: u8,
    /// Maximum number of bits that may differ between two signatures, of 24.
    pub max_bits: u8,
    /// Maximum number of bits that may differ between two sketches, of 64. Only the lists have
    /// sketches.
    pub max_marks: u8,
    /// Maximum mean difference of the feature bytes, in 1/16.
    pub max_distance: u16,
    /// Whether to search only the subset that the key falls into and to keep only the nearest
    /// match, as in the paper.
    pub one_cell: bool,
}

/// Rule for counting votes in bins.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct VoteRule {
    /// Whether a vote near a bin border counts in the bins on both sides.
    pub soft: bool,
    /// Minimum weight of a candidate.
    pub min_weight: u32,
}

/// Minimum evidence for a detection to be accepted. While parts of the frame or of the model are
/// still unsearched, the evidence must leave no doubt: nothing better is searched for in the
/// detection's place.
///
/// A detection is accepted when its candidate has at least `weight`, its first impression is at
/// least `impression`, it scores at least `score`, and either its candidate has at least `heavy` or
/// its blocks have at least `support`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Bar {
    /// Minimum weight of a candidate that may become a detection.
    pub weight: u32,
    /// Minimum first impression of a pose, 0 to 1: the estimated probability that it is right, among
    /// poses of frames that show nothing alike. Poses below are not looked at closely.
    pub impression: f32,
    /// Minimum score of a detection.
    pub score: f32,
    /// Minimum weight of a candidate that needs no `support`.
    pub heavy: u32,
    /// Minimum agreement of blocks for a candidate that weighs less than `heavy`:
    /// [`Appearance::support`](crate::Appearance::support).
    pub support: f32,
}

impl Bar {
    /// The bar that accepts every detection.
    pub const NONE: Self = Self { weight: 0, impression: 0.0, score: 0.0, heavy: 0, support: 0.0 };
}

/// Rules for a search for all objects at once, by the two lists of a packed model.
#[derive(Clone, Copy, Debug)]
pub struct Lists {
    /// Contents and limits of the two lists, the shortlist first.
    pub shares: [Share; 2],
    /// Maximum number of objects for which every step of the search is taken.
    pub few: usize,
    /// Number of objects above which matching is stricter still: it selects the second value of
    /// [`Share::max_bits`].
    pub many: usize,
    /// Minimum weight of an open candidate for the search to go on. It applies to models of more
    /// than `few` objects, once an object has been found.
    pub doubt: u32,
    /// Factor of the odds for each object of the model. The odds of the minimum score in the last
    /// step are the odds of the caller's threshold, times this value and the number of objects. The
    /// product of the two counts as 1 when it is smaller. A score is the probability that a
    /// detection is right when one object is searched for. A search for many objects has more
    /// chances to be wrong.
    pub odds: f32,
}

/// Contents and limits of one list. It holds the keygraphs of each object that are most likely to
/// be seen again and are not on a list before it.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// Maximum number of keygraphs of one object.
    pub of_each: usize,
    /// Maximum number of keygraphs of all objects together. The objects get equal shares of it.
    pub of_all: usize,
    /// Values that replace [`MatchRule::max_bits`]: the first for models of more than
    /// [`Lists::few`] objects, the second for more than [`Lists::many`]. Smaller values save time,
    /// because most of it is spent on reading features.
    pub max_bits: [u8; 2],
    /// Value that replaces [`MatchRule::max_marks`] for models of more than [`Lists::few`] objects.
    pub max_marks: u8,
}

/// All parameters that a method fixes for the search of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// Rule that says what a corner is.
    pub corners: CornerParams,
    /// Order of the corners.
    pub ranking: Ranking,
    /// Maximum number of corners on each pyramid level; 0 skips a level. More corners find smaller
    /// objects and cost time in every later stage.
    pub corner_limits: [usize; LEVELS],
    /// Number of best corners in each of the nested triangulations, ascending.
    pub prefixes: &'static [usize],
    /// Rule that says which triples are keygraphs.
    pub scalene: Scalene,
    /// Number of keygraphs in an object's first tier, which is searched first. An object with at
    /// most about twice as many keygraphs has no second tier. A larger first tier finds the object
    /// more often without the second.
    pub first_tier: usize,
    /// Minimum first impression of a pose after the last step of a search, [`Bar::impression`].
    pub impression: f32,
    /// Minimum evidence for a detection while parts of the model or the frame are still unsearched.
    pub first_pass: Bar,
    /// Minimum weights of an open candidate for the search to go on after something was found. The
    /// first value applies to the second tier on the coarse levels, the second to the finest level.
    /// An open candidate lies where nothing has been found: it may be the object, or another copy
    /// of it.
    pub doubt: [u32; 2],
    /// Minimum number of instances found for the frame to be searched again in tiles; `None` never
    /// does. Among many instances, the small ones get too few corners.
    pub crowd: Option<usize>,
    /// Rules for a search of all objects at once; `None` to search each object by itself.
    pub lists: Option<Lists>,
    /// Rule that says what a match is.
    pub matching: MatchRule,
    /// Minimum likeness of a match's surroundings, 0 to 2; `None` skips this check.
    pub verify: Option<f32>,
    /// Rule for counting votes.
    pub voting: VoteRule,
    /// Maximum number of candidates that are examined, at most
    /// [`crate::base::capacity::CANDIDATES`].
    pub candidates: usize,
    /// Whether candidates are grown, aligned and accepted by appearance. If not, they become
    /// detections as they are, as in the paper.
    pub grow: bool,
}

/// Parameters of the Keygraph method.
const KEYGRAPH: Parameters = Parameters {
    corners: CornerParams { quality_q16: 33, floor: 6_000, margin_px: 3 },
    ranking: Ranking::Radius,
    corner_limits: [450, 225, 100, 0],
    prefixes: &[25, 35, 50, 71, 100, 141, 200, 283, 400, 450],
    scalene: Scalene { min_angle_deg: 8.0, min_difference_deg: 4.0, min_side_px: 8.0 },
    first_tier: 1024,
    impression: 0.6,
    first_pass: Bar { weight: 12, impression: 0.99, score: 0.0, heavy: 100, support: 16.0 },
    doubt: [12, 24],
    crowd: Some(2),
    lists: Some(Lists {
        shares: [
            Share { of_each: 704, of_all: 384 << 10, max_bits: [3, 2], max_marks: 16 },
            Share { of_each: 6144, of_all: 6144 << 10, max_bits: [4, 4], max_marks: 16 },
        ],
        few: 16,
        many: 256,
        doubt: 20,
        odds: 0.042,
    }),
    matching: MatchRule {
        tolerance: 8,
        tolerance_px: 60,
        size_window: 12,
        max_bits: 6,
        max_marks: 18,
        max_distance: 16 * 24,
        one_cell: false,
    },
    verify: Some(1.0),
    voting: VoteRule { soft: true, min_weight: 8 },
    candidates: 24,
    grow: true,
};

/// Parameters of the paper's method as written: one scale, one triangulation, hard votes. The
/// fullest bin wins if it has at least three votes.
const PAPER: Parameters = Parameters {
    corners: CornerParams { quality_q16: 655, floor: 1, margin_px: 1 },
    ranking: Ranking::Strength(10),
    corner_limits: [200, 0, 0, 0],
    prefixes: &[200],
    scalene: Scalene { min_angle_deg: 5.0, min_difference_deg: 5.0, min_side_px: 10.0 },
    first_tier: usize::MAX,
    impression: 0.0,
    first_pass: Bar::NONE,
    doubt: [0, 0],
    crowd: None,
    lists: None,
    matching: MatchRule {
        tolerance: 0,
        tolerance_px: 0,
        size_window: u8::MAX,
        max_bits: 24,
        max_marks: 64,
        max_distance: 16 * 255,
        one_cell: true,
    },
    verify: None,
    voting: VoteRule { soft: false, min_weight: 3 },
    candidates: 1,
    grow: false,
};

impl Method {
    /// Parameters of the method.
    #[must_use]
    pub const fn parameters(self) -> &'static Parameters {
        match self {
            Self::Keygraph => &KEYGRAPH,
            Self::Paper => &PAPER,
        }
    }
}
