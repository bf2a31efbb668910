//! How often the detector finds a picture in rendered frames.
//!
//! In: a model and the picture that it was made from. Out: a [`Sweep`]: for each value of
//! each condition ([`SWEEP`]: scale, rotation, tilt, blur, darkness, noise) the number of
//! frames in which the object was found at its place, a map of the keygraphs that
//! carried it, and how often a look-alike was taken for it.
//!
//! A frame shows the picture at a random place before dead leaves. Its cell sets one
//! condition; the others are mild and random ([`MILD`]). A look-alike is the picture with a share
//! of its parts exchanged ([`LOOK_ALIKES`]), in mild conditions.
//!
//! Memory: a frame and a detector for each thread. Cost: 30 cells times the views; each
//! view takes some 20 ms to render, and then a search.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread;

use anyhow::Result;
use keygraph_core::{DEFAULT_THRESHOLD, Homography, Model};

use crate::exchange::exchange;
use crate::heat::Heat;
use crate::picture::Picture;
use crate::random::Random;
use crate::render::{Exposure, Pose, Print, RIGHT, Scene, corner_error};
use crate::search::{MAX_THREADS, Profile, search};

/// The condition that a cell of the table sets.
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
    /// The name of the condition, as JSON has it.
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

    /// The unit of the condition's values, as in "45 degrees".
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Scale | Self::Blur => "px",
            Self::Rotation | Self::Tilt => "degrees",
            Self::Darkness => "% light",
            Self::Noise => "of 255",
        }
    }

    /// The weight of the condition in the score. Scale and tilt count three times and blur
    /// twice: frames of real cameras differ most in these.
    pub(crate) const fn weight(self) -> f32 {
        match self {
            Self::Scale | Self::Tilt => 3.0,
            Self::Blur => 2.0,
            Self::Rotation | Self::Darkness | Self::Noise => 1.0,
        }
    }
}

/// The table: every condition with its values, from the easiest to the hardest. Scale runs
/// from small to large, in px of a frame that is 640 px wide.
pub const SWEEP: [(Condition, &[f32]); 6] = [
    (Condition::Scale, &[84.0, 126.0, 210.0, 420.0, 630.0, 840.0]),
    (Condition::Rotation, &[0.0, 45.0, 90.0, 180.0]),
    (Condition::Tilt, &[0.0, 15.0, 30.0, 45.0, 60.0]),
    (Condition::Blur, &[1.0, 2.0, 3.0, 4.0]),
    (Condition::Darkness, &[50.0, 25.0, 12.0, 6.0]),
    (Condition::Noise, &[5.0, 10.0, 20.0, 40.0]),
];

/// The share of a look-alike's parts that are exchanged, percent.
pub const LOOK_ALIKES: [f32; 3] = [25.0, 50.0, 75.0];

/// The ranges of the conditions that a cell does not set.
#[derive(Clone, Debug)]
pub struct Mild {
    /// Longer side, px of a frame that is 640 px wide.
    pub side_px: Range<f32>,
    /// Tilt, degrees.
    pub tilt_deg: Range<f32>,
    /// Blur, px.
    pub blur_px: Range<f32>,
    /// Brightness as a factor on the picture's own.
    pub gain: Range<f32>,
    /// Spread of the noise, of 255.
    pub noise: Range<f32>,
}

/// What a camera on a table delivers. Rotation and the axis of the tilt take any value.
pub const MILD: Mild =
    Mild { side_px: 210.0..400.0, tilt_deg: 0.0..20.0, blur_px: 0.4..1.0, gain: 0.7..1.2, noise: 2.0..5.0 };

/// Minimum rate of a cell that counts as reliable: three views in four.
pub const RELIABLE: f32 = 0.75;

/// How the sweep is run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size of the frames and of the detector. Lengths of [`SWEEP`] are scaled with it.
    pub profile: Profile,
    /// Views a cell. More views give finer rates and take more time.
    pub views: usize,
    /// Frames searched at once, 1 to [`MAX_THREADS`].
    pub threads: usize,
}

/// One cell of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// The value of the condition; lengths are in px of the frames that were rendered.
    pub value: f32,
    /// Number of views in which the object was found at its place.
    pub found: usize,
}

impl Cell {
    /// The share of the views in which the object was found, 0 to 1.
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
    /// The cells of the row, in the order of [`SWEEP`].
    pub cells: Vec<Cell>,
}

/// What the detector found in the rendered frames.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Number of views a cell.
    pub views: usize,
    /// The rows of the table, in the order of [`SWEEP`].
    pub rows: Vec<Row>,
    /// Number of outlines at a wrong place, and of second outlines at the right place.
    pub wrong: usize,
    /// Where the keygraphs lie that agreed with right outlines.
    pub heat: Heat,
    /// For each value of [`LOOK_ALIKES`] the number of views in which the look-alike was taken for
    /// the object.
    pub taken: Vec<Cell>,
}

/// Number of frames that show the object, for `views` views a cell.
#[must_use]
pub fn frames(views: usize) -> usize {
    views * SWEEP.iter().map(|(_, values)| values.len()).sum::<usize>()
}

/// Number of frames that are rendered for `views` views a cell, with those of look-alikes.
#[must_use]
pub fn all_frames(views: usize) -> usize {
    frames(views) + views * LOOK_ALIKES.len()
}

impl Row {
    /// The mean of the cells' rates, 0 to 1.
    #[must_use]
    pub fn rate(&self, views: usize) -> f32 {
        self.cells.iter().map(|c| c.rate(views)).sum::<f32>() / self.cells.len() as f32
    }
}

// -------------------------------------------------------------------- frames

/// What one view showed.
struct Seen {
    found: bool,
    wrong: usize,
    /// Triangles that support the outline, picture px.
    triangles: Vec<[[f32; 2]; 3]>,
}

/// A cell of the table, or a look-alike.
#[derive(Clone, Copy)]
enum Shows {
    /// The row and the column in [`SWEEP`].
    Object(usize, usize),
    /// The index in [`LOOK_ALIKES`].
    LookAlike(usize),
}

/// What is swept: an object of a model, and its picture.
struct Subject<'a> {
    model: &'a Model<'a>,
    index: usize,
    picture: &'a Picture,
    print: Print,
    /// Width and height of the picture, px.
    size: (f32, f32),
    options: Options,
}

/// Renders all frames of the table and searches them. `tick` is called after each frame.
///
/// # Errors
/// When a frame cannot be searched.
pub fn sweep(
    model: &Model<'_>,
    index: usize,
    picture: &Picture,
    options: &Options,
    tick: impl FnMut(),
) -> Result<Sweep> {
    let size = (picture.width as f32, picture.height as f32);
    let subject = Subject { model, index, picture, print: Print::new(picture), size, options: *options };
    let table = SWEEP.iter().enumerate();
    let table = table.flat_map(|(r, (_, values))| (0..values.len()).map(move |c| Shows::Object(r, c)));
    let cells: Vec<Shows> = table.chain((0..LOOK_ALIKES.len()).map(Shows::LookAlike)).collect();
    let views = options.views;
    let seen = in_threads(options.threads, all_frames(views), tick, |job, slot| {
        subject.look(cells[job / views], (job % views) as u64, slot)
    })?;
    let mut rows: Vec<Row> = SWEEP
        .iter()
        .map(|&(condition, values)| Row {
            condition,
            cells: values.iter().map(|&v| Cell { value: shown(condition, v, options.profile), found: 0 }).collect(),
        })
        .collect();
    let mut taken: Vec<Cell> = LOOK_ALIKES.iter().map(|&value| Cell { value, found: 0 }).collect();
    let (mut wrong, mut heat) = (0, Heat::new(picture.width, picture.height));
    for (job, seen) in seen.into_iter().enumerate() {
        match cells[job / views] {
            Shows::Object(r, c) => {
                rows[r].cells[c].found += usize::from(seen.found);
                wrong += seen.wrong;
                seen.triangles.into_iter().for_each(|t| heat.add(t));
            }
            Shows::LookAlike(i) => taken[i].found += usize::from(seen.found || seen.wrong > 0),
        }
    }
    Ok(Sweep { views, rows, wrong, heat, taken })
}

/// Runs `work` for each job below `jobs` in some threads, with the number of the thread.
/// Returns the results in the order of the jobs, so that sums do not depend on which
/// thread was faster. `tick` is called after each job.
fn in_threads<T: Send>(
    threads: usize,
    jobs: usize,
    mut tick: impl FnMut(),
    work: impl Fn(usize, usize) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    if threads <= 1 {
        // In the thread of the caller, since WebAssembly has no other.
        return (0..jobs).map(|job| work(job, 0).inspect(|_| tick())).collect();
    }
    let next = AtomicUsize::new(0);
    let mut results: Vec<(usize, T)> = thread::scope(|scope| {
        let (done, results) = channel();
        for slot in 0..threads.min(MAX_THREADS) {
            let (done, next, work) = (done.clone(), &next, &work);
            scope.spawn(move || {
                loop {
                    let job = next.fetch_add(1, Ordering::Relaxed);
                    if job >= jobs || done.send(work(job, slot).map(|result| (job, result))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(done);
        results.into_iter().inspect(|_| tick()).collect::<Result<_>>()
    })?;
    results.sort_unstable_by_key(|(job, _)| *job);
    Ok(results.into_iter().map(|(_, result)| result).collect())
}

/// A value of [`SWEEP`] in the frames of a profile.
fn shown(condition: Condition, value: f32, profile: Profile) -> f32 {
    match condition {
        Condition::Scale => value * frame_size(profile).0 as f32 / 640.0,
        _ => value,
    }
}

/// Width and height of the frames, px: as large as the profile takes, landscape.
const fn frame_size(profile: Profile) -> (usize, usize) {
    let (side, pixels) = profile.limits();
    (side, pixels / side)
}

impl Subject<'_> {
    /// Renders view `number` of a cell and searches it. The view depends on the cell and
    /// the number alone. An outline is right when it lies at the true one.
    fn look(&self, cell: Shows, number: u64, slot: usize) -> Result<Seen> {
        let (frame, h) = match cell {
            Shows::Object(row, column) => {
                let (condition, values) = SWEEP[row];
                let mut random = Random::of(&[row as u64, column as u64, number]);
                self.render(&self.print, Some((condition, values[column])), &mut random)
            }
            Shows::LookAlike(i) => {
                let mut random = Random::of(&[SWEEP.len() as u64, i as u64, number]);
                let print = Print::new(&exchange(self.picture, LOOK_ALIKES[i] / 100.0, &mut random));
                self.render(&print, None, &mut random)
            }
        };
        let truth = h.outline(self.size.0, self.size.1);
        let found = search(&frame, self.model, self.options.profile, DEFAULT_THRESHOLD, true, slot)?;
        let mut seen = Seen { found: false, wrong: 0, triangles: Vec::new() };
        for (d, supporters) in found.detections.iter().zip(&found.supporters) {
            if usize::from(d.object) != self.index {
                continue;
            }
            if seen.found || corner_error(&d.corners, &truth) >= RIGHT {
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

    /// Renders a frame of `print` with one condition at a value and all others mild. Returns
    /// the frame, and the map from picture px to frame px.
    fn render(&self, print: &Print, set: Option<(Condition, f32)>, random: &mut Random) -> (Picture, Homography) {
        let profile = self.options.profile;
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
        match set {
            None => {}
            Some((Condition::Scale, value)) => pose.side_px = shown(Condition::Scale, value, profile),
            Some((Condition::Rotation, value)) => pose.rotation_deg = value,
            Some((Condition::Tilt, value)) => pose.tilt_deg = value,
            Some((Condition::Blur, value)) => exposure.blur_px = value,
            Some((Condition::Darkness, value)) => exposure.gain = value / 100.0,
            Some((Condition::Noise, value)) => exposure.noise = value,
        }
        let mut scene = Scene::dead_leaves(width, height, random);
        let pose = scene.somewhere(self.size, pose, random);
        let h = scene.lay(print, &pose);
        (scene.expose(&exposure, random), h)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A sweep of four views a cell; `found` gives the views found by condition and cell.
    pub(crate) fn sweep(found: impl Fn(Condition, usize) -> usize) -> Sweep {
        let row = |&(condition, values): &(Condition, &[f32])| Row {
            condition,
            cells: values.iter().enumerate().map(|(i, &value)| Cell { value, found: found(condition, i) }).collect(),
        };
        let taken = LOOK_ALIKES.iter().map(|&value| Cell { value, found: 0 }).collect();
        Sweep { views: 4, rows: SWEEP.iter().map(row).collect(), wrong: 0, heat: Heat::new(60, 40), taken }
    }
}
