//! Models as files: read, merged and parsed, with messages that name the file.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::{io, slice};

use anyhow::{Context, Error, Result, ensure};
use keygraph::file::{Identity, read_whole};
use keygraph::learn;
use keygraph_core::{MAGIC, Model, PackError, Part};

/// The models that are meant: those of a folder in place of the folder, by name, and each file once.
///
/// # Errors
/// When a folder cannot be read, or has no model.
pub fn expanded(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let (mut all, mut known) = (Vec::new(), HashSet::new());
    for path in paths {
        if path.is_dir() {
            let inside = fs::read_dir(path).with_context(|| format!("cannot read the folder {}", path.display()))?;
            let mut models: Vec<_> = inside.filter_map(|entry| Some(entry.ok()?.path())).collect();
            models.retain(|p| p.extension().is_some_and(|e| e == "kgm") && p.is_file());
            ensure!(!models.is_empty(), "there is no model (.kgm) in the folder {}", path.display());
            models.sort();
            all.extend(models);
        } else {
            all.push(path.clone());
        }
    }
    // A pipe has no identity, and is read once in any case.
    all.retain(|path| Identity::of(path).is_none_or(|file| known.insert(file)));
    Ok(all)
}

/// Whether a file begins as models do.
pub fn is_model(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    path.is_file() && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == MAGIC
}

/// Reads models, and merges several into one. A single model is not checked: [`parse`] does
/// that once, since it takes most of the time in which a search gets ready.
///
/// # Errors
/// When a file cannot be read; when one of several models is damaged or does not go with
/// the others.
pub fn load(paths: &[PathBuf]) -> Result<Vec<u8>> {
    let mut models = read_all(paths)?;
    if models.len() == 1 {
        return Ok(models.remove(0));
    }
    joined(&parse_all(&models, paths)?, paths, None)
}

/// Reads models.
///
/// # Errors
/// When a file cannot be read.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Vec<u8>>> {
    paths.iter().map(|path| read(path)).collect()
}

/// Merges the models that were read from `paths`. The lists get at most `listed` keygraphs of each object, or as many
/// as packing takes.
///
/// # Errors
/// When a model does not go with the others.
pub fn joined(models: &[Model<'_>], paths: &[PathBuf], listed: Option<usize>) -> Result<Vec<u8>> {
    let parts: Vec<_> = models.iter().copied().map(Part::from).collect();
    learn::joined(&parts, listed).map_err(|e| match e {
        PackError::Different { index } | PackError::Slim { index } => {
            Error::new(e).context(paths[index].display().to_string())
        }
        _ => e.into(),
    })
}

/// Parses the models that were read from `paths`.
///
/// # Errors
/// When a model is damaged; the message names its path.
pub fn parse_all<'a>(models: &'a [Vec<u8>], paths: &[PathBuf]) -> Result<Vec<Model<'a>>> {
    models.iter().zip(paths).map(|(bytes, path)| parse(bytes, slice::from_ref(path))).collect()
}

fn read(path: &Path) -> Result<Vec<u8>> {
    read_whole(path).map_err(|e| {
        let advice = match e.kind() {
            io::ErrorKind::NotFound => " (make one with `keygraph train`)",
            _ => "",
        };
        Error::new(e).context(format!("cannot read the model {}{advice}", path.display()))
    })
}

/// Parses the model that was loaded from `paths`.
///
/// # Errors
/// When the model is damaged; the message names the first path.
pub fn parse<'a>(bytes: &'a [u8], paths: &[PathBuf]) -> Result<Model<'a>> {
    Model::parse(bytes).with_context(|| paths.first().map(|p| p.display().to_string()).unwrap_or_default())
}
