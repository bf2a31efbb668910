//! Frames of one camera or video, one after the other, through a tracker.
//!
//! In: pictures in order, each with the sequence that it belongs to. Out: what was
//! found, with ids and states. A picture of another sequence than the one before
//! starts anew: nothing is followed into it, and no id is used twice.
//!
//! Memory: a tracker, some 3 KB. Cost: that of the tracker.

use anyhow::Result;
use keygraph_core::model::Model;
use keygraph_core::track::Tracker;

use crate::input::Picture;
use crate::search::{Found, Request, follow};

/// A tracker, and the sequence that it follows things in.
#[derive(Debug)]
pub struct Trail<S> {
    tracker: Tracker,
    sequence: Option<S>,
}

impl<S> Default for Trail<S> {
    fn default() -> Self {
        Self { tracker: Tracker::new(), sequence: None }
    }
}

impl<S: PartialEq> Trail<S> {
    /// Has the next frame searched, whether or not all is in sight.
    pub const fn search_next(&mut self) {
        self.tracker.search_next();
    }

    /// Follows, and where needed searches, the model's objects in the next picture of
    /// `sequence`, with the detector of thread `slot`.
    ///
    /// # Errors
    /// When the picture is too small. The next one starts anew then, and after a panic.
    pub fn next(
        &mut self,
        sequence: S,
        picture: &Picture,
        model: &Model<'_>,
        request: &Request,
        slot: usize,
    ) -> Result<Found> {
        // It is put back when all went well.
        if self.sequence.take().is_none_or(|before| before != sequence) {
            self.tracker.reset();
        }
        let found = follow(picture, model, request, slot, &mut self.tracker)?;
        self.sequence = Some(sequence);
        Ok(found)
    }
}
