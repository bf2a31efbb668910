//! How well a picture will be found, before it is used.
//!
//! In: a model and the picture that it was made from. Out: how often the real
//! detector finds it in rendered frames ([`SWEEP`]: over scale, rotation, tilt,
//! blur, darkness and noise), a score, what limits it in words, and a map of what
//! carries it. Without the picture, what the model alone tells: it holds only a
//! small copy, and frames rendered from that would show its blur, not the object.
//!
//! A frame shows the picture somewhere before dead leaves, in mild conditions at
//! random ([`MILD`]) but for the one that its cell sets. The rate of a condition
//! is the mean of its cells; the score is 100 times the mean of the rates, scale
//! and tilt counted three times and blur twice, since these are what frames of
//! real cameras differ in most. It can only rise when a view more is found.
//!
//! Memory: a frame and a detector for each thread. Cost: 27 cells times the
//! views, each some 20 ms to render and then the time of the search.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread;

use anyhow::{Result, ensure};
use keygraph_core::detect::DEFAULT_THRESHOLD;
use keygraph_core::feature::FeatureKind;
use keygraph_core::geometry::Homography;
use keygraph_core::model::{Model, Object, Template};

use crate::heat::Heat;
use crate::input::Picture;
use crate::render::{Exposure, Pose, Print, RIGHT, Random, Scene, corner_error};
use crate::search::{MAX_THREADS, Profile, search};

/// What a cell of the table sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// Longer side seen from the front, px.
    Scale,
    /// Turn in the picture's own plane, degrees.
    Rotation,
    /// Tilt out of the frame's plane, degrees.
    Tilt,
    /// Spread of a Gaussian blur, px.
    Blur,
    /// Brightness, percent of the picture's own.
    Darkness,
    /// Spread of the noise, of 255.
    Noise,
}

impl Condition {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scale => "scale",
            Self::Rotation => "rotation",
            Self::Tilt => "tilt",
            Self::Blur => "blur",
            Self::Darkness => "darkness",
            Self::Noise => "noise",
        }
    }

    /// Its unit, as in "45 degrees".
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Scale | Self::Blur => "px",
            Self::Rotation | Self::Tilt => "degrees",
            Self::Darkness => "% light",
            Self::Noise => "of 255",
        }
    }

    const fn weight(self) -> f32 {
        match self {
            Self::Scale | Self::Tilt => 3.0,
            Self::Blur => 2.0,
            Self::Rotation | Self::Darkness | Self::Noise => 1.0,
        }
    }
}

/// The table: every condition from the easiest to the hardest, scale from small to
/// large, in px of a frame of 640 px.
pub const SWEEP: [(Condition, &[f32]); 6] = [
    (Condition::Scale, &[84.0, 126.0, 210.0, 420.0, 630.0, 840.0]),
    (Condition::Rotation, &[0.0, 45.0, 90.0, 180.0]),
    (Condition::Tilt, &[0.0, 15.0, 30.0, 45.0, 60.0]),
    (Condition::Blur, &[1.0, 2.0, 3.0, 4.0]),
    (Condition::Darkness, &[50.0, 25.0, 12.0, 6.0]),
    (Condition::Noise, &[5.0, 10.0, 20.0, 40.0]),
];

/// The ranges of all that a cell does not set.
#[derive(Clone, Debug)]
pub struct Mild {
    /// Longer side, px of a frame of 640 px.
    pub side_px: Range<f32>,
    /// Tilt, degrees.
    pub tilt_deg: Range<f32>,
    /// Blur, px.
    pub blur_px: Range<f32>,
    /// Brightness, part of the picture's own.
    pub gain: Range<f32>,
    /// Noise, of 255.
    pub noise: Range<f32>,
}

/// Rotation and the axis of the tilt are free; the rest is what a camera on a
/// table delivers.
pub const MILD: Mild =
    Mild { side_px: 210.0..400.0, tilt_deg: 0.0..20.0, blur_px: 0.4..1.0, gain: 0.7..1.2, noise: 2.0..5.0 };

/// Views that count as reliable: three in four.
pub const RELIABLE: f32 = 0.75;

/// How the sweep is run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size of frames and detector; lengths of [`SWEEP`] are scaled with it.
    pub profile: Profile,
    /// Views a cell; more make the rates finer and the run longer.
    pub views: usize,
    /// Frames searched at once, 1 to [`MAX_THREADS`].
    pub threads: usize,
}

/// One field of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// What the condition is set to; lengths in px of the frames that were rendered.
    pub value: f32,
    /// Views in which the object was found at its place.
    pub found: usize,
}

impl Cell {
    /// The part of the views in which the object was found.
    #[must_use]
    pub fn rate(&self, views: usize) -> f32 {
        self.found as f32 / views as f32
    }
}

/// One line of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The condition.
    pub condition: Condition,
    /// Its cells.
    pub cells: Vec<Cell>,
}

/// What was seen in rendered frames.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Views a cell.
    pub views: usize,
    /// The table.
    pub rows: Vec<Row>,
    /// Outlines at a wrong place, and second ones at the right place.
    pub wrong: usize,
    /// The keygraphs that agreed with right outlines.
    pub heat: Heat,
}

/// What can be told without rendering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Structure {
    /// Keypoints over all views.
    pub keypoints: usize,
    /// Keygraphs.
    pub keygraphs: usize,
    /// Part of the picture, in 8 x 8 fields, that has keypoints.
    pub spread: f32,
    /// Standard deviation of the luma, of 255.
    pub contrast: f32,
    /// How much the picture is like itself at another place: the highest
    /// correlation of its detail with itself, shifted by an eighth of the longer
    /// side or more.
    pub repetition: f32,
    /// Width and height of the picture, px.
    pub size: (u32, u32),
    /// Whether features hold no chroma.
    pub luma_only: bool,
}

/// Something that makes the picture harder to find.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limit {
    /// A key for programs.
    pub kind: &'static str,
    /// What it is and what to do about it.
    pub text: String,
}

/// Everything about one object.
#[derive(Clone, Debug)]
pub struct Assessment {
    /// Name of the object.
    pub name: String,
    /// What the model tells; `None` when there is no model.
    pub structure: Option<Structure>,
    /// What the frames tell; `None` without the picture.
    pub sweep: Option<Sweep>,
    /// 0 to 100; `None` without the picture.
    pub score: Option<u8>,
    /// What limits it: first what the picture is, then what the frames showed.
    pub limits: Vec<Limit>,
}

impl Assessment {
    /// Of a picture that training refuses, with its reason.
    #[must_use]
    pub fn refused(name: &str, reason: &str) -> Self {
        let limits = vec![Limit { kind: "refused", text: reason.into() }];
        Self { name: name.into(), structure: None, sweep: None, score: Some(0), limits }
    }
}

/// Assesses object `index` of `model`, in frames if its picture is given. `tick` is
/// called after each of the [`frames`].
///
/// # Errors
/// When the picture does not have the size of the one that the model was made from.
pub fn assess(
    model: &Model<'_>,
    index: usize,
    picture: Option<&Picture>,
    options: &Options,
    tick: impl FnMut(),
) -> Result<Assessment> {
    let object = model.object(index);
    if let Some(p) = picture {
        ensure!(
            (p.width, p.height) == (object.width, object.height),
            "{} was trained on a picture of {}x{} px, and this one has {}x{}: give the picture, and the --crop, that the model was made from",
            object.name,
            object.width,
            object.height,
            p.width,
            p.height
        );
    }
    let structure = structure(model, index, &object);
    let sweep = picture.map(|p| sweep(model, index, p, options, tick)).transpose()?;
    let score = sweep.as_ref().map(score);
    let limits = limits(&structure, sweep.as_ref());
    Ok(Assessment { name: object.name.into(), structure: Some(structure), sweep, score, limits })
}

/// Frames that are rendered for `views` views a cell.
#[must_use]
pub fn frames(views: usize) -> usize {
    views * SWEEP.iter().map(|(_, values)| values.len()).sum::<usize>()
}

// -------------------------------------------------------------------- frames

/// What one view showed.
struct Seen {
    found: bool,
    wrong: usize,
    /// Supporting triangles, picture px.
    triangles: Vec<[[f32; 2]; 3]>,
}

fn sweep(
    model: &Model<'_>,
    index: usize,
    picture: &Picture,
    options: &Options,
    mut tick: impl FnMut(),
) -> Result<Sweep> {
    let print = Print::new(picture);
    let size = (picture.width as f32, picture.height as f32);
    let cells: Vec<(usize, usize)> =
        SWEEP.iter().enumerate().flat_map(|(r, (_, values))| (0..values.len()).map(move |c| (r, c))).collect();
    let views = options.views;
    let one = |job: usize, slot: usize| -> Result<Seen> {
        let (r, c) = cells[job / views];
        let (condition, values) = SWEEP[r];
        let mut random = Random::of(&[r as u64, c as u64, (job % views) as u64]);
        let (frame, h) = view(&print, size, options.profile, condition, values[c], &mut random);
        look(&frame, model, index, &h.outline(size.0, size.1), options.profile, slot)
    };
    let next = AtomicUsize::new(0);
    let mut seen: Vec<(usize, Seen)> = thread::scope(|scope| {
        let (done, results) = channel();
        for slot in 0..options.threads.clamp(1, MAX_THREADS) {
            let (done, next, one) = (done.clone(), &next, &one);
            scope.spawn(move || {
                loop {
                    let job = next.fetch_add(1, Ordering::Relaxed);
                    if job >= frames(views) || done.send(one(job, slot).map(|seen| (job, seen))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(done);
        results.into_iter().inspect(|_| tick()).collect::<Result<_>>()
    })?;
    // Whichever thread was faster, sums are made in one order.
    seen.sort_unstable_by_key(|(job, _)| *job);
    let mut rows: Vec<Row> = SWEEP
        .iter()
        .map(|&(condition, values)| Row {
            condition,
            cells: values.iter().map(|&v| Cell { value: shown(condition, v, options.profile), found: 0 }).collect(),
        })
        .collect();
    let (mut wrong, mut heat) = (0, Heat::new(picture.width, picture.height));
    for (job, seen) in seen {
        let (r, c) = cells[job / views];
        rows[r].cells[c].found += usize::from(seen.found);
        wrong += seen.wrong;
        seen.triangles.into_iter().for_each(|t| heat.add(t));
    }
    Ok(Sweep { views, rows, wrong, heat })
}

/// A value of [`SWEEP`] in the frames of a profile.
fn shown(condition: Condition, value: f32, profile: Profile) -> f32 {
    match condition {
        Condition::Scale => value * frame_size(profile).0 as f32 / 640.0,
        _ => value,
    }
}

/// A frame in mild conditions but for one, and where the picture is in it.
fn view(
    print: &Print,
    size: (f32, f32),
    profile: Profile,
    condition: Condition,
    value: f32,
    random: &mut Random,
) -> (Picture, Homography) {
    let (width, height) = frame_size(profile);
    let scale = width as f32 / 640.0;
    let mut within = |range: &Range<f32>| random.between(range.start, range.end);
    let mut pose = Pose {
        side_px: scale * within(&MILD.side_px),
        rotation_deg: within(&(0.0..360.0)),
        tilt_deg: within(&MILD.tilt_deg),
        axis_deg: within(&(0.0..360.0)),
        centre: [0.0; 2],
    };
    let mut exposure =
        Exposure { gain: within(&MILD.gain), blur_px: within(&MILD.blur_px), noise: within(&MILD.noise) };
    match condition {
        Condition::Scale => pose.side_px = shown(condition, value, profile),
        Condition::Rotation => pose.rotation_deg = value,
        Condition::Tilt => pose.tilt_deg = value,
        Condition::Blur => exposure.blur_px = value,
        Condition::Darkness => exposure.gain = value / 100.0,
        Condition::Noise => exposure.noise = value,
    }
    let mut scene = Scene::dead_leaves(width, height, random);
    let pose = scene.somewhere(size, pose, random);
    let h = scene.lay(print, &pose);
    (scene.expose(&exposure, random), h)
}

/// Frames are as large as the profile takes, landscape.
const fn frame_size(profile: Profile) -> (usize, usize) {
    let (side, pixels) = profile.limits();
    (side, pixels / side)
}

/// Searches a frame and holds what is found against the true outline.
fn look(
    frame: &Picture,
    model: &Model<'_>,
    index: usize,
    truth: &[[f32; 2]; 4],
    profile: Profile,
    slot: usize,
) -> Result<Seen> {
    let found = search(frame, model, profile, DEFAULT_THRESHOLD, true, slot)?;
    let mut seen = Seen { found: false, wrong: 0, triangles: Vec::new() };
    for (d, supporters) in found.detections.iter().zip(&found.supporters) {
        if usize::from(d.object) != index {
            continue;
        }
        if seen.found || corner_error(&d.corners, truth) >= RIGHT {
            seen.wrong += 1;
            continue;
        }
        seen.found = true;
        if let Some(back) = d.homography.inverse() {
            seen.triangles = supporters.iter().map(|t| t.map(|p| back.apply(p))).collect();
        }
    }
    Ok(seen)
}

/// The formula of the file's opening.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 100")]
fn score(sweep: &Sweep) -> u8 {
    let weighted = |row: &Row| row.condition.weight() * row.rate(sweep.views);
    let weights: f32 = sweep.rows.iter().map(|r| r.condition.weight()).sum();
    (100.0 * sweep.rows.iter().map(weighted).sum::<f32>() / weights + 0.5) as u8
}

impl Row {
    /// Mean of the cells' rates, 0 to 1.
    #[must_use]
    pub fn rate(&self, views: usize) -> f32 {
        self.cells.iter().map(|c| c.rate(views)).sum::<f32>() / self.cells.len() as f32
    }
}

// ----------------------------------------------------------------- structure

/// Fields along each side that keypoints are counted in.
const FIELDS: usize = 8;

fn structure(model: &Model<'_>, index: usize, object: &Object<'_>) -> Structure {
    let mine = |v: usize| usize::from(model.view(v).object) == index;
    let views: Vec<_> = (0..model.views()).filter(|&v| mine(v)).map(|v| model.view(v)).collect();
    let mut fields = [[false; FIELDS]; FIELDS];
    for view in &views {
        for k in 0..usize::from(view.keypoints) {
            let [x, y] = view.to_picture.apply(model.keypoint(view.first as usize + k).px());
            fields[field(y, object.height)][field(x, object.width)] = true;
        }
    }
    let luma = luma(&object.template);
    let mean = luma.iter().map(|&v| f32::from(v)).sum::<f32>() / luma.len() as f32;
    let square = luma.iter().map(|&v| (f32::from(v) - mean) * (f32::from(v) - mean)).sum::<f32>() / luma.len() as f32;
    Structure {
        keypoints: object.keypoints as usize,
        keygraphs: (0..model.keygraphs()).filter(|&k| mine(model.keygraph(k).0)).count(),
        spread: fields.as_flattened().iter().filter(|&&f| f).count() as f32 / (FIELDS * FIELDS) as f32,
        contrast: square.sqrt(),
        repetition: repetition(&object.template),
        size: (object.width, object.height),
        luma_only: model.feature() == FeatureKind::Luma,
    }
}

/// The template's luma at its full size, in rows.
fn luma(template: &Template<'_>) -> Vec<u8> {
    let plane = template.luma(0);
    (0..plane.height()).flat_map(|y| plane.row(y)).copied().collect()
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the fields")]
fn field(v: f32, side: u32) -> usize {
    (v / side as f32 * FIELDS as f32).clamp(0.0, FIELDS as f32 - 1.0) as usize
}

/// The highest correlation of the template's detail with itself, shifted by an
/// eighth of the longer side or more, over an overlap of half of each side or more.
#[allow(clippy::cast_possible_wrap, reason = "sides of a template")]
fn repetition(template: &Template<'_>) -> f32 {
    let (w, h) = (template.width, template.height);
    let detail = detail(template);
    let least = w.max(h).div_ceil(8);
    let mut most: f32 = 0.0;
    for dy in 0..=h / 2 {
        for dx in -(w as isize / 2)..=w as isize / 2 {
            if dx * dx + ((dy * dy) as isize) < (least * least) as isize {
                continue;
            }
            let (ax, bx) = (dx.max(0).unsigned_abs(), (-dx).max(0).unsigned_abs());
            let n = w - dx.unsigned_abs();
            let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
            for y in 0..h - dy {
                let (a, b) = (&detail[(y + dy) * w + ax..][..n], &detail[y * w + bx..][..n]);
                for (&a, &b) in a.iter().zip(b) {
                    ab += a * b;
                    aa += a * a;
                    bb += b * b;
                }
            }
            if aa > 0.0 && bb > 0.0 {
                most = most.max(ab / (aa * bb).sqrt());
            }
        }
    }
    most
}

/// The template's luma without what is wider than nine pixels, which every picture
/// shares with itself.
fn detail(template: &Template<'_>) -> Vec<f32> {
    let (w, h, luma) = (template.width, template.height, luma(template));
    let around = |i: usize, n: usize| i.saturating_sub(4)..(i + 5).min(n);
    let value = |x: usize, y: usize| {
        let (xs, ys) = (around(x, w), around(y, h));
        let count = (xs.len() * ys.len()) as f32;
        let sum: u32 = ys.map(|y| luma[y * w..][xs.clone()].iter().map(|&v| u32::from(v)).sum::<u32>()).sum();
        f32::from(luma[y * w + x]) - sum as f32 / count
    };
    (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect()
}

// --------------------------------------------------------------------- words

/// Below these a [`Structure`] limits; the poor pictures of the tests lie well
/// below, photographs above.
const KEYPOINTS: usize = 300;
const SPREAD: f32 = 0.5;
const CONTRAST: f32 = 12.0;
const LONGER_SIDE: u32 = 200;
/// Above these it does.
const REPETITION: f32 = 0.6;
const ELONGATION: u32 = 4;
/// Wrong outlines a frame.
const WRONG: f32 = 0.02;

fn limits(s: &Structure, sweep: Option<&Sweep>) -> Vec<Limit> {
    let mut limits = Vec::new();
    let mut add = |holds: bool, kind, text: String| {
        if holds {
            limits.push(Limit { kind, text });
        }
    };
    let (w, h) = s.size;
    add(
        s.repetition > REPETITION,
        "repeated pattern",
        format!(
            "repeated pattern: shifted, the picture is like itself (correlation {:.2}); take a part that is nowhere else",
            s.repetition
        ),
    );
    add(
        s.keypoints < KEYPOINTS || s.spread < SPREAD,
        "few corners",
        format!(
            "few corners: {} keypoints, in {:.0} % of the picture; cut off what is plain, or take a part with more texture",
            s.keypoints,
            100.0 * s.spread
        ),
    );
    add(
        s.contrast < CONTRAST,
        "low contrast",
        format!("low contrast: luma varies by {:.0} of 255; take the picture in better light", s.contrast),
    );
    add(
        w.max(h) < LONGER_SIDE,
        "small",
        format!("small: {w}x{h} px show little detail; take a picture of 400 px or more"),
    );
    add(
        w.max(h) > ELONGATION * w.min(h),
        "elongated",
        format!("elongated: {w}x{h} px; take a part that is more nearly square"),
    );
    add(
        s.luma_only,
        "no chroma",
        "no chroma: luma alone tells it from others; if object and camera have colour, take a picture in colour".into(),
    );
    let Some(sweep) = sweep else { return limits };
    add(
        sweep.wrong as f32 > WRONG * frames(sweep.views) as f32,
        "wrong places",
        format!(
            "wrong places: {} outlines in {} frames are not where the picture is; raise --threshold in `keygraph detect`",
            sweep.wrong,
            frames(sweep.views)
        ),
    );
    let turned = sweep.rows.iter().filter(|r| r.condition == Condition::Rotation).map(|r| r.rate(sweep.views));
    let weak = turned.clone().any(|rate| rate < RELIABLE);
    add(
        weak,
        "weak",
        format!(
            "weak: found in {:.0} % of mild frames, {:.0} to {:.0} % as long as the frame; show it larger, or take a part with more and sharper texture",
            100.0 * turned.sum::<f32>(),
            MILD.side_px.start / 6.4,
            MILD.side_px.end / 6.4
        ),
    );
    // What is weak in mild conditions already is not lost to the others.
    let own = |l: &Limit| !weak || l.kind == "lost when small";
    limits.extend(sweep.rows.iter().filter_map(|row| row.limit(sweep.views)).filter(own));
    limits
}

impl Row {
    /// Where the object is no longer found, if that is sooner than one may expect.
    fn limit(&self, views: usize) -> Option<Limit> {
        // The cell up to which, or for scale from which on, it should be found.
        let (expected, kind, advice) = match self.condition {
            // Frames of all turns are mild ones.
            Condition::Rotation => return None,
            Condition::Scale => (1, "lost when small", "come closer, or search larger frames (--profile hd)"),
            Condition::Tilt => (3, "lost when tilted", "look at it from nearer to the front"),
            Condition::Blur => (1, "lost when blurred", "its detail is fine: hold the camera still and focus"),
            Condition::Darkness => (1, "lost in the dark", "give it more light"),
            Condition::Noise => (1, "lost in noise", "give it more light"),
        };
        let reliable = |c: &Cell| c.rate(views) >= RELIABLE;
        let (held, to) = match self.condition {
            Condition::Scale => (self.cells.iter().position(reliable), "from"),
            _ => (self.cells.iter().take_while(|c| reliable(c)).count().checked_sub(1), "to"),
        };
        let enough = held.is_some_and(|i| if to == "from" { i <= expected } else { i >= expected });
        let range = held.map_or_else(
            || "at no value of the table".into(),
            |i| format!("only {to} {} {}", self.cells[i].value, self.condition.unit()),
        );
        let text = format!("{kind}: found reliably {range}; {advice}");
        (!enough).then_some(Limit { kind, text })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Structure = Structure {
        keypoints: 1120,
        keygraphs: 60_000,
        spread: 0.9,
        contrast: 50.0,
        repetition: 0.2,
        size: (600, 400),
        luma_only: false,
    };

    /// A sweep of four views a cell, with the views found by condition and cell.
    fn sweep(found: impl Fn(Condition, usize) -> usize) -> Sweep {
        let row = |&(condition, values): &(Condition, &[f32])| Row {
            condition,
            cells: values.iter().enumerate().map(|(i, &value)| Cell { value, found: found(condition, i) }).collect(),
        };
        Sweep { views: 4, rows: SWEEP.iter().map(row).collect(), wrong: 0, heat: Heat::new(60, 40) }
    }

    fn texts(structure: &Structure, sweep: &Sweep) -> Vec<String> {
        limits(structure, Some(sweep)).into_iter().map(|l| l.text).collect()
    }

    #[test]
    fn the_score_is_the_weighted_mean_of_the_rows() {
        assert_eq!(score(&sweep(|_, _| 0)), 0);
        assert_eq!(score(&sweep(|_, _| 4)), 100);
        // Three of eleven parts, and half of one.
        assert_eq!(score(&sweep(|c, _| if c == Condition::Scale { 4 } else { 0 })), 27);
        assert_eq!(score(&sweep(|c, _| if c == Condition::Noise { 2 } else { 0 })), 5);
    }

    #[test]
    fn a_good_picture_has_no_limits() {
        assert_eq!(texts(&GOOD, &sweep(|_, _| 4)), [""; 0]);
    }

    #[test]
    fn what_the_picture_lacks_is_named() {
        let poor = [
            (Structure { keypoints: 200, ..GOOD }, "few corners: 200 keypoints"),
            (Structure { spread: 0.3, ..GOOD }, "in 30 % of the picture"),
            (Structure { contrast: 8.0, ..GOOD }, "low contrast: luma varies by 8"),
            (Structure { repetition: 0.9, ..GOOD }, "repeated pattern"),
            (Structure { size: (90, 60), ..GOOD }, "small: 90x60"),
            (Structure { size: (800, 100), ..GOOD }, "elongated: 800x100"),
            (Structure { luma_only: true, ..GOOD }, "no chroma"),
        ];
        for (structure, words) in poor {
            let texts = texts(&structure, &sweep(|_, _| 4));
            assert!(texts.len() == 1 && texts[0].contains(words), "{words:?} is not {texts:?}");
        }
    }

    #[test]
    fn what_the_frames_show_is_named() {
        let scale = sweep(|c, i| if c == Condition::Scale && i < 2 { 2 } else { 4 });
        assert!(texts(&GOOD, &scale)[0].contains("only from 210 px"), "{:?}", texts(&GOOD, &scale));
        let tilt = sweep(|c, i| if c == Condition::Tilt && i > 2 { 0 } else { 4 });
        assert!(texts(&GOOD, &tilt)[0].contains("only to 30 degrees"), "{:?}", texts(&GOOD, &tilt));
        let dark = sweep(|c, _| if c == Condition::Darkness { 0 } else { 4 });
        assert!(texts(&GOOD, &dark)[0].contains("at no value"), "{:?}", texts(&GOOD, &dark));
        let wrong = Sweep { wrong: 20, ..sweep(|_, _| 4) };
        assert!(texts(&GOOD, &wrong)[0].contains("20 outlines in 108 frames"), "{:?}", texts(&GOOD, &wrong));
        let weak = texts(&GOOD, &sweep(|c, i| if c == Condition::Scale && i > 1 { 4 } else { 2 }));
        assert!(weak.len() == 2 && weak[0].contains("found in 50 % of mild frames"), "{weak:?}");
    }
}
