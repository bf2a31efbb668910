//! A folder that keeps models when the program ends.
//!
//! In: models with names. Out: one file a model. A file is complete or does not exist, even
//! after a crash: it is written under another name, flushed to the disk, and renamed.
//! Memory: none. Cost: some ms a model on the disk.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// Maximum number of characters of a file's name, without its extension and number.
const LONGEST: usize = 48;
/// Maximum number of files of one name.
const MOST: u32 = 1000;

/// The folder of the models.
#[derive(Clone, Debug)]
pub struct Shelf(PathBuf);

impl Shelf {
    /// Opens the folder, and makes it when it does not exist.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        Ok(Self(folder.to_path_buf()))
    }

    /// The files of all models in the folder, sorted by name.
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

    /// Writes a model under its name, with a number added when the name is taken. Returns its
    /// file.
    ///
    /// # Errors
    /// When the file cannot be written; then no part of it is left.
    pub fn keep(&self, name: &str, model: &[u8]) -> Result<PathBuf> {
        let stem = file_stem(name);
        let numbered = |n: u32| if n == 1 { format!("{stem}.kgm") } else { format!("{stem}-{n}.kgm") };
        let free = (1..=MOST).map(|n| self.0.join(numbered(n))).find(|path| !path.exists());
        let path = free.with_context(|| format!("{} is full of models named {name}", self.0.display()))?;
        let unfinished = self.0.join(format!(".{stem}.kgm.part"));
        let written = || -> std::io::Result<()> {
            let mut file = File::create(&unfinished)?;
            file.write_all(model)?;
            file.sync_all()?;
            fs::rename(&unfinished, &path)?;
            // This flushes the name to the disk, too.
            File::open(&self.0)?.sync_all()
        };
        written().with_context(|| {
            let _ = fs::remove_file(&unfinished);
            format!("cannot keep {}: make room, or see who may write there", path.display())
        })?;
        Ok(path)
    }

    /// Removes a model's file. A file that does not exist any more is no error.
    ///
    /// # Errors
    /// When the file cannot be removed, or is not in the folder.
    pub fn discard(&self, file: &Path) -> Result<()> {
        ensure!(file.parent() == Some(&self.0), "{} is not in {}", file.display(), self.0.display());
        match fs::remove_file(file) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                Err(e).with_context(|| format!("cannot remove {}: see who may write there", file.display()))
            }
            _ => Ok(()),
        }
    }
}

/// Converts the name of an object to a file name that every system takes.
fn file_stem(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_ ".contains(c) { c } else { '_' };
    let stem: String = name.trim().chars().map(plain).take(LONGEST).collect();
    if stem.is_empty() { "object".into() } else { stem }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn what_cannot_be_written_leaves_nothing() {
        let shelf = shelf("unwritable");
        fs::create_dir(shelf.0.join(".cover.kgm.part")).expect("makes");
        let error = format!("{:#}", shelf.keep("cover", b"one").expect_err("in the way"));
        assert!(error.contains("cannot keep") && error.contains("cover.kgm"), "{error}");
        assert_eq!(shelf.files().expect("lists"), Vec::<PathBuf>::new());
    }

    #[test]
    fn names_become_names_of_files() {
        assert_eq!(file_stem("../../etc/passwd"), "______etc_passwd");
        assert_eq!(file_stem(" Brücke 7 "), "Brücke 7");
        assert_eq!(file_stem(".hidden"), "_hidden");
        assert_eq!(file_stem("  "), "object");
        assert_eq!(file_stem(&"x".repeat(300)).len(), LONGEST);
    }
}
