//! Halves rows of luma and of chroma.
//!
//! In: two rows. Out: one row of half the length, each value the mean of a 2x2 square. Several
//! bytes are added in one word: eight bytes where the target has vectors, else four. The means are
//! the same.
//!
//! Memory: none. Cost: some two operations a byte.

use crate::image::pixels::NO_CHROMA;

/// A type that holds chroma in one byte.
pub(crate) trait Byte: Copy {
    /// Returns the bits of the number.
    fn bits(self) -> u8;
    /// Returns the number that has these bits.
    fn from_bits(bits: u8) -> Self;
}

impl Byte for u8 {
    fn bits(self) -> u8 {
        self
    }

    fn from_bits(bits: u8) -> Self {
        bits
    }
}

impl Byte for i8 {
    fn bits(self) -> u8 {
        self.cast_unsigned()
    }

    fn from_bits(bits: u8) -> Self {
        bits.cast_signed()
    }
}

/// Makes a module that halves rows, as many bytes at a time as a word has.
macro_rules! halve_by {
    ($name:ident, $word:ty) => {
        mod $name {
            use super::{Byte, NO_CHROMA, chroma_mean};

            type Word = $word;

            /// Number of bytes that are halved together.
            const WORD: usize = size_of::<Word>();

            /// Mask of the lower byte of each 16-bit part. `ONES` has the number 1 in each part.
            const EVEN: Word = Word::MAX / 0xffff * 0xff;
            const ONES: Word = Word::MAX / 0xffff;

            /// Returns the means of the 2x2 squares of two words, `low` lying below `top`. Halves are
            /// rounded up. The means fill the first half of the result.
            #[inline(always)]
            const fn means(top: Word, low: Word) -> [u8; WORD] {
                let sums = (top & EVEN) + (top >> 8 & EVEN) + (low & EVEN) + (low >> 8 & EVEN) + 2 * ONES;
                let means = sums >> 2 & EVEN;
                let pairs = (means | means >> 8) & (Word::MAX / 0xffff_ffff * 0xffff);
                (pairs | pairs >> 16).to_le_bytes()
            }

            /// Halves two rows of luma to one row. Each result is the mean of a 2x2 square.
            pub(crate) fn halve_luma(top: &[u8], low: &[u8], out: &mut [u8]) {
                let (words, rest) = out.as_chunks_mut::<{ WORD / 2 }>();
                let ((top, top_rest), (low, low_rest)) = (top.as_chunks(), low.as_chunks());
                for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                    let means = means(Word::from_le_bytes(*top), Word::from_le_bytes(*low));
                    *out = core::array::from_fn(|i| means[i]);
                }
                let word =
                    |row: &[u8]| Word::from_le_bytes(core::array::from_fn(|i| row.get(i).copied().unwrap_or_default()));
                rest.copy_from_slice(&means(word(top_rest), word(low_rest))[..rest.len()]);
            }

            /// Halves two rows of chroma to one row. Each result is the mean of the pixels of a 2x2
            /// square that have chroma. A square with fewer than two of them has no chroma.
            pub(crate) fn halve_chroma<T: Byte>(top: &[T], low: &[T], out: &mut [T]) {
                // XOR with this mask gives the number plus 128. The byte that means no chroma becomes 0.
                const SIGN: Word = Word::MAX / 0xff * 0x80;
                const { assert!(NO_CHROMA.cast_unsigned() == 0x80, "no chroma is the byte that is 0 here") };
                let word = |row: &[T; WORD]| Word::from_le_bytes(core::array::from_fn(|i| row[i].bits())) ^ SIGN;
                // This sets the highest bit of the first byte that is 0, and perhaps of bytes above it.
                let zeros = |word: Word| word.wrapping_sub(SIGN >> 7) & !word;
                let (words, rest) = out.as_chunks_mut::<{ WORD / 2 }>();
                let ((top, top_rest), (low, low_rest)) = (top.as_chunks(), low.as_chunks());
                let mut lacking = 0;
                for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                    let (top, low) = (word(top), word(low));
                    lacking |= zeros(top) | zeros(low);
                    let means = means(top, low);
                    *out = core::array::from_fn(|i| T::from_bits(means[i] ^ 0x80));
                }
                let square = |top: &[T], low: &[T]| {
                    T::from_bits(
                        chroma_mean([top[0], top[1], low[0], low[1]].map(T::bits).map(u8::cast_signed)).cast_unsigned(),
                    )
                };
                if lacking & SIGN != 0 {
                    for ((out, top), low) in words.iter_mut().zip(top).zip(low) {
                        let words = [word(top), word(low)];
                        // When all pixels of both words lack chroma, their means above lack it already.
                        if (zeros(words[0]) | zeros(words[1])) & SIGN != 0 && words != [0; 2] {
                            *out = core::array::from_fn(|i| square(&top[2 * i..], &low[2 * i..]));
                        }
                    }
                }
                for ((out, top), low) in
                    rest.iter_mut().zip(top_rest.as_chunks::<2>().0).zip(low_rest.as_chunks::<2>().0)
                {
                    *out = square(top, low);
                }
            }
        }
    };
}

// Words of eight bytes make good vectors; without vectors a word is what a register holds.
#[cfg(any(test, target_feature = "sse2", target_feature = "neon", target_feature = "simd128"))]
halve_by!(by_eight, u64);
#[cfg(any(test, not(any(target_feature = "sse2", target_feature = "neon", target_feature = "simd128"))))]
halve_by!(by_four, u32);

#[cfg(any(target_feature = "sse2", target_feature = "neon", target_feature = "simd128"))]
pub(crate) use by_eight::{halve_chroma, halve_luma};
#[cfg(not(any(target_feature = "sse2", target_feature = "neon", target_feature = "simd128")))]
pub(crate) use by_four::{halve_chroma, halve_luma};

/// Returns the mean of the pixels that have chroma. With fewer than two of them there is no chroma.
fn chroma_mean(p: [i8; 4]) -> i8 {
    let (mut sum, mut n) = (0i16, 0i16);
    for v in p {
        if v != NO_CHROMA {
            sum += i16::from(v);
            n += 1;
        }
    }
    #[allow(clippy::cast_possible_truncation, reason = "a mean of i8")]
    match n {
        4 => ((sum + 2) >> 2) as i8,
        2 | 3 => (sum / n) as i8,
        _ => NO_CHROMA,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chroma_mean_leaves_out_what_has_none() {
        assert_eq!(chroma_mean([10, NO_CHROMA, 20, NO_CHROMA]), 15);
        assert_eq!(chroma_mean([10, NO_CHROMA, NO_CHROMA, NO_CHROMA]), NO_CHROMA);
        assert_eq!(chroma_mean([-4, -4, -4, -4]), -4);
    }

    /// Rows of all lengths are halved. In some words all pixels have chroma, in some a part, in
    /// some none.
    #[test]
    fn rows_halved_by_words_are_means_of_squares() {
        let noise = |i: usize, seed: usize| ((i + 1) * (seed + 77)) as u32;
        let noise = |i, seed| noise(i, seed).wrapping_mul(2_654_435_761) >> 7;
        for seed in 0..40 {
            for n in 1..40 {
                let luma: [std::vec::Vec<u8>; 2] =
                    [0, 1].map(|r| (0..2 * n + n % 2).map(|i| noise(i, seed + 50 * r) as u8).collect());
                let lacks = |i: usize| i % 16 > 8 && (seed % 3 == 0 || noise(i / 2, seed) % 5 < 2);
                let chroma = luma.clone().map(|row| {
                    let value = |(i, v): (usize, u8)| if lacks(i) { NO_CHROMA } else { v.cast_signed() };
                    row.into_iter().enumerate().map(value).collect::<std::vec::Vec<i8>>()
                });
                let (mut halves, mut halves_of_chroma) = (std::vec![0; n], std::vec![0; n]);
                by_four::halve_luma(&luma[0], &luma[1], &mut halves);
                by_four::halve_chroma(&chroma[0], &chroma[1], &mut halves_of_chroma);
                let (mut by_eight, mut chroma_by_eight) = (std::vec![0; n], std::vec![0; n]);
                by_eight::halve_luma(&luma[0], &luma[1], &mut by_eight);
                by_eight::halve_chroma(&chroma[0], &chroma[1], &mut chroma_by_eight);
                assert_eq!((&by_eight, &chroma_by_eight), (&halves, &halves_of_chroma));
                for i in 0..n {
                    let square = [luma[0][2 * i], luma[0][2 * i + 1], luma[1][2 * i], luma[1][2 * i + 1]];
                    assert_eq!(u16::from(halves[i]), (square.map(u16::from).iter().sum::<u16>() + 2) / 4);
                    let square = [chroma[0][2 * i], chroma[0][2 * i + 1], chroma[1][2 * i], chroma[1][2 * i + 1]];
                    assert_eq!(halves_of_chroma[i], chroma_mean(square), "{square:?}");
                }
            }
        }
    }
}
