//! Points and the two exact predicates that the triangulation stands on.
//!
//! In: points in 1/16 px. Out: signs without rounding error. Coordinates are
//! never negative, so a difference fits 16 bits with its sign, products of two
//! fit `i32`, and the in-circle determinant fits `i64` (see [`in_circle`]).

/// A position in an image, in 1/16 px, pixel centres at multiples of 16.
///
/// Coordinates are never negative; 2047 px is the largest that fits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Point {
    /// Column, 1/16 px.
    pub x: i16,
    /// Row, 1/16 px.
    pub y: i16,
}

impl Point {
    /// The point at `(x, y)`, both in 1/16 px.
    #[must_use]
    pub const fn new(x: i16, y: i16) -> Self {
        Self { x, y }
    }

    /// Coordinates in px.
    #[must_use]
    pub fn px(self) -> [f32; 2] {
        [f32::from(self.x) / 16.0, f32::from(self.y) / 16.0]
    }

    fn minus(self, o: Self) -> (i64, i64) {
        (
            i64::from(i32::from(self.x) - i32::from(o.x)),
            i64::from(i32::from(self.y) - i32::from(o.y)),
        )
    }

    /// Squared distance to `o`, in (1/16 px)^2.
    #[must_use]
    pub fn distance2(self, o: Self) -> i64 {
        let (dx, dy) = self.minus(o);
        dx * dx + dy * dy
    }
}

/// Twice the signed area of the triangle `a b c`, in (1/16 px)^2: positive when
/// the turn from `a b` to `c` takes the x axis towards the y axis (clockwise on
/// a screen whose y axis points down).
#[must_use]
pub fn orient(a: Point, b: Point, c: Point) -> i64 {
    let (bx, by) = b.minus(a);
    let (cx, cy) = c.minus(a);
    bx * cy - by * cx
}

/// Positive when `d` lies inside the circle through `a b c`, negative outside,
/// zero on it; `a b c` must have positive orientation.
///
/// The determinant of the lifted points. Within a square of side L its absolute
/// value is at most 2 L^4 (take the origin in the middle, where each squared
/// norm is at most L^2/2, and add the four areas): 2^61 here. Partial sums may
/// wrap, which the final sum undoes.
#[must_use]
pub fn in_circle(a: Point, b: Point, c: Point, d: Point) -> i64 {
    let (ax, ay) = a.minus(d);
    let (bx, by) = b.minus(d);
    let (cx, cy) = c.minus(d);
    let (a2, b2, c2) = (ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy);
    let t = |n: i64, m: i64| n.wrapping_mul(m);
    t(a2, bx * cy - by * cx)
        .wrapping_add(t(b2, cx * ay - cy * ax))
        .wrapping_add(t(c2, ax * by - ay * bx))
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: fn(i16, i16) -> Point = Point::new;

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
}
