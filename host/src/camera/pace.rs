//! At most so many items a second, of items that come at any rate.
//!
//! In: times of items. Out: whether an item is taken. Over a while, items of any higher rate are
//! taken at the wanted rate, and not at the next lower divisor of theirs.
//!
//! Memory and cost: two numbers.

use std::time::{Duration, Instant};

/// Takes items, an interval apart in the mean.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    interval: Duration,
    /// The time of the next item; `None` before the first.
    due: Option<Instant>,
}

impl Pace {
    /// A pace of one item in each `interval`.
    #[must_use]
    pub const fn new(interval: Duration) -> Self {
        Self { interval, due: None }
    }

    /// Whether an item that comes at `now` is taken.
    pub fn takes(&mut self, now: Instant) -> bool {
        let due = self.due.unwrap_or(now);
        if now < due {
            return false;
        }
        self.due = Some((due + self.interval).max(now));
        true
    }

    /// Time from `now` until an item is taken again.
    #[must_use]
    pub fn left(&self, now: Instant) -> Duration {
        self.due.map_or(Duration::ZERO, |due| due.saturating_duration_since(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_higher_rate_becomes_the_wanted_one() {
        let start = Instant::now();
        for (fps, taken) in [(10, 100), (25, 250), (30, 250), (60, 250), (1000, 250)] {
            let mut pace = Pace::new(Duration::from_millis(40));
            let at = |i: u32| start + Duration::from_secs(10) * i / (10 * fps);
            let count = (0..10 * fps).filter(|&i| pace.takes(at(i))).count();
            assert!(count.abs_diff(taken) <= 2, "{count} of {fps} items a second in 10 s");
        }
    }

    #[test]
    fn a_pause_is_not_made_up_for() {
        let start = Instant::now();
        let mut pace = Pace::new(Duration::from_secs(1));
        assert!(pace.left(start).is_zero() && pace.takes(start));
        assert_eq!(pace.left(start), Duration::from_secs(1));
        let later = start + Duration::from_secs(100);
        let taken = (0..100).filter(|&i| pace.takes(later + Duration::from_millis(i))).count();
        assert!(taken <= 2, "{taken} items at once");
    }
}
