//! Finds what a frame shows, level by level: keypoints, keygraphs and their features.
//!
//! In: the pyramid of a frame, and a [`Finder`]. Out: the keygraphs of the levels that are asked
//! for, with their features. The levels above the finest come first: they have a third of the
//! pixels of the finest. That one follows when a search asks for it.
//!
//! Memory: borrowed buffers. Cost: that of the stages `corners`, `delaunay`, `keygraphs` and
//! `features`. Full: each stage keeps what came first, and counts what it dropped.

use core::ops::Range;

use heapless::VecView;

use crate::base::capacity::{Buffer, LEVELS, Stage, StageStats, count, id};
use crate::base::crew::Team;
use crate::base::geometry::Point;
use crate::base::pace::Pace;
use crate::base::sort::sort_by_key;
use crate::detect::detection::{Detection, is_inside};
use crate::detect::finder::Finder;
use crate::detect::help::WORTH;
use crate::detect::observer::{Laps, Output, Tally};
use crate::detect::tile::Tile;
use crate::extract::corners::Corner;
use crate::extract::delaunay::Triple;
use crate::extract::feature::{Feature, extract};
use crate::extract::keygraph::{Keygraph, collect_keygraphs};
use crate::image::pyramid::{PyramidView, to_level0};
use crate::model::parse::Model;

/// The finest level, which is searched last: it has three in four of all pixels.
pub(crate) const FINEST: u8 = 0;

/// Ranges of the keypoints of each level among all keypoints: start and end.
pub(crate) type Spans = [(u16, u16); LEVELS];

/// The keypoints of one level, as a range of indices.
pub(crate) fn span(spans: &Spans, level: usize) -> Range<usize> {
    let (start, end) = spans[level];
    usize::from(start)..usize::from(end)
}

/// The vertices of a keygraph: their indices, and their positions in level 0, px.
pub(crate) fn vertices(points: &[Point], k: &Keygraph) -> [(u16, [f32; 2]); 3] {
    k.vertices.map(|v| (v, to_level0(points[usize::from(v)], usize::from(k.level))))
}

/// The model and the counts that the search of a level works with.
pub(crate) struct Context<'a, 'o> {
    pub(crate) model: &'a Model<'a>,
    pub(crate) tally: &'a mut Tally,
    pub(crate) laps: &'a mut Laps<'o>,
}

/// The keypoints and keygraphs of a frame, as far as its levels have been searched.
pub(crate) struct Scene<'a> {
    pub(crate) pyramid: PyramidView<'a>,
    /// The part of the frame that is searched; `None` for all of it.
    pub(crate) tile: Option<Tile>,
    /// Keypoints of all levels, in the order in which the levels were searched.
    pub(crate) points: &'a mut VecView<Point>,
    pub(crate) spans: &'a mut Spans,
    /// Keygraphs of the levels above the finest, then those of the finest. Once they have features, each
    /// part is in the order of the partition: what is read of the model for one is then still in the
    /// cache for the next.
    pub(crate) keygraphs: &'a mut VecView<Keygraph>,
    /// Features of the keygraphs, one for each.
    pub(crate) features: &'a mut [Feature],
    /// Corners and triples of the level that is being searched.
    pub(crate) corners: &'a mut VecView<Corner>,
    pub(crate) triples: &'a mut VecView<Triple>,
}

impl Scene<'_> {
    /// Finds the keygraphs of a level. In a tile, corners in the outlines of what was `found` are left
    /// out, and the number of corners is at most `thirds` of that of a whole frame.
    pub(crate) fn find_level(
        &mut self,
        level: u8,
        (found, thirds): (&[Detection], usize),
        finder: &mut dyn Finder,
        context: &mut Context<'_, '_>,
    ) {
        let level = usize::from(level);
        self.find_keypoints(level, (found, thirds), finder, context);
        context.laps.end(context.tally, Output::Corners(&self.points[span(self.spans, level)]));
        self.find_triples(level, finder, context);
        context.laps.end(context.tally, Output::Triangles(self.triples));
        let first = self.keygraphs.len();
        self.find_keygraphs(level, context);
        context.laps.end(context.tally, Output::Keygraphs(&self.keygraphs[first..]));
    }

    #[inline(never)]
    fn find_keypoints(
        &mut self,
        level: usize,
        (found, thirds): (&[Detection], usize),
        finder: &mut dyn Finder,
        context: &mut Context<'_, '_>,
    ) {
        self.corners.clear();
        let (start, tally) = (self.points.len(), &mut *context.tally);
        let whole = self.pyramid.luma(level);
        let (luma, origin) = self.tile.map_or((whole, Point::default()), |t| t.in_level(whole, level));
        if luma.width().min(luma.height()) >= 8 {
            let mut stats = finder.keypoints(luma, level, self.corners, context.laps);
            let held = self.corners.capacity().min(stats.seen as usize).max(self.corners.len());
            tally.mark(Buffer::Corners, held);
            tally.mark(Buffer::Triangulation, self.corners.len());
            let mut room = self.points.capacity() - self.points.len();
            let mut explained: &[Detection] = &[];
            if self.tile.is_some() {
                room = room.min(context.model.method().parameters().corner_limits[level] * thirds / 3);
                explained = found;
            }
            let points = self.corners.iter().map(|c| c.point.moved(origin));
            let mut is_new = |p: &Point| {
                context.laps.goes_on();
                !is_inside(explained, to_level0(*p, level))
            };
            self.points.extend(points.filter(|p| is_new(p)).take(room));
            // Keypoints that do not fit, or are explained, are counted as dropped.
            let lost = count(self.corners.len() - (self.points.len() - start));
            stats.kept = stats.kept.saturating_sub(lost);
            stats.dropped += lost;
            tally.add(Stage::Corners, stats);
        }
        tally.mark(Buffer::Keypoints, self.points.len());
        self.spans[level] = (id(start), id(self.points.len()));
    }

    /// Empties the scene, to search another part of the frame.
    pub(crate) fn turn_to(&mut self, tile: Tile) {
        self.tile = Some(tile);
        self.points.clear();
        self.keygraphs.clear();
        *self.spans = [(0, 0); LEVELS];
    }

    #[inline(never)]
    fn find_triples(&mut self, level: usize, finder: &mut dyn Finder, context: &mut Context<'_, '_>) {
        self.triples.clear();
        let stats = finder.triples(&self.points[span(self.spans, level)], self.triples, context.laps);
        context.tally.mark(Buffer::Triples, self.triples.len());
        context.tally.add(Stage::Delaunay, stats);
    }

    fn find_keygraphs(&mut self, level: usize, context: &mut Context<'_, '_>) {
        let range = span(self.spans, level);
        let (first, n) = (id(range.start), id(range.len()));
        // A finder of the caller may err: triples with indices out of range are left out.
        self.triples.retain(|t| t.iter().all(|&v| v < n));
        let rule = &context.model.method().parameters().scalene;
        let level = u8::try_from(level).unwrap_or(0);
        let stats =
            collect_keygraphs(&self.points[range], self.triples, rule, first, level, self.keygraphs, context.laps);
        context.tally.mark(Buffer::Keygraphs, self.keygraphs.len());
        context.tally.mark(Buffer::Features, self.keygraphs.len());
        context.tally.add(Stage::Keygraphs, stats);
    }

    /// Brings the keygraphs from index `first` on into the order of the partition, and extracts their
    /// features.
    #[inline(never)]
    pub(crate) fn extract_features(&mut self, first: usize, team: Option<Team>, context: &mut Context<'_, '_>) {
        let model = context.model;
        sort_by_key(&mut self.keygraphs[first..], |k| (k.key.cell(), k.size, k.vertices), context.laps);
        let Self { pyramid, points, keygraphs, features, .. } = self;
        let of = |k: &Keygraph| {
            let vertices = k.vertices.map(|v| points[usize::from(v)]);
            extract(pyramid, k.level.into(), vertices, k.size, model.feature(), model.method().sampling())
        };
        let mut done = first;
        let mut mine = |keygraphs: &[Keygraph], features: &mut [Feature]| {
            for (k, f) in keygraphs.iter().zip(features) {
                if !context.laps.goes_on() {
                    break;
                }
                done += 1;
                *f = of(k);
            }
        };
        match team.filter(|team| keygraphs.len() - first >= WORTH && team.crew.is_free()) {
            Some(team) => {
                let half = first.midpoint(keygraphs.len());
                let (near, far) = features.split_at_mut(half);
                let mut other = || keygraphs[half..].iter().zip(&mut *far).for_each(|(k, f)| *f = of(k));
                team.crew.both(&mut || mine(&keygraphs[first..half], &mut near[first..]), &mut other);
                if done == half {
                    done = keygraphs.len();
                }
            }
            None => mine(&keygraphs[first..], &mut features[first..]),
        }
        // Keygraphs without features are left out.
        self.keygraphs.truncate(done);
        let n = count(done - first);
        context.tally.add(Stage::Features, StageStats { seen: n, kept: n, dropped: 0 });
        let features = &self.features[first..done];
        context.laps.end(context.tally, Output::Features(features, model.feature_bytes()));
    }
}
