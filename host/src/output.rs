//! What a command writes: lines on standard output, and files.
//!
//! In: a line, or the path of a file and what goes into it. Out: the line, or the file: whole,
//! or as it was before. Memory: none. Cost: a few system calls, and the wait for the disk.
//!
//! A file is written under another name in its folder, flushed to the disk, and renamed. The
//! new file has the permissions of the one that it replaces, or those of any new file. A link
//! stays, and the file that it leads to is replaced. A pipe or a device, such as `/dev/stdout`,
//! is written directly. A program that is killed may leave a file whose name starts with
//! `.keygraph-` and ends with `.part`; one that a signal ends does not.

use std::borrow::Cow;
use std::collections::HashSet;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use keygraph_core::MAGIC;
use tempfile::{Builder, NamedTempFile};

use crate::file::Identity;
use crate::notice::notice;
use crate::picture::extension;
use crate::unfinished;

/// How the names of unfinished files start.
const DRAFT_START: &str = ".keygraph-";
/// How the names of unfinished files end.
const DRAFT_END: &str = ".part";
/// Maximum number of characters of a file's name that is made of an object's.
const LONGEST: usize = 48;
/// Random characters in the name of an unfinished file.
const DRAFT_RANDOM: usize = 16;

// --------------------------------------------------------------------- lines

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

/// Whether a character may stand in a name: it is no control character, and does not change
/// lines or the direction of the text.
#[must_use]
pub fn is_plain(c: char) -> bool {
    !c.is_control() && !matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// `text` with escapes (`\n`, `\u{1b}`) for characters that are not [plain](is_plain).
#[must_use]
pub fn plain(text: &str) -> Cow<'_, str> {
    if text.chars().all(is_plain) {
        return text.into();
    }
    let mut shown = String::new();
    for c in text.chars() {
        if is_plain(c) { shown.push(c) } else { shown.extend(c.escape_default()) }
    }
    shown.into()
}

/// `text` as [`plain`] shows it, but with its line breaks.
#[must_use]
pub fn plain_lines(text: &str) -> String {
    text.split('\n').map(plain).collect::<Vec<_>>().join("\n")
}

/// Checks a name that somebody gives an object.
///
/// # Errors
/// When it is empty, or has a character that is not [plain](is_plain).
pub fn check_name(name: &str) -> Result<()> {
    ensure!(!name.trim().is_empty(), "the name is empty: give the object a name");
    ensure!(name.chars().all(is_plain), "the name {} has control characters: leave them out", plain(name));
    Ok(())
}

/// Says on standard error where a result went.
pub fn tell_written(path: &Path) {
    notice(&format!("written: {}", plain(&path.display().to_string())));
}

/// Says on standard error how many files went to `path`, a file or a folder.
pub fn tell_written_files(path: &Path, files: usize) {
    let name = path.display().to_string();
    match files {
        0 => notice(&format!("nothing to write to {}", plain(&name))),
        1 if !path.is_dir() => tell_written(path),
        n => notice(&format!("written: {n} file{} in {}", if n == 1 { "" } else { "s" }, plain(&name))),
    }
}

// --------------------------------------------------------------------- files

/// Converts the name of an object to a file name that every system takes.
#[must_use]
pub fn file_stem(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_ ".contains(c) { c } else { '_' };
    let stem: String = name.trim().chars().map(plain).take(LONGEST).collect();
    if stem.is_empty() { "object".into() } else { stem }
}

/// The files that a command reads. It must not overwrite them.
#[derive(Debug, Default)]
pub struct Inputs(HashSet<Identity>);

impl Inputs {
    /// The files `paths`, and the files directly in those that are folders.
    pub fn of<'a>(paths: impl IntoIterator<Item = &'a Path>) -> Self {
        let mut files = HashSet::new();
        for path in paths {
            files.extend(Identity::of(path));
            let inside = fs::read_dir(path).into_iter().flatten().flatten();
            files.extend(inside.filter_map(|entry| Identity::of(&entry.path())));
        }
        Self(files)
    }

    /// Whether `path` is one of these files, also under another name.
    #[must_use]
    pub fn contain(&self, path: &Path) -> bool {
        Identity::of(path).is_some_and(|file| self.0.contains(&file))
    }
}

/// Checks a file that will be written, before work is done in vain.
///
/// # Errors
/// When its folder does not exist, it is a folder itself, or it is one of `inputs`.
pub fn check_output(path: &Path, inputs: &Inputs) -> Result<()> {
    let name = path.display();
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty() && !f.is_dir()) {
        bail!("cannot write {name}: the folder {} does not exist", folder.display());
    }
    ensure!(!path.is_dir(), "cannot write {name}: it is a folder");
    ensure!(!inputs.contain(path), "{name} would overwrite an input: give another name");
    Ok(())
}

/// Checks the file of a model that will be written, as [`check_output`] does.
///
/// # Errors
/// When its name has another extension than those of models, or it is a file that is no model.
pub fn check_model_output(path: &Path, inputs: &Inputs) -> Result<()> {
    let name = path.display();
    ensure!(
        matches!(extension(path).as_str(), "" | "kgm"),
        "cannot write {name}: the name of a model must end with .kgm"
    );
    check_output(path, inputs)?;
    if path.is_file() {
        let mut start = Vec::new();
        let _ = File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start));
        ensure!(start.is_empty() || start == MAGIC, "{name} is no model and would be lost: give another name");
    }
    Ok(())
}

/// Writes a file: whole, or not at all.
///
/// # Errors
/// When it cannot be written, or `write` fails. What was there before stays.
pub fn write_file(path: &Path, write: impl FnOnce(&mut File) -> Result<()>) -> Result<()> {
    let mut draft = Draft::new(path)?;
    write(draft.file()).with_context(|| unwritable(path))?;
    draft.finish()
}

/// The message of a file that cannot be written.
fn unwritable(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

/// A file that is being written. It replaces the one of its name when it is finished. When it
/// is dropped before, nothing is left of it.
#[derive(Debug)]
pub struct Draft {
    /// The path as given.
    path: PathBuf,
    place: Place,
}

#[derive(Debug)]
enum Place {
    /// A new file in the folder of the file that it will replace.
    Beside { file: NamedTempFile, target: PathBuf },
    /// A pipe or a device.
    Direct(File),
}

impl Draft {
    /// Starts the file `path`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(path: &Path) -> Result<Self> {
        let place = Place::of(path).with_context(|| unwritable(path))?;
        Ok(Self { path: path.to_path_buf(), place })
    }

    /// The file to write to.
    pub fn file(&mut self) -> &mut File {
        match &mut self.place {
            Place::Beside { file, .. } => file.as_file_mut(),
            Place::Direct(file) => file,
        }
    }

    /// The path under which another program can write to it.
    #[must_use]
    pub fn path(&self) -> &Path {
        match &self.place {
            Place::Beside { file, .. } => file.path(),
            Place::Direct(_) => &self.path,
        }
    }

    /// Flushes the file to the disk, and gives it its name.
    ///
    /// # Errors
    /// When this fails; what was there before stays.
    pub fn finish(self) -> Result<()> {
        let Place::Beside { file, target } = self.place else { return Ok(()) };
        let renamed = || -> io::Result<()> {
            file.as_file().sync_all()?;
            file.persist(&target)?;
            flush_folder(folder_of(&target))
        };
        renamed().with_context(|| unwritable(&self.path))
    }
}

impl Place {
    fn of(path: &Path) -> Result<Self> {
        let existing = match fs::metadata(path) {
            Ok(found) => Some(found),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error.into()),
        };
        let Some(existing) = existing else {
            ensure!(fs::symlink_metadata(path).is_err(), "it is a link to a file that does not exist");
            return Ok(Self::Beside { file: new_draft(folder_of(path))?, target: path.to_path_buf() });
        };
        ensure!(!existing.is_dir(), "it is a folder");
        // A file that is protected against writing is not replaced either.
        let opened = OpenOptions::new().write(true).open(path)?;
        if !existing.is_file() {
            return Ok(Self::Direct(opened));
        }
        let target = fs::canonicalize(path)?;
        let file = new_draft(folder_of(&target))?;
        file.as_file().set_permissions(existing.permissions())?;
        Ok(Self::Beside { file, target })
    }
}

/// Makes an unfinished file in a folder, with a name that no other file has and that cannot be
/// guessed. It is removed when dropped.
///
/// # Errors
/// When the folder cannot be written.
pub fn new_draft(folder: &Path) -> Result<NamedTempFile> {
    let mut builder = Builder::new();
    builder.prefix(DRAFT_START).suffix(DRAFT_END).rand_bytes(DRAFT_RANDOM);
    if let Some(permissions) = usual_permissions() {
        builder.permissions(permissions);
    }
    let draft = builder.tempfile_in(folder).map_err(|error| {
        // The error of the library names the unfinished file, which says nothing to users.
        let text = error.get_ref().and_then(|e| e.source()).map_or_else(|| error.to_string(), ToString::to_string);
        anyhow!("the folder {} takes no new file: {text}", folder.display())
    })?;
    unfinished::note(&draft);
    Ok(draft)
}

/// The permissions of a new file, from which the system takes those of the umask.
#[cfg(unix)]
#[allow(clippy::unnecessary_wraps, reason = "other systems have none")]
fn usual_permissions() -> Option<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Some(Permissions::from_mode(0o666))
}

#[cfg(not(unix))]
fn usual_permissions() -> Option<Permissions> {
    None
}

/// Whether a file in a folder is unfinished by its name.
#[must_use]
pub fn is_draft(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(DRAFT_START) && name.ends_with(DRAFT_END)
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Flushes the names of a folder to the disk, where the system can do this.
///
/// # Errors
/// When the disk fails.
pub fn flush_folder(folder: &Path) -> io::Result<()> {
    // A folder that may be written may be closed to reading.
    let Ok(opened) = File::open(folder) else { return Ok(()) };
    match opened.sync_all() {
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        result => result,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::{Folder, assert_says, make_fifo};
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::thread;

    fn write(path: &Path, bytes: &[u8]) -> Result<()> {
        write_file(path, |file| Ok(file.write_all(bytes)?))
    }

    fn names(folder: &Folder) -> Vec<String> {
        let entries = fs::read_dir(&folder.0).expect("lists").flatten();
        entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect()
    }

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).expect("there").permissions().mode() & 0o777
    }

    #[test]
    fn names_become_names_of_files() {
        assert_eq!(file_stem("../../etc/passwd"), "______etc_passwd");
        assert_eq!(file_stem(" Brücke 7 "), "Brücke 7");
        assert_eq!(file_stem(".hidden"), "_hidden");
        assert_eq!(file_stem("  "), "object");
        assert_eq!(file_stem(&"x".repeat(300)).len(), LONGEST);
    }

    #[test]
    fn a_file_is_replaced_whole_or_stays() {
        let folder = Folder::new("replaced");
        let path = folder.0.join("file");
        write(&path, b"old").expect("writes");
        assert_says(
            write_file(&path, |file| {
                file.write_all(b"half")?;
                bail!("out of ink")
            }),
            "out of ink",
        );
        assert_eq!((fs::read(&path).expect("there"), names(&folder)), (b"old".into(), vec!["file".to_string()]));
        let mut draft = Draft::new(&path).expect("starts");
        draft.file().write_all(b"new").expect("writes");
        assert!(is_draft(draft.path()) && names(&folder).len() == 2);
        assert_eq!(fs::read(&path).expect("there"), b"old", "until it is finished");
        draft.finish().expect("finishes");
        assert_eq!((fs::read(&path).expect("there"), names(&folder)), (b"new".into(), vec!["file".to_string()]));
        assert_says(write(&folder.0, b"x"), "is a folder");
        assert_says(write(&folder.0.join("no/file"), b"x"), "no takes no new file");
    }

    #[test]
    fn permissions_are_those_of_a_new_file_or_of_the_one_replaced() {
        let folder = Folder::new("permissions");
        let [plain, ours] = ["plain", "ours"].map(|n| folder.0.join(n));
        fs::write(&plain, "x").expect("writes");
        write(&ours, b"x").expect("writes");
        assert_eq!(mode(&ours), mode(&plain));
        fs::set_permissions(&ours, Permissions::from_mode(0o640)).expect("sets");
        write(&ours, b"y").expect("writes");
        assert_eq!(mode(&ours), 0o640);
    }

    #[test]
    fn a_link_stays_and_its_file_is_replaced() {
        let folder = Folder::new("link");
        let [file, link, nowhere] = ["file", "link", "nowhere"].map(|n| folder.0.join(n));
        fs::write(&file, "old").expect("writes");
        symlink("file", &link).expect("links");
        symlink("missing", &nowhere).expect("links");
        write(&link, b"new").expect("writes");
        assert_eq!(fs::read(&file).expect("there"), b"new");
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_says(write(&nowhere, b"new"), "a link to a file that does not exist");
    }

    #[test]
    fn pipes_and_devices_are_written_directly() {
        let folder = Folder::new("direct");
        let fifo = folder.0.join("fifo");
        make_fifo(&fifo);
        let reader = thread::spawn({
            let fifo = fifo.clone();
            move || fs::read(fifo)
        });
        write(&fifo, b"through").expect("writes");
        assert_eq!(reader.join().expect("no panic").expect("reads"), b"through");
        write(Path::new("/dev/null"), b"x").expect("writes");
        if Path::new("/dev/full").exists() {
            assert_says(write(Path::new("/dev/full"), b"x"), "cannot write /dev/full: No space left");
        }
        assert_eq!(names(&folder), ["fifo"]);
    }

    #[test]
    fn inputs_and_files_that_are_no_models_are_not_overwritten() {
        let folder = Folder::new("inputs");
        let [input, hard, notes, model] = ["a.kgm", "hard.kgm", "notes", "m.kgm"].map(|n| folder.0.join(n));
        fs::write(&input, MAGIC).expect("writes");
        fs::hard_link(&input, &hard).expect("links");
        fs::write(&notes, "to do").expect("writes");
        let inputs = Inputs::of([input.as_path()]);
        assert_says(check_model_output(&hard, &inputs), "overwrite an input");
        assert_says(check_model_output(&notes, &inputs), "is no model and would be lost");
        assert_says(check_model_output(&folder.0.join("a.jpg"), &inputs), "must end with .kgm");
        assert!(check_model_output(&hard, &Inputs::default()).is_ok(), "a model is replaced");
        assert!(check_model_output(&model, &inputs).is_ok());
        assert!(Inputs::of([folder.0.as_path()]).contain(&hard), "the files of a folder are inputs");
    }

    #[test]
    fn names_are_shown_without_effects() {
        assert_eq!(plain("Brücke \"7\""), "Brücke \"7\"");
        assert_eq!(plain("a\n\u{1b}[2J\u{202e}b"), "a\\n\\u{1b}[2J\\u{202e}b");
        assert!(check_name("a b").is_ok());
        assert_says(check_name(" "), "is empty");
        assert_says(check_name("a\nb"), "a\\nb has control characters");
    }
}
