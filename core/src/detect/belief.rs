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
const BIAS: i32 = 69;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0023-small-cells.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([11, 5, 3, 6, 3, 5, 3], [121, 34, 68, 235, 87, 20, 87], [-9, -1, 1, -8, 4, 8, 2, 1]),
    Tree::new([6, 5, 3, 7, 3, 5, 2], [204, 34, 88, 241, 85, 16, 226], [-8, 0, 0, -7, 3, 7, 0, 1]),
    Tree::new([3, 5, 2, 4, 8, 7, 3], [87, 34, 191, 213, 156, 229, 154], [-2, 2, 6, -2, -7, -2, -2, -4]),
    Tree::new([5, 6, 3, 11, 1, 9, 3], [34, 236, 69, 145, 22, 86, 94], [-7, -3, 3, -1, 0, 5, -2, -6]),
    Tree::new([5, 11, 3, 6, 1, 9, 3], [34, 145, 69, 236, 27, 77, 94], [-6, -4, 4, -4, 0, 5, -1, -6]),
    Tree::new([11, 10, 3, 6, 5, 5, 2], [109, 251, 72, 238, 34, 34, 189], [-6, 0, -6, 0, 2, 5, 0, 2]),
    Tree::new([6, 10, 3, 2, 5, 5, 0], [208, 251, 122, 200, 34, 16, 170], [-6, 0, -6, 0, 2, 5, 0, 0]),
    Tree::new([5, 6, 3, 4, 9, 4, 3], [34, 236, 69, 213, 236, 14, 151], [-6, -2, -1, 3, 0, 4, -2, -6]),
    Tree::new([3, 5, 7, 4, 8, 3, 8], [92, 34, 223, 213, 146, 94, 167], [-2, 3, 3, -2, -2, -5, -2, -3]),
    Tree::new([6, 10, 3, 2, 8, 4, 0], [207, 251, 122, 191, 178, 14, 73], [-5, 0, 0, -6, 1, 4, 0, 0]),
    Tree::new([5, 11, 3, 4, 7, 4, 3], [34, 145, 72, 208, 190, 14, 151], [-5, -3, -3, 4, 0, 4, -2, -5]),
    Tree::new([11, 10, 5, 0, 8, 4, 3], [97, 251, 35, 230, 125, 206, 62], [-5, -1, -1, -4, -1, 3, 3, -1]),
    Tree::new([5, 6, 3, 4, 11, 9, 7], [34, 236, 92, 208, 75, 88, 223], [-5, -1, -1, 2, -1, 3, -4, -1]),
    Tree::new([10, 11, 8, 2, 6, 7, 2], [251, 153, 178, 191, 209, 203, 212], [-5, -1, -1, 3, 0, 4, -6, 1]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [70, 122, 34, 251, 205, 225, 151], [-1, 1, -6, 0, -4, 0, 2, -5]),
    Tree::new([8, 10, 5, 11, 7, 2, 8], [167, 244, 189, 153, 203, 211, 215], [-5, 2, -1, 4, -6, 0, 2, -1]),
    Tree::new([11, 10, 8, 2, 5, 7, 2], [126, 251, 167, 191, 34, 201, 223], [-5, 0, -4, 0, 1, 4, 0, 1]),
    Tree::new([9, 7, 5, 10, 2, 4, 3], [70, 122, 34, 251, 205, 208, 151], [-1, 1, -6, 0, -4, 2, 2, -4]),
    Tree::new([8, 10, 0, 6, 1, 5, 3], [178, 230, 128, 228, 34, 203, 62], [-5, 0, 2, -1, -6, -3, 1, -2]),
    Tree::new([8, 7, 5, 11, 10, 2, 3], [130, 206, 176, 141, 230, 193, 129], [-2, 2, -3, 4, -4, 1, 2, -1]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [70, 123, 34, 251, 205, 225, 165], [-1, 1, -5, 1, -4, 1, 1, -4]),
    Tree::new([10, 11, 8, 2, 8, 7, 2], [251, 159, 188, 168, 87, 203, 179], [-4, -1, 2, -1, 0, 3, -5, 0]),
    Tree::new([6, 4, 7, 5, 8, 0, 9], [210, 14, 170, 191, 178, 228, 151], [-5, 0, 0, -4, 0, 2, 0, 4]),
    Tree::new([9, 2, 9, 5, 4, 10, 6], [59, 219, 247, 215, 76, 251, 236], [-5, 0, 1, 0, -2, 1, -4, 1]),
    Tree::new([4, 7, 3, 3, 2, 0, 9], [14, 83, 57, 32, 156, 96, 147], [3, -2, -4, 0, 0, 3, -3, 0]),
    Tree::new([3, 4, 7, 6, 10, 0, 9], [165, 175, 210, 210, 223, 255, 149], [-1, 1, -2, 5, -5, -5, -2, -2]),
    Tree::new([10, 5, 8, 10, 5, 7, 0], [216, 217, 178, 109, 221, 206, 128], [0, -5, 0, 0, 0, 3, -4, 1]),
    Tree::new([9, 2, 9, 5, 1, 3, 4], [59, 193, 242, 215, 28, 212, 70], [-5, 0, 1, -1, 1, -4, -4, 1]),
    Tree::new([4, 6, 3, 5, 3, 0, 7], [14, 243, 72, 191, 39, 98, 200], [-3, 0, 3, 0, 0, 2, -3, 0]),
    Tree::new([8, 7, 8, 5, 4, 10, 5], [13, 35, 119, 143, 117, 230, 176], [2, -3, -7, 0, -3, 2, -2, 2]),
    Tree::new([9, 2, 2, 5, 1, 11, 11], [59, 193, 156, 215, 28, 126, 68], [-5, 0, 1, -1, -1, 1, -2, 3]),
    Tree::new([10, 11, 8, 2, 10, 7, 9], [216, 135, 167, 50, 194, 200, 145], [-3, -5, -2, 1, -1, 2, 0, -4]),
    Tree::new([3, 4, 7, 0, 8, 0, 0], [212, 187, 235, 221, 125, 255, 255], [-1, 2, 5, 0, -4, -4, -2, -2]),
    Tree::new([8, 9, 8, 9, 11, 10, 0], [13, 194, 119, 178, 195, 216, 140], [-2, 2, -7, 1, -3, 1, -2, 1]),
    Tree::new([4, 7, 3, 5, 3, 4, 7], [14, 96, 136, 128, 0, 175, 210], [2, -2, -1, -5, 1, 4, -4, -1]),
    Tree::new([9, 2, 8, 5, 1, 9, 6], [59, 193, 13, 215, 28, 191, 228], [-5, 0, 1, -1, 0, -5, 0, 3]),
    Tree::new([10, 0, 8, 9, 8, 7, 2], [251, 179, 188, 148, 13, 200, 179], [-4, -1, -1, 2, 0, 2, -4, 1]),
    Tree::new([11, 6, 4, 5, 4, 2, 3], [97, 179, 177, 169, 9, 161, 205], [-3, -2, -2, 0, 0, 2, 4, 0]),
    Tree::new([3, 4, 5, 5, 10, 3, 0], [212, 189, 0, 77, 244, 250, 255], [-1, 1, -1, 4, -2, -2, -4, -4]),
    Tree::new([9, 2, 5, 8, 6, 5, 5], [49, 193, 191, 225, 187, 140, 242], [-5, 0, 0, 0, 0, -3, 4, -2]),
    Tree::new([4, 6, 3, 4, 5, 5, 10], [14, 243, 54, 0, 143, 78, 251], [-1, -4, 2, 0, 0, 3, -3, 0]),
    Tree::new([8, 6, 0, 9, 5, 4, 9], [13, 247, 221, 203, 140, 14, 70], [-2, -6, 2, -2, -2, 0, 2, 4]),
    Tree::new([8, 11, 2, 7, 8, 7, 8], [188, 126, 179, 200, 40, 236, 215], [-2, 0, 0, 2, -4, 1, 2, -2]),
    Tree::new([10, 11, 9, 2, 10, 5, 9], [216, 135, 55, 50, 194, 223, 236], [-2, -4, -2, 1, -4, 0, 1, -2]),
    Tree::new([3, 4, 0, 9, 9, 0, 0], [250, 193, 255, 213, 148, 255, 255], [0, -2, -1, 5, -4, -4, -4, -4]),
    Tree::new([2, 8, 11, 10, 7, 2, 8], [193, 188, 68, 251, 236, 215, 220], [-2, 0, -4, 1, -1, 0, 3, 1]),
    Tree::new([9, 2, 5, 8, 6, 5, 5], [49, 193, 204, 225, 187, 140, 242], [-4, 0, 0, 0, 0, -2, 4, -2]),
    Tree::new([3, 4, 0, 9, 9, 0, 0], [250, 193, 255, 220, 148, 255, 255], [0, -2, -1, 4, -4, -4, -4, -4]),
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
