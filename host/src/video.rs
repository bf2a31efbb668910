//! Writes pictures into a video file.
//!
//! In: [`Canvas`]es of one size. Out: an MP4, MKV, MOV, AVI or WebM file, made
//! by an `ffmpeg` child process that takes the raw RGB bytes on its standard
//! input. One frame at a time is held; [`VideoWriter::write`] waits while
//! ffmpeg is busy.

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ChildStdin;

use anyhow::{Context, Result, anyhow, bail, ensure};

use crate::canvas::Canvas;
use crate::ffmpeg::{CROP_TO_EVEN, Ffmpeg, file_argument};
use crate::output::Draft;
use crate::picture::extension;

/// A video that is being written. When it is dropped before
/// [`finish`](Self::finish), ffmpeg is stopped and nothing is left of the file.
#[derive(Debug)]
pub struct VideoWriter {
    name: String,
    width: u32,
    height: u32,
    /// The input of ffmpeg; `None` once ffmpeg has failed.
    pipe: Option<ChildStdin>,
    /// The program; `None` once it has failed.
    ffmpeg: Option<Ffmpeg>,
    /// The file. It comes after ffmpeg, which is stopped before the file is removed.
    draft: Draft,
}

impl VideoWriter {
    /// Starts a video of frames of `width` x `height` pixels. `fps` is frames per second
    /// as numerator and denominator. The extension chooses the format: H.264 for mp4, m4v,
    /// mkv and mov, MPEG-4 part 2 for avi, VP9 for webm. The last column or row of an odd
    /// size is left out. An existing file is replaced when the video is finished: it must not
    /// be the video that is being read.
    ///
    /// # Errors
    /// When the extension is none of these, the file cannot be written, or there is no ffmpeg.
    pub fn create(path: &Path, width: u32, height: u32, fps: (u32, u32)) -> Result<Self> {
        let name = path.display().to_string();
        ensure!(fps.0 > 0 && fps.1 > 0, "{name}: {}/{} is not a frame rate", fps.0, fps.1);
        let mut arguments: Vec<OsString> = [
            "-y",
            "-f",
            "rawvideo",
            "-pixel_format",
            "rgb24",
            "-video_size",
            &format!("{width}x{height}"),
            "-framerate",
            &format!("{}/{}", fps.0, fps.1),
            "-i",
            "pipe:0",
            "-vf",
            CROP_TO_EVEN,
        ]
        .map(OsString::from)
        .to_vec();
        let encoder = encoder_arguments(path)?;
        arguments.extend(encoder.iter().copied().map(OsString::from));
        arguments.extend(["-pix_fmt", "yuv420p"].map(OsString::from));
        let draft = Draft::new(path)?;
        arguments.push(file_argument(draft.path()));

        let mut ffmpeg = Ffmpeg::start(&arguments)?;
        Ok(Self { name, width, height, pipe: ffmpeg.input.take(), ffmpeg: Some(ffmpeg), draft })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// When the frame has another size than the video, or ffmpeg has failed. The error
    /// holds ffmpeg's messages; frames that are added after it fail too.
    pub fn write(&mut self, frame: &Canvas) -> Result<()> {
        ensure!(
            (frame.width(), frame.height()) == (self.width, self.height),
            "{}: a frame of {} x {} pixels does not fit a video of {} x {}",
            self.name,
            frame.width(),
            frame.height(),
            self.width,
            self.height
        );
        let Some(pipe) = &mut self.pipe else {
            bail!("{}: ffmpeg has failed before", self.name);
        };
        match pipe.write_all(frame.rgb()) {
            Ok(()) => Ok(()),
            // The pipe breaks when ffmpeg ends; its messages say why.
            Err(error) => {
                self.wait_for_ffmpeg()?;
                Err(anyhow!("{}: cannot write to ffmpeg: {error}", self.name))
            }
        }
    }

    /// Completes the file.
    ///
    /// # Errors
    /// When ffmpeg failed; the error holds its messages.
    pub fn finish(mut self) -> Result<()> {
        self.wait_for_ffmpeg()?;
        self.draft.finish()
    }

    fn wait_for_ffmpeg(&mut self) -> Result<()> {
        self.pipe = None;
        let Some(ffmpeg) = self.ffmpeg.take() else {
            bail!("{}: ffmpeg has failed before", self.name);
        };
        ffmpeg.finish().with_context(|| format!("cannot write the video {}", self.name))?;
        Ok(())
    }
}

/// The container and the encoder that the extension chooses. The unfinished file has another name.
fn encoder_arguments(path: &Path) -> Result<&'static [&'static str]> {
    match extension(path).as_str() {
        // The index at the front of the file lets a browser start playing.
        "mp4" | "m4v" => Ok(&["-f", "mp4", "-c:v", "libx264", "-movflags", "+faststart"]),
        "mov" => Ok(&["-f", "mov", "-c:v", "libx264", "-movflags", "+faststart"]),
        "mkv" => Ok(&["-f", "matroska", "-c:v", "libx264"]),
        "avi" => Ok(&["-f", "avi", "-c:v", "mpeg4", "-q:v", "3"]),
        "webm" => Ok(&[
            "-f",
            "webm",
            "-c:v",
            "libvpx-vp9",
            "-deadline",
            "realtime",
            "-cpu-used",
            "6",
            "-row-mt",
            "1",
            "-crf",
            "30",
            "-b:v",
            "0",
        ]),
        _ => bail!("cannot write {}: its name must end with .mp4, .m4v, .mkv, .mov, .avi or .webm", path.display()),
    }
}

// --------------------------------------------------------------------- tests

#[cfg(test)]
mod tests {
    use super::*;
    use crate::annotate::{Outline, draw_label, draw_outline};
    use crate::input::{Kind, Picture, Pixels, Source};
    use crate::scratch::{Folder, ffmpeg_makes};
    use std::fs;
    use std::os::unix::fs::symlink;

    fn gray_canvas(width: u32, height: u32) -> Canvas {
        Canvas::from_picture(&Picture {
            width,
            height,
            pixels: Pixels::Gray8(vec![128; width as usize * height as usize]),
        })
    }

    #[test]
    fn a_video_is_read_annotated_and_written_in_every_format() {
        let folder = Folder::new("round-trip");
        let original = folder.0.join("original.mp4");
        if !ffmpeg_makes("-f lavfi -i testsrc=size=160x120:rate=10:duration=1", &original) {
            return;
        }
        let outline = Outline {
            corners: [[30.0, 30.0], [130.0, 40.0], [120.0, 100.0], [40.0, 90.0]],
            surface: None,
            label: "test 1.00".into(),
            colour_index: 1,
        };
        for extension in ["mp4", "mkv", "mov", "avi", "webm"] {
            let copy = folder.0.join("copy").with_extension(extension);
            let mut writer = VideoWriter::create(&copy, 160, 120, (10, 1)).expect("starts");
            for frame in Source::open(std::slice::from_ref(&original)).expect("opens") {
                let mut canvas = Canvas::from_picture(&frame.picture.expect("a frame"));
                draw_outline(&mut canvas, &outline);
                draw_label(&mut canvas, &outline);
                writer.write(&canvas).expect("writes");
            }
            writer.finish().expect("finishes");
            let frames: Vec<_> = Source::open(&[copy]).expect("opens").collect();
            assert_eq!(frames.len(), 10, "{extension}");
            assert_eq!(frames[0].kind, Kind::Video { fps: (10, 1) }, "{extension}");
            let picture = frames[9].picture.as_ref().expect("a frame");
            // Red on the right side of the outline, where the test card has none.
            let canvas = Canvas::from_picture(picture);
            let at = 3 * (70 * 160 + 125);
            let [r, g, b] = [0, 1, 2].map(|c| i32::from(canvas.rgb()[at + c]));
            assert!(r > g + 60 && r > b + 60, "{extension}: {r} {g} {b}");
        }
    }

    #[test]
    fn odd_sizes_lose_a_row_and_a_column() {
        let folder = Folder::new("odd-writer");
        let path = folder.0.join("odd.mp4");
        let Ok(mut writer) = VideoWriter::create(&path, 33, 17, (25, 2)) else {
            return ffmpeg_is_missing();
        };
        writer.write(&gray_canvas(33, 17)).expect("writes");
        writer.finish().expect("finishes");
        let frame = Source::open(&[path]).expect("opens").next();
        let picture = frame.and_then(|f| f.picture.ok()).expect("a frame");
        assert_eq!((picture.width, picture.height), (32, 16));
    }

    #[test]
    fn ffmpegs_failure_is_told_in_its_own_words() {
        let folder = Folder::new("failing-writer");
        let path = folder.0.join("full.avi");
        symlink("/dev/full", &path).expect("links");
        let Ok(mut writer) = VideoWriter::create(&path, 640, 480, (25, 1)) else {
            return ffmpeg_is_missing();
        };
        // ffmpeg notices after some frames of noise; the pipe breaks some time later.
        let noise = (0..3 * 640 * 480_u32).map(|i| i.wrapping_mul(2_654_435_761).to_le_bytes()[3]).collect();
        let frame = Canvas::from_picture(&Picture { width: 640, height: 480, pixels: Pixels::Rgb8(noise) });
        let failed = (0..100).find_map(|_| writer.write(&frame).err());
        let error = failed.expect("cannot go on for ever");
        assert!(format!("{error:#}").contains("No space left on device"), "{error:#}");
        assert!(writer.write(&frame).is_err());
        assert!(writer.finish().is_err());
    }

    #[test]
    fn a_video_that_is_not_finished_leaves_the_one_before() {
        let folder = Folder::new("unfinished-writer");
        let path = folder.0.join("out.mp4");
        fs::write(&path, "old").expect("writes");
        let Ok(mut writer) = VideoWriter::create(&path, 64, 48, (25, 1)) else {
            return ffmpeg_is_missing();
        };
        writer.write(&gray_canvas(64, 48)).expect("writes");
        drop(writer);
        assert_eq!(fs::read(&path).expect("there"), b"old");
        assert_eq!(fs::read_dir(&folder.0).expect("lists").count(), 1, "an unfinished file was left");
        assert!(VideoWriter::create(&folder.0.join("no/out.mp4"), 64, 48, (25, 1)).is_err());
    }

    #[test]
    fn wrong_sizes_rates_and_names_are_refused() {
        let folder = Folder::new("refusing-writer");
        let create = |name: &str, fps| VideoWriter::create(&folder.0.join(name), 8, 8, fps);
        let error = create("a.gif", (25, 1)).expect_err("no gif").to_string();
        assert!(error.contains("must end with .mp4"), "{error}");
        assert!(create("a.mp4", (25, 0)).is_err());
        let Ok(mut writer) = create("a.mp4", (25, 1)) else {
            return ffmpeg_is_missing();
        };
        let error = writer.write(&gray_canvas(8, 9)).expect_err("one row more");
        assert!(error.to_string().contains("8 x 9"), "{error}");
    }

    fn ffmpeg_is_missing() {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no ffmpeg, and nothing may be skipped");
        let _ = writeln!(std::io::stderr(), "SKIPPED: cannot start ffmpeg to write a video");
    }
}
