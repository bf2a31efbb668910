//! A folder that keeps models when the program ends.
//!
//! In: models with names. Out: one file a model, and what others have put there. A file is complete or does not exist, even
//! after a crash: it is written under another name, flushed to the disk, and renamed to a name
//! that is free. So several programs can use one folder. What a program that was killed left
//! unfinished is removed an hour later, at the next start.
//! Memory: none. Cost: some ms a model on the disk.

use std::collections::BTreeMap;
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result, ensure};
use keygraph_core::MAGIC;

use crate::file::open_regular;
use crate::output::{file_stem, flush_folder, is_draft, new_draft};

/// Maximum number of files of one name.
const MOST: u32 = 1000;
/// Age of an unfinished file that no program can still be writing: it takes some ms.
const ABANDONED: Duration = Duration::from_secs(3600);

/// What tells one content of a file from another, without reading it. Every change of a file changes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Device and number of the file, where the system tells them.
    file: [u64; 2],
    bytes: u64,
    /// Seconds and nanoseconds of the last change of the content, and of anything; elsewhere two times in steps of
    /// 100 ns.
    times: [i64; 4],
}

impl Stamp {
    /// The stamp of a file.
    #[must_use]
    #[cfg(unix)]
    pub fn of(file: &Metadata) -> Self {
        use std::os::unix::fs::MetadataExt;
        let times = [file.mtime(), file.mtime_nsec(), file.ctime(), file.ctime_nsec()];
        Self { file: [file.dev(), file.ino()], bytes: file.size(), times }
    }

    /// The stamp of a file.
    #[must_use]
    #[cfg(windows)]
    pub fn of(file: &Metadata) -> Self {
        use std::os::windows::fs::MetadataExt;
        let times = [file.last_write_time().cast_signed(), file.creation_time().cast_signed(), 0, 0];
        Self { file: [0; 2], bytes: file.file_size(), times }
    }
}

/// The folder of the models.
#[derive(Clone, Debug)]
pub struct Shelf(PathBuf);

impl Shelf {
    /// Opens the folder, and makes it when it does not exist. Removes what was left
    /// unfinished there.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let shelf = Self(folder.to_path_buf());
        shelf.clear();
        Ok(shelf)
    }

    /// Removes unfinished files that are [`ABANDONED`]. What cannot be removed stays: it is in
    /// nobody's way.
    fn clear(&self) {
        let is_old = |time: SystemTime| time.elapsed().is_ok_and(|age| age >= ABANDONED);
        for entry in fs::read_dir(&self.0).into_iter().flatten().flatten() {
            let path = entry.path();
            if is_draft(&path)
                && let Ok(found) = fs::symlink_metadata(&path)
                && found.is_file()
                && found.modified().is_ok_and(is_old)
                && fs::remove_file(&path).is_ok()
            {
                tracing::info!("removed {}, which was left unfinished", path.display());
            }
        }
    }

    /// The files of all models in the folder, sorted by name. Some may be no regular files.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn files(&self) -> Result<Vec<PathBuf>> {
        let entries = fs::read_dir(&self.0).with_context(|| format!("cannot read the folder {}", self.0.display()))?;
        let hidden = |path: &PathBuf| path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
        let all = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let mut files: Vec<_> =
            all.filter(|path| path.extension().is_some_and(|e| e == "kgm") && !hidden(path)).collect();
        files.sort();
        Ok(files)
    }

    /// The files of all models in the folder with their stamps. A file of which the system does not tell has none.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn stamps(&self) -> Result<BTreeMap<PathBuf, Option<Stamp>>> {
        let mut stamps = BTreeMap::new();
        for path in self.files()? {
            match fs::symlink_metadata(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                told => _ = stamps.insert(path, told.ok().map(|file| Stamp::of(&file))),
            }
        }
        Ok(stamps)
    }

    /// Reads a file that somebody else may be writing. Of a file that does not begin as models do, only the beginning
    /// is read.
    ///
    /// # Errors
    /// When it is no regular file, cannot be read, or changes meanwhile.
    pub fn read(path: &Path) -> Result<(Vec<u8>, File, Stamp)> {
        let mut bytes = Vec::new();
        let mut read = || -> io::Result<(File, Stamp)> {
            let mut file = open_regular(path)?;
            let stamp = Stamp::of(&file.metadata()?);
            // Another file may be too large for the memory.
            (&file).take(MAGIC.len() as u64).read_to_end(&mut bytes)?;
            if bytes == MAGIC {
                file.read_to_end(&mut bytes)?;
            }
            if Stamp::of(&file.metadata()?) != stamp {
                return Err(io::Error::other("it was changed while it was read"));
            }
            Ok((file, stamp))
        };
        let (file, stamp) = read().with_context(|| format!("cannot read the model {}", path.display()))?;
        Ok((bytes, file, stamp))
    }

    /// Writes a model under its name, with a number added when the name is taken. Returns its
    /// file.
    ///
    /// # Errors
    /// When the file cannot be written; then no part of it is left.
    pub fn keep(&self, name: &str, model: &[u8]) -> Result<PathBuf> {
        let stem = file_stem(name);
        let numbered = |n: u32| if n == 1 { format!("{stem}.kgm") } else { format!("{stem}-{n}.kgm") };
        let written = || -> Result<Option<PathBuf>> {
            let mut draft = new_draft(&self.0)?;
            draft.write_all(model)?;
            draft.as_file().sync_all()?;
            for path in (1..=MOST).map(|n| self.0.join(numbered(n))) {
                match draft.persist_noclobber(&path) {
                    Ok(_) => {
                        flush_folder(&self.0)?;
                        return Ok(Some(path));
                    }
                    Err(taken) if taken.error.kind() == ErrorKind::AlreadyExists => draft = taken.file,
                    Err(failed) => return Err(failed.error.into()),
                }
            }
            Ok(None)
        };
        let path = written().with_context(|| {
            format!("cannot keep {}: make room, or see who may write there", self.0.join(numbered(1)).display())
        })?;
        path.with_context(|| format!("{} is full of models named {name}", self.0.display()))
    }

    /// Removes a model's file. A file that does not exist any more is no error.
    ///
    /// # Errors
    /// When the file cannot be removed, or is not in the folder.
    pub fn discard(&self, file: &Path) -> Result<()> {
        ensure!(file.parent() == Some(&self.0), "{} is not in {}", file.display(), self.0.display());
        match fs::remove_file(file) {
            Err(e) if e.kind() != ErrorKind::NotFound => {
                Err(e).with_context(|| format!("cannot remove {}: see who may write there", file.display()))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::thread;

    fn shelf(test: &str) -> Shelf {
        let folder = std::env::temp_dir().join(format!("keygraph-shelf-{}-{test}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        Shelf::open(&folder.join("models")).expect("makes folders")
    }

    #[test]
    fn models_are_kept_under_their_names_and_discarded() {
        let shelf = shelf("kept");
        let first = shelf.keep("me & you", b"one").expect("kept");
        assert_eq!(first, shelf.0.join("me _ you.kgm"));
        let second = shelf.keep("me & you", b"two").expect("kept");
        assert_eq!(second, shelf.0.join("me _ you-2.kgm"));
        assert_eq!(
            (fs::read(&first).expect("there"), fs::read(&second).expect("there")),
            (b"one".into(), b"two".into())
        );
        fs::write(shelf.0.join(".half.kgm"), b"").expect("writes");
        fs::write(shelf.0.join("notes.txt"), b"").expect("writes");
        assert_eq!(shelf.files().expect("lists"), [second.clone(), first.clone()]);
        shelf.discard(&second).expect("discards");
        shelf.discard(&second).expect("it is gone, which is what was wanted");
        assert_eq!(shelf.files().expect("lists"), [first]);
        assert!(shelf.discard(Path::new("/etc/passwd.kgm")).is_err());
        assert_eq!(fs::read_dir(&shelf.0).expect("lists").count(), 3, "an unfinished file was left");
    }

    #[test]
    fn no_file_of_another_program_is_overwritten() {
        let shelf = shelf("shared");
        symlink("nowhere", shelf.0.join("cover.kgm")).expect("links");
        let keep = |i: u8| (shelf.keep("cover", &[i; 1000]).expect("kept"), [i; 1000]);
        let kept: Vec<_> = thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|i| scope.spawn(move || keep(i))).collect();
            threads.into_iter().map(|t| t.join().expect("no panic")).collect()
        });
        for (file, bytes) in &kept {
            assert_eq!(fs::read(file).expect("there"), bytes, "{}", file.display());
        }
        assert_eq!(shelf.files().expect("lists").len(), 9, "eight models and the link");
        assert!(!shelf.0.join("nowhere").exists(), "the link was followed");
    }

    #[test]
    fn what_cannot_be_written_leaves_nothing() {
        let shelf = shelf("unwritable");
        fs::remove_dir(&shelf.0).expect("removes");
        fs::write(&shelf.0, "in the way").expect("writes");
        let error = format!("{:#}", shelf.keep("cover", b"one").expect_err("in the way"));
        assert!(error.contains("cannot keep") && error.contains("cover.kgm"), "{error}");
    }

    #[test]
    fn what_was_left_unfinished_is_removed_when_it_is_old() {
        let shelf = shelf("abandoned");
        let [old, new, link, other] =
            [".keygraph-a.part", ".keygraph-b.part", ".keygraph-c.part", ".other.part"].map(|n| shelf.0.join(n));
        for file in [&old, &new, &other] {
            let file = File::create(file).expect("makes");
            file.set_modified(SystemTime::now() - 2 * ABANDONED).expect("sets");
        }
        File::options().write(true).open(&new).and_then(|f| f.set_modified(SystemTime::now())).expect("sets");
        symlink(&other, &link).expect("links");
        Shelf::open(&shelf.0).expect("opens");
        assert_eq!([&old, &new, &link, &other].map(|f| fs::symlink_metadata(f).is_ok()), [false, true, true, true]);
    }
}
