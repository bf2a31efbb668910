//! The bytes of a model: every record with its fields, the layout of the sections, the checksum.
//!
//! In: numbers. Out: bytes, and numbers read from bytes. All code that reads or writes a model uses
//! the [`Field`]s of this file; no other file holds an offset. `docs/model-format.md` describes the
//! format for readers in other languages, and a test compares the two.
//!
//! Memory: 4 KB of constants for the checksum. Cost: a few operations for each field; the checksum
//! takes two operations for each byte.

use core::marker::PhantomData;
use core::ops::Range;

use crate::base::capacity::id;
use crate::base::math::VECTORS;
use crate::extract::feature::FeatureKind;
use crate::extract::keygraph::{BIN, CELLS, Key};
use crate::image::pyramid::plane_bytes;
use crate::model::method::Method;

/// The first four bytes of every model.
pub const MAGIC: [u8; 4] = *b"KGM\x1a";
/// Version of the model format that this library writes and reads.
pub const VERSION: u16 = 6;
/// Maximum length of an object's name, bytes of UTF-8.
pub const NAME_BYTES: usize = 32;
/// Maximum side of a training picture, px.
pub const MAX_PICTURE_SIDE: u32 = 1 << 20;

/// Length of the header, bytes.
pub(crate) const HEADER: usize = 44;
/// Offset of the first byte that the checksum covers.
pub(crate) const CHECKED: usize = 16;
/// Length of an object's record, bytes.
pub(crate) const OBJECT: usize = 56;
/// Length of a view's record, bytes.
pub(crate) const VIEW: usize = 44;
/// Length of a keypoint's record, bytes.
pub(crate) const KEYPOINT: usize = 4;
/// Length of an entry of the index, bytes.
pub(crate) const ENTRY: usize = 4;
/// Length of a keygraph's key, bytes: one byte in each plane of [`Keys`](crate::Keys).
pub(crate) const KEY: usize = 5;
/// Length of a keygraph's vertices, bytes: the view, and three keypoints of this view.
pub(crate) const VERTICES: usize = 5;
/// Length of a [`sketch`](crate::stages::feature::sketch), bytes.
pub const SKETCH: usize = 8;

/// A little-endian number at a fixed offset in a record.
pub(crate) struct Field<T> {
    at: usize,
    number: PhantomData<T>,
}

impl<T> Field<T> {
    const fn at(at: usize) -> Self {
        Self { at, number: PhantomData }
    }
}

/// Implements reading and writing of a field for each type of number.
macro_rules! number {
    ($($number:ty),*) => {$(
        impl Field<$number> {
            #[inline(always)]
            pub(crate) fn get(&self, record: &[u8]) -> $number {
                let mut bytes = [0; size_of::<$number>()];
                bytes.copy_from_slice(&record[self.at..][..size_of::<$number>()]);
                <$number>::from_le_bytes(bytes)
            }

            #[inline(always)]
            pub(crate) fn put(&self, record: &mut [u8], value: $number) {
                record[self.at..][..size_of::<$number>()].copy_from_slice(&value.to_le_bytes());
            }
        }
    )*};
}

number!(u8, u16, i16, u32, f32);

impl Field<u32> {
    /// Reads the number as a `usize`.
    #[inline(always)]
    pub(crate) fn size(&self, record: &[u8]) -> usize {
        usize::try_from(self.get(record)).unwrap_or(usize::MAX)
    }

    /// Writes `size` as 32 bits. [`Layout::new`] has checked that it fits.
    #[inline(always)]
    pub(crate) fn put_size(&self, record: &mut [u8], size: usize) {
        self.put(record, u32::try_from(size).unwrap_or(u32::MAX));
    }
}

/// Fields of the header: [`HEADER`] bytes at the start of the model.
pub(crate) mod header {
    use super::Field;

    pub(crate) const VERSION: Field<u16> = Field::at(4);
    /// Length of the header, bytes.
    pub(crate) const LENGTH: Field<u16> = Field::at(6);
    /// Length of the model, bytes.
    pub(crate) const MODEL_LENGTH: Field<u32> = Field::at(8);
    /// CRC-32 of the bytes from [`CHECKED`](super::CHECKED) to the end of the model.
    pub(crate) const CHECKSUM: Field<u32> = Field::at(12);
    pub(crate) const METHOD: Field<u8> = Field::at(16);
    pub(crate) const FEATURE: Field<u8> = Field::at(17);
    pub(crate) const TIERS: Field<u16> = Field::at(18);
    pub(crate) const OBJECTS: Field<u32> = Field::at(20);
    pub(crate) const VIEWS: Field<u32> = Field::at(24);
    pub(crate) const KEYPOINTS: Field<u32> = Field::at(28);
    pub(crate) const KEYGRAPHS: Field<u32> = Field::at(32);
    pub(crate) const TEMPLATE_BYTES: Field<u32> = Field::at(36);
    pub(crate) const LISTED: Field<u32> = Field::at(40);
}

/// Fields of an object's record: [`OBJECT`] bytes. The first [`NAME_BYTES`] bytes are the name.
pub(crate) mod object {
    use super::Field;

    /// Width and height of the training picture, px.
    pub(crate) const WIDTH: Field<u32> = Field::at(32);
    pub(crate) const HEIGHT: Field<u32> = Field::at(36);
    /// Offset of the object's template in the section of templates, bytes.
    pub(crate) const TEMPLATE: Field<u32> = Field::at(40);
    pub(crate) const TEMPLATE_WIDTH: Field<u16> = Field::at(44);
    pub(crate) const TEMPLATE_HEIGHT: Field<u16> = Field::at(46);
    /// Number of possible triples of keypoints, over all views.
    pub(crate) const TRIPLES: Field<u32> = Field::at(48);
    /// Number of keypoints, over all views.
    pub(crate) const KEYPOINTS: Field<u32> = Field::at(52);
}

/// Fields of a view's record: [`VIEW`] bytes.
pub(crate) mod view {
    use super::Field;

    pub(crate) const OBJECT: Field<u16> = Field::at(0);
    pub(crate) const KEYPOINTS: Field<u16> = Field::at(2);
    /// Index of the view's first keypoint.
    pub(crate) const FIRST: Field<u32> = Field::at(4);
    /// Affine map from view px to picture px.
    pub(crate) const TO_PICTURE: [Field<f32>; 6] =
        [Field::at(8), Field::at(12), Field::at(16), Field::at(20), Field::at(24), Field::at(28)];
    /// Position of the picture's middle in the view, px.
    pub(crate) const CENTRE: [Field<f32>; 2] = [Field::at(32), Field::at(36)];
    /// Scale of the view: view px per picture px.
    pub(crate) const SCALE: Field<f32> = Field::at(40);
}

/// Fields of a keypoint's record: [`KEYPOINT`] bytes, coordinates in 1/16 px of the view.
pub(crate) mod keypoint {
    use super::Field;

    pub(crate) const X: Field<i16> = Field::at(0);
    pub(crate) const Y: Field<i16> = Field::at(2);
}

/// Fields of a keygraph's vertices: [`VERTICES`] bytes.
pub(crate) mod vertices {
    use super::Field;

    pub(crate) const VIEW: Field<u16> = Field::at(0);
    /// Keypoints of the view, counted from its first one, in canonical order.
    pub(crate) const IDS: [Field<u8>; 3] = [Field::at(2), Field::at(3), Field::at(4)];
}

/// The only field of an index entry ([`ENTRY`] bytes): the first keygraph of a subset.
pub(crate) const START: Field<u32> = Field::at(0);

/// The number that stands for a method in the header.
const fn number_of_method(method: Method) -> u8 {
    match method {
        Method::Keygraph => 0,
        Method::Paper => 1,
    }
}

/// The method that a number in the header stands for, if any.
pub(crate) const fn method_of(number: u8) -> Option<Method> {
    match number {
        0 => Some(Method::Keygraph),
        1 => Some(Method::Paper),
        _ => None,
    }
}

/// The number that stands for a kind of feature in the header.
const fn number_of_kind(kind: FeatureKind) -> u8 {
    match kind {
        FeatureKind::Chroma => 1,
        FeatureKind::Luma => 2,
        FeatureKind::Both => 3,
    }
}

/// The kind of feature that a number in the header stands for, if any.
pub(crate) const fn kind_of(number: u8) -> Option<FeatureKind> {
    match number {
        1 => Some(FeatureKind::Chroma),
        2 => Some(FeatureKind::Luma),
        3 => Some(FeatureKind::Both),
        _ => None,
    }
}

/// The key of a keygraph, one byte for each plane: size, bins of the angles, signature.
pub(crate) fn key_bytes(size: u8, key: Key, signature: u32) -> [u8; KEY] {
    let [a, b, c, _] = signature.to_le_bytes();
    [size, ((key.largest % BIN) << 4) | (key.second % BIN), a, b, c]
}

/// A part of the model's keygraphs, with its own partition into subsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Tier {
    /// Copies of the keygraphs of all objects that are most likely to be seen again. Only a packed
    /// model of more than one object has this tier.
    Shortlist,
    /// Copies of the next most likely keygraphs of all objects, after those of the shortlist.
    Longlist,
    /// The keygraphs of one object that are most likely to be seen again.
    First(u16),
    /// The other keygraphs of one object. They are searched when the first tier leaves doubts.
    Second(u16),
}

impl Tier {
    /// The object that the tier belongs to; `None` for a list of all objects.
    #[must_use]
    pub const fn object(self) -> Option<u16> {
        match self {
            Self::Shortlist | Self::Longlist => None,
            Self::First(object) | Self::Second(object) => Some(object),
        }
    }

    /// Index of the list: 0 for the shortlist, 1 for the longlist, `None` for a tier of one object.
    #[must_use]
    pub const fn list(self) -> Option<usize> {
        match self {
            Self::Shortlist => Some(0),
            Self::Longlist => Some(1),
            Self::First(_) | Self::Second(_) => None,
        }
    }
}

/// The kinds of tiers that a model has: the two lists, and second tiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tiers {
    pub lists: bool,
    pub second: bool,
}

impl Tiers {
    /// Number of tiers in a model of `objects` objects.
    pub const fn count(self, objects: usize) -> usize {
        2 * self.lists as usize + objects * (1 + self.second as usize)
    }

    /// Index of a tier in the order in which the model stores its tiers.
    pub const fn number(self, tier: Tier) -> usize {
        match tier {
            Tier::Shortlist => 0,
            Tier::Longlist => 1,
            Tier::First(object) => self.count(object as usize),
            Tier::Second(object) => self.count(object as usize) + 1,
        }
    }

    /// The tiers of one object.
    pub fn of(self, object: u16) -> impl Iterator<Item = Tier> {
        [Tier::First(object), Tier::Second(object)].into_iter().take(1 + usize::from(self.second))
    }

    /// Bits of the header that say which kinds of tiers the model has.
    pub const fn bits(self) -> u16 {
        (self.second as u16) << 1 | (self.lists as u16) << 2
    }

    /// Reads the bits of the header; `None` when an unknown bit is set.
    pub const fn from_bits(bits: u16) -> Option<Self> {
        if bits & !6 == 0 { Some(Self { lists: bits & 4 == 4, second: bits & 2 == 2 }) } else { None }
    }
}

/// Numbers of records of each kind in a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub objects: usize,
    pub views: usize,
    pub keypoints: usize,
    /// Number of keygraphs in all tiers. A keygraph that is also on a list counts twice.
    pub keygraphs: usize,
    /// Length of all templates together, bytes.
    pub templates: usize,
    /// Number of keygraphs on the lists.
    pub listed: usize,
}

impl Counts {
    /// Reads the counts from a header.
    pub(crate) fn get(header: &[u8]) -> Self {
        Self {
            objects: header::OBJECTS.size(header),
            views: header::VIEWS.size(header),
            keypoints: header::KEYPOINTS.size(header),
            keygraphs: header::KEYGRAPHS.size(header),
            templates: header::TEMPLATE_BYTES.size(header),
            listed: header::LISTED.size(header),
        }
    }

    fn put(&self, header: &mut [u8]) {
        header::OBJECTS.put_size(header, self.objects);
        header::VIEWS.put_size(header, self.views);
        header::KEYPOINTS.put_size(header, self.keypoints);
        header::KEYGRAPHS.put_size(header, self.keygraphs);
        header::TEMPLATE_BYTES.put_size(header, self.templates);
        header::LISTED.put_size(header, self.listed);
    }
}

/// Offsets of the sections of a model, bytes. The counts determine all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub objects: usize,
    pub views: usize,
    pub keypoints: usize,
    pub index: usize,
    pub keys: usize,
    pub vertices: usize,
    pub features: usize,
    pub sketches: usize,
    pub templates: usize,
    pub end: usize,
}

impl Layout {
    /// Computes the offsets; `None` when the model's length does not fit 32 bits or `usize`.
    pub(crate) fn new(counts: &Counts, tiers: Tiers, feature_bytes: usize) -> Option<Self> {
        let Counts { objects, views, keypoints, keygraphs, templates, listed } = *counts;
        let after = |start: usize, n: usize, each: usize| start.checked_add(n.checked_mul(each)?);
        let o = HEADER;
        let v = after(o, objects, OBJECT)?;
        let k = after(v, views, VIEW)?;
        let c = after(k, keypoints, KEYPOINT)?;
        let keys = after(after(c, ENTRY * CELLS, tiers.count(objects))?, ENTRY, 1)?;
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
            index: c,
            keys,
            vertices,
            features,
            sketches,
            templates: t,
            end,
        })
    }

    /// Start of each part of the keygraphs, and its bytes for one keygraph. The parts are the
    /// planes of the key, the vertices and the features.
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

/// Sorts the keygraphs of a subset by their keys, in place. It is a heap sort that swaps all
/// parallel parts.
pub(crate) fn sort_cell(out: &mut [u8], layout: &Layout, feature_bytes: usize, range: Range<usize>) {
    let start = range.start;
    let parts = layout.parts(feature_bytes);
    let key = |out: &[u8], i: usize| -> [u8; KEY] { core::array::from_fn(|p| out[parts[p].0 + start + i]) };
    // Index `i` is below `j`.
    let swap = |out: &mut [u8], i: usize, j: usize| {
        for (plane, _) in &parts[..KEY] {
            out.swap(plane + start + i, plane + start + j);
        }
        for (part, each) in &parts[KEY..] {
            let (low, high) = out.split_at_mut(part + each * (start + j));
            low[part + each * (start + i)..][..*each].swap_with_slice(&mut high[..*each]);
        }
    };
    let sift = |out: &mut [u8], mut root: usize, n: usize| {
        loop {
            let mut child = 2 * root + 1;
            if child >= n {
                return;
            }
            if child + 1 < n && key(out, child) < key(out, child + 1) {
                child += 1;
            }
            if key(out, root) >= key(out, child) {
                return;
            }
            swap(out, root, child);
            root = child;
        }
    };
    let n = range.len();
    for i in (0..n / 2).rev() {
        sift(out, i, n);
    }
    for end in (1..n).rev() {
        swap(out, 0, end);
        sift(out, 0, end);
    }
}

/// Writes the header. The checksum comes last, because it covers the fields after it.
pub(crate) fn write_header(out: &mut [u8], method: Method, feature: FeatureKind, tiers: Tiers, counts: &Counts) {
    out[..MAGIC.len()].copy_from_slice(&MAGIC);
    header::VERSION.put(out, VERSION);
    header::LENGTH.put(out, id(HEADER));
    let length = out.len();
    header::MODEL_LENGTH.put_size(out, length);
    header::METHOD.put(out, number_of_method(method));
    header::FEATURE.put(out, number_of_kind(feature));
    header::TIERS.put(out, tiers.bits());
    counts.put(out);
    let checksum = crc32(&out[CHECKED..]);
    header::CHECKSUM.put(out, checksum);
}

/// Length of a template of `width` x `height` px with all its levels, bytes.
#[must_use]
pub const fn template_bytes(width: usize, height: usize) -> usize {
    plane_bytes(width, height) + 2 * plane_bytes(width / 2, height / 2)
}

/// CRC tables: what a byte adds to the CRC when 0 to 3 bytes of the same word follow it.
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

/// What half a byte adds to the CRC.
const HALVES: [u32; 16] = {
    let mut halves = [0; 16];
    let mut i = 0;
    while i < 16 {
        halves[i] = CRC_TABLES[0][16 * i];
        i += 1;
    }
    halves
};

/// CRC-32 of `bytes` (ISO-HDLC, as in zip and PNG). It takes four bytes at a time, or half a byte
/// on a target without vectors: there flash is scarcer than time, and a model is checked once.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    if VECTORS { crc32_by_words(bytes) } else { crc32_by_halves(bytes) }
}

fn crc32_by_halves(bytes: &[u8]) -> u32 {
    let half = |c: u32| c >> 4 ^ HALVES[(c & 15) as usize];
    !bytes.iter().fold(!0, |c, &b| half(half(c ^ u32::from(b))))
}

fn crc32_by_words(bytes: &[u8]) -> u32 {
    let (words, rest) = bytes.as_chunks();
    let c = words.iter().fold(!0, |c, &word| {
        let [a, b, d, e] = (c ^ u32::from_le_bytes(word)).to_le_bytes().map(usize::from);
        CRC_TABLES[3][a] ^ CRC_TABLES[2][b] ^ CRC_TABLES[1][d] ^ CRC_TABLES[0][e]
    });
    !rest.iter().fold(c, |c, &b| c >> 8 ^ CRC_TABLES[0][usize::from(c.to_le_bytes()[0] ^ b)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc_of_the_check_string() {
        for crc in [crc32, crc32_by_words, crc32_by_halves] {
            assert_eq!(crc(b"123456789"), 0xcbf4_3926);
        }
    }

    #[test]
    fn what_is_put_is_got() {
        let mut record = [0xee; HEADER];
        let counts = Counts { objects: 1, views: 2, keypoints: 300, keygraphs: 70_000, templates: 5, listed: 6 };
        counts.put(&mut record);
        assert_eq!(Counts::get(&record), counts);
        assert_eq!(record[..20], [0xee; 20], "nothing else is touched");
        view::SCALE.put(&mut record, -1.5);
        keypoint::Y.put(&mut record, -2);
        assert_eq!((view::SCALE.get(&record), keypoint::Y.get(&record)), (-1.5, -2));
        for kind in [FeatureKind::Chroma, FeatureKind::Luma, FeatureKind::Both] {
            assert_eq!(kind_of(number_of_kind(kind)), Some(kind));
        }
        for method in [Method::Keygraph, Method::Paper] {
            assert_eq!(method_of(number_of_method(method)), Some(method));
        }
        for bits in [0, 2, 4, 6] {
            assert_eq!(Tiers::from_bits(bits).map(Tiers::bits), Some(bits));
        }
        assert_eq!((kind_of(0), method_of(2), Tiers::from_bits(1)), (None, None, None));
    }

    #[test]
    fn fields_of_a_record_do_not_overlap_and_fill_it() {
        let fills = |record: usize, fields: &[(usize, usize)]| {
            let mut end = 0;
            for &(at, bytes) in fields {
                assert_eq!(at, end, "a gap or an overlap in a record of {record} bytes");
                end += bytes;
            }
            assert_eq!(end, record);
        };
        use header as h;
        fills(
            HEADER,
            &[
                (0, MAGIC.len()),
                (h::VERSION.at, 2),
                (h::LENGTH.at, 2),
                (h::MODEL_LENGTH.at, 4),
                (h::CHECKSUM.at, 4),
                (h::METHOD.at, 1),
                (h::FEATURE.at, 1),
                (h::TIERS.at, 2),
                (h::OBJECTS.at, 4),
                (h::VIEWS.at, 4),
                (h::KEYPOINTS.at, 4),
                (h::KEYGRAPHS.at, 4),
                (h::TEMPLATE_BYTES.at, 4),
                (h::LISTED.at, 4),
            ],
        );
        use object as o;
        fills(
            OBJECT,
            &[
                (0, NAME_BYTES),
                (o::WIDTH.at, 4),
                (o::HEIGHT.at, 4),
                (o::TEMPLATE.at, 4),
                (o::TEMPLATE_WIDTH.at, 2),
                (o::TEMPLATE_HEIGHT.at, 2),
                (o::TRIPLES.at, 4),
                (o::KEYPOINTS.at, 4),
            ],
        );
        let [a, b, c, d, e, f] = view::TO_PICTURE.map(|field| (field.at, 4));
        let [x, y] = view::CENTRE.map(|field| (field.at, 4));
        let heads = [(view::OBJECT.at, 2), (view::KEYPOINTS.at, 2), (view::FIRST.at, 4)];
        fills(VIEW, &[heads[0], heads[1], heads[2], a, b, c, d, e, f, x, y, (view::SCALE.at, 4)]);
        fills(KEYPOINT, &[(keypoint::X.at, 2), (keypoint::Y.at, 2)]);
        let [i, j, k] = vertices::IDS.map(|field| (field.at, 1));
        fills(VERTICES, &[(vertices::VIEW.at, 2), i, j, k]);
    }
}
