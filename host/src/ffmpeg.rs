//! ffmpeg as a child process: decodes videos and writes them.
//!
//! In: the arguments of a run. Out: the process with its pipes, and its messages when it
//! ends. Memory: 4 KB of messages and a pipe. Cost: a process and a thread.

use std::ffi::OsString;
use std::io::{self, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result, anyhow, ensure};

use crate::yuv4mpeg::CROP_TO_EVEN;

/// Maximum of bytes of ffmpeg's messages that are kept for an error.
const MAX_MESSAGE_BYTES: usize = 4096;

const NO_FFMPEG: &str = "video needs ffmpeg: install it with `sudo apt-get install ffmpeg` \
                         (Debian/Ubuntu) or `brew install ffmpeg` (macOS)";

/// Formats that ffmpeg may read, by its names for them: videos and pictures, each in one file. Not
/// among them are playlists and scripts (hls, dash, concat, ...), which name other files.
const FORMATS: &str = "3gp,apng,asf,avi,avs2,avs3,av1,bmp_pipe,dv,flv,gif,gxf,h261,h263,h264,hevc,ivf,m4v,\
                       matroska,mjpeg,mov,mp4,mpeg,mpegts,mpegvideo,mxf,nut,obu,ogg,rm,tiff_pipe,vc1,webm,\
                       webp_pipe,wtv,yuv4mpegpipe";

/// What ffmpeg says of another format.
const NOT_LISTED: &str = "not on whitelist";

/// Arguments that decode the video `path` to a YUV4MPEG2 stream on standard output.
pub(crate) fn decoding_arguments(path: &Path) -> Vec<OsString> {
    // A file that names others must not reach into the network, nor to the files of this machine.
    let limits = ["-protocol_whitelist", "file", "-format_whitelist", FORMATS, "-i"];
    let mut arguments = limits.map(OsString::from).to_vec();
    arguments.push(file_argument(path));
    let output = ["-an", "-sn", "-dn", "-vf", CROP_TO_EVEN]
        .into_iter()
        .chain(["-f", "yuv4mpegpipe", "-pix_fmt", "yuv420p", "-strict", "-1"])
        .chain(["-"]);
    arguments.extend(output.map(OsString::from));
    arguments
}

/// `path` as an argument. Without `file:`, ffmpeg would take a name such as `a:b.mp4` for
/// a protocol.
pub(crate) fn file_argument(path: &Path) -> OsString {
    let mut file = OsString::from("file:");
    file.push(path);
    file
}

/// An ffmpeg child process. A thread drains its messages, so that ffmpeg never waits for
/// this program to read them. The process is killed and waited for when this is dropped.
#[derive(Debug)]
pub(crate) struct Ffmpeg {
    /// The process. Its standard input and output are pipes, for the owner to take.
    pub(crate) child: Child,
    messages: Option<JoinHandle<String>>,
}

impl Ffmpeg {
    /// Starts ffmpeg with `arguments`.
    ///
    /// # Errors
    /// When there is no ffmpeg, or it cannot be started.
    pub(crate) fn start(arguments: &[OsString]) -> Result<Self> {
        Self::start_program("ffmpeg", arguments)
    }

    fn start_program(program: &str, arguments: &[OsString]) -> Result<Self> {
        let mut child = Command::new(program)
            .args(["-v", "error", "-nostdin"])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| match error.kind() {
                io::ErrorKind::NotFound => anyhow!(NO_FFMPEG),
                _ => anyhow!("cannot start ffmpeg: {error}"),
            })?;
        let messages = child.stderr.take().map(|stderr| thread::spawn(|| first_messages(stderr)));
        Ok(Self { child, messages })
    }

    /// Waits for the end of the process. Returns what it wrote to standard error.
    ///
    /// # Errors
    /// When ffmpeg failed; the error holds what it wrote.
    pub(crate) fn finish(mut self) -> Result<String> {
        // An open pipe would keep ffmpeg waiting.
        self.child.stdin = None;
        self.child.stdout = None;
        let status = self.child.wait().context("cannot wait for ffmpeg")?;
        let messages = self.messages.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        ensure!(
            !messages.contains(NOT_LISTED),
            "it is a playlist or another format that is not read: give the video itself"
        );
        ensure!(status.success(), "ffmpeg failed ({status}): {messages}");
        Ok(messages)
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // Both fail when the child has ended already: then there is nothing to do.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads a stream to its end and returns its first [`MAX_MESSAGE_BYTES`] bytes.
fn first_messages(mut stderr: impl Read) -> String {
    let mut kept = Vec::new();
    let _ = stderr.by_ref().take(MAX_MESSAGE_BYTES as u64).read_to_end(&mut kept);
    let _ = io::copy(&mut stderr, &mut io::sink());
    String::from_utf8_lossy(&kept).trim().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::assert_says;

    #[test]
    fn a_missing_ffmpeg_is_named_with_its_remedy() {
        let result = Ffmpeg::start_program("no-such-ffmpeg", &[]);
        assert_says(result, "video needs ffmpeg: install it with `sudo apt-get install ffmpeg`");
    }
}
