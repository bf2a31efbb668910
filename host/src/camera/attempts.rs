//! Attempts to guess the token: slowed and logged.
//!
//! In: the address that sent a wrong token. Out: how long the answer is held back: longer
//! with each failure, up to 5 s. An address with `MOST_HELD` answers held back gets no
//! other answer meanwhile, so that guessing is slow over many connections too. Somebody who
//! sends the right token does not wait.
//!
//! Memory: `MOST_ADDRESSES` addresses; the oldest is forgotten for a new one. Cost: a walk
//! over them a failure.

use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of addresses that are remembered.
const MOST_ADDRESSES: usize = 256;
/// Maximum number of answers to one address that are held back at a time.
const MOST_HELD: u32 = 4;
/// What each failure adds to the delay, and the maximum delay.
const DELAYS: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(5)];
/// Time without a failure after which an address starts anew.
const MEMORY: Duration = Duration::from_secs(600);

/// The addresses that sent wrong tokens.
#[derive(Clone, Debug, Default)]
pub struct Attempts(Arc<Mutex<Vec<Address>>>);

#[derive(Debug)]
struct Address {
    address: IpAddr,
    failures: u32,
    held: u32,
    last: Instant,
}

/// An answer that is held back; dropped when it is sent, or when nobody waits for it.
#[derive(Debug)]
pub struct Held {
    attempts: Attempts,
    address: IpAddr,
    /// Number of failures of the address so far.
    pub failures: u32,
    /// Time for which the answer is held back.
    pub delay: Duration,
}

impl Drop for Held {
    fn drop(&mut self) {
        if let Some(known) = self.attempts.lock().iter_mut().find(|a| a.address == self.address) {
            known.held = known.held.saturating_sub(1);
        }
    }
}

impl Attempts {
    fn lock(&self) -> MutexGuard<'_, Vec<Address>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether so many answers to this address are held back that it gets no other.
    #[must_use]
    pub fn is_barred(&self, address: IpAddr) -> bool {
        let address = network(address);
        self.lock().iter().any(|a| a.address == address && a.held >= MOST_HELD)
    }

    /// Counts a failure at `now`.
    #[must_use]
    pub fn fail(&self, address: IpAddr, now: Instant) -> Held {
        let address = network(address);
        let mut all = self.lock();
        let at = all.iter().position(|a| a.address == address).unwrap_or_else(|| {
            if all.len() >= MOST_ADDRESSES
                && let Some(oldest) = (0..all.len()).min_by_key(|&i| (all[i].held > 0, all[i].last))
            {
                all.swap_remove(oldest);
            }
            all.push(Address { address, failures: 0, held: 0, last: now });
            all.len() - 1
        });
        let known = &mut all[at];
        if now.duration_since(known.last) > MEMORY {
            known.failures = 0;
        }
        known.failures = known.failures.saturating_add(1);
        known.held += 1;
        known.last = now;
        let delay = (DELAYS[0] * known.failures.min(100)).min(DELAYS[1]);
        Held { attempts: self.clone(), address, failures: known.failures, delay }
    }
}

/// The part of an address that one user has: all of IPv4, the first half of IPv6.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() >> 64 << 64).into(),
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(n: u32) -> IpAddr {
        std::net::Ipv4Addr::from_bits(n).into()
    }

    #[test]
    fn failures_wait_longer_and_longer_and_not_many_at_a_time() {
        let (attempts, now) = (Attempts::default(), Instant::now());
        let delays: Vec<_> = (0..40).map(|_| attempts.fail(address(1), now).delay.as_millis()).collect();
        assert_eq!((&delays[..3], delays[39]), (&[250, 500, 750][..], 5000));
        assert!(!attempts.is_barred(address(1)), "no answer is held back any more");
        let held: Vec<_> = (0..MOST_HELD).map(|_| attempts.fail(address(1), now)).collect();
        assert!(attempts.is_barred(address(1)) && !attempts.is_barred(address(2)));
        drop(held);
        assert!(!attempts.is_barred(address(1)));
        assert_eq!(attempts.fail(address(1), now + MEMORY * 2).failures, 1, "it starts anew");
    }

    #[test]
    fn the_memory_is_bounded_and_a_network_is_one_address() {
        let (attempts, now) = (Attempts::default(), Instant::now());
        for n in 0..10_000 {
            let _ = attempts.fail(address(n), now + Duration::from_millis(n.into()));
        }
        assert_eq!(attempts.lock().len(), MOST_ADDRESSES);
        let [a, b, c] = ["2001:db8::1", "2001:db8::2", "2001:db8:0:1::1"].map(|a| network(a.parse().expect("parses")));
        assert!(a == b && b != c);
        assert_eq!(network("::ffff:1.2.3.4".parse().expect("parses")), address(0x0102_0304));
    }
}
