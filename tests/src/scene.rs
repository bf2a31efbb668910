//! Frames that show a picture where a function says, and how far a surface is from there.
//!
//! In: a picture, and where each pixel of the frame lies in it, or each place of it in the frame. Out: a frame of 640 x
//! 480 px; the distance of a surface's grid.

use keygraph::picture::{Picture, Pixels};
use keygraph_core::Surface;
use keygraph_core::stages::surface::SIDE;

/// Size of the frames, px.
pub const FRAME: [u32; 2] = [640, 480];

/// The frame that shows a picture before a gray ground with noise. `place` is the place of the picture, px, that a pixel
/// of the frame shows, if it shows one.
///
/// # Panics
/// When the picture is not RGB.
#[must_use]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours and places in the picture")]
pub fn frame_of(picture: &Picture, place: impl Fn([f32; 2]) -> Option<[f32; 2]>) -> Picture {
    let Pixels::Rgb8(pixels) = &picture.pixels else { unreachable!("the picture is not RGB") };
    let (w, h) = (picture.width as f32, picture.height as f32);
    let mut rgb = Vec::with_capacity(FRAME[0] as usize * FRAME[1] as usize * 3);
    for i in 0..FRAME[0] * FRAME[1] {
        let noise = (i.wrapping_mul(2_654_435_761) >> 29) as f32;
        let place = place([(i % FRAME[0]) as f32, (i / FRAME[0]) as f32]);
        let inside = place.filter(|&[u, v]| u >= 0.0 && v >= 0.0 && u < w - 1.0 && v < h - 1.0);
        for channel in 0..3 {
            let seen = inside.map_or(90.0, |[u, v]| {
                let (j, k) = (u as usize, v as usize);
                let (p, q) = (u - j as f32, v - k as f32);
                let at = |x: usize, y: usize| f32::from(pixels[(y * w as usize + x) * 3 + channel]);
                let row = |k: usize| at(j, k) * (1.0 - p) + at(j + 1, k) * p;
                (row(k) * (1.0 - q) + row(k + 1) * q) * 0.85
            });
            rgb.push((seen + noise) as u8);
        }
    }
    Picture { width: FRAME[0], height: FRAME[1], pixels: Pixels::Rgb8(rgb) }
}

/// Mean distance of a surface's grid points from where they are, px. `place` is where a place of the picture is in the
/// frame, both px.
#[must_use]
pub fn grid_error(surface: &Surface, picture: &Picture, place: impl Fn([f32; 2]) -> [f32; 2]) -> f32 {
    let at = |i: usize, side: u32| i as f32 / (SIDE - 1) as f32 * side as f32;
    let off = |(i, p): (usize, &[f32; 2])| {
        let q = place([at(i % SIDE, picture.width), at(i / SIDE, picture.height)]);
        (p[0] - q[0]).hypot(p[1] - q[1])
    };
    surface.points.iter().enumerate().map(off).sum::<f32>() / surface.points.len() as f32
}
