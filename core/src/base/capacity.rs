//! Sizes that several stages share, and what the stages count. Sizes of one stage
//! stand in its file, those of the profiles in `detect`.
//!
//! A full buffer is not an error: corners keep the strongest, later stages what came
//! first, and what was dropped is counted in a [`StageStats`].

/// What one stage saw, kept and dropped for lack of room in one frame.
///
/// `seen` counts candidates; `kept` what was passed on; `dropped` what would
/// have been passed on had the buffer been larger. What a stage rejects by its
/// own rule (a thin triangle, a weak corner) is in neither of the last two. Classify
/// keeps up to two matches of what it sees; delaunay's losses count points and
/// triangles alike; corners count as dropped beyond the method's limit too; pose
/// counts candidates in, and vertex pairs as dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StageStats {
    /// Candidates that came in.
    pub seen: u32,
    /// Results passed on.
    pub kept: u32,
    /// Results lost to a full buffer.
    pub dropped: u32,
}

/// Lengths fit `u32`: every buffer is far smaller.
#[allow(clippy::cast_possible_truncation, reason = "capacities are far below 2^32")]
pub(crate) const fn count(n: usize) -> u32 {
    n as u32
}

/// An index as an id of 16 bits. The owners of the buffers assert at compile time that their
/// capacities fit.
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
    /// Raw pixels to luma and half-size chroma.
    Convert,
    /// Half-size levels.
    Pyramid,
    /// Shi-Tomasi corners and their ranking.
    Corners,
    /// Nested Delaunay triangulation.
    Delaunay,
    /// Thick scalene filter and partition keys.
    Keygraphs,
    /// Features of the keygraphs.
    Features,
    /// Nearest neighbours in the model.
    Classify,
    /// Matches whose surroundings look alike.
    Verify,
    /// Hough votes and their peaks.
    Vote,
    /// Candidates grown to homographies.
    Pose,
    /// Acceptance by appearance.
    Accept,
}

impl Stage {
    /// How many stages there are.
    pub const COUNT: usize = 11;

    /// All stages in pipeline order.
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

    /// The name used in reports and JSON.
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
    /// Pyramid of luma, bytes.
    Luma,
    /// Pyramids of both chroma planes, bytes.
    Chroma,
    /// Rows that corners are computed in, numbers.
    CornerRows,
    /// Candidates for corners on a level.
    Corners,
    /// Corners of all levels.
    Keypoints,
    /// Points that are triangulated together.
    Triangulation,
    /// Triangles of a level.
    Triples,
    /// Keygraphs of all levels.
    Keygraphs,
    /// Features of all keygraphs.
    Features,
    /// Matches that vote.
    Votes,
    /// Bins that votes fall into.
    Bins,
    /// Vertex pairs near a candidate.
    Pairs,
}

impl Buffer {
    /// How many there are.
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

    /// The name used in reports and JSON.
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

/// What one buffer takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Room {
    /// Bytes of memory.
    pub bytes: usize,
    /// Elements that fit.
    pub capacity: usize,
}

/// Levels of the image pyramid: full size down to an eighth.
pub const LEVELS: usize = 4;

/// Bytes of a luma pyramid whose lowest level has `pixels` pixels.
#[must_use]
pub const fn luma_bytes(pixels: usize) -> usize {
    pixels + pixels / 4 + pixels / 16 + pixels / 64
}

/// Pixels of the lowest level of a luma pyramid that has `bytes` bytes: the inverse of
/// [`luma_bytes`] for sizes of which a 64th is whole.
#[must_use]
pub const fn pixels_of(bytes: usize) -> usize {
    bytes / 85 * 64
}

/// Bytes of one chroma pyramid (there are two) for frames of `pixels` pixels.
#[must_use]
pub const fn chroma_bytes(pixels: usize) -> usize {
    luma_bytes(pixels / 4)
}

/// Candidates (pose hypotheses) that are grown and checked in one frame.
pub const CANDIDATES: usize = 24;

/// Detections reported in one frame.
pub const DETECTIONS: usize = 32;

/// Longer side of the appearance template of an object, px.
pub const TEMPLATE_SIDE: usize = 96;

/// Bytes of the longest feature.
pub const FEATURE_BYTES: usize = 36;
