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
    Tree::new([6, 5, 3, 7, 3, 5, 2], [207, 61, 88, 241, 72, 84, 226], [-8, 0, 0, -7, 3, 8, 0, 0]),
    Tree::new([11, 5, 3, 6, 3, 5, 2], [121, 61, 68, 236, 88, 81, 195], [-8, 0, 0, -7, 3, 7, 0, 2]),
    Tree::new([6, 5, 3, 11, 10, 5, 2], [204, 177, 88, 109, 251, 84, 226], [-6, -2, -4, 0, 2, 6, 0, 0]),
    Tree::new([11, 10, 3, 6, 5, 5, 2], [123, 251, 72, 238, 60, 81, 195], [-7, 0, -6, 0, 2, 5, 0, 1]),
    Tree::new([3, 5, 7, 4, 9, 2, 8], [88, 81, 225, 213, 89, 205, 125], [-2, 2, -2, 5, -6, -2, -2, -2]),
    Tree::new([5, 6, 3, 11, 8, 4, 5], [61, 236, 69, 157, 8, 61, 99], [-6, -2, -1, 2, 1, 6, -1, -6]),
    Tree::new([6, 7, 3, 5, 8, 5, 11], [208, 203, 93, 180, 151, 81, 232], [-5, 0, 0, -5, 1, 4, 0, 0]),
    Tree::new([5, 0, 3, 2, 7, 9, 7], [81, 231, 88, 166, 158, 147, 223], [-5, -2, 2, -1, 0, 4, -5, -1]),
    Tree::new([11, 10, 1, 0, 5, 8, 7], [109, 251, 34, 230, 59, 151, 198], [-6, 0, -4, 0, 4, 1, 0, 1]),
    Tree::new([3, 5, 7, 4, 8, 2, 0], [96, 81, 223, 192, 151, 205, 56], [-2, 2, 3, -2, -5, -2, -2, -2]),
    Tree::new([10, 11, 8, 6, 6, 7, 5], [251, 153, 146, 234, 209, 203, 176], [-5, -1, -1, 3, 0, 5, -5, 1]),
    Tree::new([5, 6, 3, 4, 8, 4, 5], [61, 235, 69, 213, 8, 14, 99], [-5, -2, -1, 2, 0, 4, -1, -4]),
    Tree::new([10, 11, 8, 6, 10, 7, 5], [244, 159, 130, 234, 173, 203, 176], [-5, -2, -1, 3, 0, 4, -4, 1]),
    Tree::new([5, 11, 3, 0, 1, 8, 7], [61, 142, 96, 221, 27, 130, 221], [-5, -2, 2, -2, 2, -1, -5, -1]),
    Tree::new([10, 6, 8, 2, 5, 7, 2], [251, 228, 178, 173, 143, 203, 215], [-5, -2, 2, -1, 0, 3, -5, 1]),
    Tree::new([5, 2, 3, 0, 8, 4, 7], [81, 166, 93, 230, 98, 13, 222], [-4, 1, 3, -2, 0, 3, -4, -1]),
    Tree::new([9, 7, 5, 2, 2, 2, 3], [71, 122, 81, 60, 205, 155, 71], [1, 0, -5, 0, -3, 1, 2, -2]),
    Tree::new([10, 6, 8, 11, 10, 1, 2], [230, 228, 178, 179, 173, 39, 215], [-5, -3, -2, 1, 2, -2, -5, 0]),
    Tree::new([11, 5, 2, 6, 10, 6, 8], [97, 176, 154, 198, 251, 244, 178], [-4, -1, -2, -1, -1, 3, 4, -1]),
    Tree::new([10, 6, 8, 11, 10, 7, 2], [230, 228, 178, 179, 173, 203, 215], [-5, -3, -2, 1, 0, 3, -5, 0]),
    Tree::new([9, 7, 5, 2, 5, 2, 3], [71, 122, 84, 60, 215, 166, 151], [1, 0, -5, 0, -3, 1, 2, -4]),
    Tree::new([10, 11, 8, 2, 10, 7, 5], [251, 150, 178, 191, 187, 198, 203], [-4, -1, -1, 2, 0, 3, -4, 1]),
    Tree::new([6, 4, 8, 7, 3, 11, 9], [234, 14, 13, 206, 163, 175, 49], [-4, 0, 1, -4, 1, 3, 1, 4]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [230, 228, 130, 179, 173, 186, 176], [-4, -2, -2, 1, 0, 2, -3, 1]),
    Tree::new([3, 4, 5, 0, 9, 4, 7], [163, 121, 0, 221, 147, 199, 222], [-1, 2, 0, 4, -2, -2, -4, -2]),
    Tree::new([2, 2, 11, 9, 4, 9, 9], [157, 17, 80, 191, 14, 166, 105], [3, -1, -3, 0, -2, 1, 1, 3]),
    Tree::new([10, 0, 8, 7, 10, 3, 5], [251, 232, 188, 211, 173, 163, 203], [-4, -1, -1, 3, 1, -3, -4, 0]),
    Tree::new([9, 7, 5, 10, 5, 4, 3], [69, 117, 84, 251, 215, 192, 68], [0, 1, -4, 0, -2, 2, 2, -2]),
    Tree::new([10, 11, 8, 0, 10, 7, 5], [230, 143, 151, 230, 187, 198, 171], [-4, -2, -2, 1, 0, 2, -3, 1]),
    Tree::new([2, 0, 11, 7, 8, 9, 9], [154, 221, 68, 186, 13, 161, 104], [-3, 0, 0, 3, -2, 1, 1, 3]),
    Tree::new([5, 5, 5, 5, 5, 9, 0], [204, 140, 242, 84, 171, 51, 183], [-2, 2, -6, 0, -2, 4, -3, 0]),
    Tree::new([10, 5, 8, 10, 5, 4, 2], [223, 216, 178, 109, 221, 61, 212], [0, -4, 0, 0, 0, 2, -3, 1]),
    Tree::new([3, 4, 5, 2, 10, 7, 7], [163, 121, 0, 17, 251, 167, 222], [2, -1, 0, 3, -2, -2, -4, -2]),
    Tree::new([9, 7, 9, 10, 2, 10, 6], [69, 117, 247, 251, 186, 223, 236], [0, 1, -4, 0, -3, 1, -3, 1]),
    Tree::new([2, 0, 9, 8, 5, 5, 8], [155, 229, 148, 24, 133, 124, 2], [-4, 0, 2, 0, -2, 1, -1, 3]),
    Tree::new([5, 5, 5, 5, 5, 9, 0], [191, 140, 242, 115, 168, 51, 183], [-1, 2, -5, -1, -2, 3, -3, 0]),
    Tree::new([3, 4, 7, 5, 9, 0, 2], [163, 175, 210, 176, 141, 255, 148], [-1, 2, 0, 4, -4, -4, -1, -1]),
    Tree::new([9, 2, 10, 5, 1, 11, 8], [58, 193, 237, 215, 28, 148, 188], [-4, 0, 0, 0, -3, 0, 1, -3]),
    Tree::new([2, 8, 8, 11, 7, 9, 8], [193, 125, 2, 159, 156, 190, 220], [-1, 2, 2, -2, 0, -1, 3, -1]),
    Tree::new([4, 2, 3, 5, 3, 5, 5], [14, 17, 48, 140, 0, 114, 133], [2, -2, -1, -4, 1, 3, 1, -3]),
    Tree::new([8, 2, 6, 5, 7, 10, 9], [13, 11, 231, 140, 161, 251, 69], [2, -3, -5, 0, -2, 0, 1, 3]),
    Tree::new([2, 5, 11, 5, 5, 0, 8], [153, 132, 68, 84, 176, 171, 146], [-2, 1, -3, 1, -2, 0, 2, 0]),
    Tree::new([4, 11, 3, 7, 10, 5, 5], [14, 176, 57, 205, 173, 114, 140], [-2, 0, 0, 2, 0, 3, 0, -3]),
    Tree::new([10, 5, 8, 10, 5, 7, 2], [223, 216, 188, 124, 221, 198, 182], [0, -3, 0, 0, 0, 1, -3, 0]),
    Tree::new([9, 2, 8, 5, 1, 9, 0], [58, 193, 13, 215, 28, 191, 205], [-3, 0, 0, 0, 0, -4, 0, 3]),
    Tree::new([3, 4, 7, 0, 8, 0, 0], [211, 189, 234, 228, 162, 255, 255], [-1, 1, 4, 0, -3, -3, -1, -1]),
    Tree::new([4, 7, 9, 9, 2, 5, 7], [72, 122, 148, 141, 154, 176, 179], [4, -1, -2, 1, -2, 1, -2, 3]),
    Tree::new([10, 5, 8, 10, 5, 7, 0], [223, 216, 119, 124, 221, 186, 144], [0, -3, 0, 0, -1, 2, -2, 1]),
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
