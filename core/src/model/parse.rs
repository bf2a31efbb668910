//! Parses a model: a view of the bytes that training leaves, read in place.
//!
//! In: bytes at any alignment (flash, `include_bytes!`, a mapped file). Out: a view that borrows
//! them; nothing is copied. `docs/model-format.md` describes the format byte by byte.
//! [`Model::parse`] checks magic, version, length, checksum and every index once, so that the
//! stages can trust the view.
//!
//! Memory: none beyond the bytes. Cost: one pass over the bytes to parse them.

use crate::base::capacity::TEMPLATE_SIDE;
use crate::base::geometry::{Homography, Point};
use crate::base::says::says;
use crate::extract::feature::FeatureKind;
use crate::extract::keygraph::CELLS;
use crate::image::plane::Plane;
use crate::image::pyramid::{level_of, plane_bytes};
use crate::model::format::{
    CHECKED, Counts, ENTRY, HEADER, KEYPOINT, Layout, MAGIC, MAX_PICTURE_SIDE, NAME_BYTES, OBJECT, SKETCH, START, Tier,
    Tiers, VERSION, VERTICES, VIEW, crc32, header, keypoint, kind_of, method_of, object, template_bytes, vertices,
    view,
};
use crate::model::method::Method;

/// The reason why bytes are not a valid model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes do not start as a model does: pass a `.kgm` file.
    NotAModel,
    /// A newer version wrote the model: update this program, or train again.
    NewerVersion {
        /// Format version of the model.
        found: u16,
    },
    /// An older version wrote the model: train again.
    OlderVersion {
        /// Format version of the model.
        found: u16,
    },
    /// The bytes end before the model does: copy the file again.
    Truncated {
        /// Length of the model, bytes.
        expected: usize,
        /// Number of bytes given.
        given: usize,
    },
    /// There are bytes after the end of the model: pass exactly the model.
    TrailingBytes {
        /// Length of the model, bytes.
        expected: usize,
        /// Number of bytes given.
        given: usize,
    },
    /// The checksum does not match: the file is damaged, copy it again.
    Checksum {
        /// CRC-32 that the header states.
        expected: u32,
        /// CRC-32 computed from the bytes.
        computed: u32,
    },
    /// The checksum matches but the content contradicts itself. The program that wrote the model is
    /// at fault: train again.
    Inconsistent {
        /// Name of the section that is wrong.
        section: &'static str,
    },
}

says!(ModelError {
    Self::NotAModel => ("this is not a keygraph model: make one with `keygraph train`"),
    Self::NewerVersion { found } => (
        "model version {} is newer than version {}, which this program reads: update the program, or train again",
        found,
        VERSION
    ),
    Self::OlderVersion { found } => (
        "model version {} is older than version {}, which this program reads: train again (and pack again)",
        found,
        VERSION
    ),
    Self::Truncated { expected, given } => ("the model is cut off: {} bytes of {}; copy it again", given, expected),
    Self::TrailingBytes { expected, given } => (
        "{} bytes where the model has {}: something was appended; copy it again",
        given,
        expected
    ),
    Self::Checksum { expected, computed } => (
        "the model is damaged (CRC-32 {:08x} instead of {:08x}); copy it again",
        computed,
        expected
    ),
    Self::Inconsistent { section } => ("the model contradicts itself in its {}; train again", section),
});

/// An object of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Object<'a> {
    /// Name of the object.
    pub name: &'a str,
    /// Width of the training picture, px.
    pub width: u32,
    /// Height of the training picture, px.
    pub height: u32,
    /// Number of possible triples of keypoints, over all views.
    pub triples: u32,
    /// Number of keypoints, over all views.
    pub keypoints: u32,
    /// Small picture of the object.
    pub template: Template<'a>,
}

/// A small picture of an object, as a pyramid: luma, and chroma of half the size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Template<'a> {
    /// Width of level 0, px; at most [`TEMPLATE_SIDE`].
    pub width: usize,
    /// Height of level 0, px; at most [`TEMPLATE_SIDE`].
    pub height: usize,
    luma: &'a [u8],
    chroma: [&'a [u8]; 2],
}

impl<'a> Template<'a> {
    /// Creates a template of `width` x `height` px from `bytes`: all levels of luma, then all
    /// levels of each chroma plane. `None` when the length of `bytes` is not that of
    /// [`template_bytes`].
    #[must_use]
    pub fn new(bytes: &'a [u8], width: usize, height: usize) -> Option<Self> {
        (bytes.len() == template_bytes(width, height)).then(|| Self::of(bytes, width, height))
    }

    /// The template in `bytes`, of which there are [`template_bytes`].
    fn of(bytes: &'a [u8], width: usize, height: usize) -> Self {
        let (luma, chroma) = bytes.split_at(plane_bytes(width, height));
        let (a, b) = chroma.split_at(chroma.len() / 2);
        Self { width, height, luma, chroma: [a, b] }
    }

    /// Map from px of a picture of `width` x `height` px to px of level 0 of the template.
    #[must_use]
    #[allow(clippy::wrong_self_convention, reason = "a map, not a constructor")]
    pub fn from_picture(&self, width: f32, height: f32) -> Homography {
        let (sx, sy) = (self.width as f32 / width, self.height as f32 / height);
        Homography::scaling([sx, sy])
    }

    /// Map from px of level 0 of the template to px of a picture of `width` x `height` px.
    #[must_use]
    pub fn to_picture(&self, width: f32, height: f32) -> Homography {
        let (sx, sy) = (width / self.width as f32, height / self.height as f32);
        Homography::scaling([sx, sy])
    }

    /// Luma of a pyramid level of the template.
    ///
    /// # Panics
    /// When there is no such level.
    #[must_use]
    pub fn luma(&self, level: usize) -> Plane<'a, u8> {
        level_of(self.luma, self.width, self.height, level)
    }

    /// Both chroma planes of a pyramid level, half the size of its luma. Each byte holds an `i8`.
    ///
    /// # Panics
    /// When there is no such level.
    #[must_use]
    pub fn chroma(&self, level: usize) -> [Plane<'a, u8>; 2] {
        self.chroma.map(|p| level_of(p, self.width / 2, self.height / 2, level))
    }
}

/// A rendered view of an object, from which keypoints were taken.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct View {
    /// Index of the object that the view shows.
    pub object: u16,
    /// Number of keypoints in the view.
    pub keypoints: u16,
    /// Index of the view's first keypoint in the model.
    pub first: u32,
    /// Affine map from view px to picture px.
    pub to_picture: Homography,
    /// Position of the picture's middle in the view, px.
    pub centre: [f32; 2],
    /// Scale of the view: view px per picture px (square root of the area ratio).
    pub scale: f32,
}

/// Keys of the keygraphs, as one array for each byte of a key, so that many keys are compared at
/// once. Keys ascend within a subset, by size first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keys<'a> {
    /// Longest side of each keygraph, `16 log2(view px)`.
    pub sizes: &'a [u8],
    /// Angles of each keygraph, half-degrees above the minimum of its subset, 0 to 9. The high four
    /// bits hold the largest angle, the low four the second-largest.
    pub angles: &'a [u8],
    /// Signature of each keygraph, the lowest byte first.
    pub signatures: [&'a [u8]; 3],
}

/// A parsed model. Every model that exists is valid.
#[derive(Clone, Copy, Debug)]
pub struct Model<'a> {
    bytes: &'a [u8],
    layout: Layout,
    method: Method,
    feature: FeatureKind,
    tiers: Tiers,
    counts: Counts,
}

impl<'a> Model<'a> {
    /// Returns the length in bytes of the model that `bytes` begin with, as its header tells it. A flash
    /// partition has other bytes behind its model:
    ///
    /// ```
    /// # fn open(partition: &[u8]) -> Result<keygraph_core::Model<'_>, keygraph_core::ModelError> {
    /// use keygraph_core::Model;
    /// let model = Model::parse(&partition[..Model::length(partition)?])?;
    /// # Ok(model)
    /// # }
    /// # assert_eq!(open(&[0xff; 4096]).unwrap_err(), keygraph_core::ModelError::NotAModel);
    /// ```
    ///
    /// # Errors
    /// [`ModelError`] when no model begins here, its version is another one, or `bytes` end before it does.
    pub fn length(bytes: &[u8]) -> Result<usize, ModelError> {
        let given = bytes.len();
        if given < 4 || bytes[..4] != MAGIC {
            return Err(ModelError::NotAModel);
        }
        if given < HEADER {
            return Err(ModelError::Truncated { expected: HEADER, given });
        }
        match header::VERSION.get(bytes) {
            found if found > VERSION => return Err(ModelError::NewerVersion { found }),
            found if found < VERSION => return Err(ModelError::OlderVersion { found }),
            _ => {}
        }
        let expected = header::MODEL_LENGTH.size(bytes);
        if expected > given { Err(ModelError::Truncated { expected, given }) } else { Ok(expected) }
    }

    /// Checks that `bytes` are exactly one model, and borrows them.
    ///
    /// # Errors
    /// [`ModelError`], which says what is wrong and what to do about it.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let (expected, given) = (Self::length(bytes)?, bytes.len());
        if expected < given {
            return Err(ModelError::TrailingBytes { expected, given });
        }
        let (stored, computed) = (header::CHECKSUM.get(bytes), crc32(&bytes[CHECKED..]));
        if stored != computed {
            return Err(ModelError::Checksum { expected: stored, computed });
        }
        let wrong = |section| ModelError::Inconsistent { section };
        let method = method_of(header::METHOD.get(bytes)).ok_or(wrong("method"))?;
        let feature = kind_of(header::FEATURE.get(bytes)).ok_or(wrong("feature kind"))?;
        let tiers = Tiers::from_bits(header::TIERS.get(bytes)).ok_or(wrong("tiers"))?;
        let counts = Counts::get(bytes);
        let layout = Layout::new(&counts, tiers, method.sampling().bytes(feature)).ok_or(wrong("counts"))?;
        if usize::from(header::LENGTH.get(bytes)) != HEADER || layout.end != given {
            return Err(wrong("header"));
        }
        let model = Self { bytes, layout, method, feature, tiers, counts };
        model.check().map_or(Ok(model), |section| Err(wrong(section)))
    }

    /// Returns the name of the first section that contradicts the others, if any.
    fn check(&self) -> Option<&'static str> {
        let Counts { objects, views, keypoints, keygraphs, templates, listed } = self.counts;
        let limit = usize::from(u16::MAX);
        let end_of_lists = if self.tiers.lists { self.tier(Tier::Longlist).end } else { 0 };
        if objects == 0 || objects > limit || views > limit || listed != end_of_lists {
            return Some("counts");
        }
        for i in 0..objects {
            let (r, t) = (self.object_record(i), self.template_place(i));
            let name = &r[..NAME_BYTES];
            let sides_fit = [t.1, t.2].iter().all(|s| (8..=TEMPLATE_SIDE).contains(s));
            let sides = [object::WIDTH, object::HEIGHT].map(|side| side.get(r));
            let picture_fits = sides.iter().all(|side| (1..=MAX_PICTURE_SIDE).contains(side));
            if !sides_fit || !picture_fits || core::str::from_utf8(trim(name)).is_err() {
                return Some("objects");
            }
            if t.0.checked_add(template_bytes(t.1, t.2)).is_none_or(|end| end > templates) {
                return Some("templates");
            }
        }
        for i in 0..views {
            let v = self.view(i);
            let range = (v.first as usize).checked_add(usize::from(v.keypoints));
            let finite = v.to_picture.0.iter().chain(&v.centre).chain([&v.scale]).all(|f| f.is_finite());
            if usize::from(v.object) >= objects || range.is_none_or(|end| end > keypoints) || !finite || v.scale <= 0.0
            {
                return Some("views");
            }
        }
        let is_negative = |i: usize| {
            let r = self.record(self.layout.keypoints, KEYPOINT, i);
            keypoint::X.get(r) < 0 || keypoint::Y.get(r) < 0
        };
        if (0..keypoints).any(is_negative) {
            return Some("keypoints");
        }
        let (mut start, last) = (0, CELLS * self.tiers.count(objects));
        for c in 0..=last {
            let at = self.index_entry(c);
            if at < start || at > keygraphs || (c == 0 && at != 0) || (c == last && at != keygraphs) {
                return Some("index");
            }
            start = at;
        }
        for i in 0..keygraphs {
            let r = self.vertex_record(i);
            let view = usize::from(vertices::VIEW.get(r));
            // Only the number of keypoints is read: reading whole views would dominate this check.
            let keypoints = |view| view::KEYPOINTS.get(self.view_record(view));
            let ids = vertices::IDS.map(|id| id.get(r));
            if view >= views || ids.iter().any(|&id| u16::from(id) >= keypoints(view)) {
                return Some("keygraphs");
            }
        }
        None
    }

    fn record(&self, section: usize, each: usize, i: usize) -> &'a [u8] {
        &self.bytes[section + each * i..][..each]
    }

    fn object_record(&self, i: usize) -> &'a [u8] {
        self.record(self.layout.objects, OBJECT, i)
    }

    fn vertex_record(&self, i: usize) -> &'a [u8] {
        self.record(self.layout.vertices, VERTICES, i)
    }

    fn view_record(&self, i: usize) -> &'a [u8] {
        self.record(self.layout.views, VIEW, i)
    }

    /// Offset, width and height of the template of object `i`.
    pub(crate) fn template_place(&self, i: usize) -> (usize, usize, usize) {
        let r = self.object_record(i);
        (
            object::TEMPLATE.size(r),
            usize::from(object::TEMPLATE_WIDTH.get(r)),
            usize::from(object::TEMPLATE_HEIGHT.get(r)),
        )
    }

    /// The bytes that the model was parsed from.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Checksum of the model's bytes, by which models are told apart.
    pub(crate) fn checksum(&self) -> u32 {
        header::CHECKSUM.get(self.bytes)
    }

    /// Method by which frames are searched for the model.
    #[must_use]
    pub const fn method(&self) -> Method {
        self.method
    }

    /// Channels that the model's features are made of.
    #[must_use]
    pub const fn feature(&self) -> FeatureKind {
        self.feature
    }

    /// Length of a feature, bytes.
    #[must_use]
    pub const fn feature_bytes(&self) -> usize {
        self.method.sampling().bytes(self.feature)
    }

    /// Number of objects in the model.
    #[must_use]
    pub const fn objects(&self) -> usize {
        self.counts.objects
    }

    /// Number of views in the model.
    #[must_use]
    pub const fn views(&self) -> usize {
        self.counts.views
    }

    /// Number of keypoints in the model, over all objects and views.
    #[must_use]
    pub const fn keypoints(&self) -> usize {
        self.counts.keypoints
    }

    /// Number of keygraphs in the model. A keygraph that is also on a list counts twice.
    #[must_use]
    pub const fn keygraphs(&self) -> usize {
        self.counts.keygraphs
    }

    pub(crate) const fn counts(&self) -> &Counts {
        &self.counts
    }

    pub(crate) const fn layout(&self) -> Layout {
        self.layout
    }

    /// Offset of the chroma of template `i` in the section of templates, and its length, bytes.
    pub(crate) fn chroma_of_template(&self, i: usize) -> (usize, usize) {
        let (start, width, height) = self.template_place(i);
        let luma = plane_bytes(width, height);
        (start + luma, template_bytes(width, height) - luma)
    }

    /// Returns object `i`.
    ///
    /// # Panics
    /// When there is no such object.
    #[must_use]
    pub fn object(&self, i: usize) -> Object<'a> {
        let r = self.object_record(i);
        let (start, width, height) = self.template_place(i);
        let t = &self.bytes[self.layout.templates + start..][..template_bytes(width, height)];
        Object {
            name: core::str::from_utf8(trim(&r[..NAME_BYTES])).unwrap_or_default(),
            width: object::WIDTH.get(r),
            height: object::HEIGHT.get(r),
            triples: object::TRIPLES.get(r),
            keypoints: object::KEYPOINTS.get(r),
            template: Template::of(t, width, height),
        }
    }

    /// Returns view `i`.
    ///
    /// # Panics
    /// When there is no such view.
    #[must_use]
    pub fn view(&self, i: usize) -> View {
        let r = self.view_record(i);
        View {
            object: view::OBJECT.get(r),
            keypoints: view::KEYPOINTS.get(r),
            first: view::FIRST.get(r),
            to_picture: Homography::affine(view::TO_PICTURE.map(|number| number.get(r))),
            centre: view::CENTRE.map(|number| number.get(r)),
            scale: view::SCALE.get(r),
        }
    }

    /// Returns keypoint `i`, in 1/16 px of its view.
    ///
    /// # Panics
    /// When there is no such keypoint.
    #[must_use]
    pub fn keypoint(&self, i: usize) -> Point {
        let r = self.record(self.layout.keypoints, KEYPOINT, i);
        Point::new(keypoint::X.get(r), keypoint::Y.get(r))
    }

    /// Returns the index of the view of keygraph `i`, and the keygraph's vertices in canonical
    /// order, in 1/16 px of this view.
    ///
    /// # Panics
    /// When there is no such keygraph.
    #[must_use]
    pub fn keygraph(&self, i: usize) -> (usize, [Point; 3]) {
        let r = self.vertex_record(i);
        let view = usize::from(vertices::VIEW.get(r));
        let first = view::FIRST.size(self.view_record(view));
        (view, vertices::IDS.map(|id| self.keypoint(first + usize::from(id.get(r)))))
    }

    /// Cost of keygraph `i`: how unlikely a frame's triangulation is to contain it
    /// ([`crate::extract::keygraph::cost`]).
    pub(crate) fn cost(&self, i: usize) -> u32 {
        let r = self.vertex_record(i);
        let view = self.view_record(usize::from(vertices::VIEW.get(r)));
        let (n, first) = (usize::from(view::KEYPOINTS.get(view)), view::FIRST.size(view));
        let mut ids = vertices::IDS.map(|id| usize::from(id.get(r)));
        ids.sort_unstable();
        let (points, _) =
            self.bytes[self.layout.keypoints + KEYPOINT * first..][..KEYPOINT * n].as_chunks::<KEYPOINT>();
        let at = |p: &[u8; KEYPOINT]| Point::new(keypoint::X.get(p), keypoint::Y.get(p));
        crate::extract::keygraph::cost(|l| at(&points[l]), n, ids)
    }

    fn index_entry(&self, i: usize) -> usize {
        START.size(self.record(self.layout.index, ENTRY, i))
    }

    /// Returns the keygraphs of subset `cell` of a tier, as a range of indices.
    ///
    /// # Panics
    /// When `cell` is not below [`CELLS`], or when there is no such tier.
    #[must_use]
    pub fn cell(&self, tier: Tier, cell: usize) -> core::ops::Range<usize> {
        let i = CELLS * self.tiers.number(tier) + cell;
        self.index_entry(i)..self.index_entry(i + 1)
    }

    /// Returns the keygraphs of a tier, as a range of indices.
    ///
    /// # Panics
    /// When there is no such tier.
    #[must_use]
    pub fn tier(&self, tier: Tier) -> core::ops::Range<usize> {
        let i = CELLS * self.tiers.number(tier);
        self.index_entry(i)..self.index_entry(i + CELLS)
    }

    /// The tiers of one object: the first, and the second when the model has second tiers.
    pub(crate) fn tiers_of(&self, object: u16) -> impl Iterator<Item = Tier> {
        self.tiers.of(object)
    }

    /// Whether the model has [`Tier::Shortlist`] and [`Tier::Longlist`].
    #[must_use]
    pub const fn has_lists(&self) -> bool {
        self.tiers.lists
    }

    /// Whether the model's objects have [`Tier::Second`].
    #[must_use]
    pub const fn has_second_tiers(&self) -> bool {
        self.tiers.second
    }

    /// Whether the model holds lists alone ([`slim`](crate::slim)).
    #[must_use]
    pub const fn is_slim(&self) -> bool {
        self.tiers.lists && self.counts.listed == self.counts.keygraphs
    }

    /// Keys of all keygraphs.
    #[must_use]
    pub fn keys(&self) -> Keys<'a> {
        let plane = |i: usize| &self.bytes[self.layout.keys + self.keygraphs() * i..][..self.keygraphs()];
        Keys { sizes: plane(0), angles: plane(1), signatures: [2, 3, 4].map(plane) }
    }

    /// Features of all keygraphs, [`Model::feature_bytes`] bytes each.
    #[must_use]
    pub fn features(&self) -> &'a [u8] {
        &self.bytes[self.layout.features..self.layout.sketches]
    }

    /// [`Sketches`](crate::extract::feature::sketch) of the keygraphs on the lists, little endian.
    #[must_use]
    pub fn sketches(&self) -> &'a [[u8; SKETCH]] {
        self.bytes[self.layout.sketches..self.layout.templates].as_chunks().0
    }

    /// Number of subsets that hold at least one keygraph, and the size of the largest subset. The
    /// tiers of all objects count together. The lists do not count, but in a slim model, which has nothing else.
    #[must_use]
    pub fn occupancy(&self) -> (usize, usize) {
        let entry = |tier, cell| self.index_entry(CELLS * tier + cell);
        let tiers = 2 * usize::from(self.tiers.lists && !self.is_slim())..self.tiers.count(self.objects());
        let sizes = || (0..CELLS).map(|c| tiers.clone().map(|t| entry(t, c + 1) - entry(t, c)).sum::<usize>());
        (sizes().filter(|&n| n > 0).count(), sizes().max().unwrap_or(0))
    }
}

/// The bytes of a name without the zeros that pad it. The length is taken as unknown: a loop of known length would be
/// written out, and take 300 bytes of a board's flash.
fn trim(name: &[u8]) -> &[u8] {
    let end = core::hint::black_box(name).iter().take_while(|&&b| b != 0).count();
    &name[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_are_no_model_are_told_apart() {
        assert!(matches!(Model::parse(b""), Err(ModelError::NotAModel)));
        assert!(matches!(Model::parse(&[0; 64]), Err(ModelError::NotAModel)));
        assert!(matches!(Model::parse(&MAGIC), Err(ModelError::Truncated { .. })));
    }
}
