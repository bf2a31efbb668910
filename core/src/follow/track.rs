//! Follows objects from frame to frame.
//!
//! In: the frames of one camera in order, and a model. Out: tracks. A track is an instance with an
//! id that it keeps.
//!
//! An instance that was seen in the frame before is aligned to the current frame (`align`). The
//! alignment starts where the motion of the instance leads. It needs only luma, and only of the
//! part of the frame that may show the instance. It costs about a fifth of a search. A frame is
//! searched (`detect`) in three cases:
//! - Nothing is in sight, and something has changed since the last search (`still`).
//! - An instance could not be followed for sure, or has been lost for less than [`LOST_FRAMES`].
//! - [`SEARCH_EVERY`](crate::SEARCH_EVERY) frames have passed since the last search and something has
//!   changed, so that new instances appear.
//!
//! One in [`RECHECK`](crate::RECHECK) frames is searched though nothing has changed. A search that the
//! observer stops goes on in the next frame (`schedule`): a budget lowers the rate at which new
//! instances appear, and not the rate of the frames.
//!
//! Every frame is aligned to the template and not to the frame before, so that errors do not add
//! up. To appear, an instance must reach the caller's threshold. To stay without a search, it must
//! score [`SURE`], and its support must be nearly that of the frame before ([`FADE`]). If it does
//! not, the frame is searched, and the result of the search counts. If the search finds nothing,
//! [`STAY`] of the threshold is enough, so that an instance that is half hidden does not flicker.
//! An instance that can neither be followed nor found is reported as lost.
//!
//! Memory: some 16 KB in [`Tracker`], beside the detector, whose buffers it uses. Cost: conversion
//! and pyramid of that part of luma, and some 50,000 bilinear samples for each track, a third more
//! on targets without vectors. Full: beyond [`TRACKS`] instances, those that have been lost longest
//! make room. When none is lost, a new instance is dropped and counted.

use heapless::Vec;

use crate::base::capacity::{DETECTIONS, Stage, id};
use crate::detect::appearance::Appearance;
use crate::detect::buffers::Profile;
use crate::detect::detection::Detection;
use crate::detect::detector::Detector;
use crate::detect::observer::{Observer, Stats, passed};
use crate::detect::search::Place;
use crate::follow::instance::{State, Track};
use crate::follow::schedule::{Schedule, Sought};
use crate::follow::sight::{Sight, follow, part_of};
use crate::image::frame::{Frame, FrameError};
use crate::model::parse::Model;

/// Maximum number of instances that are followed at once: as many as a frame holds.
pub const TRACKS: usize = DETECTIONS;

/// Number of frames for which an instance that is not seen is still reported as lost, and searched
/// for in every frame. It is a second of video.
pub const LOST_FRAMES: u32 = 30;

/// A frame, and what is sought in it.
struct Task<'a> {
    frame: &'a Frame<'a>,
    model: &'a Model<'a>,
    threshold: f32,
    sought: Sought,
}

/// Follows the instances that a [`Detector`] finds.
#[derive(Debug)]
pub struct Tracker {
    /// All tracks. Instances that are seen come first, best score first.
    tracks: Vec<Track, TRACKS>,
    next_id: u32,
    schedule: Schedule,
    /// Whether the last frame was searched.
    searched: bool,
    stats: Stats,
}

impl Default for Tracker {
    fn default() -> Self {
        Self::new()
    }
}

impl Tracker {
    /// Makes a tracker without tracks.
    #[must_use]
    pub const fn new() -> Self {
        Self { tracks: Vec::new(), next_id: 0, schedule: Schedule::NEW, searched: false, stats: Stats::EMPTY }
    }

    /// Makes the tracker search the next frame, even if every instance is in sight.
    pub const fn search_next(&mut self) {
        self.schedule.search_next();
    }

    /// Forgets all tracks, and what the frames so far have shown. Ids are not used again.
    pub fn reset(&mut self) {
        self.tracks.clear();
        self.schedule.reset();
    }

    /// Follows the objects of the model in the next frame, and searches the frame where needed.
    /// Returns all instances: first those that are seen, best score first, then those that are
    /// lost. `threshold` is the minimum score at which an instance appears. `observer` is asked for
    /// the time between the stages, and is shown what a search makes.
    ///
    /// When `observer` stops a search ([`Observer::goes_on`]), the piece of the search that has begun
    /// comes to its end; the longest finds the corners and triangles of the finest level. A
    /// search that was stopped ([`Stats::stopped`]) goes on in the next frame: where nothing is in
    /// sight, with what it has gathered, in the frame that it has begun with; what it finds there is
    /// followed into the newest frame. Where something is followed, the next part of the next frame is
    /// searched. What is known is followed in every frame, however short the time is. The detector
    /// must not be used for anything else meanwhile; if it is, the search begins anew.
    ///
    /// # Errors
    /// Returns [`FrameError::TooLarge`] when the frame exceeds the profile of the detector. Nothing
    /// has changed then.
    pub fn track<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        frame: &Frame<'_>,
        model: &Model<'_>,
        threshold: f32,
        observer: &mut dyn Observer,
    ) -> Result<&[Track], FrameError> {
        detector.check(frame)?;
        let sought = Sought::new(detector, model, threshold);
        let pending = self.schedule.take_pending(detector, &sought).filter(|_| self.is_searching());
        self.schedule.count();
        let task = Task { frame, model, threshold, sought };
        match pending {
            Some(place) => self.go_on(detector, place, &task, observer)?,
            None => self.look(detector, &task, observer)?,
        }
        self.settle();
        Ok(&self.tracks)
    }

    /// Follows the tracks into a frame, and searches it where needed.
    fn look<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        task: &Task<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), FrameError> {
        let &Task { frame, model, threshold, sought } = task;
        let lost = self.tracks.iter().any(|t| t.state == State::Lost);
        let due = self.is_searching() || lost || self.schedule.is_due();
        let mut corner = [0.0; 2];
        if due {
            detector.load_frame(frame, observer)?;
        } else {
            corner = self.load_part(detector, task, observer)?;
        }
        // The model may differ from the model of the frame before.
        self.tracks.retain(|t| usize::from(t.detection.object) < model.objects());
        let start = observer.now();
        let gone = self.follow_all(&Sight { view: detector.frame(), corner }, model, threshold);
        let following = passed(start, observer.now());
        self.stats = Stats::EMPTY;
        if gone && !due {
            self.stats = *detector.stats();
            detector.load_frame(frame, observer)?;
        }
        let is_doubtful = lost || gone;
        self.searched = is_doubtful || due && self.schedule.may_be_new(&detector.frame(), &sought);
        if self.searched {
            let place = self.schedule.start();
            self.search(detector, place, task, observer);
        }
        self.stats.add(detector.stats());
        self.stats.ticks[Stage::Accept as usize] += following;
        Ok(())
    }

    /// Goes on with a search of an earlier frame. Where it has found something, that is followed into
    /// this frame; if that fails, it has not appeared.
    fn go_on<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        place: Place,
        task: &Task<'_>,
        observer: &mut dyn Observer,
    ) -> Result<(), FrameError> {
        let &Task { model, threshold, .. } = task;
        self.tracks.iter_mut().for_each(Track::begin_frame);
        detector.restart_stats();
        let first = self.next_id;
        self.search(detector, place, task, observer);
        self.searched = true;
        self.stats = *detector.stats();
        if self.tracks.iter().any(|t| t.seen) {
            let corner = self.load_part(detector, task, observer)?;
            let sight = Sight { view: detector.frame(), corner };
            let start = observer.now();
            for t in self.tracks.iter_mut().filter(|t| t.seen) {
                t.state = State::Found;
                match follow(&sight, model, t, threshold) {
                    Some(d) => t.take(d),
                    None => t.seen = false,
                }
            }
            self.tracks.retain(|t| t.seen || t.id < first);
            self.stats.add(detector.stats());
            self.stats.ticks[Stage::Accept as usize] += passed(start, observer.now());
        }
        Ok(())
    }

    /// Loads the luma of the part of a frame that may show the tracks. Returns the first pixel of the part.
    fn load_part<P: Profile + ?Sized>(
        &self,
        detector: &mut Detector<P>,
        task: &Task<'_>,
        observer: &mut dyn Observer,
    ) -> Result<[f32; 2], FrameError> {
        let part = part_of(&self.tracks, task.frame, task.model);
        detector.load_luma(task.frame, part, observer)?;
        Ok([part.x, part.y].map(|start| f32::from(id(start))))
    }

    /// Searches the frame in the detector from this place on. Takes over what has been found, and notes how
    /// the search goes on.
    fn search<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        mut place: Place,
        task: &Task<'_>,
        observer: &mut dyn Observer,
    ) {
        let &Task { model, threshold, sought, .. } = task;
        let plan = detector.plan(model, threshold);
        if detector.go_on(model, (&plan, &mut place), observer) {
            self.schedule.searched_all(&detector.frame(), &sought);
        } else {
            // What has been found is told now, and not when the search is over.
            let tile = place.tiles();
            let found = detector.finish(model, (&plan, &mut place), observer);
            if found || self.tracks.iter().any(|t| t.seen) {
                self.schedule.stopped_at(tile, plan.wants_tiles(usize::MAX));
            } else {
                self.schedule.keep(detector, place, &sought);
            }
        }
        self.merge(detector.detections());
    }

    /// Returns all instances of the last frame, in the order in which [`Tracker::track`] returned
    /// them.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Returns whether no instance is in sight, so that every frame is searched.
    #[must_use]
    pub fn is_searching(&self) -> bool {
        self.tracks.iter().all(|t| t.state == State::Lost)
    }

    /// Returns whether the last frame was searched.
    #[must_use]
    pub const fn searched(&self) -> bool {
        self.searched
    }

    /// Returns what the stages did with the last frame. Alignment counts as [`Stage::Accept`].
    #[must_use]
    pub const fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Follows every track. Returns true when a track that was seen in the frame before is not
    /// followed for sure any more.
    fn follow_all(&mut self, sight: &Sight<'_>, model: &Model<'_>, threshold: f32) -> bool {
        let mut gone = false;
        for t in &mut self.tracks {
            t.begin_frame();
            if let Some(d) = follow(sight, model, t, threshold) {
                t.sure = t.is_sure(&d);
                t.take(d);
            }
            gone |= t.state != State::Lost && !t.is_certain();
        }
        gone
    }

    /// Gives each detection of this frame to the track that it belongs to, or to a new track.
    fn merge(&mut self, detections: &[Detection]) {
        const { assert!(DETECTIONS <= 64, "a bit for each detection: widen `taken`") };
        // Detections that confirm a track come first, so that no other detection takes the track.
        let taken = detections.iter().enumerate().fold(0u64, |t, (i, d)| t | u64::from(self.confirm(d)) << i);
        for (_, d) in detections.iter().enumerate().filter(|(i, _)| taken >> i & 1 == 0) {
            self.assign(d);
        }
    }

    /// Returns whether a track has been followed to the place of this detection. The detection then
    /// counts as evidence for that track.
    fn confirm(&mut self, d: &Detection) -> bool {
        let Some(t) = self.tracks.iter_mut().find(|t| t.seen && t.detection.is_twin(d)) else { return false };
        // A second detection on the same track adds nothing.
        if !t.claimed {
            t.claimed = true;
            let aligned = t.detection;
            let better = if d.appearance.support > aligned.appearance.support { d } else { &aligned };
            t.take(Detection {
                score: d.score.max(aligned.score),
                votes: d.votes,
                agreeing: d.agreeing,
                appearance: Appearance { chroma: d.appearance.chroma, ..better.appearance },
                ..*better
            });
        }
        true
    }

    /// Gives a detection to the nearest track of its object that was not followed for sure. Without
    /// such a track it makes a new one.
    fn assign(&mut self, d: &Detection) {
        let [x, y] = middle(d);
        let distance = |t: &Track| {
            let [u, v] = middle(&t.detection);
            (u - x) * (u - x) + (v - y) * (v - y)
        };
        let nearest = self
            .tracks
            .iter_mut()
            .filter(|t| t.detection.object == d.object)
            .filter(|t| !t.is_certain())
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(t) = nearest {
            t.claimed = true;
            t.take(*d);
            return;
        }
        let new = Track {
            id: self.next_id,
            state: State::Lost,
            detection: *d,
            unseen: 1,
            before: None,
            seen: true,
            sure: false,
            claimed: true,
        };
        if self.tracks.is_full() {
            // The track that has been lost longest makes room.
            let oldest =
                (0..self.tracks.len()).max_by_key(|&i| self.tracks[i].unseen + u32::from(!self.tracks[i].seen));
            match oldest.filter(|&i| !self.tracks[i].seen) {
                Some(i) => drop(self.tracks.swap_remove(i)),
                None => {
                    self.stats.stages[Stage::Accept as usize].dropped += 1;
                    return;
                }
            }
        }
        if self.tracks.push(new).is_ok() {
            self.next_id = self.next_id.wrapping_add(1);
        }
    }

    /// Sets the states of this frame from what was seen in it.
    fn settle(&mut self) {
        for t in &mut self.tracks {
            t.state = match (t.seen, t.unseen) {
                (true, 0) => State::Tracked,
                (true, _) => State::Found,
                (false, _) => State::Lost,
            };
            t.unseen = if t.seen { 0 } else { t.unseen + 1 };
        }
        self.tracks.retain(|t| t.unseen <= LOST_FRAMES);
        self.tracks.sort_unstable_by(|a, b| {
            let key = |t: &Track| if t.seen { t.detection.score } else { -(t.unseen as f32) };
            key(b).total_cmp(&key(a))
        });
        // Two tracks that have run onto one instance are one track. The better one stays.
        let mut i = 0;
        while i < self.tracks.len() {
            let twin = |t: &Track| t.seen == self.tracks[i].seen && t.detection.is_twin(&self.tracks[i].detection);
            if self.tracks[..i].iter().any(twin) {
                self.tracks.remove(i);
            } else {
                i += 1;
            }
        }
    }
}

/// Returns the middle of an outline, frame px.
fn middle(d: &Detection) -> [f32; 2] {
    [0, 1].map(|i| d.corners.iter().map(|c| c[i]).sum::<f32>() / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::detector::{DEFAULT_THRESHOLD, QqvgaDetector};
    use crate::extract::feature::FeatureKind;
    use crate::follow::schedule::SEARCH_EVERY;
    use crate::image::pixels::PixelFormat;
    use crate::model::method::Method;
    use crate::model::train::{QqvgaTrainer, TrainParams};
    use crate::model::views::ViewSpec;
    use std::prelude::rust_2024::*;
    use std::vec;
    use std::vec::Vec;

    const W: usize = 160;
    const H: usize = 120;

    /// Returns the brightness of a picture of `W` x `H` px. The picture has random blocks of 10 px.
    fn blocks(x: usize, y: usize) -> u8 {
        let mut seed = (y / 10 * 16 + x / 10) as u32 + 1;
        for _ in 0..3 {
            seed = (seed ^ seed >> 15).wrapping_mul(0x2c1b_3c6d);
        }
        (seed >> 24) as u8
    }

    fn model() -> Vec<u8> {
        let picture: Vec<u8> = (0..W * H).map(|i| blocks(i % W, i / W)).collect();
        let view = |side_px| ViewSpec { side_px, squeeze: 1.0, direction_deg: 0.0, keypoints: 60 };
        let views = [view(96.0), view(80.0)];
        let params = TrainParams::new("blocks", Method::Keygraph, FeatureKind::Luma, &views).capped(4000, 100);
        let mut bytes = vec![0; 128 << 10];
        let frame = Frame::new(PixelFormat::Gray8, W, H, &picture).unwrap();
        let mut trainer: Box<QqvgaTrainer> = Box::default();
        let trained = trainer.train(&frame, (160, 120), &params, &mut bytes).unwrap();
        bytes.truncate(trained.bytes);
        bytes
    }

    /// Makes a frame that shows the picture at 0.6 of its size, with its corner at each of these
    /// places, on gray.
    fn frame(places: &[[f32; 2]]) -> Vec<u8> {
        let mut bytes = vec![128; W * H];
        for (i, v) in bytes.iter_mut().enumerate() {
            for p in places {
                let at = [(i % W) as f32 - p[0], (i / W) as f32 - p[1]].map(|v| v / 0.6);
                if at[0] >= 0.0 && at[1] >= 0.0 && at[0] < W as f32 && at[1] < H as f32 {
                    *v = blocks(at[0] as usize, at[1] as usize);
                }
            }
        }
        bytes
    }

    struct Run {
        model: Vec<u8>,
        detector: Box<QqvgaDetector>,
        tracker: Tracker,
    }

    impl Run {
        fn new() -> Self {
            Self { model: model(), detector: Box::default(), tracker: Tracker::new() }
        }

        fn step(&mut self, places: &[[f32; 2]]) -> Vec<Track> {
            self.look(&frame(places), DEFAULT_THRESHOLD)
        }

        fn look(&mut self, bytes: &[u8], threshold: f32) -> Vec<Track> {
            let frame = Frame::new(PixelFormat::Gray8, W, H, bytes).unwrap();
            let model = Model::parse(&self.model).unwrap();
            self.tracker.track(&mut self.detector, &frame, &model, threshold, &mut || 0).unwrap().to_vec()
        }
    }

    /// Makes a frame in which the object is hidden from row `from` on.
    fn covered(from: usize) -> Vec<u8> {
        let mut bytes = frame(&[[30.0, 20.0]]);
        bytes[from * W..].fill(128);
        bytes
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn what_moves_is_found_once_and_then_followed() {
        let mut run = Run::new();
        let mut searched = 0;
        for i in 0..20u8 {
            let x = 5.0 + 2.5 * f32::from(i);
            let tracks = run.step(&[[x, 20.0]]);
            assert_eq!(tracks.len(), 1, "frame {i}: {tracks:?}");
            let t = &tracks[0];
            assert_eq!((t.id, t.state), (0, if i == 0 { State::Found } else { State::Tracked }), "frame {i}");
            let [u, v] = t.detection.corners[0];
            assert!((u - x).abs() < 1.0 && (v - 20.0).abs() < 1.0, "frame {i}: {u} {v} for {x} 20");
            searched += u32::from(run.tracker.searched());
        }
        assert_eq!(searched, 2, "the first frame and one in {SEARCH_EVERY}");
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn what_goes_is_lost_at_once_and_forgotten_after_a_while() {
        let mut run = Run::new();
        let _ = run.step(&[[30.0, 20.0]]);
        for unseen in 1..=LOST_FRAMES {
            let tracks = run.step(&[]);
            assert_eq!(tracks.iter().map(|t| (t.state, t.unseen)).collect::<Vec<_>>(), [(State::Lost, unseen)]);
            assert!(run.tracker.is_searching() && run.tracker.searched());
        }
        assert!(run.step(&[]).is_empty());
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn what_comes_back_elsewhere_keeps_its_id() {
        let mut run = Run::new();
        let _ = run.step(&[[5.0, 5.0]]);
        let _ = run.step(&[]);
        let tracks = run.step(&[[60.0, 45.0]]);
        assert_eq!(tracks.iter().map(|t| (t.id, t.state)).collect::<Vec<_>>(), [(0, State::Found)]);
        assert_eq!(run.step(&[[60.0, 45.0]])[0].state, State::Tracked);
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn what_suddenly_looks_less_alike_is_searched_once() {
        let mut run = Run::new();
        let searched = [covered(H), covered(H), covered(60), covered(60)].map(|bytes| {
            let tracks = run.look(&bytes, DEFAULT_THRESHOLD);
            assert_eq!(tracks.iter().map(|t| (t.id, t.unseen)).collect::<Vec<_>>(), [(0, 0)]);
            run.tracker.searched()
        });
        assert_eq!(searched, [true, false, true, false]);
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn a_frame_is_searched_when_that_is_asked_for() {
        let mut run = Run::new();
        let _ = run.step(&[[5.0, 5.0]]);
        run.tracker.search_next();
        assert_eq!(run.step(&[[5.0, 5.0]])[0].state, State::Tracked);
        assert!(run.tracker.searched());
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn what_would_not_appear_may_stay() {
        // The threshold lies between the score of the object mostly hidden and the score of all of
        // it.
        let score = |bytes: &[u8]| Run::new().look(bytes, 0.1)[0].detection.score;
        let (half, whole) = (score(&covered(40)), score(&covered(H)));
        let threshold = (half + whole) / 2.0;
        assert!(half < threshold && threshold < whole, "{half} {whole}");
        assert!(Run::new().look(&covered(40), threshold).is_empty(), "too little to appear");
        let mut run = Run::new();
        let _ = run.look(&covered(H), threshold);
        for i in 0..3 {
            let tracks = run.look(&covered(40), threshold);
            assert_eq!(tracks.iter().map(|t| t.state).collect::<Vec<_>>(), [State::Tracked], "frame {i}");
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "learns, and searches whole frames: hours")]
    fn a_frame_that_is_too_large_changes_nothing() {
        let mut run = Run::new();
        let _ = run.step(&[[5.0, 5.0]]);
        let bytes = vec![0; 2 * W * H];
        let frame = Frame::new(PixelFormat::Gray8, 2 * W, H, &bytes).unwrap();
        let model = Model::parse(&run.model).unwrap();
        let result = run.tracker.track(&mut run.detector, &frame, &model, DEFAULT_THRESHOLD, &mut || 0);
        assert!(matches!(result, Err(FrameError::TooLarge { .. })));
        assert_eq!(run.tracker.tracks()[0].state, State::Found);
    }
}
