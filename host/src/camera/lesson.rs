//! Training on an object in a frame.
//!
//! In: a frame, the outline of the object in it, a name, and a plan. Out: the model, and
//! whether it finds the object in that same frame.
//!
//! Memory: the picture and the model. Cost: a training, some seconds.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use anyhow::{Result, ensure};
use keygraph_core::{DEFAULT_THRESHOLD, Model, NAME_BYTES, Trained};

use super::cutout::{Outline, cut_out};
use crate::input::Picture;
use crate::learn::{Preset, train_within};
use crate::search::{Profile, search};

/// How much a model holds, and whether it has chroma.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The preset.
    pub preset: Preset,
    /// Maximum size of the model in bytes.
    pub bytes: usize,
    /// Whether to train on luma alone, for cameras without colour.
    pub luma: bool,
}

impl Default for Plan {
    /// The preset with the most keygraphs, with luma and chroma.
    fn default() -> Self {
        Self { preset: Preset::Large, bytes: Preset::Large.bytes(), luma: false }
    }
}

/// The task of `keygraph train --from-camera`: it waits for the first object that is
/// learned.
#[derive(Clone, Debug)]
pub struct Errand {
    /// The default name of the object.
    pub name: String,
    /// The file of the model, which the page shows.
    pub output: PathBuf,
    /// The channel that takes the object.
    pub sender: Sender<Learned>,
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

/// Trains on the part of `frame` within `outline`, and searches the frame for it.
///
/// # Errors
/// When the name is empty or too long, the outline cannot be used, or the part has too
/// little texture.
pub fn learn(frame: &Picture, outline: &Outline, name: &str, plan: &Plan) -> Result<Learned> {
    let name = name.trim();
    ensure!(!name.is_empty() && name.len() <= NAME_BYTES, "give the object a name of 1 to {NAME_BYTES} bytes");
    let picture = cut_out(frame, outline)?;
    let (model, trained) = train_within(&picture, name, plan.preset, plan.luma, plan.bytes)?;
    let own = search(frame, &Model::parse(&model)?, Profile::Vga, DEFAULT_THRESHOLD, false, 1)?;
    let found = own.detections.first().map(|d| d.score);
    Ok(Learned { name: name.to_string(), picture, model, trained, found })
}
