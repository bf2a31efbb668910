//! The cores of a processor that search one frame together.
//!
//! In: pieces of work. Out: the same pieces, done. Who knows the cores (an operating system, the
//! firmware of a chip with two) implements [`Crew`]; a search asks it where work can be shared. Results
//! do not depend on who did what. Memory and cost: those of the caller's threads. Without the feature `crew`
//! nothing: [`Team`] is then a type without a value, and what needs one is not compiled.

use core::ops::Range;
#[cfg(feature = "crew")]
use core::sync::atomic::{AtomicUsize, Ordering};

use crate::base::pace::Pace;

/// Cores that share the work of one search, with the feature `crew`: `Detector::set_crew`.
pub trait Crew: Sync + core::fmt::Debug {
    /// Whether another core is free now.
    fn is_free(&self) -> bool;

    /// Calls `mine` on the caller's core, and `others` on every other core that is free. Each call takes
    /// parts of what is to be done until nothing is left; `mine` alone would do it all. Returns when all calls
    /// have returned: what they wrote can then be read on the caller's core.
    fn all(&self, mine: &mut dyn FnMut(), others: &(dyn Fn() + Sync));

    /// Does `mine` on the caller's core, and `other` on another one meanwhile; one after the other when no
    /// other core is free. Returns when both are done, as above.
    fn both(&self, mine: &mut dyn FnMut(), other: &mut (dyn FnMut() + Send));
}

/// A crew. Without the feature there is none.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Team {
    #[cfg(not(feature = "crew"))]
    nobody: core::convert::Infallible,
    /// The crew itself.
    pub(crate) crew: &'static dyn Crew,
}

impl Team {
    /// Has `work` done for all of `range`, in pieces of `size`, by all cores that are free. When `pace` says
    /// so, they stop, and the rest is not done.
    pub(crate) fn share(
        self,
        range: Range<usize>,
        size: usize,
        pace: &mut dyn Pace,
        work: &(dyn Fn(Range<usize>) + Sync),
    ) {
        #[cfg(feature = "crew")]
        {
            let next = AtomicUsize::new(range.start);
            let take = || {
                let start = next.fetch_add(size, Ordering::Relaxed);
                if start < range.end {
                    work(start..range.end.min(start + size));
                }
                start < range.end
            };
            let mut mine = || {
                while pace.goes_on() && take() {}
                // Whoever comes now finds nothing.
                next.store(range.end, Ordering::Relaxed);
            };
            self.crew.all(&mut mine, &|| while take() {});
        }
        #[cfg(not(feature = "crew"))]
        {
            let _ = (range, size, pace, work);
            match self.nobody {}
        }
    }
}
