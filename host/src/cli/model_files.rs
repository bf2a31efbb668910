//! Models as files: read, merged and parsed, with messages that name the file.

use std::path::{Path, PathBuf};
use std::{io, slice};

use anyhow::{Context, Error, Result};
use keygraph::file::read_whole;
use keygraph::learn::merge;
use keygraph_core::{Model, PackError};

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
    merged(&models, paths)
}

/// Reads models.
///
/// # Errors
/// When a file cannot be read.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Vec<u8>>> {
    paths.iter().map(|path| read(path)).collect()
}

/// Merges the models that were read from `paths`.
///
/// # Errors
/// When a model is damaged or does not go with the others.
pub fn merged(models: &[Vec<u8>], paths: &[PathBuf]) -> Result<Vec<u8>> {
    for (bytes, path) in models.iter().zip(paths) {
        parse(bytes, slice::from_ref(path))?;
    }
    merge(models).map_err(|e| match e.downcast_ref() {
        Some(&PackError::Different { index }) => e.context(paths[index].display().to_string()),
        _ => e,
    })
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
