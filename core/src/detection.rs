//! One instance of an object in a frame, and what speaks for it: votes that agree with it,
//! how it looks, and the score that comes of them.
//!
//! In: a detection and the votes. Out: a probability. Memory: none. Cost: three points
//! mapped for each vote; 72 points for each pair of outlines.

use crate::align::Appearance;
use crate::geometry::{Homography, area, contains};
use crate::math;
use crate::model::Model;
use crate::pose::{AGREEMENT, CORNER_NOISE_PX};
use crate::vote::Vote;

/// One instance of an object in a frame.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Detection {
    /// Index of the object in the model.
    pub object: u16,
    /// Picture px to frame px, last element 1.
    pub homography: Homography,
    /// Images of the picture's corners `(0,0) (w,0) (w,h) (0,h)`, frame px.
    pub corners: [[f32; 2]; 4],
    /// Estimate of the probability that the detection is right, 0 to 1.
    pub score: f32,
    /// Keygraphs whose three vertices agree with the pose.
    pub votes: u16,
    /// Distinct frame corners that agree with the pose.
    pub agreeing: u16,
    /// How the frame looks there.
    pub appearance: Appearance,
}

impl Detection {
    /// A pose without evidence.
    pub(crate) fn at(model: &Model<'_>, object: u16, homography: &Homography) -> Self {
        let o = model.object(usize::from(object));
        Self {
            object,
            homography: *homography,
            corners: homography.outline(o.width as f32, o.height as f32),
            score: 0.0,
            votes: 0,
            agreeing: 0,
            appearance: Appearance::default(),
        }
    }

    /// Whether it stands for the same instance as `other`.
    pub(crate) fn is_twin(&self, other: &Self) -> bool {
        self.object == other.object && overlap(&self.corners, &other.corners)
    }
}

/// Whether votes agree with a pose.
pub(crate) struct Agreement {
    object: u16,
    homography: Homography,
    radius2: f32,
}

impl Agreement {
    pub(crate) fn new(d: &Detection) -> Self {
        let radius = (AGREEMENT * math::sqrt(area(&d.corners).abs())).max(CORNER_NOISE_PX);
        Self { object: d.object, homography: d.homography, radius2: radius * radius }
    }

    pub(crate) fn holds(&self, model: &Model<'_>, v: &Vote, to: [[f32; 2]; 3]) -> bool {
        if v.object != self.object {
            return false;
        }
        let (view, from) = model.keygraph(v.model_keygraph as usize);
        let h = self.homography.after(&model.view(view).to_picture);
        from.iter().zip(to).all(|(from, to)| {
            let p = h.apply(from.px());
            let (dx, dy) = (p[0] - to[0], p[1] - to[1]);
            dx * dx + dy * dy < self.radius2
        })
    }
}

/// What the votes and keygraphs of a frame say of a detection.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Evidence {
    /// Weight of the votes that agree with it.
    pub agreeing: u32,
    /// Votes for its object inside its outline, agreeing or not.
    pub votes: u16,
    /// Keygraphs inside its outline.
    pub keygraphs: u16,
}

/// Estimate of the probability that a pose is right: a logistic regression over 1,844
/// right and 11,360 wrong candidates, of rendered frames of twelve kinds and of the
/// worst 511 in 62,000 pairs of a frame and an object that it does not show.
pub(crate) fn score(a: &Appearance, evidence: &Evidence) -> f32 {
    if a.blocks < 4 {
        return 0.0;
    }
    let log1p = |v: f32| math::ln(1.0 + v);
    // A vote of full weight counts as two; the blocks' logarithm is that of their share,
    // 37 being all and one.
    let logit = 4.07 * log1p(evidence.agreeing as f32 / 8.0) - 1.10 * log1p(f32::from(evidence.votes))
        + 2.58 * log1p(f32::from(evidence.keygraphs))
        + 13.15 * log1p(a.strong)
        + 15.92 * (log1p(f32::from(a.inside)) - math::ln(37.0))
        - 25.57;
    1.0 / (1.0 + math::exp(-logit))
}

/// Whether two outlines of one object stand for one instance: a quarter of either
/// lies inside the other. Two planar objects cannot be at one place, and a pattern
/// that repeats itself makes shifted copies of its own outline.
pub(crate) fn overlap(a: &[[f32; 2]; 4], b: &[[f32; 2]; 4]) -> bool {
    const SIDE: u8 = 6;
    let share = |inner: &[[f32; 2]; 4], outer: &[[f32; 2]; 4]| {
        let mix = |p: [f32; 2], q: [f32; 2], t: f32| [p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t];
        let at = |i: u8| (f32::from(i) + 0.5) / f32::from(SIDE);
        let point = |x: u8, y: u8| mix(mix(inner[0], inner[1], at(x)), mix(inner[3], inner[2], at(x)), at(y));
        let inside = |i: &u8| contains(outer, point(i % SIDE, i / SIDE));
        (0..SIDE * SIDE).filter(inside).count()
    };
    4 * share(a, b).max(share(b, a)) >= usize::from(SIDE * SIDE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_of_one_instance_overlap() {
        let at = |x: f32| [[x, 0.0], [x + 10.0, 0.0], [x + 10.0, 10.0], [x, 10.0]];
        assert!(overlap(&at(0.0), &at(6.5)), "a third");
        assert!(!overlap(&at(0.0), &at(8.5)), "a sixth");
        let small = [[2.0, 2.0], [4.0, 2.0], [4.0, 4.0], [2.0, 4.0]];
        assert!(overlap(&at(0.0), &small) && overlap(&small, &at(0.0)));
    }

    #[test]
    fn the_score_moves_with_each_piece_of_evidence() {
        let appearance = Appearance { blocks: 36, inside: 30, median: 0.5, support: 5.0, strong: 1.3, chroma: 0.0 };
        let evidence = Evidence { agreeing: 30, votes: 15, keygraphs: 120 };
        let base = score(&appearance, &evidence);
        assert!((0.05..0.95).contains(&base), "{base}");
        let with = |f: &dyn Fn(&mut Appearance, &mut Evidence)| {
            let (mut a, mut e) = (appearance, evidence);
            f(&mut a, &mut e);
            score(&a, &e)
        };
        assert!(with(&|_, e| e.agreeing += 40) > base);
        assert!(with(&|_, e| e.keygraphs += 100) > base);
        assert!(with(&|a, _| a.strong += 0.5) > base);
        assert!(with(&|a, _| a.inside += 6) > base);
        assert!(with(&|_, e| e.votes += 15) < base, "votes that disagree");
        assert_eq!(with(&|a, _| a.blocks = 3), 0.0, "too little to see");
    }
}
