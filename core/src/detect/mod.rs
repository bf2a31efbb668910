//! From the keygraphs of a frame to the objects in it: matches, votes, candidates, grown and
//! aligned poses, and what speaks for them.
//!
//! Rule: the stages take slices and views; `detector` alone owns buffers and knows their sizes.

pub mod classify;
pub mod verify;
pub mod vote;
pub mod hough;
pub mod pose;
pub mod overlay;
pub mod appearance;
pub mod align;
pub mod detection;
pub mod observer;
pub mod finder;
pub mod plan;
pub mod scene;
pub mod evidence;
pub mod search;
pub mod buffers;
pub mod detector;
pub mod digest;
