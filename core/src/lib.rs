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
//! A file is a stage, they are declared here in the order in which a frame flows
//! through them, and a file imports only from files above it. Every stage can be
//! used alone; [`detect::Detector`] owns the buffers and runs them all, and
//! [`detect::Finder`] lets other corners and other triples in. [`track::Tracker`] follows
//! what was found from frame to frame, for a small part of the cost.
//!
//! ```
//! use std::sync::Mutex;
//! use keygraph_core::detect::{DEFAULT_THRESHOLD, QqvgaDetector};
//! use keygraph_core::feature::FeatureKind;
//! use keygraph_core::frame::{Frame, PixelFormat};
//! use keygraph_core::model::{Method, Model};
//! use keygraph_core::train::{QqvgaTrainer, TrainParams, ViewSpec};
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
//! let views = [ViewSpec { side_px: 160.0, squeeze: 1.0, direction_deg: 0.0, keypoints: 60 }];
//! let params = TrainParams {
//!     name: "blocks",
//!     method: Method::Keygraph,
//!     feature: FeatureKind::Luma,
//!     views: &views,
//!     max_keygraphs: 4000,
//!     max_per_cell: 100,
//! };
//! let mut flash = vec![0; 128 << 10];
//! let trained = TRAINER.lock()?.train(&frame, (160, 120), &params, &mut flash)?;
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
//! | [`detect::QqvgaDetector`] | 160 x 120 | at most 160 KB |
//! | [`detect::QvgaDetector`] | 320 x 240 | at most 480 KB |
//! | [`detect::VgaDetector`] | 640 x 480 | at most 4 MB |
//! | [`detect::HdDetector`] | 1280 x 720 | at most 12 MB |
//!
//! A full buffer is never an error: corners keep the strongest, later stages what
//! came first (best corners and coarse triangles come first), and what was lost is
//! counted ([`capacity::StageStats`]). Nothing here reads a clock; callers pass
//! one, or a [`detect::Observer`] that is also shown what each stage makes.
#![no_std]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::cast_possible_truncation, clippy::cast_sign_loss))]

#[cfg(any(test, feature = "dispatch"))]
extern crate std;

/// The containers that the stages write into.
pub use heapless;

mod base;
mod image;
mod extract;
pub mod model;
pub mod detect;
mod follow;
mod space;

pub use base::{capacity, geometry, math, sort};
pub use detect::{align, classify, detection, digest, finder, observer, overlay, pose, verify, vote};
pub use extract::{corners, delaunay, feature, keygraph, rank};
pub use follow::track;
pub use image::{frame, pyramid, shrink};
pub use model::pack as write;
pub use model::{method, train};
pub use space::camera;
