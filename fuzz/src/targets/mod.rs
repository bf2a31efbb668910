//! The fuzz targets. Each is a function of the fuzzer's bytes that must not panic, whatever they are.

mod finder;
mod frame;
mod model;
mod picture;
mod points;
mod sequence;
mod file;
mod request;
mod stream;

pub use file::file;
pub use finder::finder;
pub use frame::frame;
pub use model::model;
pub use picture::picture;
pub use points::points;
pub use request::request;
pub use sequence::sequence;
pub use stream::stream;

/// A target: its name, and its function.
pub type Target = (&'static str, fn(&[u8]));

/// All targets.
pub const ALL: [Target; 9] = [
    ("model", model),
    ("frame", frame),
    ("points", points),
    ("finder", finder),
    ("picture", picture),
    ("sequence", sequence),
    ("file", file),
    ("request", request),
    ("stream", stream),
];
