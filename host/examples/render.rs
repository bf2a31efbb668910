//! Renders frames for other programs: one JSON line in, one frame and one JSON line out.
//!
//! `cargo run --release --example render -p keygraph < REQUESTS.jsonl`
//!
//! In, on standard input, a frame a line (here with every field; line breaks are not
//! allowed):
//!
//! ```json
//! {"out": "frame.jpg", "width": 640, "height": 480, "seed": 7,
//!  "background": "brick.jpg",
//!  "pictures": [{"path": "cover.jpg",
//!                "pose": {"side_px": 300, "rotation_deg": 30, "tilt_deg": 20, "axis_deg": 90,
//!                         "centre": [320, 240]},
//!                "homography": null,
//!                "hidden": {"share": 0.3, "by": "gravel.jpg"}}],
//!  "light": 1.0, "cast": [1.0, 1.0, 1.0], "blur_px": 0.6, "noise": 3.0, "quality": 90}
//! ```
//!
//! - `out`: the file to write, .jpg (`quality` of 1 to 100) or .png.
//! - `seed`: chooses what is not given: the place of a pose without `centre`, the part of
//!   the background, what hides a picture, and the noise.
//! - `background`: a picture; without it, dead leaves.
//! - `pictures`: laid one over the other, each where its `homography` (nine numbers, rows
//!   first, picture px to frame px) or its `pose` puts it. Fields of a pose: see
//!   [`keygraph::render::Pose`].
//! - `hidden`: the share of the picture that is hidden, and the picture that hides it.
//! - `light`: brightness as a part of the pictures' own; `cast`: factors of red, green and
//!   blue; `blur_px`, `noise`: spreads, see [`keygraph::render::Exposure`].
//!
//! All but `out`, `width`, `height`, `seed` and the `path` of a picture may be left out.
//! A pixel's centre has integer coordinates.
//!
//! Out, on standard output, a line for each frame, once the file is there:
//!
//! ```json
//! {"out": "frame.jpg", "pictures": [{"path": "cover.jpg", "homography": [1, 0, 0, 0, 1, 0, 0, 0, 1]}]}
//! ```
//!
//! The first line that cannot be rendered ends the program: its number and the reason go to
//! standard error, and the exit status is 1. The same line gives the same pixels on every
//! machine.
//!
//! Memory: each picture named is kept, at most 3 MB each. Cost: 80 ms a frame of
//! 640x480 px.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufWriter, Write, stdin, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::rc::Rc;

use anyhow::{Context, Result, bail, ensure};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use keygraph::annotate::Canvas;
use keygraph::input::{Picture, read_picture};
use keygraph::random::Random;
use keygraph::render::{Exposure, Pose, Print, Scene};
use keygraph_core::Homography;
use serde::{Deserialize, Serialize};

/// Sides of frames that are rendered, px.
const SIDES: std::ops::RangeInclusive<usize> = 64..=4096;
/// Largest tilt of a pose, degrees.
const MOST_TILT_DEG: f32 = 80.0;

/// A frame to be rendered.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    out: PathBuf,
    width: usize,
    height: usize,
    seed: u64,
    background: Option<PathBuf>,
    #[serde(default)]
    pictures: Vec<Shown>,
    #[serde(default = "one")]
    light: f32,
    #[serde(default = "white")]
    cast: [f32; 3],
    #[serde(default)]
    blur_px: f32,
    #[serde(default)]
    noise: f32,
    #[serde(default = "good")]
    quality: u8,
}

/// A picture in a frame.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Shown {
    path: PathBuf,
    pose: Option<Stand>,
    homography: Option<[f32; 9]>,
    hidden: Option<Hidden>,
}

/// A pose, perhaps without a place.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stand {
    side_px: f32,
    #[serde(default)]
    rotation_deg: f32,
    #[serde(default)]
    tilt_deg: f32,
    #[serde(default)]
    axis_deg: f32,
    centre: Option<[f32; 2]>,
}

/// What hides a part of a picture.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hidden {
    share: f32,
    by: PathBuf,
}

/// A frame that was rendered.
#[derive(Debug, Serialize)]
struct Rendered<'a> {
    out: &'a Path,
    pictures: Vec<Truth<'a>>,
}

/// Where a picture is in the frame.
#[derive(Debug, Serialize)]
struct Truth<'a> {
    path: &'a Path,
    homography: [f32; 9],
}

const fn one() -> f32 {
    1.0
}

const fn white() -> [f32; 3] {
    [1.0; 3]
}

const fn good() -> u8 {
    90
}

/// The pictures read so far.
type Prints = HashMap<PathBuf, Rc<Print>>;

fn main() -> ExitCode {
    let mut prints = Prints::new();
    for (at, line) in stdin().lock().lines().enumerate() {
        let rendered = line.context("standard input").and_then(|line| answer(&line, &mut prints));
        let told = rendered.and_then(|text| writeln!(stdout(), "{text}").context("standard output"));
        if let Err(error) = told {
            eprintln!("render: line {}: {error:#}", at + 1);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// Renders the frame of one line of JSON into its file; gives the line to print.
fn answer(line: &str, prints: &mut Prints) -> Result<String> {
    let request: Request = serde_json::from_str(line)?;
    check(&request)?;
    let (frame, homographies) = render(&request, prints)?;
    save(&frame, &request.out, request.quality)?;
    let shown = request.pictures.iter().zip(homographies);
    let pictures = shown.map(|(shown, h)| Truth { path: &shown.path, homography: h.0 }).collect();
    Ok(serde_json::to_string(&Rendered { out: &request.out, pictures })?)
}

/// Refuses numbers that no frame can be rendered with.
fn check(request: &Request) -> Result<()> {
    let sides = [request.width, request.height];
    ensure!(sides.iter().all(|s| SIDES.contains(s)), "width and height must be {SIDES:?} px, not {sides:?}");
    ensure!((1..=100).contains(&request.quality), "quality must be 1 to 100, not {}", request.quality);
    within("light", request.light, 0.0, 100.0)?;
    within("blur_px", request.blur_px, 0.0, 100.0)?;
    within("noise", request.noise, 0.0, 255.0)?;
    request.cast.iter().try_for_each(|&c| within("cast", c, 0.0, 100.0))?;
    for shown in &request.pictures {
        let name = shown.path.display();
        match (&shown.pose, &shown.homography) {
            (Some(pose), None) => {
                within("side_px", pose.side_px, 1.0, 100_000.0)?;
                within("tilt_deg", pose.tilt_deg, 0.0, MOST_TILT_DEG)?;
                within("rotation_deg", pose.rotation_deg, -3600.0, 3600.0)?;
                within("axis_deg", pose.axis_deg, -3600.0, 3600.0)?;
                pose.centre.iter().flatten().try_for_each(|&c| within("centre", c, -1e5, 1e5))?;
            }
            (None, Some(h)) => ensure!(
                h.iter().all(|v| v.is_finite()) && Homography(*h).inverse().is_some(),
                "the homography of {name} has no inverse"
            ),
            _ => bail!("{name} needs either a pose or a homography"),
        }
        if let Some(hidden) = &shown.hidden {
            within("share", hidden.share, 0.0, 1.0)?;
        }
    }
    Ok(())
}

fn within(name: &str, value: f32, low: f32, high: f32) -> Result<()> {
    ensure!((low..=high).contains(&value), "{name} must be {low} to {high}, not {value}");
    Ok(())
}

/// The frame, and for each picture the map from its px to the frame's.
fn render(request: &Request, prints: &mut Prints) -> Result<(Picture, Vec<Homography>)> {
    let mut random = Random::of(&[request.seed]);
    let (width, height) = (request.width, request.height);
    let mut scene = match &request.background {
        Some(path) => Scene::photograph(width, height, &*print(path, prints)?, &mut random),
        None => Scene::dead_leaves(width, height, &mut random),
    };
    let mut homographies = Vec::new();
    for shown in &request.pictures {
        let picture = print(&shown.path, prints)?;
        let h = match (&shown.pose, shown.homography) {
            (Some(stand), _) => pose(stand, &picture, &scene, &mut random).homography(picture.size(), scene.focal_px()),
            (None, Some(h)) => Homography(h),
            (None, None) => bail!("{} has no place", shown.path.display()),
        };
        scene.lay_at(&picture, &h);
        if let Some(hidden) = &shown.hidden {
            scene.hide(&picture, &h, hidden.share, &*print(&hidden.by, prints)?, &mut random);
        }
        homographies.push(h);
    }
    scene.tint(request.cast);
    let exposure = Exposure { gain: request.light, blur_px: request.blur_px, noise: request.noise };
    Ok((scene.expose(&exposure, &mut random), homographies))
}

/// The pose that is asked for; without a place, one that shows the whole picture.
fn pose(stand: &Stand, picture: &Print, scene: &Scene, random: &mut Random) -> Pose {
    let Stand { side_px, rotation_deg, tilt_deg, axis_deg, centre } = *stand;
    let pose = Pose { side_px, rotation_deg, tilt_deg, axis_deg, centre: centre.unwrap_or_default() };
    if centre.is_some() { pose } else { scene.somewhere(picture.size(), pose, random) }
}

/// The picture of a file, which is read once.
fn print(path: &Path, prints: &mut Prints) -> Result<Rc<Print>> {
    if let Some(known) = prints.get(path) {
        return Ok(Rc::clone(known));
    }
    let print = Rc::new(Print::new(&read_picture(path)?));
    prints.insert(path.to_path_buf(), Rc::clone(&print));
    Ok(print)
}

/// Writes a frame as JPEG of this quality or as PNG, as the extension says.
fn save(frame: &Picture, path: &Path, quality: u8) -> Result<()> {
    let canvas = Canvas::from_picture(frame);
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg") || e.eq_ignore_ascii_case("jpeg")) {
        return canvas.save(path);
    }
    let written = || -> Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        let encoder = JpegEncoder::new_with_quality(&mut file, quality);
        { encoder }.encode(canvas.rgb(), canvas.width(), canvas.height(), ExtendedColorType::Rgb8)?;
        Ok(file.flush()?)
    };
    written().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const ASTRONAUT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/pictures/astronaut.jpg");
    const BRICK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/pictures/brick.jpg");

    /// Renders into a file of this name; gives the answer and the frame.
    fn rendered(name: &str, fields: &str) -> Result<(serde_json::Value, Picture)> {
        let out = std::env::temp_dir().join(format!("keygraph-render-{}-{name}", std::process::id()));
        let line = format!(r#"{{"out": "{}", "width": 160, "height": 120, "seed": 3{fields}}}"#, out.display());
        let answer = answer(&line, &mut Prints::new())?;
        let frame = read_picture(&out)?;
        std::fs::remove_file(&out)?;
        Ok((serde_json::from_str(&answer)?, frame))
    }

    fn error(fields: &str) -> String {
        format!("{:#}", rendered("error.png", fields).unwrap_err())
    }

    #[test]
    fn every_field_counts() {
        let pose = format!(r#", "pictures": [{{"path": "{ASTRONAUT}", "pose": {{"side_px": 60}}}}]"#);
        let shown =
            |more: &str| format!(r#", "pictures": [{{"path": "{ASTRONAUT}", "pose": {{"side_px": 60{more}}}}}]"#);
        let hidden = format!(
            r#", "pictures": [{{"path": "{ASTRONAUT}", "pose": {{"side_px": 60}}, "hidden": {{"share": 0.3, "by": "{BRICK}"}}}}]"#
        );
        let (_, plain) = rendered("plain.png", &pose).unwrap();
        assert_eq!(rendered("again.png", &pose).unwrap().1, plain, "the same line, the same frame");
        let variants = [
            String::new(),
            hidden,
            shown(r#", "rotation_deg": 40"#),
            shown(r#", "tilt_deg": 40"#),
            shown(r#", "tilt_deg": 40, "axis_deg": 90"#),
            shown(r#", "centre": [40, 40]"#),
            format!(r#"{pose}, "background": "{BRICK}""#),
            format!(r#"{pose}, "light": 0.5"#),
            format!(r#"{pose}, "cast": [0.8, 1.0, 1.2]"#),
            format!(r#"{pose}, "blur_px": 2"#),
            format!(r#"{pose}, "noise": 5"#),
        ];
        let frames: Vec<Picture> = variants.iter().map(|v| rendered("variant.png", v).unwrap().1).collect();
        for (i, frame) in frames.iter().enumerate() {
            let others = frames.iter().skip(i + 1).chain([&plain]);
            assert!(others.into_iter().all(|o| o != frame), "{}", variants[i]);
        }
    }

    #[test]
    fn the_homography_is_told_as_it_was_given() {
        let given = [0.1, 0.0, 20.0, 0.0, 0.1, 30.0, 0.0, 0.0, 1.0];
        let fields = format!(r#", "pictures": [{{"path": "{ASTRONAUT}", "homography": {given:?}}}]"#);
        let (told, frame) = rendered("given.jpg", &fields).unwrap();
        assert_eq!(told["pictures"][0]["path"], ASTRONAUT);
        let numbers: Vec<f32> = serde_json::from_value(told["pictures"][0]["homography"].clone()).unwrap();
        assert_eq!(numbers, given);
        assert_eq!((frame.width, frame.height), (160, 120));
    }

    #[test]
    fn what_cannot_be_rendered_is_told() {
        let shown = |what: &str| error(&format!(r#", "pictures": [{{"path": "{ASTRONAUT}"{what}}}]"#));
        assert!(shown("").contains("needs either a pose or a homography"));
        assert!(shown(r#", "homography": [1, 0, 0, 1, 0, 0, 0, 0, 1]"#).contains("has no inverse"));
        assert!(shown(r#", "pose": {"side_px": 60, "tilt_deg": 85}"#).contains("tilt_deg must be 0 to 80, not 85"));
        assert!(shown(r#", "pose": {"side_px": 60}, "colour": 1"#).contains("unknown field `colour`"));
        assert!(error(r#", "quality": 0"#).contains("quality must be 1 to 100"));
        assert!(error(r#", "background": "nowhere.jpg""#).contains("nowhere.jpg: no such file"));
        assert!(answer("{", &mut Prints::new()).is_err());
    }
}
