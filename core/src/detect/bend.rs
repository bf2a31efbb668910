//! How a picture on paper is bent: the shape of a surface that bends along one direction.
//!
//! In: a few numbers. Out: where the places of the flat picture lie in the plane of its homography.
//!
//! Paper does not stretch: a label on a can and the page of a book bend along one direction of the picture
//! and are straight across it. Along that direction the angle of the paper is a polynomial of the length
//! (Legendre, without its constant, which the homography has). Its cosine adds up to the place along the
//! direction, its sine to the height over the plane. A camera maps the plane by a homography and the height
//! along the image of the normal. Both together are a camera's map of the bent paper, whatever its lens's
//! focal length.
//!
//! Coordinates are those of a picture with its middle at the origin and a longer side of 1.
//!
//! Memory: about 1 KB of stack. Cost: about 30 operations for each place, and 32 sines.

use crate::base::geometry::Homography;
use crate::base::math;

/// Number of terms of the angle along the direction.
pub(crate) const TERMS: usize = 4;

/// Number of numbers that a shape has.
pub(crate) const SHAPE: usize = 4 + TERMS;

/// Number of intervals in which the angle is added up.
const STEPS: usize = 32;

/// A shape: the direction along which the paper bends, as an angle from the x axis, radians; the image of
/// the plane's normal, as what a height of 1 adds to homogeneous coordinates in the plane; the
/// coefficients of the angle, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Bend(pub(crate) [f32; SHAPE]);

/// Half of the longest length: half of the diagonal of a square.
pub(crate) const REACH: f32 = 0.7072;

/// Place along the direction and height over the plane, at equal lengths of paper.
struct Profile {
    at: [[f32; 2]; STEPS + 1],
}

/// The angle of the paper at `t`, -1 to 1.
fn angle(c: &[f32], t: f32) -> f32 {
    let t2 = t * t;
    let terms = [t, 1.5 * t2 - 0.5, (2.5 * t2 - 1.5) * t, (4.375 * t2 - 3.75) * t2 + 0.375];
    terms.iter().zip(c).map(|(t, c)| t * c).sum()
}

impl Profile {
    const NONE: Self = Self { at: [[0.0; 2]; STEPS + 1] };

    fn set(&mut self, c: &[f32]) {
        let at = &mut self.at;
        at[0] = [0.0; 2];
        let step = 2.0 * REACH / STEPS as f32;
        for i in 0..STEPS {
            let (sin, cos) = math::sin_cos(angle(c, (2 * i + 1) as f32 / STEPS as f32 - 1.0));
            at[i + 1] = [at[i][0] + cos * step, at[i][1] + sin * step];
        }
        let [x, z] = at[STEPS / 2];
        for p in at {
            *p = [p[0] - x, p[1] - z];
        }
    }

    /// Place and height at the length `q` from the middle.
    fn at(&self, q: f32) -> [f32; 2] {
        let t = (q / REACH + 1.0) * (STEPS as f32 / 2.0);
        let i = usize::try_from(math::floor(t)).unwrap_or(0).min(STEPS - 1);
        let t = t - i as f32;
        let (a, b) = (self.at[i], self.at[i + 1]);
        [0, 1].map(|k| a[k] + (b[k] - a[k]) * t)
    }
}

impl Bend {
    /// Flat paper.
    pub(crate) const FLAT: Self = Self([0.0; SHAPE]);

    /// Paper that bends along the direction `angle` by `turn` radians from its middle to its end, with the
    /// normal `d`.
    pub(crate) const fn new(angle: f32, d: [f32; 3], turn: f32) -> Self {
        let mut v = [0.0; SHAPE];
        (v[0], v[1], v[2], v[3], v[4]) = (angle, d[0], d[1], d[2], turn);
        Self(v)
    }

    /// The sheet of this shape.
    pub(crate) fn sheet(&self) -> Sheet {
        let mut sheet = Sheet::FLAT;
        sheet.set(self);
        sheet
    }
}

/// Paper of a shape, with its profile computed.
pub(crate) struct Sheet {
    profile: Profile,
    direction: [f32; 2],
    normal: [f32; 3],
}

impl Sheet {
    /// A sheet before it has a shape.
    pub(crate) const FLAT: Self = Self { profile: Profile::NONE, direction: [1.0, 0.0], normal: [0.0; 3] };

    /// Gives it a shape, in place.
    #[inline(never)]
    pub(crate) fn set(&mut self, bend: &Bend) {
        let [angle, d0, d1, d2, turns @ ..] = &bend.0;
        let (sin, cos) = math::sin_cos(*angle);
        self.profile.set(turns);
        (self.direction, self.normal) = ([cos, sin], [*d0, *d1, *d2]);
    }

    /// Where a place of the flat picture is in the plane.
    pub(crate) fn at(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let ([cos, sin], [d0, d1, d2]) = (self.direction, self.normal);
        let (q, r) = (x * cos + y * sin, y * cos - x * sin);
        let [p, z] = self.profile.at(q);
        let w = 1.0 + z * d2;
        [(p * cos - r * sin + z * d0) / w, (p * sin + r * cos + z * d1) / w]
    }
}

/// The normal of the plane that `h` maps to a frame whose middle is `centre`, seen by a camera with the focal
/// length `f`, all px: what a height of 1 adds to homogeneous coordinates in the plane. `None` for a plane
/// that is seen from its edge.
pub(crate) fn normal(h: &Homography, centre: [f32; 2], f: f32) -> Option<[f32; 3]> {
    let m = Homography::affine([1.0 / f, 0.0, -centre[0] / f, 0.0, 1.0 / f, -centre[1] / f]).after(h).0;
    let cross = [m[3] * m[7] - m[6] * m[4], m[6] * m[1] - m[0] * m[7], m[0] * m[4] - m[3] * m[1]];
    let length = math::sqrt(cross.iter().map(|v| v * v).sum());
    let n = cross.map(|v| v / math::sqrt(length));
    // The camera's image of the normal, carried back into the plane.
    let image = [f * n[0] + centre[0] * n[2], f * n[1] + centre[1] * n[2], n[2]];
    let back = h.inverse()?.0;
    let d = [0, 3, 6].map(|r| back[r] * image[0] + back[r + 1] * image[1] + back[r + 2] * image[2]);
    d.iter().all(|v| v.is_finite()).then_some(d)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACES: [[f32; 2]; 4] = [[-0.5, -0.3], [0.0, 0.0], [0.25, 0.3], [0.5, 0.1]];

    fn placed(bend: &Bend) -> [[f32; 2]; 4] {
        let sheet = bend.sheet();
        PLACES.map(|p| sheet.at(p))
    }

    #[test]
    fn flat_paper_stays_where_it_is_and_a_can_is_round() {
        for (p, q) in PLACES.iter().zip(placed(&Bend::new(0.7, [0.1, 0.2, 0.3], 0.0))) {
            assert!((p[0] - q[0]).abs() < 1e-5 && (p[1] - q[1]).abs() < 1e-5, "{p:?} {q:?}");
        }
        // Half a turn over a length of 1, seen from far away in front.
        let quarter = core::f32::consts::FRAC_PI_2;
        for (p, q) in PLACES.iter().zip(placed(&Bend::new(0.0, [0.0; 3], quarter * (REACH / 0.5)))) {
            let radius = 0.5 / quarter;
            let x = radius * math::sin_cos(p[0] / radius).0;
            assert!((q[0] - x).abs() < 1e-3 && (q[1] - p[1]).abs() < 1e-5, "{q:?} is not at {x}");
        }
    }

    #[test]
    fn the_normal_of_a_plane_seen_from_the_front_points_into_the_frame() {
        let h = Homography::affine([200.0, 0.0, 320.0, 0.0, 200.0, 240.0]);
        let d = normal(&h, [320.0, 240.0], 600.0).unwrap();
        // The plane is three sizes away: a height of 1 takes a third of the way.
        assert!(d[0].abs() < 1e-5 && d[1].abs() < 1e-5 && (d[2].abs() - 1.0 / 3.0).abs() < 1e-4, "{d:?}");
    }
}
