//! The models in use, which may change while frames are searched.
//!
//! In: model files, models that were just learned, and changes of the files on the [`Shelf`]. Out: one merged model that finds all
//! objects, in an [`Arc`] that the searching thread keeps until the models change. With a
//! [`Shelf`], models are also kept as files for the next start.
//!
//! A merge takes time (up to a second for 40 models). Changes that come meanwhile are merged
//! together after it. Only those who make a change wait for it, not those who read the list.
//!
//! Memory: the merged model. A model that is a file is read again for each merge, from the file
//! that was opened first: it may be removed meanwhile. Others stay in memory. During a merge, all
//! models and the new merged one are in memory. The one before is kept for the search only while
//! models have `LITTLE` bytes together. Beyond this, the search waits for the merge, and a merge
//! waits for a training. Cost: a merge a change, and one at the start.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use keygraph_core::{Model, packed_len};
use serde_json::{Value, json};

use super::entry::{Entry, name_for, objects_of};
use super::shelf::{Shelf, Stamp};
use crate::file::{open_regular, read_whole};
use crate::learn::merge;
use crate::output::{check_name, plain};

/// Maximum number of models.
pub const MOST: usize = 64;
/// Maximum size of all models together in bytes for which a merge saves no memory.
const LITTLE: usize = 16 << 20;
/// Maximum time for which a merge waits until the search has given the merged model back.
const RETURN: Duration = Duration::from_secs(5);

/// All models merged into one, for the search.
#[derive(Clone, Debug)]
pub struct Merged {
    /// The number of merges of the models so far.
    pub generation: u64,
    /// The merged model; `None` when there are no models.
    pub bytes: Option<Arc<Vec<u8>>>,
}

/// A change of a file on the shelf that somebody else made.
#[derive(Clone, Debug)]
pub enum Change {
    /// A model that is new. It gets an id if it has none.
    New(Entry),
    /// The model with this id is exchanged for another one.
    Exchanged(u64, Entry),
    /// The model with this id is gone.
    Gone(u64),
}

/// The models in use.
#[derive(Debug)]
pub struct Models {
    content: Mutex<Content>,
    /// Held while a file is written or removed: `content` is never locked that long.
    writing: Mutex<()>,
    /// Held for the time of a merge.
    merging: Mutex<()>,
    /// Tells that there is a merged model again.
    ready: Condvar,
    /// The folder of models.
    pub shelf: Option<Shelf>,
    /// Files on the shelf that were left out at the start, and what they were like.
    pub left_out: Vec<(PathBuf, Option<Stamp>)>,
    generation: AtomicU64,
}

#[derive(Debug, Default)]
struct Content {
    next_id: u64,
    entries: Vec<Entry>,
    /// Number of changes of `entries` so far.
    changes: u64,
    /// The value of `changes` at the last merge.
    merged_changes: u64,
    merged: Option<Arc<Vec<u8>>>,
    /// The ids of models that could not be read for the last merge.
    lacking: Vec<u64>,
    /// Whether the merged model was given up for the next one.
    given_up: bool,
}

impl Models {
    /// Reads the model files `paths`, and those of the shelf.
    ///
    /// # Errors
    /// When one of `paths` cannot be read, is damaged, or does not go with the others. Such
    /// a file of the shelf is no error: it is left out and logged, so that the others are
    /// still found.
    pub fn load(paths: &[PathBuf], shelf: Option<Shelf>) -> Result<Self> {
        let kept = shelf.as_ref().map(Shelf::stamps).transpose()?.unwrap_or_default();
        let mut models = Self {
            content: Mutex::new(Content { next_id: 1, ..Content::default() }),
            writing: Mutex::new(()),
            merging: Mutex::new(()),
            ready: Condvar::new(),
            shelf,
            left_out: Vec::new(),
            generation: AtomicU64::new(0),
        };
        for path in paths {
            models.read(path)?;
        }
        for (path, stamp) in kept {
            let known = Entry::on_shelf(&path)
                .and_then(|entry| models.prepare(&[Change::New(entry)]).with_context(|| path.display().to_string()));
            if let Err(error) = known {
                tracing::error!("left out: {}", plain(&format!("{error:#}")));
                models.left_out.push((path, stamp));
            }
        }
        while let Err(error) = models.merge_changes() {
            // They are too many for one model. Those of the shelf come last.
            let Some(last) = models.lock().entries.pop_if(|e| e.file.is_some()) else { return Err(error) };
            tracing::error!("left out: {}: {error:#}", last.name);
            models.left_out.extend(last.file.map(|path| (path, last.stamp)));
        }
        Ok(models)
    }

    fn read(&self, path: &Path) -> Result<()> {
        let bytes = read_whole(path).with_context(|| format!("cannot read the model {}", path.display()))?;
        // A pipe is read once, above.
        let opened = fs::metadata(path).ok().filter(fs::Metadata::is_file).and_then(|_| File::open(path).ok());
        let inserted = self.insert(&name_for(path), bytes, |_| Ok((None, opened)));
        inserted.map(|_| ()).with_context(|| path.display().to_string())
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
        let keep = |model: &[u8]| {
            let Some(shelf) = &self.shelf else { return Ok((None, None)) };
            let path = shelf.keep(name, model)?;
            let opened = open_regular(&path).ok();
            Ok((Some(path), opened))
        };
        let entry = self.insert(name, bytes, keep)?;
        if let Err(error) = self.merge_changes() {
            self.take_out(entry.id)?;
            // The search may have nothing until this is done.
            self.merge_changes()?;
            return Err(error);
        }
        Ok(entry)
    }

    /// Adds a model, which is not merged yet. `keep` writes its file, and returns its path on the
    /// shelf and the file to read the model from, if there are any. It is called last.
    fn insert<K>(&self, name: &str, bytes: Vec<u8>, keep: K) -> Result<Entry>
    where
        K: FnOnce(&[u8]) -> Result<(Option<PathBuf>, Option<File>)>,
    {
        let model = Model::parse(&bytes)?;
        let objects = objects_of(&model);
        let _writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        check_room(self.count())?;
        let last = self.lock().entries.last().cloned();
        last.map_or(Ok(()), |last| check_together(&last, model))?;
        let (file, opened) = keep(&bytes)?;
        let mut entry = Entry::new(name, objects, bytes, file, opened);
        let mut content = self.lock();
        entry.id = content.next_id;
        content.entries.push(entry.clone());
        content.next_id += 1;
        content.changes += 1;
        Ok(entry)
    }

    /// Exchanges all models that were ordered for those of a new order, in one merge.
    ///
    /// # Errors
    /// When they are too many, or do not go with each other or with the models of this program alone. Then
    /// nothing is exchanged.
    pub fn exchange(&self, ordered: Vec<Entry>) -> Result<()> {
        let before = self.set_ordered(ordered)?;
        if let Err(error) = self.merge_changes() {
            self.set_ordered(before)?;
            // The search may have nothing until this is done.
            self.merge_changes()?;
            return Err(error);
        }
        Ok(())
    }

    /// Exchanges the models that were ordered. They are not merged yet. Returns those before.
    fn set_ordered(&self, mut ordered: Vec<Entry>) -> Result<Vec<Entry>> {
        let _writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let mut content = self.lock();
        let (before, mut entries): (Vec<_>, Vec<_>) =
            content.entries.iter().cloned().partition(|entry| entry.sha256.is_some());
        let all = entries.len() + ordered.len();
        ensure!(
            all <= MOST,
            "{all} models are too many: {MOST} are in use at most, and {} are no ordered ones",
            entries.len()
        );
        let mut next_id = content.next_id;
        for entry in ordered.iter_mut().filter(|entry| entry.id == 0) {
            entry.id = next_id;
            next_id += 1;
        }
        entries.append(&mut ordered);
        content.entries = entries;
        content.next_id = next_id;
        content.changes += 1;
        Ok(before)
    }

    /// Takes over changes of files on the shelf, in one merge.
    ///
    /// # Errors
    /// When there are too many models, or they do not go together. Then nothing is changed.
    pub fn change(&self, changes: &[Change]) -> Result<()> {
        let back = self.prepare(changes)?;
        if let Err(error) = self.merge_changes() {
            self.alter(&back)?;
            // The search may have nothing until this is done.
            self.merge_changes()?;
            return Err(error);
        }
        Ok(())
    }

    /// Makes changes whose models go with each other and with those that stay. They are not merged yet. Returns the
    /// changes that undo them.
    fn prepare(&self, changes: &[Change]) -> Result<Vec<Change>> {
        let stays = |entry: &&Entry| {
            !changes.iter().any(|c| matches!(c, Change::Exchanged(id, _) | Change::Gone(id) if *id == entry.id))
        };
        let new = |change: &Change| match change {
            Change::New(entry) | Change::Exchanged(_, entry) => Some(entry.clone()),
            Change::Gone(_) => None,
        };
        let mut new: Vec<_> = changes.iter().filter_map(new).collect();
        let other = self.lock().entries.iter().rfind(stays).cloned();
        if let Some(other) = other.or_else(|| new.pop()) {
            new.iter().try_for_each(|entry| check_together(&other, Model::parse(&entry.read()?)?))?;
        }
        self.alter(changes)
    }

    /// Makes changes, which are not merged yet. Returns the changes that undo them.
    fn alter(&self, changes: &[Change]) -> Result<Vec<Change>> {
        let _writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let mut content = self.lock();
        let (mut entries, mut next_id, mut back, mut others) = (content.entries.clone(), content.next_id, vec![], 0);
        for change in changes {
            let at = |id: u64| entries.iter().position(|entry| entry.id == id);
            match change {
                // This program may have written the file meanwhile, or have removed the model.
                Change::New(entry) if entries.iter().any(|e| e.file == entry.file) => {}
                Change::New(entry) => {
                    check_room(entries.len())?;
                    let id = if entry.id == 0 { next_id } else { entry.id };
                    next_id = next_id.max(id + 1);
                    entries.push(entry.with_id(id));
                    back.push(Change::Gone(id));
                    others += 1;
                }
                Change::Exchanged(id, entry) => {
                    if let Some(at) = at(*id) {
                        let before = std::mem::replace(&mut entries[at], entry.with_id(*id));
                        others += u64::from(!before.is_like(entry) || content.lacking.contains(id));
                        back.push(Change::Exchanged(*id, before));
                    }
                }
                Change::Gone(id) => {
                    if let Some(at) = at(*id) {
                        back.push(Change::New(entries.remove(at)));
                        others += 1;
                    }
                }
            }
        }
        content.entries = entries;
        content.next_id = next_id;
        content.changes += others;
        back.reverse();
        Ok(back)
    }

    /// The model in use that was ordered by this SHA-256.
    pub fn ordered(&self, sha256: &str) -> Option<Entry> {
        self.lock().entries.iter().find(|entry| entry.sha256.as_deref() == Some(sha256)).cloned()
    }

    /// Merges the models, unless somebody else did so after the last change.
    fn merge_changes(&self) -> Result<()> {
        let _merging = self.merging.lock().unwrap_or_else(PoisonError::into_inner);
        let (entries, changes) = {
            let content = self.lock();
            if content.changes == content.merged_changes {
                return Ok(());
            }
            (content.entries.clone(), content.changes)
        };
        if size(&entries) > LITTLE {
            self.give_up();
        }
        let mut lacking = Vec::new();
        let merged = merge_all(&entries, &mut lacking);
        let mut content = self.lock();
        // The search goes on also when there is no merged model.
        content.given_up = false;
        self.ready.notify_all();
        content.merged = merged?;
        content.lacking = lacking;
        content.merged_changes = changes;
        self.generation.fetch_add(1, Ordering::Release);
        Ok(())
    }

    /// Takes the merged model away from the search, which waits from now on for the next one.
    fn give_up(&self) {
        let old = {
            let mut content = self.lock();
            content.given_up = true;
            content.merged.take()
        };
        let start = Instant::now();
        // A search that takes longer keeps it: memory may be short then, but it ends.
        while old.as_ref().is_some_and(|old| Arc::strong_count(old) > 1) && start.elapsed() < RETURN {
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Lets no merge begin until the guard is dropped, when the models are so large that a merge
    /// and other work would need too much memory together. Waits for a merge that is going on.
    pub fn without_merges(&self) -> Option<MutexGuard<'_, ()>> {
        let large = size(&self.lock().entries) > LITTLE;
        large.then(|| self.merging.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Removes a model, and its file from the shelf. Returns the model; `None` when no model
    /// has this id.
    ///
    /// # Errors
    /// When the file cannot be removed, or the model was ordered; then it stays.
    pub fn remove(&self, id: u64) -> Result<Option<Entry>> {
        let removed = self.take_out(id)?;
        self.merge_changes()?;
        Ok(removed)
    }

    /// Removes a model, and its file from the shelf. It is merged still.
    fn take_out(&self, id: u64) -> Result<Option<Entry>> {
        let _writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(entry) = self.get(id) else { return Ok(None) };
        let is_ordered = entry.sha256.is_some();
        ensure!(!is_ordered, "{} was ordered through the broker: change the order there", entry.name);
        if let (Some(shelf), Some(file)) = (&self.shelf, &entry.file) {
            shelf.discard(file)?;
        }
        let mut content = self.lock();
        content.entries.retain(|e| e.id != id);
        content.changes += 1;
        Ok(Some(entry))
    }

    /// The model with this id.
    pub fn get(&self, id: u64) -> Option<Entry> {
        self.lock().entries.iter().find(|e| e.id == id).cloned()
    }

    /// All models. Waits for a file that this program is writing or removing.
    pub fn entries(&self) -> Vec<Entry> {
        let _writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        self.lock().entries.clone()
    }

    /// The number of changes of the models so far.
    pub fn changes(&self) -> u64 {
        self.lock().changes
    }

    /// The number of models.
    pub fn count(&self) -> usize {
        self.lock().entries.len()
    }

    /// The number of merges so far. Does not wait for one.
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::Acquire)
    }

    /// Whether `merged` is up to date and may be kept.
    pub fn are(&self, merged: &Merged) -> bool {
        let content = self.lock();
        !content.given_up && self.generation() == merged.generation
    }

    /// The merged model. Waits for the next one when it was given up.
    pub fn merged(&self) -> Merged {
        let content = self.ready.wait_while(self.lock(), |content| content.given_up);
        let content = content.unwrap_or_else(PoisonError::into_inner);
        Merged { generation: self.generation(), bytes: content.merged.clone() }
    }

    /// The list for the page: `[{"id","name","bytes","file","ordered","objects":[{"name","width",
    /// "height"}]}]`; `file` is the name of the file on the shelf, `ordered` whether the broker ordered it.
    pub fn list(&self) -> Value {
        let entries = self.lock().entries.clone();
        let line = |e: &Entry| {
            json!({
                "id": e.id, "name": e.name, "bytes": e.length, "file": e.file_name(), "ordered": e.sha256.is_some(),
                "objects": e.objects,
            })
        };
        entries.iter().map(line).collect()
    }
}

/// The size of all models together in bytes.
fn size(entries: &[Entry]) -> usize {
    entries.iter().map(|e| e.length).sum()
}

/// Checks that there may be one more than `count` models.
///
/// # Errors
/// When there are [`MOST`].
pub fn check_room(count: usize) -> Result<()> {
    ensure!(count < MOST, "{MOST} models are in use: remove one first");
    Ok(())
}

/// Checks a model beside one in use: what goes with one goes with all, which were checked likewise.
fn check_together(entry: &Entry, model: Model<'_>) -> Result<()> {
    if let Ok(bytes) = entry.read()
        && let Ok(other) = Model::parse(&bytes)
    {
        ensure!(!other.is_slim(), "{} is slim: it must be the only model", entry.name);
        packed_len(&[other, model]).context("the models do not go together")?;
    }
    Ok(())
}

/// Merges models. One that cannot be read any more is left out and logged. The ids of these go to `lacking`.
fn merge_all(entries: &[Entry], lacking: &mut Vec<u64>) -> Result<Option<Arc<Vec<u8>>>> {
    if let [entry] = entries
        && let Some(bytes) = entry.in_memory()
    {
        return Ok(Some(Arc::clone(bytes)));
    }
    // One piece of memory goes back to the system when it is freed; many small ones may not.
    let mut bytes = vec![0; size(entries)];
    let (mut rest, mut all) = (bytes.as_mut_slice(), Vec::new());
    for entry in entries {
        let (own, others) = rest.split_at_mut(entry.length);
        rest = others;
        let read = entry.read_into(0, own).map_err(anyhow::Error::from);
        match read.and_then(|()| Ok(Model::parse(own).map(|_| ())?)) {
            Ok(()) => all.push(&*own),
            Err(error) => {
                tracing::error!("left out: {} cannot be read any more: {error:#}", entry.name);
                lacking.push(entry.id);
            }
        }
    }
    Ok(match all.as_slice() {
        [] => None,
        [one] => Some(Arc::new(one.to_vec())),
        several => Some(Arc::new(merge(several).context("the models do not go together")?)),
    })
}

#[allow(clippy::cast_possible_truncation, reason = "noise")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Picture, Pixels};
    use crate::learn::{Preset, train_within};
    use crate::scratch::Folder;
    use std::thread;
    use std::time::{Duration, Instant};

    /// A small model of noise.
    fn model() -> Vec<u8> {
        let noise = (0..200 * 200_u32).map(|i| (((i / 8 % 25 * 7 + i / 1600 * 31) * 2_654_435) >> 9) as u8).collect();
        let picture = Picture { width: 200, height: 200, pixels: Pixels::Gray8(noise) };
        train_within(&picture, "noise", Preset::Compact, true, 60_000).expect("trains").0
    }

    #[test]
    fn models_are_merged_once_at_the_start() {
        let folder = Folder::new("merged-once");
        let model = model();
        let paths: Vec<_> = (0..6).map(|i| folder.0.join(format!("{i}.kgm"))).collect();
        paths.iter().for_each(|path| fs::write(path, &model).expect("writes"));
        let models = Models::load(&paths, None).expect("loads");
        assert_eq!((models.generation(), models.count()), (1, 6), "one merge for all");
        let merged = models.merged().bytes.expect("merged");
        assert_eq!(Model::parse(&merged).expect("parses").objects(), 6);
    }

    #[test]
    fn changes_during_a_merge_are_merged_together_and_the_list_does_not_wait() {
        let (models, model) = (Models::load(&[], None).expect("nothing to fail"), model());
        let merging = models.merging.lock().expect("not poisoned");
        thread::scope(|scope| {
            let adders: Vec<_> = (0..8).map(|_| scope.spawn(|| models.add("noise", model.clone()))).collect();
            let start = Instant::now();
            while models.count() < 8 {
                assert!(start.elapsed() < Duration::from_secs(60), "the list waits for the merge");
                thread::sleep(Duration::from_millis(5));
            }
            assert_eq!(models.list().as_array().map(Vec::len), Some(8));
            assert_eq!(models.generation(), 0);
            drop(merging);
            for adder in adders {
                adder.join().expect("no panic").expect("goes with the others");
            }
        });
        assert_eq!(models.generation(), 1, "one merge for all");
        models.remove(3).expect("removes").expect("it was there");
        let merged = models.merged().bytes.expect("merged");
        assert_eq!((models.generation(), Model::parse(&merged).expect("parses").objects()), (2, 7));
    }

    #[test]
    fn models_are_merged_again_when_their_files_are_gone() {
        let (folder, model) = (Folder::new("files-gone"), model());
        let paths: Vec<_> = (0..3).map(|i| folder.0.join(format!("{i}.kgm"))).collect();
        paths.iter().for_each(|path| fs::write(path, &model).expect("writes"));
        let models = Models::load(&paths, None).expect("loads");
        assert!(models.lock().entries.iter().all(|e| e.in_memory().is_none()));
        paths[1..].iter().for_each(|path| fs::remove_file(path).expect("removes"));
        // One file is no model any more.
        fs::write(&paths[0], vec![0; model.len()]).expect("writes");
        models.add("noise", model.clone()).expect("goes with the others");
        let merged = models.merged().bytes.expect("merged");
        assert_eq!((models.count(), Model::parse(&merged).expect("parses").objects()), (4, 3));
        assert_eq!(models.get(2).expect("there").read().expect("reads"), model);
    }

    #[test]
    fn the_search_waits_for_a_merge_that_its_model_was_given_up_for() {
        let (models, model) = (Models::load(&[], None).expect("nothing to fail"), model());
        models.add("noise", model.clone()).and_then(|_| models.add("noise", model)).expect("goes together");
        let held = models.merged();
        thread::scope(|scope| {
            let giving = scope.spawn(|| models.give_up());
            while models.are(&held) {
                thread::sleep(Duration::from_millis(1));
            }
            assert!(!giving.is_finished(), "it waits until the model is given back");
            drop(held);
            giving.join().expect("no panic");
            let search = scope.spawn(|| models.merged());
            models.remove(1).expect("removes").expect("it was there");
            let merged = search.join().expect("no panic").bytes.expect("merged");
            assert_eq!(Model::parse(&merged).expect("parses").objects(), 1);
        });
    }
}
