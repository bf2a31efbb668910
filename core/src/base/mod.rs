//! What every other layer stands on: the fixed sizes and the counts of the stages, the
//! arithmetic that is equal on all targets, sorting in known stack, points and plane maps.
//!
//! Rule: nothing here knows an image, a model or a frame.

pub mod capacity;
pub mod math;
pub mod sort;
pub mod geometry;
