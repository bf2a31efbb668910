//! This layer follows objects from frame to frame, so that instances keep their ids.
//!
//! Rule: an instance is aligned to the model in every frame, never to the frame before.

pub mod instance;
pub mod sight;
pub mod still;
pub mod schedule;
pub mod track;
pub mod bent;
