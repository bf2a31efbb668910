//! Many frames through the detectors: several at once, results in order.
//!
//! In: a [`Source`] of frames and a model. Out: one [`Outcome`] a frame, in the
//! order of the source, handed to the caller as soon as it and all before it are
//! there. Memory: at most two frames a thread are in flight.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::mpsc::{channel, sync_channel};
use std::thread;

use anyhow::{Context, Result};
use keygraph_core::model::Model;

use crate::annotate::{Canvas, Outline, colour, draw_corners, draw_label, draw_outline, draw_triangles};
use crate::input::{Kind, Picture, Source, SourceFrame};
use crate::search::{Found, MAX_THREADS, Profile, search};

/// How frames are searched.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size of the detector.
    pub profile: Profile,
    /// Least score of a detection.
    pub threshold: f32,
    /// Frames searched at once, 1 to [`MAX_THREADS`].
    pub threads: usize,
    /// Whether to draw what was found.
    pub annotate: bool,
}

/// What became of one frame.
#[derive(Debug)]
pub struct Outcome {
    /// The input it came from.
    pub source: String,
    /// Its index in a video.
    pub frame: u64,
    /// Still or video.
    pub kind: Kind,
    /// What was found, or why the frame could not be read.
    pub result: Result<Searched>,
}

/// A frame that was searched.
#[derive(Debug)]
pub struct Searched {
    /// Width and height, px.
    pub size: (u32, u32),
    /// What was found.
    pub found: Found,
    /// The frame with what was found drawn onto it, if asked for.
    pub canvas: Option<Canvas>,
}

/// As many threads as there are processors, within bounds.
#[must_use]
pub fn default_threads() -> usize {
    thread::available_parallelism().map_or(1, usize::from).min(MAX_THREADS)
}

/// Searches every frame of `source` and calls `each` with the outcomes in order;
/// an error of `each` ends the run.
///
/// # Errors
/// What `each` returned.
pub fn run(
    source: &mut Source,
    model: &Model<'_>,
    options: &Options,
    mut each: impl FnMut(Outcome) -> Result<()>,
) -> Result<()> {
    let threads = options.threads.clamp(1, MAX_THREADS);
    let (jobs, queue) = sync_channel::<(u64, SourceFrame)>(2 * threads);
    let queue = Mutex::new(queue);
    let (done, outcomes) = channel();
    thread::scope(|scope| {
        for slot in 0..threads {
            let (done, queue) = (done.clone(), &queue);
            scope.spawn(move || {
                loop {
                    let job = queue.lock().map_or(None, |q| q.recv().ok());
                    let Some((index, frame)) = job else { return };
                    if done.send((index, search_one(frame, model, options, slot))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(done);
        let mut waiting = BTreeMap::new();
        let (mut fed, mut emitted) = (0, 0);
        let mut ended = false;
        loop {
            while !ended && fed - emitted < 2 * threads as u64 {
                // The workers receive as long as this scope lives.
                ended = source.next().is_none_or(|frame| jobs.send((fed, frame)).is_err());
                fed += u64::from(!ended);
            }
            if fed == emitted {
                // Dropping the sender, at the end of the scope's closure, ends the workers.
                drop(jobs);
                return Ok(());
            }
            let (index, outcome) = outcomes.recv().context("a search thread ended early")?;
            waiting.insert(index, outcome);
            while let Some(outcome) = waiting.remove(&emitted) {
                emitted += 1;
                if let Err(e) = each(outcome) {
                    drop(jobs);
                    return Err(e);
                }
            }
        }
    })
}

fn search_one(frame: SourceFrame, model: &Model<'_>, options: &Options, slot: usize) -> Outcome {
    let SourceFrame { source, frame, kind, picture } = frame;
    let result = picture.and_then(|p| {
        let found = search(&p, model, options.profile, options.threshold, options.annotate, slot)
            .with_context(|| source.clone())?;
        let canvas = options.annotate.then(|| draw(&p, model, &found));
        Ok(Searched { size: (p.width, p.height), found, canvas })
    });
    Outcome { source, frame, kind, result }
}

/// The picture with corners, supporting keygraphs, outlines, names and scores.
#[must_use]
pub fn draw(picture: &Picture, model: &Model<'_>, found: &Found) -> Canvas {
    let mut canvas = Canvas::from_picture(picture);
    draw_corners(&mut canvas, &found.corners, [255, 255, 255]);
    let outlines: Vec<Outline> = found
        .detections
        .iter()
        .map(|d| Outline {
            corners: d.corners,
            label: format!("{} {:.2}", model.object(usize::from(d.object)).name, d.score),
            colour_index: usize::from(d.object),
        })
        .collect();
    for (triangles, o) in found.supporters.iter().zip(&outlines) {
        draw_triangles(&mut canvas, triangles, colour(o.colour_index));
    }
    for o in &outlines {
        draw_outline(&mut canvas, o);
    }
    for o in &outlines {
        draw_label(&mut canvas, o);
    }
    canvas
}
