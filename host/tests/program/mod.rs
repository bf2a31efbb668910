//! What the tests of the program share: how it is run, and the files that it reads.
//!
//! In: arguments, standard input, maps of a picture into a frame. Out: the results of a run,
//! temporary folders, rendered frames.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, SystemTime};

use image::RgbImage;
use keygraph::annotate::Canvas;
use keygraph::input::read_picture;
use keygraph::random::Random;
use keygraph::render::{Exposure, Print, Scene};
use keygraph_core::Homography;
use serde_json::Value;

// ------------------------------------------------------------------- running

/// The result of a run.
pub struct Run {
    pub status: i32,
    pub out: String,
    pub err: String,
}

/// Runs the program with `arguments`, and `input` on its standard input, in `folder`.
pub fn run_in<S: AsRef<OsStr>>(folder: &Path, arguments: &[S], input: &[u8]) -> Run {
    let mut child = Command::new(env!("CARGO_BIN_EXE_keygraph"))
        .current_dir(folder)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let output = thread::scope(|scope| {
        // A program that refuses its input closes the pipe; the error of the write is ignored.
        scope.spawn(move || drop(stdin.write_all(input)));
        child.wait_with_output().unwrap()
    });
    Run {
        status: output.status.code().expect("ended by a signal"),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs the program with `arguments` in the folder of temporary files.
pub fn keygraph<S: AsRef<OsStr>>(arguments: &[S]) -> Run {
    run_in(&std::env::temp_dir(), arguments, b"")
}

impl Run {
    #[track_caller]
    pub fn ended_with(self, status: i32) -> Self {
        assert_eq!(self.status, status, "exit status; standard error:\n{}\nstandard output:\n{}", self.err, self.out);
        self
    }

    /// Asserts that the run failed with status 1, printed nothing on standard output, and said
    /// all of `words` on standard error.
    #[track_caller]
    pub fn refused_with(self, words: &[&str]) -> Self {
        let run = self.ended_with(1);
        assert_eq!(run.out, "", "standard output of a run that is refused");
        run.said(words)
    }

    /// Asserts that the run said all of `words` on standard error.
    #[track_caller]
    pub fn said(self, words: &[&str]) -> Self {
        for word in words {
            assert!(self.err.contains(word), "{word:?} is not in standard error:\n{}", self.err);
        }
        assert!(!self.err.contains("panicked"), "a panic:\n{}", self.err);
        self
    }

    /// The one JSON object on standard output.
    #[track_caller]
    pub fn object(&self) -> Value {
        let value: Value = serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e} in\n{}", self.out));
        assert!(value.is_object(), "no object: {value}");
        value
    }

    /// The lines on standard output; each must be JSON.
    #[track_caller]
    pub fn lines(&self) -> Vec<Value> {
        let line = |l: &str| serde_json::from_str(l).unwrap_or_else(|e| panic!("{e} in the line\n{l}"));
        self.out.lines().map(line).collect()
    }
}

/// The numbers of a JSON array of `N`.
#[track_caller]
pub fn numbers<const N: usize>(v: &Value) -> [f64; N] {
    let all: Vec<f64> = v.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    all.try_into().unwrap_or_else(|_| panic!("not {N} numbers: {v}"))
}

/// Whether a JSON value is a time in UTC as in RFC 3339, to the millisecond, of this day or so.
pub fn is_stamp(v: &Value) -> bool {
    let shape = |c: char| if c.is_ascii_digit() { '0' } else { c };
    let text = v.as_str().unwrap_or_default();
    let time = humantime::parse_rfc3339(text);
    let near = |time: SystemTime| time.elapsed().is_ok_and(|past| past < Duration::from_secs(3600));
    text.chars().map(shape).eq("0000-00-00T00:00:00.000Z".chars()) && time.is_ok_and(near)
}

/// Whether there is an ffmpeg to do `what`. Prints a line that cargo does not hide when there is none.
pub fn has_ffmpeg(what: &str) -> bool {
    if Command::new("ffmpeg").arg("-version").output().is_ok() {
        return true;
    }
    assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no ffmpeg, and nothing may be skipped");
    let _ = writeln!(std::io::stderr(), "SKIPPED: no ffmpeg to {what}");
    false
}

// --------------------------------------------------------------------- files

/// An empty folder; it is removed with its content when dropped.
pub struct Folder(pub PathBuf);

impl Folder {
    /// Makes the folder. Tests that run side by side may use the same `name`.
    pub fn new(name: &str) -> Self {
        static MADE: AtomicUsize = AtomicUsize::new(0);
        let (test, made) = (env!("CARGO_CRATE_NAME"), MADE.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(format!("keygraph-{test}-{}-{made}-{name}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.join(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// The names of the files in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(&self.0).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

pub fn assets() -> PathBuf {
    fs::canonicalize(Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets")).unwrap()
}

pub fn picture(name: &str) -> PathBuf {
    assets().join("pictures").join(name).with_extension("jpg")
}

pub fn frame(index: u32) -> PathBuf {
    assets().join("sequence").join(format!("{index:04}.jpg"))
}

pub fn pixels(path: &Path) -> RgbImage {
    image::open(path).unwrap().into_rgb8()
}

// -------------------------------------------------------------------- frames

/// A projective map in row order.
pub type Map = [f64; 9];

/// An exposure that does not change the scene: full light, no blur, no noise.
pub const CLEAR: Exposure = Exposure { gain: 1.0, blur_px: 0.0, noise: 0.0 };

/// Writes a frame of `width` x `height` px that shows a picture of the repository before dead
/// leaves. `map` is the map from picture px to frame px.
pub fn photograph(name: &str, map: &Map, (width, height): (usize, usize), exposure: &Exposure, frame: &Path) {
    let mut random = Random::new(1);
    let mut scene = Scene::dead_leaves(width, height, &mut random);
    scene.lay_at(&Print::new(&read_picture(&picture(name)).unwrap()), &Homography(map.map(|v| v as f32)));
    Canvas::from_picture(&scene.expose(exposure, &mut random)).save(frame).unwrap();
}
