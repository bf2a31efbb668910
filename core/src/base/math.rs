//! This is the only file that calls `libm` and `micromath`.
//!
//! In: `f32`. Out: `f32`, with the same bits on every target. Both crates compute with plain IEEE
//! additions, multiplications and divisions.
//!
//! `micromath` is used for [`coarse_atan2`] only. Its error there (at most 0.0028 rad) is far finer
//! than the bin that the result falls into. `libm` gives [`sqrt`] and [`atan`], which a search does not
//! call; the other functions are ours. `docs/decisions/0002-float-math.md` gives the reasons and the figures.

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
#[inline(never)]
#[must_use]
pub fn coarse_sqrt(x: f32) -> f32 {
    inline_sqrt(x)
}

/// [`coarse_sqrt`] within its caller: plain arithmetic, so that compilers make vectors of it.
#[inline(always)]
pub(crate) fn inline_sqrt(x: f32) -> f32 {
    // Newton's steps towards 1 / sqrt(x) start from half the negative exponent.
    let start = f32::from_bits(0x5f37_59df_u32.wrapping_sub(x.to_bits() >> 1));
    let step = |y: f32| y * (1.5 - 0.5 * x * y * y);
    x * step(step(step(start)))
}

/// Returns the natural logarithm, as exact as [`log2`].
#[must_use]
pub fn ln(x: f32) -> f32 {
    log2(x) * core::f32::consts::LN_2
}

/// Returns the base-2 logarithm of a number above 1e-37, with an error below 2e-7 of the result or of 1,
/// whichever is more. Powers of two are exact. For 0, a negative number and NaN the result is some number.
///
/// The function takes the exponent apart, and sums the first terms of the series of the rest. It takes 128 bytes of a
/// board's flash, the library's takes 308.
#[inline(never)]
#[must_use]
pub fn log2(x: f32) -> f32 {
    // From a root of a half on, so that the rest lies about 1.
    const START: u32 = core::f32::consts::FRAC_1_SQRT_2.to_bits();
    let above = x.to_bits().wrapping_sub(START).cast_signed();
    let rest = f32::from_bits(START + (above.cast_unsigned() & 0x7f_ffff));
    let s = (rest - 1.0) / (rest + 1.0);
    let z = s * s;
    let series = 1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0)));
    (above >> 23) as f32 + 2.0 * core::f32::consts::LOG2_E * s * series
}

/// Returns `e` to the power `x`, with a relative error below 4e-7. Below -87 and above 88 the result is that of
/// the limit.
///
/// The function takes whole powers of two apart, and sums the first terms of the series. It takes 208 bytes of a
/// board's flash, the library's takes 460.
#[inline(never)]
#[must_use]
pub fn exp(x: f32) -> f32 {
    // The logarithm of two in two parts. The first part has few bits, so that its multiples are exact.
    const LN_2: [f32; 2] = [0.693_145_75, 1.428_606_8e-6];
    let x = x.clamp(-87.0, 88.0);
    let power = round(x * core::f32::consts::LOG2_E);
    let r = x - power as f32 * LN_2[0] - power as f32 * LN_2[1];
    let more = 1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0));
    let e = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * more)));
    e * f32::from_bits((power + 127).cast_unsigned() << 23)
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
    fn log2_is_good_to_2e_7() {
        for i in 0..40_000 {
            let x = 1e-37 * 1.004f32.powi(i);
            if x.is_infinite() {
                break;
            }
            let expected = f64::from(x).log2();
            let e = (f64::from(log2(x)) - expected).abs() / expected.abs().max(1.0);
            assert!(e < 2e-7, "log2 {x}: off by {e}");
        }
        assert_eq!((log2(1.0), log2(2.0), log2(0.25), ln(1.0)), (0.0, 1.0, -2.0, 0.0));
    }

    #[test]
    fn exp_is_good_to_4e_7() {
        for i in -8700..=8800 {
            let x = i as f32 / 100.0;
            let e = f64::from(exp(x)) / f64::from(x).exp() - 1.0;
            assert!(e.abs() < 4e-7, "exp {x}: off by {e}");
        }
        assert_eq!((exp(0.0), exp(-1e9), exp(1e9)), (1.0, exp(-87.0), exp(88.0)));
        assert!(exp(f32::NAN).is_nan());
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
