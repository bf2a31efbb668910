//! Trains a model from one picture, in memory that the caller provides.
//!
//! In: a picture and the training parameters. Out: the bytes of a model in the caller's buffer. The
//! picture is rendered at several sizes and under several tilts. The corners of each view are
//! ranked as in a frame. Every triple of corners that is a keygraph gets a cost, which says how
//! unlikely a frame's triangulation is to contain it. The cheapest keygraphs are kept.
//!
//! The cost of a triple follows from the nested triangulation of a frame. A triple is a Delaunay
//! triangle of a prefix of the ranking when the prefix holds the triple's last vertex and no other
//! corner of the prefix lies in its circumcircle. A corner in the circumcircle that is ranked
//! before the last vertex rules the triple out unless the frame misses that corner: it adds two to
//! the cost. A corner that is ranked soon after the last vertex may be cut off by the end of the
//! prefix: it adds one. A maximum for each subset of the partition and a maximum for the model drop
//! the most expensive keygraphs and count them.
//!
//! The keygraphs are enumerated twice, and none is stored in between. The first pass counts them by
//! subset and cost. The second pass writes each record to its place.
//!
//! Memory: two pyramids, the rows and candidates of the corners, and about 40 KB of tables
//! ([`Trainer`]: 1.3 MB for vga). Cost: under a second on a desktop for the largest preset.

use heapless::Vec;

use crate::base::capacity::{StageStats, TEMPLATE_SIDE, chroma_bytes, count, id, luma_bytes, pixels_of};
use crate::base::geometry::{Homography, Point};
use crate::base::math;
use crate::base::pace::Steady;
use crate::base::says::says;
use crate::extract::corners::{Corner, SCRATCH_ROWS, detect_corners};
use crate::extract::feature::{FeatureKind, extract, signature};
use crate::extract::keygraph::{CELLS, Keygraph, MAX_COST, cost};
use crate::extract::rank::rank;
use crate::image::frame::{Frame, FrameError};
use crate::image::halve::{halve_chroma, halve_luma};
use crate::image::pyramid::{Pyramid, PyramidView, plane_bytes, reduce_all};
use crate::model::format::{
    Counts, KEY, KEYPOINT, Layout, MAX_PICTURE_SIDE, NAME_BYTES, OBJECT, Tiers, VERTICES, VIEW, key_bytes, keypoint,
    object, sort_cell, template_bytes, vertices, view, write_header,
};
use crate::model::method::{Method, Parameters};
use crate::model::table::Table;
use crate::model::views::{
    MAX_VIEWS, MIN_VIEW_SIDE, ViewPlan, ViewSpec, are_valid, plan_views, render, render_chroma, render_luma,
};

/// Maximum number of keypoints in a view: an index of a keypoint is one byte.
pub const MAX_VIEW_KEYPOINTS: usize = 255;

/// Parameters of training.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct TrainParams<'a> {
    /// Name of the object; cut to at most [`NAME_BYTES`] bytes.
    pub name: &'a str,
    /// Method by which frames will be searched.
    pub method: Method,
    /// Channels that the features are made of.
    pub feature: FeatureKind,
    /// Views that are rendered, 1 to [`MAX_VIEWS`].
    pub views: &'a [ViewSpec],
    /// Maximum number of keygraphs in the model.
    pub max_keygraphs: usize,
    /// Maximum number of keygraphs in each subset of the partition.
    pub max_per_cell: usize,
}

impl<'a> TrainParams<'a> {
    /// Parameters without maxima: every keygraph that fits the buffer is kept.
    #[must_use]
    pub const fn new(name: &'a str, method: Method, feature: FeatureKind, views: &'a [ViewSpec]) -> Self {
        Self { name, method, feature, views, max_keygraphs: usize::MAX, max_per_cell: usize::MAX }
    }

    /// Returns these parameters with at most `max_keygraphs` keygraphs in the model, and at most
    /// `max_per_cell` in each subset of the partition.
    #[must_use]
    pub const fn capped(self, max_keygraphs: usize, max_per_cell: usize) -> Self {
        Self { max_keygraphs, max_per_cell, ..self }
    }
}

/// The reason why a picture could not be trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrainError {
    /// The picture was refused as a frame.
    Picture(FrameError),
    /// The buffer cannot hold even an empty model: provide more than `needed` bytes.
    NoRoom {
        /// Bytes that the model takes before its first keygraph.
        needed: usize,
        /// Length of the buffer, bytes.
        given: usize,
    },
    /// There are too few corners for a keygraph: take a picture with more texture, or in better
    /// light.
    NothingToHold {
        /// Number of keypoints found, over all views.
        keypoints: usize,
    },
    /// A side of the picture is too short to hold corners in any view: take a larger picture, or a
    /// picture of a larger part of the object.
    TooNarrow {
        /// Width of the picture that was trained on, px.
        width: usize,
        /// Height of the picture that was trained on, px.
        height: usize,
    },
    /// The views are not valid: there are none or more than [`MAX_VIEWS`], or one has a side not
    /// above 0, a squeeze not from 0.01 to 1, or a direction that is not finite.
    Views,
    /// A side of the original picture is not from 1 to 1,048,576 px: pass its true size.
    Original {
        /// Width of the original as given, px.
        width: u32,
        /// Height of the original as given, px.
        height: u32,
    },
}

says!(TrainError {
    Self::Picture(e) => ("{}", e),
    Self::NoRoom { needed, given } => (
        "{} bytes cannot hold the model: {} are needed before the first keygraph",
        given,
        needed
    ),
    Self::NothingToHold { keypoints } => (
        "the picture has too little to hold on to ({} corners): use one with more texture, sharper or brighter",
        keypoints
    ),
    Self::TooNarrow { width, height } => (
        "{}x{} px (as trained on) is too small or too narrow: each side needs {} px and better 100; use a larger picture or a less elongated part of the object",
        width,
        height,
        MIN_VIEW_SIDE
    ),
    Self::Views => (
        "a model is made from 1 to {} views, each with a side above 0 px, a squeeze from 0.01 to 1 and a finite direction",
        MAX_VIEWS
    ),
    Self::Original { width, height } => (
        "the original is said to have {}x{} px: each side must have 1 to {}",
        width,
        height,
        MAX_PICTURE_SIDE
    ),
});

impl From<FrameError> for TrainError {
    fn from(e: FrameError) -> Self {
        Self::Picture(e)
    }
}

/// Result of a training.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Trained {
    /// Length of the model at the start of the buffer, bytes.
    pub bytes: usize,
    /// Number of keypoints in each view.
    pub view_keypoints: Vec<u16, MAX_VIEWS>,
    /// Number of possible triples of keypoints, over all views.
    pub triples: u32,
    /// Counts of keygraphs. `seen` are the thick, scalene triples with a low enough cost. `kept`
    /// are in the model. `dropped` exceeded a maximum or the buffer.
    pub keygraphs: StageStats,
}

impl Trained {
    /// Number of keypoints, over all views.
    #[must_use]
    pub fn keypoints(&self) -> usize {
        self.view_keypoints.iter().map(|&n| usize::from(n)).sum()
    }
}

/// Trains models, and owns the memory for it.
#[derive(Debug)]
pub struct Trainer<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize> {
    picture: Pyramid<LUMA, CHROMA>,
    view: Pyramid<LUMA, CHROMA>,
    scratch: [[f32; SIDE]; SCRATCH_ROWS],
    corners: Vec<Corner, CORNERS>,
    table: Table,
    /// Views that are rendered. They are too large for a board's stack.
    plans: Vec<ViewPlan, MAX_VIEWS>,
}

/// Trainer for the vga profile: pictures of up to 307,200 px, with sides of up to 640 px.
pub type VgaTrainer = Trainer<{ luma_bytes(640 * 480) }, { chroma_bytes(640 * 480) }, 640, 1600>;

/// Trainer for the qqvga profile: pictures of up to 19,200 px, with sides of up to 160 px.
pub type QqvgaTrainer = Trainer<{ luma_bytes(160 * 120) }, { chroma_bytes(160 * 120) }, 160, 320>;

impl<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize>
    Trainer<LUMA, CHROMA, SIDE, CORNERS>
{
    /// Creates an idle trainer; all its bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            picture: Pyramid::new(),
            view: Pyramid::new(),
            scratch: [[0.0; SIDE]; SCRATCH_ROWS],
            corners: Vec::new(),
            table: Table::new(),
            plans: Vec::new(),
        }
    }

    /// Trains on `picture` and writes the model to the start of `out`. `picture` is a scaled copy
    /// of an original picture of `original` px (width, height). Detections give poses in px of the
    /// original.
    ///
    /// # Errors
    /// [`TrainError`], which says what to do about it.
    pub fn train(
        &mut self,
        picture: &Frame<'_>,
        original: (u32, u32),
        params: &TrainParams<'_>,
        out: &mut [u8],
    ) -> Result<Trained, TrainError> {
        self.load(picture, original)?;
        let size = (picture.width(), picture.height());
        if !are_valid(params.views) {
            return Err(TrainError::Views);
        }
        plan_views(params.views, size, SIDE, Pyramid::<LUMA, CHROMA>::fits, &mut self.plans);
        if self.plans.is_empty() {
            return Err(TrainError::TooNarrow { width: size.0, height: size.1 });
        }
        let mut trained = Trained::default();
        self.count_keygraphs(params, &mut trained)?;

        let keypoints = trained.keypoints();
        let template = template_size(size.0, size.1);
        let counts = Counts {
            objects: 1,
            views: self.plans.len(),
            keypoints,
            templates: template_bytes(template.0, template.1),
            ..Counts::default()
        };
        let (tiers, counts) = self.table_of(&counts, params, out.len())?;
        let feature_bytes = params.method.sampling().bytes(params.feature);
        let no_room = TrainError::NoRoom { needed: usize::MAX, given: out.len() };
        let layout = Layout::new(&counts, tiers, feature_bytes).ok_or(no_room)?;
        let out = &mut out[..layout.end];
        trained.keygraphs.kept = count(counts.keygraphs);
        trained.keygraphs.dropped = trained.keygraphs.seen - trained.keygraphs.kept;
        trained.bytes = out.len();

        let mut sheet = Sheet { out, layout, feature_bytes };
        self.write_views(params, original, &mut sheet);
        self.table.write(&mut sheet.out[layout.index..layout.keys]);
        for slot in 0..2 * CELLS {
            sort_cell(sheet.out, &layout, feature_bytes, self.table.range(slot));
        }
        let picture = self.picture.view();
        sheet.write_object(params.name, original, template, (trained.triples, keypoints));
        sheet.write_template(&picture, template);
        write_header(sheet.out, params.method, params.feature, tiers, &counts);
        Ok(trained)
    }

    /// Loads the picture and makes its pyramid.
    fn load(&mut self, picture: &Frame<'_>, original: (u32, u32)) -> Result<(), TrainError> {
        let (w, h) = (picture.width(), picture.height());
        if w.max(h) > SIDE {
            let max_pixels = pixels_of(LUMA);
            return Err(FrameError::TooLarge { pixels: w * h, max_pixels, side: w.max(h), max_side: SIDE }.into());
        }
        if ![original.0, original.1].iter().all(|side| (1..=MAX_PICTURE_SIDE).contains(side)) {
            return Err(TrainError::Original { width: original.0, height: original.1 });
        }
        let mut pyramid = self.picture.planes_mut();
        pyramid.load(picture)?;
        pyramid.reduce();
        Ok(())
    }

    /// Enumerates the keygraphs of all views, and counts them by subset and cost.
    fn count_keygraphs(&mut self, params: &TrainParams<'_>, trained: &mut Trained) -> Result<(), TrainError> {
        let rules = params.method.parameters();
        self.table.clear();
        for i in 0..self.plans.len() {
            let plan = self.plans[i];
            self.prepare(&plan, rules);
            let n = self.corners.len();
            // This push cannot fail: `view_keypoints` has room for as many views as `plans`.
            let _ = trained.view_keypoints.push(id(n));
            trained.triples += triples(n);
            let Self { corners, table, .. } = self;
            each_keygraph(corners, rules, &mut |k, cost| table.count(k.key.cell(), cost));
        }
        trained.keygraphs.seen = self.table.total();
        match trained.keygraphs.seen {
            0 => Err(TrainError::NothingToHold { keypoints: trained.keypoints() }),
            _ => Ok(()),
        }
    }

    /// Distributes the places for keygraphs in a model of at most `room` bytes. Returns the tiers,
    /// and `counts` with the number of keygraphs that are kept.
    fn table_of(
        &mut self,
        counts: &Counts,
        params: &TrainParams<'_>,
        room: usize,
    ) -> Result<(Tiers, Counts), TrainError> {
        let first_tier = params.method.parameters().first_tier;
        let feature_bytes = params.method.sampling().bytes(params.feature);
        let no_room = |needed| TrainError::NoRoom { needed, given: room };
        let most = |tiers| {
            let fixed = Layout::new(counts, tiers, feature_bytes).ok_or(no_room(usize::MAX))?.end;
            let places = room.checked_sub(fixed).ok_or(no_room(fixed))? / (KEY + VERTICES + feature_bytes);
            Ok::<_, TrainError>(params.max_keygraphs.min(places).min(self.table.total() as usize))
        };
        let mut tiers = Tiers { lists: false, second: false };
        // A second tier pays only when it is larger than the first.
        tiers.second = most(tiers)? / 2 > first_tier;
        let first = if tiers.second { first_tier } else { usize::MAX };
        let most = most(tiers)?;
        let keygraphs = self.table.allot(most, params.max_per_cell, first);
        Ok((tiers, Counts { keygraphs, ..*counts }))
    }

    /// Enumerates the keygraphs of all views again. Writes the views, the keypoints, and the
    /// keygraphs that have a place.
    fn write_views(&mut self, params: &TrainParams<'_>, original: (u32, u32), sheet: &mut Sheet<'_>) {
        let (rules, sampling) = (params.method.parameters(), params.method.sampling());
        let (feature_bytes, loaded) = (sheet.feature_bytes, self.picture.view());
        let scale = [original.0 as f32 / loaded.width() as f32, original.1 as f32 / loaded.height() as f32];
        let to_original = Homography::scaling(scale);
        let mut first = 0;
        for i in 0..self.plans.len() {
            let plan = self.plans[i];
            self.prepare(&plan, rules);
            let Self { corners, table, view, .. } = self;
            sheet.write_keypoints(first, corners);
            sheet.write_view(i, &plan, &to_original, (first, corners.len()));
            first += corners.len();
            let view = view.view();
            each_keygraph(corners, rules, &mut |k, cost| {
                let Some(at) = table.place(k.key.cell(), cost) else { return };
                let points = k.vertices.map(|v| corners[usize::from(v)].point);
                let feature = extract(&view, 0, points, k.size, params.feature, sampling);
                sheet.write_keygraph(at, i, k, &feature[..feature_bytes]);
            });
        }
    }

    /// Renders a view and ranks its corners.
    #[inline(never)]
    fn prepare(&mut self, plan: &ViewPlan, rules: &Parameters) {
        let picture = self.picture.view();
        let mut view = self.view.planes_mut();
        let Some((luma, a, b)) = view.level0(plan.width, plan.height) else { return };
        render(&picture, &plan.to_loaded, plan.scale, plan.width, luma, [a, b]);
        view.reduce();
        let luma = view.into_view().luma(0);
        let scratch = self.scratch.as_flattened_mut();
        let mut stats = detect_corners(luma, &rules.corners, scratch, &mut self.corners, &mut Steady);
        let margin = 2.0 / plan.scale;
        let (w, h) = (picture.width() as f32 - 1.0 - margin, picture.height() as f32 - 1.0 - margin);
        self.corners.retain(|c| {
            let [x, y] = plan.to_loaded.apply(c.point.px());
            x >= margin && y >= margin && x <= w && y <= h
        });
        let limit = plan.keypoints.min(MAX_VIEW_KEYPOINTS);
        rank(rules.ranking, &mut self.corners, limit, scratch, &mut stats, &mut Steady);
    }
}

impl<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize> Default
    for Trainer<LUMA, CHROMA, SIDE, CORNERS>
{
    fn default() -> Self {
        Self::new()
    }
}

/// Number of triples of `n` points.
fn triples(n: usize) -> u32 {
    u32::try_from(n * n.saturating_sub(1) * n.saturating_sub(2) / 6).unwrap_or(u32::MAX)
}

/// Size of the template of a picture, px: each side is 8 to [`TEMPLATE_SIDE`].
fn template_size(w: usize, h: usize) -> (usize, usize) {
    let longer = w.max(h);
    let side = |v: usize| (v * TEMPLATE_SIDE / longer).clamp(8, TEMPLATE_SIDE);
    (side(w), side(h))
}

/// Calls `found` with every keygraph of the corners whose cost is at most [`MAX_COST`], and with
/// its cost. Vertices are indices of corners. One copy for both callers: boards have 112 KiB for training.
#[inline(never)]
fn each_keygraph(corners: &[Corner], rules: &Parameters, found: &mut dyn FnMut(&Keygraph, u32)) {
    let mut points = [Point::default(); MAX_VIEW_KEYPOINTS];
    let n = corners.len().min(points.len());
    for (p, c) in points.iter_mut().zip(corners) {
        *p = c.point;
    }
    let points = &points[..n];
    for k in 2..n {
        for j in 1..k {
            for i in 0..j {
                let cost = if rules.grow { cost(|l| points[l], n, [i, j, k]) } else { 0 };
                if cost > MAX_COST {
                    continue;
                }
                if let Some(kg) = Keygraph::new([i, j, k].map(|v| points[v]), [i, j, k].map(id), &rules.scalene) {
                    found(&kg, cost);
                }
            }
        }
    }
}

/// A model that is being written.
struct Sheet<'a> {
    out: &'a mut [u8],
    layout: Layout,
    feature_bytes: usize,
}

impl Sheet<'_> {
    /// Writes the record of the only object. `sums` are its triples and keypoints over all views.
    #[inline(never)]
    fn write_object(&mut self, name: &str, original: (u32, u32), template: (usize, usize), sums: (u32, usize)) {
        let r = &mut self.out[self.layout.objects..][..OBJECT];
        r.fill(0);
        let mut end = name.len().min(NAME_BYTES);
        while !name.is_char_boundary(end) {
            end -= 1;
        }
        r[..end].copy_from_slice(&name.as_bytes()[..end]);
        object::WIDTH.put(r, original.0);
        object::HEIGHT.put(r, original.1);
        object::TEMPLATE.put(r, 0);
        object::TEMPLATE_WIDTH.put(r, id(template.0));
        object::TEMPLATE_HEIGHT.put(r, id(template.1));
        object::TRIPLES.put(r, sums.0);
        object::KEYPOINTS.put_size(r, sums.1);
    }

    /// Writes the template: the picture at `width` x `height` px, and its pyramid levels.
    #[inline(never)]
    fn write_template(&mut self, picture: &PyramidView<'_>, (width, height): (usize, usize)) {
        let scale = [picture.width() as f32 / width as f32, picture.height() as f32 / height as f32];
        let to_loaded = Homography::scaling(scale);
        let bytes = &mut self.out[self.layout.templates..self.layout.end];
        let (luma, chroma) = bytes.split_at_mut(plane_bytes(width, height));
        render_luma(picture, &to_loaded, 1.0 / scale[0], width, &mut luma[..width * height]);
        reduce_all(luma, width, height, halve_luma, &mut Steady);
        let (a, b) = chroma.split_at_mut(chroma.len() / 2);
        let mut i = 0;
        render_chroma(picture, &to_loaded, 1.0 / scale[0], (width / 2, height / 2), |v| {
            [a[i], b[i]] = v.map(i8::cast_unsigned);
            i += 1;
        });
        for plane in [a, b] {
            reduce_all(plane, width / 2, height / 2, halve_chroma, &mut Steady);
        }
    }

    /// Writes the record of view `i`, which has `n` keypoints from index `first` on.
    #[inline(never)]
    fn write_view(&mut self, i: usize, plan: &ViewPlan, to_original: &Homography, (first, n): (usize, usize)) {
        let r = &mut self.out[self.layout.views + VIEW * i..][..VIEW];
        view::OBJECT.put(r, 0);
        view::KEYPOINTS.put(r, id(n));
        view::FIRST.put_size(r, first);
        let to_picture = to_original.after(&plan.to_loaded);
        view::TO_PICTURE.iter().zip(to_picture.0).for_each(|(number, v)| number.put(r, v));
        let middle = [plan.width, plan.height].map(|v| (v as f32 - 1.0) / 2.0);
        view::CENTRE.iter().zip(middle).for_each(|(number, v)| number.put(r, v));
        // The square root below is picture px per px of the loaded picture.
        let [sx, sy] = [to_original.0[0], to_original.0[4]];
        view::SCALE.put(r, plan.scale / math::sqrt(sx * sy));
    }

    /// Writes the keypoints of a view, from index `first` on.
    fn write_keypoints(&mut self, first: usize, corners: &[Corner]) {
        let records = self.out[self.layout.keypoints + KEYPOINT * first..].chunks_exact_mut(KEYPOINT);
        for (r, c) in records.zip(corners) {
            keypoint::X.put(r, c.point.x);
            keypoint::Y.put(r, c.point.y);
        }
    }

    /// Writes keygraph `at`: key, vertices and feature.
    fn write_keygraph(&mut self, at: usize, view: usize, k: &Keygraph, feature: &[u8]) {
        let Self { out, layout, feature_bytes } = self;
        let parts = layout.parts(*feature_bytes);
        for ((plane, _), v) in parts.into_iter().zip(key_bytes(k.size, k.key, signature(feature))) {
            out[plane + at] = v;
        }
        let r = &mut out[layout.vertices + VERTICES * at..][..VERTICES];
        vertices::VIEW.put(r, id(view));
        vertices::IDS.iter().zip(k.vertices).for_each(|(number, v)| number.put(r, v.to_le_bytes()[0]));
        out[layout.features + feature.len() * at..][..feature.len()].copy_from_slice(feature);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_keep_the_shape_of_the_picture() {
        assert_eq!(template_size(640, 480), (96, 72));
        assert_eq!(template_size(100, 500), (19, 96));
        assert_eq!(template_size(640, 16), (96, 8));
    }
}
