//! Compares tracking with searching on the same frames.
//!
//!     cargo run --release -p keygraph-tests --example tracking -- [--json] [TRUTH.json ...]
//!
//! In: rendered sequences, or the truth files of videos. A truth file is a list of `{"name",
//! "model": picture, "frames": [{"image", "H"}]}`. Paths are relative to the file, frames are in
//! order, and H maps picture px to frame px. Out: a table, or with `--json` an object: `sequences` with what a search, a
//! tracker, and a tracker that smooths did, and `drift`.
//!
//! Columns of the table:
//!
//! - found: frames in which the mean corner distance is under 10 % of the object's size
//! - error: median distance of a corner from the truth, px
//! - jitter: mean second difference of a corner from frame to frame, px. In rendered sequences it
//!   is taken of the corner minus the truth, in videos of the corner itself.
//! - back: maximum number of frames from the frame in which half of the object is seen again until
//!   it is found
//! - ms: time within the process, on one thread, from decoded pixels to detections
//!
//! Cost: some minutes, mostly for searching every frame.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::print_stdout)]

use std::path::Path;

use keygraph::input::{Picture, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::render::{RIGHT, corner_error};
use keygraph::search::{Follower, Found, Profile, Request, follow, search};
use keygraph_core::{DEFAULT_THRESHOLD, Homography, Model};
use keygraph_tests::motion::{Motion, Sequence, astronaut};
use serde_json::{Value, json};

type Outline = [[f32; 2]; 4];

/// Frames over which outlines are averaged, as with `--smooth`.
const SMOOTH: u8 = 8;

/// Results of one way of detection over a sequence.
#[derive(Default)]
struct Tally {
    shown: usize,
    found: usize,
    wrong: usize,
    errors: Vec<f32>,
    /// Corners of each copy in the last two frames, minus the truth if `relative` is set.
    before: Vec<[Option<Outline>; 2]>,
    bends: Vec<f32>,
    /// Number of frames in which each copy was seen but not found, since it was last found.
    waiting: Vec<usize>,
    /// Whether each copy has been away since it was last found.
    away: Vec<bool>,
    back: usize,
    searched_ms: Vec<f32>,
    followed_ms: Vec<f32>,
    ids: Vec<u32>,
}

impl Tally {
    /// Adds a frame. `copies` holds the outline of each copy and the part of it that is seen. A
    /// copy of which at least half is seen should be found. With `relative`, jitter is taken of the
    /// corners minus the truth.
    fn add(&mut self, found: &Found, copies: &[(Outline, f32)], relative: bool) {
        let ms = found.total_ns as f32 / 1e6;
        let tracking = found.tracking.as_ref();
        if tracking.is_none_or(|t| t.searched) {
            self.searched_ms.push(ms)
        } else {
            self.followed_ms.push(ms)
        }
        for id in tracking.iter().flat_map(|t| &t.seen).map(|s| s.0) {
            if !self.ids.contains(&id) {
                self.ids.push(id);
            }
        }
        self.before.resize(copies.len(), [None; 2]);
        self.waiting.resize(copies.len(), 0);
        self.away.resize(copies.len(), false);
        let mut right = 0;
        for (c, (truth, part)) in copies.iter().enumerate() {
            let it = found.detections.iter().map(|d| d.corners).find(|d| corner_error(d, truth) < RIGHT);
            right += usize::from(it.is_some());
            if *part >= 0.5 {
                self.shown += 1;
                self.found += usize::from(it.is_some());
                self.waiting[c] = if it.is_some() { 0 } else { self.waiting[c] + 1 };
                if self.away[c] {
                    self.back = self.back.max(self.waiting[c]);
                }
                self.away[c] &= it.is_none();
            } else {
                self.away[c] |= it.is_none();
                self.waiting[c] = 0;
            }
            let rest = it.map(|d| {
                let minus = |i: usize, k: usize| d[i][k] - if relative { truth[i][k] } else { 0.0 };
                core::array::from_fn(|i| [minus(i, 0), minus(i, 1)])
            });
            if let Some(d) = it {
                let distance = |(a, b): (&[f32; 2], &[f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
                self.errors.push(d.iter().zip(truth).map(distance).sum::<f32>() / 4.0);
            }
            if let ([Some(a), Some(b)], Some(c)) = (self.before[c], rest) {
                let bend = |i: usize| {
                    let at = |k: usize| a[i][k] - 2.0 * b[i][k] + c[i][k];
                    at(0).hypot(at(1))
                };
                self.bends.push((0..4).map(bend).sum::<f32>() / 4.0);
            }
            self.before[c] = [self.before[c][1], rest];
        }
        self.wrong += found.detections.len() - right;
    }

    /// Mean second difference of a corner, px.
    fn jitter(&self) -> f32 {
        self.bends.iter().sum::<f32>() / self.bends.len() as f32
    }

    fn print(&self, name: &str, how: &str) {
        println!(
            "{name:16} {how:9} {:5} {:5} {:5} {:6.3} {:6.3} {:4} {:5} {:8} {:6.1} {:8} {:6.2}",
            self.shown,
            self.found,
            self.wrong,
            median(&self.errors),
            self.jitter(),
            self.back,
            self.ids.len(),
            self.searched_ms.len(),
            median(&self.searched_ms),
            self.followed_ms.len(),
            median(&self.followed_ms),
        );
    }
}

fn median(v: &[f32]) -> f32 {
    let mut v = v.to_vec();
    v.sort_unstable_by(f32::total_cmp);
    v.get(v.len() / 2).copied().unwrap_or(f32::NAN)
}

/// A number of px with three digits after the point.
fn px(v: f32) -> f64 {
    (f64::from(v) * 1e3).round() / 1e3
}

/// Where the results go.
struct Report {
    /// Whether they are printed as one object at the end.
    as_json: bool,
    sequences: Vec<Value>,
    drift: Vec<Value>,
}

impl Report {
    fn add(&mut self, name: &str, frames: usize, both: [&Tally; 3]) {
        if !self.as_json {
            for (tally, how) in both.into_iter().zip(["searched", "tracked", "smoothed"]) {
                tally.print(name, how);
            }
        }
        self.sequences.push(json!({
            "name": name,
            "frames": frames,
            "shown": both[0].shown,
            "found": both.map(|t| t.found),
            "elsewhere": both.map(|t| t.wrong),
            "error_px": both.map(|t| px(median(&t.errors))),
            "jitter_px": both.map(|t| px(t.jitter())),
            "searched_when_tracking": both[1].searched_ms.len(),
            "ids": both[1].ids.len(),
            "frames_until_back": both.map(|t| t.back),
        }));
    }
}

/// Searches, tracks, and tracks and smooths the frames that `shot` gives.
fn compare(
    report: &mut Report,
    name: &str,
    model: &Model<'_>,
    frames: usize,
    relative: bool,
    shot: impl Fn(usize) -> (Picture, Vec<(Outline, f32)>),
) {
    let [mut untracked, mut tracked, mut smoothed] = [Tally::default(), Tally::default(), Tally::default()];
    let [mut follower, mut steady] = [Follower::default(), Follower::default()];
    let request = Request::new(Profile::Vga, DEFAULT_THRESHOLD);
    for i in 0..frames {
        let (picture, copies) = shot(i);
        let f = follow(&picture, model, &request, 0, &mut follower).unwrap();
        tracked.add(&f, &copies, relative);
        let f = follow(&picture, model, &Request { smooth: SMOOTH, ..request }, 0, &mut steady).unwrap();
        smoothed.add(&f, &copies, relative);
        let f = search(&picture, model, Profile::Vga, DEFAULT_THRESHOLD, false, 1).unwrap();
        untracked.add(&f, &copies, relative);
    }
    report.add(name, frames, [&untracked, &tracked, &smoothed]);
}

/// Tracks 1,000 frames. Reports whether the error grows, and how far the corners deviate from their
/// mean offset.
fn drift(report: &mut Report, model: &Model<'_>, picture: &Picture, motion: Motion, noise: f32) {
    let sequence = Sequence::new(picture, motion, noise, 7);
    let mut follower = Follower::default();
    let mut offsets: Vec<Outline> = Vec::new();
    for i in 0..1000 {
        let shot = sequence.shot(i);
        let f = follow(&shot.picture, model, &Request::new(Profile::Vga, DEFAULT_THRESHOLD), 0, &mut follower).unwrap();
        let Some(d) = f.detections.first() else { continue };
        let truth = shot.copies[0].0;
        offsets.push(core::array::from_fn(|i| [0, 1].map(|k| d.corners[i][k] - truth[i][k])));
    }
    let rms = |part: &[Outline], zero: &Outline| {
        let square = |o: &Outline| {
            (0..4).map(|i| (0..2).map(|k| (o[i][k] - zero[i][k]) * (o[i][k] - zero[i][k])).sum::<f32>()).sum::<f32>()
                / 4.0
        };
        (part.iter().map(square).sum::<f32>() / part.len() as f32).sqrt()
    };
    let mean: Outline =
        core::array::from_fn(|i| [0, 1].map(|k| offsets.iter().map(|o| o[i][k]).sum::<f32>() / offsets.len() as f32));
    let zero = [[0.0; 2]; 4];
    let n = offsets.len();
    let [first, last, about] = [rms(&offsets[..100], &zero), rms(&offsets[n - 100..], &zero), rms(&offsets, &mean)];
    if !report.as_json {
        println!(
            "{motion:?}, noise {noise}: {n} of 1000 frames; error of the first 100 {first:.3} px, of the last 100 {last:.3} px; about their mean offset {about:.3} px",
        );
    }
    let motion = format!("{motion:?}").to_lowercase();
    let [first, last, about] = [first, last, about].map(px);
    report.drift.push(json!({
        "motion": motion, "noise": noise, "frames": n, "first_100_px": first, "last_100_px": last, "about_mean_px": about,
    }));
}

fn outline(h: &Value, w: f32, ht: f32) -> Option<Outline> {
    let flat = |v: &Value| v.as_array().cloned().unwrap_or_else(|| vec![v.clone()]);
    let numbers: Vec<f32> = h.as_array()?.iter().flat_map(flat).map(|v| v.as_f64().unwrap() as f32).collect();
    Some(Homography(numbers.try_into().unwrap()).outline(w, ht))
}

/// Searches and tracks the video of a truth file.
fn video(report: &mut Report, path: &Path) {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let folder = path.parent().unwrap();
    let truth: Value = serde_json::from_str(&text).unwrap();
    for object in truth.as_array().unwrap() {
        let name = object["name"].as_str().unwrap();
        let picture = read_picture(&folder.join(object["model"].as_str().unwrap())).unwrap();
        let (model, _) = train(&picture, name, Preset::Large, false).unwrap();
        let frames = object["frames"].as_array().unwrap();
        compare(report, name, &Model::parse(&model).unwrap(), frames.len(), false, |i| {
            let frame = read_picture(&folder.join(frames[i]["image"].as_str().unwrap())).unwrap();
            let truth = outline(&frames[i]["H"], picture.width as f32, picture.height as f32);
            (frame, truth.into_iter().map(|o| (o, 1.0)).collect())
        });
    }
}

fn main() {
    let (options, sets): (Vec<_>, Vec<_>) = std::env::args().skip(1).partition(|a| a == "--json");
    let report = &mut Report { as_json: !options.is_empty(), sequences: Vec::new(), drift: Vec::new() };
    if !report.as_json {
        println!(
            "{:16} {:9} {:>5} {:>5} {:>5} {:>6} {:>6} {:>4} {:>5} {:>8} {:>6} {:>8} {:>6}",
            "sequence",
            "",
            "shown",
            "found",
            "wrong",
            "error",
            "jitter",
            "back",
            "ids",
            "searched",
            "ms",
            "followed",
            "ms"
        );
    }
    if sets.is_empty() {
        let picture = astronaut();
        let (model, _) = train(&picture, "astronaut", Preset::Large, false).unwrap();
        let model = Model::parse(&model).unwrap();
        for motion in Motion::ALL {
            let sequence = Sequence::new(&picture, motion, 5.0, 7);
            compare(report, &format!("{motion:?}").to_lowercase(), &model, 120, true, |i| {
                let shot = sequence.shot(i);
                (shot.picture, shot.copies)
            });
        }
        for (motion, noise) in [(Motion::Still, 5.0), (Motion::Still, 15.0), (Motion::Slow, 5.0)] {
            drift(report, &model, &picture, motion, noise);
        }
    }
    sets.iter().for_each(|s| video(report, Path::new(s)));
    if report.as_json {
        println!("{:#}", json!({ "sequences": report.sequences, "drift": report.drift }));
    }
}
