//! Coordinates of a picture in a scaled copy of it.
//!
//! In: the factor from px of the picture to px of the copy. Out: the map between them. A
//! pixel's centre lies at whole numbers, so that x becomes (x + 1/2) * factor - 1/2.
//! Memory and cost: a few numbers.

use keygraph_core::Homography;

/// Maps one coordinate from a picture to a copy that has `factor` px per px of the picture.
#[must_use]
pub fn scaled(v: f32, factor: f32) -> f32 {
    (v + 0.5) * factor - 0.5
}

/// The homography that maps points of a picture to a copy that has `x` times as many columns
/// and `y` times as many rows.
#[must_use]
pub const fn scaling([x, y]: [f32; 2]) -> Homography {
    Homography::affine([x, 0.0, x / 2.0 - 0.5, 0.0, y, y / 2.0 - 0.5])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_homography_and_its_scalar_form_agree() {
        for factor in [0.25, 0.5, 1.0, 3.0] {
            let [x, y] = scaling([factor, 1.0]).apply([10.0, 7.0]);
            assert!((x - scaled(10.0, factor)).abs() < 1e-5 && (y - 7.0).abs() < 1e-5, "{factor}: {x}, {y}");
        }
    }

    #[test]
    fn the_edges_of_pixels_stay_edges() {
        assert_eq!((scaled(-0.5, 4.0), scaled(9.5, 4.0)), (-0.5, 39.5));
    }
}
