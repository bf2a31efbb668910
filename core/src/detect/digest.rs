//! One number for each stage's output, to compare machines.
//!
//! In: the output of each stage for one frame, as shown to an
//! [`crate::detect::observer::Observer`]. Out: a 32-bit digest for each stage (FNV-1a of G. Fowler,
//! L. Noll and K.-P. Vo) over the fields in the order of their declaration, little endian. A float
//! counts by its bits, and all NaNs count alike. Two machines whose digests all agree made the same
//! outputs.
//!
//! Memory: 4 bytes for each stage. Cost: a multiplication for each byte, about 150,000 in a qvga
//! frame; nothing when no observer computes digests.

use crate::base::capacity::{LEVELS, Stage};
use crate::detect::detection::Detection;
use crate::detect::observer::Output;
use crate::detect::vote::Similarity;
use crate::image::plane::Plane;
use crate::image::pyramid::PyramidView;

/// Digest of a sequence of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Digest(u32);

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}

/// The parts are not inlined: they are called in many places, and no time is lost where no digest is
/// computed.
impl Digest {
    /// Creates the digest of no bytes.
    #[must_use]
    pub const fn new() -> Self {
        Self(0x811c_9dc5)
    }

    /// Value of the digest.
    #[must_use]
    pub const fn value(self) -> u32 {
        self.0
    }

    /// Adds bytes to the digest.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |d, &b| (d ^ u32::from(b)).wrapping_mul(0x0100_0193));
    }

    #[inline(never)]
    fn short(&mut self, v: u16) {
        self.bytes(&v.to_le_bytes());
    }

    #[inline(never)]
    fn word(&mut self, v: u32) {
        self.bytes(&v.to_le_bytes());
    }

    #[inline(never)]
    fn float(&mut self, v: f32) {
        self.word(if v.is_nan() { f32::NAN.to_bits() } else { v.to_bits() });
    }

    #[inline(never)]
    fn floats(&mut self, v: &[f32]) {
        v.iter().for_each(|&v| self.float(v));
    }

    /// Adds a number of elements.
    fn count(&mut self, n: usize) {
        self.word(u32::try_from(n).unwrap_or(u32::MAX));
    }

    fn plane<T: Copy>(&mut self, plane: Plane<'_, T>, byte: impl Fn(T) -> u8) {
        for y in 0..plane.height() {
            plane.row(y).iter().for_each(|&v| self.bytes(&[byte(v)]));
        }
    }

    fn level(&mut self, view: &PyramidView<'_>, level: usize) {
        self.plane(view.luma(level), |v| v);
        for chroma in view.chroma(level) {
            self.plane(chroma, i8::cast_unsigned);
        }
    }

    fn pose(&mut self, p: &Similarity) {
        self.floats(&p.centre);
        self.short(p.rotation);
        self.short(p.size.cast_unsigned());
    }

    fn detection(&mut self, d: &Detection) {
        let a = &d.appearance;
        self.short(d.object);
        self.floats(&d.homography.0);
        self.floats(d.corners.as_flattened());
        self.float(d.score);
        for n in [d.votes, d.agreeing, a.blocks, a.inside] {
            self.short(n);
        }
        self.floats(&[a.visible, a.median, a.support, a.chroma]);
    }
}

/// Digests of the stages, each over all outputs of its stage in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Digests([Digest; Stage::COUNT]);

impl Digests {
    /// Creates the digests of a frame before any stage has run.
    #[must_use]
    pub const fn new() -> Self {
        Self([Digest::new(); Stage::COUNT])
    }

    /// Creates digests from the values of the stages, in the order of [`Stage::ALL`], as another
    /// machine reports them.
    #[must_use]
    pub fn from_values(values: [u32; Stage::COUNT]) -> Self {
        Self(values.map(Digest))
    }

    /// Value of the digest of a stage.
    #[must_use]
    pub const fn of(&self, stage: Stage) -> u32 {
        self.0[stage as usize].value()
    }

    /// Adds an output to the digest of its stage.
    pub fn add(&mut self, output: Output<'_>) {
        let d = &mut self.0[output.stage() as usize];
        match output {
            Output::Planes(view) => d.level(&view, 0),
            Output::Levels(view) => (1..LEVELS).for_each(|l| d.level(&view, l)),
            Output::Corners(points) => {
                d.count(points.len());
                for p in points {
                    d.short(p.x.cast_unsigned());
                    d.short(p.y.cast_unsigned());
                }
            }
            Output::Triangles(triples) => {
                d.count(triples.len());
                triples.iter().flatten().for_each(|&v| d.short(v));
            }
            Output::Keygraphs(keygraphs) => {
                d.count(keygraphs.len());
                for k in keygraphs {
                    k.vertices.iter().for_each(|&v| d.short(v));
                    d.bytes(&[u8::from(k.key.mirrored), k.key.second, k.key.largest, k.size, k.shortest, k.level]);
                }
            }
            Output::Features(features, bytes) => {
                d.count(features.len());
                features.iter().for_each(|f| d.bytes(&f[..bytes]));
            }
            Output::Matches(matches) => {
                d.count(matches.len());
                for (keygraph, m) in matches {
                    d.short(*keygraph);
                    d.word(m.keygraph);
                    d.short(m.distance);
                }
            }
            Output::Votes(votes) => {
                d.count(votes.len());
                for v in votes {
                    d.pose(&v.pose);
                    d.word(v.model_keygraph);
                    d.short(v.frame_keygraph);
                    d.short(v.object);
                    d.bytes(&[v.weight]);
                }
            }
            Output::Candidates(candidates) => {
                d.count(candidates.len());
                for c in candidates {
                    d.short(c.object);
                    d.pose(&c.pose);
                    d.word(c.weight);
                }
            }
            Output::Grown(detection) | Output::Aligned(detection) => {
                d.count(usize::from(detection.is_some()));
                detection.iter().for_each(|t| d.detection(t));
            }
            Output::Scrutinised(detection, seen) => {
                d.detection(detection);
                d.bytes(&seen.0);
                d.bytes(if seen.1 { &[1] } else { &[] });
            }
            Output::Detections(detections) => {
                d.count(detections.len());
                detections.iter().for_each(|t| d.detection(t));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::geometry::Point;

    #[test]
    fn the_published_test_vectors() {
        let of = |text: &str| {
            let mut d = Digest::new();
            d.bytes(text.as_bytes());
            d.value()
        };
        assert_eq!(of(""), 0x811c_9dc5);
        assert_eq!(of("a"), 0xe40c_292c);
        assert_eq!(of("foobar"), 0xbf9c_f968);
    }

    #[test]
    fn all_nans_are_one() {
        let of = |bits: u32| {
            let mut d = Digest::new();
            d.float(f32::from_bits(bits));
            d.value()
        };
        assert_eq!(of(0x7fc0_0000), of(0xffc0_0001));
        assert_ne!(of(0), of(0x8000_0000), "a zero has a sign");
    }

    #[test]
    fn a_stage_moves_its_own_digest_alone() {
        let mut d = Digests::new();
        d.add(Output::Corners(&[Point::new(16, 32)]));
        let moved: [bool; Stage::COUNT] = Stage::ALL.map(|s| d.of(s) != Digest::new().value());
        assert_eq!(moved, Stage::ALL.map(|s| s == Stage::Corners));
        let mut other = Digests::new();
        other.add(Output::Corners(&[Point::new(32, 16)]));
        assert_ne!(d, other, "x and y must not be interchangeable");
    }
}
