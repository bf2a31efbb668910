//! One picture to a model, in memory that the caller gives.
//!
//! In: a picture and the parameters. Out: the bytes of a model in the caller's
//! buffer. The picture is rendered at several sizes and under several tilts; the
//! corners of each view are ranked as in a frame; every triple of them that is a
//! keygraph is weighed by how likely a frame's triangulation is to contain it,
//! and the best are kept.
//!
//! A triple is Delaunay in a prefix of the ranking that holds its last vertex
//! when no other corner of the prefix lies in its circumcircle. Of the corners in
//! there, those ranked before the last vertex would have to be missed for it to
//! appear, those ranked soon after may be cut off: the cost is two for each of
//! the first and one for each of the second, and cheap triples are kept first. A
//! cap on each subset of the partition and one in total drop the dear ones, and
//! count them.
//!
//! Nothing is held in between: the triples are enumerated twice, first to count
//! them by subset and cost, then to put each record at its place.
//!
//! Memory: two pyramids, the corners' rows and candidates, and some 40 KB of tables
//! ([`Trainer`]: 1.3 MB for vga). Cost: under a
//! second on a desktop for the largest preset.

use heapless::Vec;

use crate::base::capacity::{LEVELS, StageStats, TEMPLATE_SIDE, chroma_bytes, luma_bytes, pixels_of};
use crate::base::geometry::{Homography, Point};
use crate::base::math;
use crate::extract::corners::{Corner, SCRATCH_ROWS, detect_corners};
use crate::extract::feature::{FeatureKind, extract, signature};
use crate::extract::keygraph::{CELLS, COSTS, Keygraph, MAX_COST, cost};
use crate::extract::rank::{rank_by_radius, rank_by_strength};
use crate::image::frame::{Frame, FrameError};
use crate::image::pyramid::{Pyramid, PyramidView, halve_chroma, halve_luma, plane_bytes, reduce_all};
use crate::model::method::{Method, Parameters, Ranking};
use crate::model::pack::{is_one_of, key_bytes, put_u16, put_u32, sort_cell, write_header};
use crate::model::parse::{
    KEY, KEYPOINT, Layout, MAX_PICTURE_SIDE, NAME_BYTES, OBJECT, Tiers, VERTICES, VIEW, template_bytes,
};

/// Views that one model can be made from.
pub const MAX_VIEWS: usize = 64;
/// Keypoints of a view: they are numbered by a byte.
pub const MAX_VIEW_KEYPOINTS: usize = 255;
/// Shortest side of a view, px.
const MIN_VIEW_SIDE: usize = 24;

/// One view that a picture is rendered in.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ViewSpec {
    /// Longer side of the picture in the view, px; never above the picture's own.
    pub side_px: f32,
    /// Width that remains across the tilt axis: the cosine of the tilt, 1 from
    /// the front.
    pub squeeze: f32,
    /// Direction that is squeezed, degrees.
    pub direction_deg: f32,
    /// Most keypoints taken from it.
    pub keypoints: u8,
}

/// How a model is made.
#[derive(Clone, Copy, Debug)]
pub struct TrainParams<'a> {
    /// Name of the object; cut to [`NAME_BYTES`] bytes.
    pub name: &'a str,
    /// How frames will be searched.
    pub method: Method,
    /// What features are made of.
    pub feature: FeatureKind,
    /// The views; at most [`MAX_VIEWS`].
    pub views: &'a [ViewSpec],
    /// Most keygraphs in total.
    pub max_keygraphs: usize,
    /// Most keygraphs in a subset of the partition.
    pub max_per_cell: usize,
}

/// Why a picture was not trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TrainError {
    /// The picture was refused.
    Picture(FrameError),
    /// The buffer cannot hold even an empty model: give `needed` bytes and more.
    NoRoom {
        /// Bytes needed before the first keygraph.
        needed: usize,
        /// Bytes given.
        given: usize,
    },
    /// Too few corners to make a keygraph: take a picture with more texture, or
    /// in better light.
    NothingToHold {
        /// Keypoints found over all views.
        keypoints: usize,
    },
    /// A side is too short to hold corners in any view: take a larger picture, or
    /// one of a larger part of the object.
    TooNarrow {
        /// Width as trained on, px.
        width: usize,
        /// Height as trained on, px.
        height: usize,
    },
    /// More views than [`MAX_VIEWS`], none, or one whose side is not above 0, whose
    /// squeeze is not from 0.01 to 1, or whose direction is not finite.
    Views,
    /// A side of the original is not from 1 to 1,048,576 px: pass its true size.
    Original {
        /// Width given, px.
        width: u32,
        /// Height given, px.
        height: u32,
    },
}

impl core::fmt::Display for TrainError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Picture(e) => e.fmt(f),
            Self::NoRoom { needed, given } => {
                write!(f, "{given} bytes cannot hold the model: {needed} are needed before the first keygraph")
            }
            Self::NothingToHold { keypoints } => write!(
                f,
                "the picture has too little to hold on to ({keypoints} corners): use one with more texture, sharper or brighter"
            ),
            Self::TooNarrow { width, height } => write!(
                f,
                "{width}x{height} px (as trained on) is too small or too narrow: each side needs {MIN_VIEW_SIDE} px and better 100; use a larger picture or a less elongated part of the object"
            ),
            Self::Views => write!(
                f,
                "a model is made from 1 to {MAX_VIEWS} views, each with a side above 0 px, a squeeze from 0.01 to 1 and a finite direction"
            ),
            Self::Original { width, height } => {
                write!(
                    f,
                    "the original is said to have {width}x{height} px: each side must have 1 to {MAX_PICTURE_SIDE}"
                )
            }
        }
    }
}

impl core::error::Error for TrainError {}

impl From<FrameError> for TrainError {
    fn from(e: FrameError) -> Self {
        Self::Picture(e)
    }
}

/// What training did.
#[derive(Clone, Debug, Default)]
pub struct Trained {
    /// Bytes of the model, at the start of the buffer.
    pub bytes: usize,
    /// Keypoints of each view.
    pub view_keypoints: Vec<u16, MAX_VIEWS>,
    /// Triples of keypoints, over all views.
    pub triples: u32,
    /// Keygraphs: seen are the triples that are thick, scalene and likely enough;
    /// dropped those that a cap left out.
    pub keygraphs: StageStats,
}

/// Memory that training works in.
#[derive(Debug)]
pub struct Trainer<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize> {
    picture: Pyramid<LUMA, CHROMA>,
    view: Pyramid<LUMA, CHROMA>,
    scratch: [[f32; SIDE]; SCRATCH_ROWS],
    corners: Vec<Corner, CORNERS>,
    table: Table,
    /// The views that are rendered: too many for a board's stack.
    plans: Vec<Plan, MAX_VIEWS>,
}

/// The trainer that goes with the vga profile: pictures of up to 307,200 px.
pub type VgaTrainer = Trainer<{ luma_bytes(640 * 480) }, { chroma_bytes(640 * 480) }, 640, 1600>;

/// The trainer that goes with the qqvga profile.
pub type QqvgaTrainer = Trainer<{ luma_bytes(160 * 120) }, { chroma_bytes(160 * 120) }, 160, 320>;

/// One view as it is rendered.
#[derive(Clone, Copy, Debug)]
struct Plan {
    width: usize,
    height: usize,
    /// View px to px of the loaded picture.
    to_loaded: Homography,
    scale: f32,
    keypoints: usize,
}

impl<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize>
    Trainer<LUMA, CHROMA, SIDE, CORNERS>
{
    /// An idle trainer, all zero.
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

    /// Trains on `picture`, a scaled copy of an original of `original` px (width,
    /// height), into `out`. Poses will be told in px of the original.
    ///
    /// # Errors
    /// [`TrainError`], with what to do about it.
    pub fn train(
        &mut self,
        picture: &Frame<'_>,
        original: (u32, u32),
        params: &TrainParams<'_>,
        out: &mut [u8],
    ) -> Result<Trained, TrainError> {
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
        let rules = params.method.parameters();
        self.plan(params)?;
        let views = self.plans.len();
        let mut trained = Trained::default();

        self.table.clear();
        for i in 0..views {
            let p = self.plans[i];
            self.prepare(&p, rules);
            let n = self.corners.len();
            // Bounded by the number of views that `plan` lets through.
            let _ = trained.view_keypoints.push(u16::try_from(n).unwrap_or(0));
            trained.triples += triples(n);
            let Self { corners, table, .. } = self;
            each_keygraph(corners, rules, |k, cost| table.count(k.key.cell(), cost));
        }
        let keypoints = trained.view_keypoints.iter().map(|&n| usize::from(n)).sum();
        trained.keygraphs.seen = self.table.total();
        if trained.keygraphs.seen == 0 {
            return Err(TrainError::NothingToHold { keypoints });
        }

        let (tw, th) = template_size(picture.width(), picture.height());
        let counts = |keygraphs| [1, views, keypoints, keygraphs, template_bytes(tw, th), 0];
        let sampling = params.method.sampling();
        let feature_bytes = sampling.bytes(params.feature);
        let no_room = |needed| TrainError::NoRoom { needed, given: out.len() };
        let most = |tiers| {
            let fixed = Layout::new(counts(0), tiers, feature_bytes).ok_or(no_room(usize::MAX))?.end;
            let room = out.len().checked_sub(fixed).ok_or(no_room(fixed))? / (KEY + VERTICES + feature_bytes);
            Ok::<_, TrainError>(params.max_keygraphs.min(room).min(self.table.total() as usize))
        };
        let mut tiers = Tiers { lists: false, second: false };
        // A second tier pays only where it is the larger one.
        tiers.second = most(tiers)? / 2 > rules.first_tier;
        let first = if tiers.second { rules.first_tier } else { usize::MAX };
        let most = most(tiers)?;
        let kept = self.table.allot(most, params.max_per_cell, first);
        let layout = Layout::new(counts(kept), tiers, feature_bytes).ok_or(no_room(usize::MAX))?;
        let out = &mut out[..layout.end];
        trained.keygraphs.kept = u32::try_from(kept).unwrap_or(u32::MAX);
        trained.keygraphs.dropped = trained.keygraphs.seen - trained.keygraphs.kept;
        trained.bytes = out.len();

        let mut first = 0;
        for i in 0..views {
            let p = self.plans[i];
            self.prepare(&p, rules);
            let Self { corners, table, view, .. } = self;
            for (k, c) in corners.iter().enumerate() {
                let r = &mut out[layout.keypoints + KEYPOINT * (first + k)..][..KEYPOINT];
                r[..2].copy_from_slice(&c.point.x.to_le_bytes());
                r[2..].copy_from_slice(&c.point.y.to_le_bytes());
            }
            write_view(out, &layout, i, &p, self.picture.view(), original, first, corners.len());
            first += corners.len();
            let view = view.view();
            each_keygraph(corners, rules, |k, cost| {
                let Some(at) = table.place(k.key.cell(), cost) else { return };
                let points = k.vertices.map(|v| corners[usize::from(v)].point);
                let feature = extract(&view, 0, points, k.size, params.feature, sampling);
                write_keygraph(out, &layout, at, i, k, &feature[..feature_bytes]);
            });
        }
        self.table.write(&mut out[layout.cells..layout.keys]);
        for slot in 0..2 * CELLS {
            sort_cell(out, &layout, feature_bytes, self.table.range(slot));
        }
        self.write_object(out, &layout, params.name, original, (tw, th), trained.triples, keypoints);
        write_header(out, params.method, params.feature, tiers, counts(kept));
        Ok(trained)
    }

    /// The views worth rendering: none larger than the picture, none twice.
    #[inline(never)]
    fn plan(&mut self, params: &TrainParams<'_>) -> Result<(), TrainError> {
        let Self { picture, plans, .. } = self;
        let loaded = picture.view();
        let (w, h) = (loaded.width() as f32, loaded.height() as f32);
        plans.clear();
        let valid = |v: &ViewSpec| v.side_px > 0.0 && (0.01..=1.0).contains(&v.squeeze) && v.direction_deg.is_finite();
        if params.views.is_empty() || params.views.len() > MAX_VIEWS || !params.views.iter().all(valid) {
            return Err(TrainError::Views);
        }
        for (i, v) in params.views.iter().enumerate() {
            let side = |v: &ViewSpec| v.side_px.min(w.max(h));
            let same =
                |o: &ViewSpec| side(o) == side(v) && o.squeeze == v.squeeze && o.direction_deg == v.direction_deg;
            if params.views[..i].iter().any(same) {
                continue;
            }
            let scale = side(v) / w.max(h);
            let (sin, cos) = math::sin_cos(v.direction_deg * (core::f32::consts::PI / 180.0));
            // R diag(squeeze, 1) R^-1, scaled
            let k = 1.0 - v.squeeze;
            let (a, b, d) = (scale * (1.0 - k * cos * cos), -scale * k * sin * cos, scale * (1.0 - k * sin * sin));
            let (vw, vh) = (a * w + b.abs() * h, b.abs() * w + d * h);
            let size = |v: f32| usize::try_from(math::round(v)).unwrap_or(0).min(SIDE);
            let (width, height) = (size(vw), size(vh));
            let middle = |v: f32| (v - 1.0) / 2.0;
            let to_view = Homography::affine([
                a,
                b,
                middle(width as f32) - a * middle(w) - b * middle(h),
                b,
                d,
                middle(height as f32) - b * middle(w) - d * middle(h),
            ]);
            let Some(to_loaded) = to_view.inverse() else { continue };
            if width.min(height) >= MIN_VIEW_SIDE && Pyramid::<LUMA, CHROMA>::fits(width, height) {
                // It fits: no more views than specifications.
                let _ = plans.push(Plan {
                    width,
                    height,
                    to_loaded,
                    scale: scale * math::sqrt(v.squeeze),
                    keypoints: usize::from(v.keypoints),
                });
            }
        }
        let (width, height) = (loaded.width(), loaded.height());
        if plans.is_empty() { Err(TrainError::TooNarrow { width, height }) } else { Ok(()) }
    }

    /// Renders a view and ranks its corners.
    #[inline(never)]
    fn prepare(&mut self, plan: &Plan, rules: &Parameters) {
        let picture = self.picture.view();
        let mut view = self.view.planes_mut();
        let Some((luma, a, b)) = view.level0(plan.width, plan.height) else { return };
        render(&picture, &plan.to_loaded, plan.scale, plan.width, luma, [a, b]);
        view.reduce();
        let luma = view.into_view().luma(0);
        let scratch = self.scratch.as_flattened_mut();
        let mut stats = detect_corners(luma, &rules.corners, scratch, &mut self.corners);
        let margin = 2.0 / plan.scale;
        let (w, h) = (picture.width() as f32 - 1.0 - margin, picture.height() as f32 - 1.0 - margin);
        self.corners.retain(|c| {
            let [x, y] = plan.to_loaded.apply(c.point.px());
            x >= margin && y >= margin && x <= w && y <= h
        });
        let limit = plan.keypoints.min(MAX_VIEW_KEYPOINTS);
        match rules.ranking {
            Ranking::Radius => rank_by_radius(&mut self.corners, limit, scratch, &mut stats),
            Ranking::Strength(apart) => rank_by_strength(&mut self.corners, apart, limit, &mut stats),
        }
    }

    #[allow(clippy::too_many_arguments, reason = "one record, written once")]
    #[inline(never)]
    fn write_object(
        &self,
        out: &mut [u8],
        layout: &Layout,
        name: &str,
        original: (u32, u32),
        (tw, th): (usize, usize),
        triples: u32,
        keypoints: usize,
    ) {
        let picture = self.picture.view();
        let r = &mut out[layout.objects..][..OBJECT];
        r.fill(0);
        let mut end = name.len().min(NAME_BYTES);
        while !name.is_char_boundary(end) {
            end -= 1;
        }
        r[..end].copy_from_slice(&name.as_bytes()[..end]);
        put_u32(r, 32, original.0 as usize);
        put_u32(r, 36, original.1 as usize);
        put_u32(r, 40, 0);
        put_u16(r, 44, tw);
        put_u16(r, 46, th);
        put_u32(r, 48, triples as usize);
        put_u32(r, 52, keypoints);

        let (sx, sy) = (picture.width() as f32 / tw as f32, picture.height() as f32 / th as f32);
        let to_loaded = Homography::affine([sx, 0.0, (sx - 1.0) / 2.0, 0.0, sy, (sy - 1.0) / 2.0]);
        let (luma, chroma) = out[layout.templates..layout.end].split_at_mut(plane_bytes(tw, th));
        render_luma(&picture, &to_loaded, 1.0 / sx, tw, &mut luma[..tw * th]);
        reduce_all(luma, tw, th, halve_luma);
        let (a, b) = chroma.split_at_mut(chroma.len() / 2);
        let mut i = 0;
        render_chroma(&picture, &to_loaded, 1.0 / sx, tw / 2, th / 2, |v| {
            [a[i], b[i]] = v.map(i8::cast_unsigned);
            i += 1;
        });
        for plane in [a, b] {
            reduce_all(plane, tw / 2, th / 2, halve_chroma);
        }
    }
}

impl<const LUMA: usize, const CHROMA: usize, const SIDE: usize, const CORNERS: usize> Default
    for Trainer<LUMA, CHROMA, SIDE, CORNERS>
{
    fn default() -> Self {
        Self::new()
    }
}

/// Triples of `n` points.
fn triples(n: usize) -> u32 {
    u32::try_from(n * n.saturating_sub(1) * n.saturating_sub(2) / 6).unwrap_or(u32::MAX)
}

/// Size of the template of a picture: at most [`TEMPLATE_SIDE`], at least 8.
fn template_size(w: usize, h: usize) -> (usize, usize) {
    let longer = w.max(h);
    let side = |v: usize| (v * TEMPLATE_SIDE / longer).clamp(8, TEMPLATE_SIDE);
    (side(w), side(h))
}

/// The pyramid level to sample for a view of this scale.
fn level_for(scale: f32) -> usize {
    let l = math::floor(math::log2(1.0 / scale) + 0.35);
    usize::try_from(l).unwrap_or(0).min(LEVELS - 1)
}

/// Renders the picture under an affine map (target px to picture px).
fn render(
    picture: &PyramidView<'_>,
    to: &Homography,
    scale: f32,
    width: usize,
    luma: &mut [u8],
    chroma: [&mut [i8]; 2],
) {
    let height = luma.len() / width;
    render_luma(picture, to, scale, width, luma);
    let [a, b] = chroma;
    let mut i = 0;
    render_chroma(picture, to, scale, width / 2, height / 2, |v| {
        [a[i], b[i]] = v;
        i += 1;
    });
}

/// Pixels that are rendered together.
const STRIP: usize = 32;

fn render_luma(picture: &PyramidView<'_>, to: &Homography, scale: f32, width: usize, luma: &mut [u8]) {
    let level = level_for(scale);
    let plane = picture.luma(level);
    let s = 1.0 / f32::from(1u8 << level);
    for (y, row) in luma.chunks_exact_mut(width).enumerate() {
        for (i, out) in row.chunks_mut(STRIP).enumerate() {
            let [mut us, mut vs] = [[0.0; STRIP]; 2];
            for (x, (u, v)) in us.iter_mut().zip(&mut vs).enumerate() {
                [*u, *v] = to.apply([(STRIP * i + x) as f32, y as f32]).map(|v| (v + 0.5) * s - 0.5);
            }
            plane.sample_clamped(&mut us, &mut vs);
            for (o, v) in out.iter_mut().zip(us) {
                *o = u8::try_from(math::round(v).clamp(0, 255)).unwrap_or(0);
            }
        }
    }
}

/// Calls `put` with the chroma of each pixel of a half-size plane, row by row.
fn render_chroma(
    picture: &PyramidView<'_>,
    to: &Homography,
    scale: f32,
    width: usize,
    height: usize,
    mut put: impl FnMut([i8; 2]),
) {
    let level = level_for(scale);
    let planes = picture.chroma(level);
    let s = 0.5 / f32::from(1u8 << level);
    for y in 0..height {
        for x in 0..width {
            let [u, v] = to.apply([2.0 * x as f32 + 0.5, 2.0 * y as f32 + 0.5]);
            let (u, v) = (math::floor((u + 0.5) * s), math::floor((v + 0.5) * s));
            put(planes.map(|p| p.nearest(u, v)));
        }
    }
}

/// Calls `found` with every keygraph on the corners that is likely enough, and its
/// cost. Vertices are indices of corners.
#[inline(never)]
fn each_keygraph(corners: &[Corner], rules: &Parameters, mut found: impl FnMut(&Keygraph, u32)) {
    let mut points = [Point::default(); MAX_VIEW_KEYPOINTS];
    let n = corners.len().min(points.len());
    for (p, c) in points.iter_mut().zip(corners) {
        *p = c.point;
    }
    let points = &points[..n];
    let id = |i: usize| u16::try_from(i).unwrap_or(0);
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

/// How many keygraphs of each cost a subset has, and how many are kept.
#[derive(Debug)]
struct Table {
    counts: [[u16; COSTS]; CELLS],
    /// Where each subset of the first tier, then each of the second, starts in the model.
    starts: [u32; 2 * CELLS + 1],
    /// How many of each have been placed.
    placed: [u32; 2 * CELLS],
    /// How many of the cost that is kept in part have come by, and of those that are kept
    /// of the cost that is in part of the first tier.
    partial: [[u16; 2]; CELLS],
}

/// What a number of places holds: all costs below one, and some of that one.
#[derive(Debug)]
struct Cut {
    below: usize,
    /// Places left for the cost `below`.
    left: usize,
    /// How many there are of it.
    next: usize,
}

/// Whether the next of `of` things is one of the `n` evenly spread ones. Only where some
/// but not all are, they are counted.
fn is_next_of(n: usize, of: usize, seen: &mut u16) -> bool {
    if n == 0 || n == of {
        return n > 0;
    }
    let t = usize::from(*seen);
    *seen = seen.saturating_add(1);
    is_one_of(n, of, t)
}

impl Table {
    const fn new() -> Self {
        Self {
            counts: [[0; COSTS]; CELLS],
            starts: [0; 2 * CELLS + 1],
            placed: [0; 2 * CELLS],
            partial: [[0; 2]; CELLS],
        }
    }

    fn clear(&mut self) {
        self.counts.as_flattened_mut().fill(0);
        self.placed.fill(0);
        self.partial.as_flattened_mut().fill(0);
    }

    fn count(&mut self, cell: usize, cost: u32) {
        let c = &mut self.counts[cell][cost as usize];
        *c = c.saturating_add(1);
    }

    fn total(&self) -> u32 {
        self.counts.iter().flatten().map(|&n| u32::from(n)).sum()
    }

    /// How many of `cell` cost less than `below`, at most `cap`.
    fn cheaper(&self, cell: usize, below: usize, cap: usize) -> usize {
        self.counts[cell][..below].iter().map(|&n| usize::from(n)).sum::<usize>().min(cap)
    }

    /// Which costs fill `total` places with no more than `cap` in a subset.
    fn cut(&self, total: usize, cap: usize) -> Cut {
        let all = |below| (0..CELLS).map(|c| self.cheaper(c, below, cap)).sum::<usize>();
        let mut below = 0;
        while below < COSTS && all(below + 1) <= total {
            below += 1;
        }
        let taken = all(below);
        let next = if below < COSTS { all(below + 1) - taken } else { 0 };
        Cut { below, left: total - taken, next }
    }

    /// How many of a subset a cut keeps: of the cost that it keeps in part every subset
    /// gets the same fraction.
    fn kept(&self, cell: usize, cut: &Cut, cap: usize) -> usize {
        let sure = self.cheaper(cell, cut.below, cap);
        let more = if cut.below < COSTS { self.cheaper(cell, cut.below + 1, cap) - sure } else { 0 };
        sure + (more * cut.left).checked_div(cut.next).unwrap_or(0)
    }

    /// Shares `total` places among the subsets, cheap keygraphs first and no more
    /// than `cap` in a subset, and says how many are taken. The cheapest, some `first`,
    /// are the first tier.
    fn allot(&mut self, total: usize, cap: usize, first: usize) -> usize {
        let cut = self.cut(total, cap);
        let kept = (0..CELLS).map(|c| self.kept(c, &cut, cap)).sum::<usize>();
        let first_cut = self.cut(first.min(total), cap);
        let mut start = 0;
        for slot in 0..2 * CELLS {
            let (tier, cell) = (slot / CELLS, slot % CELLS);
            let first = self.kept(cell, &first_cut, cap);
            let n = if tier == 0 { first } else { self.kept(cell, &cut, cap) - first };
            self.starts[slot] = start;
            start += u32::try_from(n).unwrap_or(0);
        }
        self.starts[2 * CELLS] = start;
        kept
    }

    /// Where a subset lies: of the first tier, or [`CELLS`] on, of the second.
    fn range(&self, slot: usize) -> core::ops::Range<usize> {
        self.starts[slot] as usize..self.starts[slot + 1] as usize
    }

    /// The place of the next keygraph of this subset and cost, if it is kept. Of
    /// the cost that is kept in part, evenly spread ones are; of the cost that is in
    /// part of the first tier likewise.
    fn place(&mut self, cell: usize, cost: u32) -> Option<usize> {
        let [first, second] = [self.range(cell).len(), self.range(CELLS + cell).len()];
        let counts = self.counts[cell];
        let sure = counts[..cost as usize].iter().map(|&n| usize::from(n)).sum();
        let kept = (first + second).saturating_sub(sure).min(counts[cost as usize].into());
        let [seen, seen_kept] = &mut self.partial[cell];
        if !is_next_of(kept, counts[cost as usize].into(), seen) {
            return None;
        }
        let in_first = is_next_of(first.saturating_sub(sure).min(kept), kept, seen_kept);
        let slot = if in_first { cell } else { CELLS + cell };
        let range = self.range(slot);
        let at = range.start + self.placed[slot] as usize;
        (at < range.end).then(|| {
            self.placed[slot] += 1;
            at
        })
    }

    fn write(&self, out: &mut [u8]) {
        for (o, s) in out.chunks_exact_mut(4).zip(&self.starts) {
            o.copy_from_slice(&s.to_le_bytes());
        }
    }
}

#[allow(clippy::too_many_arguments, reason = "one record, written once")]
#[inline(never)]
fn write_view(
    out: &mut [u8],
    layout: &Layout,
    i: usize,
    plan: &Plan,
    loaded: PyramidView<'_>,
    original: (u32, u32),
    first: usize,
    keypoints: usize,
) {
    let r = &mut out[layout.views + VIEW * i..][..VIEW];
    let (w, h) = (loaded.width() as f32, loaded.height() as f32);
    let (sx, sy) = (original.0 as f32 / w, original.1 as f32 / h);
    let to_original = Homography::affine([sx, 0.0, (sx - 1.0) / 2.0, 0.0, sy, (sy - 1.0) / 2.0]);
    let to_picture = to_original.after(&plan.to_loaded);
    put_u16(r, 0, 0);
    put_u16(r, 2, keypoints);
    put_u32(r, 4, first);
    let middle = [plan.width, plan.height].map(|v| (v as f32 - 1.0) / 2.0);
    let scale = plan.scale / math::sqrt(sx * sy);
    let floats = to_picture.0[..6].iter().chain(&middle).chain(core::iter::once(&scale));
    for (o, v) in r[8..].chunks_exact_mut(4).zip(floats) {
        o.copy_from_slice(&v.to_le_bytes());
    }
}

fn write_keygraph(out: &mut [u8], layout: &Layout, at: usize, view: usize, k: &Keygraph, feature: &[u8]) {
    let parts = layout.parts(feature.len());
    for ((plane, _), v) in parts.into_iter().zip(key_bytes(k.size, k.key, signature(feature))) {
        out[plane + at] = v;
    }
    let r = &mut out[layout.vertices + VERTICES * at..][..VERTICES];
    put_u16(r, 0, view);
    for (o, v) in r[2..].iter_mut().zip(k.vertices) {
        *o = v.to_le_bytes()[0];
    }
    out[layout.features + feature.len() * at..][..feature.len()].copy_from_slice(feature);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_go_to_the_cheap_and_every_place_is_filled() {
        let mut t = std::boxed::Box::new(Table::new());
        let fed: std::vec::Vec<(usize, u32)> = [(0, 0, 10), (0, 1, 10), (1, 0, 4), (1, 1, 20)]
            .iter()
            .flat_map(|&(c, k, n)| std::vec![(c, k); n])
            .collect();
        fed.iter().for_each(|&(c, k)| t.count(c, k));
        assert_eq!((t.total(), t.allot(20, 12, 20)), (44, 19));
        assert_eq!((t.range(0), t.range(1), t.range(2)), (0..11, 11..19, 19..19));
        let mut taken = std::vec![0; 19];
        let mut kept = [[0; 2]; 2];
        for &(c, k) in &fed {
            if let Some(at) = t.place(c, k) {
                taken[at] += 1;
                kept[c][k as usize] += 1;
            }
        }
        assert!(taken.iter().all(|&n| n == 1), "{taken:?}");
        assert_eq!(kept, [[10, 1], [4, 4]], "all cheap ones, some of the next");
    }

    #[test]
    fn keygraphs_too_dear_to_keep_take_no_places() {
        let mut t = std::boxed::Box::new(Table::new());
        // As views are walked: dear keygraphs come between those kept in part.
        let fed: std::vec::Vec<u32> = [0, 2, 2, 1, 2, 1, 0, 2, 1, 1, 2, 2].into();
        fed.iter().for_each(|&cost| t.count(0, cost));
        assert_eq!(t.allot(4, 12, 4), 4);
        let kept: std::vec::Vec<u32> = fed.into_iter().filter(|&cost| t.place(0, cost).is_some()).collect();
        assert_eq!(kept, [0, 1, 0, 1], "both of cost 0, every other of cost 1, none of cost 2");
    }

    #[test]
    fn templates_keep_the_shape_of_the_picture() {
        assert_eq!(template_size(640, 480), (96, 72));
        assert_eq!(template_size(100, 500), (19, 96));
        assert_eq!(template_size(640, 16), (96, 8));
    }
}
