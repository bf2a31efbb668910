//! Sorts in place, in a stack whose size is known beforehand.
//!
//! In: a slice and an order. Out: the slice in that order.
//!
//! The sort of `core` calls itself up to 2 log2 n times deep, and each call has room for 48
//! elements. On a board with 8 KB of stack, 800 corners in an unlucky order overflow it. Boards
//! therefore use the sort of D. Shell (*A High-Speed Sorting Procedure*, CACM 1959), which does not
//! call itself, with the gaps of M. Ciura (*Best Increments for the Average Case of Shellsort*, FCT
//! 2001). Processors with vectors have enough stack. They use the sort of `core`, which is faster.
//!
//! Memory: one element on a board. Cost: 15 comparisons an element for 1,000 elements. Equal
//! elements end up in any order, and the order differs between machines. Keys must therefore
//! differ.

use core::cmp::Ordering;

use crate::base::math::VECTORS;
use crate::base::pace::{Pace, Steady};

/// The gaps up to 701 are Ciura's. Two more are for larger frames than he had; the largest is 2.25
/// times the one below it.
const GAPS: [usize; 10] = [3937, 1750, 701, 301, 132, 57, 23, 10, 4, 1];

/// Number of elements after which a sort asks whether it goes on.
const STRIDE: usize = 512;

/// Sorts a slice by a key, in ascending order. When it is told to stop, the order is any.
pub fn sort_by_key<T: Copy, K: Ord>(values: &mut [T], key: impl Fn(&T) -> K, pace: &mut dyn Pace) {
    sort_at(values, |a, b| key(a) < key(b), pace);
}

/// Sorts a slice so that no element is `less` than the one before it.
pub fn sort<T: Copy>(values: &mut [T], less: impl Fn(&T, &T) -> bool) {
    sort_at(values, less, &mut Steady);
}

fn sort_at<T: Copy>(values: &mut [T], less: impl Fn(&T, &T) -> bool, pace: &mut dyn Pace) {
    if VECTORS {
        values.sort_unstable_by(|a, b| match (less(a, b), less(b, a)) {
            (true, _) => Ordering::Less,
            (false, true) => Ordering::Greater,
            (false, false) => Ordering::Equal,
        });
    } else {
        shell_sort(values, less, pace);
    }
}

fn shell_sort<T: Copy>(values: &mut [T], less: impl Fn(&T, &T) -> bool, pace: &mut dyn Pace) {
    for gap in GAPS {
        for i in gap..values.len() {
            if (i - gap).is_multiple_of(STRIDE) && !pace.goes_on() {
                return;
            }
            let value = values[i];
            let mut at = i;
            while at >= gap && less(&value, &values[at - gap]) {
                values[at] = values[at - gap];
                at -= gap;
            }
            values[at] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Returns orders of `n` elements that are hard for one sort or another.
    fn orders(n: u32) -> [Vec<u32>; 6] {
        let noise = |i: u32| (i + 1).wrapping_mul(2_654_435_761) >> 7;
        [
            (0..n).collect(),
            (0..n).rev().collect(),
            (0..n).map(|_| 7).collect(),
            (0..n).map(noise).collect(),
            (0..n).map(|i| noise(i) % 5).collect(),
            (0..n).map(|i| i.min(n - i)).collect(),
        ]
    }

    #[test]
    fn it_sorts_like_the_sort_of_std() {
        for n in (0..70).chain([132, 133, 800, 4500]) {
            for (o, order) in orders(n).into_iter().enumerate() {
                let (mut sorted, mut by_shell, mut expected) = (order.clone(), order.clone(), order);
                sort_by_key(&mut sorted, |&v| v, &mut Steady);
                shell_sort(&mut by_shell, |a, b| a < b, &mut Steady);
                expected.sort_unstable();
                assert_eq!(sorted, expected, "order {o} of {n}");
                assert_eq!(by_shell, expected, "order {o} of {n}");
            }
        }
    }

    #[test]
    fn floats_have_an_order_too() {
        let mut values = [0.5, f32::NAN, -1.0, f32::INFINITY, -0.0, 0.0];
        sort(&mut values, |a, b| a.total_cmp(b).is_lt());
        assert_eq!(values.map(f32::to_bits)[..3], [-1.0, -0.0, 0.0].map(f32::to_bits));
        assert!(values[5].is_nan() && values[4] == f32::INFINITY, "{values:?}");
    }

    #[test]
    fn the_cost_is_what_the_file_says() {
        let count = std::cell::Cell::new(0);
        let mut values = orders(1000)[3].clone();
        let less = |a: &u32, b: &u32| {
            count.set(count.get() + 1);
            a < b
        };
        shell_sort(&mut values, less, &mut Steady);
        assert!((10_000..=16_000).contains(&count.get()), "{} comparisons", count.get());
    }
}
