//! A folder in which models outlive the program.
//!
//! In: models with names. Out: one file each, there whole or not at all, whatever
//! happens meanwhile: it is written under another name, forced to the disk, and renamed.
//! Memory: nothing. Cost: the disk's, some ms a model.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// Most characters of a file's name, without its ending and a number.
const LONGEST: usize = 48;
/// Most files of one name.
const MOST: u32 = 1000;

/// The folder.
#[derive(Clone, Debug)]
pub struct Shelf(PathBuf);

impl Shelf {
    /// A folder, made if it is not there.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn open(folder: &Path) -> Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        Ok(Self(folder.to_path_buf()))
    }

    /// All models in it, by name.
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

    /// Keeps a model under its name; with a number, where that is taken. Returns its file.
    ///
    /// # Errors
    /// When it cannot be written: then nothing of it is there.
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
            // The name, too, is on the disk now.
            File::open(&self.0)?.sync_all()
        };
        written().with_context(|| {
            let _ = fs::remove_file(&unfinished);
            format!("cannot keep {}: make room, or see who may write there", path.display())
        })?;
        Ok(path)
    }

    /// Takes a model's file away; one that is not there any more is no error.
    ///
    /// # Errors
    /// When it is still there.
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

/// A name as that of a file, on any system.
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
