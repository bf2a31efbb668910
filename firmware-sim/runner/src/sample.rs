//! The sample: a model for a board that is given no model, and frames for it.
//!
//! In: a picture of the repository. Out: a model file in the folder for build results, trained as
//! `keygraph train --preset compact` trains it. Cost: one second. An unchanged file is not written
//! again, so that the firmware is not rebuilt.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use keygraph::hard::write;
use keygraph::learn::{Preset, train};
use keygraph::picture::read_picture;

use crate::board::{root, targets};

/// Picture that the model is trained on.
pub const PICTURE: &str = "assets/pictures/astronaut.jpg";

/// Frames that show the object whole, from the side, small, and not at all.
pub const FRAMES: [&str; 4] =
    ["assets/sequence/0000.jpg", "assets/sequence/0009.jpg", "assets/sequence/0016.jpg", "assets/sequence/0025.jpg"];

/// Returns the paths of the frames.
///
/// # Errors
/// Fails if the runner is not inside the repository.
pub fn frames() -> Result<Vec<PathBuf>> {
    let root = root()?;
    Ok(FRAMES.map(|f| root.join(f)).to_vec())
}

/// Frames of [`keygraph::hard`] that cost the most, one for each stage that they strain: what a change
/// must not make worse. `scripts/board --worst` searches all.
pub const HARDEST: [&str; 9] =
    ["exchanged", "dots-24", "dots-48", "crossed-16", "crossed-24", "leaves", "copies", "crowd", "checkerboard-8"];

/// Makes the frames that are hard on a search, and returns their paths: the hardest, or all.
///
/// # Errors
/// Fails if a file cannot be written.
pub fn hard_frames((side, pixels): (usize, usize), all: bool) -> Result<Vec<PathBuf>> {
    let size = [u32::try_from(side)?, u32::try_from(pixels / side)?];
    let folder = targets()?.join(format!("hard-frames/{}x{}", size[0], size[1]));
    write(&read_picture(&root()?.join(PICTURE))?, size, &folder, |name| all || HARDEST.contains(&name))
}

/// Trains the model, and returns the path of its file and its bytes.
///
/// # Errors
/// Fails if the picture cannot be read, or if the file cannot be written.
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
