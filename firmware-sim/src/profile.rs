//! The detector of the build. The features `qvga` and `vga` select it; without them it is qqvga.
//!
//! In, out: only types. Memory: a detector, and a raw frame with two bytes per pixel.

#[cfg(not(any(feature = "qvga", feature = "vga")))]
use keygraph_core::Qqvga as Profile;
#[cfg(feature = "qvga")]
use keygraph_core::Qvga as Profile;
#[cfg(feature = "vga")]
use keygraph_core::Vga as Profile;

/// Detector for frames of the build's profile.
pub type Detector = keygraph_core::Detector<Profile>;

/// Size of the largest frame, bytes.
pub const FRAME_BYTES: usize = 2 * Profile::LIMITS.pixels;
