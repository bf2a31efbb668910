//! Damaged frames: counted, and reported without filling the log.
//!
//! In: each damaged frame. Out: their number; a warning at the first, the 10th, the 100th
//! and so on. Memory and cost: a number.

use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counts damaged frames.
#[derive(Debug, Default)]
pub struct Damage(AtomicU64);

impl Damage {
    /// Counts a damaged frame of `source`; `error` says what is wrong with it.
    pub fn note(&self, source: impl Display, error: &anyhow::Error) {
        match self.0.fetch_add(1, Ordering::Relaxed) + 1 {
            1 => tracing::warn!("{source}: a damaged frame is skipped, as others will be: {error:#}"),
            n if is_power_of_ten(n) => {
                tracing::warn!("{source}: {n} damaged frames so far, the last: {error:#}");
            }
            n => tracing::debug!("{source}: damaged frame {n}: {error:#}"),
        }
    }

    /// The number of damaged frames so far.
    pub fn count(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

fn is_power_of_ten(n: u64) -> bool {
    n > 0 && 10_u64.pow(n.ilog10()) == n
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_are_counted_and_few_are_told() {
        let told: Vec<u64> = (0..=1_000_000).filter(|&n| is_power_of_ten(n)).collect();
        assert_eq!(told, [1, 10, 100, 1000, 10_000, 100_000, 1_000_000]);
        let damage = Damage::default();
        for _ in 0..3 {
            damage.note("camera", &anyhow::anyhow!("cut"));
        }
        assert_eq!(damage.count(), 3);
    }
}
