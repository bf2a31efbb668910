//! The object cut out of a frame: the part within an outline, seen from the front.
//!
//! In: a frame, and the outline that somebody drew around the object, or a detection. Out: the picture of
//! the object from the front. The frame is sampled bilinearly. Each side of the picture is the mean of two
//! opposite sides of the outline.
//!
//! Memory: the picture. Cost: some 20 ns a pixel.

use anyhow::{Result, bail, ensure};
use keygraph_core::stages::geometry::{area, is_convex};
use keygraph_core::{Detection, Homography, Surface};

use crate::canvas::Canvas;
use crate::picture::{Picture, Pixels};

/// Minimum side of an outline, px. Smaller objects have too little detail to train on.
const MIN_SIDE_PX: f32 = 32.0;
/// Maximum number of px of a rectified picture.
const MOST_PX: f32 = 16e6;

/// The corners of an object in frame px, from its top left clockwise.
pub type Outline = [[f32; 2]; 4];

/// Parses an outline: eight numbers with commas between them.
///
/// # Errors
/// When `text` is not eight numbers.
pub fn parse_outline(text: &str) -> Result<Outline> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[a, b, c, d, e, f, g, h]) => Ok([[a, b], [c, d], [e, f], [g, h]]),
        _ => bail!("an outline is eight numbers: x and y of four corners, the object's top left first, then clockwise"),
    }
}

/// Cuts out the part of `frame` within `outline`, seen from the front.
///
/// # Errors
/// When the outline is too small, crosses itself, is not convex, or leaves the frame.
pub fn cut_out(frame: &Picture, outline: &Outline) -> Result<Picture> {
    let (w, h) = (frame.width as f32, frame.height as f32);
    let inside = |p: &[f32; 2]| (-0.5..=w).contains(&p[0]) && (-0.5..=h).contains(&p[1]);
    ensure!(outline.iter().all(inside), "the outline leaves the picture: move its corners inside");
    ensure!(
        area(outline) > 0.0 && is_convex(outline),
        "the outline crosses itself or is dented: the corners go clockwise from the object's top left"
    );
    let side = |a: usize, b: usize| (outline[b][0] - outline[a][0]).hypot(outline[b][1] - outline[a][1]);
    let size = [(side(0, 1) + side(3, 2)) / 2.0, (side(0, 3) + side(1, 2)) / 2.0];
    ensure!(
        size[0] >= MIN_SIDE_PX && size[1] >= MIN_SIDE_PX,
        "the outline is too small ({:.0}x{:.0} px): hold the object closer to the camera, or take a larger picture",
        size[0],
        size[1]
    );
    let onto_frame = Homography::onto(outline, size);
    let size_px = (frame.width as usize, frame.height as usize);
    Ok(gather(frame, size.map(to_px), |rgb, p| sample(rgb, size_px, onto_frame.apply(p))))
}

/// The object of a detection in `frame` as it looks flat: its picture of `size` px as the frame shows it, on a
/// plane or on a surface, enlarged where the frame shows more of it, to at most `MOST_PX` px. What lies outside of
/// the frame is white.
#[must_use]
pub fn rectify(frame: &Picture, d: &Detection, surface: Option<&Surface>, size: (u32, u32)) -> Picture {
    let [w, h] = [size.0, size.1].map(|v| v.max(1) as f32);
    let (shown, most) = ((area(&d.corners).abs() / (w * h)).sqrt(), (MOST_PX / (w * h)).sqrt());
    let scale = if shown.is_finite() { shown.max(1.0).min(most) } else { 1.0 };
    let (fw, fh) = (frame.width as usize, frame.height as usize);
    gather(frame, [w, h].map(|v| to_px(v * scale).max(1)), |rgb, p| {
        let p = p.map(|v| v / scale);
        let [x, y] = surface.map_or_else(|| d.homography.apply(p), |s| s.at([p[0] / w, p[1] / h]));
        let is_inside = (-0.5..fw as f32).contains(&x) && (-0.5..fh as f32).contains(&y);
        if is_inside { sample(rgb, (fw, fh), [x, y]) } else { [255; 3] }
    })
}

/// A picture of `width` x `height` px whose colours `at` takes from the pixels of `frame`.
fn gather(frame: &Picture, [width, height]: [usize; 2], at: impl Fn(&[u8], [f32; 2]) -> [u8; 3]) -> Picture {
    let converted;
    let rgb = match &frame.pixels {
        Pixels::Rgb8(rgb) => rgb.as_slice(),
        _ => {
            converted = Canvas::from_picture(frame);
            converted.rgb()
        }
    };
    let mut cut = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            cut.extend(at(rgb, [x as f32, y as f32]));
        }
    }
    let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
    Picture { width: side(width), height: side(height), pixels: Pixels::Rgb8(cut) }
}

/// A coordinate rounded down to whole px; 0 when it is negative.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against the frame's size")]
fn to_px(v: f32) -> usize {
    v.max(0.0) as usize
}

/// The colour at a point of a picture of `w` x `h` px. Outside of it, the colour of its border.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a mean of bytes")]
pub(crate) fn sample(rgb: &[u8], (w, h): (usize, usize), [x, y]: [f32; 2]) -> [u8; 3] {
    let (x, y) = (x.clamp(0.0, (w - 1) as f32), y.clamp(0.0, (h - 1) as f32));
    let (left, top) = (to_px(x), to_px(y));
    let (right, bottom) = ((left + 1).min(w - 1), (top + 1).min(h - 1));
    let (u, v) = (x - left as f32, y - top as f32);
    let at = |x: usize, y: usize, c: usize| f32::from(rgb[(y * w + x) * 3 + c]);
    [0, 1, 2].map(|c| {
        let above = at(left, top, c) * (1.0 - u) + at(right, top, c) * u;
        let below = at(left, bottom, c) * (1.0 - u) + at(right, bottom, c) * u;
        (above * (1.0 - v) + below * v + 0.5) as u8
    })
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, clippy::panic, reason = "of small numbers; in tests")]
mod tests {
    use super::*;

    /// A frame whose red is x and whose green is y.
    fn ramps() -> Picture {
        let rgb = (0..200 * 200).flat_map(|i: u32| [(i % 200) as u8, (i / 200) as u8, 0]).collect();
        Picture { width: 200, height: 200, pixels: Pixels::Rgb8(rgb) }
    }

    #[test]
    fn a_turned_outline_is_turned_back() {
        // The object's top left is at the frame's top right: turned by 90 degrees.
        let cut = cut_out(&ramps(), &[[140.0, 20.0], [140.0, 120.0], [60.0, 120.0], [60.0, 20.0]]).expect("cuts");
        assert_eq!((cut.width, cut.height), (100, 80));
        let Pixels::Rgb8(rgb) = cut.pixels else { panic!("not RGB") };
        assert_eq!(rgb[..3], [140, 20, 0]);
        let at = (50 * 100 + 30) * 3;
        assert_eq!(rgb[at..at + 3], [90, 50, 0], "30 px along the object's width is 30 px down the frame");
    }

    #[test]
    fn an_outline_is_eight_numbers() {
        let outline = parse_outline("1,2, 3.5,4,5,6,-7,8").expect("eight");
        assert_eq!(outline, [[1.0, 2.0], [3.5, 4.0], [5.0, 6.0], [-7.0, 8.0]]);
        for text in ["", "1,2,3,4,5,6,7", "1,2,3,4,5,6,7,8,9", "1,2,3,4,5,6,7,x"] {
            assert!(parse_outline(text).is_err(), "{text:?}");
        }
    }

    #[test]
    fn outlines_that_cannot_be_are_refused() {
        let refused = |outline: Outline, word: &str| {
            let error = cut_out(&ramps(), &outline).expect_err("refused").to_string();
            assert!(error.contains(word), "{word:?} is not in: {error}");
        };
        refused([[10.0, 10.0], [100.0, 100.0], [100.0, 10.0], [10.0, 100.0]], "crosses itself");
        refused([[10.0, 10.0], [10.0, 100.0], [100.0, 100.0], [100.0, 10.0]], "clockwise");
        refused([[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]], "closer to the camera");
        refused([[10.0, 10.0], [300.0, 10.0], [300.0, 100.0], [10.0, 100.0]], "leaves the picture");
        refused([[f32::NAN, 10.0], [100.0, 10.0], [100.0, 100.0], [10.0, 100.0]], "leaves the picture");
    }
}
