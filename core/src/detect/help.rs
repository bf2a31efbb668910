//! What the other cores of a processor do for the search of a frame.
//!
//! In: luma of the finest level, and keygraphs with their features. Out: the corners and triangles of
//! that level, before the search asks for them ([`Ahead`]); the matches of a block of keygraphs, and the
//! weights of their votes ([`Block`]). The search takes them in the order in which it would have made
//! them: its results are the same to the bit.
//!
//! Memory: a second set of rows, corners, triples and mesh, and 16 bytes for each keygraph of a block.
//! Without the feature `crew` none but a few words of stack. Cost: corners and triangles that were found in
//! vain where the levels above the finest show the object. Full: as the stages.

use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering};

use heapless::VecView;

use crate::base::capacity::{StageStats, id};
use crate::base::crew::Team;
use crate::base::geometry::Point;
use crate::base::pace::{Pace, Steady};
use crate::detect::classify::{Match, NEIGHBOURS};
use crate::detect::finder::{Corners, Finder};
use crate::extract::corners::Corner;
use crate::extract::delaunay::{Triple, Workspace};
use crate::image::plane::Plane;
use crate::model::method::Parameters;

/// What a search needs to be helped.
#[derive(Debug)]
pub(crate) struct Help<'a> {
    pub(crate) ahead: Ahead<'a>,
    pub(crate) block: &'a mut Block,
}

/// What was found on the finest level before the search came to it: its size, and the counts of both stages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foreseen {
    size: [usize; 2],
    keypoints: StageStats,
    triples: StageStats,
}

/// Memory for the corners and triangles of the finest level, and to find them.
#[derive(Debug)]
pub(crate) struct Ahead<'a> {
    pub(crate) team: Team,
    pub(crate) scratch: &'a mut [f32],
    pub(crate) mesh: Workspace<'a>,
    pub(crate) corners: &'a mut VecView<Corner>,
    pub(crate) points: &'a mut VecView<Point>,
    pub(crate) triples: &'a mut VecView<Triple>,
    pub(crate) foreseen: &'a mut Option<Foreseen>,
}

impl Ahead<'_> {
    /// Finds the corners and triangles of `luma`, the pyramid level `level`.
    pub(crate) fn look(&mut self, luma: Plane<'_, u8>, level: usize, rules: &'static Parameters) {
        let mut finder = Corners { rules, scratch: self.scratch, mesh: self.mesh.reborrow() };
        self.corners.clear();
        let keypoints = finder.keypoints(luma, level, self.corners, &mut Steady);
        self.points.clear();
        self.points.extend(self.corners.iter().map(|c| c.point).take(self.points.capacity()));
        self.triples.clear();
        let triples = finder.triples(self.points, self.triples, &mut Steady);
        *self.foreseen = Some(Foreseen { size: [luma.width(), luma.height()], keypoints, triples });
    }
}

/// Gives what another core has found of a level, and finds the rest as [`Corners`] does.
pub(crate) struct Foresight<'a> {
    pub(crate) ours: Corners<'a>,
    pub(crate) ahead: Option<Ahead<'a>>,
    /// The level of which something may be known.
    pub(crate) level: usize,
}

impl Finder for Foresight<'_> {
    fn keypoints(
        &mut self,
        luma: Plane<'_, u8>,
        level: usize,
        out: &mut VecView<Corner>,
        pace: &mut dyn Pace,
    ) -> StageStats {
        if let Some(Ahead { corners, foreseen: Some(foreseen), .. }) = &self.ahead
            && level == self.level
            // A tile is smaller than the level.
            && foreseen.size == [luma.width(), luma.height()]
        {
            // It fits: both have the capacity of the profile.
            out.extend(corners.iter().copied());
            return foreseen.keypoints;
        }
        self.ours.keypoints(luma, level, out, pace)
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, pace: &mut dyn Pace) -> StageStats {
        if let Some(Ahead { points: known, triples, foreseen, .. }) = &mut self.ahead
            && let Some(foreseen) = foreseen.take_if(|_| **known == *points)
        {
            out.extend(triples.iter().copied());
            return foreseen.triples;
        }
        self.ours.triples(points, out, pace)
    }
}

/// Number of keygraphs of a block: most steps have one, since each makes the other cores start and end.
const BLOCK: usize = 2048;

/// Number of keygraphs that a core takes alone before it looks whether another one is free.
const SMALL: usize = 128;

/// Number of keygraphs below which it is not worth to make other cores start.
pub(crate) const WORTH: usize = 256;

/// Number of keygraphs that a core takes at a time: those beside each other read the same part of the model.
const PIECE: usize = 16;

/// A match, and the weight of its vote; no weight when their surroundings are not alike.
pub(crate) type Weighed = (Match, Option<u8>);

/// The matches of some keygraphs in a row, each with the weight of its vote.
#[derive(Debug)]
pub(crate) struct Block {
    keygraphs: Range<u16>,
    /// For each keygraph and neighbour: the model keygraph; distance, [`HELD`], and the weight or 0.
    cells: [[[AtomicU32; 2]; NEIGHBOURS]; BLOCK],
}

/// This cell holds a match.
const HELD: u32 = 0x100;

impl Block {
    /// A block of no keygraphs; all its bytes are zero.
    #[cfg(feature = "crew")]
    pub(crate) const fn new() -> Self {
        let cells = [const { [const { [const { AtomicU32::new(0) }; 2] }; NEIGHBOURS] }; BLOCK];
        Self { keygraphs: 0..0, cells }
    }

    /// Forgets the matches, before a step that compares other keygraphs, or other parts of the model.
    pub(crate) fn clear(&mut self) {
        self.keygraphs = 0..0;
    }

    /// Makes the block hold keygraph `i`: has all cores find the matches of the keygraphs from `i` on, at most
    /// up to `end`, by `matches`. When `pace` stops them, what is held means nothing.
    pub(crate) fn hold(
        &mut self,
        team: Team,
        (i, end): (u16, u16),
        pace: &mut dyn Pace,
        matches: &(dyn Fn(u16) -> [Option<Weighed>; NEIGHBOURS] + Sync),
    ) {
        if self.keygraphs.contains(&i) {
            return;
        }
        let is_shared = usize::from(end - i) >= WORTH && team.crew.is_free();
        self.keygraphs = i..end.min(i.saturating_add(id(if is_shared { BLOCK } else { SMALL })));
        let (first, cells) = (usize::from(i), &self.cells);
        let fill = |piece: Range<usize>| {
            for i in piece {
                for (cell, m) in cells[i - first].iter().zip(matches(id(i))) {
                    let held = m.map_or([0, 0], |(m, weight)| {
                        [m.keygraph, u32::from(m.distance) << 16 | HELD | u32::from(weight.unwrap_or(0))]
                    });
                    cell.iter().zip(held).for_each(|(c, v)| c.store(v, Ordering::Relaxed));
                }
            }
        };
        let all = first..self.keygraphs.end.into();
        if is_shared {
            team.share(all, PIECE, pace, &fill);
        } else {
            all.take_while(|_| pace.goes_on()).for_each(|i| fill(i..i + 1));
        }
    }

    /// The matches of keygraph `i`, which the block must hold.
    pub(crate) fn get(&self, i: u16) -> [Option<Weighed>; NEIGHBOURS] {
        let cells = &self.cells[usize::from(i - self.keygraphs.start)];
        cells.each_ref().map(|cell| {
            let [keygraph, rest] = cell.each_ref().map(|c| c.load(Ordering::Relaxed));
            let [weight, held, near, far] = rest.to_le_bytes();
            let m = Match { keygraph, distance: u16::from_le_bytes([near, far]) };
            (held > 0).then_some((m, (weight > 0).then_some(weight)))
        })
    }
}

#[cfg(all(test, feature = "crew"))]
mod tests {
    use super::*;
    use crate::base::crew::Crew;

    /// A crew of one: does everything itself.
    #[derive(Debug)]
    struct Alone;

    impl Crew for Alone {
        fn is_free(&self) -> bool {
            true
        }

        fn all(&self, mine: &mut dyn FnMut(), others: &(dyn Fn() + Sync)) {
            mine();
            others();
        }

        fn both(&self, mine: &mut dyn FnMut(), other: &mut (dyn FnMut() + Send)) {
            mine();
            other();
        }
    }

    #[test]
    fn a_block_gives_what_it_was_filled_with() {
        let team = Team { crew: &Alone };
        let mut block = std::boxed::Box::new(Block::new());
        let of = |i: u16| {
            let m = |n: u16| Match { keygraph: 70_000 + u32::from(i), distance: i * n };
            [(i & 3 > 0).then(|| (m(1), Some(16))), (i & 3 > 1).then(|| (m(2), None))]
        };
        // The last ones are not worth the help of others.
        for (first, end) in [(0, 2048), (2048, 4096), (4096, 4224), (4224, 4300)] {
            block.hold(team, (first, 4300), &mut Steady, &of);
            (first..end).for_each(|i| assert_eq!(block.get(i), of(i), "{first}: {i}"));
            assert!(!block.keygraphs.contains(&end));
        }
        // What is held is not looked for again, until it is forgotten.
        block.hold(team, (4225, 4300), &mut Steady, &|_| [None; NEIGHBOURS]);
        assert_eq!(block.get(4225), of(4225));
        block.clear();
        block.hold(team, (4225, 4300), &mut Steady, &|_| [None; NEIGHBOURS]);
        assert_eq!(block.get(4225), [None; NEIGHBOURS]);
    }
}
