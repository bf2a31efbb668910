//! Says when a frame of a sequence is searched, and where a search begins that ran out of time.
//!
//! In: frames that were loaded, and how each search ended. Out: whether the next frame is searched,
//! and from which part on. A frame that shows what the last searched frame showed is not searched
//! again ([`Still`]), but one in [`RECHECK`] frames is, whatever it shows. A search that was stopped
//! goes on in the next frame: where nothing is in sight, it goes on itself, in the frame that it has
//! begun with. Where something is followed, the buffers are needed for the next frame, and the next
//! part of that frame is searched: first all of it, then its tiles in turn.
//!
//! Memory: 5 KB in [`Schedule`]. Cost: that of `still`.

use crate::detect::buffers::Profile;
use crate::detect::detector::Detector;
use crate::detect::plan::{Depth, Wish};
use crate::detect::search::Place;
use crate::detect::tile::Tile;
use crate::follow::still::Still;
use crate::image::pyramid::PyramidView;
use crate::model::parse::Model;

/// Number of frames from one search to the next while every instance is followed for sure. With a
/// smaller number new instances appear sooner, at the cost of a search each.
pub const SEARCH_EVERY: u32 = 10;

/// Number of frames after which a frame is searched even where nothing has changed. It is a second
/// of video.
pub const RECHECK: u32 = 30;

/// What a search looks for: another search of the same frame for the same finds nothing new.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sought {
    wish: Wish,
    model: u32,
}

impl Sought {
    pub(super) fn new<P: Profile + ?Sized>(detector: &Detector<P>, model: &Model<'_>, threshold: f32) -> Self {
        Self { wish: detector.wish(threshold), model: model.checksum() }
    }
}

/// What is known of the searches of a sequence.
#[derive(Debug)]
pub(super) struct Schedule {
    /// Number of frames since the last search, or since a frame was found to show nothing new.
    since: u32,
    /// Number of frames since the last search.
    rest: u32,
    /// The tile with which the next search begins; 0 for all of the frame.
    tile: u8,
    /// Whether the last search was stopped, and goes on in the next frame.
    is_pending: bool,
    /// Where that search stands.
    place: Place,
    /// The frame that it searches, [`Detector::loads`].
    load: u32,
    /// What the last search looked for.
    sought: Sought,
    still: Still,
}

impl Schedule {
    /// All its bytes are zero.
    pub(super) const NEW: Self = Self {
        since: 0,
        rest: 0,
        tile: 0,
        is_pending: false,
        place: Place::ZERO,
        load: 0,
        sought: Sought { wish: Wish { threshold: 0.0, visible: 0.0, depth: Depth::Usual }, model: 0 },
        still: Still::NOTHING,
    };

    /// Makes the next frame be searched.
    pub(super) const fn search_next(&mut self) {
        (self.since, self.rest) = (SEARCH_EVERY, RECHECK);
        self.is_pending = false;
    }

    /// Forgets the frames so far.
    pub(super) fn reset(&mut self) {
        self.tile = 0;
        self.is_pending = false;
        self.still.forget();
    }

    /// Whether this frame, which has been counted, may have to be searched though all instances are in sight.
    pub(super) const fn is_due(&self) -> bool {
        self.since >= SEARCH_EVERY || self.tile > 0
    }

    /// Counts a frame.
    pub(super) const fn count(&mut self) {
        self.since = self.since.saturating_add(1);
        self.rest = self.rest.saturating_add(1);
    }

    /// Takes the search that goes on, unless the detector has been used for something else, or
    /// something else is sought now. Returns where it stands.
    pub(super) fn take_pending<P: Profile + ?Sized>(
        &mut self,
        detector: &Detector<P>,
        sought: &Sought,
    ) -> Option<Place> {
        let suits = self.is_pending && self.load == detector.loads() && self.sought == *sought;
        self.is_pending = false;
        suits.then_some(self.place)
    }

    /// Keeps a search that goes on in the next frame.
    pub(super) fn keep<P: Profile + ?Sized>(&mut self, detector: &Detector<P>, place: Place, sought: &Sought) {
        self.still.forget();
        (self.is_pending, self.place, self.load, self.sought) = (true, place, detector.loads(), *sought);
    }

    /// Whether a frame may show something new. Where it does not, it counts as searched.
    pub(super) fn may_be_new(&mut self, frame: &PyramidView<'_>, sought: &Sought) -> bool {
        let known = self.rest < RECHECK && self.tile == 0 && self.sought == *sought && self.still.holds(frame);
        if known {
            self.since = 0;
        }
        !known
    }

    /// Where a search of the next frame begins.
    pub(super) const fn start(&self) -> Place {
        Place::at_tile(self.tile)
    }

    /// Notes that all of a frame has been searched, as far as the search goes.
    pub(super) fn searched_all(&mut self, frame: &PyramidView<'_>, sought: &Sought) {
        // After a search that began with a tile, other parts are of frames before.
        if self.tile == 0 {
            self.still.remember(frame);
            self.sought = *sought;
        } else {
            self.still.forget();
        }
        (self.since, self.rest, self.tile) = (0, 0, 0);
    }

    /// Notes that a search was stopped at this tile. `is_in_turn` tells whether the next frame is
    /// searched from the next tile on.
    pub(super) fn stopped_at(&mut self, tile: u8, is_in_turn: bool) {
        self.still.forget();
        let next = tile + 1;
        self.tile = if is_in_turn && next <= Tile::COUNT { next } else { 0 };
        (self.since, self.rest) = (0, 0);
    }
}
