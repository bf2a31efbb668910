//! Squeezes a frame along one direction.
//!
//! An object that is seen from far to the side is narrow along one direction. In a frame that is squeezed along the
//! other one it looks as from nearer the front, and smaller. So a search of squeezed frames finds what no view of a
//! model comes near (J.-M. Morel and G. Yu, *ASIFT: A New Framework for Fully Affine Invariant Image Comparison*, 2009,
//! squeeze both the picture and the frame).
//!
//! In: a plane of bytes, and a direction. Out: the plane squeezed along it, turned so that the direction is that of
//! the rows. Each pixel is the mean of samples along what it covers, so that nothing aliases. What lies outside of the
//! frame looks as its edge does.
//!
//! Memory: 400 bytes of stack. Cost: a bilinear sample for each two px that a pixel covers.

use crate::base::geometry::Homography;
use crate::base::math;
use crate::image::plane::Plane;

/// A frame squeezed along a direction: its size, and where its pixels are in the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Squeeze {
    /// Width of the squeezed frame, px; even.
    pub width: usize,
    /// Height of the squeezed frame, px; even.
    pub height: usize,
    /// The map from px of the squeezed frame to px of the frame.
    pub to_frame: Homography,
    factor: u8,
}

/// Number of pixels that are made together.
const STRIP: usize = 32;

impl Squeeze {
    /// Makes the squeeze of a frame of `width` x `height` px, by `factor` along a direction. A direction of 0 degrees is
    /// that of the rows, one of 90 degrees that of the columns, downwards.
    #[must_use]
    pub fn new((width, height): (usize, usize), factor: u8, direction_deg: f32) -> Self {
        let factor = factor.max(1);
        let (by, [w, h]) = (f32::from(factor), [width, height].map(|v| v as f32));
        let (sin, cos) = math::sin_cos(direction_deg * (core::f32::consts::PI / 180.0));
        let even = |v: f32| 2 * usize::try_from(math::round(v / 2.0)).unwrap_or(0).max(1);
        let width = even((w * cos.abs() + h * sin.abs()) / by);
        let height = even(w * sin.abs() + h * cos.abs());
        let [x, y] = [width, height].map(|v| (v as f32 - 1.0) / 2.0);
        let to_frame = Homography::affine([
            by * cos,
            -sin,
            (w - 1.0) / 2.0 - by * cos * x + sin * y,
            by * sin,
            cos,
            (h - 1.0) / 2.0 - by * sin * x - cos * y,
        ]);
        Self { width, height, to_frame, factor }
    }

    /// Returns the squeeze of the frame's chroma planes, when they have half its width and height.
    #[must_use]
    pub fn halved(&self) -> Self {
        let to_frame = Homography::scaling([0.5; 2]).after(&self.to_frame).after(&Homography::scaling([2.0; 2]));
        Self { width: (self.width / 2).max(1), height: (self.height / 2).max(1), to_frame, factor: self.factor }
    }

    /// Writes the squeezed plane to `out`, row after row. The plane has the size that the squeeze was made for, and sides of
    /// 2 px or more.
    ///
    /// # Panics
    /// When `out` is shorter than the squeezed plane.
    pub fn apply(&self, plane: &Plane<'_, u8>, out: &mut [u8]) {
        let &Self { width, height, to_frame: Homography([a, b, c, d, e, f, ..]), factor } = self;
        // The samples lie side by side, the pixel's own place in the middle. A bilinear sample covers two px.
        let samples = factor.div_ceil(2);
        let (number, middle) = (f32::from(samples), (f32::from(samples) - 1.0) / 2.0);
        for (y, row) in out[..width * height].chunks_exact_mut(width).enumerate() {
            for (i, strip) in row.chunks_mut(STRIP).enumerate() {
                let [mut sums, mut us, mut vs] = [[0.0; STRIP]; 3];
                let n = strip.len();
                for k in 0..samples {
                    let aside = (f32::from(k) - middle) / number;
                    for (x, (u, v)) in us[..n].iter_mut().zip(&mut vs[..n]).enumerate() {
                        let (x, y) = ((STRIP * i + x) as f32 + aside, y as f32);
                        (*u, *v) = (a * x + b * y + c, d * x + e * y + f);
                    }
                    plane.sample_clamped(&mut us[..n], &mut vs[..n]);
                    sums.iter_mut().zip(&us).for_each(|(sum, u)| *sum += u);
                }
                for (out, sum) in strip.iter_mut().zip(sums) {
                    *out = u8::try_from(math::round(sum / number).clamp(0, 255)).unwrap_or(0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squeezed(data: &[u8], size: (usize, usize), squeeze: &Squeeze) -> std::vec::Vec<u8> {
        let mut out = std::vec![0; squeeze.width * squeeze.height];
        squeeze.apply(&Plane::new(data, size.0, size.1).unwrap(), &mut out);
        out
    }

    #[test]
    fn along_the_rows_a_pixel_is_the_mean_of_what_it_covers() {
        let data: std::vec::Vec<u8> = (0..24 * 4).map(|i| (i * i % 251) as u8).collect();
        let squeeze = Squeeze::new((24, 4), 4, 0.0);
        assert_eq!((squeeze.width, squeeze.height), (6, 4));
        for (i, &v) in squeezed(&data, (24, 4), &squeeze).iter().enumerate() {
            let (x, y) = (i % 6, i / 6);
            // Each of two samples lies between two px. At the edge, samples are moved inside by 1/256 px.
            let mean = data[24 * y + 4 * x..][..4].iter().map(|&v| f32::from(v)).sum::<f32>() / 4.0;
            assert!((f32::from(v) - mean).abs() <= 1.0, "({x}, {y}): {v} for {mean}");
        }
    }

    #[test]
    fn along_the_columns_the_frame_is_turned() {
        let data: std::vec::Vec<u8> = (0..6 * 30).map(|i| if i / 6 < 15 { 10 } else { 200 }).collect();
        let squeeze = Squeeze::new((6, 30), 5, 90.0);
        assert_eq!((squeeze.width, squeeze.height), (6, 6));
        assert_eq!(squeezed(&data, (6, 30), &squeeze)[..6], [10, 10, 10, 200, 200, 200]);
        let [x, y] = squeeze.to_frame.apply([0.0, 5.0]);
        assert!((x - 0.0).abs() < 1e-4 && (y - 2.0).abs() < 1e-4, "the first pixel of the last row: ({x}, {y})");
    }

    #[test]
    fn a_pixel_shows_the_place_that_the_map_tells() {
        // A slope, of which a mean is the value in the middle.
        let (w, h) = (90, 70);
        let data: std::vec::Vec<u8> = (0..w * h).map(|i| (i % w + i / w) as u8).collect();
        for direction in [22.5, 45.0, 112.5, 157.5] {
            let squeeze = Squeeze::new((w, h), 4, direction);
            let out = squeezed(&data, (w, h), &squeeze);
            let mut inside = 0;
            for (i, &v) in out.iter().enumerate() {
                let [x, y] = squeeze.to_frame.apply([(i % squeeze.width) as f32, (i / squeeze.width) as f32]);
                if (2.0..w as f32 - 3.0).contains(&x) && (2.0..h as f32 - 3.0).contains(&y) {
                    inside += 1;
                    assert!((f32::from(v) - x - y).abs() < 0.6, "{v} at ({x}, {y})");
                }
            }
            assert!(inside * 4 > w * h * 3 / 4, "most of the frame is there: {inside}");
        }
    }

    #[test]
    fn the_chroma_of_a_place_lies_at_that_place() {
        let squeeze = Squeeze::new((64, 48), 5, 67.5);
        let half = squeeze.halved();
        assert_eq!((2 * half.width, 2 * half.height), (squeeze.width, squeeze.height));
        // The middle of a pixel of chroma is the corner between four of luma.
        let [x, y] = half.to_frame.apply([1.0, 7.0]).map(|v| 2.0 * v + 0.5);
        let [u, v] = squeeze.to_frame.apply([2.5, 14.5]);
        assert!((x - u).abs() < 1e-3 && (y - v).abs() < 1e-3, "({x}, {y}) for ({u}, {v})");
    }
}
