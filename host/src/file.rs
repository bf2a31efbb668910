//! Files on the disk: which names stand for one file, and how a whole file is read.
//!
//! In: a path. Out: the identity of its file, or its bytes. Memory: the bytes of the file.
//! Cost: a few system calls, and the reading.

use std::fs::{self, File, FileType, Metadata};
use std::io::{self, Read};
use std::path::Path;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use crate::notice::notice;

/// Time after which somebody is told that a pipe is waited for.
const PATIENCE: Duration = Duration::from_secs(2);

/// What tells one file from another, whatever their names: device and number of the file.
#[cfg(unix)]
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Identity(u64, u64);

/// What tells one file from another: its path without links. A second name of a file (a hard
/// link) is not noticed.
#[cfg(not(unix))]
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Identity(std::path::PathBuf);

impl Identity {
    /// The identity of the file that `path` leads to, through links too. `None` when there is
    /// no file, or when it is a folder, a device or a pipe.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = fs::metadata(path).ok()?;
        metadata.is_file().then(|| Self::new(path, &metadata)).flatten()
    }

    #[cfg(unix)]
    #[allow(clippy::unnecessary_wraps, reason = "other systems may not know it")]
    fn new(_: &Path, metadata: &Metadata) -> Option<Self> {
        use std::os::unix::fs::MetadataExt;
        Some(Self(metadata.dev(), metadata.ino()))
    }

    #[cfg(not(unix))]
    fn new(path: &Path, _: &Metadata) -> Option<Self> {
        fs::canonicalize(path).ok().map(Self)
    }
}

/// Reads a whole file or pipe. Says on standard error when nobody writes into the pipe.
///
/// # Errors
/// When it cannot be read, or is a device: some have no end.
pub fn read_whole(path: &Path) -> io::Result<Vec<u8>> {
    let kind = fs::metadata(path)?.file_type();
    if is_device(kind) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a device, not a file"));
    }
    if kind.is_file() || kind.is_dir() {
        return fs::read(path);
    }
    let (done, end) = channel::<()>();
    let name = path.display().to_string();
    thread::spawn(move || {
        if end.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
            notice(&format!("waiting for what is written into the pipe {name}"));
        }
    });
    let bytes = fs::read(path);
    drop(done);
    bytes
}

/// Opens a regular file that somebody else may have put there. A link is not followed, and
/// nothing else is opened: a pipe would make this wait for ever.
///
/// # Errors
/// When it cannot be opened, or is no regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    let refuse = |what| Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    let named = fs::symlink_metadata(path)?;
    if !named.is_file() {
        return refuse("it is a link, a folder, a pipe or a device, not a regular file");
    }
    let file = File::open(path)?;
    if Identity::new(path, &file.metadata()?) != Identity::new(path, &named) {
        return refuse("it was exchanged while it was opened");
    }
    Ok(file)
}

/// Reads a regular file, as [`open_regular`] opens it.
///
/// # Errors
/// When it cannot be read, or is no regular file.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Fills `out` with the bytes of an open file from `start` on. Threads may read one file at once.
///
/// # Errors
/// When the file cannot be read, or there are not so many bytes.
#[cfg(unix)]
pub fn read_exact_at(file: &File, out: &mut [u8], start: u64) -> io::Result<()> {
    use std::os::unix::fs::FileExt;
    file.read_exact_at(out, start)
}

/// Fills `out` with the bytes of an open file from `start` on. Threads may read one file at once.
///
/// # Errors
/// When the file cannot be read, or there are not so many bytes.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut out: &mut [u8], mut start: u64) -> io::Result<()> {
    use std::os::windows::fs::FileExt;
    while !out.is_empty() {
        match file.seek_read(out, start) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                out = &mut out[n..];
                start += n as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Whether this is a device, or a socket.
#[cfg(unix)]
fn is_device(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt;
    kind.is_char_device() || kind.is_block_device() || kind.is_socket()
}

/// Whether this is a device: elsewhere, devices are not told from files.
#[cfg(not(unix))]
fn is_device(_: FileType) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::{Folder, make_fifo};
    use std::os::unix::fs::symlink;

    #[test]
    fn all_names_of_a_file_have_one_identity() {
        let folder = Folder::new("identity");
        let [file, other, link, hard] = ["file", "other", "link", "hard"].map(|n| folder.0.join(n));
        fs::write(&file, "x").expect("writes");
        fs::write(&other, "x").expect("writes");
        symlink(&file, &link).expect("links");
        fs::hard_link(&file, &hard).expect("links");
        let identity = Identity::of(&file);
        assert!(identity.is_some() && identity != Identity::of(&other));
        assert_eq!((identity.clone(), identity), (Identity::of(&link), Identity::of(&hard)));
        for none in ["/dev/null", "/tmp", "/no/such"] {
            assert_eq!(Identity::of(Path::new(none)), None, "{none}");
        }
    }

    #[test]
    fn only_regular_files_are_read_strictly() {
        let folder = Folder::new("regular");
        let [file, link, fifo] = ["file", "link", "fifo"].map(|n| folder.0.join(n));
        fs::write(&file, "x").expect("writes");
        symlink(&file, &link).expect("links");
        make_fifo(&fifo);
        assert_eq!(read_regular(&file).expect("reads"), b"x");
        for wrong in [&link, &fifo, &folder.0, &"/dev/zero".into()] {
            let error = read_regular(wrong).expect_err("no regular file").to_string();
            assert!(error.contains("not a regular file"), "{}: {error}", wrong.display());
        }
    }

    #[test]
    fn a_part_of_an_open_file_is_read() {
        let folder = Folder::new("part");
        let path = folder.0.join("file");
        fs::write(&path, b"0123456789").expect("writes");
        let file = File::open(&path).expect("opens");
        let mut part = [0; 3];
        read_exact_at(&file, &mut part, 7).expect("reads");
        assert_eq!(&part, b"789");
        let error = read_exact_at(&file, &mut part, 8).expect_err("there are two bytes");
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn a_pipe_is_read_and_a_device_is_not() {
        let folder = Folder::new("whole");
        let fifo = folder.0.join("fifo");
        make_fifo(&fifo);
        let writer = thread::spawn({
            let fifo = fifo.clone();
            move || fs::write(fifo, "through the pipe")
        });
        assert_eq!(read_whole(&fifo).expect("reads"), b"through the pipe");
        writer.join().expect("no panic").expect("writes");
        let error = read_whole(Path::new("/dev/zero")).expect_err("it has no end").to_string();
        assert!(error.contains("a device"), "{error}");
    }
}
