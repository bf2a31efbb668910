//! Finds the model keygraphs that a frame keygraph looks like.
//!
//! In: a frame keygraph and its feature. Out: its nearest neighbours among the model keygraphs
//! whose angles agree within a tolerance. Every subset of the partition that the tolerance touches
//! is searched (the paper searches one). A subset is sorted by size, so that only triangles of
//! about the right size are read. Three comparisons follow. The first compares the angles and the
//! bits of the signature, four keys in a machine word; it rejects 49 of 50. The second, in the
//! lists of many objects, compares sketches; it leaves one in three. The third compares features,
//! and ends as soon as a keygraph cannot be among the nearest.
//!
//! Memory: [`Match`], 8 bytes. Cost: 12 operations for each key that is read. This is the inner
//! loop of the search.

use heapless::Vec;

use crate::base::math::VECTORS;
use crate::extract::feature::{CHROMA_MARKS, Feature, LUMA, NO_CHROMA_BYTE, is_gray_sketch, signature, sketch};
use crate::extract::keygraph::{BIN, Keygraph, LARGEST_BINS, SECOND_BINS, cell_of};
use crate::model::format::{SKETCH, Tier};
use crate::model::method::MatchRule;
use crate::model::parse::{Keys, Model};

/// A model keygraph that a frame keygraph looks like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Match {
    /// Index of the model keygraph.
    pub keygraph: u32,
    /// Sum of the absolute differences of the feature bytes.
    pub distance: u16,
}

/// Maximum number of matches of a keygraph.
pub const NEIGHBOURS: usize = 2;

/// The nearest neighbours of a keygraph, nearest first.
pub type Nearest = [Option<Match>; NEIGHBOURS];

/// Finds the best matches of a frame keygraph with this feature among the keygraphs of a tier.
#[must_use]
pub fn classify(model: &Model<'_>, tier: Tier, k: &Keygraph, feature: &Feature, rule: &MatchRule) -> Nearest {
    classify_by::<KEYS, WORDS, WAITING>(model, tier, k, feature, rule)
}

/// [`classify`] with `K` keys in `W` words compared together, and `N` features.
fn classify_by<const K: usize, const W: usize, const N: usize>(
    model: &Model<'_>,
    tier: Tier,
    k: &Keygraph,
    feature: &Feature,
    rule: &MatchRule,
) -> Nearest {
    let Keygraph { key, size, shortest, .. } = *k;
    let bytes = model.feature_bytes();
    let feature = &feature[..bytes];
    let [a, b, c, _] = signature(feature).to_le_bytes();
    let sketches: &[_] = if tier.list().is_some() { model.sketches() } else { &[] };
    let mut lookup: Lookup<'_, K, W, N> = Lookup {
        keys: model.keys(),
        features: model.features(),
        feature,
        sketches,
        sketch: if sketches.is_empty() { 0 } else { sketch(feature) },
        max_marks: rule.max_marks.into(),
        pattern: Pattern {
            signature: [a, b, c].map(in_each_byte),
            most_bits: in_each_byte(0x80 + rule.max_bits),
            ranges: [[0; 2]; 2],
        },
        sizes: [size.saturating_sub(rule.size_window), size.saturating_add(rule.size_window)],
        limit: u32::try_from(bytes).unwrap_or(0) * u32::from(rule.max_distance) / 16 + 1,
        best: [None; NEIGHBOURS],
        waiting: Vec::new(),
    };
    if rule.one_cell {
        lookup.run(model.cell(tier, key.cell()), [0, BIN - 1], [0, BIN - 1]);
        lookup.compare();
        lookup.best[1..].fill(None);
        return lookup.best;
    }
    let noise = rule.tolerance_px / u16::from(shortest.max(1));
    let tolerance = rule.tolerance.saturating_add(u8::try_from(noise).unwrap_or(u8::MAX));
    let [second, largest] =
        [key.second, key.largest].map(|a| [a.saturating_sub(tolerance), a.saturating_add(tolerance)]);
    let bins = |[from, to]: [u8; 2], n: usize| from / BIN..=(to / BIN).min(u8::try_from(n - 1).unwrap_or(0));
    // The part of a range of angles that lies in a bin, counted from the start of the bin.
    let inside = |[from, to]: [u8; 2], bin: u8| [from.saturating_sub(bin * BIN), (to - bin * BIN).min(BIN - 1)];
    for s in bins(second, SECOND_BINS) {
        for l in bins(largest, LARGEST_BINS) {
            lookup.run(model.cell(tier, cell_of(key.mirrored, s, l)), inside(second, s), inside(largest, l));
        }
    }
    lookup.compare();
    lookup.best
}

/// Number of keys that are compared together. A word holds four keys; a target with vectors
/// compares four words at once.
const KEYS: usize = if VECTORS { 16 } else { 4 };
const WORDS: usize = KEYS / 4;
/// Number of keys of a large subset that a target with vectors compares together.
const BLOCK: usize = 128;
/// Number of keys in a subset above which the keys of the right size are searched for.
const MANY: usize = 32;
/// The highest bit of each byte.
const HIGH: u32 = 0x8080_8080;
const NIBBLE: u32 = 0x0f0f_0f0f;

/// Number of keygraphs whose features are compared together, and the number of feature bytes that
/// are compared first.
const WAITING: usize = if VECTORS { 64 } else { 16 };
const HEAD: usize = 16;

const fn in_each_byte(v: u8) -> u32 {
    u32::from_le_bytes([v; 4])
}

/// Word `i` of some keys.
#[inline(always)]
fn word<const N: usize>(keys: &[u8; N], i: usize) -> u32 {
    u32::from_le_bytes([keys[4 * i], keys[4 * i + 1], keys[4 * i + 2], keys[4 * i + 3]])
}

/// Counts the bits that are set in each half byte.
const fn count_bits(x: u32) -> u32 {
    let x = x - (x >> 1 & 0x5555_5555);
    (x & 0x3333_3333) + (x >> 2 & 0x3333_3333)
}

/// Values that the keys of a subset are compared with.
#[derive(Clone, Copy)]
struct Pattern {
    /// Each byte of the signature, repeated four times.
    signature: [u32; 3],
    /// 0x80 plus the maximum number of bits that may differ, in each byte.
    most_bits: u32,
    /// For each of the two angles, in each byte: 0x80 minus the minimum, then 0x80 plus the
    /// maximum.
    ranges: [[u32; 2]; 2],
}

impl Pattern {
    /// Compares four keys: their angles and the three bytes of their signatures. Returns a word in
    /// which the highest bit of a byte is set when its key is alike.
    #[inline(always)]
    const fn alike(&self, [angles, a, b, c]: [u32; 4]) -> u32 {
        let [a, b, c] = [a ^ self.signature[0], b ^ self.signature[1], c ^ self.signature[2]];
        // The three bits at each place are added to a number of two bits.
        let (ones, twos) = (a ^ b ^ c, a & b | (a ^ b) & c);
        let bits = count_bits(ones) + 2 * count_bits(twos);
        let bits = (bits & NIBBLE) + (bits >> 4 & NIBBLE);
        // With v from 0 to 15, the highest bit of a byte in `least + v` is set when v is at least
        // the minimum, and in `most - v` when v is at most the maximum. No byte carries into the
        // next.
        let [[s_least, s_most], [l_least, l_most]] = self.ranges;
        let (s, l) = (angles & NIBBLE, angles >> 4 & NIBBLE);
        let in_range = (s_least + s) & (s_most - s) & (l_least + l) & (l_most - l);
        (self.most_bits - bits) & in_range & HIGH
    }
}

/// Compares many keys by [`Pattern::alike`]. `out` receives one bit for each key, four in a byte.
/// The function is not inlined: this lets the compiler vectorise it.
#[cfg_attr(feature = "dispatch", multiversion::multiversion(targets("x86_64+avx2")))]
#[inline(never)]
fn alike(pattern: &Pattern, keys: [&[u8; BLOCK]; 4], out: &mut [u8; BLOCK / 4]) {
    let pattern = *pattern;
    for (i, out) in out.iter_mut().enumerate() {
        let bits = pattern.alike(keys.map(|k| word(k, i))) >> 7;
        // The lowest bits of the four bytes, side by side.
        *out = ((bits | bits >> 7 | bits >> 14 | bits >> 21) & 15) as u8;
    }
}

struct Lookup<'a, const K: usize, const W: usize, const N: usize> {
    keys: Keys<'a>,
    features: &'a [u8],
    feature: &'a [u8],
    /// Sketches of the keygraphs on the lists, which come first in the model; empty for other
    /// tiers.
    sketches: &'a [[u8; SKETCH]],
    sketch: u64,
    /// Maximum number of bits of the sketch that may differ.
    max_marks: u32,
    /// Pattern without the ranges of the angles, which differ from subset to subset.
    pattern: Pattern,
    /// Minimum and maximum size of the keygraphs that are compared.
    sizes: [u8; 2],
    /// Distance that a match must stay below.
    limit: u32,
    best: Nearest,
    /// Keygraphs whose features are still to be compared.
    waiting: Vec<u32, N>,
}

impl<const K: usize, const W: usize, const N: usize> Lookup<'_, K, W, N> {
    /// Compares the keygraphs of a subset whose angles lie in these ranges, counted from the start
    /// of the subset's bins.
    fn run(&mut self, cell: core::ops::Range<usize>, second: [u8; 2], largest: [u8; 2]) {
        let core::ops::Range { mut start, mut end } = cell;
        if start >= end {
            return;
        }
        // In a small subset, reading a few keys too many is cheaper than the search for the right
        // ones.
        if end - start > MANY {
            let sizes = &self.keys.sizes[start..end];
            end = start + sizes.partition_point(|&s| s <= self.sizes[1]);
            start += sizes.partition_point(|&s| s < self.sizes[0]);
        }
        let pattern = Pattern {
            ranges: [second, largest].map(|[from, to]| [in_each_byte(0x80 - from), in_each_byte(0x80 + to)]),
            ..self.pattern
        };
        let Keys { angles, signatures: [a, b, c], .. } = self.keys;
        let planes = [angles, a, b, c];
        if K > 4 {
            let [angles, a, b, c] = planes.map(|p| p[start..].as_chunks().0.iter());
            for (((angles, a), b), c) in angles.zip(a).zip(b).zip(c).take((end - start) / BLOCK) {
                let mut nibbles = [0; BLOCK / 4];
                alike(&pattern, [angles, a, b, c], &mut nibbles);
                for eight in nibbles.as_chunks::<8>().0 {
                    let mut left = u64::from_le_bytes(*eight);
                    while left != 0 {
                        let bit = left.trailing_zeros() as usize;
                        left &= left - 1;
                        // A byte holds four keys. The sizes of all keys fit: a large subset was
                        // narrowed above.
                        self.wait(start + bit / 8 * 4 + bit % 8);
                    }
                    start += 4 * eight.len();
                }
            }
        }
        let planes = planes.map(|p| p[start..].as_chunks());
        let [angles, a, b, c] = planes.map(|(groups, _)| groups.iter());
        let mut at = start;
        for (((angles, a), b), c) in angles.zip(a).zip(b).zip(c).take((end - start).div_ceil(K)) {
            self.look(at, end, &pattern, [angles, a, b, c]);
            at += K;
        }
        // The last group ends with the planes, and is copied into a full one.
        if at < end {
            let mut last = [[0; K]; 4];
            for (last, (_, rest)) in last.iter_mut().zip(planes) {
                last[..rest.len()].copy_from_slice(rest);
            }
            self.look(at, end, &pattern, last.each_ref());
        }
    }

    /// Compares a group of keys from index `at` on: their angles and the bytes of their signatures.
    /// A key that is alike, comes before `end` and has the right size is put on the waiting list.
    #[inline(always)]
    fn look(&mut self, at: usize, end: usize, pattern: &Pattern, keys: [&[u8; K]; 4]) {
        let words: [u32; W] = core::array::from_fn(|i| pattern.alike(keys.map(|k| word(k, i))));
        if words.iter().fold(0, |all, word| all | word) == 0 {
            return;
        }
        for (i, &word) in words.iter().enumerate() {
            let mut left = word;
            while left != 0 {
                let key = at + 4 * i + (left.trailing_zeros() / 8) as usize;
                left &= left - 1;
                if key < end && (self.sizes[0]..=self.sizes[1]).contains(&self.keys.sizes[key]) {
                    self.wait(key);
                }
            }
        }
    }

    fn wait(&mut self, key: usize) {
        if self.waiting.is_full() {
            self.compare();
        }
        // This push cannot fail: there is room now.
        let _ = self.waiting.push(u32::try_from(key).unwrap_or(u32::MAX));
    }

    /// Removes the waiting keygraphs whose sketches differ too much. The loop reads every sketch
    /// without a branch, because they lie far apart in memory.
    fn sift(&mut self) {
        let mut alike = 0;
        for i in 0..self.waiting.len() {
            let key = self.waiting[i];
            let sketch = u64::from_le_bytes(self.sketches[key as usize]);
            let ignored = if is_gray_sketch(sketch) { CHROMA_MARKS } else { 0 };
            let differ = (sketch ^ self.sketch) & !ignored;
            self.waiting[alike] = key;
            alike += usize::from(differ.count_ones() <= self.max_marks);
        }
        self.waiting.truncate(alike);
    }

    /// Compares the features of the waiting keygraphs, and keeps the nearest.
    fn compare(&mut self) {
        if !self.sketches.is_empty() {
            self.sift();
        }
        let n = self.feature.len();
        let features = self.features;
        let feature = |keygraph: u32| &features[n * keygraph as usize..][..n];
        let (head, rest) = self.feature.split_at(n.min(HEAD));
        // The heads of all features are read first: they lie far apart in memory, and no read then
        // waits for another.
        let mut heads = [0; N];
        for (sum, &keygraph) in heads.iter_mut().zip(&self.waiting) {
            *sum = differences(&feature(keygraph)[..head.len()], head);
        }
        for (i, sum) in heads.into_iter().enumerate().take(self.waiting.len()) {
            let keygraph = self.waiting[i];
            let own = &feature(keygraph)[head.len()..];
            // Of a gray keygraph luma alone is compared. The distance counts half as much again, as
            // if the chroma of the keygraph were as near as its luma.
            let gray = own.last() == Some(&NO_CHROMA_BYTE);
            let (end, limit) = if gray { (LUMA - head.len(), self.limit * 2 / 3) } else { (rest.len(), self.limit) };
            let Some(left) = limit.checked_sub(sum) else { continue };
            let Some(more) = distance(&own[..end], &rest[..end], left) else { continue };
            let sum = if gray { (sum + more) * 3 / 2 } else { sum + more };
            self.keep(Match { keygraph, distance: u16::try_from(sum).unwrap_or(u16::MAX) });
        }
        self.waiting.clear();
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

fn differences(a: &[u8], b: &[u8]) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum()
}

/// Sum of absolute differences of `a` and `b`; `None` when it reaches `limit`.
#[must_use]
pub fn distance(a: &[u8], b: &[u8], limit: u32) -> Option<u32> {
    let ((chunks, a), (others, b)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    let mut sum = differences(a, b);
    for (a, b) in chunks.iter().zip(others) {
        sum += differences(a, b);
        if sum >= limit {
            return None;
        }
    }
    (sum < limit).then_some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Point;
    use crate::extract::feature::{FeatureKind, Sampling, ZERO, extract};
    use crate::extract::keygraph::Scalene;
    use crate::image::frame::Frame;
    use crate::image::pixels::PixelFormat;
    use crate::image::pyramid::Pyramid;
    use crate::model::method::{Method, Parameters};
    use crate::model::preset::Preset;
    use crate::model::train::QqvgaTrainer;
    use std::boxed::Box;
    use std::vec;

    #[test]
    fn distance_gives_up_at_the_limit() {
        let (a, b) = ([10u8; 36], [13u8; 36]);
        assert_eq!(distance(&a, &b, 109), Some(108));
        assert_eq!(distance(&a, &b, 108), None);
        assert_eq!(distance(&a[..12], &b[..12], 1000), Some(36));
    }

    const WIDTH: usize = 160;
    const HEIGHT: usize = 120;

    /// Blocks of random gray levels, with some noise.
    fn picture(noise: u32) -> std::vec::Vec<u8> {
        let random = |i: usize| (i as u32 + 7).wrapping_mul(2_654_435_761) >> 24;
        let pixel = |i: usize| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let block = random(x / 10 + 16 * (y / 10));
            (block + random(i) * noise / 256).min(255) as u8
        };
        (0..WIDTH * HEIGHT).map(pixel).collect()
    }

    /// The nearest neighbours from the definition: every keygraph of the tier is looked at.
    fn naive(model: &Model<'_>, tier: Tier, k: &Keygraph, feature: &[u8], rules: &Parameters) -> Nearest {
        let rule = &rules.matching;
        let noise = rule.tolerance_px / u16::from(k.shortest.max(1));
        let tolerance = u16::from(rule.tolerance) + noise;
        let bytes = model.feature_bytes();
        let any = Scalene { min_angle_deg: 0.0, min_difference_deg: 0.0, min_side_px: 0.0 };
        let limit = bytes as u32 * u32::from(rule.max_distance) / 16;
        let mut found = vec![];
        for i in model.tier(tier) {
            let (_, points) = model.keygraph(i);
            let other = Keygraph::new(points, [0, 1, 2], &any).unwrap();
            let near = |a: u8, b: u8| u16::from(a.abs_diff(b)) <= tolerance;
            let its = &model.features()[bytes * i..][..bytes];
            let distance = differences(feature, its);
            let alike = other.key.mirrored == k.key.mirrored
                && near(other.key.second, k.key.second)
                && near(other.key.largest, k.key.largest)
                && other.size.abs_diff(k.size) <= rule.size_window
                && (signature(its) ^ signature(feature)).count_ones() <= u32::from(rule.max_bits);
            if alike && distance <= limit {
                found.push(Match { keygraph: i as u32, distance: distance as u16 });
            }
        }
        found.sort_by_key(|m| (m.distance, m.keygraph));
        [0, 1].map(|i| found.get(i).copied())
    }

    #[test]
    #[cfg_attr(miri, ignore = "training would take minutes")]
    fn few_keys_and_many_at_a_time_find_the_neighbours_of_the_definition() {
        let data = picture(0);
        let frame = Frame::new(PixelFormat::Gray8, WIDTH, HEIGHT, &data).unwrap();
        let mut bytes = vec![0; 1 << 20];
        let params = Preset::Compact.params("blocks", true);
        let mut trainer = Box::<QqvgaTrainer>::default();
        let trained = trainer.train(&frame, (160, 120), &params, &mut bytes).unwrap();
        let model = Model::parse(&bytes[..trained.bytes]).unwrap();
        let largest = model.occupancy().1;
        assert!(model.has_second_tiers() && largest > 2 * BLOCK, "too small a model: {largest} in a subset");

        let mut pyramid = Box::new(Pyramid::<30_000, 8_000>::new());
        let seen = picture(40);
        let mut planes = pyramid.planes_mut();
        planes.load(&Frame::new(PixelFormat::Gray8, WIDTH, HEIGHT, &seen).unwrap()).unwrap();
        planes.reduce();
        let view = pyramid.view();
        let rules = Method::Keygraph.parameters();
        let (mut asked, mut matched) = (0, 0);
        // The model's own keygraphs of the largest view, moved a little.
        for i in model.tier(Tier::Second(0)).step_by(9) {
            let (v, points) = model.keygraph(i);
            if v != 0 {
                continue;
            }
            let shift = |p: Point, d: i16| Point::new(p.x + d % 9, p.y + d % 7);
            let d = (i % 40) as i16;
            let points = [shift(points[0], d), shift(points[1], d + 3), shift(points[2], d + 5)];
            let Some(k) = Keygraph::new(points, [0, 1, 2], &rules.scalene) else { continue };
            let points = k.vertices.map(|v| points[usize::from(v)]);
            let feature = extract(&view, 0, points, k.size, FeatureKind::Luma, Sampling::Patch);
            assert_eq!(feature[model.feature_bytes()..], [ZERO; 12]);
            for tier in [Tier::First(0), Tier::Second(0)] {
                let want = naive(&model, tier, &k, &feature[..model.feature_bytes()], rules);
                let rule = &rules.matching;
                assert_eq!(classify_by::<4, 1, 16>(&model, tier, &k, &feature, rule), want, "{k:?}");
                assert_eq!(classify_by::<16, 4, 64>(&model, tier, &k, &feature, rule), want, "{k:?}");
                matched += want.iter().flatten().count();
                asked += 1;
            }
        }
        assert!(asked > 500 && matched > asked / 4, "{matched} matches of {asked} keygraphs");
    }
}
