//! From frame to frame: instances that keep their ids.
//!
//! Rule: what is followed is aligned to the model in every frame, never to the frame before.

pub mod track;
