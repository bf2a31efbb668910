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

/// Log-odds without any tree, in steps: as fitted, and 72 more, so that half-hidden objects are found.
const BIAS: i32 = 68;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0023-small-cells.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([11, 5, 3, 6, 3, 5, 3], [121, 34, 68, 236, 88, 28, 86], [-9, -1, 1, -8, 4, 8, 2, 1]),
    Tree::new([6, 5, 3, 7, 3, 5, 2], [204, 34, 88, 241, 85, 28, 227], [-8, 0, 0, -7, 3, 7, 0, 1]),
    Tree::new([3, 5, 2, 6, 8, 7, 3], [88, 34, 192, 243, 151, 229, 152], [-2, 2, 5, -2, -7, -2, -2, -4]),
    Tree::new([5, 11, 3, 6, 1, 4, 3], [34, 145, 69, 236, 27, 14, 94], [-7, -4, 4, -4, 1, 6, -1, -6]),
    Tree::new([5, 11, 3, 6, 1, 9, 3], [34, 145, 69, 236, 27, 86, 148], [-6, -3, 4, -3, 0, 5, -3, -6]),
    Tree::new([11, 10, 3, 6, 5, 5, 2], [109, 251, 73, 238, 34, 35, 192], [-6, 0, -6, 0, 2, 4, 0, 2]),
    Tree::new([5, 6, 3, 4, 9, 4, 3], [34, 236, 71, 210, 236, 14, 148], [-6, -2, -1, 3, 0, 4, -2, -6]),
    Tree::new([6, 10, 3, 2, 8, 1, 0], [208, 251, 120, 192, 178, 29, 80], [-6, 0, 0, -6, 4, 2, 0, 0]),
    Tree::new([5, 11, 3, 4, 7, 9, 7], [34, 145, 92, 210, 190, 88, 223], [-5, -3, -3, 4, -1, 3, -5, -1]),
    Tree::new([5, 6, 3, 4, 9, 8, 7], [34, 236, 92, 210, 236, 130, 223], [-5, -2, 0, 3, 3, -1, -5, -1]),
    Tree::new([11, 10, 1, 0, 6, 9, 2], [97, 251, 39, 230, 180, 148, 154], [-6, -1, -4, -1, 1, 3, -1, 1]),
    Tree::new([5, 6, 3, 4, 1, 4, 7], [34, 225, 69, 210, 17, 14, 204], [-5, -3, 3, -3, -1, 3, -4, -1]),
    Tree::new([10, 11, 8, 2, 6, 7, 2], [251, 153, 178, 192, 209, 203, 213], [-5, -1, -1, 4, 0, 4, -6, 1]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [70, 122, 34, 251, 206, 211, 148], [-1, 1, -6, 0, -5, -1, 2, -5]),
    Tree::new([6, 10, 7, 2, 8, 0, 9], [208, 251, 170, 192, 178, 229, 151], [-5, 0, 0, -5, 0, 3, 0, 4]),
    Tree::new([5, 11, 9, 4, 7, 2, 3], [34, 142, 77, 210, 188, 62, 148], [-5, -2, -2, 3, 1, -6, 2, -4]),
    Tree::new([8, 7, 5, 11, 10, 2, 8], [167, 206, 189, 138, 244, 211, 220], [-2, 2, -3, 4, -5, 0, 2, -1]),
    Tree::new([10, 6, 8, 2, 10, 7, 2], [230, 228, 167, 55, 173, 203, 180], [-2, -6, -2, 1, -1, 3, -5, 0]),
    Tree::new([5, 4, 3, 6, 3, 4, 5], [35, 210, 148, 225, 250, 175, 204], [-4, 0, 5, -3, 0, 5, -4, -2]),
    Tree::new([9, 7, 4, 10, 2, 0, 3], [70, 123, 14, 251, 206, 229, 94], [-1, 2, -5, 1, -4, 2, 2, -2]),
    Tree::new([10, 11, 8, 2, 10, 1, 0], [230, 143, 178, 55, 187, 34, 128], [-2, -5, -2, 2, 2, -1, -5, 0]),
    Tree::new([10, 11, 4, 2, 8, 5, 8], [251, 159, 14, 172, 135, 84, 188], [-4, -1, 3, -1, -5, 1, 2, -4]),
    Tree::new([9, 2, 2, 5, 4, 0, 11], [60, 219, 155, 215, 76, 228, 80], [-5, 0, 1, 0, -1, 2, -1, 3]),
    Tree::new([3, 4, 7, 6, 8, 0, 9], [163, 14, 210, 244, 130, 255, 149], [-2, 3, 2, -1, -5, -5, -2, -2]),
    Tree::new([10, 11, 9, 2, 7, 8, 2], [216, 135, 247, 50, 206, 130, 80], [-3, -5, -2, 1, 1, -2, -5, 0]),
    Tree::new([9, 2, 8, 5, 4, 6, 10], [58, 219, 13, 215, 76, 247, 251], [-5, 0, 1, 0, -5, 1, -2, 1]),
    Tree::new([3, 4, 7, 5, 9, 0, 0], [211, 187, 235, 77, 148, 255, 255], [-1, 1, 0, 5, -4, -4, -2, -2]),
    Tree::new([2, 8, 11, 11, 7, 1, 8], [192, 188, 68, 126, 236, 31, 220], [-1, 1, -5, 1, 1, -2, 4, 2]),
    Tree::new([4, 4, 3, 11, 7, 0, 10], [13, 0, 57, 124, 85, 96, 251], [-2, 1, 2, -6, 0, 3, -4, 0]),
    Tree::new([9, 2, 8, 5, 1, 9, 6], [58, 193, 13, 215, 28, 191, 234], [-5, 0, 1, -1, 1, -6, 0, 4]),
    Tree::new([10, 11, 8, 2, 10, 7, 9], [216, 135, 178, 50, 194, 202, 145], [-3, -5, -2, 1, -1, 2, -1, -5]),
    Tree::new([3, 4, 7, 0, 8, 0, 0], [211, 189, 235, 228, 125, 255, 255], [-1, 2, 5, 0, -4, -4, -2, -2]),
    Tree::new([4, 4, 3, 11, 9, 0, 10], [14, 0, 57, 140, 134, 97, 251], [-1, 2, 2, -5, 0, 2, -3, 0]),
    Tree::new([9, 2, 5, 5, 1, 5, 5], [58, 193, 191, 215, 28, 140, 242], [-5, 0, 1, -1, 0, -3, 4, -3]),
    Tree::new([2, 0, 9, 7, 8, 2, 8], [155, 221, 148, 198, 13, 211, 2], [-2, 0, 0, 3, -2, 2, -3, 3]),
    Tree::new([10, 11, 8, 2, 10, 7, 9], [216, 135, 178, 50, 194, 200, 145], [-3, -4, -2, 1, -1, 2, 0, -4]),
    Tree::new([3, 4, 7, 5, 8, 0, 0], [211, 177, 235, 77, 125, 255, 255], [-1, 1, 4, 0, -4, -4, -2, -2]),
    Tree::new([9, 5, 8, 2, 0, 9, 0], [50, 226, 13, 193, 255, 194, 221], [-5, 0, 0, 0, 0, -5, 0, 4]),
    Tree::new([10, 11, 8, 2, 10, 4, 5], [216, 135, 119, 50, 194, 72, 176], [-2, -4, -2, 1, 0, 2, -2, 2]),
    Tree::new([3, 4, 7, 9, 9, 0, 9], [163, 175, 210, 203, 141, 255, 128], [0, -1, -1, 4, -4, -4, -2, -1]),
    Tree::new([2, 8, 11, 10, 7, 1, 8], [192, 188, 68, 251, 236, 31, 220], [-2, 0, -4, 1, 1, -2, 3, 1]),
    Tree::new([9, 5, 5, 2, 0, 5, 5], [50, 226, 191, 193, 255, 140, 242], [-4, 0, 0, 0, 0, -3, 3, -3]),
    Tree::new([9, 3, 1, 4, 9, 6, 7], [247, 211, 16, 189, 209, 214, 228], [0, 3, -4, -2, -1, 2, -4, -1]),
    Tree::new([10, 11, 5, 2, 10, 4, 3], [216, 135, 82, 50, 173, 14, 57], [-2, -4, -2, 1, -3, 0, 1, -1]),
    Tree::new([9, 5, 2, 2, 0, 0, 11], [50, 226, 157, 193, 255, 229, 80], [-4, 0, 0, 0, -1, 2, -1, 2]),
    Tree::new([8, 7, 0, 5, 7, 10, 9], [13, 35, 202, 143, 161, 251, 165], [2, -2, -5, 0, -2, 0, 4, 1]),
    Tree::new([4, 4, 3, 5, 6, 5, 4], [14, 0, 49, 140, 243, 34, 153], [1, -2, -4, 2, 0, 2, -2, 0]),
    Tree::new([3, 4, 0, 5, 9, 0, 0], [250, 192, 255, 176, 148, 255, 255], [0, 2, 0, 4, -4, -4, -4, -4]),
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
