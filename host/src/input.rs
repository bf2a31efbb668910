//! Pictures, folders, videos and streams as one sequence of frames.
//!
//! In: the INPUT arguments of the command line. Each is a picture, a folder of pictures and videos, a video file,
//! an address such as `rtsp://camera/stream`, or `-` for standard input. Out: an
//! iterator of [`SourceFrame`]: the input's name, the index of the frame in it, and either
//! a [`Picture`] or an error. An input that cannot be read does not stop the inputs after
//! it.
//!
//! Memory: one frame, or one picture and its file, at a time. Cost: decoding.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow, bail, ensure};

use crate::content::{is_named_picture, is_named_video, scheme};
pub use crate::content::{is_stdin, is_url, is_video, shown};
pub use crate::picture::{Picture, Pixels, read_picture};
use crate::stream::Stream;
use crate::yuv4mpeg::UNKNOWN_FPS;

/// The kind of input that a frame is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A picture.
    Still,
    /// A frame of a video.
    Video {
        /// Frames per second as numerator and denominator; 25/1 if unknown.
        fps: (u32, u32),
    },
}

/// One frame of one input.
#[derive(Debug)]
pub struct SourceFrame {
    /// The path as given; for a file of a folder, the folder joined with the file's name.
    pub source: String,
    /// Index in the video, from 0; 0 for pictures.
    pub frame: u64,
    /// Picture or video.
    pub kind: Kind,
    /// Whether frames have their own pace: those of an address, or of a stream without a rate.
    pub live: bool,
    /// The time at which a frame of a live source came; `None` for a picture or a video.
    pub time: Option<SystemTime>,
    /// The picture, or why it could not be read.
    pub picture: Result<Picture>,
}

/// A frame, or a picture that is not decoded yet.
#[derive(Debug)]
pub enum Pending {
    /// A picture on disk.
    Still(PathBuf),
    /// A frame that is decoded, or an error.
    Frame(SourceFrame),
}

impl Pending {
    /// The source, the index and the kind of the frame.
    #[must_use]
    pub fn place(&self) -> (String, u64, Kind) {
        match self {
            Self::Frame(f) => (f.source.clone(), f.frame, f.kind),
            Self::Still(path) => (path.display().to_string(), 0, Kind::Still),
        }
    }

    /// The time at which the frame came; see [`SourceFrame::time`].
    #[must_use]
    pub fn time(&self) -> Option<SystemTime> {
        match self {
            Self::Frame(f) => f.time,
            Self::Still(_) => None,
        }
    }

    /// The frame. Decodes the picture when that is not done yet.
    #[must_use]
    pub fn read(self) -> SourceFrame {
        let (source, frame, kind) = self.place();
        match self {
            Self::Frame(frame) => frame,
            Self::Still(path) => {
                SourceFrame { source, frame, kind, live: false, time: None, picture: read_picture(&path) }
            }
        }
    }
}

// ---------------------------------------------------------------- the inputs

/// How inputs are listed and read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading {
    /// Folders in folders are read too.
    pub recursive: bool,
    /// A camera at an `rtsp` address that breaks off is called again, for as long as it takes.
    pub reconnect: bool,
}

/// All frames of all inputs, in the order given.
///
/// A picture yields one item. A video yields one item a frame, and one more with an error
/// when it breaks off, when ffmpeg reported an error, or when it has no frames. A path that
/// does not exist and a folder without pictures and videos yield an error at their place in the order.
#[derive(Debug)]
pub struct Source {
    waiting: VecDeque<Input>,
    /// The video that is being read.
    video: Option<(String, Stream)>,
    len: Option<u64>,
    left_out: Vec<LeftOut>,
    reading: Reading,
}

/// What of a folder is not read.
#[derive(Debug)]
pub struct LeftOut {
    /// The folder.
    pub folder: PathBuf,
    /// Files that are neither pictures nor videos, by their names.
    pub files: Vec<PathBuf>,
    /// Number of folders in it.
    pub folders: usize,
}

#[derive(Debug)]
enum Input {
    Still(PathBuf),
    Video(PathBuf),
    Unreadable(PathBuf, anyhow::Error),
}

impl Source {
    /// Lists the inputs, and the files of those that are folders. Decodes nothing.
    ///
    /// # Errors
    /// When `inputs` is empty; never else.
    pub fn open(inputs: &[PathBuf]) -> Result<Self> {
        Self::open_as(inputs, Reading::default())
    }

    /// As [`Source::open`], with a choice of how inputs are read.
    ///
    /// # Errors
    /// When `inputs` is empty; never else.
    pub fn open_as(inputs: &[PathBuf], reading: Reading) -> Result<Self> {
        ensure!(!inputs.is_empty(), "no input: give a picture, a folder, a video, an address, or - for standard input");
        let (mut waiting, mut left_out) = (VecDeque::new(), Vec::new());
        for path in inputs {
            if !path.is_dir() {
                waiting.push_back(classify(path));
                continue;
            }
            match files_in(path, reading.recursive, &mut left_out) {
                Ok(files) => waiting.extend(files),
                Err(error) => waiting.push_back(Input::Unreadable(path.clone(), error)),
            }
        }
        let any_video = waiting.iter().any(|i| matches!(i, Input::Video(_)));
        let len = (!any_video).then_some(waiting.len() as u64);
        Ok(Self { waiting, video: None, len, left_out, reading })
    }

    /// The number of items; `None` when there is a video among the inputs.
    #[must_use]
    pub fn len_hint(&self) -> Option<u64> {
        self.len
    }

    /// What of the folders is not read.
    #[must_use]
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// The next frame. A picture is not decoded: [`Pending::read`] does that.
    pub fn next_pending(&mut self) -> Option<Pending> {
        loop {
            if let Some((source, video)) = &mut self.video {
                if let Some((frame, picture)) = video.next() {
                    let kind = if video.still { Kind::Still } else { Kind::Video { fps: video.fps() } };
                    let (source, live) = (source.clone(), video.live);
                    let time = (live && !video.still).then(SystemTime::now);
                    return Some(Pending::Frame(SourceFrame { source, frame, kind, live, time, picture }));
                }
                self.video = None;
            }
            let (path, kind, picture) = match self.waiting.pop_front()? {
                Input::Still(path) => return Some(Pending::Still(path)),
                Input::Unreadable(path, error) => (path, Kind::Still, Err(error)),
                Input::Video(path) => match Stream::open(&path, self.reading.reconnect) {
                    Ok(video) => {
                        self.video = Some((shown(&path), video));
                        continue;
                    }
                    Err(error) => (path, Kind::Video { fps: UNKNOWN_FPS }, Err(error)),
                },
            };
            let source = shown(&path);
            return Some(Pending::Frame(SourceFrame { source, frame: 0, kind, live: false, time: None, picture }));
        }
    }
}

impl Iterator for Source {
    type Item = SourceFrame;

    fn next(&mut self) -> Option<SourceFrame> {
        self.next_pending().map(Pending::read)
    }
}

fn classify(path: &Path) -> Input {
    let path = path.to_path_buf();
    match scheme(&path) {
        Some(scheme) if !is_url(&path) && !path.exists() => {
            let error = anyhow!("{}: addresses start with rtsp, rtsps, http or https, not {scheme}", shown(&path));
            Input::Unreadable(path, error)
        }
        _ if !is_stdin(&path) && !is_url(&path) && !path.exists() => {
            let error = anyhow!("{}: no such file or folder", path.display());
            Input::Unreadable(path, error)
        }
        _ if is_video(&path) => Input::Video(path),
        _ => Input::Still(path),
    }
}

/// The pictures and videos of a folder, sorted by path, without hidden files. What is neither is put into `left_out`.
fn files_in(folder: &Path, recursive: bool, left_out: &mut Vec<LeftOut>) -> Result<Vec<Input>> {
    let mut files = Vec::new();
    let mut waiting = vec![folder.to_path_buf()];
    let (mut unlisted, mut is_inner) = (Vec::new(), false);
    while let Some(folder) = waiting.pop() {
        let unreadable = || format!("cannot list the folder {}", folder.display());
        let mut left = LeftOut { folder: folder.clone(), files: Vec::new(), folders: 0 };
        // A folder within that cannot be listed is reported in its place.
        let entries: Result<Vec<_>, _> = fs::read_dir(&folder).and_then(Iterator::collect);
        let entries = match entries.with_context(unreadable) {
            Err(error) if is_inner => {
                unlisted.push(Input::Unreadable(folder, error));
                continue;
            }
            entries => entries?,
        };
        is_inner = true;
        for entry in entries {
            let path = entry.path();
            if entry.file_name().as_encoded_bytes().starts_with(b".") {
                continue;
            }
            if path.is_dir() {
                // A link to a folder could lead back to this one.
                match recursive && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                    true => waiting.push(path),
                    false => left.folders += usize::from(!recursive),
                }
            } else if (is_named_picture(&path) || is_named_video(&path))
                // A pipe or a device could make the search wait for ever. A broken link is reported later.
                && !fs::metadata(&path).is_ok_and(|found| !found.is_file())
            {
                files.push(path);
            } else {
                left.files.push(path);
            }
        }
        left.files.sort();
        if left.folders > 0 || !left.files.is_empty() {
            left_out.push(left);
        }
    }
    if files.is_empty() && unlisted.is_empty() {
        bail!("the folder {} has no pictures and no videos in it", folder.display());
    }
    files.sort();
    let files = files.into_iter().map(|path| if is_video(&path) { Input::Video(path) } else { Input::Still(path) });
    Ok(files.chain(unlisted).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::tests::png;
    use crate::scratch::{Folder, assert_says, ffmpeg_makes, message};
    use image::ExtendedColorType;

    // inputs

    #[test]
    fn a_folder_gives_its_pictures_by_name() {
        let folder = Folder::new("by-name");
        let picture = png(1, &[0], ExtendedColorType::L8);
        for name in ["b.PNG", "a.jpeg", "c.Jpg", ".hidden.png", "notes.txt"] {
            fs::write(folder.0.join(name), &picture).expect("writes");
        }
        fs::create_dir(folder.0.join("d.png")).expect("a folder inside");
        let source = Source::open(std::slice::from_ref(&folder.0)).expect("opens");
        assert_eq!(source.len_hint(), Some(3));
        let frames: Vec<_> = source.collect();
        let names: Vec<_> = frames.iter().map(|f| f.source.clone()).collect();
        let expected = ["a.jpeg", "b.PNG", "c.Jpg"].map(|n| folder.0.join(n).display().to_string());
        assert_eq!(names, expected);
        // The content counts, not the extension.
        assert!(frames.iter().all(|f| f.picture.is_ok() && f.kind == Kind::Still));
    }

    #[test]
    fn what_cannot_be_read_does_not_stop_the_rest() {
        let folder = Folder::new("rest");
        let good = folder.0.join("picture-without-extension");
        fs::write(&good, png(1, &[0], ExtendedColorType::L8)).expect("writes");
        let empty = folder.0.join("empty");
        fs::create_dir(&empty).expect("a folder inside");
        let text = folder.0.join("text.png");
        fs::write(&text, "text").expect("writes");
        let inputs = [folder.0.join("missing.mp4"), empty, text, good];
        let source = Source::open(&inputs).expect("opens");
        assert_eq!(source.len_hint(), Some(4));
        let messages: Vec<_> = source.map(|f| message(f.picture)).collect();
        let expected = ["no such file or folder", "has no pictures and no videos", "is not a PNG", "no error"];
        assert_eq!(messages.len(), 4);
        for (message, part) in messages.iter().zip(expected) {
            assert!(message.contains(part), "{part:?} is not in {message:?}");
        }
    }

    #[test]
    fn no_inputs_is_an_error() {
        assert_says(Source::open(&[]), "no input");
    }

    // YUV4MPEG2

    /// Reads all frames of a stream from a file.
    fn frames_of(name: &str, stream: &[u8]) -> Vec<SourceFrame> {
        let folder = Folder::new(name);
        let path = folder.0.join("stream");
        fs::write(&path, stream).expect("writes");
        let source = Source::open(&[path]).expect("opens");
        assert_eq!(source.len_hint(), None);
        source.collect()
    }

    #[test]
    fn frames_are_read_in_turn() {
        let stream = b"YUV4MPEG2 W2 H2 F30000:1001 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n\
                       FRAME\nabcdUVFRAME Ixyz\nefghuv";
        let frames = frames_of("in-turn", stream);
        let fps = (30000, 1001);
        assert_eq!(frames.len(), 2);
        for (index, (frame, expected)) in frames.into_iter().zip([b"abcdUV", b"efghuv"]).enumerate() {
            assert_eq!(frame.frame, index as u64);
            assert_eq!(frame.kind, Kind::Video { fps });
            let picture = frame.picture.expect("a frame");
            assert_eq!(picture.pixels, Pixels::I420(expected.to_vec()));
        }
    }

    #[test]
    fn a_cut_stream_gives_its_frames_and_then_an_error() {
        let stream = b"YUV4MPEG2 W2 H2\nFRAME\nabcdUVFRAME\nefg";
        let frames = frames_of("cut", stream);
        assert_eq!(frames.len(), 2);
        let [first, second] = frames.try_into().expect("two frames");
        assert!(first.picture.is_ok());
        assert_eq!(second.frame, 1);
        assert_says(second.picture, "frame 1: the stream ends inside the frame: 3 of 6 bytes");
    }

    #[test]
    fn a_damaged_stream_ends_with_an_error() {
        let frames = frames_of("damaged", b"YUV4MPEG2 W2 H2\nFRAME\nabcdUVnonsense");
        let errors: Vec<_> = frames.into_iter().map(|f| message(f.picture)).collect();
        assert_eq!(errors.len(), 2);
        assert!(errors[1].contains("the stream is damaged"), "{}", errors[1]);
        let frames = frames_of("frameless", b"YUV4MPEG2 W2 H2\n");
        let errors: Vec<_> = frames.into_iter().map(|f| message(f.picture)).collect();
        assert_eq!(errors.len(), 1);
        assert!(errors[0].contains("no frames"), "{}", errors[0]);
    }

    #[test]
    fn other_colour_spaces_become_420() {
        let gray = frames_of("mono", b"YUV4MPEG2 W3 H1 Cmono\nFRAME\nabc");
        let picture = gray.into_iter().next().and_then(|f| f.picture.ok());
        assert_eq!(picture.map(|p| p.pixels), Some(Pixels::Gray8(b"abc".to_vec())));

        // 4 x 2 pixels; a row of U in 4:2:2 has 2 samples, in 4:4:4 it has 4.
        let luma = [9; 8];
        let chroma_422 = [10, 20, 30, 41, 1, 2, 3, 4];
        let chroma_444 = [0, 4, 100, 100, 4, 8, 100, 103, 1, 1, 2, 2, 1, 1, 2, 2];
        for (name, chroma, expected) in
            [("422", &chroma_422[..], [20, 31, 2, 3]), ("444", &chroma_444[..], [4, 101, 1, 2])]
        {
            let mut stream = format!("YUV4MPEG2 W4 H2 C{name}\nFRAME\n").into_bytes();
            stream.extend(luma);
            stream.extend(chroma);
            let frame = frames_of(name, &stream).into_iter().next();
            let picture = frame.and_then(|f| f.picture.ok()).expect("a frame");
            assert_eq!(picture.pixels, Pixels::I420([&luma[..], &expected].concat()));
        }
    }

    // ffmpeg

    #[test]
    fn a_video_of_odd_size_is_cropped() {
        let folder = Folder::new("odd-video");
        // A colon and a blank in the name must not confuse ffmpeg.
        let path = folder.0.join("a: b.mkv");
        let arguments = "-f lavfi -i testsrc=size=65x49:rate=10:duration=1 -c:v ffv1";
        let plain = folder.0.join("plain.mkv");
        if !ffmpeg_makes(arguments, &plain) {
            return;
        }
        fs::rename(plain, &path).expect("renames");
        let frames: Vec<_> = Source::open(&[path]).expect("opens").collect();
        assert_eq!(frames.len(), 10);
        for (index, frame) in frames.into_iter().enumerate() {
            assert_eq!((frame.frame, frame.kind), (index as u64, Kind::Video { fps: (10, 1) }));
            let picture = frame.picture.expect("a frame");
            assert_eq!((picture.width, picture.height), (64, 48));
            let Pixels::I420(planes) = picture.pixels else {
                unreachable!("video is 4:2:0");
            };
            assert_eq!(planes.len(), 64 * 48 * 3 / 2);
        }
    }

    #[test]
    fn a_rotated_video_is_turned() {
        let folder = Folder::new("rotated");
        let flat = folder.0.join("flat.mp4");
        if !ffmpeg_makes("-f lavfi -i testsrc=size=64x48:rate=5:duration=1", &flat) {
            return;
        }
        // The transformation in the track header, in 1/65536, 40 bytes after
        // its name: a quarter turn instead of none.
        let mut file = fs::read(&flat).expect("reads");
        let name = file.windows(4).position(|w| w == b"tkhd").expect("a header");
        let turn: Vec<u8> = [0, 65536, 0, -65536, 0].iter().flat_map(|v: &i32| v.to_be_bytes()).collect();
        file[name + 4 + 40..][..turn.len()].copy_from_slice(&turn);
        let rotated = folder.0.join("rotated.mp4");
        fs::write(&rotated, file).expect("writes");
        let frame = Source::open(&[rotated]).expect("opens").next();
        let picture = frame.and_then(|f| f.picture.ok()).expect("a frame");
        assert_eq!((picture.width, picture.height), (48, 64));
    }

    #[test]
    fn ffmpegs_own_words_are_in_the_error() {
        let folder = Folder::new("own-words");
        let unused = folder.0.join("probe.mkv");
        if !ffmpeg_makes("-f lavfi -i testsrc=size=320x240:rate=10:duration=4 -c:v ffv1", &unused) {
            return;
        }
        let junk = folder.0.join("junk.mp4");
        fs::write(&junk, "no video").expect("writes");
        let cut = folder.0.join("cut.mkv");
        let whole = fs::read(&unused).expect("reads");
        fs::write(&cut, &whole[..whole.len() / 2]).expect("writes");
        let mut frames: Vec<_> = Source::open(&[junk, cut]).expect("opens").collect();
        assert!(frames.len() > 10, "the cut video has some frames");
        assert_says(frames.remove(0).picture, "Invalid data found");
        assert!(frames[0].picture.is_ok());
        let last = frames.pop().expect("a last frame");
        assert_says(last.picture, "ffmpeg says");
    }

    #[test]
    fn a_playlist_is_refused_whatever_its_name() {
        let folder = Folder::new("playlist");
        let secret = folder.0.join("secret.ts");
        if !ffmpeg_makes("-f lavfi -i testsrc=size=64x48:rate=5:duration=1", &secret) {
            return;
        }
        let hls = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nsecret.ts\n#EXT-X-ENDLIST\n";
        let concat = "ffconcat version 1.0\nfile secret.ts\n";
        for (name, list) in [("hls.mp4", hls), ("hls.m3u8", hls), ("concat.mkv", concat)] {
            let path = folder.0.join(name);
            fs::write(&path, list).expect("writes");
            let frames: Vec<_> = Source::open(&[path]).expect("opens").collect();
            assert_eq!(frames.len(), 1, "{name} shows other files");
            assert_says(frames.into_iter().next().expect("one").picture, "it is a playlist");
        }
        assert_eq!(Source::open(&[secret]).expect("opens").count(), 5, "the video itself is read");
    }

    #[test]
    fn dropping_a_video_ends_its_ffmpeg() {
        let folder = Folder::new("dropped");
        let path = folder.0.join("long.mkv");
        if !ffmpeg_makes("-f lavfi -i testsrc=size=320x240:rate=25:duration=8 -c:v mpeg4", &path) {
            return;
        }
        let mut source = Source::open(&[path]).expect("opens");
        assert!(source.next().is_some_and(|f| f.picture.is_ok()));
        // Waits for the child: would hang here if it was not killed.
        drop(source);
    }
}
