//! Aligns a track to what is seen of the next frame.
//!
//! In: the pyramid of the frame, or of a part of it, and a track. Out: where the track is, if the
//! frame looks like the object anywhere near. Memory: none. Cost: some 50,000 bilinear samples a
//! track, a third more on targets without vectors.

use crate::base::geometry::{Homography, area};
use crate::base::math;
use crate::base::pace::Steady;
use crate::detect::align::{Refinement, refine_by};
use crate::detect::appearance::{Appearance, appearance_of_luma, support};
use crate::detect::detection::Detection;
use crate::follow::instance::{STAY, SURE, State, Track};
use crate::image::pyramid::PyramidView;
use crate::model::parse::Model;

/// Minimum support (number of blocks that agree) at the predicted pose, and after the coarse steps.
/// The first is 0, because the frame at the predicted pose may look like nothing when an object
/// moved far.
const LEAST_SUPPORT: [f32; 2] = [0.0, 0.8];

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
    let aligned = refine_by(&STEPS, LEAST_SUPPORT, &sight.view, &o.template, &sight.within(start), size, &mut Steady)?;
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
}
