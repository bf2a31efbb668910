//! The model: what training leaves, read in place from bytes.
//!
//! In: bytes at any alignment (flash, `include_bytes!`, a mapped file). Out: a
//! view that borrows them; nothing is copied. `docs/model-format.md` describes
//! the format byte by byte. [`Model::parse`] checks magic, version, length,
//! checksum and every index once, so that the stages can trust the view.
//!
//! Memory: none beyond the bytes. Cost: one pass over them when parsed.

use crate::base::capacity::TEMPLATE_SIDE;
use crate::base::geometry::{Homography, Point};
use crate::extract::feature::FeatureKind;
use crate::extract::keygraph::CELLS;
use crate::image::pyramid::{Plane, level_of, plane_bytes};
use crate::model::method::Method;

/// First bytes of every model.
pub const MAGIC: [u8; 4] = *b"KGM\x1a";
/// The version that this library writes and reads.
pub const VERSION: u16 = 6;
/// Longest name of an object, bytes of UTF-8.
pub const NAME_BYTES: usize = 32;
/// Longest side of a training picture, px.
pub const MAX_PICTURE_SIDE: u32 = 1 << 20;

pub(crate) const HEADER: usize = 44;
/// Where the checksummed part starts.
pub(crate) const CHECKED: usize = 16;
pub(crate) const OBJECT: usize = 56;
pub(crate) const VIEW: usize = 44;
pub(crate) const KEYPOINT: usize = 4;
/// Bytes of a keygraph's key: one in each plane of [`Keys`].
pub(crate) const KEY: usize = 5;
pub(crate) const VERTICES: usize = 5;
/// Bytes of a [`crate::extract::feature::sketch`].
pub const SKETCH: usize = 8;

/// Why bytes are not a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ModelError {
    /// The bytes do not start as a model does: pass a `.kgm` file.
    NotAModel,
    /// Written by a newer version: update this program, or train again.
    NewerVersion {
        /// The version found.
        found: u16,
    },
    /// The bytes end before the model does: copy the file again.
    Truncated {
        /// Bytes that the model has.
        expected: usize,
        /// Bytes that were given.
        given: usize,
    },
    /// There are bytes behind the model: pass exactly the model.
    TrailingBytes {
        /// Bytes that the model has.
        expected: usize,
        /// Bytes that were given.
        given: usize,
    },
    /// The checksum does not match: the file is damaged, copy it again.
    Checksum {
        /// CRC-32 in the header.
        expected: u32,
        /// CRC-32 of the bytes.
        computed: u32,
    },
    /// The checksum matches but the content contradicts itself: whatever wrote
    /// the model is at fault; train again.
    Inconsistent {
        /// The section that is wrong.
        section: &'static str,
    },
}

impl core::fmt::Display for ModelError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::NotAModel => write!(f, "this is not a keygraph model: make one with `keygraph train`"),
            Self::NewerVersion { found } => write!(
                f,
                "model version {found} is not the version {VERSION} that this program reads: update it, or train again"
            ),
            Self::Truncated { expected, given } => {
                write!(f, "the model is cut off: {given} bytes of {expected}; copy it again")
            }
            Self::TrailingBytes { expected, given } => {
                write!(f, "{given} bytes where the model has {expected}: something was appended; copy it again")
            }
            Self::Checksum { expected, computed } => {
                write!(f, "the model is damaged (CRC-32 {computed:08x} instead of {expected:08x}); copy it again")
            }
            Self::Inconsistent { section } => {
                write!(f, "the model contradicts itself in its {section}; train again")
            }
        }
    }
}

impl core::error::Error for ModelError {}

/// What a byte that is 0 to 3 bytes before the end of four adds to their CRC.
const CRC_TABLES: [[u32; 256]; 4] = {
    let mut tables = [[0; 256]; 4];
    let mut i = 0;
    while i < 256 {
        #[allow(clippy::cast_possible_truncation, reason = "below 256")]
        let mut c = i as u32;
        let mut k = 0;
        while k < 8 {
            c = if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 };
            k += 1;
        }
        tables[0][i] = c;
        i += 1;
    }
    let mut t = 1;
    while t < 4 {
        i = 0;
        while i < 256 {
            let c = tables[t - 1][i];
            tables[t][i] = c >> 8 ^ tables[0][(c & 0xff) as usize];
            i += 1;
        }
        t += 1;
    }
    tables
};

/// CRC-32 (ISO-HDLC, the one of zip and PNG), four bytes at a time.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks();
    let c = words.iter().fold(!0, |c, &word| {
        let [a, b, d, e] = (c ^ u32::from_le_bytes(word)).to_le_bytes().map(usize::from);
        CRC_TABLES[3][a] ^ CRC_TABLES[2][b] ^ CRC_TABLES[1][d] ^ CRC_TABLES[0][e]
    });
    !rest.iter().fold(c, |c, &b| c >> 8 ^ CRC_TABLES[0][usize::from(c.to_le_bytes()[0] ^ b)])
}

/// A part of the keygraphs with a partition of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Tier {
    /// Copies of the keygraphs of all objects that are likeliest to be seen again, where there
    /// is more than one object.
    Shortlist,
    /// Copies of the next of them.
    Longlist,
    /// The keygraphs of an object that are likeliest to be seen again.
    First(u16),
    /// Its others: searched where the first tier leaves doubts.
    Second(u16),
}

impl Tier {
    /// The object whose keygraphs these are.
    #[must_use]
    pub const fn object(self) -> Option<u16> {
        match self {
            Self::Shortlist | Self::Longlist => None,
            Self::First(object) | Self::Second(object) => Some(object),
        }
    }

    /// Which list of all objects it is.
    #[must_use]
    pub const fn list(self) -> Option<usize> {
        match self {
            Self::Shortlist => Some(0),
            Self::Longlist => Some(1),
            Self::First(_) | Self::Second(_) => None,
        }
    }
}

/// Which tiers a model has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tiers {
    pub lists: bool,
    pub second: bool,
}

impl Tiers {
    /// How many there are with so many objects.
    pub const fn count(self, objects: usize) -> usize {
        2 * self.lists as usize + objects * (1 + self.second as usize)
    }

    /// Where a tier that there is stands among them.
    pub const fn number(self, tier: Tier) -> usize {
        match tier {
            Tier::Shortlist => 0,
            Tier::Longlist => 1,
            Tier::First(object) => self.count(object as usize),
            Tier::Second(object) => self.count(object as usize) + 1,
        }
    }

    /// As they stand in the header.
    pub const fn bits(self) -> u16 {
        (self.second as u16) << 1 | (self.lists as u16) << 2
    }

    const fn from_bits(bits: u16) -> Option<Self> {
        if bits & !6 == 0 { Some(Self { lists: bits & 4 == 4, second: bits & 2 == 2 }) } else { None }
    }
}

/// Objects, views, keypoints, keygraphs, bytes of templates, keygraphs of the lists.
pub(crate) type Counts = [usize; 6];

/// Where the sections of a model lie; all follow from the counts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub objects: usize,
    pub views: usize,
    pub keypoints: usize,
    pub cells: usize,
    pub keys: usize,
    pub vertices: usize,
    pub features: usize,
    pub sketches: usize,
    pub templates: usize,
    pub end: usize,
}

impl Layout {
    /// `None` when the sum does not fit `usize`.
    pub(crate) fn new(
        [objects, views, keypoints, keygraphs, templates, listed]: Counts,
        tiers: Tiers,
        feature_bytes: usize,
    ) -> Option<Self> {
        let after = |start: usize, n: usize, each: usize| start.checked_add(n.checked_mul(each)?);
        let o = HEADER;
        let v = after(o, objects, OBJECT)?;
        let k = after(v, views, VIEW)?;
        let c = after(k, keypoints, KEYPOINT)?;
        let keys = after(after(c, 4 * CELLS, tiers.count(objects))?, 4, 1)?;
        let vertices = after(keys, keygraphs, KEY)?;
        let features = after(vertices, keygraphs, VERTICES)?;
        let sketches = after(features, keygraphs, feature_bytes)?;
        let t = after(sketches, listed, SKETCH)?;
        let end = after(t, templates, 1)?;
        // Lengths and offsets are stored in 32 bits.
        u32::try_from(end).ok()?;
        Some(Self {
            objects: o,
            views: v,
            keypoints: k,
            cells: c,
            keys,
            vertices,
            features,
            sketches,
            templates: t,
            end,
        })
    }

    /// Where the parts of a keygraph start, and how many bytes of each it has: the key's
    /// planes, vertices, feature.
    pub(crate) const fn parts(&self, feature_bytes: usize) -> [(usize, usize); KEY + 2] {
        let n = (self.vertices - self.keys) / KEY;
        let mut parts = [(self.vertices, VERTICES); KEY + 2];
        let mut i = 0;
        while i < KEY {
            parts[i] = (self.keys + n * i, 1);
            i += 1;
        }
        parts[KEY + 1] = (self.features, feature_bytes);
        parts
    }
}

pub(crate) fn u16_at(b: &[u8], i: usize) -> u16 {
    u16::from_le_bytes([b[i], b[i + 1]])
}

pub(crate) fn u32_at(b: &[u8], i: usize) -> u32 {
    let b = &b[i..][..4];
    u32::from_le_bytes([b[0], b[1], b[2], b[3]])
}

pub(crate) fn size_at(b: &[u8], i: usize) -> usize {
    usize::try_from(u32_at(b, i)).unwrap_or(usize::MAX)
}

pub(crate) fn f32_at(b: &[u8], i: usize) -> f32 {
    f32::from_bits(u32_at(b, i))
}

/// One object of a model.
#[derive(Clone, Copy, Debug)]
pub struct Object<'a> {
    /// Its name.
    pub name: &'a str,
    /// Width of the training picture, px.
    pub width: u32,
    /// Height of the training picture, px.
    pub height: u32,
    /// Triples of keypoints that were possible, over all views.
    pub triples: u32,
    /// Its keypoints, over all views.
    pub keypoints: u32,
    /// What it looks like.
    pub template: Template<'a>,
}

/// A small picture of an object, as a pyramid: luma, and chroma of half the size.
#[derive(Clone, Copy, Debug)]
pub struct Template<'a> {
    /// Width of level 0, px; at most [`TEMPLATE_SIDE`].
    pub width: usize,
    /// Height of level 0, px; at most [`TEMPLATE_SIDE`].
    pub height: usize,
    luma: &'a [u8],
    chroma: [&'a [u8]; 2],
}

impl<'a> Template<'a> {
    /// A template of this size in `bytes`: all levels of luma, then of each chroma
    /// plane. `None` when there are not [`template_bytes`] of them.
    #[must_use]
    pub fn new(bytes: &'a [u8], width: usize, height: usize) -> Option<Self> {
        let (luma, chroma) = bytes.split_at_checked(plane_bytes(width, height))?;
        let (a, b) = chroma.split_at(chroma.len() / 2);
        (bytes.len() == template_bytes(width, height)).then_some(Self { width, height, luma, chroma: [a, b] })
    }

    /// Px of a picture of this size to px of level 0.
    #[must_use]
    #[allow(clippy::wrong_self_convention, reason = "a map, not a constructor")]
    pub fn from_picture(&self, width: f32, height: f32) -> Homography {
        let (sx, sy) = (self.width as f32 / width, self.height as f32 / height);
        Homography::affine([sx, 0.0, (sx - 1.0) / 2.0, 0.0, sy, (sy - 1.0) / 2.0])
    }

    /// Px of level 0 to px of a picture of this size.
    #[must_use]
    pub fn to_picture(&self, width: f32, height: f32) -> Homography {
        let (sx, sy) = (width / self.width as f32, height / self.height as f32);
        Homography::affine([sx, 0.0, (sx - 1.0) / 2.0, 0.0, sy, (sy - 1.0) / 2.0])
    }

    /// Luma of level `level`.
    ///
    /// # Panics
    /// When there is no such level.
    #[must_use]
    pub fn luma(&self, level: usize) -> Plane<'a, u8> {
        level_of(self.luma, self.width, self.height, level)
    }

    /// Both chroma planes of level `level`, half the size of its luma; the bytes
    /// are those of `i8`.
    ///
    /// # Panics
    /// When there is no such level.
    #[must_use]
    pub fn chroma(&self, level: usize) -> [Plane<'a, u8>; 2] {
        self.chroma.map(|p| level_of(p, self.width / 2, self.height / 2, level))
    }
}

/// One rendered view of an object that keypoints were taken from.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The object that it shows.
    pub object: u16,
    /// How many keypoints it has.
    pub keypoints: u16,
    /// Its first keypoint.
    pub first: u32,
    /// View px to picture px, affine.
    pub to_picture: Homography,
    /// Where the middle of the picture lies, view px.
    pub centre: [f32; 2],
    /// View px per picture px (the square root of the area ratio).
    pub scale: f32,
}

/// The keys of keygraphs, byte by byte, so that many are compared at once. Within a
/// subset they ascend, by size first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keys<'a> {
    /// Longest side, `16 log2(view px)`.
    pub sizes: &'a [u8],
    /// Half-degrees by which the largest angle (high four bits) and the second-largest
    /// (low four) exceed the least of the subset, 0 to 9.
    pub angles: &'a [u8],
    /// The signature, its lowest byte first.
    pub signatures: [&'a [u8]; 3],
}

/// A parsed model: a view that exists is valid.
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
    /// Checks `bytes`, which must be exactly one model, and borrows them.
    ///
    /// # Errors
    /// [`ModelError`], a variant for each thing that can be wrong.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, ModelError> {
        let given = bytes.len();
        if given < 4 || bytes[..4] != MAGIC {
            return Err(ModelError::NotAModel);
        }
        if given < HEADER {
            return Err(ModelError::Truncated { expected: HEADER, given });
        }
        let found = u16_at(bytes, 4);
        if found != VERSION {
            return Err(ModelError::NewerVersion { found });
        }
        let expected = size_at(bytes, 8);
        if expected > given {
            return Err(ModelError::Truncated { expected, given });
        }
        if expected < given {
            return Err(ModelError::TrailingBytes { expected, given });
        }
        let (stored, computed) = (u32_at(bytes, 12), crc32(&bytes[CHECKED..]));
        if stored != computed {
            return Err(ModelError::Checksum { expected: stored, computed });
        }
        let wrong = |section| ModelError::Inconsistent { section };
        let method = match bytes[16] {
            0 => Method::Keygraph,
            1 => Method::Paper,
            _ => return Err(wrong("method")),
        };
        let feature = match bytes[17] {
            1 => FeatureKind::Chroma,
            2 => FeatureKind::Luma,
            3 => FeatureKind::Both,
            _ => return Err(wrong("feature kind")),
        };
        let counts = [20, 24, 28, 32, 36, 40].map(|i| size_at(bytes, i));
        let tiers = Tiers::from_bits(u16_at(bytes, 18)).ok_or(wrong("tiers"))?;
        let layout = Layout::new(counts, tiers, method.sampling().bytes(feature)).ok_or(wrong("counts"))?;
        if usize::from(u16_at(bytes, 6)) != HEADER || layout.end != given {
            return Err(wrong("header"));
        }
        let model = Self { bytes, layout, method, feature, tiers, counts };
        model.check().map_or(Ok(model), |section| Err(wrong(section)))
    }

    /// The first section that contradicts the others.
    fn check(&self) -> Option<&'static str> {
        let [objects, views, keypoints, keygraphs, templates, listed] = self.counts;
        let limit = usize::from(u16::MAX);
        let end_of_lists = if self.tiers.lists { self.tier(Tier::Longlist).end } else { 0 };
        if objects == 0 || objects > limit || views > limit || listed != end_of_lists {
            return Some("counts");
        }
        for i in 0..objects {
            let (r, t) = (self.object_record(i), self.template_place(i));
            let name = &r[..NAME_BYTES];
            let sides_fit = [t.1, t.2].iter().all(|s| (8..=TEMPLATE_SIDE).contains(s));
            let picture_fits = [32, 36].iter().all(|&o| (1..=MAX_PICTURE_SIDE).contains(&u32_at(r, o)));
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
        let coordinate_fits = |o: usize| u16_at(self.bytes, self.layout.keypoints + o) <= i16::MAX.unsigned_abs();
        if !(0..keypoints).all(|i| coordinate_fits(KEYPOINT * i) && coordinate_fits(KEYPOINT * i + 2)) {
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
            let view = usize::from(u16_at(r, 0));
            // The rest of a view would take longer to read than all else here.
            let keypoints = |view| u16_at(self.record(self.layout.views, VIEW, view), 2);
            if view >= views || r[2..VERTICES].iter().max().is_none_or(|&v| u16::from(v) >= keypoints(view)) {
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

    /// Offset, width and height of the template of object `i`.
    fn template_place(&self, i: usize) -> (usize, usize, usize) {
        let r = self.object_record(i);
        (size_at(r, 40), usize::from(u16_at(r, 44)), usize::from(u16_at(r, 46)))
    }

    /// The bytes that the model was parsed from.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// How frames are searched for it.
    #[must_use]
    pub const fn method(&self) -> Method {
        self.method
    }

    /// What its features are made of.
    #[must_use]
    pub const fn feature(&self) -> FeatureKind {
        self.feature
    }

    /// Bytes of a feature.
    #[must_use]
    pub const fn feature_bytes(&self) -> usize {
        self.method.sampling().bytes(self.feature)
    }

    /// How many objects it holds.
    #[must_use]
    pub const fn objects(&self) -> usize {
        self.counts[0]
    }

    /// How many views it holds.
    #[must_use]
    pub const fn views(&self) -> usize {
        self.counts[1]
    }

    /// How many keypoints it holds, over all objects and views.
    #[must_use]
    pub const fn keypoints(&self) -> usize {
        self.counts[2]
    }

    /// How many keygraphs it holds, those of the lists counted again.
    #[must_use]
    pub const fn keygraphs(&self) -> usize {
        self.counts[3]
    }

    pub(crate) const fn counts(&self) -> Counts {
        self.counts
    }

    pub(crate) const fn layout(&self) -> Layout {
        self.layout
    }

    /// Object `i`.
    ///
    /// # Panics
    /// When there is no such object.
    #[must_use]
    pub fn object(&self, i: usize) -> Object<'a> {
        let r = self.object_record(i);
        let (start, width, height) = self.template_place(i);
        let t = &self.bytes[self.layout.templates + start..][..template_bytes(width, height)];
        let (luma, chroma) = t.split_at(plane_bytes(width, height));
        let (a, b) = chroma.split_at(chroma.len() / 2);
        Object {
            name: core::str::from_utf8(trim(&r[..NAME_BYTES])).unwrap_or_default(),
            width: u32_at(r, 32),
            height: u32_at(r, 36),
            triples: u32_at(r, 48),
            keypoints: u32_at(r, 52),
            template: Template { width, height, luma, chroma: [a, b] },
        }
    }

    /// View `i`.
    ///
    /// # Panics
    /// When there is no such view.
    #[must_use]
    pub fn view(&self, i: usize) -> View {
        let r = self.record(self.layout.views, VIEW, i);
        View {
            object: u16_at(r, 0),
            keypoints: u16_at(r, 2),
            first: u32_at(r, 4),
            to_picture: Homography::affine(core::array::from_fn(|k| f32_at(r, 8 + 4 * k))),
            centre: [f32_at(r, 32), f32_at(r, 36)],
            scale: f32_at(r, 40),
        }
    }

    /// Keypoint `i`, in its view.
    ///
    /// # Panics
    /// When there is no such keypoint.
    #[must_use]
    pub fn keypoint(&self, i: usize) -> Point {
        let r = self.record(self.layout.keypoints, KEYPOINT, i);
        let at = |o| i16::try_from(u16_at(r, o)).unwrap_or(i16::MAX);
        Point::new(at(0), at(2))
    }

    /// The view of keygraph `i`, and its vertices in canonical order, in view px.
    ///
    /// # Panics
    /// When there is no such keygraph.
    #[must_use]
    pub fn keygraph(&self, i: usize) -> (usize, [Point; 3]) {
        let r = self.vertex_record(i);
        let view = usize::from(u16_at(r, 0));
        let first = size_at(self.record(self.layout.views, VIEW, view), 4);
        (view, core::array::from_fn(|k| self.keypoint(first + usize::from(r[2 + k]))))
    }

    /// How unlikely a frame's triangulation is to contain keygraph `i`: [`crate::extract::keygraph::cost`].
    pub(crate) fn cost(&self, i: usize) -> u32 {
        let r = self.vertex_record(i);
        let view = self.record(self.layout.views, VIEW, usize::from(u16_at(r, 0)));
        let (n, first) = (usize::from(u16_at(view, 2)), size_at(view, 4));
        let mut ids: [usize; 3] = core::array::from_fn(|k| usize::from(r[2 + k]));
        ids.sort_unstable();
        let (points, _) =
            self.bytes[self.layout.keypoints + KEYPOINT * first..][..KEYPOINT * n].as_chunks::<KEYPOINT>();
        let at = |p: &[u8; KEYPOINT]| Point::new(i16::from_le_bytes([p[0], p[1]]), i16::from_le_bytes([p[2], p[3]]));
        crate::extract::keygraph::cost(|l| at(&points[l]), n, ids)
    }

    fn index_entry(&self, i: usize) -> usize {
        size_at(self.bytes, self.layout.cells + 4 * i)
    }

    /// The keygraphs of subset `cell` of a tier as a range of indices.
    ///
    /// # Panics
    /// When `cell` is not below [`CELLS`], or there is no such tier.
    #[must_use]
    pub fn cell(&self, tier: Tier, cell: usize) -> core::ops::Range<usize> {
        let i = CELLS * self.tiers.number(tier) + cell;
        self.index_entry(i)..self.index_entry(i + 1)
    }

    /// The keygraphs of a tier as a range of indices.
    ///
    /// # Panics
    /// When there is no such tier.
    #[must_use]
    pub fn tier(&self, tier: Tier) -> core::ops::Range<usize> {
        let i = CELLS * self.tiers.number(tier);
        self.index_entry(i)..self.index_entry(i + CELLS)
    }

    /// Whether there are [`Tier::Shortlist`] and [`Tier::Longlist`].
    #[must_use]
    pub const fn has_lists(&self) -> bool {
        self.tiers.lists
    }

    /// Whether there is [`Tier::Second`].
    #[must_use]
    pub const fn has_second_tiers(&self) -> bool {
        self.tiers.second
    }

    /// The keys of all keygraphs.
    #[must_use]
    pub fn keys(&self) -> Keys<'a> {
        let plane = |i: usize| &self.bytes[self.layout.keys + self.keygraphs() * i..][..self.keygraphs()];
        Keys { sizes: plane(0), angles: plane(1), signatures: [2, 3, 4].map(plane) }
    }

    /// Features, [`Model::feature_bytes`] each.
    #[must_use]
    pub fn features(&self) -> &'a [u8] {
        &self.bytes[self.layout.features..self.layout.sketches]
    }

    /// The [`crate::extract::feature::sketch`]es of the keygraphs of the lists, little endian.
    #[must_use]
    pub fn sketches(&self) -> &'a [[u8; SKETCH]] {
        self.bytes[self.layout.sketches..self.layout.templates].as_chunks().0
    }

    /// Subsets that hold at least one keygraph of any tier, and the size of the largest.
    #[must_use]
    pub fn occupancy(&self) -> (usize, usize) {
        let entry = |tier, cell| self.index_entry(CELLS * tier + cell);
        let tiers = 2 * usize::from(self.tiers.lists)..self.tiers.count(self.objects());
        let sizes = || (0..CELLS).map(|c| tiers.clone().map(|t| entry(t, c + 1) - entry(t, c)).sum::<usize>());
        (sizes().filter(|&n| n > 0).count(), sizes().max().unwrap_or(0))
    }
}

/// Bytes of a template of this size.
#[must_use]
pub const fn template_bytes(width: usize, height: usize) -> usize {
    plane_bytes(width, height) + 2 * plane_bytes(width / 2, height / 2)
}

fn trim(name: &[u8]) -> &[u8] {
    let end = name.iter().position(|&b| b == 0).unwrap_or(name.len());
    &name[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc_of_the_check_string() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn bytes_that_are_no_model_are_told_apart() {
        assert!(matches!(Model::parse(b""), Err(ModelError::NotAModel)));
        assert!(matches!(Model::parse(&[0; 64]), Err(ModelError::NotAModel)));
        assert!(matches!(Model::parse(&MAGIC), Err(ModelError::Truncated { .. })));
    }
}
