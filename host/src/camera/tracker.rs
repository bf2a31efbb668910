//! The states of the models' objects, for the broker and the log.
//!
//! In: the instances that a tracker reports in a frame. Out: one state an object: the
//! greatest of its instances.
//!
//! Memory: a byte an object. Cost: negligible.

use keygraph_core::track;

use crate::search::Found;

/// The state of an object. With several instances, the greatest state counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// The object was not seen in the last second.
    Searching,
    /// The object was seen in the last second, but not in this frame.
    Lost,
    /// A search of this frame found the object.
    Found,
    /// The object was followed from the frame before into this frame.
    Tracked,
}

impl State {
    /// The name of the state in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Lost => track::State::Lost.name(),
            Self::Found => track::State::Found.name(),
            Self::Tracked => track::State::Tracked.name(),
        }
    }

    /// Whether the object is in this frame.
    #[must_use]
    pub const fn is_seen(self) -> bool {
        matches!(self, Self::Found | Self::Tracked)
    }
}

impl From<track::State> for State {
    fn from(state: track::State) -> Self {
        match state {
            track::State::Found => Self::Found,
            track::State::Tracked => Self::Tracked,
            track::State::Lost => Self::Lost,
        }
    }
}

/// The states of a model's objects after a frame.
#[must_use]
pub fn states(objects: usize, found: &Found) -> Vec<State> {
    let mut states = vec![State::Searching; objects];
    let mut note = |object: u16, state: track::State| {
        if let Some(s) = states.get_mut(usize::from(object)) {
            *s = State::from(state).max(*s);
        }
    };
    if let Some(tracking) = &found.tracking {
        found.detections.iter().zip(&tracking.seen).for_each(|(d, (_, state))| note(d.object, *state));
        tracking.lost.iter().for_each(|t| note(t.detection.object, t.state));
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Tracking;
    use keygraph_core::align::Appearance;
    use keygraph_core::detect::{Detection, Stats};
    use keygraph_core::geometry::Homography;

    #[test]
    fn the_instance_that_is_known_best_speaks_for_the_object() {
        let of = |object: u16| Detection {
            object,
            homography: Homography::IDENTITY,
            corners: [[0.0; 2]; 4],
            score: 0.9,
            votes: 0,
            agreeing: 0,
            appearance: Appearance::default(),
        };
        let seen = vec![(4, track::State::Tracked), (7, track::State::Found), (8, track::State::Found)];
        let mut found = Found::new(vec![of(2), of(2), of(0)], Stats::default());
        found.tracking = Some(Tracking { seen, lost: Vec::new(), searched: true });
        assert_eq!(states(3, &found), [State::Found, State::Searching, State::Tracked]);
    }
}
