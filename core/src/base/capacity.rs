//! This file holds the sizes that several stages share, the names of stages and buffers, and the
//! counts that stages report. The sizes of one stage stand in the file of that stage. The sizes of
//! the profiles stand in `detect`.
//!
//! A full buffer is not an error. The corner stage then keeps the strongest corners. Later stages
//! keep what came first. Each stage counts what it drops in a [`StageStats`].

/// Counts of what one stage saw, kept and dropped in one frame.
///
/// `seen` counts the candidates that came in. `kept` counts the results that were passed on.
/// `dropped` counts the results that would have been passed on had the buffer been larger. A
/// candidate that a stage rejects by its own rule (a thin triangle, a weak corner) counts neither
/// as kept nor as dropped.
///
/// Four stages count in their own way:
/// - Classify keeps up to two matches for each keygraph that it sees.
/// - Delaunay counts lost points and lost triangles together in `dropped`.
/// - Corners also counts in `dropped` the corners beyond the limit of the method, and in a tile those
///   in the outlines of what has been found.
/// - Pose counts candidates in `seen`, and lost vertex pairs in `dropped`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StageStats {
    /// Number of candidates that came in.
    pub seen: u32,
    /// Number of results that were passed on.
    pub kept: u32,
    /// Number of results that were lost to a full buffer.
    pub dropped: u32,
}

/// Returns a length as `u32`. Every length fits, because every buffer is far smaller than 2^32.
#[allow(clippy::cast_possible_truncation, reason = "capacities are far below 2^32")]
pub(crate) const fn count(n: usize) -> u32 {
    n as u32
}

/// Returns an index as an id of 16 bits. The owner of each buffer asserts at compile time that its
/// capacity fits.
#[allow(clippy::cast_possible_truncation, reason = "asserted where the buffers are declared")]
pub(crate) const fn id(index: usize) -> u16 {
    debug_assert!(index <= u16::MAX as usize, "an id has 16 bits");
    index as u16
}

/// The stages, in the order in which a frame flows through them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Stage {
    /// Converts raw pixels to luma and half-size chroma.
    Convert,
    /// Makes the half-size levels.
    Pyramid,
    /// Finds Shi-Tomasi corners and ranks them.
    Corners,
    /// Makes the nested Delaunay triangulation.
    Delaunay,
    /// Keeps the thick scalene triangles and computes their partition keys.
    Keygraphs,
    /// Computes the features of the keygraphs.
    Features,
    /// Finds the nearest neighbours of the features in the model.
    Classify,
    /// Keeps the matches whose surroundings look alike.
    Verify,
    /// Collects Hough votes and finds their peaks.
    Vote,
    /// Grows candidates to homographies.
    Pose,
    /// Accepts poses by their appearance.
    Accept,
}

impl Stage {
    /// Number of stages.
    pub const COUNT: usize = 11;

    /// All stages, in pipeline order.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Convert,
        Self::Pyramid,
        Self::Corners,
        Self::Delaunay,
        Self::Keygraphs,
        Self::Features,
        Self::Classify,
        Self::Verify,
        Self::Vote,
        Self::Pose,
        Self::Accept,
    ];

    /// Returns the name of the stage in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Convert => "convert",
            Self::Pyramid => "pyramid",
            Self::Corners => "corners",
            Self::Delaunay => "delaunay",
            Self::Keygraphs => "keygraphs",
            Self::Features => "features",
            Self::Classify => "classify",
            Self::Verify => "verify",
            Self::Vote => "vote",
            Self::Pose => "pose",
            Self::Accept => "accept",
        }
    }
}

/// The buffers of a detector that grow with its profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Buffer {
    /// Luma pyramid; an element is a byte.
    Luma,
    /// Pyramids of both chroma planes; an element is a byte.
    Chroma,
    /// Rows in which corners are computed; an element is a number.
    CornerRows,
    /// Corner candidates of a level.
    Corners,
    /// Corners of all levels.
    Keypoints,
    /// Points of one triangulation.
    Triangulation,
    /// Triangles of a level.
    Triples,
    /// Keygraphs of all levels.
    Keygraphs,
    /// Features of all keygraphs.
    Features,
    /// Matches that vote.
    Votes,
    /// Bins of the votes.
    Bins,
    /// Vertex pairs near a candidate.
    Pairs,
}

impl Buffer {
    /// Number of buffers.
    pub const COUNT: usize = 12;

    /// All buffers, in the order in which a frame fills them.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Luma,
        Self::Chroma,
        Self::CornerRows,
        Self::Corners,
        Self::Keypoints,
        Self::Triangulation,
        Self::Triples,
        Self::Keygraphs,
        Self::Features,
        Self::Votes,
        Self::Bins,
        Self::Pairs,
    ];

    /// Returns the name of the buffer in reports and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Luma => "luma",
            Self::Chroma => "chroma",
            Self::CornerRows => "corner rows",
            Self::Corners => "corners",
            Self::Keypoints => "keypoints",
            Self::Triangulation => "triangulation",
            Self::Triples => "triples",
            Self::Keygraphs => "keygraphs",
            Self::Features => "features",
            Self::Votes => "votes",
            Self::Bins => "bins of votes",
            Self::Pairs => "vertex pairs",
        }
    }
}

/// Size of one buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Room {
    /// Size in bytes.
    pub bytes: usize,
    /// Maximum number of elements.
    pub capacity: usize,
}

/// Number of levels of the image pyramid, from full size down to an eighth.
pub const LEVELS: usize = 4;

/// Returns the size in bytes of a luma pyramid whose level 0 has `pixels` pixels.
#[must_use]
pub const fn luma_bytes(pixels: usize) -> usize {
    pixels + pixels / 4 + pixels / 16 + pixels / 64
}

/// Returns the number of pixels of level 0 of a luma pyramid of `bytes` bytes. This is the inverse
/// of [`luma_bytes`] for numbers of pixels that are multiples of 64.
#[must_use]
pub const fn pixels_of(bytes: usize) -> usize {
    bytes / 85 * 64
}

/// Returns the size in bytes of one chroma pyramid for frames of `pixels` pixels. A frame has two.
#[must_use]
pub const fn chroma_bytes(pixels: usize) -> usize {
    luma_bytes(pixels / 4)
}

/// Maximum number of candidates (pose hypotheses) that are grown and checked in one frame.
pub const CANDIDATES: usize = 24;

/// Maximum number of detections that are reported in one frame.
pub const DETECTIONS: usize = 64;

/// Longer side of the appearance template of an object, px.
pub const TEMPLATE_SIDE: usize = 96;

/// Length of the longest feature, bytes.
pub const FEATURE_BYTES: usize = 36;
