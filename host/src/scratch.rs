//! What the unit tests share: temporary folders, named pipes, checks of errors, videos.

use std::env;
use std::fs;
use std::io::{Write, stderr};
use std::path::{Path, PathBuf};
use std::process::{self, Command};

/// An empty folder; it is removed with its content when dropped.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    /// Makes the folder. One test only may use `name`.
    pub(crate) fn new(name: &str) -> Self {
        let path = env::temp_dir().join(format!("keygraph-{}-{name}", process::id()));
        fs::create_dir_all(&path).expect("temporary folder");
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The message of an error; "no error" when there is none.
pub(crate) fn message<T>(result: anyhow::Result<T>) -> String {
    result.err().map_or("no error".into(), |e| format!("{e:#}"))
}

/// Asserts that `result` is an error whose message contains `part`.
#[track_caller]
pub(crate) fn assert_says<T>(result: anyhow::Result<T>, part: &str) {
    let message = message(result);
    assert!(message.contains(part), "{part:?} is not in {message:?}");
}

/// Makes a named pipe.
pub(crate) fn make_fifo(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().expect("mkfifo").success());
}

/// Runs `ffmpeg -v error` with `arguments`, which are split at spaces, and the output
/// file. Returns false, and prints a line that cargo does not hide, when there is no
/// ffmpeg.
pub(crate) fn ffmpeg_makes(arguments: &str, output: &Path) -> bool {
    let status =
        Command::new("ffmpeg").args(["-v", "error", "-nostdin", "-y"]).args(arguments.split(' ')).arg(output).status();
    let Ok(status) = status else {
        assert!(env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no ffmpeg, and nothing may be skipped");
        let _ = writeln!(stderr(), "SKIPPED: no ffmpeg to make {}", output.display());
        return false;
    };
    assert!(status.success(), "ffmpeg {arguments}");
    true
}
