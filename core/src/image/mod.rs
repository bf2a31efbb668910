//! This layer turns the bytes of a camera into planes of luma and chroma, at full size and at half
//! sizes.
//!
//! Rule: a view that exists is valid. Sizes are checked once, where a view is made.

pub mod exposure;
pub mod pixels;
pub mod frame;
pub mod shrink;
pub mod plane;
pub mod squeeze;
pub mod halve;
pub mod pyramid;
