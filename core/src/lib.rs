//! x
#![no_std]
#[cfg(test)]
extern crate std;
pub mod capacity;
pub mod math;
pub mod geometry;
pub mod frame;
pub mod pyramid;
pub mod corners;
pub mod delaunay;
