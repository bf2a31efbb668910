//! An object learned from a frame that shows it.
//!
//! In: a frame, the outline of the object in it, a name, and how much the model shall
//! hold. Out: the model, and whether the object is found by it in that very frame.
//!
//! Memory: the picture and the model. Cost: a training, some seconds.

use std::path::PathBuf;
use std::sync::mpsc::Sender;

use anyhow::{Result, ensure};
use keygraph_core::detect::DEFAULT_THRESHOLD;
use keygraph_core::model::{Model, NAME_BYTES};
use keygraph_core::train::Trained;

use super::cutout::{Outline, cut_out};
use crate::input::Picture;
use crate::learn::{Preset, train_within};
use crate::search::{Profile, search};

/// How much a model holds, and of what.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The preset.
    pub preset: Preset,
    /// Most bytes of the model.
    pub bytes: usize,
    /// For cameras without colour.
    pub luma: bool,
}

impl Default for Plan {
    /// All that helps.
    fn default() -> Self {
        Self { preset: Preset::Large, bytes: Preset::Large.bytes(), luma: false }
    }
}

/// What `keygraph train --from-camera` waits for: the first object that is learned.
#[derive(Clone, Debug)]
pub struct Errand {
    /// What the object is called unless somebody says otherwise.
    pub name: String,
    /// Where its model will be written, to be told.
    pub output: PathBuf,
    /// Takes the object.
    pub sender: Sender<Learned>,
}

/// An object that was learned.
#[derive(Clone, Debug)]
pub struct Learned {
    /// What it is called.
    pub name: String,
    /// The object from the front, as it was cut out.
    pub picture: Picture,
    /// The model.
    pub model: Vec<u8>,
    /// What training has to tell.
    pub trained: Trained,
    /// The score with which it is found in the frame that it is from.
    pub found: Option<f32>,
}

/// Trains on what lies within `outline`, and looks for it in the frame.
///
/// # Errors
/// When the name is empty or too long, the outline cannot be, or there is too little to
/// hold on to.
pub fn learn(frame: &Picture, outline: &Outline, name: &str, plan: &Plan) -> Result<Learned> {
    let name = name.trim();
    ensure!(!name.is_empty() && name.len() <= NAME_BYTES, "give the object a name of 1 to {NAME_BYTES} bytes");
    let picture = cut_out(frame, outline)?;
    let (model, trained) = train_within(&picture, name, plan.preset, plan.luma, plan.bytes)?;
    let own = search(frame, &Model::parse(&model)?, Profile::Vga, DEFAULT_THRESHOLD, false, 1)?;
    let found = own.detections.first().map(|d| d.score);
    Ok(Learned { name: name.to_string(), picture, model, trained, found })
}
