//! What tests with rendered frames share: the repository's pictures, a camera that
//! photographs one of them before another, and the program.
//!
//! In: a picture and a homography in double precision. Out: a frame of 640 x 480 px.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use image::{Rgb, RgbImage, imageops};
use serde_json::Value;

/// Width and height of a frame, px.
pub const FRAME: [u32; 2] = [640, 480];

/// Samples taken along each side of a frame pixel.
const SAMPLES: u32 = 3;

/// A projective map in row order.
pub type Map = [f64; 9];

pub fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pictures").join(name).with_extension("jpg")
}

pub fn pixels(name: &str) -> RgbImage {
    image::open(asset(name)).unwrap().into_rgb8()
}

/// An asset stretched over a frame.
pub fn background(name: &str) -> RgbImage {
    imageops::resize(&pixels(name), FRAME[0], FRAME[1], imageops::FilterType::Triangle)
}

pub fn apply(m: &Map, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = m[6] * x + m[7] * y + m[8];
    [(m[0] * x + m[1] * y + m[2]) / w, (m[3] * x + m[4] * y + m[5]) / w]
}

pub fn inverse(m: &Map) -> Map {
    let minor = |a: usize, b: usize, c: usize, d: usize| m[a] * m[d] - m[b] * m[c];
    let adjugate = [
        minor(4, 5, 7, 8),
        minor(2, 1, 8, 7),
        minor(1, 2, 4, 5),
        minor(5, 3, 8, 6),
        minor(0, 2, 6, 8),
        minor(2, 0, 5, 3),
        minor(3, 4, 6, 7),
        minor(1, 0, 7, 6),
        minor(0, 1, 3, 4),
    ];
    let det = m[0] * adjugate[0] + m[1] * adjugate[3] + m[2] * adjugate[6];
    adjugate.map(|v| v / det)
}

/// The picture before the background, where `map` (picture px to frame px) puts it.
pub fn photograph(picture: &RgbImage, map: &Map, background: &RgbImage) -> RgbImage {
    let back = inverse(map);
    let mut frame = background.clone();
    for (x, y, pixel) in frame.enumerate_pixels_mut() {
        let mut sum = [0.0; 3];
        for s in 0..SAMPLES * SAMPLES {
            let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(SAMPLES) - 0.5;
            let at = apply(&back, [f64::from(x) + offset(s % SAMPLES), f64::from(y) + offset(s / SAMPLES)]);
            let colour = interpolated(picture, at).unwrap_or(pixel.0.map(f64::from));
            (0..3).for_each(|c| sum[c] += colour[c]);
        }
        *pixel = Rgb(sum.map(|v| (v / f64::from(SAMPLES * SAMPLES)).round() as u8));
    }
    frame
}

/// Between the four nearest pixels; `None` outside of the picture.
fn interpolated(picture: &RgbImage, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let (w, h) = (f64::from(picture.width()), f64::from(picture.height()));
    if !(-0.5..w - 0.5).contains(&x) || !(-0.5..h - 0.5).contains(&y) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, w - 1.0), y.clamp(0.0, h - 1.0));
    let (left, top) = (x.floor() as u32, y.floor() as u32);
    let (right, bottom) = ((left + 1).min(picture.width() - 1), (top + 1).min(picture.height() - 1));
    let (fx, fy) = (x.fract(), y.fract());
    let value = |x, y, c: usize| f64::from(picture.get_pixel(x, y).0[c]);
    Some([0, 1, 2].map(|c| {
        let upper = value(left, top, c) * (1.0 - fx) + value(right, top, c) * fx;
        let lower = value(left, bottom, c) * (1.0 - fx) + value(right, bottom, c) * fx;
        upper * (1.0 - fy) + lower * fy
    }))
}

/// What a run of the program left behind.
pub struct Run {
    pub status: i32,
    pub out: String,
    pub err: String,
}

/// Runs the program.
pub fn keygraph<S: Into<OsString>>(arguments: impl IntoIterator<Item = S>) -> Run {
    let output =
        Command::new(env!("CARGO_BIN_EXE_keygraph")).args(arguments.into_iter().map(Into::into)).output().unwrap();
    Run {
        status: output.status.code().expect("ended by a signal"),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

impl Run {
    #[track_caller]
    pub fn ended_with(self, status: i32) -> Self {
        assert_eq!(self.status, status, "exit status; standard error:\n{}\nstandard output:\n{}", self.err, self.out);
        self
    }

    /// Said all of `words` on standard error.
    #[track_caller]
    pub fn said(self, words: &[&str]) -> Self {
        for word in words {
            assert!(self.err.contains(word), "{word:?} is not in standard error:\n{}", self.err);
        }
        self
    }

    /// Its lines of JSON.
    pub fn lines(&self) -> Vec<Value> {
        self.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    }
}

pub fn numbers<const N: usize>(v: &Value) -> [f64; N] {
    let all: Vec<f64> = v.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    all.try_into().unwrap_or_else(|_| panic!("not {N} numbers: {v}"))
}

/// An empty folder that is removed with all that is in it.
pub struct Folder(pub PathBuf);

impl Folder {
    /// `name` must be used by one test only.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("keygraph-studio-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
