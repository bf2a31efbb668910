//! Frames of a plane through a lens, with known poses.
//!
//! In: a picture, a lens and a pose. Out: a frame of 640 x 480 px, and where places of the picture are in it. The
//! lens of core bends the rays; its tests hold it against OpenCV.

use keygraph::picture::{Picture, Pixels};
use keygraph_core::Lens;

/// Size of the frames, px.
pub const FRAME: [u32; 2] = [640, 480];

/// A picture before a camera.
#[derive(Clone, Copy, Debug)]
pub struct Lensed<'a> {
    /// The picture, RGB.
    pub picture: &'a Picture,
    /// The camera and its lens.
    pub lens: Lens,
    /// Turns about x, y and z, radians, in this order.
    pub turn: [f32; 3],
    /// The middle of the picture in camera coordinates, in widths of the picture.
    pub middle: [f32; 3],
}

impl Lensed<'_> {
    /// The rotation from the picture to the camera, row by row.
    #[must_use]
    pub fn rotation(&self) -> [f32; 9] {
        let [(a, b), (c, d), (e, f)] = self.turn.map(f32::sin_cos);
        // Rz Ry Rx.
        [f * d, f * c * a - e * b, f * c * b + e * a, e * d, e * c * a + f * b, e * c * b - f * a, -c, d * a, d * b]
    }

    fn sides(&self) -> [f32; 2] {
        [self.picture.width as f32, self.picture.height as f32]
    }

    /// Where a place of the picture, px, is in the frame, px.
    #[must_use]
    pub fn place(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let ([w, h], r) = (self.sides(), self.rotation());
        let [u, v] = [(x - w / 2.0) / w, (y - h / 2.0) / w];
        let p = [0, 1, 2].map(|i| r[3 * i] * u + r[3 * i + 1] * v + self.middle[i]);
        let [fx, fy, cx, cy] = self.lens.intrinsics();
        self.lens.distort([fx * p[0] / p[2] + cx, fy * p[1] / p[2] + cy])
    }

    /// The frame, before a gray ground with noise.
    ///
    /// # Panics
    /// When the picture is not RGB.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours and places in the picture")]
    pub fn frame(&self) -> Picture {
        let Pixels::Rgb8(label) = &self.picture.pixels else { unreachable!("the picture is not RGB") };
        let ([w, h], r) = (self.sides(), self.rotation());
        let [fx, fy, cx, cy] = self.lens.intrinsics();
        let normal = [r[2], r[5], r[8]];
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let mut rgb = Vec::with_capacity(FRAME[0] as usize * FRAME[1] as usize * 3);
        for i in 0..FRAME[0] * FRAME[1] {
            let noise = (i.wrapping_mul(2_654_435_761) >> 29) as f32;
            let ideal = self.lens.undistort([(i % FRAME[0]) as f32, (i / FRAME[0]) as f32]);
            let place = ideal.and_then(|[x, y]| {
                let ray = [(x - cx) / fx, (y - cy) / fy, 1.0];
                let s = dot(normal, self.middle) / dot(normal, ray);
                let q = [0, 1, 2].map(|k| ray[k] * s - self.middle[k]);
                let [u, v] = [0, 1].map(|k| dot([r[k], r[3 + k], r[6 + k]], q));
                let (u, v) = (u * w + w / 2.0, v * w + h / 2.0);
                (s > 0.0 && u >= 0.0 && v >= 0.0 && u < w - 1.0 && v < h - 1.0).then_some((u, v))
            });
            for channel in 0..3 {
                let seen = place.map_or(90.0, |(u, v)| {
                    let (j, k) = (u as usize, v as usize);
                    let (p, q) = (u - j as f32, v - k as f32);
                    let at = |x: usize, y: usize| f32::from(label[(y * w as usize + x) * 3 + channel]);
                    let row = |k: usize| at(j, k) * (1.0 - p) + at(j + 1, k) * p;
                    (row(k) * (1.0 - q) + row(k + 1) * q) * 0.85
                });
                rgb.push((seen + noise) as u8);
            }
        }
        Picture { width: FRAME[0], height: FRAME[1], pixels: Pixels::Rgb8(rgb) }
    }
}
