//! Cameras through V4L2.
//!
//! In: a request. Out: the camera's frames, put into the slot. A camera that is unplugged is
//! waited for. Every error says what to do about it.
//!
//! Memory: four buffers of the driver. Cost: one [`super::mode::to_picture`] a frame.

use std::fs;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use v4l::buffer::Type;
use v4l::capability::Flags;
use v4l::control::{Control, Value};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, FourCC};

use super::Captured;
use super::live::Live;
use super::mjpeg::to_jpeg;
use super::mode::{Format, Mode, Wish, choose, refusal, to_picture, ungranted};
use crate::input::Picture;

/// Maximum time without a frame. After it, the camera is opened again.
const SILENCE: Duration = Duration::from_secs(3);
/// Time between two attempts to open a camera that was unplugged.
const PAUSE: Duration = Duration::from_millis(500);
/// Time after which exposure and white balance have settled.
const SETTLING: Duration = Duration::from_secs(2);
/// Number of buffers that the driver fills. Fewer buffers lose frames; with more buffers,
/// frames arrive later.
const BUFFERS: u32 = 4;

/// Controls that make the exposure manual, and their values, as in `linux/v4l2-controls.h`:
/// manual exposure, constant frame rate, no automatic gain.
const EXPOSURE: [(u32, i64); 3] = [(0x009A_0901, 1), (0x009A_0903, 0), (0x0098_0912, 0)];
/// The control that makes the white balance manual, and its value.
const WHITE_BALANCE: [(u32, i64); 1] = [(0x0098_090C, 0)];

/// Which camera to open, and how.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Path or number of the camera; `None` takes the first that gives pictures.
    pub device: Option<String>,
    /// The wished size, format and rate.
    pub wish: Wish,
    /// Whether to keep exposure and gain as they are when they have settled.
    pub lock_exposure: bool,
    /// Whether to keep the white balance as it is when it has settled.
    pub lock_white_balance: bool,
}

/// The reason why a camera's frames ended.
enum End {
    /// The slot was closed: nobody wants frames.
    Closed,
    /// The camera was unplugged, or failed.
    Lost(anyhow::Error),
}

/// Puts frames into the slot until it is closed. Waits for a camera that is unplugged.
///
/// # Errors
/// When there is no camera at the start, or it cannot be used.
pub fn capture(request: &Request, live: &Live) -> Result<()> {
    let mut number = 0;
    let mut opened = false;
    loop {
        // The crate v4l panics on some answers of drivers.
        let session = || -> Result<End> {
            let path = find(request.device.as_deref())?;
            let device = open(&path)?;
            let (mode, stride) = set_up(&device, &path, request)?;
            give_frames(&device, &path, (&mode, stride), request, live, &mut number)
        };
        let end =
            catch_unwind(AssertUnwindSafe(session)).unwrap_or_else(|_| Err(anyhow!("the camera's driver failed")));
        let trouble = match end {
            Ok(End::Closed) => return Ok(()),
            Ok(End::Lost(error)) => error,
            Err(error) if !opened && number == 0 => return Err(error),
            Err(error) => error,
        };
        opened = true;
        let text = format!("{trouble:#}; waiting for it");
        let is_new = live.trouble().as_ref() != Some(&text);
        live.set_trouble(Some(text.clone()));
        if is_new {
            tracing::warn!("{text}");
        }
        if live.frames.is_closed() {
            return Ok(());
        }
        thread::sleep(PAUSE);
    }
}

fn give_frames(
    device: &Device,
    path: &Path,
    (mode, stride): (&Mode, usize),
    request: &Request,
    live: &Live,
    number: &mut u64,
) -> Result<End> {
    let name = path.display();
    let mut stream = Stream::with_buffers(device, Type::VideoCapture, BUFFERS)
        .map_err(|e| explain(e, path))
        .context("no buffers")?;
    stream.set_timeout(SILENCE);
    let start = Instant::now();
    let mut locked = !(request.lock_exposure || request.lock_white_balance);
    let mut first = true;
    let mut sequence = None;
    while !live.frames.is_closed() {
        let (bytes, about) = match stream.next() {
            Ok(frame) => frame,
            Err(e) if first => return Err(explain(e, path)),
            Err(e) => return Ok(End::Lost(explain(e, path))),
        };
        if first {
            tracing::info!("{name}: {mode}");
            live.set_trouble(None);
            first = false;
        }
        let at = Instant::now();
        // Frames are skipped when the driver had no free buffer.
        let skipped = sequence.replace(about.sequence).map_or(0, |before| skipped(before, about.sequence));
        live.frames.count_dropped(skipped);
        *number += skipped;
        let bytes = &bytes[..bytes.len().min(about.bytesused as usize)];
        match read_frame(mode, stride, bytes) {
            Ok((picture, jpeg)) => _ = live.frames.put(Captured { number: *number, at, picture, jpeg }),
            Err(error) => live.damage.note(format!("{name}, frame {number}"), &error),
        }
        *number += 1;
        if !locked && start.elapsed() > SETTLING {
            locked = true;
            if request.lock_exposure {
                lock(device, path, "exposure", &EXPOSURE);
            }
            if request.lock_white_balance {
                lock(device, path, "white balance", &WHITE_BALANCE);
            }
        }
    }
    Ok(End::Closed)
}

/// Number of frames between two sequence numbers of a driver; 0 when the driver does not
/// number frames.
fn skipped(before: u32, sequence: u32) -> u64 {
    sequence.saturating_sub(before).saturating_sub(1).into()
}

/// Decodes the bytes of a frame. Returns the picture, and the JPEG if the frame was one.
fn read_frame(mode: &Mode, stride: usize, bytes: &[u8]) -> Result<(Picture, Option<Vec<u8>>)> {
    let jpeg = (mode.format == Format::Mjpg).then(|| to_jpeg(bytes)).transpose()?;
    Ok((to_picture(mode, stride, jpeg.as_deref().unwrap_or(bytes))?, jpeg))
}

// ------------------------------------------------------------------- finding

/// The paths of all devices `/dev/video*`, sorted by number.
fn nodes() -> Vec<PathBuf> {
    let number = |path: &Path| path.file_name()?.to_str()?.strip_prefix("video")?.parse::<u32>().ok();
    let entries = fs::read_dir("/dev").into_iter().flatten().flatten();
    let mut found: Vec<_> = entries.filter_map(|e| Some((number(&e.path())?, e.path()))).collect();
    found.sort();
    found.into_iter().map(|(_, path)| path).collect()
}

fn find(wanted: Option<&str>) -> Result<PathBuf> {
    if let Some(wanted) = wanted {
        let is_number = wanted.bytes().all(|b| b.is_ascii_digit());
        let path = if is_number { format!("/dev/video{wanted}") } else { wanted.to_string() };
        return Ok(path.into());
    }
    let nodes = nodes();
    let mut refused = None;
    for node in &nodes {
        match open(node) {
            Ok(device) if gives_pictures(&device) => return Ok(node.clone()),
            Ok(_) => {}
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    Err(refused.unwrap_or_else(|| {
        if nodes.is_empty() {
            anyhow!("there is no camera: no /dev/video*; plug one in, or give --replay VIDEO")
        } else {
            anyhow!("none of the {} video devices gives pictures: see --list", nodes.len())
        }
    }))
}

fn open(path: &Path) -> Result<Device> {
    let device = Device::with_path(path).map_err(|e| explain(e, path))?;
    device.query_caps().map_err(|e| explain(e, path))?;
    Ok(device)
}

fn gives_pictures(device: &Device) -> bool {
    device.query_caps().is_ok_and(|c| c.capabilities.contains(Flags::VIDEO_CAPTURE | Flags::STREAMING))
}

/// Converts an error of the system to a message that says what to do.
fn explain(error: io::Error, path: &Path) -> anyhow::Error {
    const ENXIO: i32 = 6;
    const EIO: i32 = 5;
    const EBUSY: i32 = 16;
    const ENODEV: i32 = 19;
    const ENOTTY: i32 = 25;
    let path = path.display();
    match (error.kind(), error.raw_os_error()) {
        (_, Some(EBUSY)) => {
            anyhow!("{path} is in use by another program: close that (`fuser {path}` tells which)")
        }
        (io::ErrorKind::PermissionDenied, _) => {
            anyhow!("no permission to open {path}: `sudo usermod -aG video $USER`, then log in anew")
        }
        (io::ErrorKind::NotFound, _) => anyhow!("{path} is not there: plug the camera in, or see --list"),
        (_, Some(ENXIO | ENODEV | EIO)) => anyhow!("{path} was unplugged"),
        (_, Some(ENOTTY)) => anyhow!("{path} is no camera: see --list"),
        (io::ErrorKind::TimedOut, _) => {
            anyhow!("{path} gives no frames: unplug it and plug it in again, or ask for another --size or --format")
        }
        _ => anyhow!(error).context(path.to_string()),
    }
}

// -------------------------------------------------------------------- set up

/// All modes in formats that this program reads, and the names of the other formats.
fn modes(device: &Device) -> io::Result<(Vec<Mode>, Vec<String>)> {
    let (mut modes, mut others) = (Vec::new(), Vec::new());
    for description in device.enum_formats()? {
        let Some(format) = Format::of(description.fourcc.repr) else {
            others.push(description.fourcc.to_string());
            continue;
        };
        for size in device.enum_framesizes(description.fourcc)? {
            let sizes = match size.size {
                FrameSizeEnum::Discrete(d) => vec![(d.width, d.height)],
                FrameSizeEnum::Stepwise(s) => {
                    let within = |v: u32, min: u32, max: u32, step: u32| {
                        let v = v.clamp(min, max);
                        v - (v - min) % step.max(1)
                    };
                    let at = |w, h| {
                        (
                            within(w, s.min_width, s.max_width, s.step_width),
                            within(h, s.min_height, s.max_height, s.step_height),
                        )
                    };
                    vec![at(320, 240), at(640, 480), at(1280, 720), at(1920, 1080)]
                }
            };
            for (width, height) in sizes {
                modes.push(Mode { format, width, height, fps: most_fps(device, description.fourcc, width, height) });
            }
        }
    }
    Ok((modes, others))
}

/// The maximum rate of a mode, frames a second; 0 when the driver does not tell.
fn most_fps(device: &Device, fourcc: FourCC, width: u32, height: u32) -> f64 {
    let intervals = device.enum_frameintervals(fourcc, width, height).unwrap_or_default();
    let shortest = intervals.into_iter().map(|i| match i.interval {
        FrameIntervalEnum::Discrete(f) => f,
        FrameIntervalEnum::Stepwise(s) => s.min,
    });
    shortest.map(|f| f64::from(f.denominator) / f64::from(f.numerator.max(1))).fold(0.0, f64::max)
}

/// Asks for the mode nearest to the wish. Returns the mode that the camera granted, and the
/// bytes of a row.
fn set_up(device: &Device, path: &Path, request: &Request) -> Result<(Mode, usize)> {
    let name = path.display();
    ensure!(gives_pictures(device), "{name} gives no pictures: see --list");
    let (modes, others) = modes(device).map_err(|e| explain(e, path))?;
    let chosen = choose(&modes, &request.wish)
        .with_context(|| format!("{name}: {}", refusal(&modes, &others, &request.wish)))?;
    let fourcc = FourCC::new(&chosen.format.fourcc());
    let (width, height) = request.wish.size.unwrap_or((chosen.width, chosen.height));
    let got = device.set_format(&v4l::Format::new(width, height, fourcc)).map_err(|e| explain(e, path))?;
    ensure!(got.fourcc == fourcc, "{name} did not take the format {fourcc}: ask for another with --format");
    let mut fps = chosen.fps;
    let rate = request.wish.fps.map_or(chosen.fps, |f| if chosen.fps > 0.0 { f.min(chosen.fps) } else { f });
    if rate > 0.0 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a rate is at most 10,000")]
        let interval = v4l::Fraction::new(1000, (rate * 1000.0).round() as u32);
        // A camera whose rate cannot be set keeps its own.
        if let Ok(set) = device.set_params(&Parameters::new(interval)) {
            fps = f64::from(set.interval.denominator) / f64::from(set.interval.numerator.max(1));
        }
    }
    let granted = Mode { width: got.width, height: got.height, fps, ..chosen };
    if let Some(text) = ungranted(&request.wish, &granted) {
        tracing::warn!("{name}: {text}");
    }
    Ok((granted, got.stride as usize))
}

/// Makes controls manual, so that their last automatic values stay.
fn lock(device: &Device, path: &Path, name: &str, controls: &[(u32, i64)]) {
    let set = |&(id, value): &(u32, i64)| device.set_control(Control { id, value: Value::Integer(value) }).is_ok();
    // All controls are tried: a camera has some of them.
    if controls.iter().filter(|c| set(c)).count() > 0 {
        tracing::info!("{}: {name} locked", path.display());
    } else {
        tracing::warn!("{}: this camera's {name} cannot be locked", path.display());
    }
}

// ------------------------------------------------------------------- listing

/// Lines that describe all cameras and their modes.
///
/// # Errors
/// When there is no camera.
pub fn list() -> Result<Vec<String>> {
    let nodes = nodes();
    ensure!(!nodes.is_empty(), "there is no camera: no /dev/video*; plug one in");
    let mut lines = Vec::new();
    for path in nodes {
        let device = match open(&path) {
            Ok(device) => device,
            Err(error) => {
                lines.push(format!("{error:#}"));
                continue;
            }
        };
        let about = device.query_caps().map_err(|e| explain(e, &path))?;
        if !gives_pictures(&device) {
            lines.push(format!("{}  {}: gives no pictures", path.display(), about.card));
            continue;
        }
        lines.push(format!("{}  {} ({}, {})", path.display(), about.card, about.driver, about.bus));
        let (modes, others) = modes(&device).map_err(|e| explain(e, &path))?;
        let chosen = choose(&modes, &Wish::default());
        lines.extend(
            modes.iter().map(|m| format!("    {m}{}", if Some(*m) == chosen { "  (taken by itself)" } else { "" })),
        );
        if !others.is_empty() {
            lines.push(format!("    not understood: {}", others.join(" ")));
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_failure_of_a_device_says_what_to_do() {
        let path = Path::new("/dev/video7");
        let said = |error: io::Error| explain(error, path).to_string();
        let of = |code: i32| said(io::Error::from_raw_os_error(code));
        for (text, words) in [
            (of(16), "in use by another program"),
            (of(13), "sudo usermod -aG video $USER"),
            (of(1), "sudo usermod -aG video $USER"),
            (of(2), "is not there: plug the camera in"),
            (of(19), "was unplugged"),
            (of(6), "was unplugged"),
            (of(5), "was unplugged"),
            (of(25), "is no camera: see --list"),
            (said(io::ErrorKind::TimedOut.into()), "gives no frames"),
        ] {
            assert!(text.contains("/dev/video7") && text.contains(words), "{words:?} is not in: {text}");
        }
        // All other errors keep the words of the system.
        assert!(format!("{:#}", explain(io::Error::from_raw_os_error(12), path)).contains("memory"));
    }

    #[test]
    fn frames_that_the_driver_skipped() {
        assert_eq!([(0, 1), (0, 0), (7, 10), (9, 3)].map(|(a, b)| skipped(a, b)), [0, 0, 2, 0]);
        assert_eq!(skipped(u32::MAX, 0), 0, "numbers start anew");
    }

    #[test]
    fn a_device_is_named_by_number_or_path() {
        let found = |wanted: &str| find(Some(wanted)).expect("named");
        assert_eq!(found("3"), Path::new("/dev/video3"));
        assert_eq!(found("/dev/v4l/by-id/usb-1"), Path::new("/dev/v4l/by-id/usb-1"));
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let refused = |path: &str, words: &str| {
            let error = format!("{:#}", open(Path::new(path)).err().expect("no camera"));
            assert!(error.contains(words), "{words:?} is not in: {error}");
        };
        refused("/dev/video999", "is not there");
        refused("/dev/null", "is no camera: see --list");
    }

    #[test]
    fn a_cut_frame_is_an_error_in_every_format() {
        let mode = |format| Mode { format, width: 16, height: 16, fps: 0.0 };
        for format in Format::ALL {
            let full = [0xFF, 0xD8].repeat(512);
            assert!(read_frame(&mode(format), 0, &full[..100]).is_err(), "{format:?}");
            assert_eq!(read_frame(&mode(format), 0, &full).is_ok(), format != Format::Mjpg, "{format:?}");
        }
    }
}
