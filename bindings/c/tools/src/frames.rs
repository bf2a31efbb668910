//! Frames for programs in C. In: pictures of the repository. Out: the files that the firmware reads, and
//! pictures as PPM.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use keygraph::learn::{Preset, train};
use keygraph::picture::{Pixels, read_picture};
use keygraph::search::{Profile, Request, prepare};
use keygraph_core::{DEFAULT_THRESHOLD, PixelFormat, Stage};
use serde_json::Value;

/// Picture of the sample's model, as in firmware-sim.
const SAMPLE: &str = "assets/pictures/astronaut.jpg";

/// Writes `model.kgm`, the sample, and `frames.bin`: for each frame three words (format, width, height)
/// and its bytes.
pub fn write(folder: &Path, profile: &str, frames: &[&str]) -> Result<()> {
    let profile = match profile {
        "qqvga" => Profile::Qqvga,
        "qvga" => Profile::Qvga,
        "vga" => Profile::Vga,
        _ => bail!("{profile} is no profile of a board"),
    };
    fs::create_dir_all(folder)?;
    let (model, _) = train(&read_picture(Path::new(SAMPLE))?, "astronaut", Preset::Compact, false)?;
    fs::write(folder.join("model.kgm"), model)?;
    let request = Request { format: Some(PixelFormat::Yuyv), ..Request::new(profile, DEFAULT_THRESHOLD) };
    let mut bytes = Vec::new();
    for name in frames {
        let picture = read_picture(Path::new(name))?;
        let scaled = prepare(&picture, &request)?;
        for word in [scaled.format as u32, u32::try_from(scaled.width)?, u32::try_from(scaled.height)?] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend_from_slice(&scaled.data);
    }
    Ok(fs::write(folder.join("frames.bin"), bytes)?)
}

/// Writes a picture as binary PPM, or PGM if it has no colour.
pub fn ppm(from: &Path, to: &Path) -> Result<()> {
    let picture = read_picture(from)?;
    let (kind, pixels) = match &picture.pixels {
        Pixels::Rgb8(pixels) => ("P6", pixels),
        Pixels::Gray8(pixels) => ("P5", pixels),
        Pixels::I420(_) => bail!("{}: this is a frame of a video", from.display()),
    };
    let mut bytes = format!("{kind}\n{} {}\n255\n", picture.width, picture.height).into_bytes();
    bytes.extend(pixels);
    Ok(fs::write(to, bytes)?)
}

/// What a firmware says of one frame: the digests of its stages, and how many objects it found.
#[derive(Debug, PartialEq)]
struct Told {
    digests: Vec<(String, String)>,
    found: usize,
}

/// Compares the lines of the firmware in C with the JSON lines of `scripts/board --digests`.
pub fn compare(c: &Path, rust: &Path) -> Result<()> {
    let read = |path: &Path| fs::read_to_string(path).with_context(|| path.display().to_string());
    let (c, rust) = (told_by_c(&read(c)?)?, told_by_rust(&read(rust)?)?);
    ensure!(!rust.is_empty(), "the firmware in Rust told nothing");
    ensure!(c.len() == rust.len(), "the firmware in C told of {} frames, that in Rust of {}", c.len(), rust.len());
    for (i, (c, rust)) in c.iter().zip(&rust).enumerate() {
        for (a, b) in c.digests.iter().zip(&rust.digests) {
            ensure!(a == b, "frame {i}: the stage {} differs first: {} in C, {} in Rust", a.0, a.1, b.1);
        }
        ensure!(c == rust, "frame {i}: {c:?} in C, {rust:?} in Rust");
        ensure!(c.digests.len() == Stage::COUNT, "frame {i} has {} digests", c.digests.len());
    }
    let found: usize = c.iter().map(|f| f.found).sum();
    ensure!(found > 0, "no frame shows the object: that proves little");
    println!("{} frames, {found} detections: every stage does the same in C and in Rust", c.len());
    Ok(())
}

/// Reads lines such as `frame 0`, `digest corners 0123abcd` and `found astronaut ...`.
fn told_by_c(text: &str) -> Result<Vec<Told>> {
    let mut frames: Vec<Told> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["frame", ..] => frames.push(Told { digests: Vec::new(), found: 0 }),
            ["digest", stage, value] => {
                let frame = frames.last_mut().context("a digest comes before its frame")?;
                frame.digests.push((stage.into(), value.into()));
            }
            ["found", ..] => frames.last_mut().context("a detection comes before its frame")?.found += 1,
            _ => {}
        }
    }
    Ok(frames)
}

fn told_by_rust(text: &str) -> Result<Vec<Told>> {
    let frame = |line: &str| {
        let line: Value = serde_json::from_str(line)?;
        let digest = |stage: &Stage| {
            let value = line["digests"][stage.name()].as_str().context("the line has no digests")?;
            Ok((stage.name().to_string(), value.to_string()))
        };
        let digests = Stage::ALL.iter().map(digest).collect::<Result<_>>()?;
        let found = line["detections"].as_array().context("the line has no detections")?.len();
        Ok(Told { digests, found })
    };
    text.lines().map(frame).collect()
}
