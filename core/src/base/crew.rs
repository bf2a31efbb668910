//! The cores of a processor that search one frame together.
//!
//! In: pieces of work. Out: the same pieces, done. Who knows the cores (an operating system, the
//! firmware of a chip with two) implements [`Crew`]; a search asks it where work can be shared. Results
//! do not depend on who did what. Memory and cost: those of the caller's threads.

/// Cores that share the work of one search, with the feature `crew`: `Detector::set_crew`.
pub trait Crew: Sync + core::fmt::Debug {
    /// Calls `mine` on the caller's core, and `others` on every other core that is free. Each call takes
    /// parts of what is to be done until nothing is left; `mine` alone would do it all. Returns when all calls
    /// have returned.
    fn all(&self, mine: &mut dyn FnMut(), others: &(dyn Fn() + Sync));

    /// Does `mine` on the caller's core, and `other` on another one meanwhile; one after the other when no
    /// other core is free. Returns when both are done.
    fn both(&self, mine: &mut dyn FnMut(), other: &mut (dyn FnMut() + Send));
}
