//! Presets of training: how much a model holds.
//!
//! In: a preset, the name of an object, and whether to leave out colour. Out: the training
//! parameters, and the maximum size of the model. Host, boards and bindings all train by these
//! presets. Memory: none. Cost: none. The memory and cost of training follow from the views.

use crate::extract::feature::FeatureKind;
use crate::model::method::Method;
use crate::model::train::TrainParams;
use crate::model::views::ViewSpec;

/// A training preset: the method, the views, and the maximum size of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Preset {
    /// Up to 2 MB. The largest size that improves detection: a larger model finds no more.
    Large,
    /// Up to 1.5 MB: fits the flash of the larger boards.
    Standard,
    /// Up to 512 KB: fits most boards.
    Compact,
    /// Up to 64 KB, from a picture of at most 240 x 180 px: the preset for training on a board.
    Learnt,
    /// The method of the paper as written, up to 8 MiB.
    Paper,
}

const fn upright(side_px: f32, keypoints: u8) -> ViewSpec {
    ViewSpec { side_px, squeeze: 1.0, direction_deg: 0.0, keypoints }
}

const fn tilted(side_px: f32, squeeze: f32, direction_deg: f32, keypoints: u8) -> ViewSpec {
    ViewSpec { side_px, squeeze, direction_deg, keypoints }
}

/// Two sizes at which an object is about as large as the frame or larger, five smaller sizes from the
/// front, and four tilted views in four directions each.
const VIEWS: [ViewSpec; 23] = [
    upright(800.0, 250),
    upright(560.0, 180),
    upright(400.0, 110),
    upright(280.0, 110),
    upright(200.0, 100),
    upright(140.0, 90),
    upright(100.0, 70),
    tilted(320.0, 0.7, 0.0, 80),
    tilted(320.0, 0.7, 45.0, 80),
    tilted(320.0, 0.7, 90.0, 80),
    tilted(320.0, 0.7, 135.0, 80),
    tilted(180.0, 0.7, 0.0, 80),
    tilted(180.0, 0.7, 45.0, 80),
    tilted(180.0, 0.7, 90.0, 80),
    tilted(180.0, 0.7, 135.0, 80),
    tilted(400.0, 0.5, 0.0, 80),
    tilted(400.0, 0.5, 45.0, 80),
    tilted(400.0, 0.5, 90.0, 80),
    tilted(400.0, 0.5, 135.0, 80),
    tilted(220.0, 0.5, 0.0, 70),
    tilted(220.0, 0.5, 45.0, 70),
    tilted(220.0, 0.5, 90.0, 70),
    tilted(220.0, 0.5, 135.0, 70),
];

/// Four sizes from the front, and one tilted view in four directions.
const LEARNT_VIEWS: [ViewSpec; 8] = [
    upright(240.0, 90),
    upright(170.0, 80),
    upright(120.0, 70),
    upright(84.0, 50),
    tilted(170.0, 0.7, 0.0, 60),
    tilted(170.0, 0.7, 45.0, 60),
    tilted(170.0, 0.7, 90.0, 60),
    tilted(170.0, 0.7, 135.0, 60),
];

const PAPER_VIEW: [ViewSpec; 1] = [upright(640.0, 79)];

impl Preset {
    /// Every preset, the largest model first.
    pub const ALL: [Self; 5] = [Self::Large, Self::Standard, Self::Compact, Self::Learnt, Self::Paper];

    /// Name of the preset on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Large => "large",
            Self::Standard => "standard",
            Self::Compact => "compact",
            Self::Learnt => "learnt",
            Self::Paper => "paper",
        }
    }

    /// Maximum size of a model of this preset, bytes.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Large => 2_000_000,
            Self::Standard => 1_500_000,
            Self::Compact => 512 << 10,
            Self::Learnt => 64 << 10,
            Self::Paper => 8 << 20,
        }
    }

    /// Training parameters for an object with this name. `luma_only` leaves out colour, for
    /// pictures and cameras without it.
    #[must_use]
    pub const fn params(self, name: &str, luma_only: bool) -> TrainParams<'_> {
        let (method, views): (_, &'static [ViewSpec]) = match self {
            Self::Paper => (Method::Paper, &PAPER_VIEW),
            Self::Learnt => (Method::Keygraph, &LEARNT_VIEWS),
            // It has no room for the two largest.
            Self::Compact => (Method::Keygraph, VIEWS.split_at(2).1),
            _ => (Method::Keygraph, &VIEWS),
        };
        let feature = match self {
            _ if luma_only => FeatureKind::Luma,
            Self::Paper => FeatureKind::Chroma,
            _ => FeatureKind::Both,
        };
        let max_per_cell = match self {
            Self::Paper => usize::MAX,
            _ => 4000,
        };
        TrainParams::new(name, method, feature, views).capped(usize::MAX, max_per_cell)
    }
}
