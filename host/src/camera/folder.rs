//! The folder of models, as others change it while the program runs.
//!
//! In: the files on the shelf, looked at once a second. Out: changes of the models in use, all of one look in one merge,
//! and a line of the log for each. A file is read when it has stayed as it is from one look to the next, and counts as
//! gone when two looks miss it: a file that is being written, or exchanged in two steps, changes nothing. One that is no
//! model yet is tried again when it changes; the model before stays in use. What this program writes is in use already.
//!
//! Looking is no work of the search, and of no request: the folder may be on a slow drive.
//!
//! Memory: a few words for each file; one model while it is read. Cost: a system call for each file and look, and a merge
//! for each look with changes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Error};
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::entry::Entry;
use super::live::Live;
use super::models::{Change, Models, check_room};
use super::repeated::Repeated;
use super::shelf::Stamp;
use crate::output::plain;

/// Time between two looks.
const PERIOD: Duration = Duration::from_secs(1);

/// What the last look has seen.
#[derive(Debug, Default)]
pub struct Folder {
    files: BTreeMap<PathBuf, Option<Stamp>>,
    /// Files that were refused: what they were like, and the number of changes of the models then.
    refused: BTreeMap<PathBuf, (Option<Stamp>, u64)>,
    /// Ids of models whose files the last look missed.
    missed: BTreeSet<u64>,
    /// Names that several objects have.
    shared: BTreeSet<String>,
    told: Repeated,
}

/// Follows the changes of the folder until `stopped`.
pub async fn follow(live: Arc<Live>, mut stopped: watch::Receiver<bool>) {
    let folder = Arc::new(Mutex::new(Folder::new(&live.models)));
    while timeout(PERIOD, stopped.wait_for(|&s| s)).await.is_err() {
        let (live, folder) = (Arc::clone(&live), Arc::clone(&folder));
        // A panic was printed already; the next look is another one.
        let _ = spawn_blocking(move || folder.lock().unwrap_or_else(PoisonError::into_inner).look(&live.models)).await;
    }
}

impl Folder {
    /// Before the first look.
    #[must_use]
    pub fn new(models: &Models) -> Self {
        let changes = models.changes();
        let refused = models.left_out.iter().map(|(path, stamp)| (path.clone(), (*stamp, changes))).collect();
        Self { refused, ..Self::default() }
    }

    /// Looks at the folder, and takes over what has changed since the last look.
    pub fn look(&mut self, models: &Models) {
        let Some(shelf) = &models.shelf else { return };
        // Before the files are listed: what is in use by now, and is not listed then, is gone.
        let entries = models.entries();
        let files = match shelf.stamps() {
            Ok(files) => files,
            Err(error) => return self.warn(&format!("{error:#}; the models stay as they are")),
        };
        let entries: BTreeMap<&Path, &Entry> = entries.iter().filter_map(|e| Some((e.file.as_deref()?, e))).collect();
        let mut waiting = Vec::new();
        for (path, stamp) in &files {
            let entry = entries.get(path.as_path()).copied();
            let is_known = entry.is_some_and(|entry| stamp.is_none() || entry.stamp == *stamp);
            let is_settled = stamp.is_some() && self.files.get(path) == Some(stamp);
            if !is_known && is_settled {
                let is_refused = self.refused.get(path) == Some(&(*stamp, models.changes()));
                waiting.push((path, *stamp, entry, is_refused));
            }
        }
        // One that did not go with the others may go with those that come now.
        if waiting.iter().all(|(.., is_refused)| *is_refused) {
            waiting.clear();
        }
        let (mut news, mut count) = (Vec::new(), models.count());
        for (path, stamp, entry, _) in waiting {
            let room = if entry.is_some() { Ok(()) } else { check_room(count) };
            match room.with_context(|| path.display().to_string()).and_then(|()| Entry::on_shelf(path)) {
                Ok(new) => {
                    count += usize::from(entry.is_none());
                    news.push(News::new(path, entry, new));
                }
                Err(error) => self.refuse(path, stamp, entry.is_some(), models, &error),
            }
        }
        let missed: BTreeMap<u64, &Entry> =
            entries.iter().filter(|(path, _)| !files.contains_key(**path)).map(|(_, e)| (e.id, *e)).collect();
        news.extend(missed.values().filter(|entry| self.missed.contains(&entry.id)).map(|entry| News::gone(entry)));
        self.missed = missed.into_keys().collect();
        self.refused.retain(|path, _| files.contains_key(path));
        self.files = files;
        self.take(models, news);
        self.tell_shared_names(models);
    }

    /// Changes the models; when not all changes can be made, those that can.
    fn take(&mut self, models: &Models, news: Vec<News>) {
        if news.is_empty() {
            return;
        }
        let changes: Vec<_> = news.iter().map(|one| one.change.clone()).collect();
        let is_done = models.change(&changes).is_ok();
        for one in news {
            let done = if is_done { Ok(()) } else { models.change(&[one.change]) };
            match done {
                Ok(()) => {
                    self.refused.remove(&one.path);
                    if !one.told.is_empty() {
                        tracing::info!("{}", plain(&one.told));
                    }
                }
                Err(error) => {
                    let error = error.context(one.path.display().to_string());
                    self.refuse(&one.path, one.stamp, one.is_exchange, models, &error);
                }
            }
        }
    }

    fn refuse(&mut self, path: &Path, stamp: Option<Stamp>, in_use: bool, models: &Models, error: &Error) {
        // A file that is refused for the others is tried again when these change.
        let before = self.refused.insert(path.to_path_buf(), (stamp, models.changes()));
        if before.is_none_or(|before| before.0 != stamp) {
            let rest = if in_use { "; the model before stays in use" } else { "" };
            self.warn(&format!("left out: {error:#}{rest}"));
        }
    }

    fn warn(&self, text: &str) {
        if let Some(text) = self.told.note(text, Instant::now()) {
            tracing::warn!("{}", plain(&text));
        }
    }

    /// Tells, once, of each name that objects of several models have.
    fn tell_shared_names(&mut self, models: &Models) {
        let entries = models.entries();
        let mut owners = BTreeMap::<&str, BTreeSet<&str>>::new();
        for entry in &entries {
            entry.object_names().for_each(|name| _ = owners.entry(name).or_default().insert(&entry.name));
        }
        owners.retain(|_, owners| owners.len() > 1);
        for (name, owners) in &owners {
            if !self.shared.contains(*name) {
                let owners = owners.iter().copied().collect::<Vec<_>>().join(", ");
                let told = format!("several models have an object {name}, reported as one to brokers: {owners}");
                tracing::warn!("{}", plain(&told));
            }
        }
        self.shared = owners.into_keys().map(str::to_string).collect();
    }
}

/// A change, and what is told of it.
#[derive(Debug)]
struct News {
    path: PathBuf,
    stamp: Option<Stamp>,
    is_exchange: bool,
    change: Change,
    /// Empty when nothing is.
    told: String,
}

impl News {
    /// `new` at `path` in place of `before`, if there was one.
    fn new(path: &Path, before: Option<&Entry>, new: Entry) -> Self {
        let (name, file, stamp) = (&new.name, path.display(), new.stamp);
        let told = match before {
            None => format!("model {name} added: {file} is new"),
            Some(before) if before.is_like(&new) => String::new(),
            Some(_) => format!("model {name} exchanged: {file} was changed"),
        };
        let change =
            before.map_or_else(|| Change::New(new.clone()), |before| Change::Exchanged(before.id, new.clone()));
        Self { path: path.to_path_buf(), stamp, is_exchange: before.is_some(), change, told }
    }

    fn gone(entry: &Entry) -> Self {
        let path = entry.file.clone().unwrap_or_default();
        let told = format!("model {} removed: {} is gone", entry.name, path.display());
        Self { path, stamp: None, is_exchange: true, change: Change::Gone(entry.id), told }
    }
}

#[cfg(test)]
mod tests {
    use super::super::shelf::Shelf;
    use super::*;
    use crate::learn::{Preset, train_within};
    use crate::picture::{Picture, Pixels};
    use crate::scratch;
    use std::fs::{self, File};
    use std::time::SystemTime;

    use keygraph_core::Model;

    /// A small model of noise.
    fn model(name: &str) -> Vec<u8> {
        trained(name, Preset::Compact)
    }

    fn trained(name: &str, preset: Preset) -> Vec<u8> {
        let noise = (0..200 * 200_u32).map(|i| (((i / 8 % 25 * 7 + i / 1600 * 31) * 2_654_435) >> 9).to_le_bytes()[0]);
        let picture = Picture { width: 200, height: 200, pixels: Pixels::Gray8(noise.collect()) };
        train_within(&picture, name, preset, true, 60_000).expect("trains").0
    }

    /// The folder, the models in it, and how it is looked at.
    struct Watched {
        scratch: scratch::Folder,
        models: Models,
        folder: Folder,
    }

    impl Watched {
        fn new(test: &str, files: &[(&str, &[u8])]) -> Self {
            let scratch = scratch::Folder::new(test);
            files.iter().for_each(|(name, bytes)| fs::write(scratch.0.join(name), bytes).expect("writes"));
            let models = Models::load(&[], Some(Shelf::open(&scratch.0).expect("opens"))).expect("loads");
            let folder = Folder::new(&models);
            Self { scratch, models, folder }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.scratch.0.join(name)
        }

        /// Writes a file in place.
        fn write(&self, name: &str, bytes: &[u8]) {
            fs::write(self.path(name), bytes).expect("writes");
        }

        /// Looks some times. Returns the number of merges so far, and the objects that are looked for.
        fn look(&mut self, times: usize) -> (u64, String) {
            (0..times).for_each(|_| self.folder.look(&self.models));
            let merged = self.models.merged();
            let bytes = merged.bytes.map_or_else(Vec::new, |bytes| bytes.to_vec());
            let model = Model::parse(&bytes).ok();
            let names = model.iter().flat_map(|m| (0..m.objects()).map(|i| m.object(i).name));
            (merged.generation, names.collect::<Vec<_>>().join(" "))
        }
    }

    /// What [`Watched::look`] returns.
    fn seen(merges: u64, objects: &str) -> (u64, String) {
        (merges, objects.into())
    }

    #[test]
    fn files_that_come_change_and_go_are_taken_over_in_one_merge() {
        let (one, two, other) = (model("one"), model("two"), model("other"));
        let mut watched = Watched::new("folder-changes", &[("one.kgm", &one)]);
        assert_eq!(watched.look(3), seen(1, "one"), "nothing has changed");
        for name in ["two.kgm", "three.kgm"] {
            watched.write(name, &two);
        }
        assert_eq!(watched.look(1), seen(1, "one"), "they may still be written");
        assert_eq!(watched.look(3), seen(2, "one two two"));
        watched.write("one.kgm", &other);
        fs::remove_file(watched.path("three.kgm")).expect("removes");
        assert_eq!(watched.look(1), seen(2, "one two two"));
        assert_eq!(watched.look(3), seen(3, "other two"), "it keeps its place");
        fs::write(watched.path("new.part"), &one).expect("writes");
        fs::rename(watched.path("new.part"), watched.path("one.kgm")).expect("renames");
        fs::rename(watched.path("two.kgm"), watched.path("four.kgm")).expect("renames");
        assert_eq!(watched.look(3), seen(4, "one two"));
        for name in ["one.kgm", "four.kgm"] {
            fs::remove_file(watched.path(name)).expect("removes");
        }
        assert_eq!(watched.look(3), seen(5, ""));
    }

    #[test]
    fn the_model_before_is_in_use_until_the_new_one_is_whole() {
        let (one, other) = (model("one"), model("other"));
        let mut watched = Watched::new("folder-half", &[("one.kgm", &one)]);
        for part in 1..4 {
            watched.write("one.kgm", &other[..other.len() * part / 4]);
            assert_eq!(watched.look(3), seen(1, "one"));
        }
        assert_eq!(watched.folder.refused.len(), 1);
        watched.write("one.kgm", &other);
        assert_eq!(watched.look(2), seen(2, "other"));
        // An exchange in two steps.
        fs::remove_file(watched.path("one.kgm")).expect("removes");
        assert_eq!(watched.look(1), seen(2, "other"));
        watched.write("one.kgm", &one);
        assert_eq!(watched.look(2), seen(3, "one"));
    }

    #[test]
    fn what_is_in_use_already_is_not_merged_again() {
        let mut watched = Watched::new("folder-own", &[]);
        let added = watched.models.add("one", model("one")).expect("is added");
        assert_eq!(watched.look(3), seen(1, "one"), "the program wrote the file");
        let file = File::options().append(true).open(watched.path("one.kgm")).expect("there");
        file.set_modified(SystemTime::now() + Duration::from_secs(9)).expect("sets");
        assert_eq!(watched.look(3), seen(1, "one"), "its content is as before");
        watched.write("one.kgm", &model("one"));
        assert_eq!(watched.look(3), seen(1, "one"), "its content is as before");
        // Meanwhile it is needed for a merge, and was not whole.
        watched.write("one.kgm", b"half");
        watched.models.add("two", model("two")).expect("is added");
        assert_eq!(watched.look(3), seen(2, "two"));
        watched.write("one.kgm", &model("one"));
        assert_eq!(watched.look(3), seen(3, "one two"));
        watched.models.remove(added.id).expect("is removed");
        assert_eq!(watched.look(3), seen(4, "two"));
    }

    #[test]
    fn what_was_left_out_at_the_start_comes_when_it_can_be_used() {
        let mut watched = Watched::new("folder-later", &[("bad.kgm", b"no model"), ("two.kgm", &model("two"))]);
        assert_eq!(watched.folder.refused.len(), 1, "what was told at the start is not told again");
        assert_eq!(watched.look(3), seen(1, "two"));
        watched.write("bad.kgm", &model("good"));
        assert_eq!(watched.look(3), seen(2, "two good"));
        assert_eq!(watched.folder.refused.len(), 0);
    }

    #[test]
    fn models_beyond_the_limit_wait_until_there_is_room() {
        let one = model("one");
        let files: Vec<_> = (0..super::super::models::MOST + 1).map(|i| format!("{i:03}.kgm")).collect();
        let files: Vec<_> = files.iter().map(|name| (name.as_str(), one.as_slice())).collect();
        let mut watched = Watched::new("folder-full", &files);
        let all = (watched.look(3), watched.models.count());
        assert_eq!((all.0.0, all.1), (1, files.len() - 1));
        fs::remove_file(watched.path("000.kgm")).expect("removes");
        watched.look(4);
        let names: Vec<_> = watched.models.entries().iter().filter_map(Entry::file_name).collect();
        assert_eq!((names.len(), names.last().map(String::as_str)), (files.len() - 1, Some("064.kgm")));
        // All at once.
        let mut watched = Watched::new("folder-filled", &[]);
        files.iter().for_each(|(name, bytes)| watched.write(name, bytes));
        assert_eq!((watched.look(3).0, watched.models.count()), (1, files.len() - 1), "in one merge");
    }

    #[test]
    fn models_of_another_method_wait_until_all_are_of_it() {
        let mut watched = Watched::new("folder-methods", &[("a.kgm", &model("one")), ("b.kgm", &model("two"))]);
        let paper = |name| trained(name, Preset::Paper);
        watched.write("c.kgm", &paper("three"));
        assert_eq!(watched.look(3), seen(1, "one two"));
        assert_eq!(watched.folder.refused.len(), 1);
        watched.write("d.kgm", &model("four"));
        assert_eq!(watched.look(3), seen(2, "one two four"), "beside one that does not go with it");
        fs::remove_file(watched.path("d.kgm")).expect("removes");
        watched.write("a.kgm", &paper("five"));
        watched.write("b.kgm", &paper("six"));
        assert_eq!(watched.look(3), seen(3, "five six three"));
    }

    #[test]
    fn a_folder_that_cannot_be_read_changes_nothing() {
        let mut watched = Watched::new("folder-away", &[("one.kgm", &model("one"))]);
        let away = watched.scratch.0.with_extension("away");
        fs::rename(&watched.scratch.0, &away).expect("renames");
        assert_eq!(watched.look(3), seen(1, "one"));
        fs::rename(&away, &watched.scratch.0).expect("renames");
        assert_eq!(watched.look(3), seen(1, "one"));
    }

    #[test]
    fn names_that_several_models_have_are_told_once() {
        let mut watched = Watched::new("folder-names", &[("a.kgm", &model("one")), ("b.kgm", &model("two"))]);
        watched.look(1);
        assert!(watched.folder.shared.is_empty());
        watched.write("c.kgm", &model("one"));
        watched.look(3);
        assert_eq!(watched.folder.shared, BTreeSet::from(["one".into()]));
        fs::remove_file(watched.path("a.kgm")).expect("removes");
        watched.look(3);
        assert!(watched.folder.shared.is_empty());
    }
}
