//! This file holds points, the two exact predicates of the triangulation, and projective maps of
//! the plane.
//!
//! In: points in 1/16 px. Out: signs without rounding error.
//!
//! Coordinates are never negative. The difference of two coordinates therefore fits 16 bits with
//! its sign, the product of two differences fits `i32`, and the in-circle determinant fits `i64`
//! (see [`in_circle`]).

/// A position in an image, in 1/16 px. Pixel centres lie at multiples of 16.
///
/// Coordinates are never negative. The largest coordinate that fits is 2047 px.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Point {
    /// Column, 1/16 px.
    pub x: i16,
    /// Row, 1/16 px.
    pub y: i16,
}

impl Point {
    /// Makes the point at `(x, y)`, both in 1/16 px.
    #[must_use]
    pub const fn new(x: i16, y: i16) -> Self {
        Self { x, y }
    }

    /// Returns the coordinates in px.
    #[must_use]
    pub fn px(self) -> [f32; 2] {
        [f32::from(self.x) / 16.0, f32::from(self.y) / 16.0]
    }

    /// Returns the point moved by `by`.
    pub(crate) const fn moved(self, by: Self) -> Self {
        Self { x: self.x.saturating_add(by.x), y: self.y.saturating_add(by.y) }
    }

    fn minus(self, o: Self) -> (i64, i64) {
        (i64::from(i32::from(self.x) - i32::from(o.x)), i64::from(i32::from(self.y) - i32::from(o.y)))
    }

    /// Returns the squared distance to `o`, in (1/16 px)^2.
    #[must_use]
    pub fn distance2(self, o: Self) -> i64 {
        let (dx, dy) = self.minus(o);
        dx * dx + dy * dy
    }
}

/// Returns twice the signed area of the triangle `a b c`, in (1/16 px)^2. The result is positive
/// when the turn from `a b` to `a c` takes the x axis towards the y axis (clockwise on a screen
/// whose y axis points down).
#[must_use]
pub fn orient(a: Point, b: Point, c: Point) -> i64 {
    let (bx, by) = b.minus(a);
    let (cx, cy) = c.minus(a);
    bx * cy - by * cx
}

/// Returns a positive number when `d` lies inside the circle through `a b c`, a negative number
/// when `d` lies outside, and zero when `d` lies on the circle. `a b c` must have positive
/// orientation.
///
/// The result is the determinant of the lifted points. Within a square of side L its absolute value
/// is at most 2 L^4, which is 2^61 here. (Take the origin in the middle, where each squared norm is
/// at most L^2/2, and add the four areas.) Partial sums may wrap; the final sum undoes it.
#[must_use]
pub fn in_circle(a: Point, b: Point, c: Point, d: Point) -> i64 {
    let (ax, ay) = a.minus(d);
    let (bx, by) = b.minus(d);
    let (cx, cy) = c.minus(d);
    let (a2, b2, c2) = (ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy);
    let t = |n: i64, m: i64| n.wrapping_mul(m);
    t(a2, bx * cy - by * cx).wrapping_add(t(b2, cx * ay - cy * ax)).wrapping_add(t(c2, ax * by - ay * bx))
}

/// The circle through three points of positive orientation, prepared for tests of many other
/// points. It is the determinant of [`in_circle`], expanded by its last point.
pub(crate) struct Circle {
    on: Point,
    factors: [i64; 3],
}

impl Circle {
    pub fn through(a: Point, b: Point, c: Point) -> Self {
        let ((bx, by), (cx, cy)) = (b.minus(a), c.minus(a));
        let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
        let t = |n: i64, m: i64| n.wrapping_mul(m);
        let factors = [t(cy, b2).wrapping_sub(t(by, c2)), t(bx, c2).wrapping_sub(t(cx, b2)), t(by, cx) - t(bx, cy)];
        Self { on: a, factors }
    }

    /// Returns whether a point lies inside the circle.
    pub fn holds(&self, p: Point) -> bool {
        let (x, y) = p.minus(self.on);
        let t = |n: i64, m: i64| n.wrapping_mul(m);
        t(self.factors[0], x).wrapping_add(t(self.factors[1], y)).wrapping_add(t(self.factors[2], x * x + y * y)) > 0
    }
}

/// A projective map of the plane, from px to px, as a row-major matrix. Pixel centres lie at
/// integers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Homography(pub [f32; 9]);

impl Homography {
    /// The map that changes nothing.
    pub const IDENTITY: Self = Self([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);

    /// Makes the affine map whose matrix has the rows `[a b c]`, `[d e f]` and `[0 0 1]`.
    #[must_use]
    pub const fn affine([a, b, c, d, e, f]: [f32; 6]) -> Self {
        Self([a, b, c, d, e, f, 0.0, 0.0, 1.0])
    }

    /// Makes the map from a picture to its copy that is `x` times as wide and `y` times as high.
    /// Pixel centres lie at integers in both.
    #[must_use]
    pub const fn scaling([x, y]: [f32; 2]) -> Self {
        Self::affine([x, 0.0, (x - 1.0) / 2.0, 0.0, y, (y - 1.0) / 2.0])
    }

    /// Makes the map from the corners `(0,0) (w,0) (w,h) (0,h)` of a picture to four places (P. Heckbert,
    /// *Fundamentals of Texture Mapping and Image Warping*, 1989, section 2.2.3). It is not finite when
    /// three of the places lie on a line.
    #[must_use]
    pub fn onto(p: &[[f32; 2]; 4], [w, h]: [f32; 2]) -> Self {
        let d1 = [0, 1].map(|i| p[1][i] - p[2][i]);
        let d2 = [0, 1].map(|i| p[3][i] - p[2][i]);
        let s = [0, 1].map(|i| p[0][i] - p[1][i] + p[2][i] - p[3][i]);
        let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
        let (g, k) = (cross(s, d2) / cross(d1, d2), cross(d1, s) / cross(d1, d2));
        let row = |i: usize| [p[1][i] - p[0][i] + g * p[1][i], p[3][i] - p[0][i] + k * p[3][i], p[0][i]];
        let ([a, b, c], [d, e, f]) = (row(0), row(1));
        Self([a / w, b / h, c, d / w, e / h, f, g / w, k / h, 1.0])
    }

    /// Returns the image of `p`. The result is not finite when the map sends `p` to infinity.
    #[must_use]
    #[cfg_attr(not(feature = "dispatch"), inline(never))]
    pub fn apply(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let h = &self.0;
        let w = h[6] * x + h[7] * y + h[8];
        [(h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w]
    }

    /// Returns the image of `p` under an affine map. The last row of the matrix is not used.
    #[must_use]
    pub fn apply_affine(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let h = &self.0;
        [h[0] * x + h[1] * y + h[2], h[3] * x + h[4] * y + h[5]]
    }

    /// Returns the map that applies `other` first and `self` second.
    #[inline(never)]
    #[must_use]
    pub fn after(&self, other: &Self) -> Self {
        let (a, b) = (&self.0, &other.0);
        Self(core::array::from_fn(|i| {
            let (r, c) = (i / 3 * 3, i % 3);
            a[r] * b[c] + a[r + 1] * b[c + 3] + a[r + 2] * b[c + 6]
        }))
    }

    /// Returns the inverse map, up to scale. Returns `None` when the map has no inverse.
    #[inline(never)]
    #[must_use]
    pub fn inverse(&self) -> Option<Self> {
        let h = &self.0;
        let minor = |a: usize, b: usize, c: usize, d: usize| h[a] * h[d] - h[b] * h[c];
        let cofactors = [
            minor(4, 5, 7, 8),
            -minor(1, 2, 7, 8),
            minor(1, 2, 4, 5),
            -minor(3, 5, 6, 8),
            minor(0, 2, 6, 8),
            -minor(0, 2, 3, 5),
            minor(3, 4, 6, 7),
            -minor(0, 1, 6, 7),
            minor(0, 1, 3, 4),
        ];
        let det = h[0] * cofactors[0] + h[1] * cofactors[3] + h[2] * cofactors[6];
        (det != 0.0 && det.is_finite()).then(|| Self(cofactors.map(|c| c / det)))
    }

    /// Returns the same map scaled so that its last element is 1. A map whose last element is 0 is
    /// returned as it is.
    #[inline(never)]
    #[must_use]
    pub fn normalised(&self) -> Self {
        let last = self.0[8];
        if last == 0.0 { *self } else { Self(self.0.map(|v| v / last)) }
    }

    /// Returns the images of the corners `(0,0) (w,0) (w,h) (0,h)` of a picture.
    #[inline(never)]
    #[must_use]
    pub fn outline(&self, width: f32, height: f32) -> [[f32; 2]; 4] {
        [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|p| self.apply(p))
    }
}

/// Returns the signed area of a polygon. The area is positive when the outline turns the x axis
/// towards the y axis.
#[inline(never)]
#[must_use]
pub fn area(outline: &[[f32; 2]]) -> f32 {
    let n = outline.len();
    let cross = |i: usize| {
        let ([x0, y0], [x1, y1]) = (outline[i], outline[(i + 1) % n]);
        x0 * y1 - x1 * y0
    };
    (0..n).map(cross).sum::<f32>() / 2.0
}

/// Returns whether a polygon with positive area turns the same way at every corner.
#[must_use]
pub fn is_convex(outline: &[[f32; 2]]) -> bool {
    let n = outline.len();
    (0..n).all(|i| {
        let [a, b, c] = [0, 1, 2].map(|k| outline[(i + k) % n]);
        (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) > 0.0
    })
}

/// Returns whether a convex polygon with positive area contains `p`. Its edges belong to it.
#[inline(never)]
#[must_use]
pub fn contains(outline: &[[f32; 2]], p: [f32; 2]) -> bool {
    let n = outline.len();
    (0..n).all(|i| {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: fn(i16, i16) -> Point = Point::new;

    #[test]
    fn a_circle_holds_what_lies_in_it() {
        let mut state = 7u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as i16 % 40
        };
        let mut inside = 0;
        for _ in 0..20_000 {
            let [a, b, c, d] = [(); 4].map(|()| P(next(), next()));
            if orient(a, b, c) > 0 {
                let circle = Circle::through(a, b, c);
                assert_eq!(circle.holds(d), in_circle(a, b, c, d) > 0, "{a:?} {b:?} {c:?} {d:?}");
                assert!([a, b, c].iter().all(|&p| !circle.holds(p)), "a vertex lies on it");
                inside += u32::from(circle.holds(d));
            }
        }
        assert!(inside > 1000, "{inside}");
    }

    #[test]
    fn orientation_is_exact_at_the_ends_of_the_range() {
        let m = i16::MAX;
        assert_eq!(orient(P(0, 0), P(m, m), P(m - 1, m - 1)), 0);
        assert!(orient(P(0, 0), P(m, m - 1), P(m, m)) > 0);
        assert!(orient(P(0, 0), P(m, m), P(m, m - 1)) < 0);
    }

    #[test]
    fn circle_through_the_corners_of_the_range() {
        let m = i16::MAX;
        let (a, b, c) = (P(0, 0), P(m, 0), P(m, m));
        assert!(orient(a, b, c) > 0);
        assert_eq!(in_circle(a, b, c, P(0, m)), 0);
        assert!(in_circle(a, b, c, P(1, m - 1)) > 0);
        assert!(in_circle(a, b, P(m - 1, m - 1), P(0, m)) < 0);
    }

    #[test]
    fn a_homography_and_its_inverse_cancel() {
        let h = Homography([1.2, 0.3, 40.0, -0.2, 0.9, 25.0, 4e-4, -3e-4, 1.0]);
        let back = h.inverse().unwrap();
        for p in [[0.0, 0.0], [100.0, 20.0], [300.0, 200.0]] {
            let q = back.apply(h.apply(p));
            assert!((q[0] - p[0]).abs() < 1e-2 && (q[1] - p[1]).abs() < 1e-2, "{p:?} came back as {q:?}");
        }
        let i = h.after(&back).normalised();
        assert!(i.0.iter().zip(Homography::IDENTITY.0).all(|(a, b)| (a - b).abs() < 1e-4), "{i:?}");
        assert!(Homography([0.0; 9]).inverse().is_none());
    }

    #[test]
    fn a_map_onto_an_outline_carries_corners_to_corners() {
        let outline = [[20.0, 30.0], [150.0, 10.0], [180.0, 160.0], [40.0, 120.0]];
        for (p, q) in Homography::onto(&outline, [100.0, 80.0]).outline(100.0, 80.0).iter().zip(&outline) {
            assert!((p[0] - q[0]).abs() < 1e-3 && (p[1] - q[1]).abs() < 1e-3, "{p:?} is not {q:?}");
        }
    }

    #[test]
    fn outlines_know_their_area_and_shape() {
        let square = Homography::IDENTITY.outline(4.0, 3.0);
        assert_eq!(area(&square), 12.0);
        assert!(is_convex(&square));
        assert!(contains(&square, [3.9, 0.1]) && !contains(&square, [4.1, 1.0]));
        let mut bow = square;
        bow.swap(2, 3);
        assert!(!is_convex(&bow));
    }
}
