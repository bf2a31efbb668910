//! Writing models: what training and packing share, and packing itself.
//!
//! In: models, or records already at their place. Out: the bytes of one model in
//! the caller's buffer, subsets sorted, checksum set. [`pack`] merges many models
//! into one: lists of the likeliest keygraphs of all objects, with a sketch of each, and their
//! tiers side by side.
//!
//! Memory: 7 KB of stack for [`pack`]. Cost: a pass over the bytes, a heap sort of every
//! subset of the lists, and four passes over the keygraphs to tell the likeliest (some 40 ms
//! an object).

use crate::extract::feature::{FeatureKind, sketch};
use crate::extract::keygraph::{BIN, CELLS, COSTS, Key, MAX_COST};
use crate::model::method::Method;
use crate::model::parse::{
    CHECKED, Counts, HEADER, KEY, KEYPOINT, Layout, MAGIC, Model, OBJECT, SKETCH, Tier, Tiers, VERSION, VERTICES, VIEW,
    crc32, u16_at, u32_at,
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
fn merged(models: &[Model<'_>]) -> Result<(Counts, Tiers), PackError> {
    let first = models.first().ok_or(PackError::Nothing)?;
    let alike = |m: &Model<'_>| m.method() == first.method() && m.feature() == first.feature();
    if let Some(index) = models.iter().position(|m| !alike(m)) {
        return Err(PackError::Different { index });
    }
    let mut counts: Counts = core::array::from_fn(|i| models.iter().map(|m| m.counts()[i]).sum());
    counts[3] = each_object(models).map(|(m, object, _)| own_keygraphs(m, object).count()).sum();
    let lists = first.method().parameters().lists.is_some() && counts[0] > 1;
    // They are made anew.
    counts[5] = 0;
    if lists {
        let n = counts[0];
        counts[5] = each_object(models).map(|(m, object, _)| shares(m, object, n).iter().sum::<usize>()).sum();
        counts[3] += counts[5];
    }
    let tiers = Tiers { lists, second: models.iter().any(Model::has_second_tiers) };
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

fn layout(models: &[Model<'_>]) -> Result<(Counts, Tiers, Layout), PackError> {
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

/// All keygraphs of an object: the subset of each, and its index.
fn own_keygraphs<'a>(m: &'a Model<'_>, object: u16) -> impl Iterator<Item = (usize, usize)> + 'a {
    let tiers = [Tier::First(object), Tier::Second(object)].into_iter().take(1 + usize::from(m.has_second_tiers()));
    tiers.flat_map(move |tier| (0..CELLS).flat_map(move |cell| m.cell(tier, cell).map(move |i| (cell, i))))
}

/// How many keygraphs of an object each list of so many objects takes.
fn shares(m: &Model<'_>, object: u16, objects: usize) -> [usize; 2] {
    let mut left = own_keygraphs(m, object).count();
    let shares = m.method().parameters().lists.map(|lists| lists.shares);
    shares.map_or([0; 2], |shares| {
        shares.map(|share| {
            let n = share.of_each.min(share.of_all / objects).min(left);
            left -= n;
            n
        })
    })
}

/// Chooses the keygraphs of an object for the lists: the cheapest for the first, the next
/// for the second, evenly spread ones of a cost of which only some are taken.
struct Choice {
    /// Of each cost: how many there are, how many of them each list takes.
    counts: [(usize, [usize; 2]); COSTS],
    /// How many of each cost have come by, and of these that are on a list.
    seen: [[usize; 2]; COSTS],
}

impl Choice {
    fn new(m: &Model<'_>, object: u16, objects: usize) -> Self {
        let mut counts = [(0, [0; 2]); COSTS];
        for (_, i) in own_keygraphs(m, object) {
            counts[class(m, i)].0 += 1;
        }
        let mut left = shares(m, object, objects);
        for (n, taken) in &mut counts {
            let mut rest = *n;
            for (taken, left) in taken.iter_mut().zip(&mut left) {
                *taken = rest.min(*left);
                *left -= *taken;
                rest -= *taken;
            }
        }
        Self { counts, seen: [[0; 2]; COSTS] }
    }

    /// The list that takes a keygraph. All have to come by, each time in the same order.
    fn list(&mut self, m: &Model<'_>, i: usize) -> Option<usize> {
        let class = class(m, i);
        let (n, [first, second]) = self.counts[class];
        let [seen, taken] = &mut self.seen[class];
        *seen += 1;
        is_one_of(first + second, n, *seen - 1).then(|| {
            *taken += 1;
            usize::from(!is_one_of(first, first + second, *taken - 1))
        })
    }
}

/// Whether thing `i` of `of` is one of the `n` evenly spread ones.
pub(crate) const fn is_one_of(n: usize, of: usize, i: usize) -> bool {
    of > 0 && (i as u64 + 1) * n as u64 / of as u64 != i as u64 * n as u64 / of as u64
}

/// What a keygraph costs, or the most that counts.
fn class(m: &Model<'_>, keygraph: usize) -> usize {
    m.cost(keygraph).min(MAX_COST) as usize
}

/// The index and the keygraphs of the lists.
fn write_lists(models: &[Model<'_>], objects: usize, out: &mut [u8], layout: &Layout, copied: &mut Copied) {
    let mut places = [[0; CELLS]; 2];
    for (m, object, _) in each_object(models) {
        let mut choice = Choice::new(m, object, objects);
        for (cell, i) in own_keygraphs(m, object) {
            if let Some(list) = choice.list(m, i) {
                places[list][cell] += 1;
            }
        }
    }
    let mut end = 0;
    for place in places.as_flattened_mut() {
        copied.subset(end, out, layout);
        end += core::mem::replace(place, end);
    }
    for (m, object, views) in each_object(models) {
        let mut choice = Choice::new(m, object, objects);
        for (cell, i) in own_keygraphs(m, object) {
            if let Some(list) = choice.list(m, i) {
                copied.keygraphs = places[list][cell];
                copied.keygraphs(m, i..i + 1, views, out, layout);
                places[list][cell] += 1;
            }
        }
    }
    copied.keygraphs = end;
    let feature_bytes = models.first().map_or(0, |m| m.feature_bytes());
    let mut start = 0;
    for end in places.into_iter().flatten() {
        sort_cell(out, layout, feature_bytes, start..end);
        start = end;
    }
    let (features, rest) = out[layout.features..layout.templates].split_at_mut(layout.sketches - layout.features);
    for (feature, to) in features.chunks_exact(feature_bytes).zip(rest.as_chunks_mut::<SKETCH>().0) {
        *to = sketch(feature).to_le_bytes();
    }
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
    if tiers.lists {
        write_lists(models, counts[0], out, &layout, &mut copied);
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
pub(crate) fn write_header(out: &mut [u8], method: Method, feature: FeatureKind, tiers: Tiers, counts: Counts) {
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
