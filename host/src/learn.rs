//! Training on a picture, and merging models.
//!
//! In: a picture of any size, and a preset. Out: the bytes of a model and a report.
//! Memory: the trainer (a static) and the model. Cost: about a second on a laptop.

use std::sync::Mutex;

use anyhow::{Context, Result, ensure};
use keygraph_core::{FeatureKind, Frame, Method, Model, TrainParams, Trained, VgaTrainer, ViewSpec, pack, packed_len};

use crate::input::{Picture, Pixels};
use crate::search::fit;

/// How much a model holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Preset {
    /// Up to 2 MB; larger models find no more (docs/economy.png).
    Large,
    /// Up to 1.5 MB: fits the flash of the larger boards.
    Standard,
    /// Up to 512 KB: fits most boards.
    Compact,
    /// The method of the paper as written, up to 8 MB.
    Paper,
}

/// A view from the front, scaled to a longer side of `side_px`.
const fn upright(side_px: f32, keypoints: u8) -> ViewSpec {
    ViewSpec { side_px, squeeze: 1.0, direction_deg: 0.0, keypoints }
}

/// A view that is squeezed to `squeeze` of its length in one direction, as a tilt does.
const fn tilted(side_px: f32, squeeze: f32, direction_deg: f32, keypoints: u8) -> ViewSpec {
    ViewSpec { side_px, squeeze, direction_deg, keypoints }
}

const VIEWS: [ViewSpec; 21] = [
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

const PAPER_VIEW: [ViewSpec; 1] = [upright(640.0, 79)];

impl Preset {
    /// Maximum size of a model in bytes.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Large => 2_000_000,
            Self::Standard => 1_500_000,
            Self::Compact => 512 << 10,
            Self::Paper => 8 << 20,
        }
    }

    /// The core's training parameters for this preset.
    #[must_use]
    pub const fn params(self, name: &str, luma_only: bool) -> TrainParams<'_> {
        let (method, views): (_, &'static [ViewSpec]) = match self {
            Self::Paper => (Method::Paper, &PAPER_VIEW),
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
        TrainParams { name, method, feature, views, max_keygraphs: usize::MAX, max_per_cell }
    }
}

/// Whether a picture has colour worth training on: in more than one pixel of a hundred, the
/// channels differ by more than a tenth of their range.
#[must_use]
pub fn has_colour(picture: &Picture) -> bool {
    match &picture.pixels {
        Pixels::Rgb8(rgb) => {
            let coloured = |p: &&[u8]| p.iter().max().zip(p.iter().min()).is_some_and(|(a, b)| a - b > 25);
            100 * rgb.chunks_exact(3).filter(coloured).count() > rgb.len() / 3
        }
        Pixels::Gray8(_) => false,
        Pixels::I420(_) => true,
    }
}

/// Trains on `picture`. Uses luma alone when `luma_only` is set or the picture has no
/// colour. Returns the model and a report.
///
/// # Errors
/// When the picture is too small, or has too little texture.
pub fn train(picture: &Picture, name: &str, preset: Preset, luma_only: bool) -> Result<(Vec<u8>, Trained)> {
    train_within(picture, name, preset, luma_only, preset.bytes())
}

/// Trains as [`train`] does, into a model of at most `bytes` bytes instead of the preset's
/// maximum.
///
/// # Errors
/// When training fails, see [`train`], or `bytes` cannot hold a keygraph.
pub fn train_within(
    picture: &Picture,
    name: &str,
    preset: Preset,
    luma_only: bool,
    bytes: usize,
) -> Result<(Vec<u8>, Trained)> {
    static TRAINER: Mutex<VgaTrainer> = Mutex::new(VgaTrainer::new());
    let scaled = fit(picture, 640, 640 * 480);
    let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).context("the picture")?;
    let mut model = vec![0; bytes];
    let mut trainer = TRAINER.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let luma_only = luma_only || (preset != Preset::Paper && !has_colour(picture));
    let params = preset.params(name, luma_only);
    let trained = trainer.train(&frame, (picture.width, picture.height), &params, &mut model)?;
    ensure!(trained.keygraphs.kept > 0, "{} bytes cannot hold one keygraph: allow more", model.len());
    model.truncate(trained.bytes);
    Ok((model, trained))
}

/// Merges models into one, with their objects in the order given.
///
/// # Errors
/// When a model is damaged, or the models differ in method or feature.
pub fn merge(models: &[Vec<u8>]) -> Result<Vec<u8>> {
    let parsed = models.iter().map(|m| Model::parse(m)).collect::<Result<Vec<_>, _>>()?;
    let mut out = vec![0; packed_len(&parsed)?];
    pack(&parsed, &mut out)?;
    Ok(out)
}
