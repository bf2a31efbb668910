//! What a command writes: lines on standard output, and files.
//!
//! In: a line, or the path of a file that will be written. Out: the line, or an error
//! before work is done in vain. Memory: none. Cost: a system call or two.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use anyhow::{Result, bail};

/// Prints a line on standard output and flushes it.
///
/// # Errors
/// When standard output is closed.
pub fn print_line(line: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()?;
    Ok(())
}

/// Checks that the folder of a file that will be written exists.
///
/// # Errors
/// When the folder does not exist.
pub fn check_folder_of(path: &Path) -> Result<()> {
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty() && !f.is_dir()) {
        bail!("cannot write {}: the folder {} does not exist", path.display(), folder.display());
    }
    Ok(())
}

/// Whether `path` and one of `inputs` are the same file.
pub fn is_one_of<'a>(path: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> bool {
    let same = |p: &Path| inputs.into_iter().any(|input| fs::canonicalize(input).is_ok_and(|i| i == p));
    fs::canonicalize(path).is_ok_and(|p| same(&p))
}
