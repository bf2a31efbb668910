//! The only file that calls `libm` and `micromath`.
//!
//! In: `f32`. Out: `f32`, the same bits on every target: both crates compute
//! with plain IEEE additions, multiplications and divisions.
//!
//! `micromath` is used for [`coarse_atan2`] alone, where its error (0.0028 rad
//! at most) is far finer than the bin that the result falls into; everything
//! that ends in a coordinate goes through `libm`. Why, with figures:
//! `docs/decisions/0002-float-math.md`.

use micromath::F32Ext;

/// Square root, exactly rounded.
#[must_use]
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Square root, good to three ten-millionths, of a number that is 0 or larger than 1e-30:
/// plain arithmetic, so that compilers make vectors of it.
#[must_use]
pub fn coarse_sqrt(x: f32) -> f32 {
    // Newton's steps towards 1 / sqrt(x), from half the negative exponent.
    let start = f32::from_bits(0x5f37_59df_u32.wrapping_sub(x.to_bits() >> 1));
    let step = |y: f32| y * (1.5 - 0.5 * x * y * y);
    x * step(step(step(start)))
}

/// Natural logarithm.
#[must_use]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Base-2 logarithm.
#[must_use]
pub fn log2(x: f32) -> f32 {
    libm::log2f(x)
}

/// `e` to the power `x`.
#[must_use]
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// Sine and cosine of an angle in radians.
#[must_use]
pub fn sin_cos(x: f32) -> (f32, f32) {
    (libm::sinf(x), libm::cosf(x))
}

/// Angle of `(x, y)` in radians, in `(-pi, pi]`, good to 0.003 rad: for angle
/// and vote bins only. The angle of the null vector is 0.
#[must_use]
pub fn coarse_atan2(y: f32, x: f32) -> f32 {
    if x == 0.0 && y == 0.0 {
        return 0.0;
    }
    F32Ext::atan2(y, x)
}

/// Nearest integer, halves away from zero, saturating.
#[must_use]
#[allow(clippy::cast_possible_truncation)]
pub fn round(x: f32) -> i32 {
    (x + if x < 0.0 { -0.5 } else { 0.5 }) as i32
}

/// Largest integer not above `x`, saturating.
#[must_use]
#[allow(clippy::cast_possible_truncation)]
pub fn floor(x: f32) -> i32 {
    let i = x as i32;
    if x < i as f32 { i.saturating_sub(1) } else { i }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_sqrt_is_good_to_three_ten_millionths() {
        for i in 0..2000 {
            let x = 1e-3 * 1.02f32.powi(i % 1500) * (1.0 + i as f32 / 2000.0);
            let e = (coarse_sqrt(x) / sqrt(x) - 1.0).abs();
            assert!(e < 3e-7, "sqrt {x}: off by {e}");
        }
        assert_eq!(coarse_sqrt(0.0), 0.0);
    }

    #[test]
    fn coarse_atan2_is_good_to_three_milliradians() {
        for i in -314..=314 {
            let a = i as f32 / 100.0;
            let (s, c) = sin_cos(a);
            let e = (coarse_atan2(7.0 * s, 7.0 * c) - a).abs();
            assert!(e < 0.003, "angle {a}: off by {e}");
        }
        assert_eq!(coarse_atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn floor_and_round_of_negatives() {
        assert_eq!((floor(-0.5), floor(-1.0), floor(1.9)), (-1, -1, 1));
        assert_eq!((round(-0.5), round(-0.4), round(1.5)), (-1, 0, 2));
    }
}
