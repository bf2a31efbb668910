//! Writes annotated frames.
//!
//! In: canvases in the order of the frames. Out: pictures in a folder, one picture, or a
//! video; the path given to `--annotate` decides. Memory: the names of the files written.
//! Cost: encoding.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use crate::canvas::Canvas;
use crate::input::Kind;
use crate::output::{Inputs, check_output};
use crate::picture::{EXTENSIONS, extension};
use crate::video::VideoWriter;

const VIDEOS: [&str; 6] = ["mp4", "m4v", "mov", "mkv", "avi", "webm"];
/// Frame rate of a video that is made of stills.
const STILLS_FPS: (u32, u32) = (10, 1);

/// The place for annotated frames.
#[derive(Debug)]
pub struct Gallery {
    target: Target,
    /// The inputs, which must not be overwritten.
    inputs: Inputs,
    written: HashSet<PathBuf>,
    video: Option<Running>,
}

#[derive(Debug)]
enum Target {
    Folder(PathBuf),
    Picture(PathBuf),
    Video(PathBuf),
}

#[derive(Debug)]
struct Running {
    source: String,
    path: PathBuf,
    size: (u32, u32),
    writer: VideoWriter,
}

impl Gallery {
    /// Makes a gallery; the extension of `path` decides what it writes. Without one, or with
    /// a slash at the end, it makes a folder. No file of `inputs` will be overwritten.
    ///
    /// # Errors
    /// When the extension is not known, the folder cannot be made, or the file would
    /// overwrite an input.
    pub fn new(path: &Path, inputs: Inputs) -> Result<Self> {
        let is_folder = path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/");
        let target = match extension(path).as_str() {
            e if is_folder || e.is_empty() => {
                fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))?;
                Target::Folder(path.into())
            }
            e if VIDEOS.contains(&e) => Target::Video(path.into()),
            e if EXTENSIONS.contains(&e) => Target::Picture(path.into()),
            e => bail!(
                "--annotate {} ends with .{e}, which is not known: give a picture (.{}), a video (.{}), or a folder: \
                 a name without an extension, or with / at its end",
                path.display(),
                EXTENSIONS.join(", ."),
                VIDEOS.join(", .")
            ),
        };
        let gallery = Self { target, inputs, written: HashSet::new(), video: None };
        if let Target::Video(file) | Target::Picture(file) = &gallery.target {
            gallery.refuse_input(file)?;
            check_output(file, &gallery.inputs)?;
        }
        Ok(gallery)
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// When the frame cannot be written, would overwrite an input, or does not fit the frames
    /// before it.
    pub fn add(&mut self, source: &str, kind: Kind, canvas: &Canvas) -> Result<()> {
        let fps = match kind {
            Kind::Video { fps } => Some(fps),
            Kind::Still => None,
        };
        match (&self.target, fps) {
            (Target::Video(path), _) => {
                let path = path.clone();
                self.add_to_video("", &path, source, fps.unwrap_or(STILLS_FPS), canvas)
            }
            (Target::Picture(path), None) => {
                let path = path.clone();
                ensure!(
                    self.written.is_empty(),
                    "--annotate {} takes one picture and there are more: give a folder",
                    path.display()
                );
                self.save(path, canvas)
            }
            (Target::Picture(path), Some(_)) => {
                bail!("--annotate {} is a picture and {source} a video: give a folder or a .mp4 file", path.display())
            }
            (Target::Folder(folder), Some(fps)) => {
                let name = if source == "-" { "stdin".into() } else { stem(source) };
                let path = folder.join(format!("{name}.mp4"));
                let path = if self.video.as_ref().is_some_and(|v| v.source == source) { path } else { self.free(path) };
                self.add_to_video(source, &path, source, fps, canvas)
            }
            (Target::Folder(folder), None) => {
                let name = Path::new(source).file_name().unwrap_or_default();
                let mut path = folder.join(name);
                if !EXTENSIONS.contains(&extension(Path::new(name)).as_str()) {
                    path = path.with_extension("png");
                }
                let path = self.free(path);
                self.save(path, canvas)
            }
        }
    }

    /// `path`, with a number added when this run has written it already.
    fn free(&self, path: PathBuf) -> PathBuf {
        let numbered = |n: usize| {
            let extension = path.extension().unwrap_or_default().to_string_lossy();
            path.with_file_name(format!("{}-{n}.{extension}", stem(&path.to_string_lossy())))
        };
        if !self.written.contains(&path) {
            return path;
        }
        (2..).map(numbered).find(|p| !self.written.contains(p)).unwrap_or(path)
    }

    fn save(&mut self, path: PathBuf, canvas: &Canvas) -> Result<()> {
        self.refuse_input(&path)?;
        canvas.save(&path)?;
        self.written.insert(path);
        Ok(())
    }

    fn add_to_video(&mut self, key: &str, path: &Path, source: &str, fps: (u32, u32), canvas: &Canvas) -> Result<()> {
        if self.video.as_ref().is_some_and(|v| v.source != key) {
            self.finish_video()?;
        }
        let size = (canvas.width(), canvas.height());
        if self.video.is_none() {
            self.refuse_input(path)?;
            self.written.insert(path.into());
            let writer = VideoWriter::create(path, size.0, size.1, fps)?;
            self.video = Some(Running { source: key.into(), path: path.into(), size, writer });
        }
        let Some(v) = &mut self.video else { return Ok(()) };
        ensure!(
            v.size == size,
            "{source} is {}x{} and the video {} {}x{}: give a folder for frames of several sizes",
            size.0,
            size.1,
            v.path.display(),
            v.size.0,
            v.size.1
        );
        v.writer.write(canvas)
    }

    fn refuse_input(&self, path: &Path) -> Result<()> {
        ensure!(
            !self.inputs.contain(path),
            "--annotate would overwrite the input {}: give another folder",
            path.display()
        );
        Ok(())
    }

    fn finish_video(&mut self) -> Result<()> {
        self.video.take().map_or(Ok(()), |v| v.writer.finish())
    }

    /// Completes the video, if one is being written. Returns the number of files that were written.
    ///
    /// # Errors
    /// When a video cannot be finished.
    pub fn finish(mut self) -> Result<usize> {
        self.finish_video()?;
        Ok(self.written.len())
    }
}

fn stem(path: &str) -> String {
    Path::new(path).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
