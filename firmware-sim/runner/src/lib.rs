//! The emulated board from a laptop's side.
//!
//! - [`board`]: the boards that are modelled, and the firmware for them
//! - [`emulator`]: a firmware, a model and frames in, results and logs out
//! - [`tables`]: memory and cost in words

pub mod board;
pub mod emulator;
pub mod tables;
