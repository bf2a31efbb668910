//! Some objects of a model, to be packed without the others.
//!
//! In: a parsed model, and a range of its objects. Out: where the records of these objects lie, and what
//! they hold. In a model in colour, an object that was trained on luma alone is told by chroma bytes that are
//! [`NO_CHROMA_BYTE`]. A part of such objects is on luma alone, as their models were.
//!
//! Memory: the ranges. Cost: one pass over the model's views, and one over the vertices and the chroma of the
//! part's keygraphs.

use core::ops::Range;

use crate::base::capacity::id;
use crate::extract::feature::{FeatureKind, NO_CHROMA_BYTE};
use crate::extract::keygraph::CELLS;
use crate::model::format::{Tier, VERTICES, template_bytes, vertices};
use crate::model::parse::Model;

/// Some objects of a model, one after the other: what [`pack_parts`](crate::pack_parts) takes. Their records
/// lie in one piece in each section.
#[derive(Clone, Debug)]
pub struct Part<'a> {
    pub(crate) model: Model<'a>,
    pub(crate) objects: Range<usize>,
    pub(crate) views: Range<usize>,
    pub(crate) keypoints: Range<usize>,
    /// Their templates in the section of templates, bytes.
    pub(crate) templates: Range<usize>,
    /// Kind of their features, without chroma that says that there is none.
    pub(crate) feature: FeatureKind,
    /// Whether they have second tiers.
    pub(crate) second: bool,
}

impl<'a> From<Model<'a>> for Part<'a> {
    /// All objects of a model.
    fn from(model: Model<'a>) -> Self {
        let counts = model.counts();
        Self {
            objects: 0..counts.objects,
            views: 0..counts.views,
            keypoints: 0..counts.keypoints,
            templates: 0..counts.templates,
            feature: model.feature(),
            second: model.has_second_tiers(),
            model,
        }
    }
}

impl<'a> Part<'a> {
    /// Takes the objects `objects` of a model. `None` when there are no such objects, or when their records lie
    /// in several pieces, which neither training nor packing does.
    #[must_use]
    pub fn of(model: Model<'a>, objects: Range<usize>) -> Option<Self> {
        let all = Self::from(model);
        if objects == all.objects {
            return Some(all);
        }
        if objects.is_empty() || objects.end > all.objects.end {
            return None;
        }
        let is_own = |&view: &usize| objects.contains(&usize::from(model.view(view).object));
        let start = all.views.clone().find(is_own).unwrap_or(0);
        let views = start..start + all.views.filter(is_own).count();
        let keypoints = |view: usize| {
            let view = model.view(view);
            let first = view.first as usize;
            first..first + usize::from(view.keypoints)
        };
        let template = |object: usize| {
            let (start, width, height) = model.template_place(object);
            start..start + template_bytes(width, height)
        };
        let part = Self {
            keypoints: joined(views.clone().map(keypoints))?,
            templates: joined(objects.clone().map(template))?,
            feature: model.feature(),
            second: model.has_second_tiers() && objects.clone().any(|o| !model.tier(Tier::Second(id(o))).is_empty()),
            views,
            objects,
            model,
        };
        let is_whole = part.views.clone().all(|v| part.objects.contains(&usize::from(model.view(v).object)))
            && part.keygraphs().all(|i| part.views.contains(&view_of(&model, i)));
        let feature = if part.is_gray() { FeatureKind::Luma } else { part.feature };
        is_whole.then_some(Self { feature, ..part })
    }

    /// Iterates over the part's keygraphs, without the lists.
    fn keygraphs(&self) -> impl Iterator<Item = usize> {
        let model = &self.model;
        self.objects.clone().flat_map(move |object| own_keygraphs(model, id(object)).map(|(_, i)| i))
    }

    /// Whether the chroma of all keygraphs says that there is none.
    fn is_gray(&self) -> bool {
        let (model, each) = (&self.model, self.model.feature_bytes());
        let luma = model.method().sampling().bytes(FeatureKind::Luma);
        let has_none =
            |i: usize| model.features()[each * i + luma..each * (i + 1)].iter().all(|&b| b == NO_CHROMA_BYTE);
        self.feature == FeatureKind::Both && self.keygraphs().next().is_some() && self.keygraphs().all(has_none)
    }
}

/// One range of ranges of which each starts where the range before it ends.
fn joined(mut ranges: impl Iterator<Item = Range<usize>>) -> Option<Range<usize>> {
    let first = ranges.next().unwrap_or(0..0);
    ranges.try_fold(first, |all, next| (all.end == next.start).then_some(all.start..next.end))
}

/// Index of the view of a keygraph.
fn view_of(model: &Model<'_>, keygraph: usize) -> usize {
    let record = &model.bytes()[model.layout().vertices + VERTICES * keygraph..][..VERTICES];
    usize::from(vertices::VIEW.get(record))
}

/// Iterates over the keygraphs of an object, without the lists. An item is a subset and the index
/// of a keygraph in it.
pub(crate) fn own_keygraphs<'a>(m: &'a Model<'_>, object: u16) -> impl Iterator<Item = (usize, usize)> + 'a {
    m.tiers_of(object).flat_map(move |tier| (0..CELLS).flat_map(move |cell| m.cell(tier, cell).map(move |i| (cell, i))))
}
