//! This layer is the base of every other layer. It holds the fixed sizes, the counts of the stages,
//! arithmetic that gives equal results on all targets, sorting in a known stack, points, maps
//! of the plane and of lenses, what errors say, whether work goes on, and who shares it.
//!
//! Rule: nothing here knows an image, a model or a frame.

pub mod says;
pub mod pace;
pub mod crew;
pub mod capacity;
pub mod math;
pub mod sort;
pub mod geometry;
pub mod lens;
