//! Objects that look alike, told before one is taken for the other.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use keygraph::advice::looks_like;
use keygraph::alike::{Alike, alike};
use keygraph::notice::notice;
use keygraph::output::{file_stem, plain};
use keygraph::progress::Progress;
use keygraph_core::{Model, Object};

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

/// Tells which objects of different models look alike, each two once. Objects that do not count are left out.
///
/// # Errors
/// When a copy of an object is too small, or a picture of shared parts cannot be written.
pub fn tell_among(models: &[Model<'_>], counts: impl Fn(Place) -> bool, shared: &Shared) -> Result<()> {
    let objects = |m: usize| (0..models[m].objects()).map(move |i| (m, i));
    let all: Vec<Place> = (0..models.len()).flat_map(objects).filter(|&o| counts(o)).collect();
    let object = |(m, i): Place| models[m].object(i);
    let progress = Progress::new(Some(all.len() as u64), "objects compared");
    let mut pairs: Vec<(Place, Place, Alike)> = Vec::new();
    for &shown in &all {
        for (m, model) in models.iter().enumerate().filter(|&(m, _)| m != shown.0) {
            for alike in alike(&object(shown), model)? {
                let taken = (m, alike.taken);
                if !counts(taken) {
                    continue;
                }
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

/// Tells which objects of `models` look like `object`, and returns them. `models` are the bytes of
/// models.
///
/// # Errors
/// When a model is damaged, or a picture of shared parts cannot be written.
pub fn tell_beside(object: &Object<'_>, models: &[Vec<u8>], shared: &Shared) -> Result<Vec<Pair>> {
    let mut pairs = Vec::new();
    for bytes in models {
        let model = Model::parse(bytes)?;
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
    notice(&said);
    Ok(())
}

/// A file for two names, with a number when there is one already.
fn picture_of(folder: &Path, shown: &str, taken: &str) -> PathBuf {
    let stem = format!("{}-{}", file_stem(shown), file_stem(taken));
    let numbered = |n: u32| folder.join(if n == 1 { format!("{stem}.png") } else { format!("{stem}-{n}.png") });
    (1..).map(numbered).find(|path| !path.exists()).unwrap_or_else(|| numbered(1))
}
