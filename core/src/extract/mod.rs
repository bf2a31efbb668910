//! This layer turns planes of pixels into keygraphs with features. Its stages find corners, rank
//! them, join them by nested Delaunay triangulations, keep the thick scalene triangles, and
//! describe what these look like. Frames and training pictures go through the same code.
//!
//! Rule: nothing here knows a model.

pub mod strength;
pub mod corners;
pub mod rank;
pub mod delaunay;
pub mod keygraph;
pub mod feature;
