//! Outlines, drawn into a buffer.
//!
//! In: a mapped frame of one of the formats of `pixels`, and corners in px. Out: the frame with a white line
//! with black sides; YUV in its luma alone. Memory: none. Cost: that of the pixels of the line.

use gstreamer as gst;
use gstreamer_video::{VideoFormat, VideoFrameExt, VideoFrameRef};

/// Draws the outline of an object.
pub fn outline(frame: &mut VideoFrameRef<&mut gst::BufferRef>, corners: &[[f32; 2]; 4]) {
    let each = if frame.format() == VideoFormat::Rgb { 3 } else { 1 };
    let (width, height) = (frame.width() as usize, frame.height() as usize);
    let stride = usize::try_from(frame.plane_stride()[0]).unwrap_or_default();
    // As thick in a large frame as in a small one, when both are shown in one size.
    let thick = (width.max(height) as f32 / 400.0).max(1.0);
    let Ok(data) = frame.plane_data_mut(0) else { return };
    for (radius, value) in [(2.0 * thick, 0), (thick, 255)] {
        for i in 0..4 {
            let [a, b] = [corners[i], corners[(i + 1) % 4]];
            for [x, y] in along(a, b, (width, height)) {
                dot(data, (stride, each), (width, height), [x, y, radius], value);
            }
        }
    }
}

/// Points on a line at distances of a pixel, as far as they are in or beside the frame.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lengths in px, limited before")]
fn along(a: [f32; 2], b: [f32; 2], (width, height): (usize, usize)) -> impl Iterator<Item = [f32; 2]> {
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    let steps = if length.is_finite() { length.min(1e5) as usize + 1 } else { 0 };
    let point = move |i: usize| {
        let t = i as f32 / steps as f32;
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    };
    let is_near =
        move |&[x, y]: &[f32; 2]| x > -20.0 && y > -20.0 && x < width as f32 + 20.0 && y < height as f32 + 20.0;
    (0..=steps).map(point).filter(is_near)
}

/// Fills a square around a point.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited to the frame")]
fn dot(data: &mut [u8], (stride, each): (usize, usize), size: (usize, usize), [x, y, radius]: [f32; 3], value: u8) {
    let range = |v: f32, most: usize| {
        ((v - radius).round().max(0.0) as usize)..((v + radius).round().max(0.0) as usize).min(most)
    };
    for row in range(y, size.1) {
        for column in range(x, size.0) {
            let start = row * stride + column * each;
            if let Some(pixel) = data.get_mut(start..start + each) {
                pixel.fill(value);
            }
        }
    }
}
