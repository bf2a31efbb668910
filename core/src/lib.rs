//! Finds planar objects (books, posters, boxes, signs) in camera frames from one
//! picture of each, without an operating system, without a heap, in memory that is
//! fixed at compile time.
//!
//! The method is that of keygraphs (M. Hashimoto, R. Cesar, *A Keygraph
//! Classification Framework for Real-Time Object Detection*): triangles of corners
//! are classified by what lies inside them, and the matches vote for a pose.
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
//! # To use
//!
//! Five types do the work: a [`Frame`] borrows the bytes of a camera, a [`Model`] borrows the
//! bytes of a trained model, a [`Detector`] of one of four profiles finds the model's objects in
//! a frame, a [`Tracker`] follows them from frame to frame for a small part of the cost, and a
//! [`Trainer`] makes a model of a picture. They stand at the root of the crate, with what they
//! take and give.
//!
//! # The stages
//!
//! A stage is a file, and a file imports only from files above it, in the order in which a frame
//! flows through them. Every stage can be used alone: [`stages`]. The files are grouped in
//! layers (`base`, `image`, `extract`, `model`, `detect`, `follow`, `space`), each of which
//! states its rule in its `mod.rs`.
//!
//! # Example
//!
//! ```
//! use std::sync::Mutex;
//! use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, PixelFormat, Preset, QqvgaDetector, QqvgaTrainer};
//!
//! // All zero: in a static they cost no flash and no stack.
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
//! With the feature `dispatch`, which needs std, some loops are compiled for AVX2 too, and that
//! code is taken where the processor has it: a tenth faster, and the same results.
//!
//! | profile | frame | detector with a raw frame |
//! | --- | --- | --- |
//! | [`QqvgaDetector`] | 160 x 120 | at most 160 KB |
//! | [`QvgaDetector`] | 320 x 240 | at most 480 KB |
//! | [`VgaDetector`] | 640 x 480 | at most 4 MB |
//! | [`HdDetector`] | 1280 x 720 | at most 12 MB |
//!
//! A full buffer is never an error: corners keep the strongest, later stages what
//! came first (best corners and coarse triangles come first), and what was lost is
//! counted ([`StageStats`]). Nothing here reads a clock; callers pass
//! one, or an [`Observer`] that is also shown what each stage makes.
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

/// The containers that the stages write into.
pub use heapless;

// Frames.
pub use image::frame::{Frame, FrameError, PixelFormat};

// Models, and how they are made.
pub use extract::feature::FeatureKind;
pub use model::format::{MAGIC, NAME_BYTES, VERSION};
pub use model::method::Method;
pub use model::pack::{PackError, pack, packed_len};
pub use model::parse::{Model, ModelError, Object, Template, View};
pub use model::preset::Preset;
pub use model::train::{QqvgaTrainer, TrainError, TrainParams, Trained, Trainer, VgaTrainer};
pub use model::views::{MAX_VIEWS, ViewSpec};

// Detection.
pub use base::capacity::{Buffer, DETECTIONS, Room, Stage, StageStats, chroma_bytes, luma_bytes};
pub use base::geometry::Homography;
pub use detect::appearance::Appearance;
pub use detect::buffers::{Buffers, Hd, Limits, Profile, Qqvga, Qvga, Vga};
pub use detect::detection::Detection;
pub use detect::detector::{DEFAULT_THRESHOLD, Detector, HdDetector, QqvgaDetector, QvgaDetector, VgaDetector};
pub use detect::observer::{Observer, Output, Stats};

// Following, and space.
pub use follow::track::{LOST_FRAMES, SEARCH_EVERY, State, TRACKS, Track, Tracker};
pub use space::camera::{CameraError, Intrinsics, PlanePose, Pose, plane_pose};

/// The stages, and what they stand on, each to be used alone: in the order in which a frame
/// flows through them.
///
/// Functions take slices and `heapless` views, and no const generics. What belongs to the
/// types at the crate's root is not repeated here.
pub mod stages {
    pub use crate::base::{math, sort};
    /// Fixed sizes that several stages share.
    pub mod capacity {
        pub use crate::base::capacity::{CANDIDATES, FEATURE_BYTES, LEVELS, TEMPLATE_SIDE, pixels_of};
    }
    /// Points in 1/16 px, exact predicates, outlines.
    pub mod geometry {
        pub use crate::base::geometry::{Point, area, contains, in_circle, is_convex, orient};
    }

    /// Limits of frames, and chroma that is none.
    pub mod frame {
        pub use crate::image::frame::{DARK, MAX_SIDE, MIN_SIDE, NO_CHROMA};
    }
    pub use crate::image::{pyramid, shrink};

    pub use crate::extract::{corners, delaunay, keygraph, rank};
    /// What a keygraph looks like, in up to 36 bytes that neither light nor pose change.
    pub mod feature {
        pub use crate::extract::feature::{Feature, SAMPLES, SEGMENTS, Sampling, ZERO, extract, signature, sketch};
    }

    /// The thresholds of a method.
    pub mod method {
        pub use crate::model::method::{Bar, Lists, MatchRule, Parameters, Share, VoteRule};
    }
    /// What a model is made of.
    pub mod model {
        pub use crate::model::format::{MAX_PICTURE_SIDE, SKETCH, Tier, crc32, template_bytes};
        pub use crate::model::parse::Keys;
        pub use crate::model::train::MAX_VIEW_KEYPOINTS;
    }

    pub use crate::detect::{align, classify, digest, hough, plan, pose, verify, vote};
    /// Does the frame look like the object where the pose says it is?
    pub mod appearance {
        pub use crate::detect::appearance::{appearance, is_plausible};
    }
    /// Keypoints and triples from elsewhere.
    pub mod finder {
        pub use crate::detect::finder::Finder;
    }

    /// When a followed instance is believed.
    pub mod track {
        pub use crate::follow::track::{FADE, STAY, SURE};
    }
}
