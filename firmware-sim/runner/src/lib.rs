//! The emulated board from a laptop's side.
//!
//! - [`board`]: the boards that are modelled, and the firmware for them
//! - [`emulator`]: a firmware, a model and frames in, results and logs out
//! - [`sample`]: the model and the frames to show it with
//! - [`tables`]: memory and cost in words
//! - [`baseline`]: memory and cost as they were, to compare with

pub mod board;
pub mod emulator;
pub mod sample;
pub mod tables;
pub mod baseline;
