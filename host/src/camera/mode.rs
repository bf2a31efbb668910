//! The modes of a camera: which one to ask for, and its bytes as a picture.
//!
//! In: the modes that the camera offers, and a wish; then the bytes of a frame. Out: the
//! mode to ask for; then a [`Picture`]. YUYV becomes I420, with the mean chroma of two
//! rows: detectors use chroma at half width and half height in any case.
//!
//! Memory: one frame. Cost: a pass over its bytes, or the decoding of a JPEG.

use std::fmt;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use image::{ImageFormat, load_from_memory_with_format};

use crate::input::{Picture, Pixels};
use crate::picture::flatten_onto_white;

/// The default size, px: that of the default profile.
const USUAL_SIZE: (u32, u32) = (640, 480);

/// A pixel format of cameras that this program reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// 4:2:2, packed: `Y0 U Y1 V`.
    Yuyv,
    /// One JPEG a frame.
    Mjpg,
    /// Luma alone.
    Grey,
}

impl Format {
    /// All formats. The first is preferred: it needs no decoding and has no artefacts.
    pub const ALL: [Self; 3] = [Self::Yuyv, Self::Mjpg, Self::Grey];

    /// The four characters of the format in V4L2.
    #[must_use]
    pub const fn fourcc(self) -> [u8; 4] {
        match self {
            Self::Yuyv => *b"YUYV",
            Self::Mjpg => *b"MJPG",
            Self::Grey => *b"GREY",
        }
    }

    /// The format with these four characters; `None` for a format that this program does not
    /// read.
    #[must_use]
    pub fn of(fourcc: [u8; 4]) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.fourcc() == fourcc)
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = |f: &Self| text.as_bytes().eq_ignore_ascii_case(&f.fourcc());
        let alias = |f: &Self| *f == Self::Mjpg && text.eq_ignore_ascii_case("mjpeg");
        let found = Self::ALL.into_iter().find(|f| named(f) || alias(f));
        found.ok_or_else(|| format!("{text} is none of the formats that are understood: YUYV, MJPG, GREY"))
    }
}

/// One mode of a camera: format, size and rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Pixel format.
    pub format: Format,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Maximum frames a second; 0 when the camera does not tell.
    pub fps: f64,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fourcc = self.format.fourcc();
        write!(f, "{} {}x{}", String::from_utf8_lossy(&fourcc), self.width, self.height)?;
        if self.fps > 0.0 { write!(f, ", {} frames/s", (self.fps * 100.0).round() / 100.0) } else { Ok(()) }
    }
}

/// The mode that the user wishes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// Width and height, px.
    pub size: Option<(u32, u32)>,
    /// Pixel format.
    pub format: Option<Format>,
    /// Frames per second.
    pub fps: Option<f64>,
}

/// Chooses the mode nearest to the wish: by size, then by rate (the highest without a
/// wish), then by the order of [`Format::ALL`]. `None` when no mode has the wished format.
#[must_use]
pub fn choose(modes: &[Mode], wish: &Wish) -> Option<Mode> {
    let (w, h) = wish.size.unwrap_or(USUAL_SIZE);
    let off = |m: &Mode| {
        let size = m.width.abs_diff(w) + m.height.abs_diff(h);
        // A mode that is faster than wished can be slowed down.
        (size, wish.fps.map_or(-m.fps, |fps| (fps - m.fps).max(0.0)), m.format)
    };
    let fit = modes.iter().filter(|m| wish.format.is_none_or(|f| f == m.format));
    fit.min_by(|a, b| {
        let (a, b) = (off(a), off(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
    })
    .copied()
}

/// The message for a camera of which [`choose`] takes no mode. `others` are the names of
/// formats that this program does not read.
#[must_use]
pub fn refusal(modes: &[Mode], others: &[String], wish: &Wish) -> String {
    let all: Vec<String> = modes.iter().map(ToString::to_string).chain(others.iter().cloned()).collect();
    let has = if all.is_empty() { "nothing".to_string() } else { all.join("; ") };
    match wish.format.filter(|_| !modes.is_empty()) {
        Some(format) => {
            let fourcc = format.fourcc();
            format!("this camera does not give {}: leave --format out; it has {has}", String::from_utf8_lossy(&fourcc))
        }
        None => format!(
            "this camera gives none of the formats that are understood (YUYV, MJPG, GREY): take another camera; it has {has}"
        ),
    }
}

/// A message about the part of a wish that the camera did not grant; `None` when it granted
/// all.
#[must_use]
pub fn ungranted(wish: &Wish, got: &Mode) -> Option<String> {
    let size = wish.size.filter(|&size| size != (got.width, got.height));
    // The intervals of cameras are whole microseconds or so: rates are rounded.
    let fps = wish.fps.filter(|&fps| got.fps > 0.0 && (got.fps - fps).abs() > 0.01 * fps);
    let asked = [size.map(|(w, h)| format!("{w}x{h}")), fps.map(|fps| format!("{fps} frames/s"))];
    let asked: Vec<String> = asked.into_iter().flatten().collect();
    (!asked.is_empty()).then(|| format!("this camera has no {} and gives {got}: see --list", asked.join(" at ")))
}

/// Converts the bytes of a frame to a picture; `stride` is the number of bytes from one row
/// of the buffer to the next.
///
/// # Errors
/// When the frame is incomplete or damaged. The next frame may be whole.
pub fn to_picture(mode: &Mode, stride: usize, bytes: &[u8]) -> Result<Picture> {
    let (w, h) = (mode.width as usize, mode.height as usize);
    let row_bytes = match mode.format {
        Format::Mjpg => {
            let image = load_from_memory_with_format(bytes, ImageFormat::Jpeg);
            let (picture, _) = flatten_onto_white(image.context("a damaged JPEG")?);
            return Ok(picture);
        }
        Format::Yuyv => 2 * w,
        Format::Grey => w,
    };
    let stride = stride.max(row_bytes);
    ensure!(
        h > 0 && bytes.len() >= stride * (h - 1) + row_bytes,
        "a frame of {} bytes is incomplete: {mode} has {}",
        bytes.len(),
        stride * h
    );
    let row = |y: usize| &bytes[y * stride..y * stride + row_bytes];
    let pixels = match mode.format {
        Format::Grey => Pixels::Gray8((0..h).flat_map(|y| row(y).iter().copied()).collect()),
        Format::Yuyv if w % 2 == 0 && h % 2 == 0 => Pixels::I420(yuyv_to_i420(w, h, row)),
        _ => bail!("{mode} has an odd side: ask for another with --size"),
    };
    Ok(Picture { width: mode.width, height: mode.height, pixels })
}

fn yuyv_to_i420<'a>(w: usize, h: usize, row: impl Fn(usize) -> &'a [u8]) -> Vec<u8> {
    let mut planes = Vec::with_capacity(w * h * 3 / 2);
    for y in 0..h {
        planes.extend(row(y).iter().step_by(2));
    }
    for channel in [1, 3] {
        for y in (0..h).step_by(2) {
            let samples = |y: usize| row(y).iter().skip(channel).step_by(4);
            planes.extend(samples(y).zip(samples(y + 1)).map(|(a, b)| a.midpoint(*b)));
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(format: Format, width: u32, height: u32, fps: f64) -> Mode {
        Mode { format, width, height, fps }
    }

    /// The modes of a common webcam.
    fn webcam() -> [Mode; 6] {
        [
            mode(Format::Yuyv, 1920, 1080, 5.0),
            mode(Format::Yuyv, 640, 480, 30.0),
            mode(Format::Yuyv, 320, 240, 30.0),
            mode(Format::Mjpg, 1920, 1080, 30.0),
            mode(Format::Mjpg, 640, 480, 30.0),
            mode(Format::Mjpg, 800, 600, 60.0),
        ]
    }

    #[test]
    fn the_nearest_size_counts_first_then_the_rate_then_the_format() {
        let [large_yuyv, usual, _, large_jpeg, ..] = webcam();
        assert_eq!(choose(&webcam(), &Wish::default()), Some(usual));
        let large = Wish { size: Some((1800, 1000)), ..Wish::default() };
        assert_eq!(choose(&webcam(), &large), Some(large_jpeg));
        assert_eq!(choose(&webcam(), &Wish { fps: Some(5.0), ..large }), Some(large_yuyv));
        assert_eq!(choose(&webcam(), &Wish { fps: Some(15.0), ..large }), Some(large_jpeg));
        assert_eq!(choose(&webcam(), &Wish { format: Some(Format::Grey), ..Wish::default() }), None);
        assert_eq!(choose(&[], &Wish::default()), None);
    }

    #[test]
    fn a_camera_that_will_not_do_says_what_it_has() {
        let says = |text: &str, words: &[&str]| {
            assert!(words.iter().all(|word| text.contains(word)), "{words:?} are not all in: {text}");
        };
        let gray = Wish { format: Some(Format::Grey), ..Wish::default() };
        says(&refusal(&webcam(), &[], &gray), &["does not give GREY", "--format", "YUYV 640x480, 30 frames/s"]);
        let others = ["H264".to_string(), "NV12".to_string()];
        says(&refusal(&[], &others, &gray), &["none of the formats", "another camera", "it has H264; NV12"]);
        says(&refusal(&[], &[], &Wish::default()), &["it has nothing"]);
    }

    #[test]
    fn what_was_not_granted_is_told() {
        let got = mode(Format::Yuyv, 640, 480, 30.0);
        let wish = |size, fps| Wish { size, fps, format: None };
        assert_eq!(ungranted(&Wish::default(), &got), None);
        assert_eq!(ungranted(&wish(Some((640, 480)), Some(29.97)), &got), None);
        let said = "this camera has no 1000x700 at 60 frames/s and gives YUYV 640x480, 30 frames/s: see --list";
        assert_eq!(ungranted(&wish(Some((1000, 700)), Some(60.0)), &got).as_deref(), Some(said));
        let said = "this camera has no 5 frames/s and gives YUYV 640x480, 30 frames/s: see --list";
        assert_eq!(ungranted(&wish(None, Some(5.0)), &got).as_deref(), Some(said));
        assert_eq!(ungranted(&wish(None, Some(5.0)), &Mode { fps: 0.0, ..got }), None, "it does not say its rate");
    }

    #[test]
    fn names_of_formats() {
        assert_eq!("yuyv".parse(), Ok(Format::Yuyv));
        assert_eq!("MJPEG".parse(), Ok(Format::Mjpg));
        assert!("H264".parse::<Format>().is_err_and(|e| e.contains("YUYV, MJPG, GREY")));
        assert_eq!(webcam()[1].to_string(), "YUYV 640x480, 30 frames/s");
    }

    #[test]
    fn yuyv_with_padded_rows() {
        // Two rows of two pixels and two bytes of padding.
        let bytes = [10, 100, 11, 200, 0, 0, 12, 102, 13, 210];
        let picture = to_picture(&mode(Format::Yuyv, 2, 2, 0.0), 6, &bytes).expect("converts");
        assert_eq!(picture.pixels, Pixels::I420(vec![10, 11, 12, 13, 101, 205]));
        let error = to_picture(&mode(Format::Yuyv, 2, 2, 0.0), 6, &bytes[..9]).expect_err("cut").to_string();
        assert!(error.contains("9 bytes is incomplete"), "{error}");
    }

    #[test]
    fn gray_stays_gray_and_a_damaged_jpeg_is_an_error() {
        let picture = to_picture(&mode(Format::Grey, 2, 1, 0.0), 0, &[7, 8, 9]).expect("converts");
        assert_eq!(picture.pixels, Pixels::Gray8(vec![7, 8]));
        assert!(to_picture(&mode(Format::Mjpg, 2, 1, 0.0), 0, &[0xFF, 0xD8, 0]).is_err());
    }
}
