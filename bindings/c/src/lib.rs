//! Keygraph for C. `include/keygraph.h` is made of this crate, and documents every function.
//!
//! In: pointers, lengths and numbers from C. Out: a [`kg_status`] from each function, and plain
//! structs. Memory: what the caller gives; no heap, no thread, and no function of libc but `memcpy`,
//! `memmove`, `memset` and `memcmp`. Cost: that of the core, and a few checks for each call.
//!
//! All `unsafe` of the boundary is in this crate. Pointers are checked in [`boundary`]: null,
//! alignment, length. Objects are made in the caller's memory in [`place`], never on the stack. Each
//! object begins with a tag and a flag, so that memory that holds no object and calls from within a
//! callback are refused. Numbers from C are integers here and never Rust enums, since C can pass any.
//!
//! No panic crosses the boundary: the library is built with `panic = "abort"`, and [`panics`] ends the
//! program, after a call of a function that the program may set.
#![no_std]
#![allow(non_camel_case_types, reason = "the names are those of the header")]
#![allow(clippy::missing_safety_doc, reason = "the header states the rules for pointers once, for all functions")]
#![allow(
    improper_ctypes_definitions,
    reason = "objects in the memory of the caller are opaque: C sees pointers to them"
)]

#[cfg(test)]
extern crate std;

mod boundary;
mod place;
mod panics;
mod status;
mod version;
mod frame;
mod model;
mod observer;
mod detection;
mod slot;
mod detector;
mod results;
mod tracker;
mod trainer;
mod pose;
mod sizes;

pub use detection::*;
pub use detector::*;
pub use frame::*;
pub use model::*;
pub use observer::*;
pub use panics::*;
pub use place::KG_ALIGNMENT;
pub use pose::*;
pub use results::*;
pub use status::*;
pub use tracker::*;
pub use trainer::*;
pub use version::*;
