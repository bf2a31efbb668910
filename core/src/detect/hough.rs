//! Counts votes in bins; the fullest bins become candidates.
//!
//! In: votes. Out: the poses with the most votes, heaviest first. Votes are counted in a sparse
//! Hough table over (object, x, y, rotation, size). A position bin is a quarter of the size, as in
//! D. Lowe, *Distinctive Image Features from Scale-Invariant Keypoints*, IJCV 2004. A vote near a
//! bin border counts in both bins. A keygraph counts once in a bin.
//!
//! Memory: 12 bytes for each bin. Cost: about five bins for each vote; to find the peaks, the
//! number of candidates times the number of bins. Full: votes for new bins are counted as dropped.

use heapless::VecView;

use crate::base::capacity::StageStats;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::vote::{Similarity, Vote};
use crate::model::method::VoteRule;

/// A bin of the Hough table; all its bytes are zero when it is free.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bin {
    key: u32,
    weight: u32,
    object: u16,
    /// Index of the keygraph that voted last, plus one; 0 for a free bin.
    last: u16,
}

impl Bin {
    /// A free bin.
    pub const FREE: Self = Self { key: 0, weight: 0, object: 0, last: 0 };

    /// Whether no vote has fallen into the bin.
    #[must_use]
    pub const fn is_free(&self) -> bool {
        self.last == 0
    }
}

/// A pose with many votes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Candidate {
    /// Index of the object.
    pub object: u16,
    /// Mean pose of the votes in and near the candidate's bin.
    pub pose: Similarity,
    /// Sum of the weights of the votes in the candidate's bin.
    pub weight: u32,
}

/// Number of rotation bins, 20 degrees each.
const ROTATIONS: i32 = 18;
/// Number of position bins to the left of the frame's origin, and above it.
const OFFSET: i32 = 256;
/// Total number of position bins in each direction.
const WIDE: i32 = 1024;

/// Coordinates of a bin: size in half octaves, rotation in 20 degrees, x and y in quarters of the
/// size.
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

/// The bin that `v` falls into. If `soft` is true and `v` is within a quarter of a bin of a border,
/// also the bin beyond that border.
fn near(v: f32, soft: bool) -> impl Iterator<Item = i32> {
    let bin = math::floor(v);
    let inside = v - bin as f32;
    let beyond = match inside {
        _ if !soft => None,
        f if f < 0.25 => Some(bin.saturating_sub(1)),
        f if f >= 0.75 => Some(bin.saturating_add(1)),
        _ => None,
    };
    core::iter::once(bin).chain(beyond)
}

/// Calls `put` with the key of each bin that a pose falls into.
#[inline(always)]
fn each_bin(pose: &Similarity, soft: bool, mut put: impl FnMut(u32)) {
    let rotation = f32::from(pose.rotation) * (ROTATIONS as f32 / 65536.0);
    for s in near(f32::from(pose.size) / 128.0, soft) {
        let width = position_bin(s);
        for r in near(rotation, soft) {
            for x in near(pose.centre[0] / width, soft) {
                for y in near(pose.centre[1] / width, soft) {
                    put(pack([s, r, x, y]));
                }
            }
        }
    }
}

/// Counts the votes in `bins`, which are cleared first. Writes the heaviest bins to `out` as
/// candidates, heaviest first, without the neighbours of a heavier bin. Votes of one frame keygraph
/// must be next to each other. Returns the counts of votes in bins.
pub fn find_candidates(
    votes: &[Vote],
    rule: &VoteRule,
    bins: &mut [Bin],
    out: &mut VecView<Candidate>,
    pace: &mut dyn Pace,
) -> StageStats {
    let mut stats = StageStats::default();
    out.clear();
    bins.fill(Bin::FREE);
    for v in votes {
        if !pace.goes_on() {
            return stats;
        }
        each_bin(&v.pose, rule.soft, |key| {
            stats.seen += 1;
            match slot(bins, key, v.object) {
                Some(b) if b.last != v.frame_keygraph + 1 => {
                    b.weight += u32::from(v.weight);
                    b.last = v.frame_keygraph + 1;
                    stats.kept += 1;
                }
                Some(_) => {}
                None => stats.dropped += 1,
            }
        });
    }
    peaks(bins, rule, out, pace);
    for c in out.iter_mut() {
        if !pace.goes_on() {
            break;
        }
        c.pose = mean(votes, c);
    }
    stats
}

/// Mean pose of the votes within soft reach of the candidate's bin.
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

/// The bin with this key and object, or a free bin near its place in the table, which becomes this
/// bin. `None` when the table is full there.
fn slot(bins: &mut [Bin], key: u32, object: u16) -> Option<&mut Bin> {
    const PROBES: usize = 24;
    let hash = (key ^ u32::from(object) << 11).wrapping_mul(0x9e37_79b1);
    let n = bins.len();
    // The high half of the product spreads the keys best.
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

/// The heaviest bin; `None` when all bins weigh less than `least`. Among bins of equal weight it is
/// the one with the lowest object and key, so that the order in the table does not matter.
fn heaviest(bins: &[Bin], least: u32) -> Option<Bin> {
    let weight = bins.iter().map(|b| b.weight).max().unwrap_or(0);
    if weight < least {
        return None;
    }
    bins.iter().filter(|b| b.weight == weight).min_by_key(|b| (b.object, b.key)).copied()
}

/// Writes the heaviest bins to `out`, and empties the bins around each.
fn peaks(bins: &mut [Bin], rule: &VoteRule, out: &mut VecView<Candidate>, pace: &mut dyn Pace) {
    while !out.is_full() && pace.goes_on() {
        let Some(best) = heaviest(bins, rule.min_weight.max(1)) else { return };
        let c = unpack(best.key);
        let width = position_bin(c[0]);
        let middle = |v: i32| (v as f32 + 0.5) * width;
        let rotation = (c[1] * 65536 + 32768) / ROTATIONS;
        let pose = Similarity {
            centre: [middle(c[2]), middle(c[3])],
            rotation: u16::try_from(rotation).unwrap_or(0),
            size: i16::try_from(c[0] * 128 + 64).unwrap_or(i16::MAX),
        };
        // This push cannot fail: the loop ends when `out` is full.
        let _ = out.push(Candidate { object: best.object, pose, weight: best.weight });
        pace.goes_on();
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
    use crate::base::pace::Steady;
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
    fn agreeing_votes_win_even_across_a_bin_border() {
        let mut poses = std::vec![pose(500.0, 90.0, 200.0, 60.0), pose(20.0, 400.0, 77.0, 300.0)];
        for i in 0..6 {
            let d = i as f32;
            // The votes lie around rotation 0, where the bins wrap.
            poses.push(pose(200.0 + d, 150.0 - d, d - 3.0, 128.0 + d));
        }
        let mut bins = [Bin::FREE; 512];
        let mut out: Vec<Candidate, 4> = Vec::new();
        let stats = find_candidates(&votes(&poses, 3), &SOFT, &mut bins, &mut out, &mut Steady);
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
        find_candidates(&v, &SOFT, &mut bins, &mut out, &mut Steady);
        assert_eq!(out.iter().map(|c| (c.object, c.weight)).collect::<std::vec::Vec<_>>(), [(1, 4)]);
    }

    #[test]
    fn a_full_table_counts_what_it_drops() {
        let poses: std::vec::Vec<_> = (0..40).map(|i| pose(15.0 * i as f32, 200.0, 9.0 * i as f32, 64.0)).collect();
        let mut bins = [Bin::FREE; 16];
        let mut out: Vec<Candidate, 4> = Vec::new();
        let stats = find_candidates(&votes(&poses, 0), &SOFT, &mut bins, &mut out, &mut Steady);
        assert!(stats.dropped > 0);
        assert_eq!(stats.kept + stats.dropped, stats.seen);
    }
}
