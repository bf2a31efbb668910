//! Many frames through the detectors: several at once, with results in order.
//!
//! In: a [`Source`] of frames and a model. Out: one [`Outcome`] a frame, in the order of
//! the source. The caller gets it as soon as it and all before it are ready. With a
//! tracker, frames are searched one by one. Memory: at most two frames for each thread.
//! Cost: that of the search, divided by the threads.

use std::collections::BTreeMap;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::SystemTime;

use anyhow::{Context, Result, anyhow};
use keygraph_core::{Detection, Model};

use crate::annotate::{Canvas, Outline, colour, draw_axes, draw_corners, draw_outlines, draw_part, draw_triangles};
use crate::cutout::rectify;
use crate::input::{Kind, Pending, Picture, Source, SourceFrame};
use crate::lens::Optics;
use crate::output::plain;
use crate::pose::{Calibration, Place};
use crate::search::{Found, MAX_THREADS, Request};
use crate::trail::Trail;
use crate::wide::search_widely;

/// How frames are searched.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    /// How each frame is searched.
    pub request: Request,
    /// Number of threads, 1 to [`MAX_THREADS`]: each searches a frame. Of fewer pictures, and of a sequence that is
    /// tracked, each is searched by several.
    pub threads: usize,
    /// Whether to follow objects from frame to frame.
    pub track: bool,
    /// Whether to draw the results into the frames.
    pub annotate: bool,
    /// Whether to show each object as it looks flat.
    pub rectify: bool,
    /// The camera's lens, for frames of any size.
    pub optics: Option<Optics>,
    /// Widths, and intrinsics unless there is a lens; `None` when no poses are wanted.
    pub calibration: Option<&'a Calibration>,
}

/// The outcome of one frame.
#[derive(Debug)]
pub struct Outcome {
    /// The name of the input that the frame is from.
    pub source: String,
    /// Index of the frame in its video; 0 for a still.
    pub frame: u64,
    /// Still or video.
    pub kind: Kind,
    /// The time at which a frame of a live source came.
    pub time: Option<SystemTime>,
    /// The results, or why the frame could not be read or searched.
    pub result: Result<Searched>,
}

/// A frame that was searched.
#[derive(Debug)]
pub struct Searched {
    /// Width and height, px.
    pub size: (u32, u32),
    /// The results.
    pub found: Found,
    /// Where each detection is in space; `None` without a calibration.
    pub places: Option<Vec<Place>>,
    /// The frame with the results drawn onto it; `None` unless asked for.
    pub canvas: Option<Canvas>,
    /// Each object as it looks flat; empty unless asked for.
    pub flat: Vec<Picture>,
}

/// The number of processors, at most [`MAX_THREADS`].
#[must_use]
pub fn default_threads() -> usize {
    thread::available_parallelism().map_or(1, usize::from).min(MAX_THREADS)
}

/// Searches every frame of `source` and calls `each` with the outcomes in order. An error
/// of `each` ends the run.
///
/// # Errors
/// The error that `each` returned.
pub fn run(
    source: &mut Source,
    model: &Model<'_>,
    options: &Options<'_>,
    mut each: impl FnMut(Outcome) -> Result<()>,
) -> Result<()> {
    let threads = options.threads.clamp(1, MAX_THREADS);
    // When there are fewer pictures than threads, several threads search one of them.
    let pictures = source.len_hint().map_or(threads, |n| usize::try_from(n).unwrap_or(threads).clamp(1, threads));
    let sharing = if options.track { threads } else { threads / pictures };
    // Those without a frame of their own help where they can.
    let (helping, threads) = (threads, threads / sharing);
    let request = Request { threads: helping - threads + 1, ..options.request };
    let options = &Options { request, ..*options };
    let (jobs, queue) = channel::<(u64, Pending)>();
    let queue = Mutex::new(queue);
    let (done, outcomes) = channel();
    // A frame is read when there is a permit for it. The permit comes back with the outcome.
    let (permit, permits) = channel();
    for _ in 0..2 * threads {
        // The receiver lives in this function.
        let _ = permit.send(());
    }
    thread::scope(|scope| {
        scope.spawn(move || {
            // The reader has its own thread, since a live source makes it wait. The threads
            // that search decode the pictures.
            for (index, ()) in (0..).zip(permits) {
                let Some(frame) = source.next_pending() else { return };
                if jobs.send((index, frame)).is_err() {
                    return;
                }
            }
        });
        for slot in 0..threads {
            let (done, queue) = (done.clone(), &queue);
            scope.spawn(move || {
                let mut trail = options.track.then(Trail::default);
                while let Some((index, frame)) = queue.lock().map_or(None, |q| q.recv().ok()) {
                    let outcome =
                        search_safely(frame, model, options, slot * sharing..(slot + 1) * sharing, &mut trail);
                    if done.send((index, outcome)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(done);
        // Both ends move into the call and are dropped with it, even on an error: then all
        // threads end.
        in_order(outcomes, move |outcome| {
            each(outcome)?;
            // The reader has ended when the source has.
            let _ = permit.send(());
            Ok(())
        })
    })
}

/// Calls `each` with the numbered outcomes of a channel, in the order of their numbers from
/// 0.
fn in_order(outcomes: Receiver<(u64, Outcome)>, mut each: impl FnMut(Outcome) -> Result<()>) -> Result<()> {
    let mut waiting = BTreeMap::new();
    let mut next = 0;
    for (index, outcome) in outcomes {
        waiting.insert(index, outcome);
        while let Some(outcome) = waiting.remove(&next) {
            next += 1;
            each(outcome)?;
        }
    }
    Ok(())
}

/// What a tracker takes for one sequence: a video, or the pictures of a folder, with frames
/// of one size.
type Sequence = (PathBuf, (u32, u32));

fn sequence(source: &str, kind: Kind, size: (u32, u32)) -> Sequence {
    let path = Path::new(source);
    let of = if kind == Kind::Still { path.parent().unwrap_or(path) } else { path };
    (of.into(), size)
}

/// Calls [`search_one`]; a panic becomes an error of this frame alone.
fn search_safely(
    frame: Pending,
    model: &Model<'_>,
    options: &Options<'_>,
    slots: Range<usize>,
    trail: &mut Option<Trail<Sequence>>,
) -> Outcome {
    let ((source, index, kind), time) = (frame.place(), frame.time());
    catch_unwind(AssertUnwindSafe(|| search_one(frame.read(), model, options, slots, trail.as_mut()))).unwrap_or_else(
        |_| {
            let result = Err(anyhow!("{source}, frame {index}: the search failed; please report this frame"));
            Outcome { source, frame: index, kind, time, result }
        },
    )
}

fn search_one(
    frame: SourceFrame,
    model: &Model<'_>,
    options: &Options<'_>,
    slots: Range<usize>,
    trail: Option<&mut Trail<Sequence>>,
) -> Outcome {
    let SourceFrame { source, frame, kind, time, picture, .. } = frame;
    let result = picture.and_then(|p| {
        let lens = options.optics.map(|o| o.of_size(p.width, p.height)).transpose().with_context(|| source.clone())?;
        let request = Request { details: options.annotate, lens, ..options.request };
        let found = match trail {
            Some(trail) => trail.next(sequence(&source, kind, (p.width, p.height)), &p, model, &request, slots.start),
            None => search_widely(&p, model, &request, slots),
        }
        .with_context(|| source.clone())?;
        let calibration = options.calibration.map(|c| c.through(lens));
        let places = calibration.as_ref().map(|c| c.places(model, &found));
        let canvas = options.annotate.then(|| {
            let mut canvas = draw(&p, model, &found);
            if let (Some(calibration), Some(places)) = (&calibration, &places) {
                for (d, place) in found.detections.iter().zip(places) {
                    if let Some(pose) = &place.pose {
                        draw_axes(&mut canvas, calibration.axes(d, pose));
                    }
                }
            }
            canvas
        });
        let size = |d: &Detection| {
            let o = model.object(usize::from(d.object));
            (o.width, o.height)
        };
        let shown = found.detections.iter().enumerate().filter(|_| options.rectify);
        let flat = shown.map(|(i, d)| rectify(&p, d, found.surface(i), size(d))).collect();
        Ok(Searched { size: (p.width, p.height), found, places, canvas, flat })
    });
    Outcome { source, frame, kind, time, result }
}

/// Draws corners, supporting keygraphs, outlines, names and scores into a copy of `picture`, and the
/// border of what was searched if that was a part.
#[must_use]
pub fn draw(picture: &Picture, model: &Model<'_>, found: &Found) -> Canvas {
    let mut canvas = Canvas::from_picture(picture);
    if let Some(part) = found.part {
        draw_part(&mut canvas, part);
    }
    draw_corners(&mut canvas, &found.corners, [255, 255, 255]);
    let outlines = outlines(model, found);
    for (triangles, o) in found.supporters.iter().zip(&outlines) {
        draw_triangles(&mut canvas, triangles, colour(o.colour_index));
    }
    draw_outlines(&mut canvas, &outlines);
    canvas
}

/// The outlines of the detections of a frame, with name, id and score.
#[must_use]
pub fn outlines(model: &Model<'_>, found: &Found) -> Vec<Outline> {
    let outline = |(i, d): (usize, &Detection)| Outline {
        corners: d.corners,
        surface: found.surface(i).copied(),
        label: {
            let id = found.tracking.as_ref().map_or_else(String::new, |t| format!(" #{}", t.seen[i].0));
            format!("{}{id} {:.2}", plain(model.object(usize::from(d.object)).name), d.score)
        },
        colour_index: usize::from(d.object),
    };
    found.detections.iter().enumerate().map(outline).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_a_folder_and_frames_of_a_video_are_sequences() {
        const SIZE: (u32, u32) = (640, 480);
        let video = Kind::Video { fps: (25, 1) };
        let first = sequence("a/0001.png", Kind::Still, SIZE);
        assert_eq!(first, sequence("a/0002.png", Kind::Still, SIZE));
        assert_ne!(first, sequence("b/0002.png", Kind::Still, SIZE));
        assert_ne!(first, sequence("a/0002.png", Kind::Still, (480, 640)));
        assert_eq!(sequence("a.mp4", video, SIZE), sequence("a.mp4", video, SIZE));
        assert_ne!(sequence("a.mp4", video, SIZE), sequence("b.mp4", video, SIZE));
    }
}
