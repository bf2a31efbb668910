//! Pictures of the stages of a search.
//!
//! In: the frame as it was searched, the picture of the object, and what the stages made. Out: canvases. Memory: one
//! canvas each. Cost: a few passes over its pixels.

use keygraph_core::{Detection, Homography};

use super::trace::{Level, Pair, Trace};
use crate::annotate::{Colour, PALETTE, draw_corners, draw_dots, draw_lines, draw_triangles};
use crate::canvas::Canvas;
use crate::cutout::sample;

/// Side of the squares in which two views of a keygraph are shown, px.
const PATCH: u32 = 320;
/// Side of the square in which the picture and what is seen are compared, px; and blocks in a row of it.
const FLAT: u32 = 320;
const BLOCKS: usize = 8;
/// Space between pictures side by side, px.
const GAP: u32 = 8;
/// Maximum number of lines between matches.
const MOST_LINES: usize = 40;
/// Correlation from which a block agrees.
const AGREES: f32 = 0.5;

const GREEN: Colour = PALETTE[0];
const RED: Colour = PALETTE[1];
const BLUE: Colour = PALETTE[2];
const YELLOW: Colour = PALETTE[3];

/// Corners: those of coarse levels in blue and large, those of the finest in green.
pub fn corners(frame: &Canvas, levels: &[Level]) -> Canvas {
    let mut canvas = frame.dimmed();
    for level in levels.iter().rev() {
        let colour = if level.level == 0 { GREEN } else { BLUE };
        draw_dots(&mut canvas, &level.corners, colour, 3 + 2 * u32::from(level.level));
    }
    canvas
}

/// The nested triangulations of one level.
pub fn triangles(frame: &Canvas, level: Option<&Level>) -> Canvas {
    let mut canvas = frame.dimmed();
    if let Some(level) = level {
        draw_triangles(&mut canvas, &level.triangles, YELLOW);
        draw_dots(&mut canvas, &level.corners, GREEN, 5);
    }
    canvas
}

/// A keygraph of the frame, and the one of the picture that it was matched to: both turned, scaled and tilted so
/// that their vertices lie at the same places. Its features are taken so.
pub fn keygraph(frame: &Canvas, picture: &Canvas, pair: &Pair) -> Canvas {
    let side = PATCH as f32;
    let shown = [[0.2, 0.75], [0.8, 0.75], [0.45, 0.2]].map(|p: [f32; 2]| p.map(|v| v * side));
    let patch = |from: &Canvas, triangle: [[f32; 2]; 3]| {
        let map = affine(&shown, &triangle);
        let mut patch = map.map_or_else(|| Canvas::plain(PATCH, PATCH), |map| warped(from, &map, [PATCH; 2]));
        draw_triangles(&mut patch, &[shown], YELLOW);
        patch
    };
    beside(&[patch(picture, pair.picture), patch(frame, pair.frame)])
}

/// The picture beside the frame, with lines between matches.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sizes of pictures")]
pub fn matches(frame: &Canvas, picture: &Canvas, pairs: &[Pair]) -> Canvas {
    let scale = (frame.height() as f32 / picture.height() as f32).min(1.0);
    let [width, height] = [picture.width(), picture.height()].map(|v| ((v as f32 * scale) as u32).max(1));
    let small = warped(picture, &Homography::scaling([1.0 / scale; 2]), [width, height]);
    let mut canvas = beside(&[small.dimmed(), frame.dimmed()]);
    let offset = (width + GAP) as f32;
    // Evenly over all, so that small triangles are shown too.
    for (i, pair) in pairs.iter().step_by(pairs.len().div_ceil(MOST_LINES).max(1)).enumerate() {
        let colour = PALETTE[i % PALETTE.len()];
        let from = pair.picture.map(|p| p.map(|v| v * scale));
        let to = pair.frame.map(|[x, y]| [x + offset, y]);
        draw_triangles(&mut canvas, &[from, to], colour);
        draw_lines(&mut canvas, &[[middle(&from), middle(&to)]], colour, 1);
    }
    canvas
}

/// Where the votes put the object's middle: a dot for each, a circle for each candidate.
pub fn votes(frame: &Canvas, trace: &Trace) -> Canvas {
    let mut canvas = frame.dimmed();
    let all: Vec<_> = trace.votes.iter().map(|v| v.pose.centre).collect();
    draw_dots(&mut canvas, &all, YELLOW, 3);
    let candidates: Vec<_> = trace.candidates.iter().map(|c| c.pose.centre).collect();
    draw_corners(&mut canvas, &candidates, RED);
    if let Some(best) = candidates.first() {
        draw_dots(&mut canvas, &[*best], RED, 9);
    }
    canvas
}

/// Outlines of all poses that were looked at in red, of those that are believed in green.
pub fn poses(frame: &Canvas, looked_at: &[Detection], believed: &[Detection]) -> Canvas {
    let mut canvas = frame.clone();
    for (poses, colour, width) in [(looked_at, RED, 1), (believed, GREEN, 3)] {
        for d in poses {
            let sides: Vec<_> = (0..4).map(|i| [d.corners[i], d.corners[(i + 1) % 4]]).collect();
            draw_lines(&mut canvas, &sides, colour, width);
        }
    }
    canvas
}

/// The picture, what the frame shows at a pose, and which blocks of the two agree (green) and do not (red).
/// Returns the share of the blocks with texture that agree, too.
pub fn look(frame: &Canvas, picture: &Canvas, homography: &Homography) -> (Canvas, f32) {
    let (w, h) = (picture.width() as f32, picture.height() as f32);
    let to_picture = Homography::scaling([w / FLAT as f32, h / FLAT as f32]);
    let expected = warped(picture, &to_picture, [FLAT; 2]);
    let seen = warped(frame, &homography.after(&to_picture), [FLAT; 2]);
    let mut verdict = seen.dimmed();
    let side = FLAT as usize / BLOCKS;
    let (mut agree, mut count) = (0_u32, 0_u32);
    for block in 0..BLOCKS * BLOCKS {
        let at = [block % BLOCKS * side, block / BLOCKS * side];
        let Some(correlation) = correlation(&expected, &seen, at, side) else { continue };
        count += 1;
        agree += u32::from(correlation >= AGREES);
        let [x, y] = at.map(|v| v as f32 + 2.0);
        let s = side as f32 - 5.0;
        let corners = [[x, y], [x + s, y], [x + s, y + s], [x, y + s]];
        let sides: Vec<_> = (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect();
        draw_lines(&mut verdict, &sides, if correlation >= AGREES { GREEN } else { RED }, 2);
    }
    (beside(&[expected, seen, verdict]), agree as f32 / count.max(1) as f32)
}

/// Correlation of the luma of a block of two canvases, -1 to 1; `None` where the first has no texture.
fn correlation(a: &Canvas, b: &Canvas, [x, y]: [usize; 2], side: usize) -> Option<f32> {
    let luma = |canvas: &Canvas| -> Vec<f32> {
        let row = canvas.width() as usize;
        let pixel = |i: usize| &canvas.rgb()[3 * ((y + i / side) * row + x + i % side)..][..3];
        let values: Vec<f32> = (0..side * side)
            .map(|i| {
                let p = pixel(i);
                0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2])
            })
            .collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        values.iter().map(|v| v - mean).collect()
    };
    let (a, b) = (luma(a), luma(b));
    let product = |p: &[f32], q: &[f32]| p.iter().zip(q).map(|(x, y)| x * y).sum::<f32>();
    let (aa, bb) = (product(&a, &a), product(&b, &b));
    // A standard deviation of 6 of 255.
    (aa > 36.0 * a.len() as f32).then(|| product(&a, &b) / (aa * bb.max(1.0)).sqrt())
}

/// The affine map that carries one triangle to another; `None` when the first has no area.
fn affine(from: &[[f32; 2]; 3], to: &[[f32; 2]; 3]) -> Option<Homography> {
    keygraph_core::stages::verify::affine_through(from, to)
}

/// A canvas of this size whose pixels are those of another one where `map` carries them, white outside of it.
fn warped(from: &Canvas, map: &Homography, [width, height]: [u32; 2]) -> Canvas {
    let mut to = Canvas::plain(width, height);
    let size = (from.width() as usize, from.height() as usize);
    for (i, pixel) in to.pixels_mut().iter_mut().enumerate() {
        let [x, y] = map.apply([(i % width as usize) as f32, (i / width as usize) as f32]);
        if (0.0..size.0 as f32).contains(&x) && (0.0..size.1 as f32).contains(&y) {
            *pixel = sample(from.rgb(), size, [x, y]);
        }
    }
    to
}

fn middle(triangle: &[[f32; 2]; 3]) -> [f32; 2] {
    [0, 1].map(|i| triangle.iter().map(|p| p[i]).sum::<f32>() / 3.0)
}

/// Canvases from left to right, with a gap.
fn beside(parts: &[Canvas]) -> Canvas {
    let width = parts.iter().map(|part| part.width() + GAP).sum::<u32>().saturating_sub(GAP);
    let height = parts.iter().map(Canvas::height).max().unwrap_or(1);
    let mut whole = Canvas::plain(width, height);
    let mut left = 0;
    for part in parts {
        whole.paste(part, left);
        left += part.width() + GAP;
    }
    whole
}
