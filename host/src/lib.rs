//! Pictures, videos and files around [`keygraph_core`]: formats, devices, pages.
//! No vision here.
//!
//! A file uses only files above it:
//!
//! - [`picture`], [`yuv4mpeg`]: pixels, and the files and streams that hold them
//! - [`input`]: pictures, folders, videos and streams as one sequence of frames
//! - [`annotate`], [`video`], [`progress`]: what is drawn, written and shown
//! - [`sensor`]: pixels as a camera's sensor would give them
//! - [`search`]: one frame into a detector of the right size
//! - [`trail`]: frames in order, and what was found followed through them
//! - [`margins`]: plain surroundings of a picture
//! - [`pose`]: where detections are in space
//! - [`learn`]: one picture into a model; models into one
//! - [`render`]: frames of pictures in poses that are known
//! - [`heat`]: which parts of a picture carry keygraphs
//! - [`assess`]: how well a picture will be found, before it is used
//! - [`mod@bench`]: what stages cost, in time and memory
//! - [`report`]: results as JSON
//! - [`run`], [`gallery`]: many frames at once, and where their pictures go
//! - [`camera`]: live, in front of a camera
//! - [`demo`]: the whole path on the pictures of the repository

pub mod picture;
pub mod yuv4mpeg;
pub mod input;
pub mod annotate;
pub mod video;
pub mod progress;
pub mod sensor;
pub mod search;
pub mod trail;
pub mod margins;
pub mod pose;
pub mod learn;
pub mod render;
pub mod heat;
pub mod assess;
pub mod bench;
pub mod report;
pub mod run;
pub mod gallery;
pub mod camera;
pub mod demo;
