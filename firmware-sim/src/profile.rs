//! The detector of the build. The features `qvga` and `vga` select it; without them it is qqvga.
//!
//! In, out: only types. Memory: a detector, and a raw frame with two bytes per pixel.

/// Detector for frames of 320x240 px.
#[cfg(feature = "qvga")]
pub type Detector = keygraph_core::detect::QvgaDetector;
/// Detector for frames of 640x480 px.
#[cfg(feature = "vga")]
pub type Detector = keygraph_core::detect::VgaDetector;
/// Detector for frames of 160x120 px.
#[cfg(not(any(feature = "qvga", feature = "vga")))]
pub type Detector = keygraph_core::detect::QqvgaDetector;

/// Size of the largest frame, bytes.
pub const FRAME_BYTES: usize = 2 * Detector::MAX_PIXELS;
