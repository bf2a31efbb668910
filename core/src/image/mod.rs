//! From the bytes of a camera to planes of pixels: luma and chroma, whole and at half sizes.
//!
//! Rule: a view that exists is valid. Sizes are checked once, where a view is made.

pub mod frame;
pub mod shrink;
pub mod pyramid;
