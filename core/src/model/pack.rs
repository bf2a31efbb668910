//! Packs several models into one.
//!
//! In: parsed models of one method. Models on luma alone can stand beside models in colour: their
//! features get chroma bytes that say so, and their templates have no chroma, so that only their luma
//! is compared. Out: the bytes of one model in the
//! caller's buffer, with sorted subsets and a checksum. The tiers of all objects stand side by
//! side. A model of several objects also gets lists, where its method has them: copies of the
//! keygraphs of all objects that are most likely to be seen again, with a sketch of each.
//!
//! Memory: 7 KB of stack for [`pack`]. Cost: one pass over the bytes, a heap sort of every subset
//! of the lists, and four passes over the keygraphs to choose the most likely ones (about 40 ms for
//! each object).

use crate::base::capacity::id;
use crate::base::says::says;
use crate::extract::feature::{FeatureKind, NO_CHROMA_BYTE, sketch};
use crate::extract::keygraph::{CELLS, COSTS, MAX_COST};
use crate::image::pixels::NO_CHROMA;
use crate::model::format::{
    Counts, ENTRY, KEYPOINT, Layout, OBJECT, SKETCH, START, Tier, Tiers, VERTICES, VIEW, object, sort_cell, vertices,
    view, write_header,
};
use crate::model::parse::Model;
use crate::model::table::is_one_of;

/// The reason why models cannot be packed into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PackError {
    /// There is no model to pack.
    Nothing,
    /// The models were trained by different methods: train them alike.
    Different {
        /// Index of the first model that differs from model 0.
        index: usize,
    },
    /// There are more than 65,535 objects or views, or more than 4 GiB: split them over several
    /// files.
    TooMany,
    /// The buffer is too short: provide `needed` bytes ([`packed_len`]).
    NoRoom {
        /// Length of the packed model, bytes.
        needed: usize,
        /// Length of the buffer, bytes.
        given: usize,
    },
}

says!(PackError {
    Self::Nothing => ("there is no model to pack"),
    Self::Different { index } => (
        "model {} was trained by another method than the first: train all with `--preset paper`, or none",
        index + 1
    ),
    Self::TooMany => ("more than 65,535 objects or views, or 4 GiB, do not fit one model: split them over several"),
    Self::NoRoom { needed, given } => ("{} bytes cannot hold the packed model of {}", given, needed),
});

/// Checks that `models` can be packed together. Returns the sums of their counts, and the tiers of
/// the packed model.
fn merged(models: &[Model<'_>]) -> Result<(Counts, Tiers), PackError> {
    let first = models.first().ok_or(PackError::Nothing)?;
    let feature = kind(models);
    let alike = |m: &Model<'_>| {
        let fits = m.feature() == feature || (m.feature() == FeatureKind::Luma && feature == FeatureKind::Both);
        m.method() == first.method() && fits
    };
    if let Some(index) = models.iter().position(|m| !alike(m)) {
        return Err(PackError::Different { index });
    }
    // The lists of the input models are not counted: packing makes new lists.
    let mut counts = Counts::default();
    for m in models {
        let Counts { objects, views, keypoints, templates, .. } = m.counts();
        counts.objects += objects;
        counts.views += views;
        counts.keypoints += keypoints;
        counts.templates += templates;
    }
    counts.keygraphs = each_object(models).map(|(m, object, _)| own_keygraphs(m, object).count()).sum();
    let lists = first.method().parameters().lists.is_some() && counts.objects > 1;
    if lists {
        let n = counts.objects;
        counts.listed = each_object(models).map(|(m, object, _)| shares(m, object, n).iter().sum::<usize>()).sum();
        counts.keygraphs += counts.listed;
    }
    let tiers = Tiers { lists, second: models.iter().any(Model::has_second_tiers) };
    let limit = usize::from(u16::MAX);
    if counts.objects > limit || counts.views > limit { Err(PackError::TooMany) } else { Ok((counts, tiers)) }
}

/// Kind of feature of the packed model: that of the first model in colour, or of the first model
/// when all are on luma alone.
fn kind(models: &[Model<'_>]) -> FeatureKind {
    let coloured = models.iter().map(Model::feature).find(|&f| f != FeatureKind::Luma);
    coloured.unwrap_or(FeatureKind::Luma)
}

/// Length of a feature of the packed model, bytes.
fn feature_bytes(models: &[Model<'_>]) -> usize {
    models.first().map_or(0, |m| m.method().sampling().bytes(kind(models)))
}

/// Length of the model that [`pack`] makes of `models`, bytes.
///
/// # Errors
/// [`PackError`] when the models cannot be packed into one.
pub fn packed_len(models: &[Model<'_>]) -> Result<usize, PackError> {
    layout(models).map(|(.., l)| l.end)
}

fn layout(models: &[Model<'_>]) -> Result<(Counts, Tiers, Layout), PackError> {
    let (counts, tiers) = merged(models)?;
    Layout::new(&counts, tiers, feature_bytes(models)).map(|l| (counts, tiers, l)).ok_or(PackError::TooMany)
}

/// Iterates over the objects of all models. An item is the model, the index of the object in that
/// model, and the number of views in the models before it.
fn each_object<'a, 'b>(models: &'b [Model<'a>]) -> impl Iterator<Item = (&'b Model<'a>, u16, usize)> {
    let mut views = 0;
    models.iter().flat_map(move |m| {
        let before = views;
        views += m.views();
        (0..id(m.objects())).map(move |object| (m, object, before))
    })
}

/// Iterates over the keygraphs of an object, without the lists. An item is a subset and the index
/// of a keygraph in it.
fn own_keygraphs<'a>(m: &'a Model<'_>, object: u16) -> impl Iterator<Item = (usize, usize)> + 'a {
    let tiers = [Tier::First(object), Tier::Second(object)].into_iter().take(1 + usize::from(m.has_second_tiers()));
    tiers.flat_map(move |tier| (0..CELLS).flat_map(move |cell| m.cell(tier, cell).map(move |i| (cell, i))))
}

/// Number of keygraphs of an object in each of the two lists, for a packed model of `objects`
/// objects.
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

/// Chooses the keygraphs of an object for the two lists. The cheapest keygraphs go to the first
/// list, the next cheapest to the second. A list may take only a part of the keygraphs of one cost:
/// these are spread evenly over the order of the keygraphs.
struct Choice {
    /// For each cost: the number of keygraphs, and the number that each list takes.
    counts: [(usize, [usize; 2]); COSTS],
    /// For each cost: the number of keygraphs passed to `list` so far, and how many of these were
    /// chosen for a list.
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

    /// Returns the list that takes keygraph `i`, if any. The caller passes every keygraph of the
    /// object once, in the order in which [`Choice::new`] counted them.
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

/// The cost of a keygraph, at most [`MAX_COST`].
fn class(m: &Model<'_>, keygraph: usize) -> usize {
    m.cost(keygraph).min(MAX_COST) as usize
}

/// Writes the index entries and the keygraphs of the two lists, and their sketches.
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
    let feature_bytes = feature_bytes(models);
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

/// Merges `models` into one model at the start of `out`. Returns its length, bytes. Objects keep
/// their order.
///
/// # Errors
/// [`PackError`] when the models cannot be packed into one, or when `out` is too short.
pub fn pack(models: &[Model<'_>], out: &mut [u8]) -> Result<usize, PackError> {
    let (counts, tiers, layout) = layout(models)?;
    let (Some(first), given) = (models.first(), out.len()) else { return Err(PackError::Nothing) };
    let out = out.get_mut(..layout.end).ok_or(PackError::NoRoom { needed: layout.end, given })?;

    // Totals of the models copied so far: objects, views, keypoints, template bytes.
    let (mut objects, mut views, mut keypoints, mut templates) = (0, 0, 0, 0);
    for m in models {
        let (from, l) = (m.bytes(), m.layout());
        let mut copy = |to: usize, range: core::ops::Range<usize>| {
            out[to..to + range.len()].copy_from_slice(&from[range]);
        };
        copy(layout.objects + OBJECT * objects, l.objects..l.views);
        copy(layout.views + VIEW * views, l.views..l.keypoints);
        copy(layout.keypoints + KEYPOINT * keypoints, l.keypoints..l.index);
        copy(layout.templates + templates, l.templates..l.end);
        if m.feature() != kind(models) {
            for i in 0..m.objects() {
                let (start, chroma) = m.chroma_of_template(i);
                out[layout.templates + templates + start..][..chroma].fill(NO_CHROMA.cast_unsigned());
            }
        }
        for i in objects..objects + m.objects() {
            let r = &mut out[layout.objects + OBJECT * i..][..OBJECT];
            let at = object::TEMPLATE.size(r) + templates;
            object::TEMPLATE.put_size(r, at);
        }
        for i in views..views + m.views() {
            let r = &mut out[layout.views + VIEW * i..][..VIEW];
            let (of, first) = (view::OBJECT.get(r) + id(objects), view::FIRST.size(r) + keypoints);
            view::OBJECT.put(r, of);
            view::FIRST.put_size(r, first);
        }
        objects += m.objects();
        views += m.views();
        keypoints += m.keypoints();
        templates += l.end - l.templates;
    }

    let mut copied = Copied { keygraphs: 0, subsets: 0, feature_bytes: feature_bytes(models) };
    if tiers.lists {
        write_lists(models, counts.objects, out, &layout, &mut copied);
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
    copied.end_index(out, &layout);
    write_header(out, first.method(), kind(models), tiers, &counts);
    Ok(out.len())
}

/// Number of keygraphs and of index entries that [`pack`] has written so far.
struct Copied {
    keygraphs: usize,
    subsets: usize,
    /// Length of a feature of the packed model, bytes.
    feature_bytes: usize,
}

impl Copied {
    /// Appends the keygraphs `range` of `m`. `views` is the number of views in the models before
    /// `m`.
    fn keygraphs(
        &mut self,
        m: &Model<'_>,
        range: core::ops::Range<usize>,
        views: usize,
        out: &mut [u8],
        layout: &Layout,
    ) {
        let at = self.keygraphs;
        let parts = m.layout().parts(m.feature_bytes());
        for ((to, wide), (part, each)) in layout.parts(self.feature_bytes).into_iter().zip(parts) {
            let source = &m.bytes()[part + each * range.start..part + each * range.end];
            let out = &mut out[to + wide * at..][..wide * range.len()];
            if wide == each {
                out.copy_from_slice(source);
                continue;
            }
            for (out, source) in out.chunks_exact_mut(wide).zip(source.chunks_exact(each)) {
                let (luma, chroma) = out.split_at_mut(each);
                luma.copy_from_slice(source);
                chroma.fill(NO_CHROMA_BYTE);
            }
        }
        self.keygraphs += range.len();
        for i in at..self.keygraphs {
            let r = &mut out[layout.vertices + VERTICES * i..][..2];
            let view = vertices::VIEW.get(r) + id(views);
            vertices::VIEW.put(r, view);
        }
    }

    /// Appends an index entry for a subset that starts at keygraph `start`.
    fn subset(&mut self, start: usize, out: &mut [u8], layout: &Layout) {
        START.put_size(&mut out[layout.index + ENTRY * self.subsets..], start);
        self.subsets += 1;
    }

    /// Appends the last index entry: the number of keygraphs.
    fn end_index(&mut self, out: &mut [u8], layout: &Layout) {
        self.subset(self.keygraphs, out, layout);
    }
}
