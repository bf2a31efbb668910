//! Frames of a camera or a video, in order, through a tracker.
//!
//! In: pictures in order, each with the sequence that it belongs to. Out: results with ids
//! and states. When the sequence changes, the tracker is reset: no object is followed
//! into the new sequence, and no id is used twice.
//!
//! Memory: a tracker, some 18 KB. Cost: that of the tracker.

use anyhow::Result;
use keygraph_core::Model;

use crate::input::Picture;
use crate::search::{Follower, Found, Request, follow};

/// A tracker, and the sequence in which it follows objects.
#[derive(Debug)]
pub struct Trail<S> {
    follower: Follower,
    sequence: Option<S>,
}

impl<S> Default for Trail<S> {
    fn default() -> Self {
        Self { follower: Follower::default(), sequence: None }
    }
}

impl<S: PartialEq> Trail<S> {
    /// Makes the next frame be searched, even when all objects are in view.
    pub const fn search_next(&mut self) {
        self.follower.tracker.search_next();
    }

    /// Follows the model's objects into the next picture of `sequence`, and searches it where
    /// needed, with the detector of thread `slot`.
    ///
    /// # Errors
    /// When the picture is too small. After an error or a panic, the next picture starts a
    /// new sequence.
    pub fn next(
        &mut self,
        sequence: S,
        picture: &Picture,
        model: &Model<'_>,
        request: &Request,
        slot: usize,
    ) -> Result<Found> {
        // The sequence is put back below, when the frame was tracked.
        if self.sequence.take().is_none_or(|before| before != sequence) {
            self.follower.tracker.reset();
        }
        let found = follow(picture, model, request, slot, &mut self.follower)?;
        self.sequence = Some(sequence);
        Ok(found)
    }
}
