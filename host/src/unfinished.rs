//! Files that this program is about to remove: those that are not finished, and temporary ones.
//!
//! In: their names. Out: none of them is left when the program ends itself in the middle. One that is dropped or
//! finished before is no concern of this. Memory: a name each. Cost: a system call each.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

/// Names of files. Some may be finished or gone.
#[derive(Debug)]
struct Files(Mutex<Vec<PathBuf>>);

/// All files of this program.
static FILES: Files = Files(Mutex::new(Vec::new()));

impl Files {
    /// Adds a name, and forgets those that are gone.
    fn add(&self, path: &Path) {
        let mut paths = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        paths.retain(|p| fs::symlink_metadata(p).is_ok());
        paths.push(path.to_path_buf());
    }

    #[cfg(any(test, feature = "live"))]
    fn remove(&self) {
        for path in self.0.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            // Most are finished: then nothing has this name.
            let _ = fs::remove_file(path);
        }
    }
}

/// Notes a file that is removed when it is dropped, and is not finished yet.
pub(crate) fn note(file: &NamedTempFile) {
    FILES.add(file.path());
}

/// Makes a temporary file, for what can be read from a file alone. It is removed when it is dropped.
///
/// # Errors
/// When the folder of temporary files cannot be written.
pub(crate) fn temporary() -> io::Result<NamedTempFile> {
    let file = NamedTempFile::new()?;
    note(&file);
    Ok(file)
}

/// Removes the files of this program, which is about to end. Whoever still writes one fails to give it its name. Files
/// that have their name stay.
#[cfg(feature = "live")]
pub(crate) fn remove() {
    FILES.remove();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::Folder;
    use std::io::Write;

    #[test]
    fn unfinished_files_are_removed_and_finished_ones_stay() {
        let folder = Folder::new("unfinished");
        // Those of the program are left to the other tests.
        let files = Files(Mutex::new(Vec::new()));
        let [mut one, two] = [0; 2].map(|_| NamedTempFile::new_in(&folder.0).expect("makes"));
        files.add(one.path());
        one.write_all(b"whole").expect("writes");
        one.persist(folder.0.join("model")).expect("renames");
        files.add(two.path());
        assert_eq!(files.0.lock().expect("not poisoned").as_slice(), [two.path()], "what is finished is forgotten");
        files.remove();
        let names: Vec<_> = fs::read_dir(&folder.0).expect("lists").flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["model"]);
        assert!(two.persist(folder.0.join("other")).is_err());
    }
}
