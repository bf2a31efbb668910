//! `keygraph calibrate`: a camera's intrinsics and lens.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use keygraph::calibrate::{Calibrated, Kind, LEAST_VIEWS, MOST_VIEWS, View, calibrate};
use keygraph::input::{Picture, Source};
use keygraph::lens_file;
use keygraph::notice::is_quiet;
use keygraph::output::{Inputs, check_output, plain, plain_lines, print_line, tell_written, write_file};
use keygraph::progress::Progress;
use keygraph::report;
use keygraph::search::{Profile, Request, Shape, search_for};
use keygraph_core::{DEFAULT_THRESHOLD, Model};

use super::model_files::{expanded, load, parse};

/// Minimum distance of the corners of one view from those of any other, as a share of the frame's diagonal.
const APART: f32 = 0.04;
/// Share of the frame's half diagonal up to which places should be seen.
const FAR: f64 = 0.75;
/// Number of times that the views are looked at again through the lens so far.
const AGAIN: usize = 3;

/// Arguments of `keygraph calibrate`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Model of the picture that is shown: any trained picture, flat and stiff, of any size
    #[arg(short, long = "model", value_name = "MODEL.kgm", required = true)]
    models: Vec<PathBuf>,
    /// Pictures, folders of pictures or videos of it, taken with the camera: 10 to 20 views, tilted to each side,
    /// near and far, in the middle and in the corners of the frame
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Where the calibration goes: YAML as OpenCV reads it, for `detect --lens`
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// A fisheye lens: one that shows more than about 110 degrees
    #[arg(long)]
    fisheye: bool,
    /// Size that frames are searched at; larger ones are scaled down
    #[arg(long, value_enum, default_value = "hd")]
    profile: Profile,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A frame in which the picture was found.
struct Sighting {
    /// Number of the frame among all frames of the inputs.
    number: usize,
    /// Name of its input, and the number of the frame in it.
    name: String,
    corners: [[f32; 2]; 4],
    view: View,
}

/// Calibrates and writes the file.
///
/// # Errors
/// When a file cannot be read or written, when the picture is not seen often enough, or from too few sides.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let models = expanded(&arguments.models)?;
    let bytes = load(&models)?;
    let model = parse(&bytes, &models)?;
    check_output(&arguments.output, &Inputs::of(arguments.inputs.iter().chain(&models).map(PathBuf::as_path)))?;
    let kind = if arguments.fisheye { Kind::Fisheye } else { Kind::Brown };
    let request = Request { shape: Shape::Plane, matches: true, ..Request::new(arguments.profile, DEFAULT_THRESHOLD) };
    let mut size = None;
    let mut sightings: Vec<Sighting> = Vec::new();
    let mut frames = 0;
    let unread = each_frame(&arguments.inputs, "frames", true, |number, name, picture| {
        frames += 1;
        let own = [picture.width, picture.height];
        let known = *size.get_or_insert(own);
        ensure!(
            own == known,
            "{name} has {}x{} px, and the frames before have {}x{}: give frames of one camera at one size",
            own[0],
            own[1],
            known[0],
            known[1]
        );
        if let Some(sighting) = sight(picture, &model, &request, (number, name))? {
            take(&mut sightings, sighting, own);
        }
        Ok(())
    })?;
    let size = size.context("there is no frame in the inputs")?;
    if sightings.len() < LEAST_VIEWS {
        bail!(
            "the picture was found in {} of {frames} frames in views that differ, and {LEAST_VIEWS} are needed: show it flat and \
             stiff, lit evenly, from many sides",
            sightings.len()
        );
    }
    let views = |sightings: &[Sighting]| sightings.iter().map(|s| s.view.clone()).collect::<Vec<_>>();
    let mut found = calibrate(kind, &views(&sightings), size, None)?;
    let mut lost = Vec::new();
    for _ in 0..AGAIN {
        let request = Request { lens: Some(found.lens()?), ..request };
        let mut next = Vec::new();
        each_frame(&arguments.inputs, "frames through the lens", false, |number, name, picture| {
            if sightings.iter().any(|s| s.number == number) {
                match sight(picture, &model, &request, (number, name))? {
                    Some(sighting) => next.push(sighting),
                    None => lost.push(name.to_string()),
                }
            }
            Ok(())
        })?;
        sightings = next;
        found = calibrate(kind, &views(&sightings), size, Some(&found))?;
    }
    let text = lens_file::written(&found, size)?;
    write_file(&arguments.output, |file| Ok(file.write_all(text.as_bytes())?))?;
    tell(arguments, &sightings, &found, (frames, &lost))?;
    Ok(ExitCode::from(u8::from(unread > 0)))
}

/// Takes a view that differs from those that there are. When there are many, it takes the place of one that has
/// another near it, if it is farther from all.
fn take(sightings: &mut Vec<Sighting>, new: Sighting, size: [u32; 2]) {
    let nearest = |to: &Sighting, among: &[Sighting]| {
        let others = among.iter().filter(|s| s.number != to.number);
        others.map(|s| apart(&to.corners, &s.corners, size)).fold(f32::MAX, f32::min)
    };
    let far = nearest(&new, sightings);
    if far <= APART {
        return;
    }
    if sightings.len() < MOST_VIEWS {
        sightings.push(new);
        return;
    }
    let near: Vec<f32> = sightings.iter().map(|s| nearest(s, sightings)).collect();
    let closest = (0..near.len()).min_by(|&a, &b| near[a].total_cmp(&near[b]));
    if let Some(i) = closest.filter(|&i| near[i] < far) {
        sightings[i] = new;
    }
}

/// Calls `each` with every frame of the inputs: its number, its name and its picture. Returns how many cannot be read; why
/// is printed with `tells`.
fn each_frame(
    inputs: &[PathBuf],
    what: &'static str,
    tells: bool,
    mut each: impl FnMut(usize, &str, &Picture) -> Result<()>,
) -> Result<usize> {
    let source = Source::open(inputs)?;
    let progress = Progress::new(source.len_hint(), what);
    let (mut result, mut unread) = (Ok(()), 0);
    for (number, frame) in source.enumerate() {
        let name =
            if frame.frame > 0 { format!("{}, frame {}", frame.source, frame.frame) } else { frame.source.clone() };
        match frame.picture {
            Ok(picture) => result = each(number, &name, &picture),
            Err(e) => {
                unread += 1;
                if tells {
                    progress.error(&plain_lines(&format!("{e:#}")));
                }
            }
        }
        progress.tick();
        if result.is_err() {
            break;
        }
    }
    progress.finish();
    result.map(|()| unread)
}

/// The best view of a frame.
fn sight(
    picture: &Picture,
    model: &Model<'_>,
    request: &Request,
    (number, name): (usize, &str),
) -> Result<Option<Sighting>> {
    let found = search_for(picture, model, request, 0)?;
    let (Some(d), Some(matches)) = (found.detections.first(), found.matches.first()) else { return Ok(None) };
    let surface = found.surfaces.first().copied().flatten();
    if surface.is_some_and(|s| s.is_bent) {
        return Ok(None);
    }
    let object = model.object(usize::from(d.object));
    let homography = surface.map_or(d.homography, |s| s.homography);
    let view = View { homography, size: [object.width as f32, object.height as f32], matches: matches.clone() };
    Ok(Some(Sighting { number, name: name.into(), corners: d.corners, view }))
}

/// Mean distance of corners, as a share of the frame's diagonal.
fn apart(a: &[[f32; 2]; 4], b: &[[f32; 2]; 4], [width, height]: [u32; 2]) -> f32 {
    let sum: f32 = a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).sum();
    sum / 4.0 / (width as f32).hypot(height as f32)
}

/// Prints what was found.
fn tell(
    arguments: &Arguments,
    sightings: &[Sighting],
    found: &Calibrated,
    (frames, lost): (usize, &[String]),
) -> Result<()> {
    let names = found.kind.names();
    let used = found.views.iter().flatten().count();
    if arguments.json {
        let views = sightings.iter().map(|s| s.name.as_str());
        print_line(&report::calibration_object(found, frames, views).to_string())?;
        tell_written(&arguments.output);
        return Ok(());
    }
    if is_quiet() {
        return Ok(());
    }
    for (name, (value, sigma)) in names.iter().zip(found.numbers.iter().zip(&found.uncertainty)) {
        let digits = if name.starts_with(['f', 'c']) { 2 } else { 5 };
        // A coefficient that cannot be told from 0 is held there.
        let held = *value == 0.0 && *sigma == 0.0;
        print_line(&if held {
            format!("{name} held at 0")
        } else {
            format!("{name} {value:.digits$} +- {sigma:.digits$}")
        })?;
    }
    print_line(&format!(
        "{used} views of {frames} frames, places {:.2} px from where the camera shows them",
        found.error_px
    ))?;
    for (s, _) in sightings.iter().zip(&found.views).filter(|(_, error)| error.is_none()) {
        print_line(&format!("left out: {}, which shows too little or does not fit the others", plain(&s.name)))?;
    }
    for name in lost {
        print_line(&format!("left out: {}, in which the picture is not found through the lens", plain(name)))?;
    }
    if found.reach < FAR {
        print_line(&format!(
            "no view reaches beyond {:.0} % of the way to the frame's corners: the lens is guessed there; show the picture in them",
            100.0 * found.reach
        ))?;
    }
    tell_written(&arguments.output);
    Ok(())
}
