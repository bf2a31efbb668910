//! The states of the models' objects, for the broker and the log.
//!
//! In: the instances that a tracker reports in a frame. Out: one state an object: the
//! greatest of its instances.
//!
//! Memory: a byte an object. Cost: negligible.

use keygraph_core::State as CoreState;

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
            Self::Lost => CoreState::Lost.name(),
            Self::Found => CoreState::Found.name(),
            Self::Tracked => CoreState::Tracked.name(),
        }
    }

    /// Whether the object is in this frame.
    #[must_use]
    pub const fn is_seen(self) -> bool {
        matches!(self, Self::Found | Self::Tracked)
    }
}

impl From<CoreState> for State {
    fn from(state: CoreState) -> Self {
        match state {
            CoreState::Found => Self::Found,
            CoreState::Tracked => Self::Tracked,
            CoreState::Lost => Self::Lost,
        }
    }
}

/// The states of a model's objects after a frame.
#[must_use]
pub fn states(objects: usize, found: &Found) -> Vec<State> {
    let mut states = vec![State::Searching; objects];
    let mut note = |object: u16, state: CoreState| {
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
    use keygraph_core::{Detection, Homography, Stats};

    #[test]
    fn the_instance_that_is_known_best_speaks_for_the_object() {
        let of = |object: u16| Detection::new(object, &Homography::IDENTITY, [0.0; 2]);
        let seen = vec![(4, CoreState::Tracked), (7, CoreState::Found), (8, CoreState::Found)];
        let mut found = Found::new(vec![of(2), of(2), of(0)], Stats::default());
        found.tracking = Some(Tracking { seen, lost: Vec::new(), searched: true });
        assert_eq!(states(3, &found), [State::Found, State::Searching, State::Tracked]);
    }
}
