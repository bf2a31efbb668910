//! The whole path on the pictures of the repository.
//!
//! In: `assets/`. Out: a model and annotated frames in a folder, and a summary in words:
//! results are compared with the known poses of the rendered sequence. Memory: two models
//! and some frames. Cost: two trainings and 48 searches.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use keygraph_core::{DEFAULT_THRESHOLD, Detection, Homography, Model, Trained};
use serde_json::Value;

use crate::gallery::Gallery;
use crate::input::{Source, read_picture};
use crate::learn::{Preset, merge, train};
use crate::output::{Inputs, write_file};
use crate::progress::Progress;
use crate::render::{RIGHT, corner_error};
use crate::run::{Options, default_threads, run};
use crate::search::{Profile, Request};

/// The objects of the sequence. Each has a picture with its name.
pub const OBJECTS: [&str; 2] = ["astronaut", "coffee"];

/// The results for one object.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of frames that show the object.
    pub shown: usize,
    /// Number of frames in which the object was found at the right place.
    pub found: usize,
    /// Number of detections at a wrong place, or in frames that do not show the object.
    pub wrong: usize,
}

/// Trains on the picture of one of the [`OBJECTS`]. Returns the path of the picture, the
/// model and the report.
fn learn(assets: &Path, name: &str, preset: Preset) -> Result<(PathBuf, Vec<u8>, Trained)> {
    let path = assets.join("pictures").join(name).with_extension("jpg");
    let (model, trained) = train(&read_picture(&path)?, name, preset, false)?;
    Ok((path, model, trained))
}

/// The folder of frames, and one model of all [`OBJECTS`].
///
/// # Errors
/// When the assets cannot be read.
pub fn sample(assets: &Path, preset: Preset) -> Result<(PathBuf, Vec<u8>)> {
    let sequence = sequence(assets)?;
    let models = OBJECTS.iter().map(|name| Ok(learn(assets, name, preset)?.1)).collect::<Result<Vec<_>>>()?;
    Ok((sequence, merge(&models)?))
}

/// The folder of frames in `assets`.
fn sequence(assets: &Path) -> Result<PathBuf> {
    let sequence = assets.join("sequence");
    ensure!(
        sequence.is_dir(),
        "{} is not there: run this in the repository, or say where its assets are with --assets",
        sequence.display()
    );
    Ok(sequence)
}

/// Trains on the pictures in `assets`, searches the sequence, and writes the model and
/// annotated frames to `out`. Prints a summary.
///
/// # Errors
/// When the assets cannot be read, or `out` cannot be written.
pub fn demo(assets: &Path, out: &Path) -> Result<[Tally; 2]> {
    let sequence = sequence(assets)?;
    let frames = out.join("frames");
    fs::create_dir_all(&frames).with_context(|| format!("cannot make the folder {}", frames.display()))?;
    let packed = train_objects(assets)?;
    let model_path = out.join("demo.kgm");
    write_file(&model_path, |file| Ok(file.write_all(&packed)?))?;
    let tallies = search_sequence(&Model::parse(&packed)?, &sequence, &frames)?;
    for (name, t) in OBJECTS.iter().zip(&tallies) {
        println!(
            "  {name}: found in {} of the {} frames that show it; {} wrong.",
            t.found,
            t.shown,
            if t.wrong == 0 { "none".into() } else { t.wrong.to_string() }
        );
    }
    println!("Look at {}; the model is {}.", frames.display(), model_path.display());
    Ok(tallies)
}

/// Trains on all [`OBJECTS`] and merges their models. Prints a line an object.
fn train_objects(assets: &Path) -> Result<Vec<u8>> {
    let mut models = Vec::new();
    for name in OBJECTS {
        let (path, model, trained) = learn(assets, name, Preset::Large)?;
        println!(
            "Trained {name} from {}: {} keygraphs on {} keypoints, {:.1} MB.",
            path.display(),
            trained.keygraphs.kept,
            trained.view_keypoints.iter().map(|&n| u32::from(n)).sum::<u32>(),
            model.len() as f64 / 1e6
        );
        models.push(model);
    }
    merge(&models)
}

/// Searches the sequence, writes annotated frames, and compares the results with the true
/// poses. Prints the number of frames and the median time.
fn search_sequence(model: &Model<'_>, sequence: &Path, frames: &Path) -> Result<[Tally; 2]> {
    let truth = fs::read_to_string(sequence.join("truth.json")).context("the true poses of the sequence")?;
    let truth: Value = serde_json::from_str(&truth)?;
    let inputs = [sequence.to_path_buf()];
    let mut source = Source::open(&inputs)?;
    let progress = Progress::new(source.len_hint(), "frames");
    let mut gallery = Gallery::new(frames, Inputs::of(inputs.iter().map(PathBuf::as_path)))?;
    let options = Options {
        request: Request::new(Profile::Vga, DEFAULT_THRESHOLD),
        threads: default_threads(),
        track: false,
        annotate: true,
        rectify: false,
        optics: None,
        calibration: None,
    };
    let mut tallies = [Tally::default(); 2];
    let mut times = Vec::new();
    run(&mut source, model, &options, |outcome| {
        let searched = outcome.result?;
        for (o, tally) in tallies.iter_mut().enumerate() {
            let object = model.object(o);
            let map = true_pose(&truth[times.len()]["objects"][OBJECTS[o]]);
            let outline = map.map(|h| h.outline(object.width as f32, object.height as f32));
            let mine = searched.found.detections.iter().filter(|d| usize::from(d.object) == o);
            tally.count(mine, outline.as_ref());
        }
        times.push(searched.found.total_ns);
        if let Some(c) = &searched.canvas {
            gallery.add(&outcome.source, outcome.kind, c)?;
        }
        progress.tick();
        Ok(())
    })?;
    gallery.finish()?;
    progress.finish();

    times.sort_unstable();
    let median = times.get(times.len() / 2).copied().unwrap_or(0);
    println!(
        "Searched {} frames of 640x480 for both objects at once, {:.0} ms each (median).",
        times.len(),
        median as f64 / 1e6
    );
    Ok(tallies)
}

impl Tally {
    /// Counts the detections of the object in one frame; `truth` is its true outline, `None`
    /// when the frame does not show it.
    fn count<'a>(&mut self, detections: impl Iterator<Item = &'a Detection> + Clone, truth: Option<&[[f32; 2]; 4]>) {
        let is_right = |d: &Detection| truth.is_some_and(|t| corner_error(&d.corners, t) < RIGHT);
        let found = detections.clone().any(is_right);
        self.shown += usize::from(truth.is_some());
        self.found += usize::from(found);
        self.wrong += detections.count() - usize::from(found);
    }
}

/// The map from picture px to frame px in an entry of `truth.json`; `None` when the frame
/// does not show the object.
#[must_use]
#[allow(clippy::cast_possible_truncation, reason = "a pose")]
pub fn true_pose(entry: &Value) -> Option<Homography> {
    let v: Vec<f32> = entry.as_array()?.iter().filter_map(Value::as_f64).map(|f| f as f32).collect();
    v.try_into().ok().map(Homography)
}
