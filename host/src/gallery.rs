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
use crate::picture::{EXTENSIONS, extension};
use crate::video::VideoWriter;

const VIDEOS: [&str; 6] = ["mp4", "m4v", "mov", "mkv", "avi", "webm"];
/// Frame rate of a video that is made of stills.
const STILLS_FPS: (u32, u32) = (10, 1);

/// The place for annotated frames.
#[derive(Debug)]
pub struct Gallery {
    target: Target,
    /// Resolved paths of the inputs, which must not be overwritten.
    inputs: HashSet<PathBuf>,
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
    /// Makes a gallery; the extension of `path` decides what it writes, and without one it
    /// makes a folder. No file of `inputs` will be overwritten, nor a file in a folder among
    /// them.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(path: &Path, inputs: &[PathBuf]) -> Result<Self> {
        let target = match extension(path).as_str() {
            _ if path.is_dir() => Target::Folder(path.into()),
            e if VIDEOS.contains(&e) => Target::Video(path.into()),
            e if EXTENSIONS.contains(&e) => Target::Picture(path.into()),
            _ => {
                fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))?;
                Target::Folder(path.into())
            }
        };
        let inputs = inputs.iter().filter_map(|i| fs::canonicalize(i).ok()).collect();
        Ok(Self { target, inputs, written: HashSet::new(), video: None })
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
        let is_input = fs::canonicalize(path)
            .is_ok_and(|p| self.inputs.contains(&p) || p.parent().is_some_and(|f| self.inputs.contains(f)));
        ensure!(!is_input, "--annotate would overwrite the input {}: give another folder", path.display());
        Ok(())
    }

    fn finish_video(&mut self) -> Result<()> {
        self.video.take().map_or(Ok(()), |v| v.writer.finish())
    }

    /// Completes the video, if one is being written.
    ///
    /// # Errors
    /// When a video cannot be finished.
    pub fn finish(mut self) -> Result<()> {
        self.finish_video()
    }
}

fn stem(path: &str) -> String {
    Path::new(path).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
