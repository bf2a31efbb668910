//! Which model keygraphs a frame keygraph looks like.
//!
//! In: a frame keygraph and its feature. Out: its nearest neighbours among the
//! model keygraphs whose angles agree within a tolerance. Every partition subset
//! that the tolerance touches is looked at (the paper looks at one); in a subset
//! sorted by its largest angle only the run within the tolerance is read; keys
//! are compared before features; a comparison ends as soon as it cannot win.
//!
//! Memory: [`Match`], 8 bytes. Cost: the run lengths; the heart of the detector.

use crate::capacity::FEATURE_BYTES;
use crate::feature::Feature;
use crate::keygraph::{BIN, Key, LARGEST_BINS, SECOND_BINS, cell_of};
use crate::model::{KEY, Model};

/// What counts as a match.
#[derive(Clone, Copy, Debug)]
pub struct MatchRule {
    /// Tolerance of both angles, half-degrees, for a triangle with long sides.
    /// Raising it finds more under tilt and reads more of the model.
    pub tolerance: u8,
    /// A pixel of noise turns a short side: this over the shortest side in px is
    /// added to the tolerance, half-degrees.
    pub tolerance_px: u16,
    /// Most that the size in the frame may differ from the size in the view,
    /// sixteenths of an octave. Corners come back at the scale at which they
    /// were trained, so a triangle of another size is another triangle.
    pub size_window: u8,
    /// Most that a feature byte may differ on average, 1/16.
    pub max_distance: u16,
    /// Whether only the subset that the key falls into is searched, and the
    /// nearest alone is kept: the paper.
    pub one_cell: bool,
}

/// A model keygraph that a frame keygraph looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Match {
    /// Index of the model keygraph.
    pub keygraph: u32,
    /// Sum of absolute differences of the feature bytes.
    pub distance: u16,
}

/// Most matches of a keygraph.
pub const NEIGHBOURS: usize = 6;

/// The nearest neighbours, nearest first.
pub type Nearest = [Option<Match>; NEIGHBOURS];

/// Finds the best matches of a keygraph with this key, size, shortest side
/// (px) and feature.
#[must_use]
pub fn classify(model: &Model<'_>, key: Key, size: u8, shortest: u8, feature: &Feature, rule: &MatchRule) -> Nearest {
    let bytes = model.feature().bytes();
    let mut search = Search {
        keys: model.keys(),
        features: model.features(),
        feature: &feature[..bytes],
        size,
        rule,
        limit: distance_limit(bytes, rule) + 1,
        best: [None; NEIGHBOURS],
    };
    if rule.one_cell {
        search.run(model.cell(key.cell()), 0, u8::MAX, 0, u8::MAX);
        search.best[1..].fill(None);
        return search.best;
    }
    let noise = rule.tolerance_px / u16::from(shortest.max(1));
    let tolerance = rule.tolerance.saturating_add(u8::try_from(noise).unwrap_or(u8::MAX));
    let (s0, s1) = (key.second.saturating_sub(tolerance), key.second.saturating_add(tolerance));
    let (l0, l1) = (key.largest.saturating_sub(tolerance), key.largest.saturating_add(tolerance));
    let bins = |from: u8, to: u8, n: usize| from / BIN..=(to / BIN).min(u8::try_from(n - 1).unwrap_or(0));
    for second in bins(s0, s1, SECOND_BINS) {
        for largest in bins(l0, l1, LARGEST_BINS) {
            search.run(model.cell(cell_of(key.mirrored, second, largest)), s0, s1, l0, l1);
        }
    }
    search.best
}

/// Largest distance of a match on features of `bytes` bytes. The fewer bytes, the
/// more their mean difference scatters: twelve of luma alone may differ by half more.
#[must_use]
pub fn distance_limit(bytes: usize, rule: &MatchRule) -> u32 {
    let limit = u32::try_from(bytes).unwrap_or(0) * u32::from(rule.max_distance) / 16;
    if bytes <= 12 { limit + limit / 2 } else { limit }
}

struct Search<'a> {
    keys: &'a [u8],
    features: &'a [u8],
    feature: &'a [u8],
    size: u8,
    rule: &'a MatchRule,
    /// Only distances below this are of interest.
    limit: u32,
    best: Nearest,
}

impl Search<'_> {
    fn run(&mut self, cell: core::ops::Range<usize>, s0: u8, s1: u8, l0: u8, l1: u8) {
        let n = self.feature.len();
        let keys = &self.keys[KEY * cell.start..KEY * cell.end];
        let skipped = partition_point(keys, l0);
        let features = &self.features[n * (cell.start + skipped)..n * cell.end];
        // Ranges as one comparison each: v - low <= high - low, wrapping.
        let seconds = s1 - s0;
        let z0 = self.size.saturating_sub(self.rule.size_window);
        let sizes = self.size.saturating_add(self.rule.size_window) - z0;
        let candidates = keys[KEY * skipped..].chunks_exact(KEY).zip(features.chunks_exact(n));
        for (i, (key, feature)) in candidates.enumerate() {
            if key[0] > l1 {
                break;
            }
            if !((key[1].wrapping_sub(s0) <= seconds) & (key[2].wrapping_sub(z0) <= sizes)) {
                continue;
            }
            let Some(distance) = distance(feature, self.feature, self.limit) else { continue };
            let keygraph = u32::try_from(cell.start + skipped + i).unwrap_or(u32::MAX);
            self.keep(Match { keygraph, distance: u16::try_from(distance).unwrap_or(u16::MAX) });
        }
    }

    fn keep(&mut self, m: Match) {
        let nearer = |b: &Option<Match>| b.is_some_and(|b| b.distance <= m.distance);
        let place = self.best.iter().take_while(|b| nearer(b)).count();
        if place < NEIGHBOURS {
            self.best[place..].rotate_right(1);
            self.best[place] = Some(m);
        }
        if let Some(last) = self.best[NEIGHBOURS - 1] {
            self.limit = u32::from(last.distance);
        }
    }
}

/// How many of `keys` come before the first whose largest angle reaches `l0`.
fn partition_point(keys: &[u8], l0: u8) -> usize {
    let (mut low, mut high) = (0, keys.len() / KEY);
    while low < high {
        let mid = usize::midpoint(low, high);
        if keys[KEY * mid] < l0 {
            low = mid + 1;
        } else {
            high = mid;
        }
    }
    low
}

/// Sum of absolute differences if it stays below `limit`.
#[must_use]
pub fn distance(a: &[u8], b: &[u8], limit: u32) -> Option<u32> {
    const { assert!(FEATURE_BYTES.is_multiple_of(12)) };
    let mut sum = 0;
    for (a, b) in a.as_chunks::<12>().0.iter().zip(b.as_chunks::<12>().0) {
        sum += a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>();
        if sum >= limit {
            return None;
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_gives_up_at_the_limit() {
        let (a, b) = ([10u8; 36], [13u8; 36]);
        assert_eq!(distance(&a, &b, 109), Some(108));
        assert_eq!(distance(&a, &b, 108), None);
        assert_eq!(distance(&a[..12], &b[..12], 1000), Some(36));
    }

    #[test]
    fn runs_start_where_the_angle_does() {
        let keys = [5, 0, 0, 7, 0, 0, 7, 0, 0, 9, 0, 0];
        assert_eq!([4, 5, 6, 7, 8, 9, 10].map(|l| partition_point(&keys, l)), [0, 0, 1, 1, 3, 3, 4]);
    }
}
