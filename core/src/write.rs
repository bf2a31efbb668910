//! Writing models: what training and packing share, and packing itself.
//!
//! In: models, or records already at their place. Out: the bytes of one model in
//! the caller's buffer, subsets sorted, checksum set. [`pack`] merges many models
//! into one with one index over all.
//!
//! Memory: none beyond the buffer. Cost: one pass over the bytes, and a heap sort
//! of every subset of the partition.

use crate::feature::FeatureKind;
use crate::keygraph::{BIN, CELLS, Key};
use crate::model::{
    CHECKED, HEADER, KEY, KEYPOINT, Layout, MAGIC, Method, Model, OBJECT, VERSION, VERTICES, VIEW, crc32, u16_at,
    u32_at,
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
fn merged(models: &[Model<'_>]) -> Result<[usize; 5], PackError> {
    let first = models.first().ok_or(PackError::Nothing)?;
    let alike = |m: &Model<'_>| m.method() == first.method() && m.feature() == first.feature();
    if let Some(index) = models.iter().position(|m| !alike(m)) {
        return Err(PackError::Different { index });
    }
    let counts = core::array::from_fn(|i| models.iter().map(|m| m.counts()[i]).sum());
    let limit = usize::from(u16::MAX);
    if counts[0] > limit || counts[1] > limit { Err(PackError::TooMany) } else { Ok(counts) }
}

/// Bytes of the model that [`pack`] makes of `models`.
///
/// # Errors
/// [`PackError`] when they do not go together.
pub fn packed_len(models: &[Model<'_>]) -> Result<usize, PackError> {
    layout(models).map(|(_, l)| l.end)
}

fn layout(models: &[Model<'_>]) -> Result<([usize; 5], Layout), PackError> {
    let counts = merged(models)?;
    let bytes = models.first().map_or(0, |m| m.feature_bytes());
    Layout::new(counts, bytes).map(|l| (counts, l)).ok_or(PackError::TooMany)
}

/// Merges `models` into one at the start of `out` and says how long it is.
/// Objects keep their order.
///
/// # Errors
/// [`PackError`], with what to do about it.
pub fn pack(models: &[Model<'_>], out: &mut [u8]) -> Result<usize, PackError> {
    let (counts, layout) = layout(models)?;
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

    let mut start = 0;
    for cell in 0..CELLS {
        put_u32(out, layout.cells + 4 * cell, start);
        let mut at = start;
        let mut views = 0;
        for m in models {
            let (from, l, range) = (m.bytes(), m.layout(), m.cell(cell));
            for ((to, each), (part, _)) in layout.parts(feature_bytes).into_iter().zip(l.parts(feature_bytes)) {
                let source = &from[part + each * range.start..part + each * range.end];
                out[to + each * at..][..source.len()].copy_from_slice(source);
            }
            for i in at..at + range.len() {
                let r = &mut out[layout.vertices + VERTICES * i..][..2];
                let view = usize::from(u16_at(r, 0));
                put_u16(r, 0, view + views);
            }
            at += range.len();
            views += m.views();
        }
        sort_cell(out, &layout, feature_bytes, start..at);
        start = at;
    }
    put_u32(out, layout.cells + 4 * CELLS, start);
    write_header(out, first.method(), first.feature(), counts);
    Ok(out.len())
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
pub(crate) fn write_header(out: &mut [u8], method: Method, feature: FeatureKind, counts: [usize; 5]) {
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
    put_u16(out, 18, 0);
    for (i, n) in counts.into_iter().enumerate() {
        put_u32(out, 20 + 4 * i, n);
    }
    let crc = crc32(&out[CHECKED..]);
    out[12..16].copy_from_slice(&crc.to_le_bytes());
}
