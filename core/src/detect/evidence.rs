//! Weighs the evidence for and against a pose, accepts detections, and settles votes.
//!
//! In: a detection, the votes and keygraphs of the frame. Out: the score of the detection, which
//! estimates the probability that it is right; the list of accepted detections; the votes,
//! separated into supporters and open ones.
//!
//! Memory: a bit for each corner on the stack. Cost: for each detection, three points mapped for
//! each vote, and a test of each corner.

use heapless::VecView;

use crate::base::capacity::{LEVELS, id};
use crate::base::geometry::{Homography, area, contains};
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::appearance::Appearance;
use crate::detect::classify::classify;
use crate::detect::detection::{Detection, Detections, is_inside};
use crate::detect::pairing::Pairing;
use crate::detect::pose::{AGREEMENT, CORNER_NOISE_PX, MAX_CORNERS};
use crate::detect::scene::{Scene, span, vertices};
use crate::detect::vote::{Vote, Votes};
use crate::extract::keygraph::Keygraph;
use crate::image::pyramid::to_level0;
use crate::model::parse::Model;

/// Number of votes above which more of them do not raise a score.
pub(crate) const ENOUGH: u16 = 132;

/// Tests whether votes agree with a pose.
pub(crate) struct Agreement {
    object: u16,
    homography: Homography,
    radius2: f32,
}

impl Agreement {
    #[inline(never)]
    pub(crate) fn new(d: &Detection) -> Self {
        let radius = (AGREEMENT * math::coarse_sqrt(area(&d.corners).abs())).max(CORNER_NOISE_PX);
        Self { object: d.object, homography: d.homography, radius2: radius * radius }
    }

    /// Whether vote `v` agrees. `to` are the vertices of its frame keygraph, frame px.
    #[inline(never)]
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

/// Evidence of the votes and keygraphs of a frame for or against a detection.
#[derive(Clone, Copy, Debug, Default)]
struct Evidence {
    /// Weight of the votes that agree with the detection.
    agreeing: u32,
    /// Number of votes for the object inside the outline, whether they agree or not.
    votes: u16,
    /// Number of keygraphs inside the outline.
    keygraphs: u16,
}

/// Estimates the probability that a pose is right. It is a logistic regression over 1,844 right and
/// 11,360 wrong candidates. They come from rendered frames of twelve kinds, and from the worst 511
/// in 62,000 pairs of a frame and an object that it does not show.
fn score(a: &Appearance, evidence: &Evidence) -> f32 {
    if a.blocks < 4 {
        return 0.0;
    }
    let log1p = |v: f32| math::ln(1.0 + v);
    // A vote of full weight counts as two. The term of the blocks is the logarithm of their share:
    // 37 is the number of all blocks plus one.
    let logit = 4.07 * log1p(evidence.agreeing as f32 / 8.0) - 1.10 * log1p(f32::from(evidence.votes))
        + 2.58 * log1p(f32::from(evidence.keygraphs))
        + 13.15 * log1p(a.strong)
        + 15.92 * (log1p(f32::from(a.inside)) - math::ln(37.0))
        - 25.57;
    1.0 / (1.0 + math::exp(-logit))
}

/// Collects the evidence for a detection, and scores it.
#[inline(never)]
pub(crate) fn weigh(
    scene: &Scene<'_>,
    votes: &Votes<VecView<Vote>>,
    model: &Model<'_>,
    d: &mut Detection,
    pace: &mut dyn Pace,
) {
    let mut inside = [0u32; MAX_CORNERS / 32];
    for level in 0..LEVELS {
        for i in span(scene.spans, level) {
            let within = is_inside(core::slice::from_ref(d), to_level0(scene.points[i], level));
            inside[i / 32] |= u32::from(within) << (i % 32);
        }
    }
    let within = |k: &Keygraph| k.vertices.iter().all(|&v| inside[usize::from(v) / 32] >> (v % 32) & 1 == 1);
    let agrees = Agreement::new(d);
    let mut evidence = Evidence::default();
    for v in votes.all().iter().filter(|v| v.object == d.object) {
        pace.goes_on();
        let k = &scene.keygraphs[usize::from(v.frame_keygraph)];
        evidence.votes += u16::from(within(k));
        if agrees.holds(model, v, vertices(scene.points, k).map(|(_, p)| p)) {
            d.votes += 1;
            evidence.agreeing += u32::from(v.weight);
        }
    }
    evidence.keygraphs = id(scene.keygraphs.iter().filter(|k| within(k)).count());
    d.score = score(&d.appearance, &evidence);
}

/// Counts the votes for a pose among all keygraphs of its object, at most about [`ENOUGH`]: what a search for that object
/// alone would count. A search by lists compares a few of them.
#[inline(never)]
pub(crate) fn count_votes(scene: &Scene<'_>, model: &Model<'_>, d: &Detection, pace: &mut dyn Pace) -> u16 {
    let agrees = Agreement::new(d);
    let matching = &model.method().parameters().matching;
    let mut votes = 0;
    for (i, k) in scene.keygraphs.iter().enumerate() {
        if votes >= ENOUGH || !pace.goes_on() {
            break;
        }
        if !is_inside(core::slice::from_ref(d), vertices(scene.points, k)[0].1) {
            continue;
        }
        for tier in model.tiers_of(d.object) {
            let near = classify(model, tier, k, &scene.features[i], matching);
            for m in near.into_iter().flatten() {
                let pairing = Pairing::new(scene, model, id(i), m);
                let vote = pairing.weight(scene, model).and_then(|w| pairing.vote(w));
                votes += u16::from(vote.is_some_and(|v| agrees.holds(model, &v, pairing.in_frame())));
            }
        }
    }
    votes
}

/// Inserts a detection into the list, best score first, if it scores at least `threshold`, is
/// plausible, and is the best at its place. Worse detections of the same instance are removed.
/// Returns whether a detection was lost for lack of room.
#[inline(never)]
pub(crate) fn accept(detections: &mut Detections, d: &Detection, threshold: f32, pace: &mut dyn Pace) -> bool {
    let mut is_twin = |t: &Detection| {
        pace.goes_on();
        d.is_twin(t)
    };
    let beaten = detections.iter().any(|t| t.score >= d.score && is_twin(t));
    if d.score < threshold || !d.is_plausible() || beaten {
        return false;
    }
    detections.retain(|t| !is_twin(t));
    let worse = |t: &Detection| t.score.total_cmp(&d.score).is_lt();
    let place = detections.iter().position(worse).unwrap_or(detections.len());
    detections.insert(place, *d).is_err()
}

/// Puts the detections that are the best at their place first, best score first, and returns their
/// number. Of several objects at one place the best is the one that fits best, by the parts in which
/// they differ.
#[inline(never)]
pub(crate) fn name(detections: &mut Detections, pace: &mut dyn Pace) -> usize {
    let mut beats = |a: &Detection, b: &Detection| {
        pace.goes_on();
        a.beats(b)
    };
    let mut named = 0;
    for i in 0..detections.len() {
        if !detections.iter().any(|other| beats(other, &detections[i])) {
            detections.swap(named, i);
            named += 1;
        }
    }
    named
}

/// The detections that no one before them in the list rivals: one for each place.
pub(crate) fn places<'a>(detections: &'a Detections, pace: &'a mut dyn Pace) -> impl Iterator<Item = &'a Detection> {
    detections
        .iter()
        .enumerate()
        .filter(move |(i, d)| {
            let is_rival = |other: &Detection| {
                pace.goes_on();
                other.is_rival(d)
            };
            !detections[..*i].iter().any(is_rival)
        })
        .map(|(_, d)| d)
}

/// Makes the votes that agree with a detection supporters. Other votes for an object that lie in
/// the outline of one of its detections are removed.
#[inline(never)]
pub(crate) fn settle(
    votes: &mut Votes<VecView<Vote>>,
    scene: &Scene<'_>,
    detections: &Detections,
    model: &Model<'_>,
    pace: &mut dyn Pace,
) {
    let at = |v: &Vote| vertices(scene.points, &scene.keygraphs[usize::from(v.frame_keygraph)]).map(|(_, p)| p);
    votes.settle(
        |v| detections.iter().any(|d| d.object == v.object && Agreement::new(d).holds(model, v, at(v))),
        |v| is_found(detections, v.object, at(v)[0]),
        pace,
    );
}

/// Whether an object has been found at a place, frame px.
#[inline(never)]
pub(crate) fn is_found(detections: &Detections, object: u16, at: [f32; 2]) -> bool {
    detections.iter().any(|d| d.object == object && contains(&d.corners, at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::capacity::DETECTIONS;
    use crate::base::pace::Steady;
    use crate::detect::belief::believe;
    use crate::detect::scrutiny::Scrutiny;

    #[test]
    fn the_score_moves_with_each_piece_of_evidence() {
        let appearance =
            Appearance { blocks: 36, inside: 30, visible: 0.5, median: 0.5, support: 5.0, strong: 1.3, chroma: 0.0 };
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

    #[test]
    fn more_votes_than_enough_raise_no_score() {
        let mut seed = 1u32;
        for _ in 0..2000 {
            let seen = Scrutiny(
                core::array::from_fn(|_| {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (seed >> 24) as u8
                }),
                false,
            );
            let score = |votes| believe(&seen.with_votes(votes));
            assert_eq!(score(ENOUGH), score(u16::MAX), "{seen:?}");
            assert!(score(0) <= score(ENOUGH));
        }
    }

    fn at(object: u16, x: f32, score: f32) -> Detection {
        let homography = Homography::affine([1.0, 0.0, x, 0.0, 1.0, 10.0]);
        Detection { score, ..Detection::new(object, &homography, [50.0; 2]) }
    }

    #[test]
    fn the_object_that_fits_best_names_the_place() {
        let fitting = |d: Detection, support: f32| Detection {
            appearance: Appearance { blocks: 36, support, ..Appearance::default() },
            ..d
        };
        let found = &mut Detections::new();
        let all = [(0, 0.0, 30.0), (1, 4.0, 31.0), (2, 2.0, 12.0), (0, 200.0, 20.0), (1, 300.0, 25.0)];
        for (i, (object, x, support)) in all.into_iter().enumerate() {
            found.push(fitting(at(object, x, 0.99 - 0.01 * i as f32), support)).unwrap();
        }
        // A small object that lies on another is not its rival.
        let small = Homography::affine([0.3, 0.0, 310.0, 0.0, 0.3, 20.0]);
        found.push(fitting(Detection { score: 0.9, ..Detection::new(3, &small, [50.0; 2]) }, 30.0)).unwrap();
        assert_eq!(name(found, &mut Steady), 4);
        let names: std::vec::Vec<_> = found[..4].iter().map(|d| (d.object, d.corners[0][0])).collect();
        assert_eq!(names, [(1, 4.0), (0, 200.0), (1, 300.0), (3, 310.0)]);
        assert!(found[4..].iter().all(|d| d.is_rival(&found[0])), "both others lie there");
    }

    #[test]
    fn the_best_at_a_place_stays_and_the_list_is_in_order() {
        let found = &mut Detections::new();
        let told = |found: &Detections| found.iter().map(|d| (d.object, d.score)).collect::<std::vec::Vec<_>>();
        for d in [at(0, 0.0, 0.9), at(0, 5.0, 0.85), at(1, 5.0, 0.95), at(0, 200.0, 0.7), at(0, 300.0, 0.99)] {
            assert!(!accept(found, &d, 0.8, &mut Steady));
        }
        assert_eq!(told(found), [(0, 0.99), (1, 0.95), (0, 0.9)], "a worse twin and one below the threshold are out");
        assert!(!accept(found, &at(0, 5.0, 0.97), 0.8, &mut Steady), "it takes the place of its twin");
        assert_eq!(told(found), [(0, 0.99), (0, 0.97), (1, 0.95)]);
        for i in 0..DETECTIONS - 3 {
            assert!(!accept(found, &at(2, 400.0 + 60.0 * i as f32, 0.9), 0.8, &mut Steady));
        }
        assert!(accept(found, &at(3, 400.0, 0.9), 0.8, &mut Steady), "one too many");
        assert_eq!(found.len(), DETECTIONS);
    }
}
