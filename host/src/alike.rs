//! Which objects look alike, before one is taken for the other.
//!
//! In: an object, and a model. Out: the objects of the model that are found in the picture of the
//! first, the share of each that agrees, and a picture of the shared parts. A model holds a small copy of
//! its picture; that copy, enlarged, is the frame that is searched.
//!
//! Memory: a picture of 288 px, and the detector. Cost: a thorough search of that picture.

use anyhow::Result;
use image::imageops::{FilterType, resize};
use image::{Rgb, RgbImage, imageops};
use keygraph_core::stages::frame::NO_CHROMA;
use keygraph_core::{Depth, Detection, Model, Object};

use crate::canvas::Canvas;
use crate::picture::{Picture, Pixels};
use crate::search::{Profile, Request, search_for};

/// How much the copies are enlarged. Smaller, they are found less often.
const ENLARGED: u32 = 3;
/// Minimum score at which one object counts as found in the picture of another.
const LIKELY: f32 = 0.5;
/// Number of parts along each side in the picture of shared parts.
const PARTS: usize = 12;
/// Minimum correlation of a part that is shared.
const AGREES: f32 = 0.5;
/// Brightness of the parts that are not shared.
const DARK: f32 = 0.2;

/// Two objects that look alike.
#[derive(Clone, Debug)]
pub struct Alike {
    /// Index of the object that was found, in its model.
    pub taken: usize,
    /// Share of the found object that agrees, 0 to 1.
    pub share: f32,
    /// Score of the detection.
    pub score: f32,
    /// Where it was found: in px of [`copy_of`] the shown object.
    detection: Detection,
}

/// The small copy of an object that its model holds, enlarged.
#[must_use]
#[allow(clippy::cast_possible_truncation, reason = "sides of a template")]
pub fn copy_of(object: &Object<'_>) -> Picture {
    let (luma, [a, b]) = (object.template.luma(0), object.template.chroma(0));
    let pixel = |x: u32, y: u32| {
        let (x, y) = (x as usize, y as usize);
        let (cx, cy) = ((x / 2).min(a.width().saturating_sub(1)), (y / 2).min(a.height().saturating_sub(1)));
        let chroma = [a, b].map(|plane| plane.row(cy)[cx].cast_signed());
        Rgb(colour(luma.row(y)[x], chroma))
    };
    let (w, h) = (object.template.width as u32, object.template.height as u32);
    let small = RgbImage::from_fn(w, h, pixel);
    let (width, height) = (ENLARGED * w, ENLARGED * h);
    let rgb = resize(&small, width, height, FilterType::CatmullRom).into_raw();
    Picture { width, height, pixels: Pixels::Rgb8(rgb) }
}

/// The colour that a camera has seen as this luma and this chroma: red against green and blue, and
/// green against blue, as parts of the largest of the three.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited to a byte")]
fn colour(luma: u8, [along, across]: [i8; 2]) -> [u8; 3] {
    if along == NO_CHROMA {
        return [luma; 3];
    }
    let (s, d) = (f32::from(along) / 63.5, f32::from(across) / (63.5 * 1.732_050_8));
    let parts = [0.0, (d - s) / 2.0, (-d - s) / 2.0];
    let most = parts.iter().fold(0.0f32, |a, &b| a.max(b));
    let [red, green, blue] = parts.map(|v| (v - most + 1.0).max(0.0));
    let scale = f32::from(luma) / (0.299 * red + 0.587 * green + 0.114 * blue).max(0.05);
    [red, green, blue].map(|v| (scale * v).min(255.0) as u8)
}

/// The objects of `model` that are found in the picture of `object`, most alike first.
///
/// # Errors
/// When the picture is too small to be searched.
pub fn alike(object: &Object<'_>, model: &Model<'_>) -> Result<Vec<Alike>> {
    let request = Request { all_names: true, depth: Depth::Thorough, ..Request::new(Profile::Vga, LIKELY) };
    let found = search_for(&copy_of(object), model, &request, 0)?;
    let mut alike: Vec<Alike> = Vec::new();
    for detection in found.detections {
        let taken = usize::from(detection.object);
        let share = detection.appearance.share();
        if !alike.iter().any(|a| a.taken == taken && a.share >= share) {
            alike.retain(|a| a.taken != taken);
            alike.push(Alike { taken, share, score: detection.score, detection });
        }
    }
    alike.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(alike)
}

impl Alike {
    /// Draws both pictures side by side, dark where they differ: that of the object that was
    /// searched, and that of the one that was found in it.
    #[must_use]
    pub fn draw(&self, shown: &Object<'_>, taken: &Object<'_>) -> Canvas {
        let (left, right) = (copy_of(shown), copy_of(taken));
        let canvases = [&left, &right].map(Canvas::from_picture);
        let parts = self.parts(&canvases, taken);
        let back = self.detection.homography.inverse();
        let size = [taken.width as f32, taken.height as f32];
        let to_taken = [size[0] / right.width as f32, size[1] / right.height as f32];
        let mut all = RgbImage::new(left.width + right.width + ENLARGED, left.height.max(right.height));
        for (canvas, from) in canvases.iter().zip([0, left.width + ENLARGED]) {
            let (w, rgb) = (canvas.width() as usize, canvas.rgb());
            let pixel = |x: u32, y: u32| {
                let i = 3 * (y as usize * w + x as usize);
                let p = [x as f32, y as f32];
                let p = match (from, &back) {
                    (0, Some(back)) => back.apply(p),
                    _ => [(p[0] + 0.5) * to_taken[0] - 0.5, (p[1] + 0.5) * to_taken[1] - 0.5],
                };
                let shared = part_at(p, size).is_some_and(|part| parts[part]);
                Rgb([0, 1, 2].map(|c| if shared { rgb[i + c] } else { dark(rgb[i + c]) }))
            };
            let picture = RgbImage::from_fn(canvas.width(), canvas.height(), pixel);
            imageops::replace(&mut all, &picture, from.into(), 0);
        }
        let (width, height) = all.dimensions();
        Canvas::from_picture(&Picture { width, height, pixels: Pixels::Rgb8(all.into_raw()) })
    }

    /// For each part of the taken object whether the shown one has it.
    fn parts(&self, [shown, taken]: &[Canvas; 2], object: &Object<'_>) -> Vec<bool> {
        let size = [object.width as f32, object.height as f32];
        let mut sums = vec![[0.0f32; 6]; PARTS * PARTS];
        let gray = |canvas: &Canvas, x: usize, y: usize| {
            let i = 3 * (y * canvas.width() as usize + x);
            canvas.rgb()[i..i + 3].iter().map(|&v| f32::from(v)).sum::<f32>() / 3.0
        };
        let (w, h) = (taken.width() as usize, taken.height() as usize);
        for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
            let p = [(x as f32 + 0.5) / w as f32 * size[0] - 0.5, (y as f32 + 0.5) / h as f32 * size[1] - 0.5];
            let [u, v] = self.detection.homography.apply(p).map(f32::round);
            let inside = (0.0..shown.width() as f32).contains(&u) && (0.0..shown.height() as f32).contains(&v);
            if let Some(part) = part_at(p, size).filter(|_| inside) {
                let (a, b) = (gray(taken, x, y), gray(shown, index(u), index(v)));
                for (sum, v) in sums[part].iter_mut().zip([1.0, a, b, a * a, b * b, a * b]) {
                    *sum += v;
                }
            }
        }
        let agrees = |s: &[f32; 6]| {
            let [n, a, b, aa, bb, ab] = *s;
            let (va, vb) = (aa - a * a / n, bb - b * b / n);
            n > 0.0 && (ab - a * b / n) > AGREES * (va * vb).max(f32::MIN_POSITIVE).sqrt()
        };
        sums.iter().map(agrees).collect()
    }
}

/// A coordinate as an index; it lies inside.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside a canvas")]
const fn index(v: f32) -> usize {
    v as usize
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "darker than a byte")]
fn dark(v: u8) -> u8 {
    (DARK * f32::from(v)) as u8
}

/// The part of an object of this size that a point lies in, px.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to lie inside")]
fn part_at([x, y]: [f32; 2], [w, h]: [f32; 2]) -> Option<usize> {
    let (u, v) = ((x + 0.5) / w, (y + 0.5) / h);
    let inside = (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v);
    inside.then(|| (v * PARTS as f32) as usize * PARTS + (u * PARTS as f32) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use keygraph_core::stages::pyramid::Pyramid;
    use keygraph_core::{Frame, PixelFormat};

    #[test]
    fn a_colour_that_is_rebuilt_has_the_luma_and_the_chroma_that_it_was_made_of() {
        for rgb in [[200, 30, 30], [20, 160, 60], [60, 90, 220], [120, 120, 120], [240, 220, 10]] {
            let seen = |rgb: [u8; 3]| {
                let pixels: Vec<u8> = rgb.repeat(16 * 16);
                let mut pyramid: Box<Pyramid<700, 200>> = Box::new(Pyramid::new());
                let frame = Frame::new(PixelFormat::Rgb8, 16, 16, &pixels).expect("a frame");
                pyramid.planes_mut().load(&frame).expect("it fits");
                let view = pyramid.view();
                (view.luma(0).row(8)[8], view.chroma(0).map(|p| p.row(4)[4]))
            };
            let (luma, chroma) = seen(rgb);
            let again = seen(colour(luma, chroma));
            let near = |a: i32, b: i32| (a - b).abs() <= 3;
            assert!(near(again.0.into(), luma.into()), "{rgb:?}");
            assert!((0..2).all(|i| near(again.1[i].into(), chroma[i].into())), "{rgb:?} {chroma:?} {:?}", again.1);
        }
    }
}
