//! The detector of the build: feature `qvga` or `vga`, else qqvga.
//!
//! In, out: types alone. Memory: a detector and a raw frame of two bytes a pixel.

/// The detector.
#[cfg(feature = "qvga")]
pub type Detector = keygraph_core::detect::QvgaDetector;
/// The detector.
#[cfg(feature = "vga")]
pub type Detector = keygraph_core::detect::VgaDetector;
/// The detector.
#[cfg(not(any(feature = "qvga", feature = "vga")))]
pub type Detector = keygraph_core::detect::QqvgaDetector;

/// Bytes of the largest frame.
pub const FRAME_BYTES: usize = 2 * Detector::MAX_PIXELS;
