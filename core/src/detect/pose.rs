//! Grows a candidate to a homography over all vertex pairs that agree with it.
//!
//! In: a candidate pose and the votes. Out: the homography from the picture to the frame, and the
//! number of frame corners that agree with it. The vertex pairs of all matches of the object that
//! lie near the candidate are fitted robustly (Tukey's biweight) by Gauss-Newton steps. The first
//! steps fit an affine map, the later ones a homography, while the radius of agreement narrows.
//!
//! Picture coordinates are relative to the picture's middle and size. Frame coordinates are
//! relative to the candidate's. All numbers are then near 1, and `f32` is enough for the normal
//! equations.
//!
//! Memory: 20 bytes for each pair. Cost: about 80 operations for each pair and step. Full: further
//! pairs are counted as dropped.

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::geometry::Homography;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::hough::Candidate;
use crate::detect::vote::Vote;
use crate::model::parse::Model;

/// A vertex of the model and the frame corner that a match pairs it with, both in normalised
/// coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pair {
    /// Position in the picture, normalised.
    pub from: [f32; 2],
    /// Position in the frame, normalised.
    pub to: [f32; 2],
    /// Index of the frame corner.
    pub corner: u16,
    /// Weight of the vote that the pair comes from, 1 to 16.
    pub weight: u8,
}

/// Steps of the fit: the radius of agreement, in object sizes, and whether the step fits a
/// homography (otherwise an affine map).
const STEPS: [(f32, bool); 7] =
    [(0.25, false), (0.15, false), (0.10, true), (0.06, true), (0.04, true), (0.03, true), (0.025, true)];

/// Minimum radius of agreement, px: a corner is not located better than this.
pub const CORNER_NOISE_PX: f32 = 2.0;

/// Radius of agreement when the agreeing corners are counted, in object sizes.
pub const AGREEMENT: f32 = 0.025;

/// Maximum number of frame corners that can be told apart when they are counted.
pub const MAX_CORNERS: usize = 4096;

/// Maps between px and normalised coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Normalised {
    picture: [f32; 3],
    frame: [f32; 3],
}

impl Normalised {
    /// Creates the maps for a picture of `width` x `height` px, and a candidate that lies at
    /// `centre` in the frame with a size of `size_px`.
    #[must_use]
    pub fn new(width: f32, height: f32, centre: [f32; 2], size_px: f32) -> Self {
        let middle = |v: f32| (v - 1.0) / 2.0;
        Self {
            picture: [middle(width), middle(height), 1.0 / math::coarse_sqrt(width * height)],
            frame: [centre[0], centre[1], 1.0 / size_px],
        }
    }

    fn picture_unit(&self, p: [f32; 2]) -> [f32; 2] {
        [(p[0] - self.picture[0]) * self.picture[2], (p[1] - self.picture[1]) * self.picture[2]]
    }

    fn frame_unit(&self, p: [f32; 2]) -> [f32; 2] {
        [(p[0] - self.frame[0]) * self.frame[2], (p[1] - self.frame[1]) * self.frame[2]]
    }

    /// Converts a homography between normalised coordinates to one from picture px to frame px.
    #[must_use]
    pub fn to_px(&self, h: &Homography) -> Homography {
        let [px, py, ps] = self.picture;
        let [fx, fy, fs] = self.frame;
        let into = Homography::affine([ps, 0.0, -px * ps, 0.0, ps, -py * ps]);
        let out = Homography::affine([1.0 / fs, 0.0, fx, 0.0, 1.0 / fs, fy]);
        out.after(h).after(&into).normalised()
    }

    /// Converts a homography from picture px to frame px to one between normalised coordinates.
    #[must_use]
    pub fn unit_of(&self, h: &Homography) -> Homography {
        let [px, py, ps] = self.picture;
        let [fx, fy, fs] = self.frame;
        let into = Homography::affine([1.0 / ps, 0.0, px, 0.0, 1.0 / ps, py]);
        let out = Homography::affine([fs, 0.0, -fx * fs, 0.0, fs, -fy * fs]);
        out.after(h).after(&into).normalised()
    }
}

/// Returns the map from which a candidate is grown, in normalised coordinates. Its rotation is that
/// of the candidate's pose. Its shape is the weighted mean over the views of the votes near the
/// pose. The view of a tilted picture says more about an object's shape than a few pairs can.
#[must_use]
pub fn start(model: &Model<'_>, candidate: &Candidate, votes: &[Vote]) -> Homography {
    let pose = &candidate.pose;
    let reach = pose.size_px() / 4.0;
    let (mut shape, mut weight) = ([0.0; 4], 0.0);
    for v in votes.iter().filter(|v| v.object == candidate.object) {
        let turn = v.pose.rotation.wrapping_sub(pose.rotation).cast_signed();
        let (dx, dy) = (v.pose.centre[0] - pose.centre[0], v.pose.centre[1] - pose.centre[1]);
        // The limits are those of a bin: 20 degrees, half an octave, a quarter of the size.
        let near =
            turn.unsigned_abs() < 3641 && v.pose.size.abs_diff(pose.size) < 128 && dx * dx + dy * dy < reach * reach;
        if !near {
            continue;
        }
        let view = model.view(model.keygraph(v.model_keygraph as usize).0);
        let Some(to_view) = view.to_picture.inverse() else { continue };
        let weighed = f32::from(v.weight);
        weight += weighed;
        for (s, i) in shape.iter_mut().zip([0, 1, 3, 4]) {
            *s += weighed * to_view.0[i] / (to_view.0[8] * view.scale);
        }
    }
    if weight == 0.0 {
        return pose.turn();
    }
    let [a, b, c, d] = shape.map(|s| s / weight);
    pose.turn().after(&Homography::affine([a, b, 0.0, c, d, 0.0]))
}

/// Writes to `out` the vertex pairs of the object's votes that lie near `start`, the map of the
/// candidate. `vertices(i)` returns the corners of frame keygraph `i`: their indices, and their
/// positions in level 0, px. Returns the maps to the pairs' coordinates, and the counts of pairs.
pub fn collect_pairs(
    model: &Model<'_>,
    candidate: &Candidate,
    start: &Homography,
    votes: &[Vote],
    vertices: impl Fn(u16) -> [(u16, [f32; 2]); 3],
    out: &mut VecView<Pair>,
    pace: &mut dyn Pace,
) -> (Normalised, StageStats) {
    let object = model.object(usize::from(candidate.object));
    let pose = &candidate.pose;
    let map = Normalised::new(object.width as f32, object.height as f32, pose.centre, pose.size_px());
    let mut stats = StageStats::default();
    out.clear();
    for v in votes.iter().filter(|v| v.object == candidate.object) {
        if !pace.goes_on() {
            break;
        }
        // A vote for another rotation or size cannot belong to this pose.
        let turn = v.pose.rotation.wrapping_sub(pose.rotation).cast_signed();
        if turn.unsigned_abs() > 8192 || v.pose.size.abs_diff(pose.size) > 256 {
            continue;
        }
        let (view, from) = model.keygraph(v.model_keygraph as usize);
        let to_picture = model.view(view).to_picture;
        for (from, (corner, to)) in from.iter().zip(vertices(v.frame_keygraph)) {
            let from = map.picture_unit(to_picture.apply(from.px()));
            let to = map.frame_unit(to);
            let [x, y] = start.apply(from);
            if (x - to[0]) * (x - to[0]) + (y - to[1]) * (y - to[1]) < 0.35 * 0.35 {
                stats.seen += 1;
                match out.push(Pair { from, to, corner, weight: v.weight }) {
                    Ok(()) => stats.kept += 1,
                    Err(_) => stats.dropped += 1,
                }
            }
        }
    }
    (map, stats)
}

/// Strength of the pulls on a fit, which count against what few pairs say.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Prior {
    /// Pull towards the shape that the fit started from.
    pub shape: f32,
    /// Pull towards a map without perspective, for each unit of the pairs' weight.
    pub flat: f32,
}

/// Priors in the order in which they are tried: a weak one for an object that is tilted, a strong
/// one for few pairs close together.
pub const PRIORS: [Prior; 2] = [Prior { shape: 0.0, flat: 2.5e-4 }, Prior { shape: 0.1, flat: 1e-3 }];

/// Fits a homography to `pairs`, from `start` on. `prior` is one of [`PRIORS`]. Returns the map
/// from picture px to frame px; `None` when too few pairs agree or the fit falls apart.
#[must_use]
pub fn grow(
    start: &Homography,
    map: &Normalised,
    pairs: &[Pair],
    prior: Prior,
    pace: &mut dyn Pace,
) -> Option<Homography> {
    let mut h = *start;
    let noise = CORNER_NOISE_PX * map.frame[2];
    for (radius, projective) in STEPS {
        let mut fit = Fit::new(&h, radius.max(noise));
        for p in pairs {
            if !pace.goes_on() {
                return None;
            }
            fit.add(p.from, p.to, f32::from(p.weight) / 8.0);
        }
        h = fit.step(projective, start, prior)?;
    }
    Some(map.to_px(&h))
}

/// Number of distinct frame corners among `pairs` that agree with `h` (picture px to frame px).
#[must_use]
pub fn count_agreeing(map: &Normalised, pairs: &[Pair], h: &Homography) -> u16 {
    let h = map.unit_of(h);
    let mut seen = [0u32; MAX_CORNERS / 32];
    let mut agreeing = 0;
    let radius = (CORNER_NOISE_PX * map.frame[2]).max(AGREEMENT);
    for p in pairs {
        let q = h.apply(p.from);
        let (dx, dy) = (q[0] - p.to[0], q[1] - p.to[1]);
        if dx * dx + dy * dy < radius * radius {
            let (word, bit) = (usize::from(p.corner) / 32 % seen.len(), 1 << (p.corner % 32));
            agreeing += u16::from(seen[word] & bit == 0);
            seen[word] |= bit;
        }
    }
    agreeing
}

/// One Gauss-Newton step of a robust homography fit.
///
/// A pair gives two rows of the design matrix: `[u v o 0 0 0 -x u -x v]` and `[0 0 0 u v o -y u -y
/// v]`. Products that both rows have in common are summed once.
#[derive(Debug)]
pub struct Fit {
    h: Homography,
    radius2: f32,
    /// Sums of the products `uu uv uo vv vo oo`; then sums of the first five times x, and times y.
    plain: [f32; 6],
    by_x: [f32; 5],
    by_y: [f32; 5],
    /// Sums of the products `uu uv vv` times `x x + y y`.
    by_both: [f32; 3],
    /// Sums of `u v o` times the error in x, and in y; then sums of `u v` times `x ex + y ey`.
    error_x: [f32; 3],
    error_y: [f32; 3],
    error_both: [f32; 2],
    weight: f32,
}

/// Adds `values * k` to `sums`, element by element.
pub(crate) fn accumulate<const N: usize>(sums: &mut [f32; N], values: &[f32], k: f32) {
    for (s, v) in sums.iter_mut().zip(values) {
        *s += v * k;
    }
}

impl Fit {
    /// Starts a step from `h`. A pair whose error exceeds `radius` has no weight.
    #[must_use]
    pub fn new(h: &Homography, radius: f32) -> Self {
        Self {
            h: h.normalised(),
            radius2: radius * radius,
            plain: [0.0; 6],
            by_x: [0.0; 5],
            by_y: [0.0; 5],
            by_both: [0.0; 3],
            error_x: [0.0; 3],
            error_y: [0.0; 3],
            error_both: [0.0; 2],
            weight: 0.0,
        }
    }

    /// Adds a pair of points. All coordinates must be near 1.
    pub fn add(&mut self, from: [f32; 2], to: [f32; 2], weight: f32) {
        let h = &self.h.0;
        let d = h[6] * from[0] + h[7] * from[1] + 1.0;
        if d < 0.05 {
            return;
        }
        let o = 1.0 / d;
        let (x, y) = ((h[0] * from[0] + h[1] * from[1] + h[2]) * o, (h[3] * from[0] + h[4] * from[1] + h[5]) * o);
        let (ex, ey) = (to[0] - x, to[1] - y);
        let e2 = (ex * ex + ey * ey) / self.radius2;
        if e2 >= 1.0 {
            return;
        }
        let w = weight * (1.0 - e2) * (1.0 - e2);
        let (u, v) = (from[0] * o, from[1] * o);
        let (wu, wv) = (w * u, w * v);
        let products = [wu * u, wu * v, wu * o, wv * v, wv * o, w * o * o];
        accumulate(&mut self.plain, &products, 1.0);
        accumulate(&mut self.by_x, &products, x);
        accumulate(&mut self.by_y, &products, y);
        accumulate(&mut self.by_both, &[products[0], products[1], products[3]], x * x + y * y);
        accumulate(&mut self.error_x, &[wu, wv, w * o], ex);
        accumulate(&mut self.error_y, &[wu, wv, w * o], ey);
        accumulate(&mut self.error_both, &[wu, wv], x * ex + y * ey);
        self.weight += w;
    }

    /// Upper triangle of the normal equations and their right side.
    fn normal(&self) -> [[f32; 9]; 8] {
        let [uu, uv, uo, vv, vo, oo] = self.plain;
        let mut n = [[0.0; 9]; 8];
        for (at, by, error) in [(0, &self.by_x, &self.error_x), (3, &self.by_y, &self.error_y)] {
            n[at][at..at + 3].copy_from_slice(&[uu, uv, uo]);
            n[at + 1][at + 1..at + 3].copy_from_slice(&[vv, vo]);
            n[at + 2][at + 2] = oo;
            for (row, [a, b]) in [[by[0], by[1]], [by[1], by[3]], [by[2], by[4]]].into_iter().enumerate() {
                n[at + row][6..].copy_from_slice(&[-a, -b, error[row]]);
            }
        }
        n[6][6..].copy_from_slice(&[self.by_both[0], self.by_both[1], -self.error_both[0]]);
        n[7][7..].copy_from_slice(&[self.by_both[2], -self.error_both[1]]);
        n
    }

    /// Total weight of the pairs that agreed.
    #[must_use]
    pub const fn weight(&self) -> f32 {
        self.weight
    }

    /// Returns the homography after the step; it is affine when `projective` is false. `prior`
    /// pulls it towards the shape of `start`. `None` when the pairs do not determine the
    /// homography.
    #[must_use]
    pub fn step(self, projective: bool, start: &Homography, prior: Prior) -> Option<Homography> {
        if self.weight < 2.0 {
            return None;
        }
        let n = if projective { 8 } else { 6 };
        let mut normal = self.normal();
        // A weak pull towards the current map holds the directions that the pairs leave open. A
        // stronger pull keeps the perspective terms from fitting noise.
        for (i, row) in normal.iter_mut().enumerate().take(n) {
            row[i] += if i < 6 { 2e-3 } else { 1e-2 } * self.weight.max(4.0) * 0.25;
        }
        // Few pairs do not determine a shape: it is pulled towards the shape of the start.
        for i in [0, 1, 3, 4] {
            normal[i][i] += prior.shape;
            normal[i][8] += prior.shape * (start.0[i] - self.h.0[i]);
        }
        if projective {
            // This pull acts on the perspective terms themselves, not on their change: they tend to
            // zero.
            let pull = prior.flat * self.weight.max(4.0);
            for (i, row) in normal.iter_mut().enumerate().skip(6) {
                row[i] += pull;
                row[8] -= pull * self.h.0[i];
            }
        }
        let delta = solve(&mut normal, n)?;
        let mut h = self.h;
        for (h, d) in h.0.iter_mut().zip(delta) {
            *h += d;
        }
        h.0.iter().all(|v| v.is_finite()).then_some(h)
    }
}

/// Solves the first `n` symmetric equations by elimination. `m` holds their upper triangle and, in its last
/// column, their right side. `None` when they are singular.
pub(crate) fn solve<const N: usize, const COLUMNS: usize>(m: &mut [[f32; COLUMNS]; N], n: usize) -> Option<[f32; N]> {
    for i in 0..n {
        let pivot = m[i][i];
        if pivot <= 1e-9 {
            return None;
        }
        for r in i + 1..n {
            let f = m[i][r] / pivot;
            let (done, rest) = m.split_at_mut(r);
            for (v, p) in rest[0][r..].iter_mut().zip(&done[i][r..]) {
                *v -= f * p;
            }
        }
    }
    let mut x = [0.0; N];
    for i in (0..n).rev() {
        let known: f32 = (i + 1..n).map(|c| m[i][c] * x[c]).sum();
        x[i] = (m[i][COLUMNS - 1] - known) / m[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use crate::detect::vote::Similarity;

    #[test]
    fn solve_small_system() {
        let mut m = [[0.0; 9]; 8];
        (m[0][0], m[0][1], m[1][1], m[0][8], m[1][8]) = (4.0, 2.0, 3.0, 10.0, 11.0);
        let x = solve(&mut m, 2).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-5 && (x[1] - 3.0).abs() < 1e-5, "{x:?}");
        assert!(solve(&mut [[0.0; 9]; 8], 8).is_none());
    }

    #[test]
    fn a_homography_is_grown_through_outliers() {
        let truth = Homography([0.8, -0.35, 310.0, 0.3, 0.9, 200.0, 2e-4, -1e-4, 1.0]);
        let (w, h) = (200.0, 150.0);
        let centre = truth.apply([99.5, 74.5]);
        let map = Normalised::new(w, h, [centre[0] + 6.0, centre[1] - 5.0], 150.0);
        let mut pairs = std::vec::Vec::new();
        for i in 0..60u16 {
            let p = [f32::from(i * 37 % 200), f32::from(i * 53 % 150)];
            let mut q = truth.apply(p);
            if i % 3 == 0 {
                q[0] += f32::from(i) - 30.0; // every third pair is wrong
                q[1] -= 17.0;
            }
            pairs.push(Pair { from: map.picture_unit(p), to: map.frame_unit(q), corner: i, weight: 8 });
        }
        let pose = Similarity { centre, rotation: 4400, size: 0 };
        let g = grow(&pose.turn(), &map, &pairs, PRIORS[0], &mut Steady).unwrap();
        assert!(count_agreeing(&map, &pairs, &g) >= 40);
        for (a, b) in g.outline(w, h).iter().zip(truth.outline(w, h)) {
            assert!((a[0] - b[0]).abs() < 2.0 && (a[1] - b[1]).abs() < 2.0, "{a:?} for {b:?}");
        }
    }

    #[test]
    fn normalising_there_and_back_changes_nothing() {
        let h = Homography([0.8, -0.35, 310.0, 0.3, 0.9, 200.0, 2e-4, -1e-4, 1.0]);
        let map = Normalised::new(200.0, 150.0, [320.0, 240.0], 140.0);
        let back = map.to_px(&map.unit_of(&h));
        for (a, b) in h.outline(200.0, 150.0).iter().zip(back.outline(200.0, 150.0)) {
            assert!((a[0] - b[0]).abs() < 0.01 && (a[1] - b[1]).abs() < 0.01);
        }
    }
}
