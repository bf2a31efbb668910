//! The two methods as constants: every threshold of the pipeline in one place.
//!
//! In: a model's [`Method`]. Out: its [`Parameters`]. Memory and cost: none.

use crate::base::capacity::LEVELS;
use crate::extract::corners::CornerParams;
use crate::extract::feature::Sampling;
use crate::extract::keygraph::Scalene;
use crate::extract::rank::Ranking;

/// How the keygraphs were made, and so how frames are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Method {
    /// Several views and scales, nested levels, normalised features.
    Keygraph,
    /// The paper as written.
    Paper,
}

impl Method {
    /// The name used in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Keygraph => "keygraph",
            Self::Paper => "paper",
        }
    }

    /// Where its features are sampled.
    #[must_use]
    pub const fn sampling(self) -> Sampling {
        match self {
            Self::Keygraph => Sampling::Patch,
            Self::Paper => Sampling::Segments,
        }
    }
}

/// What counts as a match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MatchRule {
    /// Tolerance of both angles, half-degrees, for a triangle with long sides.
    /// Raising it finds more under tilt and reads more of the model.
    pub tolerance: u8,
    /// A pixel of noise turns a short side: this over the shortest side in px is
    /// added to the tolerance, half-degrees.
    pub tolerance_px: u16,
    /// Most that the size in the frame may differ from the size in the view,
    /// sixteenths of an octave. Corners come back at the scale at which they
    /// were trained, so a triangle of another size is another triangle.
    pub size_window: u8,
    /// Most of the 24 bits of the signature that may differ.
    pub max_bits: u8,
    /// Most of the 64 bits of the sketch that may differ, where there are sketches.
    pub max_marks: u8,
    /// Most that a feature byte may differ on average, 1/16.
    pub max_distance: u16,
    /// Whether only the subset that the key falls into is searched, and the
    /// nearest alone is kept: the paper.
    pub one_cell: bool,
}

/// How votes are binned.
#[derive(Clone, Copy, Debug)]
pub struct VoteRule {
    /// Whether a vote near a bin border goes to both bins.
    pub soft: bool,
    /// Least weight of a candidate.
    pub min_weight: u32,
}

/// What has to speak for a detection for it to be believed. While more of the frame or of the
/// model could still be searched it must leave no doubt, since nothing better is searched for
/// in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bar {
    /// Minimum weight of a candidate that may become a detection.
    pub weight: u32,
    /// Minimum score of a detection.
    pub score: f32,
    /// Besides, its candidate has at least this weight,
    pub heavy: u32,
    /// or so many blocks of it agree: [`Appearance::support`](crate::stages::align::Appearance::support).
    pub support: f32,
}

impl Bar {
    /// All is believed.
    pub const NONE: Self = Self { weight: 0, score: 0.0, heavy: 0, support: 0.0 };
}

/// How a model of more than one object is searched: for all of them at once, by two lists.
#[derive(Clone, Copy, Debug)]
pub struct Lists {
    /// What the lists hold.
    pub shares: [Share; 2],
    /// Up to so many objects are all looked for to the end.
    pub few: usize,
    /// More than these are searched with less tolerance still.
    pub many: usize,
    /// Of more, once one has been found, those that have a candidate of this weight.
    pub doubt: u32,
    /// How much better the odds of a score are to be than those of the threshold, for each object
    /// of the model. A score is the probability that a detection is right where one is looked
    /// for; with many there is more to be wrong about.
    pub odds: f32,
}

/// What a list holds of each object: the likeliest to be seen again that no list before has.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// Most keygraphs of an object.
    pub of_each: usize,
    /// Most of all objects together.
    pub of_all: usize,
    /// With more than [`Lists::few`] objects, and with more than [`Lists::many`], this takes the
    /// place of [`MatchRule::max_bits`]: reading features is what takes time.
    pub max_bits: [u8; 2],
    /// Likewise of [`MatchRule::max_marks`], however many.
    pub max_marks: u8,
}

/// Everything that a method fixes about the search of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// What counts as a corner.
    pub corners: CornerParams,
    /// How corners are ordered.
    pub ranking: Ranking,
    /// Most corners kept on each pyramid level; 0 leaves a level out. More
    /// corners find smaller objects and cost time in every later stage.
    pub corner_limits: [usize; LEVELS],
    /// Prefixes of the corners that are triangulated, ascending.
    pub prefixes: &'static [usize],
    /// Which triples are keygraphs.
    pub scalene: Scalene,
    /// Keygraphs of an object that are searched first; all, where they are less than twice
    /// as many. More find it without the others more often.
    pub first_tier: usize,
    /// What is found before all has been searched.
    pub first_pass: Bar,
    /// Least weight of a candidate elsewhere that may be the object, or another copy: to search
    /// all of the model, and the finest level.
    pub doubt: [u32; 2],
    /// How many objects are looked for; `None` to search each by itself.
    pub lists: Option<Lists>,
    /// What counts as a match.
    pub matching: MatchRule,
    /// Least likeness of a match's surroundings, 0 to 2; `None` leaves them out.
    pub verify: Option<f32>,
    /// How matches are counted.
    pub voting: VoteRule,
    /// Most candidates that are looked at; below [`crate::base::capacity::CANDIDATES`].
    pub candidates: usize,
    /// Whether candidates are grown and accepted by appearance, or taken as they
    /// are: the paper.
    pub grow: bool,
}

/// Our method.
const KEYGRAPH: Parameters = Parameters {
    corners: CornerParams { quality_q16: 33, floor: 6_000, margin_px: 3 },
    ranking: Ranking::Radius,
    corner_limits: [450, 225, 100, 0],
    prefixes: &[25, 35, 50, 71, 100, 141, 200, 283, 400, 450],
    scalene: Scalene { min_angle_deg: 8.0, min_difference_deg: 4.0, min_side_px: 8.0 },
    first_tier: 1024,
    first_pass: Bar { weight: 12, score: 0.99, heavy: 100, support: 16.0 },
    doubt: [12, 24],
    lists: Some(Lists {
        shares: [
            Share { of_each: 704, of_all: 384 << 10, max_bits: [3, 2], max_marks: 16 },
            Share { of_each: 6144, of_all: 6144 << 10, max_bits: [4, 4], max_marks: 16 },
        ],
        few: 16,
        many: 256,
        doubt: 20,
        odds: 0.25,
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

/// The paper as written: one scale, one triangulation, hard votes, the fullest
/// bin with at least three votes wins.
const PAPER: Parameters = Parameters {
    corners: CornerParams { quality_q16: 655, floor: 1, margin_px: 1 },
    ranking: Ranking::Strength(10),
    corner_limits: [200, 0, 0, 0],
    prefixes: &[200],
    scalene: Scalene { min_angle_deg: 5.0, min_difference_deg: 5.0, min_side_px: 10.0 },
    first_tier: usize::MAX,
    first_pass: Bar::NONE,
    doubt: [0, 0],
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
    /// The method's parameters.
    #[must_use]
    pub const fn parameters(self) -> &'static Parameters {
        match self {
            Self::Keygraph => &KEYGRAPH,
            Self::Paper => &PAPER,
        }
    }
}
