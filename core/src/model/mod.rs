//! From pictures to the bytes of a model, and back to a view of them: methods and their
//! thresholds, the file format, parsing, training and packing.
//!
//! Rule: offsets of the format stand in `format` alone; whoever reads or writes a record
//! calls it.

pub mod method;
pub mod format;
pub mod parse;
pub mod table;
pub mod pack;
pub mod views;
pub mod train;
pub mod preset;
