//! Training on a picture, and merging models.
//!
//! In: a picture of any size, and a preset. Out: the bytes of a model and a report.
//! Memory: the trainer (a static) and the model. Cost: about a second on a laptop.

use std::sync::Mutex;

use anyhow::{Context, Result, ensure};
use keygraph_core::{Frame, Model, PackError, Part, Trained, VgaTrainer, pack_parts, packed_parts_len, slim, slim_len};

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

impl Preset {
    /// The presets, with the names that the command line and the bindings give them.
    pub const NAMED: [(&'static str, Self); 4] =
        [("large", Self::Large), ("standard", Self::Standard), ("compact", Self::Compact), ("paper", Self::Paper)];

    /// The preset of the core, which holds what it means.
    #[must_use]
    pub const fn to_core(self) -> keygraph_core::Preset {
        match self {
            Self::Large => keygraph_core::Preset::Large,
            Self::Standard => keygraph_core::Preset::Standard,
            Self::Compact => keygraph_core::Preset::Compact,
            Self::Paper => keygraph_core::Preset::Paper,
        }
    }

    /// Maximum size of a model in bytes.
    #[must_use]
    pub const fn bytes(self) -> usize {
        self.to_core().bytes()
    }
}

/// How much a model holds, and whether it has chroma.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The preset.
    pub preset: Preset,
    /// Maximum size of the model in bytes.
    pub bytes: usize,
    /// Whether to train on luma alone, for cameras without colour.
    pub luma: bool,
    /// Whether frames are mirrored left to right: the object is then learned as it is.
    pub mirror: bool,
}

impl Default for Plan {
    /// The preset with the most keygraphs, with luma and chroma.
    fn default() -> Self {
        Self { preset: Preset::Large, bytes: Preset::Large.bytes(), luma: false, mirror: false }
    }
}

/// An object that was learned.
#[derive(Clone, Debug)]
pub struct Learned {
    /// The name of the object.
    pub name: String,
    /// The picture of the object from the front.
    pub picture: Picture,
    /// The bytes of the model.
    pub model: Vec<u8>,
    /// The report of the training.
    pub trained: Trained,
    /// The score of the object in the frame that it was learned from; `None` when it is not
    /// found there.
    pub found: Option<f32>,
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
    let params = preset.to_core().params(name, luma_only);
    let trained = trainer.train(&frame, (picture.width, picture.height), &params, &mut model)?;
    ensure!(trained.keygraphs.kept > 0, "{} bytes cannot hold one keygraph: allow more", model.len());
    model.truncate(trained.bytes);
    Ok((model, trained))
}

/// Merges models into one, with their objects in the order given.
///
/// # Errors
/// When a model is damaged, or the models differ in method or feature.
pub fn merge(models: &[impl AsRef<[u8]>]) -> Result<Vec<u8>> {
    let parsed = models.iter().map(|m| Model::parse(m.as_ref())).collect::<Result<Vec<_>, _>>()?;
    let parts: Vec<_> = parsed.into_iter().map(Part::from).collect();
    Ok(joined(&parts, None)?)
}

/// Packs parts of models. The lists get at most `listed` keygraphs of each object, or as many as packing takes.
///
/// # Errors
/// When the models do not go together.
pub fn joined(parts: &[Part<'_>], listed: Option<usize>) -> Result<Vec<u8>, PackError> {
    let most = listed.unwrap_or(usize::MAX);
    let mut out = vec![0; packed_parts_len(parts, most)?];
    pack_parts(parts, most, &mut out)?;
    Ok(out)
}

/// Leaves out of a packed model what a search for all its objects at once does not read.
///
/// # Errors
/// When the model has no lists: it has one object, or is of the paper's method.
pub fn slimmed(model: &Model<'_>) -> Result<Vec<u8>, PackError> {
    let mut out = vec![0; slim_len(model)?];
    slim(model, &mut out)?;
    Ok(out)
}
