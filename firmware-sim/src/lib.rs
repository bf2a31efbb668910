//! Parts that the emulated board and the laptop share, and parts that the firmware programs share.
//!
//! - [`wire`]: frames to the board, results from the board
//! - [`profile`]: the detector of the build
//! - [`sensor`]: the interface of a camera, and the loop that serves it
//! - [`learn`]: learns an object from the middle of a frame
//! - `board` (built for the board only): clock, flash, memory and files of the emulated board
//! - `search` (built for the board only): searches the frames that come from the laptop

#![no_std]

pub mod wire;
pub mod profile;
pub mod sensor;
pub mod learn;
#[cfg(target_os = "none")]
pub mod board;
#[cfg(target_os = "none")]
pub mod search;
