//! Aligns a track to what is seen of the next frame.
//!
//! In: the pyramid of the frame, or of a part of it, and a track. Out: where the track is, if the
//! frame looks like the object anywhere near. Memory: none. Cost: some 50,000 bilinear samples a
//! track, a third more on targets without vectors.

use core::ops::Range;

use crate::base::capacity::LEVELS;
use crate::base::geometry::{Homography, area};
use crate::base::math;
use crate::base::pace::Steady;
use crate::detect::align::{Least, Refinement, refine_by};
use crate::detect::appearance::{Appearance, appearance_of_luma, support};
use crate::detect::detection::Detection;
use crate::follow::instance::{STAY, SURE, State, Track};
use crate::image::frame::{Frame, MIN_SIDE, Window};
use crate::image::pyramid::PyramidView;
use crate::model::parse::Model;

/// Minimum support (number of blocks that agree) at the predicted pose, and after the coarse steps.
/// The first is 0, because the frame at the predicted pose may look like nothing when an object
/// moved far.
const LEAST_SUPPORT: Least = Least { start: 0.0, then: 0.8, fine: 0.0 };

/// Steps of the alignment of a pose that is nearly right; see `align`.
const STEPS: [Refinement; 3] = [
    Refinement { level: 2, blocks: 4, times: 5, still: 0.1, keep: 1.0 },
    Refinement { level: 1, blocks: 6, times: 4, still: 0.05, keep: 1.0 },
    Refinement { level: 0, blocks: 6, times: 3, still: 0.04, keep: 0.98 },
];

/// How far the neighbourhood is searched each way, in px of level `GLANCE_LEVEL` of the template.
const GLANCE: i8 = 4;
const GLANCE_LEVEL: usize = 2;

/// Maximum factor by which an area may change from one frame to the next.
const MAX_GROWTH: f32 = 2.0;

/// The part of a frame that is looked at. `corner` is its upper left corner in the frame, px.
pub(super) struct Sight<'a> {
    pub(super) view: PyramidView<'a>,
    pub(super) corner: [f32; 2],
}

impl Sight<'_> {
    /// Returns in px of the part a pose that is in px of the frame.
    fn within(&self, h: &Homography) -> Homography {
        Homography::affine([1.0, 0.0, -self.corner[0], 0.0, 1.0, -self.corner[1]]).after(h)
    }

    /// Returns in px of the frame a pose that is in px of the part.
    fn without(&self, h: &Homography) -> Homography {
        Homography::affine([1.0, 0.0, self.corner[0], 0.0, 1.0, self.corner[1]]).after(h)
    }
}

/// Returns the part of a frame that may show the tracks. It holds the places where they were
/// and where they are expected, with a margin of a quarter of their longer side. The margin is
/// wider than `glance` searches.
pub(super) fn part_of(tracks: &[Track], frame: &Frame<'_>, model: &Model<'_>) -> Window {
    let mut reach = [[f32::MAX, f32::MIN]; 2];
    for t in tracks.iter().filter(|t| usize::from(t.detection.object) < model.objects()) {
        let o = model.object(usize::from(t.detection.object));
        let predicted = t.predicted().map(|h| h.outline(o.width as f32, o.height as f32));
        for outline in [Some(t.detection.corners), predicted].into_iter().flatten() {
            let bounds = [0, 1].map(|side| {
                let along = || outline.iter().map(|p| p[side]);
                [along().fold(f32::MAX, f32::min), along().fold(f32::MIN, f32::max)]
            });
            let longer = bounds.iter().map(|[least, most]| most - least).fold(0.0, f32::max);
            let beside = (longer / 4.0).max(LEAST_MARGIN_PX);
            for (reach, [least, most]) in reach.iter_mut().zip(bounds) {
                *reach = [reach[0].min(least - beside), reach[1].max(most + beside)];
            }
        }
    }
    let (columns, rows) = (span(reach[0], frame.width()), span(reach[1], frame.height()));
    Window { x: columns.start, y: rows.start, width: columns.len(), height: rows.len() }
}

/// Minimum margin beside a track, px.
const LEAST_MARGIN_PX: f32 = 16.0;

/// Returns the range from `least` to `most` within a side of `side` px. It begins and ends at whole
/// pixels of the coarsest level, or at the end of the side. It has at least as many pixels as the
/// side of a frame must have.
fn span([least, most]: [f32; 2], side: usize) -> Range<usize> {
    const STEP: usize = 1 << (LEVELS - 1);
    let whole = |v: f32| usize::try_from(math::floor(v)).unwrap_or(0).min(side);
    let start = whole(least).min(side - MIN_SIDE) / STEP * STEP;
    start..whole(most).next_multiple_of(STEP).max(start + MIN_SIDE).min(side)
}

/// Returns where a track is in this frame. Returns `None` when nothing nearby looks like it.
pub(super) fn follow(sight: &Sight<'_>, model: &Model<'_>, track: &Track, threshold: f32) -> Option<Detection> {
    let last = &track.detection.homography;
    if track.state == State::Lost {
        return align(sight, model, track, last, threshold.max(SURE)).filter(|d| track.is_sure(d));
    }
    let stay = STAY * threshold;
    let predicted = track.predicted().unwrap_or(*last);
    let straight = align(sight, model, track, &predicted, stay);
    if straight.is_some_and(|d| track.is_sure(&d)) {
        return straight;
    }
    let near = align(sight, model, track, &glance(sight, model, track, &predicted), stay);
    let score = |d: &Option<Detection>| d.map_or(-1.0, |d| d.score);
    if score(&near) > score(&straight) { near } else { straight }
}

/// Aligns a pose of a track with the frame. Returns `None` when the score is below `least`, or when
/// the outline is not plausible or its area changed too much.
fn align(sight: &Sight<'_>, model: &Model<'_>, track: &Track, start: &Homography, least: f32) -> Option<Detection> {
    let last = &track.detection;
    let o = model.object(usize::from(last.object));
    let size = [o.width as f32, o.height as f32];
    let aligned = refine_by(&STEPS, &LEAST_SUPPORT, &sight.view, &o.template, &sight.within(start), size, &mut Steady)?;
    let appearance = appearance_of_luma(&sight.view, &o.template, &aligned, size, &mut Steady);
    let homography = sight.without(&aligned).normalised();
    let d = Detection {
        appearance,
        score: score(&appearance),
        votes: last.votes,
        agreeing: last.agreeing,
        ..Detection::at(model, last.object, &homography)
    };
    let growth = area(&d.corners) / area(&last.corners);
    let believed = d.score >= least && d.is_plausible() && (1.0 / MAX_GROWTH..MAX_GROWTH).contains(&growth);
    believed.then_some(d)
}

/// Returns the pose, shifted to the place at which the frame looks most like the object.
fn glance(sight: &Sight<'_>, model: &Model<'_>, track: &Track, start: &Homography) -> Homography {
    let o = model.object(usize::from(track.detection.object));
    let size = [o.width as f32, o.height as f32];
    let t = o.template.luma(GLANCE_LEVEL);
    let step = math::sqrt(area(&start.outline(size[0], size[1])).abs() / (t.width() * t.height()) as f32);
    let mut best = (*start, 0.0);
    for y in -GLANCE..=GLANCE {
        for x in -GLANCE..=GLANCE {
            let shift = Homography::affine([1.0, 0.0, f32::from(x) * step, 0.0, 1.0, f32::from(y) * step]);
            let h = shift.after(start);
            let support = support(&sight.view, &o.template, GLANCE_LEVEL, &sight.within(&h), size);
            if support > best.1 {
                best = (h, support);
            }
        }
    }
    best.0.normalised()
}

/// Returns an estimate of the probability that a followed pose is right. It is a logistic
/// regression over 116 right and 320 wrong poses. They come from rendered and real frames in which
/// the object moved, was hidden, changed its light, or left.
fn score(a: &Appearance) -> f32 {
    if a.blocks < 4 {
        return 0.0;
    }
    let logit = 6.0 * math::ln(1.0 + a.support) + 2.0 * (math::ln(1.0 + f32::from(a.inside)) - math::ln(37.0)) - 10.4;
    1.0 / (1.0 + math::exp(-logit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_score_grows_with_what_is_seen() {
        let a =
            Appearance { blocks: 30, inside: 36, visible: 0.5, median: 0.5, support: 5.0, strong: 3.0, chroma: 0.0 };
        assert!(score(&Appearance { support: 8.0, ..a }) > score(&a));
        assert!(score(&a) > score(&Appearance { inside: 18, ..a }));
        assert_eq!(score(&Appearance { blocks: 3, ..a }), 0.0, "too little to see");
    }

    #[test]
    fn a_span_is_whole_pixels_of_every_level_within_the_frame() {
        let ends = [f32::MIN, -40.0, 0.0, 3.2, 15.9, 77.0, 500.5, 640.0, 900.0, f32::MAX, f32::INFINITY, f32::NAN];
        for side in [16, 17, 23, 100, 640] {
            for (least, most) in ends.iter().flat_map(|&a| ends.map(|b| (a, b))) {
                let span = span([least, most], side);
                let whole = |v: usize| v.is_multiple_of(8);
                assert!(whole(span.start) && (whole(span.end) || span.end == side), "{least} to {most} of {side}");
                assert!(span.len() >= MIN_SIDE && span.end <= side, "{least} to {most} of {side}: {span:?}");
                let within = |v: f32| v >= 0.0 && v < side as f32;
                for v in [least, most].into_iter().filter(|&v| within(v) && least <= most) {
                    assert!((span.start as f32..span.end as f32).contains(&v), "{least} to {most} of {side}: {span:?}");
                }
            }
        }
    }
}
