//! The models in use, which may change while frames are searched.
//!
//! In: model files, and models that were just learned. Out: one merged model that finds all
//! objects, in an [`Arc`] that the searching thread keeps until the models change. With a
//! [`Shelf`], models are also kept as files for the next start.
//!
//! Memory: each model, and the merged one. Cost: a merge (some 10 ms) a change.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, ensure};
use keygraph_core::Model;
use serde_json::{Value, json};

use super::shelf::Shelf;
use crate::file::{read_regular, read_whole};
use crate::learn::merge;
use crate::output::{check_name, plain};

/// Maximum number of models.
const MOST: usize = 64;

/// One model as it was given.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The id of the model for as long as the program runs.
    pub id: u64,
    /// The name for people: that of the file, or of the object.
    pub name: String,
    /// The bytes of the model.
    pub bytes: Arc<Vec<u8>>,
    /// The file on the shelf; it is removed with the model.
    pub file: Option<PathBuf>,
}

impl Entry {
    /// The name of the model's file on the shelf.
    #[must_use]
    pub fn file_name(&self) -> Option<String> {
        Some(self.file.as_ref()?.file_name()?.to_string_lossy().into_owned())
    }
}

/// All models merged into one, for the search.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The number of changes of the models so far.
    pub generation: u64,
    /// The merged model; `None` when there are no models.
    pub bytes: Option<Arc<Vec<u8>>>,
}

/// The models in use.
#[derive(Debug)]
pub struct Models {
    content: Mutex<Content>,
    shelf: Option<Shelf>,
    generation: AtomicU64,
}

#[derive(Debug)]
struct Content {
    next_id: u64,
    entries: Vec<Entry>,
    merged: Option<Arc<Vec<u8>>>,
}

impl Models {
    /// Reads the model files `paths`, and those of the shelf.
    ///
    /// # Errors
    /// When one of `paths` cannot be read, is damaged, or does not go with the others. Such
    /// a file of the shelf is no error: it is left out and logged, so that the others are
    /// still found.
    pub fn load(paths: &[PathBuf], shelf: Option<Shelf>) -> Result<Self> {
        let content = Content { next_id: 1, entries: Vec::new(), merged: None };
        let kept = shelf.as_ref().map(Shelf::files).transpose()?.unwrap_or_default();
        let models = Self { content: Mutex::new(content), shelf, generation: AtomicU64::new(0) };
        for path in paths {
            models.read(path, None)?;
        }
        for path in kept {
            if let Err(error) = models.read(&path, Some(path.clone())) {
                tracing::error!("left out: {}", plain(&format!("{error:#}")));
            }
        }
        Ok(models)
    }

    fn read(&self, path: &Path, file: Option<PathBuf>) -> Result<()> {
        // On the shelf, others may have put something that is no file.
        let bytes = if file.is_some() { read_regular(path) } else { read_whole(path) };
        let bytes = bytes.with_context(|| format!("cannot read the model {}", path.display()))?;
        let name = path.file_stem().map_or_else(String::new, |s| plain(&s.to_string_lossy()).into_owned());
        self.insert(&name, bytes, |_| Ok(file)).with_context(|| path.display().to_string())?;
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, Content> {
        // Every change is made in one assignment.
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a model, and writes it to the shelf if there is one.
    ///
    /// # Errors
    /// When the name is empty or has control characters; when the model is damaged, does not go
    /// with the others, or cannot be written.
    pub fn add(&self, name: &str, bytes: Vec<u8>) -> Result<Entry> {
        check_name(name)?;
        self.insert(name, bytes, |model| self.shelf.as_ref().map(|shelf| shelf.keep(name, model)).transpose())
    }

    /// Adds a model. `keep` writes its file and returns the path; it is called last.
    fn insert<K>(&self, name: &str, bytes: Vec<u8>, keep: K) -> Result<Entry>
    where
        K: FnOnce(&[u8]) -> Result<Option<PathBuf>>,
    {
        Model::parse(&bytes)?;
        let mut content = self.lock();
        ensure!(content.entries.len() < MOST, "{MOST} models are in use: remove one first");
        let id = content.next_id;
        let mut entries = content.entries.clone();
        entries.push(Entry { id, name: name.to_string(), bytes: Arc::new(bytes), file: None });
        let merged = merge_all(&entries)?;
        let entry = &mut entries[content.entries.len()];
        entry.file = keep(&entry.bytes)?;
        let entry = entry.clone();
        *content = Content { next_id: id + 1, entries, merged };
        self.generation.fetch_add(1, Ordering::Release);
        Ok(entry)
    }

    /// Removes a model, and its file from the shelf. Returns the model; `None` when no model
    /// has this id.
    ///
    /// # Errors
    /// When the file cannot be removed; then the model stays.
    pub fn remove(&self, id: u64) -> Result<Option<Entry>> {
        let mut content = self.lock();
        let mut entries = content.entries.clone();
        let Some(at) = entries.iter().position(|e| e.id == id) else { return Ok(None) };
        let removed = entries.remove(at);
        let merged = merge_all(&entries)?;
        if let (Some(shelf), Some(file)) = (&self.shelf, &removed.file) {
            shelf.discard(file)?;
        }
        content.merged = merged;
        content.entries = entries;
        self.generation.fetch_add(1, Ordering::Release);
        Ok(Some(removed))
    }

    /// The model with this id.
    pub fn get(&self, id: u64) -> Option<Entry> {
        self.lock().entries.iter().find(|e| e.id == id).cloned()
    }

    /// The number of changes of the models so far. Does not wait for a merge.
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::Acquire)
    }

    /// The merged model.
    pub fn merged(&self) -> Merged {
        let content = self.lock();
        Merged { generation: self.generation(), bytes: content.merged.clone() }
    }

    /// The list for the page: `[{"id","name","bytes","file","objects":[{"name","width",
    /// "height"}]}]`; `file` is the name of the file on the shelf.
    pub fn list(&self) -> Value {
        let entries = self.lock().entries.clone();
        entries
            .iter()
            .filter_map(|e| {
                let model = Model::parse(&e.bytes).ok()?;
                let objects = (0..model.objects()).map(|i| model.object(i));
                let objects = objects.map(|o| json!({"name": o.name, "width": o.width, "height": o.height}));
                Some(json!({
                    "id": e.id, "name": e.name, "bytes": e.bytes.len(), "file": e.file_name(),
                    "objects": objects.collect::<Vec<_>>(),
                }))
            })
            .collect()
    }
}

fn merge_all(entries: &[Entry]) -> Result<Option<Arc<Vec<u8>>>> {
    Ok(match entries {
        [] => None,
        [one] => Some(Arc::clone(&one.bytes)),
        several => {
            let all: Vec<Vec<u8>> = several.iter().map(|e| e.bytes.to_vec()).collect();
            Some(Arc::new(merge(&all).context("the models do not go together")?))
        }
    })
}
