//! The buffers of a detector, sized at compile time: the profiles.
//!
//! In: seven sizes. Out: the buffers as views. Only their owner, [`Buffers`], knows the sizes. The
//! stages see the views that [`Profile`] lends.
//!
//! Memory: the size of [`Buffers`]. For each profile an assertion below compares it with the
//! profile's budget. All bytes are zero at the start. Cost: none.

use core::fmt;
use core::mem::size_of;

use heapless::{Vec, VecView};

use crate::base::capacity::{Buffer, FEATURE_BYTES, LEVELS, Room, chroma_bytes, luma_bytes, pixels_of};
#[cfg(feature = "crew")]
use crate::base::crew::{Crew, Team};
use crate::base::geometry::Point;
use crate::detect::help::Help;
#[cfg(feature = "crew")]
use crate::detect::help::{Ahead, Block, Foreseen};
use crate::detect::hough::Bin;
use crate::detect::observer::Tally;
use crate::detect::pose::{MAX_CORNERS, Pair};
use crate::detect::scene::Spans;
use crate::detect::search::Findings;
use crate::detect::vote::{Vote, Votes};
use crate::extract::corners::{Corner, SCRATCH_ROWS};
use crate::extract::delaunay::{Triangulation, Triple, Workspace};
use crate::extract::feature::Feature;
use crate::extract::keygraph::Keygraph;
use crate::image::pyramid::{Pyramid, PyramidMut, PyramidView};

/// Buffers for frames of up to 160 x 120 px.
pub type Qqvga = Buffers<{ luma_bytes(160 * 120) }, { chroma_bytes(160 * 120) }, 160, 420, 160, 448, 768>;
/// Buffers for frames of up to 320 x 240 px.
pub type Qvga = Buffers<{ luma_bytes(320 * 240) }, { chroma_bytes(320 * 240) }, 320, 800, 256, 1024, 2048>;
/// Buffers for frames of up to 640 x 480 px.
pub type Vga = Buffers<{ luma_bytes(640 * 480) }, { chroma_bytes(640 * 480) }, 640, 2000, 512, 4096, 6144>;
/// Buffers for frames of up to 1280 x 720 px.
pub type Hd = Buffers<{ luma_bytes(1280 * 720) }, { chroma_bytes(1280 * 720) }, 1280, 4000, 1024, 8192, 12288>;

/// Size of a detector and one raw frame of two bytes a pixel, bytes.
const fn with_frame(buffers: usize, pixels: usize) -> usize {
    buffers + size_of::<usize>() + 2 * pixels
}
const _: () = assert!(with_frame(Qqvga::BYTES, 160 * 120) <= 160 << 10, "qqvga exceeds 160 KB");
const _: () = assert!(with_frame(Qvga::BYTES, 320 * 240) <= 480 << 10, "qvga exceeds 480 KB");
const _: () = assert!(with_frame(Vga::BYTES, 640 * 480) <= 4 << 20, "vga exceeds 4 MB");
const _: () = assert!(with_frame(Hd::BYTES, 1280 * 720) <= 12 << 20, "hd exceeds 12 MB");

/// The bytes of a profile that no [`Room`] counts.
const fn rest(buffers: usize, rooms: &[Room; Buffer::COUNT]) -> usize {
    let (mut rest, mut i) = (buffers, 0);
    while i < Buffer::COUNT {
        rest -= rooms[i].bytes;
        i += 1;
    }
    rest
}
const _: () = assert!(rest(Qqvga::BYTES, &Qqvga::ROOMS) < 9 << 10, "the rest of a detector exceeds 9 KB");
const _: () = assert!(rest(Hd::BYTES, &Hd::ROOMS) < 9 << 10, "the rest of a detector exceeds 9 KB");

/// Size of the largest frame that fits a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Limits {
    /// Maximum length of the longer side, px.
    pub side: usize,
    /// Maximum number of pixels.
    pub pixels: usize,
}

/// The buffers of one profile: [`Qqvga`], [`Qvga`], [`Vga`], [`Hd`], or sizes of your own.
///
/// `LUMA` and `CHROMA` are the bytes of the pyramids ([`luma_bytes`], [`chroma_bytes`]). `SIDE` is
/// the maximum length of a frame's longer side, px. The other parameters are maximum numbers:
/// `CORNERS` of corner candidates, `POINTS` of corners on a level, `KEYGRAPHS` of triples,
/// keygraphs, votes and vertex pairs, `BINS` of vote bins.
#[derive(Debug)]
pub struct Buffers<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> {
    pyramid: Pyramid<LUMA, CHROMA>,
    scratch: [[f32; SIDE]; SCRATCH_ROWS],
    mesh: Triangulation<POINTS>,
    corners: Vec<Corner, CORNERS>,
    points: Vec<Point, CORNERS>,
    triples: Vec<Triple, KEYGRAPHS>,
    keygraphs: Vec<Keygraph, KEYGRAPHS>,
    features: [Feature; KEYGRAPHS],
    votes: Votes<Vec<Vote, KEYGRAPHS>>,
    bins: [Bin; BINS],
    pairs: Vec<Pair, KEYGRAPHS>,
    spans: Spans,
    findings: Findings,
    tally: Tally,
    #[cfg(feature = "crew")]
    aside: Aside<SIDE, CORNERS, POINTS, KEYGRAPHS>,
}

/// What other cores work in, when there are any.
#[cfg(feature = "crew")]
#[derive(Debug)]
struct Aside<const SIDE: usize, const CORNERS: usize, const POINTS: usize, const KEYGRAPHS: usize> {
    team: Option<Team>,
    foreseen: Option<Foreseen>,
    scratch: [[f32; SIDE]; SCRATCH_ROWS],
    mesh: Triangulation<POINTS>,
    corners: Vec<Corner, CORNERS>,
    points: Vec<Point, CORNERS>,
    triples: Vec<Triple, KEYGRAPHS>,
    block: Block,
}

#[cfg(feature = "crew")]
impl<const SIDE: usize, const CORNERS: usize, const POINTS: usize, const KEYGRAPHS: usize>
    Aside<SIDE, CORNERS, POINTS, KEYGRAPHS>
{
    const fn new() -> Self {
        Self {
            team: None,
            foreseen: None,
            scratch: [[0.0; SIDE]; SCRATCH_ROWS],
            mesh: Triangulation::new(),
            corners: Vec::new(),
            points: Vec::new(),
            triples: Vec::new(),
            block: Block::new(),
        }
    }

    fn help(&mut self) -> Option<Help<'_>> {
        let Self { team, foreseen, scratch, mesh, corners, points, triples, block } = self;
        let (scratch, mesh) = (scratch.as_flattened_mut(), mesh.workspace());
        team.map(|team| Help { ahead: Ahead { team, scratch, mesh, corners, points, triples, foreseen }, block })
    }
}

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Buffers<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>
{
    const FITS: () = assert!(
        SIDE <= 2047 && CORNERS <= MAX_CORNERS && KEYGRAPHS < u16::MAX as usize,
        "positions are 16 bits of 1/16 px, ids are u16, corners are counted in a bit set: lower SIDE, CORNERS or KEYGRAPHS"
    );

    /// Size of the largest frame that fits.
    pub const LIMITS: Limits = Limits { side: SIDE, pixels: pixels_of(LUMA) };

    /// Bytes and capacity of each buffer, in the order of [`Buffer::ALL`]. The rest of a detector
    /// is under 9 KB.
    pub const ROOMS: [Room; Buffer::COUNT] = [
        Room { bytes: LUMA, capacity: LUMA },
        Room { bytes: 2 * CHROMA, capacity: 2 * CHROMA },
        Room { bytes: size_of::<[[f32; SIDE]; SCRATCH_ROWS]>(), capacity: SIDE * SCRATCH_ROWS },
        Room { bytes: size_of::<Vec<Corner, CORNERS>>(), capacity: CORNERS },
        Room { bytes: size_of::<Vec<Point, CORNERS>>(), capacity: CORNERS },
        Room { bytes: size_of::<Triangulation<POINTS>>(), capacity: POINTS },
        Room { bytes: size_of::<Vec<Triple, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<Vec<Keygraph, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<[Feature; KEYGRAPHS]>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<Vec<Vote, KEYGRAPHS>>(), capacity: KEYGRAPHS },
        Room { bytes: size_of::<[Bin; BINS]>(), capacity: BINS },
        Room { bytes: size_of::<Vec<Pair, KEYGRAPHS>>(), capacity: KEYGRAPHS },
    ];

    /// Bytes of the buffers, without those that other cores work in ([`Crew`](crate::Crew)).
    #[cfg(not(feature = "crew"))]
    pub const BYTES: usize = size_of::<Self>();
    /// Bytes of the buffers, without those that other cores work in ([`Crew`](crate::Crew)).
    #[cfg(feature = "crew")]
    pub const BYTES: usize = size_of::<Self>() - size_of::<Aside<SIDE, CORNERS, POINTS, KEYGRAPHS>>();

    /// Creates empty buffers; all bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        let () = Self::FITS;
        Self {
            pyramid: Pyramid::new(),
            scratch: [[0.0; SIDE]; SCRATCH_ROWS],
            mesh: Triangulation::new(),
            corners: Vec::new(),
            points: Vec::new(),
            triples: Vec::new(),
            keygraphs: Vec::new(),
            features: [[0; FEATURE_BYTES]; KEYGRAPHS],
            votes: Votes::new(),
            bins: [Bin::FREE; BINS],
            pairs: Vec::new(),
            spans: [(0, 0); LEVELS],
            findings: Findings::EMPTY,
            tally: Tally::EMPTY,
            #[cfg(feature = "crew")]
            aside: Aside::new(),
        }
    }
}

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Default for Buffers<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>
{
    fn default() -> Self {
        Self::new()
    }
}

/// A frame size for searching, with the buffers for it. [`Buffers`] is the only implementation.
/// `dyn Profile` stands for any profile when a program chooses it at run time.
pub trait Profile: Lend + fmt::Debug {}

impl<B: Lend + fmt::Debug> Profile for B {}

/// All buffers as views, for a search.
#[derive(Debug)]
pub struct Lent<'a> {
    pub(super) pyramid: PyramidMut<'a>,
    pub(super) scratch: &'a mut [f32],
    pub(super) mesh: Workspace<'a>,
    pub(super) corners: &'a mut VecView<Corner>,
    pub(super) points: &'a mut VecView<Point>,
    pub(super) triples: &'a mut VecView<Triple>,
    pub(super) keygraphs: &'a mut VecView<Keygraph>,
    pub(super) features: &'a mut [Feature],
    pub(super) votes: &'a mut Votes<VecView<Vote>>,
    pub(super) bins: &'a mut [Bin],
    pub(super) pairs: &'a mut VecView<Pair>,
    pub(super) spans: &'a mut Spans,
    pub(super) findings: &'a mut Findings,
    pub(super) tally: &'a mut Tally,
    /// Other cores, and what they work in.
    pub(super) help: Option<Help<'a>>,
}

/// Results of the last search, as views.
#[derive(Debug)]
pub struct Shown<'a> {
    pub(super) pyramid: PyramidView<'a>,
    pub(super) points: &'a [Point],
    pub(super) keygraphs: &'a [Keygraph],
    pub(super) votes: &'a [Vote],
    pub(super) spans: &'a Spans,
    pub(super) findings: &'a Findings,
    pub(super) tally: &'a Tally,
}

/// Lends buffers as views. This is the part of [`Profile`] that is not for callers.
pub trait Lend {
    /// Size of the largest frame that fits.
    fn limits(&self) -> Limits;
    /// Bytes and capacity of each buffer, in the order of [`Buffer::ALL`].
    fn rooms(&self) -> [Room; Buffer::COUNT];
    /// Lends all buffers, for a search.
    fn lend(&mut self) -> Lent<'_>;
    /// Shows the results of the last search.
    fn show(&self) -> Shown<'_>;
    /// Sets the cores that share a search.
    #[cfg(feature = "crew")]
    fn set_crew(&mut self, crew: Option<&'static dyn Crew>);
}

impl<
    const LUMA: usize,
    const CHROMA: usize,
    const SIDE: usize,
    const CORNERS: usize,
    const POINTS: usize,
    const KEYGRAPHS: usize,
    const BINS: usize,
> Lend for Buffers<LUMA, CHROMA, SIDE, CORNERS, POINTS, KEYGRAPHS, BINS>
{
    fn limits(&self) -> Limits {
        Self::LIMITS
    }

    fn rooms(&self) -> [Room; Buffer::COUNT] {
        Self::ROOMS
    }

    fn lend(&mut self) -> Lent<'_> {
        Lent {
            pyramid: self.pyramid.planes_mut(),
            scratch: self.scratch.as_flattened_mut(),
            mesh: self.mesh.workspace(),
            corners: &mut self.corners,
            points: &mut self.points,
            triples: &mut self.triples,
            keygraphs: &mut self.keygraphs,
            features: &mut self.features,
            votes: &mut self.votes,
            bins: &mut self.bins,
            pairs: &mut self.pairs,
            spans: &mut self.spans,
            findings: &mut self.findings,
            tally: &mut self.tally,
            #[cfg(feature = "crew")]
            help: self.aside.help(),
            #[cfg(not(feature = "crew"))]
            help: None,
        }
    }

    #[cfg(feature = "crew")]
    fn set_crew(&mut self, crew: Option<&'static dyn Crew>) {
        let Aside { team, foreseen, block, .. } = &mut self.aside;
        let old = team.map(|team| core::ptr::from_ref(team.crew).cast::<()>());
        if old != crew.map(|crew| core::ptr::from_ref(crew).cast()) {
            // What was found before is of another frame by now, perhaps.
            *foreseen = None;
            block.clear();
        }
        *team = crew.map(|crew| Team { crew });
    }

    fn show(&self) -> Shown<'_> {
        Shown {
            pyramid: self.pyramid.view(),
            points: &self.points,
            keygraphs: &self.keygraphs,
            votes: self.votes.all(),
            spans: &self.spans,
            findings: &self.findings,
            tally: &self.tally,
        }
    }
}
