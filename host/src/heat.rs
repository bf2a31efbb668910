//! A map of the parts of a picture that carry keygraphs.
//!
//! In: triangles in picture px. Out: their density on a coarse grid, and the picture in the
//! colours of the density: dark where there is none, then blue, red, yellow and white. A
//! triangle counts 1, spread evenly over its area. Memory: a float for each of at most
//! 128 x 128 fields. Cost: the fields that a triangle covers.

use keygraph_core::stages::geometry::{area, contains};

use crate::canvas::Canvas;
use crate::picture::{Picture, Pixels};

/// Number of fields along the longer side.
const FIELDS: u32 = 128;
/// Colours from no density to full density.
const RAMP: [[f32; 3]; 5] =
    [[0.0, 0.0, 0.0], [40.0, 40.0, 170.0], [220.0, 40.0, 60.0], [255.0, 200.0, 40.0], [255.0, 255.0, 220.0]];
/// Share of the fields that get the last colour.
const BRIGHTEST: f32 = 0.02;
/// Share of the picture's brightness in the drawing.
const PICTURE: f32 = 0.3;

/// Density of keygraphs over a picture.
#[derive(Clone, Debug)]
pub struct Heat {
    width: usize,
    height: usize,
    /// Fields per picture px.
    scale: f32,
    density: Vec<f32>,
}

/// Maps one coordinate of a picture to a copy that has `factor` px per px of the picture.
fn scaled(v: f32, factor: f32) -> f32 {
    (v + 0.5) * factor - 0.5
}

impl Heat {
    /// An empty map of a picture of `width` x `height` px.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most FIELDS")]
    pub fn new(width: u32, height: u32) -> Self {
        let scale = FIELDS as f32 / width.max(height).max(1) as f32;
        let fields = |n: u32| ((n as f32 * scale) as usize).max(1);
        let (w, h) = (fields(width), fields(height));
        Self { width: w, height: h, scale, density: vec![0.0; w * h] }
    }

    /// Adds a triangle, picture px.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the fields")]
    pub fn add(&mut self, triangle: [[f32; 2]; 3]) {
        let mut t = triangle.map(|p| p.map(|v| scaled(v, self.scale)));
        let mut size = area(&t);
        if size < 0.0 {
            t.swap(1, 2);
            size = -size;
        }
        // A triangle smaller than a field may contain no centre of a field.
        if !(1.0..f32::MAX).contains(&size) {
            return;
        }
        let range = |i: usize, n: usize| {
            let (low, high) = t.iter().fold((f32::MAX, f32::MIN), |(a, b), p| (a.min(p[i]), b.max(p[i])));
            low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, n as f32) as usize
        };
        for y in range(1, self.height) {
            for x in range(0, self.width) {
                if contains(&t, [x as f32, y as f32]) {
                    self.density[y * self.width + x] += 1.0 / size;
                }
            }
        }
    }

    /// Draws the picture, darkened, in the colours of the density.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    pub fn draw(&self, picture: &Picture) -> Canvas {
        let mut sorted = self.density.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let full = sorted[((sorted.len() - 1) as f32 * (1.0 - BRIGHTEST)) as usize].max(f32::MIN_POSITIVE);
        let whole = Canvas::from_picture(picture);
        let (w, pixels) = (picture.width as usize, whole.rgb().as_chunks::<3>().0);
        let rgb = pixels.iter().enumerate().flat_map(|(i, p)| {
            let at = |v: usize| scaled(v as f32, self.scale);
            // The square root makes weak parts visible.
            let heat = (self.at(at(i % w), at(i / w)) / full).min(1.0).sqrt();
            let colour = ramp(heat);
            let gray = p.iter().map(|&v| f32::from(v)).sum::<f32>() / 3.0;
            colour.map(|c| (PICTURE * gray + (1.0 - PICTURE) * c) as u8)
        });
        let pixels = Pixels::Rgb8(rgb.collect());
        Canvas::from_picture(&Picture { width: picture.width, height: picture.height, pixels })
    }

    /// The density at a point, in fields; interpolated bilinearly.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the fields")]
    fn at(&self, x: f32, y: f32) -> f32 {
        let (x, y) = (x.clamp(0.0, self.width as f32 - 1.0), y.clamp(0.0, self.height as f32 - 1.0));
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f32, y - j as f32);
        let (i1, j1) = ((i + 1).min(self.width - 1), (j + 1).min(self.height - 1));
        let row = |j: usize| self.density[j * self.width + i] * (1.0 - u) + self.density[j * self.width + i1] * u;
        row(j) * (1.0 - v) + row(j1) * v
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index into the ramp")]
fn ramp(heat: f32) -> [f32; 3] {
    let at = heat * (RAMP.len() - 1) as f32;
    let i = (at as usize).min(RAMP.len() - 2);
    let u = at - i as f32;
    core::array::from_fn(|c| RAMP[i][c] * (1.0 - u) + RAMP[i + 1][c] * u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_counts_one_whichever_way_it_turns() {
        let mut heat = Heat::new(256, 192);
        heat.add([[20.0, 20.0], [220.0, 30.0], [100.0, 170.0]]);
        heat.add([[20.0, 20.0], [100.0, 170.0], [220.0, 30.0]]);
        let sum: f32 = heat.density.iter().sum();
        assert!((sum - 2.0).abs() < 0.05, "{sum}");
        let carrying = heat.density.iter().filter(|&&d| d > 0.0).count() as f32 / heat.density.len() as f32;
        assert!((carrying - 0.5 * 200.0 * 145.0 / (256.0 * 192.0)).abs() < 0.03, "{carrying}");
    }

    #[test]
    fn the_picture_is_bright_where_triangles_lie_and_dark_elsewhere() {
        let mut heat = Heat::new(200, 100);
        heat.add([[10.0, 10.0], [90.0, 10.0], [50.0, 90.0]]);
        heat.add([[f32::NAN, 0.0], [f32::INFINITY, 10.0], [50.0, 90.0]]);
        let gray = Picture { width: 200, height: 100, pixels: Pixels::Gray8(vec![100; 20_000]) };
        let drawn = heat.draw(&gray);
        let at = |x: usize, y: usize| drawn.rgb()[3 * (y * 200 + x)];
        assert!(at(50, 40) > 150 && at(150, 40) < 50, "{} and {}", at(50, 40), at(150, 40));
    }
}
