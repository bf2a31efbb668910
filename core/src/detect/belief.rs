//! Says how far a pose can be believed.
//!
//! In: [`Scrutiny`]. Out: a score, the estimated probability that the pose is right. It is a sum of
//! small decision trees, fitted by gradient boosting (J. H. Friedman, *Greedy Function
//! Approximation*, 2001) on rendered and real frames: objects that are hidden, bent, dim and lit
//! unevenly, and look-alikes. All numbers are integers until the last step.
//!
//! Memory: a table of constants. Cost: three comparisons for each tree.

use crate::base::math;
use crate::detect::scrutiny::{PROPERTIES, Scrutiny};

/// A decision tree of three levels. Node `i` leads to nodes `2 i + 1` and `2 i + 2`: to the second
/// when its property is above its limit.
struct Tree {
    /// The property of each node, four bits each.
    property: [u8; 4],
    limit: [u8; 7],
    /// Log-odds of the eight ends.
    leaf: [i8; 8],
}

impl Tree {
    /// The tree with these properties, limits and ends.
    const fn new(property: [u8; 7], limit: [u8; 7], leaf: [i8; 8]) -> Self {
        let (mut packed, mut node) = ([0; 4], 0);
        while node < 7 {
            assert!((property[node] as usize) < PROPERTIES, "there is no such property");
            packed[node / 2] |= property[node] << (4 * (node % 2));
            node += 1;
        }
        Self { property: packed, limit, leaf }
    }

    /// The property of a node.
    fn property(&self, node: usize) -> usize {
        usize::from(self.property[node / 2] >> (4 * (node % 2)) & 15)
    }
}

/// Number of steps of a leaf in one unit of log-odds.
const STEPS: f32 = 32.0;

/// Log-odds without any tree, in steps: as fitted, and 66 more, so that half-hidden objects are found.
const BIAS: i32 = 64;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0023-small-cells.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([11, 3, 3, 5, 7, 5, 0], [121, 94, 86, 84, 225, 81, 65], [-5, 1, -8, -5, 4, 7, 1, 1]),
    Tree::new([11, 5, 3, 6, 3, 5, 2], [109, 63, 72, 236, 85, 84, 188], [-8, 0, 0, -7, 2, 6, 0, 2]),
    Tree::new([3, 5, 7, 0, 9, 2, 3], [88, 84, 225, 233, 93, 206, 150], [-2, 2, -2, 5, -7, -2, -2, -2]),
    Tree::new([11, 10, 3, 6, 5, 5, 0], [123, 251, 91, 238, 59, 80, 64], [-6, 0, -6, 0, 2, 5, 0, 0]),
    Tree::new([3, 5, 7, 0, 4, 2, 3], [91, 82, 223, 231, 14, 206, 130], [-2, 2, 1, 5, -6, -2, -2, -2]),
    Tree::new([6, 7, 3, 5, 5, 5, 0], [208, 203, 122, 204, 61, 84, 153], [-6, 0, -6, 0, 2, 4, 0, 0]),
    Tree::new([3, 5, 7, 0, 10, 4, 0], [94, 81, 222, 231, 237, 58, 62], [-2, 2, -2, 4, -2, -5, -2, -2]),
    Tree::new([5, 6, 3, 11, 2, 4, 5], [59, 236, 70, 145, 61, 61, 99], [-6, -2, 2, 0, 0, 5, -1, -5]),
    Tree::new([11, 6, 7, 5, 3, 11, 5], [97, 202, 203, 176, 88, 153, 59], [-5, -3, -1, -3, -1, 3, -1, 4]),
    Tree::new([10, 11, 5, 6, 10, 11, 3], [251, 153, 59, 234, 173, 145, 94], [-5, -1, -1, 3, -4, 1, 3, -3]),
    Tree::new([1, 10, 5, 11, 8, 7, 3], [34, 251, 176, 153, 135, 206, 59], [-1, 2, 3, -1, -4, -1, -1, -3]),
    Tree::new([5, 6, 3, 11, 2, 4, 7], [59, 236, 70, 145, 61, 61, 206], [-5, -1, 2, 0, 0, 4, -5, -1]),
    Tree::new([10, 11, 8, 6, 10, 7, 5], [251, 149, 146, 234, 187, 194, 176], [-5, -1, -1, 2, -1, 4, -4, 1]),
    Tree::new([5, 6, 3, 4, 1, 4, 5], [59, 228, 68, 195, 20, 61, 99], [-5, -2, 2, -1, 0, 4, -1, -4]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [244, 228, 140, 159, 173, 203, 176], [-5, -2, -1, 2, 0, 4, -4, 1]),
    Tree::new([6, 7, 7, 5, 5, 0, 3], [208, 201, 186, 204, 61, 229, 122], [-4, 0, -4, 0, 0, 2, 3, 0]),
    Tree::new([3, 5, 5, 4, 9, 1, 1], [150, 81, 0, 193, 82, 32, 9], [-2, 2, -2, 2, -2, -2, -2, -4]),
    Tree::new([10, 11, 8, 2, 10, 7, 5], [251, 153, 178, 167, 187, 203, 204], [-4, -1, -1, 2, 0, 3, -4, 0]),
    Tree::new([9, 2, 5, 9, 5, 0, 3], [78, 62, 81, 49, 204, 230, 150], [-1, 2, -5, 0, -3, 2, 2, -4]),
    Tree::new([2, 6, 11, 5, 0, 9, 9], [156, 189, 80, 176, 229, 166, 105], [-3, -1, -1, 2, -2, 1, 1, 4]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [230, 228, 130, 179, 173, 186, 176], [-5, -2, -1, 1, -1, 2, -3, 1]),
    Tree::new([10, 6, 1, 11, 10, 4, 5], [230, 228, 39, 179, 173, 71, 171], [-4, -2, -1, 1, 0, 2, -2, 0]),
    Tree::new([3, 4, 5, 6, 5, 4, 1], [150, 14, 0, 243, 80, 205, 9], [-2, 2, -1, 2, -2, -2, -2, -4]),
    Tree::new([2, 0, 11, 7, 8, 9, 9], [156, 221, 80, 198, 8, 171, 105], [-3, 0, 0, 3, -2, 1, 1, 3]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [70, 123, 59, 251, 186, 211, 150], [0, 1, -4, 0, -3, 0, 1, -3]),
    Tree::new([10, 6, 8, 2, 8, 4, 5], [251, 224, 178, 167, 2, 61, 204], [-4, -1, -1, 1, 0, 2, -4, 0]),
    Tree::new([3, 4, 5, 5, 9, 9, 7], [167, 120, 0, 176, 146, 192, 222], [-1, 2, 0, 4, -2, -2, -4, -2]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [230, 228, 146, 168, 173, 203, 204], [-4, -2, -1, 1, 0, 2, -3, 1]),
    Tree::new([2, 2, 8, 9, 4, 8, 9], [156, 27, 109, 177, 72, 2, 164], [3, 0, -2, 0, -1, 3, -2, 1]),
    Tree::new([9, 7, 10, 10, 2, 10, 5], [70, 123, 223, 251, 206, 124, 84], [0, 1, -4, 0, 0, -3, -1, 1]),
    Tree::new([3, 4, 5, 5, 9, 7, 7], [167, 175, 0, 170, 141, 203, 222], [-1, 2, 0, 4, -1, -1, -3, -1]),
    Tree::new([10, 11, 8, 2, 10, 8, 2], [251, 143, 178, 191, 187, 18, 211], [-3, -1, -1, 1, -1, 1, -3, 0]),
    Tree::new([3, 4, 7, 6, 9, 1, 2], [135, 120, 210, 231, 146, 9, 131], [-1, 1, 0, 3, -1, -3, -1, -1]),
    Tree::new([2, 2, 11, 9, 8, 8, 9], [156, 17, 80, 178, 13, 109, 109], [3, 1, -4, 0, 1, -2, 1, 3]),
    Tree::new([9, 5, 10, 2, 10, 6, 9], [68, 215, 223, 193, 173, 234, 247], [-3, 0, 0, 1, -3, 0, 1, -2]),
    Tree::new([8, 7, 5, 0, 10, 0, 3], [125, 186, 176, 228, 230, 186, 130], [-2, 1, -2, 2, -3, 1, 1, -1]),
    Tree::new([3, 4, 7, 5, 5, 0, 0], [213, 189, 235, 176, 140, 255, 255], [-1, 1, 4, 0, -3, -3, -1, -1]),
    Tree::new([5, 5, 5, 4, 8, 2, 5], [140, 84, 170, 193, 8, 206, 242], [-2, 2, -1, 2, -5, 0, 1, -3]),
    Tree::new([6, 11, 5, 5, 7, 8, 5], [175, 97, 140, 169, 195, 18, 204], [-3, -2, -2, -1, -1, 2, -1, 1]),
    Tree::new([2, 0, 11, 4, 8, 8, 8], [166, 229, 94, 12, 8, 103, 183], [-2, 0, 0, 3, 1, -1, 3, 1]),
    Tree::new([3, 4, 5, 2, 8, 3, 7], [72, 68, 99, 17, 130, 251, 209], [1, -1, 2, -1, -1, -1, -3, -1]),
    Tree::new([9, 7, 10, 10, 2, 10, 8], [68, 123, 223, 251, 186, 124, 178], [0, 1, -3, 0, 0, -2, 1, -2]),
    Tree::new([2, 5, 11, 5, 5, 5, 8], [193, 140, 75, 84, 170, 177, 8], [-1, 1, -5, 0, -1, 1, 1, 3]),
    Tree::new([3, 4, 7, 6, 8, 11, 0], [213, 189, 235, 223, 162, 167, 255], [-1, 1, 3, 0, -3, -1, -1, -1]),
    Tree::new([2, 8, 8, 10, 5, 6, 6], [203, 156, 2, 251, 204, 229, 133], [-1, 0, -3, 0, -1, 0, 0, 2]),
    Tree::new([2, 2, 11, 9, 7, 0, 9], [153, 36, 68, 176, 198, 172, 103], [3, 0, -2, 0, -1, 0, 0, 2]),
    Tree::new([9, 2, 8, 5, 1, 2, 0], [59, 193, 13, 215, 28, 7, 205], [-3, 0, 0, 0, 1, -3, 0, 3]),
    Tree::new([11, 8, 6, 2, 10, 9, 10], [175, 8, 228, 7, 244, 201, 173], [-1, -3, -2, 0, 1, 1, 1, 3]),
];

/// Agreement of the cells below which nothing is believed, of 255. Right poses of objects of which half is hidden had
/// 41 and more in 409 of 411 frames. Below it the trees have seen next to nothing.
const LEAST_AGREEMENT: u8 = 32;

/// Estimates the probability that a pose is right; 0 when hardly anything agrees.
#[inline(never)]
pub(crate) fn believe(s: &Scrutiny) -> f32 {
    if s.0[0] < LEAST_AGREEMENT {
        return 0.0;
    }
    let sum = TREES.iter().fold(BIAS, |sum, tree| {
        let mut node = 0;
        while node < 7 {
            let above = s.0[tree.property(node)] > tree.limit[node];
            node = 2 * node + 1 + usize::from(above);
        }
        sum + i32::from(tree.leaf[node - 7])
    });
    1.0 / (1.0 + math::exp(-(sum as f32) / STEPS))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::scrutiny::{NAMES, PROPERTIES};

    /// An object that is seen whole, and one that agrees here and there, in other colours.
    const WHOLE: [u8; PROPERTIES] = [255, 0, 0, 13, 0, 128, 255, 0, 0, 191, 255, 100];
    const SCATTERED: [u8; PROPERTIES] = [90, 60, 90, 120, 90, 128, 140, 160, 60, 190, 255, 60];

    #[test]
    fn what_is_seen_whole_is_believed_and_what_agrees_here_and_there_is_not() {
        let (whole, scattered) = (believe(&Scrutiny(WHOLE)), believe(&Scrutiny(SCATTERED)));
        assert!(whole > 0.95 && scattered < 0.8, "{whole} {scattered}");
    }

    /// The scores for each value of a property, while the others stay.
    fn scores(name: &str, start: [u8; PROPERTIES]) -> std::vec::Vec<f32> {
        let i = NAMES.iter().position(|&n| n == name).unwrap();
        let at = |v| core::array::from_fn(|k| if k == i { v } else { start[k] });
        (0..=255).map(|v| believe(&Scrutiny(at(v)))).collect()
    }

    #[test]
    fn more_agreement_is_never_believed_less_and_more_doubt_never_more() {
        for start in [WHOLE, SCATTERED] {
            for name in ["agree", "clump", "votes"] {
                assert!(scores(name, start).is_sorted(), "{name}");
            }
            for name in ["mid", "tint"] {
                assert!(scores(name, start).iter().rev().is_sorted(), "{name}");
            }
        }
        assert_eq!(scores("agree", WHOLE)[31], 0.0, "hardly anything agrees");
    }
}
