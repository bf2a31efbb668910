//! A video file, an address or standard input as frames in their order.
//!
//! In: a path, `-` or an address. Out: an iterator of frames, each a picture or an error. YUV4MPEG2 streams, and
//! JPEG and PNG pictures one after the other on standard input, are read here. Everything else goes through an
//! `ffmpeg` child process. It returns YUV4MPEG2 with 8-bit 4:2:0 samples at a constant frame rate, turned as
//! the video's rotation says.
//!
//! Memory: one frame. Cost: decoding.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use std::process::ChildStdout;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, ensure};
use tempfile::NamedTempFile;

use crate::content::{Content, START_BYTES, hide, is_live, is_rtsp, is_stdin, is_url, shown};
use crate::ffmpeg::{Ffmpeg, Patient, decoding_arguments, pump};
use crate::picture::{Picture, by_ffmpeg, decode};
use crate::pictures::Pictures;
use crate::unfinished::temporary;
use crate::yuv4mpeg::{UNKNOWN_FPS, Yuv4MpegReader};

/// Pauses before a camera is called again that broke off: the first and the longest.
const PAUSES: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(10)];

/// What ffmpeg says at the end of an answer without a length: -1, as a number without a sign.
const UNKNOWN_LENGTH: &str = "should be 18446744073709551615";

/// Maximum size of the first box of an MP4, bytes.
const MOST_START: usize = 4096;

type Bytes = Box<dyn Read + Send>;

/// How frames lie in a stream.
enum Frames {
    Planes(Yuv4MpegReader<Bytes>),
    Pictures(Pictures),
}

impl Frames {
    /// The next frame. The error within is that of one picture, behind which others come.
    fn next(&mut self) -> Result<Option<Result<Picture>>> {
        match self {
            Self::Planes(reader) => Ok(reader.next_frame()?.map(Ok)),
            Self::Pictures(pictures) => Ok(pictures.next()?.map(|bytes| Ok(decode(&bytes)?.0))),
        }
    }
}

/// A video or a stream that is being read, directly or through ffmpeg.
pub(crate) struct Stream {
    path: PathBuf,
    next_frame: u64,
    fps: (u32, u32),
    /// Whether nobody may wait before a frame is taken: the stream has its own pace.
    pub(crate) live: bool,
    /// Whether it is one picture, and no video. Known when the first frame was read.
    pub(crate) still: bool,
    /// `None` after the last frame.
    frames: Option<Frames>,
    ffmpeg: Option<Ffmpeg>,
    /// Standard input as a file, where it can be read from a file alone.
    spooled: Option<NamedTempFile>,
    /// The pause before the next try to reach a camera that broke off. `None`: it is not tried again.
    again: Option<Duration>,
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stream")
            .field("path", &shown(&self.path))
            .field("next_frame", &self.next_frame)
            .finish_non_exhaustive()
    }
}

impl Stream {
    /// Opens a video, an address or standard input. A camera at an `rtsp` address that breaks off is called
    /// again, for as long as it takes, when `reconnect` is set.
    ///
    /// # Errors
    /// When it cannot be opened, or does not start as a video does.
    pub(crate) fn open(path: &Path, reconnect: bool) -> Result<Self> {
        let mut stream = Self {
            path: path.to_path_buf(),
            next_frame: 0,
            fps: UNKNOWN_FPS,
            live: is_live(path),
            still: false,
            frames: None,
            ffmpeg: None,
            spooled: None,
            again: (reconnect && is_rtsp(path)).then_some(PAUSES[0]),
        };
        stream.start()?;
        Ok(stream)
    }

    /// Starts to read.
    fn start(&mut self) -> Result<()> {
        let path = self.path.clone();
        if is_stdin(&path) {
            return self.start_stdin().context("standard input");
        }
        let name = shown(&path);
        if Content::of(&path) == Content::Yuv4Mpeg {
            let file = File::open(&path).with_context(|| format!("cannot open {name}"))?;
            return self.start_planes(Box::new(file)).context(name);
        }
        let output = self.start_ffmpeg(&path)?;
        // A camera at an address may stop to send without an end.
        let output: Bytes = if is_url(&path) { Box::new(Patient::new(output)) } else { Box::new(output) };
        self.start_planes(output).context(name)
    }

    /// Starts to read standard input as what its first bytes say that it is.
    fn start_stdin(&mut self) -> Result<()> {
        let mut start = Vec::new();
        io::stdin().take(START_BYTES as u64).read_to_end(&mut start).context("cannot be read")?;
        ensure!(!start.is_empty(), "is empty; give a picture or a video");
        let content = Content::told_by(&start);
        let is_file = is_only_a_file(&mut start)?;
        let whole = Cursor::new(start).chain(io::stdin());
        match content {
            Content::Yuv4Mpeg => self.start_planes(Box::new(whole)),
            Content::Picture => {
                // Such a stream has no rate: its frames come when they were taken.
                self.live = true;
                self.frames = Some(Frames::Pictures(Pictures::new(whole)));
                Ok(())
            }
            Content::Foreign | Content::Other if is_file => self.start_spooled(whole, content),
            Content::Foreign | Content::Other => {
                let output = self.start_ffmpeg(&self.path.clone())?;
                let input = self.ffmpeg.as_mut().and_then(|ffmpeg| ffmpeg.input.take());
                pump(whole, input.context("ffmpeg has no input")?);
                self.start_planes(Box::new(output)).context("it is neither a picture nor a video that is known")
            }
        }
    }

    /// Writes what can be read from a file alone into a temporary one, and starts to read that.
    fn start_spooled(&mut self, mut whole: impl Read, content: Content) -> Result<()> {
        let mut file = temporary().context("cannot be kept in a temporary file")?;
        io::copy(&mut whole, &mut file).context("cannot be kept in a temporary file")?;
        if content == Content::Foreign {
            let png = by_ffmpeg(&fs::read(file.path())?)?;
            self.frames = Some(Frames::Pictures(Pictures::new(Cursor::new(png))));
            return Ok(());
        }
        let output = self.start_ffmpeg(file.path())?;
        self.spooled = Some(file);
        self.start_planes(Box::new(output))
    }

    /// Starts ffmpeg, and returns its output.
    fn start_ffmpeg(&mut self, path: &Path) -> Result<ChildStdout> {
        let mut ffmpeg = Ffmpeg::start(&decoding_arguments(path))?;
        let output = ffmpeg.output.take().context("ffmpeg has no output");
        self.ffmpeg = Some(ffmpeg);
        output
    }

    fn start_planes(&mut self, bytes: Bytes) -> Result<()> {
        match Yuv4MpegReader::new(bytes) {
            Ok(frames) => {
                self.fps = frames.fps;
                self.frames = Some(Frames::Planes(frames));
                Ok(())
            }
            // Without a header, ffmpeg's message says more than ours.
            Err(error) => {
                self.finish_ffmpeg(Some(&error))?;
                Err(error)
            }
        }
    }

    /// Frames per second as numerator and denominator; 25/1 if unknown.
    pub(crate) fn fps(&self) -> (u32, u32) {
        self.fps
    }

    /// Waits for the end of ffmpeg, unless it is ended because it was silent for too long. Returns its
    /// messages, none without it.
    fn finish_ffmpeg(&mut self, error: Option<&Error>) -> Result<String> {
        let is_silence = |cause: &(dyn std::error::Error + 'static)| {
            cause.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::TimedOut)
        };
        if error.is_some_and(|error| error.chain().any(is_silence)) {
            self.ffmpeg = None;
        }
        let hidden = |text: String| match &self.spooled {
            Some(file) => text.replace(&*file.path().to_string_lossy(), "-"),
            None => hide(&self.path, &text),
        };
        match self.ffmpeg.take().map(Ffmpeg::finish) {
            Some(Ok(messages)) => Ok(hidden(messages)),
            Some(Err(error)) => Err(anyhow!(hidden(format!("{error:#}")))),
            None => Ok(String::new()),
        }
    }

    /// Reads the next frame. After the last frame, checks whether ffmpeg reported errors.
    fn next_picture(&mut self) -> Option<Result<Picture>> {
        let (first, frames) = (self.next_frame == 0, self.frames.as_mut()?);
        let error = match frames.next() {
            Ok(Some(picture)) => {
                self.again = self.again.map(|_| PAUSES[0]);
                if let Frames::Pictures(pictures) = frames
                    && first
                {
                    self.still = pictures.is_at_end();
                }
                return Some(picture);
            }
            Ok(None) if first => Some(anyhow!("the video has no frames")),
            // A camera has no end: it was switched off, or its network was.
            Ok(None) => self.again.map(|_| anyhow!("the camera ended the stream; it is called again")),
            Err(error) => Some(error),
        };
        // The pipe is closed before the wait: ffmpeg may still want to write.
        self.frames = None;
        let complaint = match self.finish_ffmpeg(error.as_ref()) {
            // An answer of a server that does not tell its length has no end that ffmpeg expects.
            Ok(messages) if messages.contains(UNKNOWN_LENGTH) => None,
            Ok(messages) if !messages.is_empty() => {
                Some(anyhow!("frames may be missing or damaged, ffmpeg says: {messages}"))
            }
            Ok(_) => None,
            Err(error) => Some(error),
        };
        complaint.or(error).map(Err)
    }

    /// Calls a camera again that broke off. `None` when that is not wanted, else whether it could be reached.
    fn call_again(&mut self) -> Option<Result<()>> {
        let pause = self.again?;
        thread::sleep(pause);
        self.again = Some((pause * 2).min(PAUSES[1]));
        Some(self.start())
    }
}

/// Whether standard input, which starts so, has to be a file to be read: a GIF, and an MP4 (ISO/IEC 14496-12) whose
/// index comes last. Reads on to where an MP4 tells.
fn is_only_a_file(start: &mut Vec<u8>) -> Result<bool> {
    let Some((&size, b"ftyp")) =
        start.split_first_chunk().map(|(size, rest)| (size, rest.get(..4).unwrap_or_default()))
    else {
        return Ok(start.starts_with(b"GIF8"));
    };
    // The size and the name of the box behind the first one.
    let wanted = (u32::from_be_bytes(size) as usize).clamp(START_BYTES, MOST_START) + 8;
    io::stdin().take((wanted - start.len()) as u64).read_to_end(start).context("cannot be read")?;
    Ok(!start.ends_with(b"moov"))
}

impl Iterator for Stream {
    /// The index of a frame, and the frame or why it could not be read.
    type Item = (u64, Result<Picture>);

    fn next(&mut self) -> Option<Self::Item> {
        let reached = if self.frames.is_none() { self.call_again()? } else { Ok(()) };
        let frame = self.next_frame;
        // What is no frame has the number of the next one.
        let is_tried_again = reached.is_err();
        let picture = match reached {
            Ok(()) => self.next_picture()?.with_context(|| format!("{}, frame {frame}", shown(&self.path))),
            Err(error) => Err(anyhow!("{error:#}; it is tried again")),
        };
        self.next_frame += u64::from(!is_tried_again);
        Some((frame, picture))
    }
}
