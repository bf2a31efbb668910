//! Pictures, videos and files around [`keygraph_core`]: no vision here.

pub mod input;
pub mod annotate;
pub mod video;
pub mod progress;
pub mod learn;
pub mod search;
pub mod report;
