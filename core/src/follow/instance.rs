//! An instance of an object that is followed, and its state.
//!
//! In: detections, frame after frame. Out: a [`Track`] that knows its state, and where it is
//! expected next. Memory: 200 bytes. Cost: none to speak of.

use crate::base::geometry::Homography;
use crate::detect::detection::Detection;

/// Share of the threshold that an instance needs to stay.
pub const STAY: f32 = 0.5;

/// Minimum score at which a followed pose is believed without a search. No wrong pose among those
/// that the score was fitted to reached it. 5 of 116 right poses did not reach it.
pub const SURE: f32 = 0.8;

/// Minimum share of the support in the frame before at which a followed pose is believed without a
/// search. An instance that suddenly looks much less alike has been hidden, or the alignment went
/// astray.
pub const FADE: f32 = 0.7;

/// State of an instance in the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// A search found the instance. It was not seen in the frame before.
    Found,
    /// The instance was seen in the frame before, and in this one.
    Tracked,
    /// The instance is not seen. Its detection is the last one that it had.
    Lost,
}

impl State {
    /// Returns `found`, `tracked` or `lost`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::Tracked => "tracked",
            Self::Lost => "lost",
        }
    }
}

/// An instance of an object that is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Track {
    /// Id of the instance. No other instance gets the same id.
    pub id: u32,
    /// State of the instance.
    pub state: State,
    /// Detection in this frame, or the last one if the instance is not seen. `votes` and `agreeing`
    /// come from the last search that found it. `appearance.chroma` is 0 when no search found it in
    /// this frame.
    pub detection: Detection,
    /// Number of frames since the instance was seen; 0 when it is seen in this frame.
    pub unseen: u32,
    /// Pose one frame before the instance was last seen.
    pub(super) before: Option<Homography>,
    /// Whether the instance has been seen in the frame that is being processed.
    pub(super) seen: bool,
    /// Whether the instance was followed in that frame beyond doubt.
    pub(super) sure: bool,
    /// Whether a detection of the search in that frame belongs to the instance.
    pub(super) claimed: bool,
}

impl Track {
    /// Returns whether the pose is certain: it was followed beyond doubt, or a search found it.
    pub(super) fn is_certain(&self) -> bool {
        self.seen && (self.claimed || self.sure)
    }

    /// Begins a frame in which the instance has not been seen yet.
    pub(super) fn begin_frame(&mut self) {
        (self.seen, self.sure, self.claimed) = (false, false, false);
    }

    /// Takes a pose in this frame.
    pub(super) fn take(&mut self, d: Detection) {
        if !self.seen {
            self.before = (self.unseen == 0).then_some(self.detection.homography);
        }
        self.detection = d;
        self.seen = true;
    }

    /// Returns whether `d`, a pose that the instance was followed to, is beyond doubt.
    pub(super) fn is_sure(&self, d: &Detection) -> bool {
        d.score >= SURE && d.appearance.support >= FADE * self.detection.appearance.support
    }

    /// Returns the pose in this frame if the motion goes on. Returns `None` when the motion is
    /// unknown.
    pub(super) fn predicted(&self) -> Option<Homography> {
        let step = self.detection.homography.after(&self.before?.inverse()?);
        Some(step.after(&self.detection.homography).normalised())
    }
}
