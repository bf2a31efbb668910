//! The laptop's side of the emulated board: builds the firmware, runs it, and reports its cost.
//!
//! - [`board`]: the modelled boards, and the firmware for them
//! - [`emulator`]: runs a firmware with a model and frames, and returns results and logs
//! - [`sample`]: the sample model, and the frames for it
//! - [`tables`]: memory and cost as tables
//! - [`baseline`]: memory and cost at the last measurement, for comparison

pub mod board;
pub mod emulator;
pub mod sample;
pub mod tables;
pub mod baseline;
