//! Pictures, videos, files and devices around [`keygraph_core`]. This package has no vision
//! of its own.
//!
//! A file uses only files above it:
//!
//! - [`clock`]: the time of day as text
//! - [`notice`]: errors and notices on standard error
//! - [`mod@file`]: which names stand for one file, and how a whole file is read
//! - `unfinished`: files that are not finished, and temporary ones
//! - `content`: what a file holds, by its first bytes and its name
//! - `ffmpeg`: the child process that decodes and encodes videos
//! - [`picture`], [`yuv4mpeg`], `pictures`: pixels, and the files and streams that hold them
//! - `stream`: a video, an address or standard input as frames
//! - [`input`]: pictures, folders, videos and streams as one sequence of frames
//! - [`output`]: lines on standard output, and files: whole, or as they were
//! - `ending`: the end of the program at a signal (with the feature `live`)
//! - [`canvas`], [`annotate`], [`video`], [`progress`]: what is drawn, written and shown
//! - [`sensor`]: pixels as a camera's sensor would give them
//! - [`region`]: the part of a frame that is searched
//! - [`request`]: how frames are searched
//! - `crew`: threads that search one frame together (with the feature `crew`)
//! - [`search`]: one frame through a detector of the right size
//! - [`wide`]: a picture searched for what is seen from far to the side, too
//! - [`trail`]: frames in order through a tracker
//! - [`margins`]: plain margins of a picture
//! - [`cutout`]: the object cut out of a picture, seen from the front
//! - [`mod@alike`]: objects that look alike
//! - [`lens`], `calibrate`, `lens_file`: the camera's lens; measured with a picture, read and written (the last two with
//!   the feature `calibrate`)
//! - [`pose`]: poses of detections in space
//! - [`learn`]: training on a picture; merging models
//! - [`mod@repack`]: objects of a model added, replaced and removed
//! - [`random`]: random numbers that are equal on every machine
//! - [`render`]: frames of pictures in known poses
//! - [`mod@exchange`]: look-alikes of a picture
//! - [`hard`]: frames that are hard on a search
//! - [`heat`]: which parts of a picture carry keygraphs
//! - [`mod@sweep`]: how often a picture is found in rendered frames
//! - [`mod@structure`]: facts about a trained picture
//! - [`advice`]: whether a picture is good, and what to do if not
//! - [`mod@assess`]: how well a picture will be found, before it is used
//! - [`mod@bench`]: what stages cost, in time and memory
//! - [`run`], [`gallery`]: many frames at once, and where their pictures go
//! - [`mod@explain`]: why an object is found in a frame, or is not
//! - [`report`], [`words`]: results as JSON, and as sentences
//! - `camera`: live frames of a camera (with the feature `live`)
//! - [`demo`]: the whole path on the pictures of the repository

pub mod clock;
pub mod notice;
pub mod file;
mod unfinished;
mod content;
mod ffmpeg;
pub mod picture;
pub mod yuv4mpeg;
mod pictures;
mod stream;
pub mod input;
pub mod output;
#[cfg(feature = "live")]
pub mod ending;
pub mod canvas;
pub mod annotate;
pub mod video;
pub mod progress;
pub mod sensor;
pub mod region;
pub mod request;
pub mod smooth;
#[cfg(feature = "crew")]
pub mod crew;
pub mod search;
pub mod wide;
pub mod trail;
pub mod margins;
pub mod cutout;
pub mod alike;
pub mod lens;
#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "calibrate")]
pub mod lens_file;
pub mod pose;
pub mod learn;
pub mod repack;
pub mod random;
pub mod render;
pub mod exchange;
pub mod hard;
pub mod heat;
pub mod sweep;
pub mod structure;
pub mod advice;
pub mod assess;
pub mod bench;
pub mod run;
pub mod gallery;
pub mod explain;
pub mod report;
pub mod words;
#[cfg(feature = "live")]
pub mod camera;
pub mod demo;

#[cfg(test)]
mod scratch;
