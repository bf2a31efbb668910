//! The models in use, which may change while frames are searched.
//!
//! In: model files and freshly learned models. Out: one merged model that finds all
//! their objects, in an [`Arc`] that a searching thread keeps until it looks again.
//!
//! Memory: each model, and the merged one. Cost: a merge (some 10 ms) a change.

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, ensure};
use keygraph_core::model::Model;
use serde_json::{Value, json};

use crate::learn::merge;

/// Most models at a time.
const MOST: usize = 64;

/// One model as it was given.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Names it for as long as the program runs.
    pub id: u64,
    /// What people call it: the file's name, or the object's.
    pub name: String,
    /// The model.
    pub bytes: Arc<Vec<u8>>,
}

/// What a search needs: all models in one.
#[derive(Clone, Debug)]
pub struct Merged {
    /// Grows with each change.
    pub generation: u64,
    /// The merged model; `None` when there is none to look for.
    pub bytes: Option<Arc<Vec<u8>>>,
}

/// The models in use.
#[derive(Debug)]
pub struct Models {
    content: Mutex<Content>,
    generation: AtomicU64,
}

#[derive(Debug)]
struct Content {
    next_id: u64,
    entries: Vec<Entry>,
    merged: Option<Arc<Vec<u8>>>,
}

impl Models {
    /// Reads model files.
    ///
    /// # Errors
    /// When one cannot be read, is damaged, or does not go with the others.
    pub fn load(paths: &[PathBuf]) -> Result<Self> {
        let content = Content { next_id: 1, entries: Vec::new(), merged: None };
        let models = Self { content: Mutex::new(content), generation: AtomicU64::new(0) };
        for path in paths {
            let bytes = fs::read(path).with_context(|| format!("cannot read the model {}", path.display()))?;
            let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
            models.add(&name, bytes).with_context(|| path.display().to_string())?;
        }
        Ok(models)
    }

    fn lock(&self) -> MutexGuard<'_, Content> {
        // Every change is made in one assignment.
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a model and returns its id.
    ///
    /// # Errors
    /// When it is damaged, or does not go with those that are there.
    pub fn add(&self, name: &str, bytes: Vec<u8>) -> Result<u64> {
        Model::parse(&bytes)?;
        let mut content = self.lock();
        ensure!(content.entries.len() < MOST, "{MOST} models are in use: remove one first");
        let id = content.next_id;
        let mut entries = content.entries.clone();
        entries.push(Entry { id, name: name.to_string(), bytes: Arc::new(bytes) });
        let merged = merge_all(&entries)?;
        *content = Content { next_id: id + 1, entries, merged };
        self.generation.fetch_add(1, Ordering::Release);
        Ok(id)
    }

    /// Removes a model. False when there is none of this id.
    ///
    /// # Errors
    /// Never for models that [`Models::add`] took.
    pub fn remove(&self, id: u64) -> Result<bool> {
        let mut content = self.lock();
        let mut entries = content.entries.clone();
        entries.retain(|e| e.id != id);
        if entries.len() == content.entries.len() {
            return Ok(false);
        }
        content.merged = merge_all(&entries)?;
        content.entries = entries;
        self.generation.fetch_add(1, Ordering::Release);
        Ok(true)
    }

    /// The model of this id.
    pub fn get(&self, id: u64) -> Option<Entry> {
        self.lock().entries.iter().find(|e| e.id == id).cloned()
    }

    /// Changes when the models do; without waiting for a merge.
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::Acquire)
    }

    /// What to look for.
    pub fn merged(&self) -> Merged {
        let content = self.lock();
        Merged { generation: self.generation(), bytes: content.merged.clone() }
    }

    /// The list for the page: `[{"id","name","bytes","objects":[{"name","width","height"}]}]`.
    pub fn list(&self) -> Value {
        let entries = self.lock().entries.clone();
        entries
            .iter()
            .filter_map(|e| {
                let model = Model::parse(&e.bytes).ok()?;
                let objects = (0..model.objects()).map(|i| model.object(i));
                let objects = objects.map(|o| json!({"name": o.name, "width": o.width, "height": o.height}));
                Some(json!({
                    "id": e.id, "name": e.name, "bytes": e.bytes.len(), "objects": objects.collect::<Vec<_>>(),
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
