//! The keygraphs of a frame become detections: matches, votes, candidates, grown and aligned poses,
//! and the evidence for each pose.
//!
//! Rule: the stages take slices and views. Only `detector` owns buffers, and only `buffers` knows
//! their sizes.

pub mod classify;
pub mod verify;
pub mod vote;
pub mod hough;
pub mod pose;
pub mod light;
pub mod overlay;
pub mod tint;
pub mod appearance;
pub mod align;
pub mod detection;
pub mod mosaic;
pub mod outline;
pub mod scrutiny;
pub mod bend;
pub mod cells;
pub mod surface;
pub mod matches;
pub mod belief;
pub mod observer;
pub mod finder;
pub mod help;
pub mod plan;
pub mod tile;
pub mod scene;
pub mod pairing;
pub mod evidence;
pub mod search;
pub mod buffers;
pub mod detector;
pub mod digest;
