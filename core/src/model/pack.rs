//! Packs several models into one.
//!
//! In: parsed models of one method, or [parts](Part) of them. Models on luma alone can stand beside models in
//! colour: their features get chroma bytes that say so, and their templates have no chroma, so that only their
//! luma is compared. Out: the bytes of one model in the
//! caller's buffer, with sorted subsets and a checksum. The tiers of all objects stand side by
//! side. A model of several objects also gets lists, where its method has them: copies of the
//! keygraphs of all objects that are most likely to be seen again, with a sketch of each.
//!
//! The lists are made anew of the keygraphs of each object. So a part of a pack gives what the models of its
//! objects would give, byte for byte, with two exceptions. The template of a model on luma alone loses its
//! chroma beside models in colour. Second tiers that are empty in all objects are left out of a part.
//!
//! Memory: 7 KB of stack for [`pack`]. Cost: one pass over the bytes, a heap sort of every subset
//! of the lists, and one look at the surroundings of each keygraph to choose the most likely ones.

use core::ops::Range;

use crate::base::capacity::id;
use crate::base::says::says;
use crate::extract::feature::{FeatureKind, NO_CHROMA_BYTE, sketch};
use crate::extract::keygraph::{CELLS, COSTS, MAX_COST};
use crate::image::pixels::NO_CHROMA;
use crate::model::format::{
    Counts, ENTRY, KEYPOINT, Layout, OBJECT, SKETCH, START, Tier, Tiers, VERTICES, VIEW, object, sort_cell, vertices,
    view, write_header,
};
use crate::model::method::Method;
use crate::model::parse::Model;
use crate::model::part::{Part, own_keygraphs};
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
    /// A model is slim: pack the models that it was made of.
    Slim {
        /// Index of the first such model.
        index: usize,
    },
    /// The model has no lists, without which it cannot be slim: pack at least two models, not trained by
    /// [`Method::Paper`].
    NoLists,
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
    Self::Slim { index } => ("model {} is slim: pack the models that it was made of", index + 1),
    Self::NoLists => ("only a pack of at least two objects can be slim, and none of the method `paper`"),
    Self::TooMany => ("more than 65,535 objects or views, or 4 GiB, do not fit one model: split them over several"),
    Self::NoRoom { needed, given } => ("{} bytes cannot hold the packed model of {}", given, needed),
});

/// Parts of models, as often as they are asked for.
trait Parts<'a>: Iterator<Item = Part<'a>> + Clone {}

impl<'a, I: Iterator<Item = Part<'a>> + Clone> Parts<'a> for I {}

fn whole<'a>(models: &[Model<'a>]) -> impl Parts<'a> {
    models.iter().copied().map(Part::from)
}

/// What a packed model will be.
struct Plan {
    method: Method,
    feature: FeatureKind,
    tiers: Tiers,
    counts: Counts,
    layout: Layout,
    /// Maximum number of keygraphs of each object in the lists.
    most: usize,
}

impl Plan {
    /// Checks that `parts` can be packed together, and sums up their counts. The lists get at most `most` keygraphs of
    /// each object.
    fn new<'a>(parts: impl Parts<'a>, most: usize) -> Result<Self, PackError> {
        let method = parts.clone().next().ok_or(PackError::Nothing)?.model.method();
        let feature = kind(parts.clone());
        let alike = |p: &Part<'_>| {
            let fits = p.feature == feature || (p.feature == FeatureKind::Luma && feature == FeatureKind::Both);
            p.model.method() == method && fits
        };
        if let Some(index) = parts.clone().position(|p| !alike(&p)) {
            return Err(PackError::Different { index });
        }
        if let Some(index) = parts.clone().position(|p| p.model.is_slim()) {
            return Err(PackError::Slim { index });
        }
        // The lists of the input models are not counted: packing makes new lists.
        let mut counts = Counts::default();
        for p in parts.clone() {
            counts.objects += p.objects.len();
            counts.views += p.views.len();
            counts.keypoints += p.keypoints.len();
            counts.templates += p.templates.len();
        }
        counts.keygraphs = each_object(parts.clone()).map(|o| own_keygraphs(&o.model, o.object).count()).sum();
        let lists = method.parameters().lists.is_some() && counts.objects > 1;
        if lists {
            let n = counts.objects;
            counts.listed =
                each_object(parts.clone()).map(|o| shares(&o.model, o.object, n, most).iter().sum::<usize>()).sum();
            counts.keygraphs += counts.listed;
        }
        let tiers = Tiers { lists, second: parts.into_iter().any(|p| p.second) };
        let limit = usize::from(u16::MAX);
        if counts.objects > limit || counts.views > limit {
            return Err(PackError::TooMany);
        }
        let layout = Layout::new(&counts, tiers, method.sampling().bytes(feature)).ok_or(PackError::TooMany)?;
        Ok(Self { method, feature, tiers, counts, layout, most })
    }

    /// Length of a feature of the packed model, bytes.
    fn feature_bytes(&self) -> usize {
        self.method.sampling().bytes(self.feature)
    }
}

/// Kind of feature of the packed model: that of the first part in colour, or luma when all are on luma alone.
fn kind<'a>(mut parts: impl Parts<'a>) -> FeatureKind {
    parts.find(|p| p.feature != FeatureKind::Luma).map_or(FeatureKind::Luma, |p| p.feature)
}

/// Length of the model that [`pack`] makes of `models`, bytes.
///
/// # Errors
/// [`PackError`] when the models cannot be packed into one.
pub fn packed_len(models: &[Model<'_>]) -> Result<usize, PackError> {
    Plan::new(whole(models), usize::MAX).map(|plan| plan.layout.end)
}

/// Length of the model that [`pack_parts`] makes of `parts`, bytes.
///
/// # Errors
/// [`PackError`] when the parts cannot be packed into one model.
pub fn packed_parts_len(parts: &[Part<'_>], most: usize) -> Result<usize, PackError> {
    Plan::new(parts.iter().cloned(), most).map(|plan| plan.layout.end)
}

/// An object that is packed: its model, and its index there.
struct Packed<'a> {
    model: Model<'a>,
    object: u16,
    shift: Shift,
}

/// How the views of a part are numbered anew.
#[derive(Clone, Copy)]
struct Shift {
    /// Index of the part's first view in its model.
    from: usize,
    /// Number of views in the parts before it.
    to: usize,
}

/// Iterates over the objects of all parts.
fn each_object<'a>(parts: impl Parts<'a>) -> impl Iterator<Item = Packed<'a>> {
    let mut views = 0;
    parts.flat_map(move |p| {
        let shift = Shift { from: p.views.start, to: views };
        views += p.views.len();
        p.objects.map(move |object| Packed { model: p.model, object: id(object), shift })
    })
}

/// Number of keygraphs of an object in each of the two lists, for a packed model of `objects`
/// objects: at most `most` in both.
fn shares(m: &Model<'_>, object: u16, objects: usize, most: usize) -> [usize; 2] {
    let mut left = own_keygraphs(m, object).count().min(most);
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
    /// `costs` are those of the object's keygraphs, and `shares` what the lists take of them.
    fn new(costs: impl Iterator<Item = usize>, shares: [usize; 2]) -> Self {
        let mut counts = [(0, [0; 2]); COSTS];
        for cost in costs {
            counts[cost].0 += 1;
        }
        let mut left = shares;
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

    /// Returns the list that takes a keygraph of this cost, if any. The caller passes every keygraph of
    /// the object once.
    fn list(&mut self, cost: usize) -> Option<usize> {
        let (n, [first, second]) = self.counts[cost];
        let [seen, taken] = &mut self.seen[cost];
        *seen += 1;
        is_one_of(first + second, n, *seen - 1).then(|| {
            *taken += 1;
            usize::from(!is_one_of(first, first + second, *taken - 1))
        })
    }
}

/// Places for the costs of all keygraphs while the lists are written: each is where the keygraph's feature
/// will be when all is written.
struct Costs {
    start: usize,
    each: usize,
}

impl Costs {
    /// Computes the costs, which takes most of the time of packing.
    fn write<'a>(parts: impl Parts<'a>, plan: &Plan, out: &mut [u8]) -> Self {
        let each = plan.feature_bytes();
        let costs = Self { start: plan.layout.features + each * plan.counts.listed, each };
        let mut place = costs.start;
        for o in each_object(parts) {
            for (_, i) in own_keygraphs(&o.model, o.object) {
                out[place] = u8::try_from(o.model.cost(i).min(MAX_COST)).unwrap_or(u8::MAX);
                place += each;
            }
        }
        costs
    }

    /// Cost of keygraph `n` of the parts.
    fn get(&self, out: &[u8], n: usize) -> usize {
        usize::from(out[self.start + self.each * n])
    }
}

/// Writes the index entries and the keygraphs of the two lists, and their sketches.
fn write_lists<'a>(parts: impl Parts<'a>, plan: &Plan, out: &mut [u8], copied: &mut Copied) {
    let layout = &plan.layout;
    let costs = Costs::write(parts.clone(), plan, out);
    let choice = |out: &[u8], o: &Packed<'_>, first: usize| {
        let n = own_keygraphs(&o.model, o.object).count();
        let of_object = (first..first + n).map(|i| costs.get(out, i));
        Choice::new(of_object, shares(&o.model, o.object, plan.counts.objects, plan.most))
    };
    let (mut places, mut n) = ([[0; CELLS]; 2], 0);
    for o in each_object(parts.clone()) {
        let mut choice = choice(out, &o, n);
        for (cell, _) in own_keygraphs(&o.model, o.object) {
            if let Some(list) = choice.list(costs.get(out, n)) {
                places[list][cell] += 1;
            }
            n += 1;
        }
    }
    let mut end = 0;
    for place in places.as_flattened_mut() {
        copied.subset(end, out, layout);
        end += core::mem::replace(place, end);
    }
    n = 0;
    for o in each_object(parts) {
        let mut choice = choice(out, &o, n);
        for (cell, i) in own_keygraphs(&o.model, o.object) {
            if let Some(list) = choice.list(costs.get(out, n)) {
                copied.keygraphs = places[list][cell];
                copied.keygraphs(&o.model, i..i + 1, o.shift, out, layout);
                places[list][cell] += 1;
            }
            n += 1;
        }
    }
    copied.keygraphs = end;
    let feature_bytes = plan.feature_bytes();
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
    pack_all(whole(models), usize::MAX, out)
}

/// Merges parts of models into one model at the start of `out`, as [`pack`] does with whole ones. Returns its
/// length, bytes. Objects stand in the order of the parts. The lists hold at most `most` keygraphs of each object:
/// with fewer a search for many objects takes less time, and finds a little less; with none it finds nothing.
///
/// # Errors
/// [`PackError`] when the parts cannot be packed into one model, or when `out` is too short.
pub fn pack_parts(parts: &[Part<'_>], most: usize, out: &mut [u8]) -> Result<usize, PackError> {
    pack_all(parts.iter().cloned(), most, out)
}

fn pack_all<'a>(parts: impl Parts<'a>, most: usize, out: &mut [u8]) -> Result<usize, PackError> {
    let plan = Plan::new(parts.clone(), most)?;
    let Plan { method, feature, tiers, counts, layout, .. } = &plan;
    let given = out.len();
    let out = out.get_mut(..layout.end).ok_or(PackError::NoRoom { needed: layout.end, given })?;

    // Totals of the parts copied so far: objects, views, keypoints, template bytes.
    let (mut objects, mut views, mut keypoints, mut templates) = (0, 0, 0, 0);
    for p in parts.clone() {
        let (from, l) = (p.model.bytes(), p.model.layout());
        let mut copy = |to: usize, section: usize, each: usize, range: &Range<usize>| {
            let source = &from[section + each * range.start..section + each * range.end];
            out[to..to + source.len()].copy_from_slice(source);
        };
        copy(layout.objects + OBJECT * objects, l.objects, OBJECT, &p.objects);
        copy(layout.views + VIEW * views, l.views, VIEW, &p.views);
        copy(layout.keypoints + KEYPOINT * keypoints, l.keypoints, KEYPOINT, &p.keypoints);
        copy(layout.templates + templates, l.templates, 1, &p.templates);
        if p.feature != *feature {
            for i in p.objects.clone() {
                let (start, chroma) = p.model.chroma_of_template(i);
                let start = layout.templates + templates + start - p.templates.start;
                out[start..][..chroma].fill(NO_CHROMA.cast_unsigned());
            }
        }
        for i in objects..objects + p.objects.len() {
            let r = &mut out[layout.objects + OBJECT * i..][..OBJECT];
            let at = object::TEMPLATE.size(r) - p.templates.start + templates;
            object::TEMPLATE.put_size(r, at);
        }
        for i in views..views + p.views.len() {
            let r = &mut out[layout.views + VIEW * i..][..VIEW];
            let of = view::OBJECT.get(r) - id(p.objects.start) + id(objects);
            let first = view::FIRST.size(r) - p.keypoints.start + keypoints;
            view::OBJECT.put(r, of);
            view::FIRST.put_size(r, first);
        }
        objects += p.objects.len();
        views += p.views.len();
        keypoints += p.keypoints.len();
        templates += p.templates.len();
    }

    let mut copied = Copied { keygraphs: 0, subsets: 0, feature_bytes: plan.feature_bytes() };
    if tiers.lists {
        write_lists(parts.clone(), &plan, out, &mut copied);
    }
    for o in each_object(parts) {
        for tier in tiers.of(o.object) {
            for cell in 0..CELLS {
                let start = copied.keygraphs;
                let has = o.model.has_second_tiers() || tier == Tier::First(o.object);
                copied.keygraphs(&o.model, if has { o.model.cell(tier, cell) } else { 0..0 }, o.shift, out, layout);
                copied.subset(start, out, layout);
            }
        }
    }
    copied.end_index(out, layout);
    write_header(out, *method, *feature, *tiers, counts);
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
    /// Appends the keygraphs `range` of `m`, whose views get the numbers that `shift` says.
    fn keygraphs(&mut self, m: &Model<'_>, range: Range<usize>, shift: Shift, out: &mut [u8], layout: &Layout) {
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
                // The shorter of the two has luma alone.
                let (luma, chroma) = out.split_at_mut(wide.min(each));
                luma.copy_from_slice(&source[..luma.len()]);
                chroma.fill(NO_CHROMA_BYTE);
            }
        }
        self.keygraphs += range.len();
        for i in at..self.keygraphs {
            let r = &mut out[layout.vertices + VERTICES * i..][..2];
            let view = vertices::VIEW.get(r) - id(shift.from) + id(shift.to);
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
