//! Objects that look alike, told before one is taken for the other.

use std::path::{Path, PathBuf};
use std::{fs, slice};

use anyhow::{Context, Result};
use keygraph::advice::looks_like;
use keygraph::alike::{Alike, alike};
use keygraph::output::plain;
use keygraph::progress::Progress;
use keygraph_core::{Model, Object};

use super::model_files::{load, parse};

/// Where the pictures of shared parts go.
#[derive(Debug, clap::Args)]
pub struct Shared {
    /// Folder for a picture of each two objects that look alike, dark where they differ
    #[arg(long, value_name = "DIR")]
    shared: Option<PathBuf>,
}

/// Two objects that look alike, as a report has them.
pub struct Pair {
    /// Name of the object that is like the new one.
    pub object: String,
    /// What they share.
    pub alike: Alike,
}

/// An object: the index of its model, and its index in the model.
type Place = (usize, usize);

/// Tells which objects of different models look alike, each two once. `models` are the bytes of the
/// models.
///
/// # Errors
/// When a model is damaged, or a picture of shared parts cannot be written.
pub fn tell_among(models: &[Vec<u8>], shared: &Shared) -> Result<()> {
    let models = models.iter().map(|bytes| Ok(Model::parse(bytes)?)).collect::<Result<Vec<_>>>()?;
    let objects = |m: usize| (0..models[m].objects()).map(move |i| (m, i));
    let all: Vec<Place> = (0..models.len()).flat_map(objects).collect();
    let object = |(m, i): Place| models[m].object(i);
    let progress = Progress::new(Some(all.len() as u64), "objects compared");
    let mut pairs: Vec<(Place, Place, Alike)> = Vec::new();
    for &shown in &all {
        for (m, model) in models.iter().enumerate().filter(|&(m, _)| m != shown.0) {
            for alike in alike(&object(shown), model)? {
                let taken = (m, alike.taken);
                match pairs.iter_mut().find(|(a, b, _)| (*a, *b) == (taken, shown)) {
                    Some(pair) if pair.2.share >= alike.share => {}
                    Some(pair) => *pair = (shown, taken, alike),
                    None => pairs.push((shown, taken, alike)),
                }
            }
        }
        progress.tick();
    }
    progress.finish();
    pairs.sort_by(|a, b| b.2.share.total_cmp(&a.2.share));
    pairs.iter().try_for_each(|(shown, taken, alike)| tell(alike, &object(*shown), &object(*taken), shared))
}

/// Tells which objects of the models in `files` look like `object`, and returns them.
///
/// # Errors
/// When a file is no model, or a picture of shared parts cannot be written.
pub fn tell_beside<'a>(
    object: &Object<'_>,
    files: impl Iterator<Item = &'a PathBuf>,
    shared: &Shared,
) -> Result<Vec<Pair>> {
    let mut pairs = Vec::new();
    for file in files {
        let bytes = load(slice::from_ref(file))?;
        let model = parse(&bytes, slice::from_ref(file))?;
        for alike in alike(object, &model)? {
            let other = model.object(alike.taken);
            tell(&alike, object, &other, shared)?;
            pairs.push(Pair { object: other.name.into(), alike });
        }
    }
    Ok(pairs)
}

fn tell(alike: &Alike, shown: &Object<'_>, taken: &Object<'_>, shared: &Shared) -> Result<()> {
    let mut said = looks_like(alike, &plain(shown.name), &plain(taken.name));
    if let Some(folder) = &shared.shared {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let path = picture_of(folder, shown.name, taken.name);
        alike.draw(shown, taken).save_png(&path)?;
        said += &format!(" ({})", plain(&path.display().to_string()));
    }
    eprintln!("keygraph: {said}");
    Ok(())
}

/// A file for two names, with a number when there is one already.
fn picture_of(folder: &Path, shown: &str, taken: &str) -> PathBuf {
    let plain = |name: &str| name.replace(|c: char| !c.is_alphanumeric() && !"-_.".contains(c), "_");
    let stem = format!("{}-{}", plain(shown), plain(taken));
    let path = folder.join(format!("{stem}.png"));
    let numbered = |n: u32| folder.join(format!("{stem}-{n}.png"));
    if path.exists() { (2..).map(numbered).find(|p| !p.exists()).unwrap_or(path) } else { path }
}
