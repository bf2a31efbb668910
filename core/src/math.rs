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

/// Largest integer whose square is not above `n`.
///
/// The seed is a float square root, right to 24 bits; the loops mend the rest, so
/// that the result is exact for every `n` up to 2^62 (at most one step below
/// 2^48, which is where the corners use it).
#[must_use]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub fn isqrt(n: u64) -> u32 {
    let mut r = u64::from(sqrt(n as f32) as u32);
    while r * r > n {
        r -= 1;
    }
    while (r + 1) * (r + 1) <= n {
        r += 1;
    }
    r as u32
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
    fn isqrt_is_exact_around_squares() {
        for r in [0u64, 1, 2, 3, 255, 4096, 65_535, 1 << 20, (1 << 24) + 1, (1 << 31) - 1] {
            let n = r * r;
            assert_eq!(u64::from(isqrt(n)), r);
            assert_eq!(u64::from(isqrt(n + 2 * r)), r);
            if r > 0 {
                assert_eq!(u64::from(isqrt(n - 1)), r - 1);
            }
        }
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
