//! The sample: a model for the board that is given none, and frames to show it with.
//!
//! In: a picture of the repository. Out: a model file, trained as `keygraph train
//! --preset compact` does, in the folder of what is built. Cost: a second; the file is
//! left alone if nothing has changed, so that no firmware is built anew.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use keygraph::learn::{Preset, train};
use keygraph::picture::read_picture;

use crate::board::{root, targets};

/// What the model is trained on.
pub const PICTURE: &str = "assets/pictures/astronaut.jpg";

/// Frames that show it whole, from the side, small, and not at all.
pub const FRAMES: [&str; 4] =
    ["assets/sequence/0000.jpg", "assets/sequence/0009.jpg", "assets/sequence/0016.jpg", "assets/sequence/0025.jpg"];

/// The frames' files.
///
/// # Errors
/// When the runner does not lie in the repository.
pub fn frames() -> Result<Vec<PathBuf>> {
    let root = root()?;
    Ok(FRAMES.map(|f| root.join(f)).to_vec())
}

/// The model's file, and its bytes.
///
/// # Errors
/// When the picture cannot be read, or the file not written.
pub fn model() -> Result<(PathBuf, Vec<u8>)> {
    let picture = read_picture(&root()?.join(PICTURE))?;
    let (bytes, _) = train(&picture, "astronaut", Preset::Compact, false)?;
    let folder = targets()?;
    let path = folder.join("board-sample.kgm");
    if fs::read(&path).ok().as_ref() != Some(&bytes) {
        fs::create_dir_all(&folder)
            .and_then(|()| fs::write(&path, &bytes))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok((path.canonicalize()?, bytes))
}
