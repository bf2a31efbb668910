//! Frames of a label on a can, with known places.
//!
//! In: a picture and a pose. Out: a frame of 640 x 480 px, and where places of the picture are in it. The can is
//! a cylinder before a pinhole camera; each pixel's ray is met with it.

use keygraph::picture::Picture;

use crate::scene::{FRAME, frame_of};

/// Focal length, px.
const FOCAL: f32 = 700.0;
/// Distance of the can's axis from the camera, in widths of the label.
const AWAY: f32 = 2.2;

/// A can with a label around it.
#[derive(Clone, Copy, Debug)]
pub struct Can<'a> {
    /// The label, RGB.
    pub picture: &'a Picture,
    /// How much of a turn the label goes around the can, radians.
    pub turn: f32,
    /// How far the can is turned about its axis, radians.
    pub spin: f32,
    /// How far its top leans to the right, radians.
    pub lean: f32,
}

impl Can<'_> {
    fn sides(&self) -> [f32; 2] {
        [self.picture.width as f32, self.picture.height as f32]
    }

    /// Where places of the picture, px, are in the frame, px.
    #[must_use]
    pub fn place(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let [w, h] = self.sides();
        let radius = 1.0 / self.turn;
        let angle = (x / w - 0.5) * self.turn + self.spin;
        let (u, v, depth) = (radius * angle.sin(), (y - h / 2.0) / w, AWAY - radius * angle.cos());
        let (sin, cos) = self.lean.sin_cos();
        let [u, v] = [u * cos - v * sin, u * sin + v * cos];
        [FRAME[0] as f32 / 2.0 + FOCAL * u / depth, FRAME[1] as f32 / 2.0 + FOCAL * v / depth]
    }

    /// The frame, before a gray ground with noise.
    ///
    /// # Panics
    /// When the picture is not RGB.
    #[must_use]
    pub fn frame(&self) -> Picture {
        let ([w, h], radius) = (self.sides(), 1.0 / self.turn);
        let (sin, cos) = self.lean.sin_cos();
        frame_of(self.picture, |[x, y]| {
            let [x, y] = [(x - FRAME[0] as f32 / 2.0) / FOCAL, (y - FRAME[1] as f32 / 2.0) / FOCAL];
            let [x, y] = [x * cos + y * sin, y * cos - x * sin];
            // The ray (x, y, 1) s meets the cylinder where (x s)^2 + (s - AWAY)^2 = radius^2.
            let (a, b, c) = (x * x + 1.0, AWAY, AWAY * AWAY - radius * radius);
            let meets = b * b - a * c;
            let s = (b - meets.max(0.0).sqrt()) / a;
            let angle = (x * s).atan2(AWAY - s) - self.spin;
            (meets > 0.0).then_some([(angle / self.turn + 0.5) * w, y * s * w + h / 2.0])
        })
    }
}
