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

/// Estimate of the probability that a pose is right: a logistic regression over 515
/// right and 6,175 wrong candidates of hard frames, rendered and real.
pub(crate) fn score(d: &Detection) -> f32 {
    let a = &d.appearance;
    if a.blocks < 4 {
        return 0.0;
    }
    let log1p = |n: u16| math::ln(1.0 + f32::from(n));
    // The blocks' logarithm is that of their share, 37 being all and one.
    let logit = 1.22 * log1p(d.agreeing)
        + 3.61 * log1p(d.votes)
        + 6.67 * math::ln(1.0 + a.strong)
        + 3.07 * (log1p(a.inside) - math::ln(37.0))
        - 17.17;
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
    fn the_score_grows_with_each_piece_of_evidence() {
        let blank = Detection {
            object: 0,
            homography: Homography::IDENTITY,
            corners: [[0.0; 2]; 4],
            score: 0.0,
            votes: 5,
            agreeing: 15,
            appearance: Appearance { blocks: 36, inside: 30, median: 0.5, support: 10.0, strong: 6.0, chroma: 0.0 },
        };
        let more = |f: &dyn Fn(&mut Detection)| {
            let mut d = blank;
            f(&mut d);
            score(&d)
        };
        assert!(more(&|d| d.votes += 5) > score(&blank));
        assert!(more(&|d| d.agreeing += 5) > score(&blank));
        assert!(more(&|d| d.appearance.strong += 2.0) > score(&blank));
        assert!(more(&|d| d.appearance.inside += 6) > score(&blank));
        assert_eq!(more(&|d| d.appearance.blocks = 3), 0.0, "too little to see");
    }
}
