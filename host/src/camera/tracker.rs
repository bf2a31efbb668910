//! From frame to frame: what is found, and what was.
//!
//! In: a frame and a model. Out: detections, each with a state, and the objects that
//! were seen a moment ago and are not now. Each frame is searched anew; a tracker of
//! poses takes its place in [`Tracker::next`] and nowhere else.
//!
//! Memory: two numbers an object. Cost: a search.

use anyhow::Result;
use keygraph_core::model::Model;

use crate::input::Picture;
use crate::search::{Found, Profile, search};

/// Frames after the last detection during which an object counts as lost; then it is
/// searched like one that never was there.
const LOST_FRAMES: u64 = 30;

/// What is known of an object or a detection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Not seen lately.
    Searching,
    /// Found by a search of this frame.
    Found,
    /// Followed from the frame before.
    Tracked,
    /// Seen a moment ago, not now.
    Lost,
}

impl State {
    /// The name used in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Found => "found",
            Self::Tracked => "tracked",
            Self::Lost => "lost",
        }
    }
}

/// How frames are looked at.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Size of the detector.
    pub profile: Profile,
    /// Least score of a detection.
    pub threshold: f32,
    /// Whether corners and triangles are wanted too.
    pub details: bool,
}

/// What is known after a frame.
#[derive(Debug)]
pub struct Tracked {
    /// The detections of this frame, best score first, and how they came about.
    pub found: Found,
    /// The state of each detection.
    pub states: Vec<State>,
    /// The state of each object of the model.
    pub objects: Vec<State>,
}

/// Carries what is known from frame to frame, for one model.
#[derive(Debug)]
pub struct Tracker {
    frame: u64,
    /// The last frame that showed each object.
    seen: Vec<Option<u64>>,
}

impl Tracker {
    /// Knows nothing yet of `objects` objects.
    #[must_use]
    pub fn new(objects: usize) -> Self {
        Self { frame: 0, seen: vec![None; objects] }
    }

    /// Looks at the next frame.
    ///
    /// # Errors
    /// When the picture is too small.
    pub fn next(&mut self, picture: &Picture, model: &Model<'_>, look: &Look) -> Result<Tracked> {
        let found = search(picture, model, look.profile, look.threshold, look.details, 0)?;
        let states = vec![State::Found; found.detections.len()];
        let objects = self.note(found.detections.iter().map(|d| usize::from(d.object)));
        Ok(Tracked { found, states, objects })
    }

    /// Notes the objects of one frame and returns the state of all.
    fn note(&mut self, shown: impl Iterator<Item = usize>) -> Vec<State> {
        self.frame += 1;
        for object in shown {
            self.seen[object] = Some(self.frame);
        }
        let state = |seen: &Option<u64>| match seen.map(|at| self.frame - at) {
            Some(0) => State::Found,
            Some(ago) if ago <= LOST_FRAMES => State::Lost,
            _ => State::Searching,
        };
        self.seen.iter().map(state).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_found_lost_and_searched_again() {
        let mut tracker = Tracker::new(2);
        assert_eq!(tracker.note([].into_iter()), [State::Searching; 2]);
        assert_eq!(tracker.note([1].into_iter()), [State::Searching, State::Found]);
        for _ in 0..LOST_FRAMES {
            assert_eq!(tracker.note([].into_iter()), [State::Searching, State::Lost]);
        }
        assert_eq!(tracker.note([0].into_iter()), [State::Found, State::Searching]);
    }
}
