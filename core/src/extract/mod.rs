//! From planes of pixels to keygraphs with features: corners, their ranking, nested Delaunay
//! triangulations, thick scalene triangles, and what these look like. Frames and training
//! pictures go through the same code.
//!
//! Rule: nothing here knows a model.

pub mod corners;
pub mod rank;
pub mod delaunay;
pub mod keygraph;
pub mod feature;
