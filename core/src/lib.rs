//! Finds planar objects (books, posters, boxes, signs) in camera frames from one picture of each.
//! It needs no operating system and no heap. Its memory is fixed at compile time.
//!
//! The method is that of keygraphs (M. Hashimoto, R. Cesar, *A Keygraph Classification Framework
//! for Real-Time Object Detection*): triangles of corners are classified by what lies inside them,
//! and the matches vote for a pose.
//!
//! ```text
//! frame ──► pyramid ──► corners ──► delaunay ──► keygraph ──► feature
//!  raw       luma,       Shi-        nested       thick        affine
//!  bytes     chroma      Tomasi      levels       scalene      patches
//!                                                                 │
//!           detections ◄── align ◄── pose ◄── vote ◄── classify ◄─┘
//!                          looks     grown    Hough     nearest     ▲
//!                          alike?                       neighbour   │
//!                                                            model ─┘
//!                                    picture ──► train ──► (bytes, read in place)
//! ```
//!
//! # Use
//!
//! Five types do the work:
//!
//! - A [`Frame`] borrows the bytes of a camera.
//! - A [`Model`] borrows the bytes of a trained model.
//! - A [`Detector`] of one of four profiles finds the model's objects in a frame.
//! - A [`Tracker`] follows the objects from frame to frame for a small part of the cost.
//! - A [`Trainer`] makes a model from a picture.
//!
//! They stand at the root of the crate, with the types that a program needs to use them. Types that
//! only those meet who look into the stages are in [`stages`].
//!
//! # The stages
//!
//! Each stage is a file. A file imports only from the files above it, in the order in which a frame
//! flows through the stages. Every stage can be used alone: [`stages`]. The files are grouped in
//! layers (`base`, `image`, `extract`, `model`, `detect`, `follow`, `space`). Each layer states its
//! rule in its `mod.rs`.
//!
//! # Example
//!
//! ```
//! use std::sync::Mutex;
//! use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, PixelFormat, Preset, QqvgaDetector, QqvgaTrainer};
//!
//! // Trainer and detector are all zero: in a static they cost no flash and no stack.
//! static TRAINER: Mutex<QqvgaTrainer> = Mutex::new(QqvgaTrainer::new());
//! static DETECTOR: Mutex<QqvgaDetector> = Mutex::new(QqvgaDetector::new());
//!
//! // A picture with texture: random blocks.
//! let mut seed = 1u32;
//! let mut blocks = [0u8; 16 * 12];
//! for b in &mut blocks {
//!     seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
//!     *b = (seed >> 24) as u8;
//! }
//! let picture: Vec<u8> = (0..160 * 120).map(|i| blocks[i / 160 / 10 * 16 + i % 160 / 10]).collect();
//! let frame = Frame::new(PixelFormat::Gray8, 160, 120, &picture)?;
//!
//! let mut flash = vec![0; 128 << 10];
//! let trained = TRAINER.lock()?.train(&frame, (160, 120), &Preset::Learnt.params("blocks", true), &mut flash)?;
//!
//! let model = Model::parse(&flash[..trained.bytes])?;
//! let mut detector = DETECTOR.lock()?;
//! let found = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut || 0)?;
//! assert_eq!(model.object(usize::from(found[0].object)).name, "blocks");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where detectors lie
//!
//! A new detector, trainer or tracker has no byte that is not zero; a test has the linker show it
//! (`boards/zero`). So a static costs no flash, and memory that was filled with zeros holds a new one.
//! They are large: how they get to their place decides how much stack that takes.
//!
//! | idiom | stack |
//! | --- | --- |
//! | `static D: ConstStaticCell<QvgaDetector> = ConstStaticCell::new(QvgaDetector::new());` (crate `static_cell`), or a mutex around it | none |
//! | the same with `#[unsafe(link_section = ".sdram")]`: in RAM beside the chip, which the start-up code must make ready and fill with zeros | none |
//! | `StaticCell::init_with(QvgaDetector::new)`, `Box::new(QvgaDetector::new())`: built on the stack, then copied | up to twice the detector |
//!
//! The C library has functions that make a detector in memory of the caller, which zeros it in place.
//!
//! [`Detector::begin`] reads a frame into planes of its own: the caller's buffer is free for the next one
//! while [`Ongoing::step`] searches. One raw buffer is enough. [`Detector::begin_again`] searches the same
//! frame for another model: several that lie apart in flash need not be merged. [`Model::length`] tells
//! where one of them ends.
//!
//! A DMA that wants words fills a buffer of `[u32; N]`; its bytes are read as they lie in memory, by
//! `zerocopy::IntoBytes::as_bytes` or `bytemuck::cast_slice`, without `unsafe`.
//!
//! # Speed
//!
//! The feature `vectors` computes whole rows side by side on a Cortex-M55, whose vectors Rust does not
//! tell; it goes with `-C target-cpu=cortex-m55` and `opt-level = 3`. The results are the same.
//!
//! The feature `crew` lets several cores search one frame ([`Detector::set_crew`]), with the same results; a
//! detector of `vga` then takes 150 KB more.
//!
//! The feature `dispatch` needs std. It compiles some loops for AVX2 too, and uses that code when
//! the processor has AVX2. Detection is then a tenth faster, with the same results.
//!
//! | profile | frame | detector with a raw frame |
//! | --- | --- | --- |
//! | [`QqvgaDetector`] | 160 x 120 | at most 160 KB |
//! | [`QvgaDetector`] | 320 x 240 | at most 480 KB |
//! | [`VgaDetector`] | 640 x 480 | at most 4 MB |
//! | [`HdDetector`] | 1280 x 720 | at most 12 MB |
//!
//! A full buffer is never an error. Corners keep the strongest, and later stages keep what came
//! first: best corners and coarse triangles come first. The losses are counted in [`StageStats`].
//! The crate reads no clock. Callers pass a clock, or an [`Observer`] that is also shown what each
//! stage makes.
#![no_std]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::cast_possible_truncation, clippy::cast_sign_loss))]

#[cfg(any(test, feature = "dispatch"))]
extern crate std;

mod base;
mod image;
mod extract;
mod model;
mod detect;
mod follow;
mod space;

/// The container types that the stages write into.
pub use heapless;

// Frames.
pub use image::frame::{Frame, FrameError, Window};
pub use image::pixels::PixelFormat;

// Models and training.
pub use extract::feature::FeatureKind;
pub use model::format::{MAGIC, NAME_BYTES, VERSION};
pub use model::method::Method;
pub use model::pack::{PackError, pack, pack_parts, packed_len, packed_parts_len};
pub use model::parse::{Model, ModelError, Object, Template, View};
pub use model::part::Part;
pub use model::preset::Preset;
pub use model::slim::{slim, slim_len};
pub use model::train::{QqvgaTrainer, TrainError, TrainParams, Trained, Trainer, VgaTrainer};
pub use model::views::{MAX_VIEWS, ViewSpec};

// Detection.
pub use base::capacity::{Buffer, DETECTIONS, Room, Stage, StageStats, chroma_bytes, luma_bytes};
pub use base::crew::Crew;
pub use base::geometry::Homography;
pub use base::lens::{Distortion, Lens, LensError};
pub use detect::appearance::Appearance;
pub use detect::buffers::{Buffers, Hd, Limits, Profile, Qqvga, Qvga, Vga};
pub use detect::detection::Detection;
pub use detect::detector::{
    DEFAULT_THRESHOLD, Detector, HdDetector, Ongoing, QqvgaDetector, QvgaDetector, VgaDetector,
};
pub use detect::matches::CellMatch;
pub use detect::observer::{Observer, Output, Stats};
pub use detect::plan::Depth;
pub use detect::surface::{Known, Surface};

// Tracking, and poses in space.
pub use follow::bent::Surfaces;
pub use follow::instance::{State, Track};
pub use follow::schedule::{RECHECK, SEARCH_EVERY};
pub use follow::track::{LOST_FRAMES, TRACKS, Tracker};
pub use space::camera::{CameraError, Intrinsics, PlanePose, Pose, plane_pose};
pub use space::cylinder::{Cylinder, cylinder};

/// The stages and their foundations, in the order in which a frame flows through them. Each can be
/// used alone.
///
/// Functions take slices and `heapless` views, and have no const generics. Types at the crate's
/// root are not repeated here.
pub mod stages {
    pub use crate::base::{math, sort};
    /// Sizes that several stages share.
    pub mod capacity {
        pub use crate::base::capacity::{CANDIDATES, FEATURE_BYTES, LEVELS, TEMPLATE_SIDE, pixels_of};
    }
    /// Points in 1/16 px, exact predicates, and outlines.
    pub mod geometry {
        pub use crate::base::geometry::{Point, area, contains, in_circle, is_convex, orient};
    }

    pub use crate::base::pace;

    /// Limits of a frame's size, the minimum brightness for chroma, and the value of missing
    /// chroma.
    pub mod frame {
        pub use crate::image::frame::{MAX_SIDE, MIN_SIDE};
        pub use crate::image::pixels::{DARK, NO_CHROMA};
    }
    pub use crate::image::{plane, pyramid, shrink, squeeze};

    pub use crate::extract::{corners, delaunay, keygraph, rank};
    /// Features of keygraphs: up to 36 bytes that change neither with the light nor with the pose.
    pub mod feature {
        pub use crate::extract::feature::{Feature, SAMPLES, SEGMENTS, Sampling, ZERO, extract, signature, sketch};
    }

    /// Thresholds of the methods.
    pub mod method {
        pub use crate::model::method::{Bar, Lists, MatchRule, Parameters, Share, VoteRule};
    }
    /// Parts of a model.
    pub mod model {
        pub use crate::model::format::{MAX_PICTURE_SIDE, SKETCH, Tier, crc32, template_bytes};
        pub use crate::model::parse::Keys;
        pub use crate::model::train::MAX_VIEW_KEYPOINTS;
    }

    pub use crate::detect::{align, classify, digest, hough, plan, pose, scrutiny, verify, vote};
    /// The grid of a surface.
    pub mod surface {
        pub use crate::detect::cells::{POINTS, SIDE};
    }
    /// Appearance of a frame at a pose: whether it looks like the object there.
    pub mod appearance {
        pub use crate::detect::appearance::{appearance, is_plausible};
    }
    /// Source of keypoints and triples, which callers can replace.
    pub mod finder {
        pub use crate::detect::finder::Finder;
    }

    /// Thresholds for the tracks of a tracker.
    pub mod track {
        pub use crate::follow::instance::{FADE, STAY, SURE};
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
