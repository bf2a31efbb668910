//! How frames are searched, as a command line or a program says.
//!
//! In: words and numbers. Out: a [`Request`]. Memory and cost: none.

use std::time::Duration;

use keygraph_core::{
    Buffer, Depth, Hd, HdDetector, Homography, Known, Lens, PixelFormat, Qqvga, QqvgaDetector, Qvga, QvgaDetector,
    Room, Vga, VgaDetector,
};

use crate::region::Region;

/// A frame size that detectors are built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// 1280 x 720 px, 12 MB of memory.
    Hd,
    /// 640 x 480 px, 4 MB of memory.
    Vga,
    /// 320 x 240 px, 480 KB of memory.
    Qvga,
    /// 160 x 120 px, 160 KB of memory.
    Qqvga,
}

impl Profile {
    /// The profiles, with the names that the command line and the bindings give them.
    pub const NAMED: [(&'static str, Self); 4] =
        [("hd", Self::Hd), ("vga", Self::Vga), ("qvga", Self::Qvga), ("qqvga", Self::Qqvga)];

    /// Maximum side and maximum number of pixels of a frame.
    #[must_use]
    pub const fn limits(self) -> (usize, usize) {
        match self {
            Self::Hd => (1280, 1280 * 720),
            Self::Vga => (640, 640 * 480),
            Self::Qvga => (320, 320 * 240),
            Self::Qqvga => (160, 160 * 120),
        }
    }

    /// The bytes of the detector as one thread needs it, and its buffers.
    #[must_use]
    pub const fn memory(self) -> (usize, [Room; Buffer::COUNT]) {
        const fn bytes<D, B>(buffers: usize) -> usize {
            size_of::<D>() - size_of::<B>() + buffers
        }
        match self {
            Self::Hd => (bytes::<HdDetector, Hd>(Hd::BYTES), Hd::ROOMS),
            Self::Vga => (bytes::<VgaDetector, Vga>(Vga::BYTES), Vga::ROOMS),
            Self::Qvga => (bytes::<QvgaDetector, Qvga>(Qvga::BYTES), Qvga::ROOMS),
            Self::Qqvga => (bytes::<QqvgaDetector, Qqvga>(Qqvga::BYTES), Qqvga::ROOMS),
        }
    }
}

/// What shape objects may have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Shape {
    /// Flat, or bent along one direction, as a label on a can or a page: the surface is told where a plane
    /// does not explain what is seen.
    #[default]
    Any,
    /// Flat.
    Plane,
}

impl Shape {
    /// The shapes, with the names that the command line and the bindings give them.
    pub const NAMED: [(&'static str, Self); 2] = [("any", Self::Any), ("plane", Self::Plane)];
}

/// How a frame is searched, and which results are reported.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Size of the detector.
    pub profile: Profile,
    /// Minimum score of a detection, 0 to 1.
    pub threshold: f32,
    /// Time after which a search is stopped: it then reports what it has found.
    pub budget: Option<Duration>,
    /// Minimum share of an object that must be seen, 0 to 1.
    pub min_visible: f32,
    /// Whether to report all names at a place, and not the best alone.
    pub all_names: bool,
    /// What shape objects may have.
    pub shape: Shape,
    /// The camera's lens, in px of the picture, and of the frame for those who give a frame; `None` takes straight lines as
    /// straight.
    pub lens: Option<Lens>,
    /// Whether to match the cells of what is found, for a calibration.
    pub matches: bool,
    /// Whether to report corners, keygraphs and supporters.
    pub details: bool,
    /// The part of each frame that is searched, at its own resolution; `None` searches all.
    pub region: Option<Region>,
    /// Whether frames are mirrored left to right before they are searched. Results stay in px of the
    /// frame as it came; their homographies have a negative determinant.
    pub mirror: bool,
    /// The format of a sensor to which pixels are converted; `None` takes them as they were
    /// decoded.
    pub format: Option<PixelFormat>,
    /// How much of each frame is searched, and for how much of the model.
    pub depth: Depth,
    /// Whether pictures are searched for what is seen from far to the side, too, as
    /// [`search_widely`](crate::wide::search_widely) does.
    pub wide: bool,
    /// Number of threads that search a frame together, with the feature `crew`. The results do not depend on it.
    pub threads: usize,
    /// Number of frames over which the outline of an object that stands still is averaged, in a sequence; 0 for none.
    /// Outlines never lag by more than a pixel of the searched frame, [`smooth`](crate::smooth).
    pub smooth: u8,
    /// Whether to report digests. Frames of a sequence have none.
    pub digests: bool,
}

/// Parses the minimum share of an object that must be seen, 0 to 1.
///
/// # Errors
/// When `text` is no number from 0 to 1.
pub fn parse_share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a share lies between 0 and 1".into())
}

/// Parses the minimum score of a detection, 0 to 1.
///
/// # Errors
/// When `text` is no number from 0 to 1.
pub fn parse_threshold(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a score lies between 0 and 1".into())
}

/// Parses the time of a search, ms.
///
/// # Errors
/// When `text` is no number above 0.
pub fn parse_budget(text: &str) -> Result<Duration, String> {
    let ms = text.parse().ok().filter(|ms: &f64| *ms > 0.0 && *ms <= 1e6);
    ms.map(|ms| Duration::from_secs_f64(ms / 1e3)).ok_or_else(|| "a budget is a number of ms above 0".into())
}

/// How much is searched with `--thorough`, and without it.
#[must_use]
pub const fn depth_of(thorough: bool) -> Depth {
    if thorough { Depth::Thorough } else { Depth::Usual }
}

impl Request {
    /// Returns the request for px of a part or a copy of the picture; `to_picture` is the map to px of the picture.
    #[must_use]
    pub fn within(&self, to_picture: &Homography) -> Self {
        Self { lens: self.lens.map(|lens| lens.within(to_picture)), ..*self }
    }

    /// What is known of the objects and the camera.
    #[must_use]
    pub fn known(&self) -> Known<'_> {
        Known { lens: self.lens.as_ref(), is_flat: self.shape == Shape::Plane }
    }

    /// Whether surfaces are looked for: through a lens a plane is one, too.
    #[must_use]
    pub fn wants_surfaces(&self) -> bool {
        self.shape == Shape::Any || self.lens.is_some()
    }

    /// A request for detections alone, on pixels as they were decoded.
    #[must_use]
    pub const fn new(profile: Profile, threshold: f32) -> Self {
        Self {
            profile,
            threshold,
            budget: None,
            min_visible: 0.0,
            all_names: false,
            shape: Shape::Any,
            lens: None,
            matches: false,
            details: false,
            region: None,
            mirror: false,
            format: None,
            depth: Depth::Usual,
            wide: false,
            threads: 1,
            smooth: 0,
            digests: false,
        }
    }
}
