//! ffmpeg as a child process: decodes videos and writes them.
//!
//! In: the arguments of a run. Out: the process with its pipes, and its messages when it
//! ends. Memory: 4 KB of messages and a pipe. Cost: a process and a thread.

use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, ensure};

use crate::content::{extension, is_rtsp, is_stdin, is_url, without_query};

/// Filter of ffmpeg that drops the last column or row of an odd size, which 4:2:0 cannot
/// halve.
pub(crate) const CROP_TO_EVEN: &str = "crop=trunc(iw/2)*2:trunc(ih/2)*2";

/// Maximum of bytes of ffmpeg's messages that are kept for an error.
const MAX_MESSAGE_BYTES: usize = 4096;

const NO_FFMPEG: &str = "video needs ffmpeg: install it with `sudo apt-get install ffmpeg` \
                         (Debian/Ubuntu), `brew install ffmpeg` (macOS) or `winget install Gyan.FFmpeg` (Windows)";

/// Formats that ffmpeg may read, by its names for them: videos and pictures, each in one file. Not
/// among them are playlists and scripts (hls, dash, concat, ...), which name other files.
const FORMATS: &str = "3gp,apng,asf,avi,avs2,avs3,av1,bmp_pipe,dv,flv,gif,gxf,h261,h263,h264,hevc,ivf,m4v,\
                       matroska,mjpeg,mov,mp4,mpeg,mpegts,mpegvideo,mxf,nut,obu,ogg,rm,tiff_pipe,vc1,webm,\
                       webp_pipe,wtv,yuv4mpegpipe";

/// What an address may give besides: the stream of a camera, a picture, and a stream in pieces (HLS). The
/// protocols keep its pieces from being files of this machine.
const REMOTE_FORMATS: &str = "aac,hls,jpeg_pipe,mp3,mpjpeg,png_pipe,rtp,rtsp,sdp";

/// Protocols by which a stream at an address may come.
const PROTOCOLS: &str = "rtp,rtsp,rtsps,srtp,udp,tcp,tls,http,https,httpproxy,crypto";

/// What ffmpeg says of another format.
const NOT_LISTED: &str = "not on whitelist";

/// Maximum number of pixels of a frame.
const MOST_PIXELS: &str = "100000000";

/// Time without a byte after which a stream at an address counts as broken off.
const MOST_SILENCE: Duration = Duration::from_secs(15);

/// Arguments that decode the video `path`, an address, or `-`, to a YUV4MPEG2 stream on standard output.
pub(crate) fn decoding_arguments(path: &Path) -> Vec<OsString> {
    let mut arguments = input_arguments(path);
    let output = ["-an", "-sn", "-dn", "-vf", CROP_TO_EVEN]
        .into_iter()
        .chain(["-f", "yuv4mpegpipe", "-pix_fmt", "yuv420p", "-strict", "-1"])
        .chain(["-"]);
    arguments.extend(output.map(OsString::from));
    arguments
}

/// Arguments that decode the picture `path` to a PNG on standard output.
pub(crate) fn picture_arguments(path: &Path) -> Vec<OsString> {
    let mut arguments = input_arguments(path);
    arguments.extend(["-frames:v", "1", "-f", "image2pipe", "-c:v", "png", "-"].map(OsString::from));
    arguments
}

/// Arguments that read `path`, and nothing that it may name.
fn input_arguments(path: &Path) -> Vec<OsString> {
    let mut arguments = vec!["-max_pixels".into(), MOST_PIXELS.into()];
    let mut add = |more: &[&str]| arguments.extend(more.iter().map(OsString::from));
    // A file that names others must not reach into the network, nor to the files of this machine.
    if is_url(path) {
        add(&["-protocol_whitelist", PROTOCOLS, "-format_whitelist", &format!("{FORMATS},{REMOTE_FORMATS}")]);
        if is_rtsp(path) {
            // Datagrams get lost; what a camera cannot send otherwise still comes so.
            add(&["-rtsp_flags", "prefer_tcp"]);
        } else {
            let silence = MOST_SILENCE.as_micros().to_string();
            add(&["-rw_timeout", &silence]);
            // By its name, ffmpeg would take the address for the pattern of many.
            match extension(Path::new(without_query(path))).as_str() {
                "jpg" | "jpeg" => add(&["-f", "jpeg_pipe"]),
                "png" => add(&["-f", "png_pipe"]),
                _ => {}
            }
        }
        add(&["-i"]);
        arguments.push(path.into());
    } else if is_stdin(path) {
        add(&[
            "-protocol_whitelist",
            "pipe",
            "-format_whitelist",
            &format!("{FORMATS},jpeg_pipe,mpjpeg,png_pipe"),
            "-i",
            "pipe:0",
        ]);
    } else {
        add(&["-protocol_whitelist", "file", "-format_whitelist", FORMATS, "-i"]);
        arguments.push(file_argument(path));
    }
    arguments
}

/// Whether there is an ffmpeg that can be started.
#[cfg(feature = "live")]
pub(crate) fn is_there() -> bool {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    ffmpeg.status().is_ok_and(|status| status.success())
}

/// Writes all of `from` to a child process, in a thread. Ends when either ends.
pub(crate) fn pump(mut from: impl Read + Send + 'static, mut to: impl Write + Send + 'static) {
    // An error says that the process has ended, and its own message says why.
    thread::spawn(move || io::copy(&mut from, &mut to));
}

/// A stream that is read by a thread of its own, so that nobody has to wait for it without an end.
#[derive(Debug)]
pub(crate) struct Patient {
    chunks: Receiver<Vec<u8>>,
    rest: io::Cursor<Vec<u8>>,
    /// Time without a byte after which reading fails.
    patience: Option<Duration>,
}

impl Patient {
    /// The output of a program that may fall silent.
    pub(crate) fn new(stream: impl Read + Send + 'static) -> Self {
        Self { patience: Some(MOST_SILENCE), ..Self::without_end(stream) }
    }

    /// A stream that may be silent for as long as it likes.
    pub(crate) fn without_end(mut stream: impl Read + Send + 'static) -> Self {
        // One chunk more than the pipe holds.
        let (send, chunks) = sync_channel(1);
        thread::spawn(move || {
            let mut chunk = vec![0; 1 << 16];
            while let Ok(n @ 1..) = stream.read(&mut chunk) {
                if send.send(chunk[..n].to_vec()).is_err() {
                    break;
                }
            }
        });
        Self { chunks, rest: io::Cursor::default(), patience: None }
    }

    /// Whether the stream is known to be at its end, or becomes so within `time`.
    pub(crate) fn ends_within(&mut self, time: Duration) -> bool {
        if self.rest.position() < self.rest.get_ref().len() as u64 {
            return false;
        }
        match self.chunks.recv_timeout(time) {
            Ok(chunk) => {
                self.rest = io::Cursor::new(chunk);
                false
            }
            Err(error) => error == RecvTimeoutError::Disconnected,
        }
    }
}

impl Read for Patient {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let n = self.rest.read(buffer)?;
            if n > 0 || buffer.is_empty() {
                return Ok(n);
            }
            let next = match self.patience {
                Some(time) => self.chunks.recv_timeout(time),
                None => self.chunks.recv().map_err(|_| RecvTimeoutError::Disconnected),
            };
            match next {
                Ok(chunk) => self.rest = io::Cursor::new(chunk),
                Err(RecvTimeoutError::Disconnected) => return Ok(0),
                Err(RecvTimeoutError::Timeout) => {
                    let message = format!("nothing came for {} seconds", MOST_SILENCE.as_secs());
                    return Err(io::Error::new(io::ErrorKind::TimedOut, message));
                }
            }
        }
    }
}

/// `path` as an argument. Without `file:`, ffmpeg would take a name such as `a:b.mp4` for
/// a protocol.
pub(crate) fn file_argument(path: &Path) -> OsString {
    let mut file = OsString::from("file:");
    file.push(path);
    file
}

/// The processes that run. Who waits for one or ends one holds the lock: so none is missed by [`stop_all`].
static RUNNING: Mutex<Vec<Child>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Child>> {
    // Every change is made in one call.
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends all processes, for a program that is about to end. From now on, whoever starts one or waits for one waits
/// without an end, and has nothing to report.
#[cfg(feature = "live")]
pub(crate) fn stop_all() {
    let mut running = running();
    for child in running.iter_mut() {
        // Both fail when it has ended already: then there is nothing to do.
        let _ = child.kill();
        let _ = child.wait();
    }
    std::mem::forget(running);
}

/// An ffmpeg child process. A thread drains its messages, so that ffmpeg never waits for
/// this program to read them. The process is killed and waited for when this is dropped.
#[derive(Debug)]
pub(crate) struct Ffmpeg {
    /// The pipe to its standard input, for the owner to take.
    pub(crate) input: Option<ChildStdin>,
    /// The pipe of its standard output, for the owner to take.
    pub(crate) output: Option<ChildStdout>,
    id: u32,
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
        let mut running = running();
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
        let (input, output, id) = (child.stdin.take(), child.stdout.take(), child.id());
        running.push(child);
        Ok(Self { input, output, id, messages })
    }

    /// Waits for the end of the process. Returns what it wrote to standard error.
    ///
    /// # Errors
    /// When ffmpeg failed; the error holds what it wrote.
    pub(crate) fn finish(mut self) -> Result<String> {
        // An open pipe would keep ffmpeg waiting.
        self.input = None;
        self.output = None;
        // Its messages end when it does: the wait is short, then.
        let messages = self.messages.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let status = self.take(&mut running()).map(|mut child| child.wait());
        let status = status.context("ffmpeg was ended")?.context("cannot wait for ffmpeg")?;
        ensure!(
            !messages.contains(NOT_LISTED),
            "it is a playlist or another format that is not read: give the video itself"
        );
        ensure!(status.success(), "ffmpeg failed ({status}): {messages}");
        Ok(messages)
    }

    /// The process, if nobody has waited for it.
    fn take(&self, running: &mut Vec<Child>) -> Option<Child> {
        let at = running.iter().position(|child| child.id() == self.id)?;
        Some(running.swap_remove(at))
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        let mut running = running();
        if let Some(mut child) = self.take(&mut running) {
            // Both fail when the child has ended already: then there is nothing to do.
            let _ = child.kill();
            let _ = child.wait();
        }
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
