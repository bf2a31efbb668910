//! Facts about a trained picture that need no rendered frames.
//!
//! In: a model. Out: a [`Structure`]: how many keypoints and keygraphs the object has, how
//! they are spread, and the contrast and repetition of its template. Memory: some copies
//! of the template. Cost: a pass over the keygraphs, and some 20 ms for the repetition.

use keygraph_core::{FeatureKind, Model, Template};

/// Facts about an object that need no rendered frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Structure {
    /// Number of keypoints in all views.
    pub keypoints: usize,
    /// Number of keygraphs.
    pub keygraphs: usize,
    /// Share of the picture that has keypoints, counted in 8 x 8 fields, 0 to 1.
    pub spread: f32,
    /// Standard deviation of the luma, of 255.
    pub contrast: f32,
    /// How much the picture repeats itself: the maximum correlation of its detail with the
    /// same detail, shifted by an eighth of the longer side or more, -1 to 1.
    pub repetition: f32,
    /// Width and height of the picture, px.
    pub size: (u32, u32),
    /// Whether the features hold luma alone, no chroma.
    pub luma_only: bool,
}

/// Fields along each side of the grid in which keypoints are counted.
const FIELDS: usize = 8;

/// The facts about object `index` of `model`.
#[must_use]
pub fn structure(model: &Model<'_>, index: usize) -> Structure {
    let object = model.object(index);
    let mine = |v: usize| usize::from(model.view(v).object) == index;
    let views: Vec<_> = (0..model.views()).filter(|&v| mine(v)).map(|v| model.view(v)).collect();
    let mut fields = [[false; FIELDS]; FIELDS];
    for view in &views {
        for k in 0..usize::from(view.keypoints) {
            let [x, y] = view.to_picture.apply(model.keypoint(view.first as usize + k).px());
            fields[field(y, object.height)][field(x, object.width)] = true;
        }
    }
    let luma = luma(&object.template);
    let mean = luma.iter().map(|&v| f32::from(v)).sum::<f32>() / luma.len() as f32;
    let square = luma.iter().map(|&v| (f32::from(v) - mean) * (f32::from(v) - mean)).sum::<f32>() / luma.len() as f32;
    Structure {
        keypoints: object.keypoints as usize,
        keygraphs: (0..model.keygraphs()).filter(|&k| mine(model.keygraph(k).0)).count(),
        spread: fields.as_flattened().iter().filter(|&&f| f).count() as f32 / (FIELDS * FIELDS) as f32,
        contrast: square.sqrt(),
        repetition: repetition(&object.template),
        size: (object.width, object.height),
        luma_only: model.feature() == FeatureKind::Luma,
    }
}

/// The luma of the template at its full size, in rows.
fn luma(template: &Template<'_>) -> Vec<u8> {
    let plane = template.luma(0);
    (0..plane.height()).flat_map(|y| plane.row(y)).copied().collect()
}

/// The field in which coordinate `v` of a side of `side` px lies.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the fields")]
fn field(v: f32, side: u32) -> usize {
    (v / side as f32 * FIELDS as f32).clamp(0.0, FIELDS as f32 - 1.0) as usize
}

/// The maximum correlation of the template's detail with itself, shifted by an eighth of
/// the longer side or more. The overlap is at least half of each side.
#[allow(clippy::cast_possible_wrap, reason = "sides of a template")]
fn repetition(template: &Template<'_>) -> f32 {
    let (w, h) = (template.width, template.height);
    let detail = detail(template);
    let least = w.max(h).div_ceil(8);
    let mut most: f32 = 0.0;
    for dy in 0..=h / 2 {
        for dx in -(w as isize / 2)..=w as isize / 2 {
            if dx * dx + ((dy * dy) as isize) < (least * least) as isize {
                continue;
            }
            let (ax, bx) = (dx.max(0).unsigned_abs(), (-dx).max(0).unsigned_abs());
            let n = w - dx.unsigned_abs();
            let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
            for y in 0..h - dy {
                let (a, b) = (&detail[(y + dy) * w + ax..][..n], &detail[y * w + bx..][..n]);
                for (&a, &b) in a.iter().zip(b) {
                    ab += a * b;
                    aa += a * a;
                    bb += b * b;
                }
            }
            if aa > 0.0 && bb > 0.0 {
                most = most.max(ab / (aa * bb).sqrt());
            }
        }
    }
    most
}

/// The template's luma less its mean over 9 x 9 pixels. Wider shapes are removed, since
/// these correlate with themselves in every picture.
fn detail(template: &Template<'_>) -> Vec<f32> {
    let (w, h, luma) = (template.width, template.height, luma(template));
    let around = |i: usize, n: usize| i.saturating_sub(4)..(i + 5).min(n);
    let value = |x: usize, y: usize| {
        let (xs, ys) = (around(x, w), around(y, h));
        let count = (xs.len() * ys.len()) as f32;
        let sum: u32 = ys.map(|y| luma[y * w..][xs.clone()].iter().map(|&v| u32::from(v)).sum::<u32>()).sum();
        f32::from(luma[y * w + x]) - sum as f32 / count
    };
    (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect()
}
