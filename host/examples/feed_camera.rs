//! Plays a video or a folder of pictures into a device of `v4l2loopback`, as a camera.
//!
//! In: a device, a pixel format, frames of one size, and a rate. Out: the frames, written
//! to the device again and again until the program is stopped. Programs that read cameras
//! can read them.
//!
//! ```sh
//! sudo apt-get install v4l2loopback-dkms libclang-dev && sudo modprobe v4l2loopback
//! cargo run --release --features camera --example feed_camera -p keygraph -- /dev/video0 YUYV assets/sequence 25
//! keygraph camera --device 0 -m astronaut.kgm --web
//! ```
//!
//! The format is YUYV, MJPG, GREY or NV12. `CUT` as the last argument drops the second half
//! of every third frame, as a bad cable does.
//!
//! Memory: all frames in the format of the device. Cost: a copy a frame.

use std::io::Write;
use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use keygraph::annotate::Canvas;
use keygraph::input::{Picture, Source};
use keygraph::search::fit;
use keygraph::sensor::sense;
use keygraph_core::PixelFormat;
use v4l::video::Output;
use v4l::{Device, Format, FourCC};

/// Quality of the JPEGs, of 100.
const QUALITY: u8 = 90;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [device, format, input, rate, rest @ ..] = &arguments[..] else {
        bail!("give a device, a format, a video or a folder, and a rate: /dev/video0 YUYV assets/sequence 25");
    };
    let rate: f64 = rate.parse().ok().filter(|r| (0.1..=1000.0).contains(r)).context("a rate is 0.1 to 1000")?;
    let pictures: Vec<Picture> = Source::open(&[PathBuf::from(input)])?.map(|f| f.picture).collect::<Result<_>>()?;
    let first = pictures.first().context("there is no frame")?;
    let (width, height) = (first.width, first.height);
    let same = pictures.iter().all(|p| (p.width, p.height) == (width, height));
    ensure!(same, "all frames must have the size of the first, {width}x{height}");
    let frames: Vec<Vec<u8>> = pictures.iter().map(|p| encode(p, format)).collect::<Result<_>>()?;

    let mut camera = Device::with_path(device).with_context(|| format!("cannot open {device}"))?;
    let fourcc = FourCC::new(format.as_bytes().try_into().context("a format has four characters")?);
    let got = camera.set_format(&Format::new(width, height, fourcc))?;
    ensure!(
        (got.width, got.height, got.fourcc) == (width, height, fourcc),
        "{device} took {}x{} {} in place of {width}x{height} {fourcc}: is somebody reading from it?",
        got.width,
        got.height,
        got.fourcc
    );
    let cut = rest.first().is_some_and(|word| word == "CUT");
    println!("{} frames of {width}x{height} as {format}, {rate} a second", frames.len());
    let mut due = Instant::now();
    for (number, frame) in frames.iter().cycle().enumerate() {
        let length = if cut && number % 3 == 2 { frame.len() / 2 } else { frame.len() };
        let written = camera.write(&frame[..length]).with_context(|| format!("{device} takes no frame"))?;
        ensure!(written == length, "{device} took {written} of {length} bytes");
        due += Duration::from_secs_f64(1.0 / rate);
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    Ok(())
}

/// Encodes a picture in the format of the device.
fn encode(picture: &Picture, format: &str) -> Result<Vec<u8>> {
    let to = match format {
        "YUYV" => PixelFormat::Yuyv,
        "GREY" => PixelFormat::Gray8,
        "NV12" => PixelFormat::Nv12,
        "MJPG" => {
            let (canvas, mut jpeg) = (Canvas::from_picture(picture), Vec::new());
            let (w, h) = (canvas.width(), canvas.height());
            JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode(canvas.rgb(), w, h, ExtendedColorType::Rgb8)?;
            return Ok(jpeg);
        }
        _ => bail!("{format} is none of YUYV, MJPG, GREY, NV12"),
    };
    // Without a limit on the size, the picture is not scaled.
    let whole = fit(picture, usize::MAX, usize::MAX);
    Ok(sense(whole.format, (whole.width, whole.height), &whole.data, to).2)
}
