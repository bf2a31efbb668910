//! x
#![no_std]
#[cfg(test)]
extern crate std;
pub mod capacity;
pub mod math;
pub mod geometry;
pub mod frame;
pub mod shrink;
pub mod pyramid;
pub mod corners;
pub mod delaunay;
pub mod keygraph;
pub mod feature;
pub mod model;
pub mod write;
pub mod classify;
pub mod vote;
pub mod pose;
pub mod align;
pub mod method;
pub mod train;
pub mod detect;
