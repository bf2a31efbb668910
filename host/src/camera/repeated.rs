//! Messages that come again and again, logged without filling the log.
//!
//! In: each message, and when it comes. Out: the text to log, if any: a message is told at
//! once, equal ones are counted, and their number is told every 10 seconds. Of messages that
//! differ, eight are told in 10 seconds.
//!
//! Memory: eight messages. Cost: a lock and a few comparisons a message.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Minimum time between two reports of one message.
const INTERVAL: Duration = Duration::from_secs(10);
/// Number of messages that are told apart.
const MOST: usize = 8;

/// The messages of one place.
#[derive(Debug, Default)]
pub struct Repeated(Mutex<Vec<Message>>);

#[derive(Debug)]
struct Message {
    text: String,
    told: Instant,
    /// Number of times that it came since it was told.
    untold: u64,
}

impl Repeated {
    /// Takes a message that comes at `now`. Returns the text to log.
    pub fn note(&self, text: &str, now: Instant) -> Option<String> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all.iter_mut().find(|m| m.text == text) {
            known.untold += 1;
            if now.duration_since(known.told) < INTERVAL {
                return None;
            }
            known.told = now;
            let times = std::mem::take(&mut known.untold);
            return Some(if times == 1 { text.to_string() } else { format!("{text} ({times} more times)") });
        }
        if all.len() == MOST {
            let oldest = (0..MOST).min_by_key(|&i| all[i].told)?;
            if now.duration_since(all[oldest].told) < INTERVAL {
                return None;
            }
            all.swap_remove(oldest);
        }
        all.push(Message { text: text.to_string(), told: now, untold: 0 });
        Some(text.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_messages_are_told_once_and_then_counted() {
        let (repeated, start) = (Repeated::default(), Instant::now());
        let after = |ms: u64| start + Duration::from_millis(ms);
        let told: Vec<_> = (0..=20_000).filter_map(|ms| repeated.note("cut", after(ms))).collect();
        assert_eq!(told, ["cut", "cut (10000 more times)", "cut (10000 more times)"]);
        assert_eq!(repeated.note("cut", after(40_000)).as_deref(), Some("cut"));
    }

    #[test]
    fn messages_that_all_differ_do_not_fill_the_log() {
        let (repeated, start) = (Repeated::default(), Instant::now());
        let told = (0..5000).filter_map(|i| repeated.note(&i.to_string(), start + Duration::from_millis(i))).count();
        assert_eq!(told, MOST);
        assert_eq!(repeated.note("later", start + Duration::from_secs(11)).as_deref(), Some("later"));
    }
}
