//! Matches vote for a pose of their object.
//!
//! In: matches. Out: the poses with most votes. A match maps three vertices of a
//! view to three corners of the frame; the similarity that fits them best (least
//! squares) says where the object's middle lies, how it is turned and how large
//! it is. Votes are counted in a sparse Hough table over (object, x, y, rotation,
//! size); position bins are a quarter of the size, as in D. Lowe, *Distinctive
//! Image Features from Scale-Invariant Keypoints*, IJCV 2004. A vote near a bin
//! border goes to both bins; a keygraph counts once in a bin.
//!
//! Memory: 12 bytes a bin. Cost: some five bins a vote; candidates times bins to
//! find the peaks. Full: votes for new bins are counted as dropped.

use heapless::VecView;

use crate::capacity::StageStats;
use crate::classify::Match;
use crate::geometry::Homography;
use crate::math;
use crate::model::{Object, View};

/// A pose hypothesis: where the middle of an object lies, and its turn and size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Similarity {
    /// Middle of the picture in the frame, px.
    pub centre: [f32; 2],
    /// Rotation, in turns of 65,536; from the x axis towards the y axis.
    pub rotation: u16,
    /// Size in the frame (square root of the area): `256 log2(px)`.
    pub size: i16,
}

impl Similarity {
    /// Size in the frame, px.
    #[must_use]
    pub fn size_px(&self) -> f32 {
        math::exp(f32::from(self.size) * (core::f32::consts::LN_2 / 256.0))
    }

    /// Rotation, radians.
    #[must_use]
    pub fn radians(&self) -> f32 {
        f32::from(self.rotation) * (core::f32::consts::TAU / 65536.0)
    }

    /// The rotation alone.
    #[must_use]
    pub fn turn(&self) -> Homography {
        let (sin, cos) = math::sin_cos(self.radians());
        Homography::affine([cos, -sin, 0.0, sin, cos, 0.0])
    }
}

/// One match and the pose that it speaks for.
#[derive(Clone, Copy, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Vote {
    /// The pose.
    pub pose: Similarity,
    /// Index of the model keygraph.
    pub model_keygraph: u32,
    /// Index of the frame keygraph.
    pub frame_keygraph: u16,
    /// The object.
    pub object: u16,
    /// How much the vote counts, 1 to 16.
    pub weight: u8,
}

/// The pose that maps the vertices `from` of a view of an object to `to`, both in
/// px, by least squares. `object_size` is the square root of the picture's area.
/// `None` for degenerate vertices.
#[must_use]
pub fn similarity(view: &View, object_size: f32, from: [[f32; 2]; 3], to: [[f32; 2]; 3]) -> Option<Similarity> {
    let mean = |p: &[[f32; 2]; 3], i: usize| (p[0][i] + p[1][i] + p[2][i]) / 3.0;
    let (fx, fy, tx, ty) = (mean(&from, 0), mean(&from, 1), mean(&to, 0), mean(&to, 1));
    // z = sum(conj(from) * to) / sum(|from|^2), as complex numbers
    let (mut re, mut im, mut norm) = (0.0, 0.0, 0.0);
    for (f, t) in from.iter().zip(&to) {
        let (ax, ay, bx, by) = (f[0] - fx, f[1] - fy, t[0] - tx, t[1] - ty);
        re += ax * bx + ay * by;
        im += ax * by - ay * bx;
        norm += ax * ax + ay * ay;
    }
    let (re, im) = (re / norm, im / norm);
    let scale2 = re * re + im * im;
    if !(scale2 > 1e-6 && scale2 < 1e6) {
        return None;
    }
    let (cx, cy) = (view.centre[0] - fx, view.centre[1] - fy);
    let size = math::sqrt(scale2) * view.scale * object_size;
    let turns = math::coarse_atan2(im, re) * (65536.0 / core::f32::consts::TAU);
    Some(Similarity {
        centre: [tx + re * cx - im * cy, ty + re * cy + im * cx],
        rotation: math::round(turns).rem_euclid(65536).try_into().unwrap_or(0),
        size: i16::try_from(math::round(math::log2(size.max(1.0)) * 256.0)).unwrap_or(i16::MAX),
    })
}

/// Makes the vote of one match, which counts `weight`: `from` are its vertices in
/// `view` of `object`, px; `to` those of the frame keygraph in level 0, px.
#[must_use]
pub fn cast(
    object: &Object<'_>,
    view: &View,
    m: Match,
    frame_keygraph: u16,
    from: [[f32; 2]; 3],
    to: [[f32; 2]; 3],
    weight: u8,
) -> Option<Vote> {
    let object_size = math::sqrt(object.width as f32 * object.height as f32);
    let pose = similarity(view, object_size, from, to)?;
    Some(Vote { pose, model_keygraph: m.keygraph, frame_keygraph, object: view.object, weight })
}

/// How votes are binned.
#[derive(Clone, Copy, Debug)]
pub struct VoteRule {
    /// Whether a vote near a bin border goes to both bins.
    pub soft: bool,
    /// Least weight of a candidate.
    pub min_weight: u32,
}

/// One bin of the Hough table; all zero when it is free.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bin {
    key: u32,
    weight: u32,
    object: u16,
    /// The keygraph that voted last, plus one.
    last: u16,
}

impl Bin {
    /// A free bin.
    pub const FREE: Self = Self { key: 0, weight: 0, object: 0, last: 0 };

    /// Whether no vote has fallen into it.
    #[must_use]
    pub const fn is_free(&self) -> bool {
        self.last == 0
    }
}

/// A pose that many matches speak for.
#[derive(Clone, Copy, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Candidate {
    /// The object.
    pub object: u16,
    /// The mean of the votes in and near its bin.
    pub pose: Similarity,
    /// Its votes.
    pub weight: u32,
}

const ROTATIONS: i32 = 18;
const OFFSET: i32 = 256;
const WIDE: i32 = 1024;

/// A bin's coordinates: size in half octaves, rotation in 20 degrees, position in
/// quarters of the size.
type Coordinates = [i32; 4];

fn pack([s, r, x, y]: Coordinates) -> u32 {
    let inside = |v: i32| v.saturating_add(OFFSET).clamp(0, WIDE - 1).unsigned_abs();
    (s.clamp(0, 31).unsigned_abs() << 25 | r.rem_euclid(ROTATIONS).unsigned_abs() << 20) | inside(x) << 10 | inside(y)
}

fn unpack(key: u32) -> Coordinates {
    let field = |shift: u32, bits: u32| (key >> shift & ((1 << bits) - 1)).cast_signed();
    [field(25, 5), field(20, 5), field(10, 10) - OFFSET, field(0, 10) - OFFSET]
}

/// Width of a position bin, px.
fn position_bin(size_bin: i32) -> f32 {
    math::exp(size_bin as f32 * (core::f32::consts::LN_2 / 2.0)) / 4.0
}

/// The bin that `v` falls into and, if it lies within a quarter of a bin of the
/// border, the bin beyond.
fn near(v: f32, soft: bool) -> (i32, Option<i32>) {
    let bin = math::floor(v);
    let inside = v - bin as f32;
    let beyond = match inside {
        _ if !soft => None,
        f if f < 0.25 => Some(bin.saturating_sub(1)),
        f if f >= 0.75 => Some(bin.saturating_add(1)),
        _ => None,
    };
    (bin, beyond)
}

fn both((bin, beyond): (i32, Option<i32>)) -> impl Iterator<Item = i32> {
    core::iter::once(bin).chain(beyond)
}

/// Counts the votes in `bins`, which is cleared first, and leaves the heaviest
/// bins, apart from their neighbours, in `out`, heaviest first.
pub fn vote(votes: &[Vote], rule: &VoteRule, bins: &mut [Bin], out: &mut VecView<Candidate>) -> StageStats {
    let mut stats = StageStats::default();
    bins.fill(Bin::FREE);
    for v in votes {
        let p = &v.pose;
        let rotation = f32::from(p.rotation) * (ROTATIONS as f32 / 65536.0);
        for s in both(near(f32::from(p.size) / 128.0, rule.soft)) {
            let width = position_bin(s);
            for r in both(near(rotation, rule.soft)) {
                for x in both(near(p.centre[0] / width, rule.soft)) {
                    for y in both(near(p.centre[1] / width, rule.soft)) {
                        stats.seen += 1;
                        match slot(bins, pack([s, r, x, y]), v.object) {
                            Some(b) if b.last != v.frame_keygraph + 1 => {
                                b.weight += u32::from(v.weight);
                                b.last = v.frame_keygraph + 1;
                                stats.kept += 1;
                            }
                            Some(_) => {}
                            None => stats.dropped += 1,
                        }
                    }
                }
            }
        }
    }
    peaks(bins, rule, out);
    for c in out.iter_mut() {
        c.pose = mean(votes, c);
    }
    stats
}

/// The mean pose of the votes within (soft) reach of the candidate's bin.
fn mean(votes: &[Vote], c: &Candidate) -> Similarity {
    let reach = c.pose.size_px() / 4.0;
    let (mut sum, mut n) = ([0.0f32; 4], 0.0f32);
    for v in votes.iter().filter(|v| v.object == c.object) {
        let p = &v.pose;
        let d = [
            p.centre[0] - c.pose.centre[0],
            p.centre[1] - c.pose.centre[1],
            f32::from(p.rotation.wrapping_sub(c.pose.rotation).cast_signed()),
            f32::from(p.size.saturating_sub(c.pose.size)),
        ];
        let limits = [reach, reach, 65536.0 / ROTATIONS as f32, 128.0];
        if d.iter().zip(limits).all(|(d, l)| d.abs() <= 0.75 * l) {
            let w = f32::from(v.weight);
            sum.iter_mut().zip(d).for_each(|(s, d)| *s += w * d);
            n += w;
        }
    }
    if n == 0.0 {
        return c.pose;
    }
    let [x, y, turn, size] = sum.map(|s| s / n);
    let step = |v: f32| i16::try_from(math::round(v)).unwrap_or(0);
    Similarity {
        centre: [c.pose.centre[0] + x, c.pose.centre[1] + y],
        rotation: c.pose.rotation.wrapping_add_signed(step(turn)),
        size: c.pose.size.saturating_add(step(size)),
    }
}

/// The bin of a pose, an old one or a free one close to its place in the table.
fn slot(bins: &mut [Bin], key: u32, object: u16) -> Option<&mut Bin> {
    const PROBES: usize = 24;
    let hash = (key ^ u32::from(object) << 11).wrapping_mul(0x9e37_79b1);
    let n = bins.len();
    // The high half of the product spreads best.
    let start = usize::try_from((u64::from(hash) * n as u64) >> 32).unwrap_or(0);
    let at = (0..PROBES.min(n)).map(|i| if start + i < n { start + i } else { start + i - n }).find(|&i| {
        let b = &bins[i];
        b.is_free() || (b.key == key && b.object == object)
    })?;
    let b = &mut bins[at];
    if b.is_free() {
        *b = Bin { key, object, ..Bin::FREE };
    }
    Some(b)
}

fn peaks(bins: &mut [Bin], rule: &VoteRule, out: &mut VecView<Candidate>) {
    out.clear();
    while !out.is_full() {
        // Equal weights are told apart by their keys, not by where they lie.
        let weight = bins.iter().map(|b| b.weight).max().unwrap_or(0);
        if weight < rule.min_weight.max(1) {
            return;
        }
        let heaviest = bins.iter().filter(|b| b.weight == weight).min_by_key(|b| (b.object, b.key));
        let Some(best) = heaviest.copied() else { return };
        let c = unpack(best.key);
        let width = position_bin(c[0]);
        let middle = |v: i32| (v as f32 + 0.5) * width;
        let rotation = (c[1] * 65536 + 32768) / ROTATIONS;
        let pose = Similarity {
            centre: [middle(c[2]), middle(c[3])],
            rotation: u16::try_from(rotation).unwrap_or(0),
            size: i16::try_from(c[0] * 128 + 64).unwrap_or(i16::MAX),
        };
        // It fits: the buffer is not full.
        let _ = out.push(Candidate { object: best.object, pose, weight: best.weight });
        for b in bins.iter_mut().filter(|b| b.weight > 0 && b.object == best.object) {
            let o = unpack(b.key);
            let turn = (o[1] - c[1]).rem_euclid(ROTATIONS);
            let step = position_bin(o[0]);
            let close = |i: usize| ((o[i] as f32 + 0.5) * step - middle(c[i])).abs() <= 1.3 * width.max(step);
            if (o[0] - c[0]).abs() <= 1 && (turn <= 1 || turn == ROTATIONS - 1) && close(2) && close(3) {
                b.weight = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;

    const SOFT: VoteRule = VoteRule { soft: true, min_weight: 3 };

    fn pose(x: f32, y: f32, degrees: f32, px: f32) -> Similarity {
        Similarity {
            centre: [x, y],
            rotation: ((degrees / 360.0 * 65536.0) as i32).rem_euclid(65536) as u16,
            size: (px.log2() * 256.0).round() as i16,
        }
    }

    fn votes(poses: &[Similarity], object: u16) -> std::vec::Vec<Vote> {
        let v = |(i, &pose): (usize, &Similarity)| Vote {
            pose,
            object,
            frame_keygraph: i as u16,
            weight: 1,
            ..Vote::default()
        };
        poses.iter().enumerate().map(v).collect()
    }

    #[test]
    fn keys_come_back() {
        for c in [[0, 0, 0, 0], [22, 17, -200, 400], [11, 3, 767, -256]] {
            assert_eq!(unpack(pack(c)), c);
        }
        assert_eq!(unpack(pack([5, -1, 0, 0])), [5, 17, 0, 0], "rotation wraps");
    }

    #[test]
    fn a_similarity_is_read_off_three_vertices() {
        let view = View {
            object: 0,
            keypoints: 3,
            first: 0,
            to_picture: Homography::IDENTITY,
            centre: [50.0, 40.0],
            scale: 0.5,
        };
        // A quarter turn, twice as large, moved by (300, 20).
        let to = |[x, y]: [f32; 2]| [300.0 - 2.0 * y, 20.0 + 2.0 * x];
        let from = [[10.0, 10.0], [70.0, 20.0], [30.0, 60.0]];
        let s = similarity(&view, 100.0, from, from.map(to)).unwrap();
        assert!((s.centre[0] - 220.0).abs() < 1e-3 && (s.centre[1] - 120.0).abs() < 1e-3, "{s:?}");
        assert!(s.rotation.abs_diff(16384) < 32, "{s:?}");
        assert!((s.size_px() - 100.0).abs() < 0.2, "2 * 0.5 * 100, not {}", s.size_px());
        assert!(similarity(&view, 100.0, [[5.0, 5.0]; 3], from).is_none());
    }

    #[test]
    fn agreeing_votes_win_even_across_a_bin_border() {
        let mut poses = std::vec![pose(500.0, 90.0, 200.0, 60.0), pose(20.0, 400.0, 77.0, 300.0)];
        for i in 0..6 {
            let d = i as f32;
            // Around rotation 0, where the bins wrap.
            poses.push(pose(200.0 + d, 150.0 - d, d - 3.0, 128.0 + d));
        }
        let mut bins = [Bin::FREE; 512];
        let mut out: Vec<Candidate, 4> = Vec::new();
        let stats = vote(&votes(&poses, 3), &SOFT, &mut bins, &mut out);
        assert_eq!((out.len(), stats.dropped), (1, 0));
        let c = &out[0];
        assert_eq!((c.object, c.weight), (3, 6));
        assert!((c.pose.centre[0] - 200.0).abs() < 48.0 && (c.pose.centre[1] - 150.0).abs() < 48.0, "{c:?}");
    }

    #[test]
    fn one_keygraph_counts_once_and_objects_are_apart() {
        let mut v = votes(&[pose(100.0, 100.0, 30.0, 100.0); 5], 0);
        for v in &mut v {
            v.frame_keygraph = 7;
        }
        v.extend(votes(&[pose(100.0, 100.0, 30.0, 100.0); 4], 1));
        let mut bins = [Bin::FREE; 256];
        let mut out: Vec<Candidate, 4> = Vec::new();
        vote(&v, &SOFT, &mut bins, &mut out);
        assert_eq!(out.iter().map(|c| (c.object, c.weight)).collect::<std::vec::Vec<_>>(), [(1, 4)]);
    }

    #[test]
    fn a_full_table_counts_what_it_drops() {
        let poses: std::vec::Vec<_> = (0..40).map(|i| pose(15.0 * i as f32, 200.0, 9.0 * i as f32, 64.0)).collect();
        let mut bins = [Bin::FREE; 16];
        let mut out: Vec<Candidate, 4> = Vec::new();
        let stats = vote(&votes(&poses, 0), &SOFT, &mut bins, &mut out);
        assert!(stats.dropped > 0);
        assert_eq!(stats.kept + stats.dropped, stats.seen);
    }
}
