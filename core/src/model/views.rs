//! Renders the views that a picture is trained in: several sizes, and several tilts.
//!
//! In: a picture, and the views that are asked for. Out: the views worth rendering, and their
//! pixels. Memory: 64 bytes for each view. Cost: one bilinear sample for each pixel of luma.

use heapless::VecView;

use crate::base::capacity::LEVELS;
use crate::base::geometry::Homography;
use crate::base::math;
use crate::image::pyramid::PyramidView;

/// Maximum number of views that one model can be made from.
pub const MAX_VIEWS: usize = 64;
/// Minimum side of a view, px.
pub(crate) const MIN_VIEW_SIDE: usize = 24;

/// A view to render a picture in.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ViewSpec {
    /// Longer side of the picture in the view, px. A value above the picture's own longer side
    /// counts as that side.
    pub side_px: f32,
    /// Factor by which the tilt narrows the picture, 0.01 to 1: the cosine of the tilt angle. 1 is
    /// the view from the front.
    pub squeeze: f32,
    /// Direction in which the picture is narrowed, degrees.
    pub direction_deg: f32,
    /// Maximum number of keypoints taken from the view.
    pub keypoints: u8,
}

/// A view with its size and maps, ready to render.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewPlan {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Map from view px to px of the loaded picture.
    pub(crate) to_loaded: Homography,
    /// Scale of the view: view px per px of the loaded picture.
    pub(crate) scale: f32,
    /// Maximum number of keypoints taken from the view.
    pub(crate) keypoints: usize,
}

impl ViewSpec {
    fn is_valid(&self) -> bool {
        self.side_px > 0.0 && (0.01..=1.0).contains(&self.squeeze) && self.direction_deg.is_finite()
    }
}

/// Whether the number of views and the values of each are valid.
pub(crate) fn are_valid(specs: &[ViewSpec]) -> bool {
    !specs.is_empty() && specs.len() <= MAX_VIEWS && specs.iter().all(ViewSpec::is_valid)
}

/// Writes to `plans` the views worth rendering. A view is never larger than the picture, which has
/// `width` x `height` px. A view that equals an earlier one is left out, and so is a view that does
/// not fit. `fits` is asked with the width and height of a view, each at most `side`.
#[inline(never)]
pub(crate) fn plan_views(
    specs: &[ViewSpec],
    (width, height): (usize, usize),
    side: usize,
    fits: impl Fn(usize, usize) -> bool,
    plans: &mut VecView<ViewPlan>,
) {
    let (w, h) = (width as f32, height as f32);
    let side_of = |v: &ViewSpec| v.side_px.min(w.max(h));
    plans.clear();
    for (i, v) in specs.iter().enumerate() {
        let is_same =
            |o: &ViewSpec| side_of(o) == side_of(v) && o.squeeze == v.squeeze && o.direction_deg == v.direction_deg;
        if specs[..i].iter().any(is_same) {
            continue;
        }
        let scale = side_of(v) / w.max(h);
        let (sin, cos) = math::sin_cos(v.direction_deg * (core::f32::consts::PI / 180.0));
        // The matrix is R diag(squeeze, 1) R^-1, times the scale.
        let k = 1.0 - v.squeeze;
        let (a, b, d) = (scale * (1.0 - k * cos * cos), -scale * k * sin * cos, scale * (1.0 - k * sin * sin));
        let size = |v: f32| usize::try_from(math::round(v)).unwrap_or(0).min(side);
        let (width, height) = (size(a * w + b.abs() * h), size(b.abs() * w + d * h));
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
        if width.min(height) >= MIN_VIEW_SIDE && fits(width, height) {
            let (scale, keypoints) = (scale * math::sqrt(v.squeeze), usize::from(v.keypoints));
            // This push cannot fail: `plans` has room for as many plans as specifications.
            let _ = plans.push(ViewPlan { width, height, to_loaded, scale, keypoints });
        }
    }
}

/// Pyramid level of the picture to sample for a view of this scale.
fn level_for(scale: f32) -> usize {
    let l = math::floor(math::log2(1.0 / scale) + 0.35);
    usize::try_from(l).unwrap_or(0).min(LEVELS - 1)
}

/// Renders luma and chroma of the picture under the affine map `to` (target px to picture px).
pub(crate) fn render(
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
    render_chroma(picture, to, scale, (width / 2, height / 2), |v| {
        [a[i], b[i]] = v;
        i += 1;
    });
}

/// Number of pixels that are rendered together.
const STRIP: usize = 32;

pub(crate) fn render_luma(picture: &PyramidView<'_>, to: &Homography, scale: f32, width: usize, luma: &mut [u8]) {
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
pub(crate) fn render_chroma(
    picture: &PyramidView<'_>,
    to: &Homography,
    scale: f32,
    (width, height): (usize, usize),
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
