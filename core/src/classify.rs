//! Which model keygraphs a frame keygraph looks like.
//!
//! In: a frame keygraph and its feature. Out: its nearest neighbours among the
//! model keygraphs whose angles agree within a tolerance. Every partition subset
//! that the tolerance touches is looked at (the paper looks at one); a subset is
//! sorted by size, so that only triangles of about the right size are read; angles
//! are compared first, then the bits of the signature, which throw out most,
//! then features; a comparison ends as soon as it cannot win.
//!
//! Memory: [`Match`], 8 bytes. Cost: the run lengths; the heart of the detector.

use crate::capacity::FEATURE_BYTES;
use crate::feature::{Feature, signature};
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
    /// Most of the 24 bits of the signature that may differ.
    pub max_bits: u8,
    /// Most that a feature byte may differ on average, 1/16.
    pub max_distance: u16,
    /// Whether only the subset that the key falls into is searched, and the
    /// nearest alone is kept: the paper.
    pub one_cell: bool,
}

/// A model keygraph that a frame keygraph looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Match {
    /// Index of the model keygraph.
    pub keygraph: u32,
    /// Sum of absolute differences of the feature bytes.
    pub distance: u16,
}

/// Most matches of a keygraph.
pub const NEIGHBOURS: usize = 2;

/// The nearest neighbours, nearest first.
pub type Nearest = [Option<Match>; NEIGHBOURS];

/// Finds the best matches of a keygraph with this key, size, shortest side
/// (px) and feature.
#[must_use]
pub fn classify(model: &Model<'_>, key: Key, size: u8, shortest: u8, feature: &Feature, rule: &MatchRule) -> Nearest {
    let bytes = model.feature_bytes();
    let feature = &feature[..bytes];
    let mut search = Search {
        keys: model.keys(),
        features: model.features(),
        feature,
        signature: signature(feature),
        max_bits: u32::from(rule.max_bits),
        sizes: [size.saturating_sub(rule.size_window), size.saturating_add(rule.size_window)],
        limit: u32::try_from(bytes).unwrap_or(0) * u32::from(rule.max_distance) / 16 + 1,
        best: [None; NEIGHBOURS],
    };
    if rule.one_cell {
        search.run(model.cell(key.cell()), [0, u8::MAX], [0, u8::MAX]);
        search.best[1..].fill(None);
        return search.best;
    }
    let noise = rule.tolerance_px / u16::from(shortest.max(1));
    let tolerance = rule.tolerance.saturating_add(u8::try_from(noise).unwrap_or(u8::MAX));
    let [second, largest] =
        [key.second, key.largest].map(|a| [a.saturating_sub(tolerance), a.saturating_add(tolerance)]);
    let bins = |[from, to]: [u8; 2], n: usize| from / BIN..=(to / BIN).min(u8::try_from(n - 1).unwrap_or(0));
    for s in bins(second, SECOND_BINS) {
        for l in bins(largest, LARGEST_BINS) {
            search.run(model.cell(cell_of(key.mirrored, s, l)), second, largest);
        }
    }
    search.best
}

struct Search<'a> {
    keys: &'a [[u8; KEY]],
    features: &'a [u8],
    feature: &'a [u8],
    signature: u32,
    max_bits: u32,
    /// Sizes that are looked at, both included.
    sizes: [u8; 2],
    /// Only distances below this are of interest.
    limit: u32,
    best: Nearest,
}

impl Search<'_> {
    /// Looks at a subset's keygraphs whose angles lie in these ranges.
    fn run(&mut self, cell: core::ops::Range<usize>, second: [u8; 2], largest: [u8; 2]) {
        let n = self.feature.len();
        let keys = &self.keys[cell.clone()];
        let skipped = keys.partition_point(|k| k[0] < self.sizes[0]);
        // Ranges as one comparison each: v - low <= high - low, wrapping.
        let (seconds, largests) = (second[1] - second[0], largest[1] - largest[0]);
        for (i, &[size, l, s, a, b, c]) in keys.iter().enumerate().skip(skipped) {
            if size > self.sizes[1] {
                break;
            }
            if !((l.wrapping_sub(largest[0]) <= largests) & (s.wrapping_sub(second[0]) <= seconds)) {
                continue;
            }
            if (u32::from_le_bytes([a, b, c, 0]) ^ self.signature).count_ones() > self.max_bits {
                continue;
            }
            let at = cell.start + i;
            let feature = &self.features[n * at..][..n];
            let Some(distance) = distance(feature, self.feature, self.limit) else { continue };
            let keygraph = u32::try_from(at).unwrap_or(u32::MAX);
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
}
