//! Frames of a plane through a lens, with known poses.
//!
//! In: a picture, a lens and a pose. Out: a frame of 640 x 480 px, and where places of the picture are in it. The
//! lens of core bends the rays; its tests hold it against OpenCV.

use keygraph::picture::Picture;
use keygraph_core::Lens;

use crate::scene::frame_of;

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
    pub fn frame(&self) -> Picture {
        let ([w, h], r) = (self.sides(), self.rotation());
        let [fx, fy, cx, cy] = self.lens.intrinsics();
        let normal = [r[2], r[5], r[8]];
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        frame_of(self.picture, |p| {
            let [x, y] = self.lens.undistort(p)?;
            let ray = [(x - cx) / fx, (y - cy) / fy, 1.0];
            let s = dot(normal, self.middle) / dot(normal, ray);
            let q = [0, 1, 2].map(|k| ray[k] * s - self.middle[k]);
            let [u, v] = [0, 1].map(|k| dot([r[k], r[3 + k], r[6 + k]], q));
            (s > 0.0).then_some([u * w + w / 2.0, v * w + h / 2.0])
        })
    }
}
