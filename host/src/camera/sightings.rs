//! When each object was seen last.
//!
//! In: the states of all objects after each frame. Out: the objects that were seen last, newest
//! first, with the time since. An object whose model is removed is forgotten.
//!
//! Memory: a name for each object that was seen. Cost: a look-up for each object in view.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::tracker::State;

/// Maximum number of objects that are told.
const MOST_TOLD: usize = 12;

/// The time at which each object was seen last.
#[derive(Debug, Default)]
pub struct Sightings {
    /// The models that the objects are of.
    generation: u64,
    times: HashMap<String, Instant>,
}

impl Sightings {
    /// Notes the states of all objects of the models `generation` at `now`.
    pub fn note(&mut self, generation: u64, objects: &[(String, State, Option<f32>)], now: Instant) {
        if std::mem::replace(&mut self.generation, generation) != generation {
            self.times.retain(|name, _| objects.iter().any(|o| o.0 == *name));
        }
        for (name, ..) in objects.iter().filter(|o| o.1.is_seen()) {
            match self.times.get_mut(name) {
                Some(time) => *time = now,
                None => _ = self.times.insert(name.clone(), now),
            }
        }
    }

    /// The objects that were seen last, newest first, and the time since, at `now`.
    #[must_use]
    pub fn last(&self, now: Instant) -> Vec<(String, Duration)> {
        let mut all: Vec<_> =
            self.times.iter().map(|(name, &time)| (now.saturating_duration_since(time), name)).collect();
        all.sort_unstable();
        all.truncate(MOST_TOLD);
        all.into_iter().map(|(since, name)| (name.clone(), since)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(name: &str, state: State) -> (String, State, Option<f32>) {
        (name.into(), state, None)
    }

    #[test]
    fn the_last_that_was_seen_comes_first() {
        let (mut sightings, start) = (Sightings::default(), Instant::now());
        let after = |s| start + Duration::from_secs(s);
        let states = [("a", State::Tracked), ("b", State::Found), ("c", State::Lost), ("d", State::Searching)];
        sightings.note(1, &states.map(|(n, s)| object(n, s)), after(1));
        sightings.note(1, &[object("a", State::Lost), object("b", State::Tracked)], after(3));
        let told = |sightings: &Sightings| {
            sightings.last(after(4)).into_iter().map(|(n, t)| (n, t.as_secs())).collect::<Vec<_>>()
        };
        assert_eq!(told(&sightings), [("b".into(), 1), ("a".into(), 3)]);
        // The model of b is removed.
        sightings.note(2, &[object("a", State::Searching)], after(4));
        assert_eq!(told(&sightings), [("a".into(), 3)]);
        sightings.note(3, &[], after(4));
        assert!(told(&sightings).is_empty());
    }

    #[test]
    fn not_more_are_told_than_fit_a_page() {
        let (mut sightings, now) = (Sightings::default(), Instant::now());
        let objects: Vec<_> = (0..100).map(|i| object(&format!("{i}"), State::Found)).collect();
        sightings.note(1, &objects, now);
        assert_eq!(sightings.last(now).len(), MOST_TOLD);
    }
}
