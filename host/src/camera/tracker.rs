//! How the objects of the models stand: the states that a broker and the log are told.
//!
//! In: what a tracker says of the instances in a frame. Out: a state an object, that of
//! its instance that is known best.
//!
//! Memory: a byte an object. Cost: none to speak of.

use keygraph_core::track;

use crate::search::Found;

/// How an object stands; of several instances the greatest counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Not seen lately.
    Searching,
    /// Seen a moment ago, not now.
    Lost,
    /// Found by a search of this frame.
    Found,
    /// Seen in the frame before too.
    Tracked,
}

impl State {
    /// The name used in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Lost => track::State::Lost.name(),
            Self::Found => track::State::Found.name(),
            Self::Tracked => track::State::Tracked.name(),
        }
    }

    /// Whether it is in this frame.
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

/// The states of the model's objects after a frame that was tracked.
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
