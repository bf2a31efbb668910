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
    Tree::new([11, 5, 3, 6, 3, 5, 2], [121, 34, 72, 235, 87, 32, 189], [-9, -1, 1, -8, 4, 8, 1, 3]),
    Tree::new([6, 5, 3, 7, 3, 5, 2], [204, 34, 88, 241, 81, 28, 226], [-8, 0, 0, -7, 3, 7, 0, 1]),
    Tree::new([5, 11, 3, 6, 1, 9, 3], [34, 145, 69, 236, 27, 81, 95], [-7, -4, 4, -4, 0, 6, -1, -7]),
    Tree::new([5, 6, 3, 11, 1, 8, 7], [34, 236, 87, 145, 22, 151, 225], [-6, -3, 3, -1, 5, -1, -6, -1]),
    Tree::new([11, 10, 3, 6, 5, 5, 2], [109, 251, 68, 238, 34, 34, 154], [-6, 0, -6, 0, 2, 5, 0, 2]),
    Tree::new([3, 5, 2, 4, 8, 7, 3], [87, 34, 191, 210, 156, 229, 191], [-2, 3, 4, -2, -6, -2, -2, -3]),
    Tree::new([5, 6, 3, 4, 9, 4, 3], [34, 236, 69, 210, 235, 14, 151], [-6, -2, 0, 3, 0, 5, -2, -6]),
    Tree::new([6, 10, 3, 2, 8, 4, 0], [208, 251, 121, 200, 178, 15, 239], [-6, 0, 0, -6, 2, 5, 0, 0]),
    Tree::new([5, 11, 3, 0, 1, 4, 3], [34, 142, 72, 221, 27, 14, 151], [-5, -3, 3, -3, 0, 4, -2, -6]),
    Tree::new([5, 11, 3, 4, 1, 9, 7], [34, 142, 95, 210, 27, 89, 221], [-5, -3, 3, -3, -1, 3, -5, -1]),
    Tree::new([11, 10, 1, 0, 8, 9, 7], [97, 251, 34, 230, 125, 148, 203], [-6, -1, -1, -4, 1, 3, -1, 1]),
    Tree::new([5, 6, 3, 4, 1, 4, 7], [34, 225, 69, 210, 19, 14, 204], [-5, -2, 3, -2, -1, 3, -4, -1]),
    Tree::new([6, 10, 7, 2, 8, 0, 9], [207, 251, 186, 191, 178, 229, 152], [-5, 0, 0, -6, 0, 3, 0, 4]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [69, 117, 34, 251, 206, 210, 151], [-1, 1, -6, 1, -5, -1, 2, -5]),
    Tree::new([10, 11, 8, 2, 6, 7, 2], [251, 153, 178, 191, 209, 203, 213], [-5, -1, -1, 3, -1, 4, -6, 1]),
    Tree::new([5, 11, 3, 4, 9, 8, 7], [35, 145, 121, 210, 244, 130, 219], [-4, -2, 2, -2, 2, -1, -5, -1]),
    Tree::new([9, 7, 5, 10, 2, 4, 3], [69, 117, 34, 251, 206, 210, 151], [-1, 1, -6, 1, -4, 2, 1, -4]),
    Tree::new([10, 6, 8, 2, 10, 7, 2], [230, 228, 167, 55, 173, 203, 211], [-3, -6, -2, 1, -1, 3, -5, 1]),
    Tree::new([10, 11, 8, 2, 10, 1, 0], [230, 143, 178, 55, 187, 39, 128], [-2, -5, -2, 2, 2, -2, -5, 0]),
    Tree::new([9, 7, 5, 10, 2, 6, 3], [69, 117, 34, 251, 206, 210, 165], [-1, 1, -5, 1, -4, 0, 1, -4]),
    Tree::new([10, 11, 4, 2, 8, 4, 8], [251, 153, 14, 191, 135, 0, 188], [-4, -1, 3, -1, 0, -5, 2, -4]),
    Tree::new([11, 7, 8, 0, 10, 8, 2], [126, 203, 167, 147, 244, 13, 223], [-5, -1, -4, 0, 0, 2, 0, 1]),
    Tree::new([9, 2, 2, 5, 4, 0, 11], [60, 219, 155, 215, 76, 229, 80], [-5, 0, 1, 0, -1, 3, -1, 3]),
    Tree::new([4, 0, 3, 3, 3, 0, 9], [14, 229, 57, 0, 31, 96, 147], [-2, -6, 3, -1, 0, 3, -3, 0]),
    Tree::new([10, 6, 8, 11, 10, 7, 2], [216, 234, 178, 142, 173, 206, 179], [-5, -3, -2, 1, -1, 3, -5, 0]),
    Tree::new([3, 4, 7, 6, 10, 0, 9], [165, 175, 210, 244, 223, 255, 149], [-1, 3, -2, 5, -4, -4, -2, -2]),
    Tree::new([10, 11, 4, 2, 8, 9, 8], [251, 159, 60, 168, 135, 191, 146], [-4, -1, 2, -1, 1, -4, 3, -2]),
    Tree::new([9, 2, 8, 5, 1, 7, 6], [58, 193, 13, 215, 28, 35, 234], [-5, 0, 1, -1, 2, -5, 0, 4]),
    Tree::new([3, 4, 7, 5, 8, 0, 0], [216, 189, 235, 77, 125, 255, 255], [-1, 1, 5, 0, -4, -4, -2, -2]),
    Tree::new([4, 7, 3, 3, 3, 0, 10], [13, 83, 57, 39, 0, 96, 251], [3, -2, -1, -5, 0, 2, -4, 0]),
    Tree::new([2, 8, 11, 7, 7, 1, 8], [193, 188, 68, 206, 236, 31, 220], [-1, 1, -5, 1, 1, -2, 4, 2]),
    Tree::new([10, 11, 8, 2, 10, 7, 5], [216, 135, 130, 50, 194, 200, 176], [-3, -5, -2, 1, 0, 3, -2, 2]),
    Tree::new([9, 2, 9, 5, 1, 3, 1], [58, 193, 247, 215, 28, 216, 16], [-5, 0, 1, -1, 1, -4, 1, -4]),
    Tree::new([10, 11, 8, 2, 10, 8, 9], [216, 135, 178, 50, 194, 13, 145], [-3, -4, -2, 1, -2, 1, 0, -4]),
    Tree::new([0, 8, 8, 7, 4, 11, 9], [228, 18, 8, 179, 12, 171, 68], [-6, 0, -2, 1, 1, 3, 1, 4]),
    Tree::new([9, 2, 2, 5, 1, 0, 11], [58, 193, 155, 215, 28, 221, 68], [-5, 0, 1, -1, -1, 2, -2, 3]),
    Tree::new([5, 5, 5, 5, 5, 9, 0], [191, 140, 242, 84, 171, 52, 183], [-1, 2, -6, 0, -2, 4, -3, 0]),
    Tree::new([3, 4, 7, 0, 10, 0, 0], [216, 189, 235, 228, 244, 255, 255], [-1, 2, 0, 5, -4, -4, -2, -2]),
    Tree::new([8, 9, 8, 11, 11, 10, 0], [13, 194, 119, 160, 195, 244, 137], [-1, 2, -6, 1, -2, 1, -2, 1]),
    Tree::new([4, 4, 3, 11, 9, 0, 7], [14, 0, 72, 129, 134, 97, 200], [-1, 2, 2, -5, 0, 2, -3, 0]),
    Tree::new([2, 9, 8, 5, 5, 11, 0], [193, 58, 220, 215, 191, 68, 255], [-4, 0, 0, 3, 0, 3, -1, -1]),
    Tree::new([10, 10, 8, 0, 5, 7, 2], [216, 109, 188, 192, 215, 200, 179], [0, 0, -4, 0, 0, 1, -4, 1]),
    Tree::new([3, 4, 0, 0, 9, 0, 0], [240, 177, 255, 220, 148, 255, 255], [-1, 2, -1, 4, -4, -4, -4, -4]),
    Tree::new([10, 0, 4, 9, 8, 9, 7], [251, 179, 72, 148, 13, 144, 151], [-4, -1, -1, 2, 2, -2, -4, 2]),
    Tree::new([9, 5, 2, 2, 0, 0, 11], [49, 226, 160, 193, 255, 229, 94], [-4, 0, 0, 0, -1, 2, 0, 3]),
    Tree::new([8, 9, 0, 9, 4, 10, 9], [13, 194, 220, 178, 139, 251, 72], [-1, 1, -5, 1, -2, 0, 1, 3]),
    Tree::new([9, 5, 5, 2, 0, 5, 5], [49, 226, 191, 193, 255, 140, 242], [-4, 0, 0, 0, 0, -3, 3, -3]),
    Tree::new([3, 4, 0, 5, 9, 0, 0], [240, 189, 255, 77, 148, 255, 255], [-1, 1, 0, 4, -3, -3, -3, -3]),
];

/// Agreement of the cells below which nothing is believed, of 255. Right poses of objects of which half is hidden had
/// 41 and more in 409 of 411 frames. Below it the trees have seen next to nothing.
const LEAST_AGREEMENT: u8 = 32;

/// What a border where the object seems hidden takes from the log-odds, in steps: it is ninety times as frequent among packages
/// that share a third of their area as among half-hidden objects (`docs/decisions/0027-borders.md`).
const BORDERED: i32 = 144;

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
    let sum = if s.1 { sum - BORDERED } else { sum };
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
        let (whole, scattered) = (believe(&Scrutiny(WHOLE, false)), believe(&Scrutiny(SCATTERED, false)));
        assert!(whole > 0.95 && scattered < 0.8, "{whole} {scattered}");
    }

    /// The scores for each value of a property, while the others stay.
    fn scores(name: &str, start: [u8; PROPERTIES]) -> std::vec::Vec<f32> {
        let i = NAMES.iter().position(|&n| n == name).unwrap();
        let at = |v| core::array::from_fn(|k| if k == i { v } else { start[k] });
        (0..=255).map(|v| believe(&Scrutiny(at(v), false))).collect()
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
