//! Writing models: what training and packing share, and packing itself.
//!
//! In: models, or records already at their place. Out: the bytes of one model in
//! the caller's buffer, subsets sorted, checksum set. [`pack`] merges many models
//! into one: their tiers side by side and, where objects are many, a shortlist of all.
//!
//! Memory: none beyond the buffer. Cost: one pass over the bytes, and a heap sort
//! of every subset.

use crate::feature::FeatureKind;
use crate::keygraph::{BIN, CELLS, Key};
use crate::model::{
    CHECKED, HEADER, KEY, KEYPOINT, Layout, MAGIC, Method, Model, OBJECT, Tier, Tiers, VERSION, VERTICES, VIEW, crc32,
    u16_at, u32_at,
};

/// Why models cannot be packed into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PackError {
    /// There is nothing to pack.
    Nothing,
    /// They were trained by different methods or on different features: train
    /// them alike.
    Different {
        /// Index of the first model that differs from the first of all.
        index: usize,
    },
    /// More than 65,535 objects or views, or 4 GiB: split them over several files.
    TooMany,
    /// The buffer is too short: give `needed` bytes ([`packed_len`]).
    NoRoom {
        /// Bytes of the packed model.
        needed: usize,
        /// Bytes given.
        given: usize,
    },
}

impl core::fmt::Display for PackError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Nothing => write!(f, "there is no model to pack"),
            Self::Different { index } => write!(
                f,
                "model {} was trained by another method or on another feature than the first: train all alike (`--luma` for all or none, no mix with `--preset paper`)",
                index + 1
            ),
            Self::TooMany => {
                write!(f, "more than 65,535 objects or views, or 4 GiB, do not fit one model: split them over several")
            }
            Self::NoRoom { needed, given } => write!(f, "{given} bytes cannot hold the packed model of {needed}"),
        }
    }
}

impl core::error::Error for PackError {}

/// Sums of the counts of `models`, once they are known to go together.
fn merged(models: &[Model<'_>]) -> Result<([usize; 5], Tiers), PackError> {
    let first = models.first().ok_or(PackError::Nothing)?;
    let alike = |m: &Model<'_>| m.method() == first.method() && m.feature() == first.feature();
    if let Some(index) = models.iter().position(|m| !alike(m)) {
        return Err(PackError::Different { index });
    }
    // The shortlist is made anew.
    let own = |m: &Model<'_>| m.keygraphs() - if m.has_shortlist() { m.tier(Tier::Shortlist).len() } else { 0 };
    let mut counts: [usize; 5] = core::array::from_fn(|i| models.iter().map(|m| m.counts()[i]).sum());
    counts[3] = models.iter().map(own).sum();
    let rules = first.method().parameters().shortlist;
    let shortlist = rules.keygraphs > 0 && counts[0] > rules.without;
    if shortlist {
        let copies =
            |(m, object, _)| (0..CELLS).map(|cell| shortlisted(m, object, cell, counts[0]).count()).sum::<usize>();
        counts[3] += each_object(models).map(copies).sum::<usize>();
    }
    let tiers = Tiers { shortlist, second: models.iter().any(Model::has_second_tiers) };
    let limit = usize::from(u16::MAX);
    if counts[0] > limit || counts[1] > limit { Err(PackError::TooMany) } else { Ok((counts, tiers)) }
}

/// Bytes of the model that [`pack`] makes of `models`.
///
/// # Errors
/// [`PackError`] when they do not go together.
pub fn packed_len(models: &[Model<'_>]) -> Result<usize, PackError> {
    layout(models).map(|(.., l)| l.end)
}

fn layout(models: &[Model<'_>]) -> Result<([usize; 5], Tiers, Layout), PackError> {
    let (counts, tiers) = merged(models)?;
    let bytes = models.first().map_or(0, |m| m.feature_bytes());
    Layout::new(counts, tiers, bytes).map(|l| (counts, tiers, l)).ok_or(PackError::TooMany)
}

/// All objects: the model of each, its number there, and how many views come before that
/// model's.
fn each_object<'a, 'b>(models: &'b [Model<'a>]) -> impl Iterator<Item = (&'b Model<'a>, u16, usize)> {
    let mut views = 0;
    models.iter().flat_map(move |m| {
        let before = views;
        views += m.views();
        (0..u16::try_from(m.objects()).unwrap_or(u16::MAX)).map(move |object| (m, object, before))
    })
}

/// The keygraphs of a subset of an object that the shortlist of so many objects copies:
/// evenly spread ones of its first tier.
fn shortlisted(m: &Model<'_>, object: u16, cell: usize, objects: usize) -> impl Iterator<Item = usize> {
    let tier = m.tier(Tier::First(object));
    let rules = m.method().parameters().shortlist;
    let each = tier.len().div_ceil(rules.keygraphs.min(rules.total / objects).max(1)).max(1);
    m.cell(Tier::First(object), cell).filter(move |i| (i - tier.start).is_multiple_of(each))
}

/// Merges `models` into one at the start of `out` and says how long it is.
/// Objects keep their order.
///
/// # Errors
/// [`PackError`], with what to do about it.
pub fn pack(models: &[Model<'_>], out: &mut [u8]) -> Result<usize, PackError> {
    let (counts, tiers, layout) = layout(models)?;
    let (Some(first), given) = (models.first(), out.len()) else { return Err(PackError::Nothing) };
    let out = out.get_mut(..layout.end).ok_or(PackError::NoRoom { needed: layout.end, given })?;
    let feature_bytes = first.feature_bytes();

    // What came before this model: objects, views, keypoints, template bytes.
    let (mut objects, mut views, mut keypoints, mut templates) = (0, 0, 0, 0);
    for m in models {
        let (from, l) = (m.bytes(), m.layout());
        let mut copy = |to: usize, range: core::ops::Range<usize>| {
            out[to..to + range.len()].copy_from_slice(&from[range]);
        };
        copy(layout.objects + OBJECT * objects, l.objects..l.views);
        copy(layout.views + VIEW * views, l.views..l.keypoints);
        copy(layout.keypoints + KEYPOINT * keypoints, l.keypoints..l.cells);
        copy(layout.templates + templates, l.templates..l.end);
        for i in objects..objects + m.objects() {
            let r = &mut out[layout.objects + OBJECT * i..][..OBJECT];
            let at = u32_at(r, 40) as usize;
            put_u32(r, 40, at + templates);
        }
        for i in views..views + m.views() {
            let r = &mut out[layout.views + VIEW * i..][..VIEW];
            let (object, at) = (usize::from(u16_at(r, 0)), u32_at(r, 4) as usize);
            put_u16(r, 0, object + objects);
            put_u32(r, 4, at + keypoints);
        }
        objects += m.objects();
        views += m.views();
        keypoints += m.keypoints();
        templates += l.end - l.templates;
    }

    let mut copied = Copied { keygraphs: 0, subsets: 0 };
    if tiers.shortlist {
        for cell in 0..CELLS {
            let start = copied.keygraphs;
            for (m, object, views) in each_object(models) {
                for i in shortlisted(m, object, cell, counts[0]) {
                    copied.keygraphs(m, i..i + 1, views, out, &layout);
                }
            }
            sort_cell(out, &layout, feature_bytes, start..copied.keygraphs);
            copied.subset(start, out, &layout);
        }
    }
    for (m, object, views) in each_object(models) {
        for tier in [Tier::First(object), Tier::Second(object)].into_iter().take(1 + usize::from(tiers.second)) {
            for cell in 0..CELLS {
                let start = copied.keygraphs;
                let has = m.has_second_tiers() || tier == Tier::First(object);
                copied.keygraphs(m, if has { m.cell(tier, cell) } else { 0..0 }, views, out, &layout);
                copied.subset(start, out, &layout);
            }
        }
    }
    put_u32(out, layout.cells + 4 * copied.subsets, copied.keygraphs);
    write_header(out, first.method(), first.feature(), tiers, counts);
    Ok(out.len())
}

/// How much of the keygraphs and of their index [`pack`] has written.
struct Copied {
    keygraphs: usize,
    subsets: usize,
}

impl Copied {
    /// Appends keygraphs of `m`, whose views are counted from `views` on.
    fn keygraphs(
        &mut self,
        m: &Model<'_>,
        range: core::ops::Range<usize>,
        views: usize,
        out: &mut [u8],
        layout: &Layout,
    ) {
        let (at, feature_bytes) = (self.keygraphs, m.feature_bytes());
        for ((to, each), (part, _)) in layout.parts(feature_bytes).into_iter().zip(m.layout().parts(feature_bytes)) {
            let source = &m.bytes()[part + each * range.start..part + each * range.end];
            out[to + each * at..][..source.len()].copy_from_slice(source);
        }
        self.keygraphs += range.len();
        for i in at..self.keygraphs {
            let r = &mut out[layout.vertices + VERTICES * i..][..2];
            let view = usize::from(u16_at(r, 0));
            put_u16(r, 0, view + views);
        }
    }

    /// Appends a subset to the index: the keygraphs from `start` on.
    fn subset(&mut self, start: usize, out: &mut [u8], layout: &Layout) {
        put_u32(out, layout.cells + 4 * self.subsets, start);
        self.subsets += 1;
    }
}

pub(crate) fn put_u16(r: &mut [u8], at: usize, v: usize) {
    r[at..at + 2].copy_from_slice(&u16::try_from(v).unwrap_or(u16::MAX).to_le_bytes());
}

pub(crate) fn put_u32(r: &mut [u8], at: usize, v: usize) {
    r[at..at + 4].copy_from_slice(&u32::try_from(v).unwrap_or(u32::MAX).to_le_bytes());
}

/// The key of a keygraph, a byte for each plane.
pub(crate) fn key_bytes(size: u8, key: Key, signature: u32) -> [u8; KEY] {
    let [a, b, c, _] = signature.to_le_bytes();
    [size, ((key.largest % BIN) << 4) | (key.second % BIN), a, b, c]
}

/// Sorts the keygraphs of a subset by their keys, in place (heap sort over their
/// parallel parts).
pub(crate) fn sort_cell(out: &mut [u8], layout: &Layout, feature_bytes: usize, range: core::ops::Range<usize>) {
    let start = range.start;
    let parts = layout.parts(feature_bytes);
    let key = |out: &[u8], i: usize| -> [u8; KEY] { core::array::from_fn(|p| out[parts[p].0 + start + i]) };
    let swap = |out: &mut [u8], i: usize, j: usize| {
        for (part, each) in parts {
            for b in 0..each {
                out.swap(part + each * (start + i) + b, part + each * (start + j) + b);
            }
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

/// Writes the header, and last the checksum over everything behind it.
pub(crate) fn write_header(out: &mut [u8], method: Method, feature: FeatureKind, tiers: Tiers, counts: [usize; 5]) {
    out[..4].copy_from_slice(&MAGIC);
    put_u16(out, 4, usize::from(VERSION));
    put_u16(out, 6, HEADER);
    put_u32(out, 8, out.len());
    out[16] = match method {
        Method::Keygraph => 0,
        Method::Paper => 1,
    };
    out[17] = match feature {
        FeatureKind::Chroma => 1,
        FeatureKind::Luma => 2,
        FeatureKind::Both => 3,
    };
    put_u16(out, 18, tiers.bits().into());
    for (i, n) in counts.into_iter().enumerate() {
        put_u32(out, 20 + 4 * i, n);
    }
    let crc = crc32(&out[CHECKED..]);
    out[12..16].copy_from_slice(&crc.to_le_bytes());
}
