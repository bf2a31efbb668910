//! This is the only file that calls `libm` and `micromath`.
//!
//! In: `f32`. Out: `f32`, with the same bits on every target. Both crates compute with plain IEEE
//! additions, multiplications and divisions.
//!
//! `micromath` is used for [`coarse_atan2`] only. Its error there (at most 0.0028 rad) is far finer
//! than the bin that the result falls into. Everything that ends in a coordinate goes through
//! `libm`. `docs/decisions/0002-float-math.md` gives the reasons and the figures.

use micromath::F32Ext;

/// Whether the target computes several numbers with one instruction. On such a target a value that
/// may not be needed is cheaper to compute than to test for, and loops over several numbers at once
/// are worth their code size. The results are the same on all targets.
pub(crate) const VECTORS: bool =
    cfg!(any(target_feature = "sse2", target_feature = "neon", target_feature = "simd128"));

/// Whether whole rows are worth computing side by side. The vectors of a Cortex-M55 are slow to fill
/// and to empty: they gain on whole rows alone.
pub(crate) const ROWS: bool = VECTORS || cfg!(feature = "vectors");

/// Returns the greater of two numbers. Neither may be NaN.
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Returns the smaller of two numbers. Neither may be NaN.
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the square root, exactly rounded.
#[must_use]
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Returns the square root with a relative error below 3e-7. `x` must be 0 or larger than 1e-30.
/// The function uses plain arithmetic, so that compilers make vectors of it.
#[must_use]
pub fn coarse_sqrt(x: f32) -> f32 {
    // Newton's steps towards 1 / sqrt(x) start from half the negative exponent.
    let start = f32::from_bits(0x5f37_59df_u32.wrapping_sub(x.to_bits() >> 1));
    let step = |y: f32| y * (1.5 - 0.5 * x * y * y);
    x * step(step(step(start)))
}

/// Returns the natural logarithm.
#[must_use]
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Returns the base-2 logarithm.
#[must_use]
pub fn log2(x: f32) -> f32 {
    libm::log2f(x)
}

/// Returns `e` to the power `x`.
#[must_use]
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// Returns the sine and the cosine of an angle in radians, with an error below 2e-7. The angle must
/// be a few turns at most.
///
/// The function removes whole quarter turns and sums the first terms of both series. The library's
/// function takes 6 KB of a board's flash, because it is right for any angle.
#[must_use]
pub fn sin_cos(x: f32) -> (f32, f32) {
    // A quarter turn in two parts. The first part has few bits, so that its multiples are exact.
    const QUARTER: [f32; 2] = [1.570_312_5, 4.838_268e-4];
    let quarters = round(x * core::f32::consts::FRAC_2_PI);
    let q = quarters as f32;
    let r = x - q * QUARTER[0] - q * QUARTER[1];
    let z = r * r;
    let sin = r * (1.0 + z * (-1.0 / 6.0 + z * (1.0 / 120.0 + z * (-1.0 / 5040.0 + z / 362_880.0))));
    let cos = 1.0 + z * (-0.5 + z * (1.0 / 24.0 + z * (-1.0 / 720.0 + z / 40_320.0)));
    match quarters.rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Returns the angle whose tangent is `x`, radians.
#[must_use]
pub fn atan(x: f32) -> f32 {
    libm::atanf(x)
}

/// Returns the angle of `(x, y)` in radians, in `(-pi, pi]`, with an error below 0.003 rad. Use it
/// for angle bins and vote bins only. The angle of the null vector is 0.
#[must_use]
pub fn coarse_atan2(y: f32, x: f32) -> f32 {
    if x == 0.0 && y == 0.0 {
        return 0.0;
    }
    F32Ext::atan2(y, x)
}

/// Returns the integer nearest to a number whose absolute value is below 2^22. Halves go to the
/// even integer. The function uses plain arithmetic, so that compilers make vectors of it. For a
/// larger number or NaN the result is some integer below 0 or above 2^21.
#[must_use]
pub fn whole(x: f32) -> i32 {
    // At this size the last bit of an `f32` counts one.
    const ONES: f32 = 12_582_912.0;
    (x + ONES).to_bits().wrapping_sub(ONES.to_bits()).cast_signed()
}

/// Returns the nearest integer, saturating. Halves go away from zero.
#[must_use]
#[allow(clippy::cast_possible_truncation)]
pub fn round(x: f32) -> i32 {
    (x + if x < 0.0 { -0.5 } else { 0.5 }) as i32
}

/// Returns the largest integer that is not above `x`, saturating.
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
    fn sin_cos_is_good_to_2e_7() {
        for i in -2000..=2000 {
            let x = i as f32 / 160.0;
            let (s, c) = sin_cos(x);
            let (es, ec) = (f64::from(s) - f64::from(x).sin(), f64::from(c) - f64::from(x).cos());
            assert!(es.abs().max(ec.abs()) < 2e-7, "{x}: off by {es} and {ec}");
        }
    }

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
