//! Training pictures become the bytes of a model, and the bytes become a view of the model. The
//! files hold the methods and their thresholds, the file format, parsing, training and packing.
//!
//! Rule: the offsets of the format stand in `format` alone. All code that reads or writes a record
//! uses its fields.

pub mod method;
pub mod format;
pub mod parse;
pub mod table;
pub mod part;
pub mod pack;
pub mod slim;
pub mod views;
pub mod train;
pub mod preset;
