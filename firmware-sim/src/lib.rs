//! What the emulated board and the laptop beside it have in common, and what the
//! firmwares share.
//!
//! - [`wire`]: frames to the board, results from it
//! - [`profile`]: the detector of the build
//! - [`sensor`]: what a camera has to offer, and the loop that serves it
//! - [`learn`]: an object from the middle of a frame
//! - `board`, `search` (on the board only): the emulated board's clock, flash, memory
//!   and files; frames from them through the detector

#![no_std]

pub mod wire;
pub mod profile;
pub mod sensor;
pub mod learn;
#[cfg(target_os = "none")]
pub mod board;
#[cfg(target_os = "none")]
pub mod search;
