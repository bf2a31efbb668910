//! Renders camera frames of pictures, with known poses.
//!
//! In: pictures, a pose for each, what the light and the camera do, and a seed. Out: a frame, and
//! for each picture the homography from its pixels to the pixels of the frame.
//!
//! A pose goes through a pinhole camera, so that a tilt shortens the far side more than the near
//! side. A picture is averaged over the area that a pixel covers, so that small pictures do not
//! alias. The background is a part of another picture, or dead leaves: disks and rectangles that
//! cover each other. The number of leaves with side r is proportional to r^-3, which gives edges at
//! all scales, as photographs have (A. Lee, D. Mumford, J. Huang, *Occlusion Models for Natural
//! Images*, 2001).
//!
//! `host/examples/render.rs` renders for other programs.
//!
//! A seed gives the same bytes on every machine. Random numbers come from [`crate::random`]. Floats
//! are computed with + - x / and square roots, which are rounded exactly, and with
//! [`keygraph_core::stages::math`].
//!
//! Memory: 12 bytes a frame pixel, twice while it is blurred. Cost: some 20 ms a
//! frame of 640 x 480 px, half of it the leaves.

use core::ops::Range;

use keygraph_core::Homography;
use keygraph_core::stages::geometry::area;
use keygraph_core::stages::math;
use keygraph_core::stages::shrink::shrink;

use crate::annotate::Canvas;
use crate::input::{Picture, Pixels};
use crate::random::Random;
use crate::search::{Profile, fit};

/// A detection is right when its corners lie on average within this part of the
/// object's size from the truth.
pub const RIGHT: f32 = 0.1;

/// Mean distance of `corners` from the true ones, as a part of the object's size:
/// the square root of the true outline's area.
#[must_use]
pub fn corner_error(corners: &[[f32; 2]; 4], truth: &[[f32; 2]; 4]) -> f32 {
    let size = area(truth).abs().sqrt();
    let distance = |(a, b): (&[f32; 2], &[f32; 2])| length(a[0] - b[0], a[1] - b[1]);
    corners.iter().zip(truth).map(distance).sum::<f32>() / 4.0 / size
}

fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}

// --------------------------------------------------------------------- poses

/// Where a picture stands before the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Longer side of the picture seen from the front, frame px.
    pub side_px: f32,
    /// Turn in its own plane, clockwise on the screen, degrees.
    pub rotation_deg: f32,
    /// Angle between its normal and the line of sight to its middle, degrees;
    /// below 80.
    pub tilt_deg: f32,
    /// Direction of the axis that it is tilted about, degrees from the frame's x
    /// axis.
    pub axis_deg: f32,
    /// Where the picture's middle is seen, frame px.
    pub centre: [f32; 2],
}

impl Pose {
    /// The homography from picture px to frame px, for a picture of `size` px (width, height) and
    /// a camera of focal length `focal_px`. The optical axis meets the middle of the picture. So a
    /// picture that is not in the middle of the frame is seen as in a part of a larger frame.
    #[must_use]
    pub fn homography(&self, size: (f32, f32), focal_px: f32) -> Homography {
        let turn = |deg: f32| math::sin_cos(deg.to_radians());
        let ((sin_t, cos_t), (sin_a, cos_a)) = (turn(self.tilt_deg), turn(self.axis_deg));
        let (sin, cos) = turn(self.rotation_deg - self.axis_deg);
        // Turn within the axis' frame, tilt about the axis, turn the axis back.
        let column = |x: f32, y: f32| [cos_a * x - sin_a * y * cos_t, sin_a * x + cos_a * y * cos_t, y * sin_t];
        let (u, v) = (column(cos, sin), column(-sin, cos));
        let f = focal_px;
        let camera = Homography([f * u[0], f * v[0], 0.0, f * u[1], f * v[1], 0.0, u[2], v[2], f]);
        let s = self.side_px / size.0.max(size.1);
        let plane = Homography::affine([s, 0.0, -s * (size.0 - 1.0) / 2.0, 0.0, s, -s * (size.1 - 1.0) / 2.0]);
        let place = Homography::affine([1.0, 0.0, self.centre[0], 0.0, 1.0, self.centre[1]]);
        place.after(&camera).after(&plane).normalised()
    }
}

// ------------------------------------------------------------------ pictures

/// A picture to be rendered.
#[derive(Clone, Debug)]
pub struct Print {
    /// Width and height of the picture, px.
    size: (f32, f32),
    /// Width and height of the copy that is rendered, px.
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Print {
    /// Takes a copy of `picture`. A picture that is larger than any frame is scaled down.
    #[must_use]
    pub fn new(picture: &Picture) -> Self {
        let (side, pixels) = Profile::Hd.limits();
        let scaled = fit(picture, side, pixels);
        let (width, height) = (scaled.width, scaled.height);
        let whole = Canvas::from_picture(picture);
        let mut rgb = vec![0; 3 * width * height];
        shrink::<3>(whole.rgb(), (picture.width as usize, picture.height as usize), &mut rgb, (width, height));
        Self { size: (picture.width as f32, picture.height as f32), width, height, rgb }
    }

    /// Width and height of the picture, px.
    #[must_use]
    pub const fn size(&self) -> (f32, f32) {
        self.size
    }

    /// The copy, scaled down to two pixels for one pixel of the frame; unchanged if it has fewer.
    /// `scale` is frame px per picture px.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sizes of pictures")]
    fn at(&self, scale: f32) -> (usize, usize, Vec<u8>) {
        let f = (2.0 * scale * self.size.0 / self.width as f32).min(1.0);
        let size = |n: usize| ((n as f32 * f) as usize).max(1);
        let (w, h) = (size(self.width), size(self.height));
        let mut rgb = vec![0; 3 * w * h];
        shrink::<3>(&self.rgb, (self.width, self.height), &mut rgb, (w, h));
        (w, h, rgb)
    }
}

// -------------------------------------------------------------------- frames

/// What the light and the camera do to a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Brightness as a part of the picture's own.
    pub gain: f32,
    /// Spread of the Gaussian blur, frame px.
    pub blur_px: f32,
    /// Spread of the noise of each channel, of 255.
    pub noise: f32,
}

/// A frame that is being composed: linear red, green and blue of 0 to 255.
#[derive(Clone, Debug)]
pub struct Scene {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
}

/// Radius of the smallest leaves, px.
const LEAST_LEAF_PX: f32 = 12.0;
/// Leaves that fall on a pixel, on average.
const LEAVES_DEEP: f32 = 7.0;
/// Points along each side of the grid that measures how much of a picture is hidden.
const GRID: u16 = 64;

impl Scene {
    /// Dead leaves of `width` x `height` px.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of leaves")]
    pub fn dead_leaves(width: usize, height: usize, random: &mut Random) -> Self {
        let mut scene = Self { width, height, rgb: vec![[128.0; 3]; width * height] };
        let (w, h) = (width as f32, height as f32);
        let most = w.max(h) / 5.0;
        let part = 1.0 - (LEAST_LEAF_PX / most) * (LEAST_LEAF_PX / most);
        // The mean area of a disk whose radius is distributed as r^-3.
        let mean = core::f32::consts::TAU * LEAST_LEAF_PX * LEAST_LEAF_PX * math::ln(most / LEAST_LEAF_PX) / part;
        let count = (LEAVES_DEEP * w * h / mean) as usize;
        for _ in 0..count {
            let r = LEAST_LEAF_PX / (1.0 - part * random.unit()).sqrt();
            let centre = [random.between(-r, w + r), random.between(-r, h + r)];
            let round = random.bits() & 1 == 0;
            let aspect = random.between(0.4, 1.0);
            scene.leaf(centre, [r, if round { r } else { r * aspect }], round, random);
        }
        scene
    }

    /// A random part of a picture, which fills all of `width` x `height` px.
    #[must_use]
    pub fn photograph(width: usize, height: usize, print: &Print, random: &mut Random) -> Self {
        let mut scene = Self { width, height, rgb: vec![[128.0; 3]; width * height] };
        scene.lay_part(print, [-0.5; 2], [width as f32, height as f32], random);
        scene
    }

    /// Covers a rectangle with one leaf: corner and size in px.
    pub fn cover(&mut self, [x, y]: [f32; 2], [w, h]: [f32; 2], random: &mut Random) {
        self.leaf([x + w / 2.0, y + h / 2.0], [w / 2.0, h / 2.0], false, random);
    }

    /// An ellipse or rectangle of half sides `half`, of one colour that fades
    /// along it and a grain.
    fn leaf(&mut self, centre: [f32; 2], half: [f32; 2], round: bool, random: &mut Random) {
        let light = random.between(15.0, 230.0);
        // Two uniform ones: most things are nearly gray.
        let tint = [0; 3].map(|_| light + random.between(-35.0, 35.0) + random.between(-35.0, 35.0));
        let fade = [0; 2].map(|_| random.between(-25.0, 25.0));
        let grain = random.between(0.0, 10.0);
        let [xs, ys] = [0, 1].map(|i| span(centre[i] - half[i], centre[i] + half[i], [self.width, self.height][i]));
        for y in ys {
            let v = (y as f32 - centre[1]) / half[1];
            for x in xs.clone() {
                let u = (x as f32 - centre[0]) / half[0];
                if !round || u * u + v * v <= 1.0 {
                    let light = fade[0] * u + fade[1] * v + grain * (random.unit() - 0.5);
                    self.rgb[y * self.width + x] = tint.map(|t| (t + light).clamp(0.0, 255.0));
                }
            }
        }
    }

    /// Lays a picture over the scene, as a camera sees it whose field of view is 53 degrees along
    /// the longer side. Returns the homography from picture px to frame px.
    pub fn lay(&mut self, print: &Print, pose: &Pose) -> Homography {
        let h = pose.homography(print.size, self.focal_px());
        self.lay_at(print, &h);
        h
    }

    /// Lays a picture over the scene where `h` (picture px to frame px) puts it. A picture that is
    /// seen edge on leaves the scene unchanged.
    pub fn lay_at(&mut self, print: &Print, h: &Homography) {
        self.lay_within(print, h, [0..self.width, 0..self.height]);
    }

    /// Hides a `share` (0 to 1) of a picture, which `h` has put into the scene, behind an
    /// upright rectangle: a random part of `other`.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of points")]
    pub fn hide(&mut self, print: &Print, h: &Homography, share: f32, other: &Print, random: &mut Random) {
        // Shares of the width and the height to frame px.
        let at = |u: f32, v: f32| h.apply([u * print.size.0 - 0.5, v * print.size.1 - 0.5]);
        let [x, y] = at(random.between(0.2, 0.8), random.between(0.2, 0.8));
        let stretch = math::exp(random.between(-0.25, 0.25));
        // Each point of the grid is reached by the rectangle 2 r stretch x 2 r / stretch.
        let step = |i: u16| (f32::from(i) + 0.5) / f32::from(GRID);
        let points = (0..GRID * GRID).map(|i| at(step(i % GRID), step(i / GRID)));
        let mut reach: Vec<f32> =
            points.map(|p| ((p[0] - x).abs() / stretch).max((p[1] - y).abs() * stretch)).collect();
        reach.sort_unstable_by(f32::total_cmp);
        let hidden = (share * reach.len() as f32) as usize;
        let Some(&r) = hidden.checked_sub(1).and_then(|last| reach.get(last)) else { return };
        let (half_w, half_h) = (r * stretch, r / stretch);
        self.lay_part(other, [x - half_w, y - half_h], [2.0 * half_w, 2.0 * half_h], random);
    }

    /// Fills a rectangle (corner and size in px) with a random part of a picture,
    /// mirrored half of the time.
    fn lay_part(&mut self, print: &Print, [x, y]: [f32; 2], [w, h]: [f32; 2], random: &mut Random) {
        // Larger than the rectangle by a little at least, so that rounding leaves no seam.
        let scale = (w / print.size.0).max(h / print.size.1) * random.between(1.02, 1.5);
        let left = random.between(w - scale * print.size.0, 0.0);
        let top = random.between(h - scale * print.size.1, 0.0);
        // From the edge of the picture's first pixel to the edge of the part's.
        let (sx, x0) = if random.bits() & 1 == 0 { (scale, x + left) } else { (-scale, x + w - left) };
        let place = Homography::affine([sx, 0.0, x0 + sx / 2.0, 0.0, scale, y + top + scale / 2.0]);
        self.lay_within(print, &place, [span(x, x + w, self.width), span(y, y + h, self.height)]);
    }

    /// Lays a picture as [`Scene::lay_at`] does, but only within `columns` and `rows` of the frame.
    fn lay_within(&mut self, print: &Print, h: &Homography, [columns, rows]: [Range<usize>; 2]) {
        let Some(back) = h.inverse() else { return };
        // The picture reaches half a pixel beyond the middle of its outer ones.
        let shape = Homography::affine([1.0, 0.0, -0.5, 0.0, 1.0, -0.5]);
        let outline = h.after(&shape).outline(print.size.0, print.size.1);
        let side = |i: usize| {
            let ([a, b], [c, d]) = (outline[i], outline[(i + 1) % 4]);
            length(a - c, b - d) / if i.is_multiple_of(2) { print.size.0 } else { print.size.1 }
        };
        let (w, ht, rgb) = print.at((0..4).map(side).fold(0.0, f32::max));
        let texels = rgb.as_chunks::<3>().0;
        let (fx, fy) = (w as f32 / print.size.0, ht as f32 / print.size.1);
        let to_copy = Homography::scaling([fx, fy]).after(&back);
        let bounds = |i: usize| outline.iter().fold((f32::MAX, f32::MIN), |(a, b), p| (a.min(p[i]), b.max(p[i])));
        let ((x0, x1), (y0, y1)) = (bounds(0), bounds(1));
        for y in common(&span(y0 - 1.0, y1 + 1.0, self.height), &rows) {
            for x in common(&span(x0 - 1.0, x1 + 1.0, self.width), &columns) {
                let (mut sum, mut covered) = ([0.0; 3], 0.0);
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let p = to_copy.apply([x as f32 + dx, y as f32 + dy]);
                    if let Some(c) = sample(texels, (w, ht), p) {
                        sum = core::array::from_fn(|i| sum[i] + c[i] / 4.0);
                        covered += 0.25;
                    }
                }
                let pixel = &mut self.rgb[y * self.width + x];
                *pixel = core::array::from_fn(|i| sum[i] + (1.0 - covered) * pixel[i]);
            }
        }
    }

    /// Focal length of the camera, px: the longer side.
    #[must_use]
    pub fn focal_px(&self) -> f32 {
        self.width.max(self.height) as f32
    }

    /// A random place in the frame at which the whole picture of `size` px is seen in `pose`. A
    /// picture that is too long for the frame sticks out on both sides.
    #[must_use]
    pub fn somewhere(&self, size: (f32, f32), pose: Pose, random: &mut Random) -> Pose {
        let outline = Pose { centre: [0.0; 2], ..pose }.homography(size, self.focal_px()).outline(size.0, size.1);
        let frame = [self.width as f32 - 1.0, self.height as f32 - 1.0];
        let centre = [0, 1].map(|i| {
            let (low, high) = outline.iter().fold((f32::MAX, f32::MIN), |(a, b), p| (a.min(p[i]), b.max(p[i])));
            random.between(-low, frame[i] - high)
        });
        Pose { centre, ..pose }
    }

    /// Multiplies red, green and blue by a factor each, as a coloured lamp does.
    pub fn tint(&mut self, [red, green, blue]: [f32; 3]) {
        for pixel in &mut self.rgb {
            *pixel = [pixel[0] * red, pixel[1] * green, pixel[2] * blue];
        }
    }

    /// The frame that the camera delivers: light, then blur, then noise.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    pub fn expose(mut self, exposure: &Exposure, random: &mut Random) -> Picture {
        blur(&mut self.rgb, self.width, exposure.blur_px);
        let mut value = |v: f32| (v * exposure.gain + exposure.noise * random.normal() + 0.5).clamp(0.0, 255.0) as u8;
        let rgb = self.rgb.as_flattened().iter().map(|&v| value(v)).collect();
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Picture { width: side(self.width), height: side(self.height), pixels: Pixels::Rgb8(rgb) }
    }
}

/// Pixels from `low` to `high` that lie in a frame of `n`.
#[allow(clippy::cast_sign_loss, reason = "never negative")]
fn span(low: f32, high: f32, n: usize) -> Range<usize> {
    let inside = |v: f32| (math::floor(v).max(0) as usize).min(n);
    let first = inside(-math::floor(-low) as f32);
    first..inside(high + 1.0).max(first)
}

/// What two ranges have in common.
fn common(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// Bilinear; `None` outside of the picture.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside of the picture")]
fn sample(texels: &[[u8; 3]], (w, h): (usize, usize), [x, y]: [f32; 2]) -> Option<[f32; 3]> {
    let (right, bottom) = (w as f32 - 0.5, h as f32 - 0.5);
    if !(x >= -0.5 && y >= -0.5 && x < right && y < bottom) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, right - 0.5), y.clamp(0.0, bottom - 0.5));
    let (i, j) = (x as usize, y as usize);
    let (u, v) = (x - i as f32, y - j as f32);
    let row = |j: usize| {
        let (a, b) = (texels[j * w + i], texels[j * w + (i + 1).min(w - 1)]);
        [0, 1, 2].map(|c| f32::from(a[c]) * (1.0 - u) + f32::from(b[c]) * u)
    };
    let (a, b) = (row(j), row((j + 1).min(h - 1)));
    Some([0, 1, 2].map(|c| a[c] * (1.0 - v) + b[c] * v))
}

/// Gaussian blur of spread `sigma` px, in rows and then in columns; the border is
/// repeated outwards.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a radius")]
fn blur(rgb: &mut [[f32; 3]], width: usize, sigma: f32) {
    let radius = (3.0 * sigma + 0.5) as usize;
    if radius == 0 {
        return;
    }
    let weight = |d: usize| math::exp(-0.5 * (d * d) as f32 / (sigma * sigma));
    let sum = weight(0) + 2.0 * (1..=radius).map(weight).sum::<f32>();
    let kernel: Vec<f32> = (0..=2 * radius).map(|k| weight(k.abs_diff(radius)) / sum).collect();
    let height = rgb.len() / width;
    let mut padded = vec![[0.0; 3]; width + 2 * radius];
    for line in rgb.chunks_exact_mut(width) {
        for (x, p) in padded.iter_mut().enumerate() {
            *p = line[x.saturating_sub(radius).min(width - 1)];
        }
        line.fill([0.0; 3]);
        for (k, &weight) in kernel.iter().enumerate() {
            add(line, &padded[k..k + width], weight);
        }
    }
    let source = rgb.to_vec();
    for (y, line) in rgb.chunks_exact_mut(width).enumerate() {
        line.fill([0.0; 3]);
        for (k, &weight) in kernel.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(height - 1);
            add(line, &source[from * width..][..width], weight);
        }
    }
}

fn add(line: &mut [[f32; 3]], other: &[[f32; 3]], weight: f32) {
    for (a, &b) in line.as_flattened_mut().iter_mut().zip(other.as_flattened()) {
        *a += weight * b;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
mod tests {
    use super::*;

    const FRONT: Pose = Pose { side_px: 80.0, rotation_deg: 0.0, tilt_deg: 0.0, axis_deg: 0.0, centre: [60.0, 50.0] };
    const CLEAR: Exposure = Exposure { gain: 1.0, blur_px: 0.0, noise: 0.0 };

    fn bytes(picture: &Picture) -> &[u8] {
        match &picture.pixels {
            Pixels::Rgb8(b) => b,
            _ => panic!("frames are RGB"),
        }
    }

    fn flat(width: u32, height: u32, value: u8) -> Picture {
        Picture { width, height, pixels: Pixels::Rgb8(vec![value; (3 * width * height) as usize]) }
    }

    #[test]
    fn random_numbers_are_the_published_ones() {
        // The first outputs of splitmix64 for the seed 1234567.
        let mut random = Random::new(1_234_567);
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([0; 3].map(|_| random.bits()), expected);
    }

    #[test]
    fn normal_numbers_have_mean_0_and_spread_1() {
        let mut random = Random::new(1);
        let values: Vec<f32> = (0..20_000).map(|_| random.normal()).collect();
        let mean = values.iter().sum::<f32>() / 20_000.0;
        let square = values.iter().map(|v| v * v).sum::<f32>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.03, "mean {mean}, square {square}");
    }

    #[test]
    fn from_the_front_a_pose_is_a_similarity() {
        let h = Pose { rotation_deg: 90.0, ..FRONT }.homography((161.0, 121.0), 640.0);
        // 161 px become 80: the middle stays, the left side comes up.
        let close = |p: [f32; 2], q: [f32; 2]| assert!(length(p[0] - q[0], p[1] - q[1]) < 1e-2, "{p:?} is not {q:?}");
        close(h.apply([80.0, 60.0]), [60.0, 50.0]);
        close(h.apply([0.0, 60.0]), [60.0, 50.0 - 80.0 * 80.0 / 161.0]);
    }

    #[test]
    fn tilt_shortens_by_its_cosine_and_the_far_side_more() {
        let pose = Pose { tilt_deg: 60.0, axis_deg: 90.0, ..FRONT };
        // Far away, there is no perspective.
        let far = pose.homography((101.0, 101.0), 1e6).outline(100.0, 100.0);
        let side = |o: &[[f32; 2]; 4], i: usize, j: usize| length(o[i][0] - o[j][0], o[i][1] - o[j][1]);
        assert!((side(&far, 0, 1) / side(&far, 1, 2) - 0.5).abs() < 0.01, "{far:?}");
        let near = pose.homography((101.0, 101.0), 100.0).outline(100.0, 100.0);
        assert!((side(&near, 1, 2) / side(&near, 3, 0) - 1.0).abs() > 0.5, "{near:?}");
    }

    #[test]
    fn a_picture_lies_where_its_outline_says() {
        let mut scene = Scene { width: 120, height: 100, rgb: vec![[0.0; 3]; 12_000] };
        let pose = Pose { rotation_deg: 30.0, tilt_deg: 40.0, axis_deg: 20.0, ..FRONT };
        let h = scene.lay(&Print::new(&flat(200, 100, 200)), &pose);
        let frame = scene.expose(&CLEAR, &mut Random::new(1));
        let lit = bytes(&frame).iter().map(|&b| f32::from(b)).sum::<f32>() / 3.0 / 200.0;
        let expected = area(&h.outline(200.0, 100.0));
        assert!((lit / expected - 1.0).abs() < 0.01, "{lit} px of {expected}");
    }

    #[test]
    fn fine_stripes_become_gray_and_coarse_ones_stay() {
        let stripes = |n: u32| Picture {
            width: 640,
            height: 640,
            pixels: Pixels::Gray8(
                (0..640 * 640).map(|i| if (i % 640 / n).is_multiple_of(2) { 0 } else { 240 }).collect(),
            ),
        };
        let spread = |n: u32| {
            let mut scene = Scene { width: 120, height: 100, rgb: vec![[0.0; 3]; 12_000] };
            let _ = scene.lay(&Print::new(&stripes(n)), &FRONT);
            let frame = scene.expose(&CLEAR, &mut Random::new(1));
            let row = &bytes(&frame)[3 * (50 * 120 + 30)..3 * (50 * 120 + 90)];
            row.iter().max().unwrap() - row.iter().min().unwrap()
        };
        assert!(spread(1) < 8, "one pixel in eight: {}", spread(1));
        assert!(spread(80) > 230, "ten pixels wide: {}", spread(80));
    }

    #[test]
    fn exposure_darkens_blurs_and_adds_noise() {
        let mut scene = Scene { width: 64, height: 64, rgb: vec![[0.0; 3]; 64 * 64] };
        scene.rgb[32 * 64 + 32] = [200.0 * core::f32::consts::TAU * 9.0; 3];
        let frame = scene.clone().expose(&Exposure { gain: 0.5, blur_px: 3.0, noise: 0.0 }, &mut Random::new(1));
        let at = |x: usize, y: usize| bytes(&frame)[3 * (y * 64 + x)];
        // A point becomes a bell of height 1 / (2 pi sigma^2).
        assert!(at(32, 32).abs_diff(100) < 2 && at(35, 32).abs_diff(61) < 2, "{} {}", at(32, 32), at(35, 32));
        assert_eq!(at(35, 32), at(32, 35));
        let gray = Scene { width: 64, height: 64, rgb: vec![[128.0; 3]; 64 * 64] };
        let noisy = gray.expose(&Exposure { noise: 10.0, ..CLEAR }, &mut Random::new(1));
        let square = |&b: &u8| (f32::from(b) - 128.0) * (f32::from(b) - 128.0);
        let spread = (bytes(&noisy).iter().map(square).sum::<f32>() / (3.0 * 64.0 * 64.0)).sqrt();
        assert!((spread - 10.0).abs() < 0.5, "{spread}");
    }

    /// The scene as a frame, without blur and noise.
    fn seen(scene: &Scene) -> Picture {
        scene.clone().expose(&CLEAR, &mut Random::new(1))
    }

    #[test]
    fn a_photograph_fills_the_frame_and_no_more_of_the_picture_than_there_is() {
        // Darker to the right: a part shows some of it, in order or mirrored.
        let ramp = Picture {
            width: 200,
            height: 50,
            pixels: Pixels::Gray8((0..10_000).map(|i| 250 - (i % 200) as u8).collect()),
        };
        let mut mirrored = 0;
        for seed in 0..20 {
            let scene = Scene::photograph(64, 64, &Print::new(&ramp), &mut Random::new(seed));
            let frame = seen(&scene);
            let row: Vec<u8> = bytes(&frame)[..3 * 64].chunks_exact(3).map(|p| p[0]).collect();
            let rises = row.windows(2).all(|w| w[0] <= w[1]);
            assert!(rises || row.windows(2).all(|w| w[0] >= w[1]), "{row:?}");
            assert!(row.iter().all(|&v| v >= 51), "nothing but the picture: {row:?}");
            // 64 px of the frame are at most 50 of the picture, and at least two thirds of these.
            assert!((30..=50).contains(&row[0].abs_diff(row[63])), "{row:?}");
            mirrored += usize::from(rises);
        }
        assert!((5..=15).contains(&mirrored), "{mirrored} of 20");
    }

    #[test]
    fn as_much_is_hidden_as_is_asked_for() {
        let print = Print::new(&flat(200, 100, 200));
        let other = Print::new(&flat(30, 30, 50));
        let pose = Pose { rotation_deg: 30.0, tilt_deg: 20.0, axis_deg: 20.0, ..FRONT };
        for (seed, share) in [(1, 0.1), (2, 0.3), (3, 0.5), (4, 0.8)] {
            let mut scene = Scene { width: 120, height: 100, rgb: vec![[0.0; 3]; 12_000] };
            let h = scene.lay(&print, &pose);
            scene.hide(&print, &h, share, &other, &mut Random::new(seed));
            let left = bytes(&seen(&scene)).iter().filter(|&&v| v > 125).count() as f32 / 3.0;
            let hidden = 1.0 - left / area(&h.outline(200.0, 100.0));
            assert!((hidden - share).abs() < 0.05, "{hidden} hidden of {share}");
        }
        let mut scene = Scene { width: 120, height: 100, rgb: vec![[0.0; 3]; 12_000] };
        let h = scene.lay(&print, &pose);
        let before = scene.rgb.clone();
        scene.hide(&print, &h, 0.0, &other, &mut Random::new(1));
        assert_eq!(scene.rgb, before, "nothing is hidden");
    }

    #[test]
    fn a_tint_multiplies_each_channel() {
        let mut scene = Scene { width: 1, height: 1, rgb: vec![[100.0; 3]] };
        scene.tint([0.5, 1.0, 1.2]);
        assert_eq!(bytes(&seen(&scene)), [50, 100, 120]);
    }

    #[test]
    fn a_frame_is_the_same_bytes_wherever_it_is_made() {
        let mut random = Random::of(&[1, 2, 3]);
        let object = Scene::dead_leaves(90, 60, &mut random).expose(&CLEAR, &mut random);
        let mut scene = Scene::dead_leaves(160, 120, &mut random);
        let tilted = Pose { tilt_deg: 30.0, axis_deg: 70.0, rotation_deg: 200.0, ..FRONT };
        let pose = scene.somewhere((90.0, 60.0), tilted, &mut random);
        let h = scene.lay(&Print::new(&object), &pose);
        scene.cover([40.0, 30.0], [20.0, 30.0], &mut random);
        assert!(h.outline(90.0, 60.0).iter().flatten().all(|&v| (0.0..160.0).contains(&v)), "{pose:?} is outside");
        let frame = scene.expose(&Exposure { gain: 0.8, blur_px: 1.0, noise: 4.0 }, &mut random);
        assert_eq!(keygraph_core::stages::model::crc32(bytes(&frame)), 0xe9ba_21bb, "CRC-32 of the frame");
    }
}
