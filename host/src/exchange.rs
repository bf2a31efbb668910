//! Look-alikes of a picture: its parts exchanged, its layout kept.
//!
//! In: a picture. Out: a picture of the same size in which some of its square parts show what
//! another part shows. So do the codes, forms and packages of one kind look: the same border, the
//! same print, the same colours, and other content. Memory: a copy of the picture. Cost: a pass
//! over it.

use crate::canvas::Canvas;
use crate::picture::{Picture, Pixels};
use crate::random::Random;

/// Number of parts along the longer side.
const PARTS: u32 = 8;

/// Exchanges a `share` of the parts of a picture, 0 to 1, among each other.
#[must_use]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of some parts")]
pub fn exchange(picture: &Picture, share: f32, random: &mut Random) -> Picture {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let side = picture.width.max(picture.height).div_ceil(PARTS).max(1) as usize;
    let (columns, rows) = ((w / side).max(1), (h / side).max(1));
    let mut parts: Vec<usize> = (0..columns * rows).collect();
    for i in (1..parts.len()).rev() {
        parts.swap(i, (random.unit() * (i + 1) as f32) as usize);
    }
    parts.truncate((share * parts.len() as f32 + 0.5) as usize);
    let source = Canvas::from_picture(picture);
    let mut rgb = source.rgb().to_vec();
    // A single part has nothing to be exchanged with.
    for (i, &to) in parts.iter().enumerate().filter(|_| parts.len() > 1) {
        let from = parts[(i + 1) % parts.len()];
        let corner = |part: usize| (part % columns * side, part / columns * side);
        let ((fx, fy), (tx, ty)) = (corner(from), corner(to));
        let (n, lines) = (side.min(w - fx.max(tx)), side.min(h - fy.max(ty)));
        for y in 0..lines {
            let at = |x: usize, top: usize| 3 * ((top + y) * w + x);
            rgb[at(tx, ty)..][..3 * n].copy_from_slice(&source.rgb()[at(fx, fy)..][..3 * n]);
        }
    }
    Picture { width: picture.width, height: picture.height, pixels: Pixels::Rgb8(rgb) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_that_is_asked_for_differs_and_the_pixels_stay() {
        let row = |y: u8| (0..160).flat_map(move |x| [x, y, x.wrapping_mul(y)]);
        let rgb: Vec<u8> = (0..120).flat_map(row).collect();
        let picture = Picture { width: 160, height: 120, pixels: Pixels::Rgb8(rgb.clone()) };
        for share in [0.0, 0.25, 0.5, 1.0] {
            let other = Canvas::from_picture(&exchange(&picture, share, &mut Random::of(&[1]))).rgb().to_vec();
            let differ = rgb.chunks(3).zip(other.chunks(3)).filter(|(a, b)| a != b).count() as f32 / (160.0 * 120.0);
            assert!((differ - share).abs() < 0.03, "{differ} of {share}");
            let sorted = |mut v: Vec<u8>| {
                v.sort_unstable();
                v
            };
            assert!(sorted(other) == sorted(rgb.clone()), "parts are exchanged, none is lost");
        }
    }
}
