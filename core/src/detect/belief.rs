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
const BIAS: i32 = 61;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0023-small-cells.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([11, 3, 3, 5, 7, 5, 5], [121, 87, 68, 84, 223, 84, 0], [-5, 1, -8, -5, 4, 8, 2, 1]),
    Tree::new([6, 5, 3, 7, 3, 5, 3], [207, 61, 89, 241, 72, 84, 94], [-8, 0, 0, -6, 3, 7, 0, 0]),
    Tree::new([11, 5, 3, 6, 3, 5, 2], [109, 176, 68, 211, 163, 84, 188], [-6, -1, 0, -5, 2, 6, 0, 2]),
    Tree::new([3, 5, 7, 0, 9, 2, 0], [87, 81, 225, 231, 95, 205, 60], [-2, 1, -2, 5, -6, -2, -2, -2]),
    Tree::new([3, 5, 7, 0, 9, 2, 0], [87, 81, 225, 231, 86, 205, 58], [-2, 1, -2, 4, -6, -2, -2, -2]),
    Tree::new([5, 6, 3, 11, 11, 4, 5], [61, 235, 71, 145, 178, 60, 99], [-6, -2, 0, 2, 1, 5, -1, -5]),
    Tree::new([6, 7, 11, 5, 8, 7, 1], [204, 203, 145, 191, 151, 196, 29], [-6, 0, 0, -5, 0, 2, 5, 2]),
    Tree::new([5, 6, 3, 11, 8, 4, 5], [61, 235, 68, 145, 8, 60, 99], [-5, -2, -1, 2, 1, 5, 0, -5]),
    Tree::new([10, 11, 8, 6, 8, 5, 5], [251, 153, 151, 234, 87, 81, 176], [-6, -2, 3, -1, -2, 3, -5, 1]),
    Tree::new([10, 11, 8, 6, 6, 7, 5], [251, 150, 130, 234, 209, 203, 176], [-5, -1, -1, 3, 0, 5, -4, 2]),
    Tree::new([5, 11, 3, 0, 6, 9, 7], [61, 142, 94, 221, 210, 147, 223], [-5, -2, -2, 1, -1, 3, -5, -1]),
    Tree::new([1, 9, 5, 5, 5, 7, 3], [34, 148, 176, 191, 60, 206, 59], [-1, 2, -1, 3, -4, -1, -1, -3]),
    Tree::new([10, 11, 8, 2, 6, 7, 2], [251, 150, 178, 191, 209, 203, 217], [-5, -1, -1, 2, 0, 4, -5, 0]),
    Tree::new([3, 5, 5, 4, 9, 0, 5], [149, 81, 0, 193, 89, 96, 210], [-2, 2, -2, 2, -2, -2, -5, -2]),
    Tree::new([11, 5, 2, 6, 10, 6, 8], [97, 176, 157, 202, 251, 243, 178], [-4, -1, -2, -1, -1, 3, 4, -1]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [244, 228, 146, 159, 201, 194, 176], [-5, -2, -1, 2, 0, 3, -4, 1]),
    Tree::new([3, 5, 5, 4, 8, 0, 5], [149, 84, 0, 193, 151, 96, 210], [-2, 2, 2, -2, -2, -2, -5, -2]),
    Tree::new([10, 6, 8, 11, 10, 1, 5], [230, 228, 130, 179, 173, 40, 176], [-5, -3, -2, 1, 2, -2, -3, 1]),
    Tree::new([3, 4, 5, 0, 3, 1, 5], [149, 60, 0, 228, 57, 30, 204], [-2, 3, 3, 0, -2, -2, -4, -2]),
    Tree::new([10, 11, 8, 2, 10, 7, 2], [251, 159, 178, 167, 173, 203, 217], [-4, -1, -1, 2, 0, 3, -4, 1]),
    Tree::new([9, 7, 5, 10, 5, 11, 3], [77, 126, 61, 251, 219, 142, 149], [0, 1, -4, 0, -3, 1, 1, -4]),
    Tree::new([10, 6, 8, 11, 10, 7, 2], [230, 228, 178, 179, 173, 203, 214], [-4, -2, -2, 1, -1, 2, -4, 0]),
    Tree::new([2, 0, 9, 4, 5, 8, 8], [156, 221, 148, 14, 133, 98, 2], [-4, 0, 2, 0, 2, -2, -1, 4]),
    Tree::new([3, 4, 5, 6, 10, 4, 7], [163, 121, 0, 231, 251, 205, 222], [-1, 2, -1, 4, -2, -2, -4, -2]),
    Tree::new([10, 6, 8, 11, 10, 7, 2], [230, 228, 178, 179, 173, 198, 214], [-4, -2, -2, 1, -1, 2, -4, 0]),
    Tree::new([9, 5, 5, 2, 10, 2, 3], [69, 215, 84, 205, 194, 166, 71], [-4, 0, 0, 1, -2, 1, 2, -2]),
    Tree::new([10, 6, 8, 7, 10, 4, 5], [251, 228, 188, 212, 201, 65, 203], [-4, -1, -1, 1, 0, 2, -4, 0]),
    Tree::new([3, 4, 5, 2, 9, 4, 7], [163, 121, 0, 17, 147, 193, 222], [2, -1, 0, 3, -2, -2, -4, -2]),
    Tree::new([2, 0, 8, 4, 5, 8, 2], [156, 228, 109, 13, 133, 2, 193], [-3, 0, 2, 0, -1, 3, -2, 2]),
    Tree::new([5, 5, 5, 5, 5, 9, 0], [191, 140, 242, 84, 171, 52, 183], [-2, 1, -5, 0, -2, 3, -3, 0]),
    Tree::new([10, 5, 8, 10, 5, 7, 5], [230, 216, 125, 109, 221, 186, 176], [0, -3, 0, 0, -1, 2, -2, 1]),
    Tree::new([3, 4, 7, 6, 8, 5, 9], [120, 118, 210, 223, 162, 210, 90], [-1, 1, 3, -1, -4, -1, -1, -1]),
    Tree::new([2, 2, 11, 9, 8, 9, 9], [156, 17, 68, 191, 13, 161, 104], [2, -1, -4, 0, -2, 0, 1, 3]),
    Tree::new([10, 5, 8, 10, 5, 11, 2], [223, 216, 178, 109, 221, 97, 182], [0, -4, 0, 0, -1, 1, -3, 0]),
    Tree::new([9, 7, 5, 10, 5, 5, 5], [69, 117, 191, 251, 215, 140, 242], [0, 1, -4, 0, 0, -3, 3, -3]),
    Tree::new([10, 6, 8, 7, 10, 11, 8], [251, 227, 13, 212, 173, 175, 188], [-3, -1, -1, 1, -3, 2, 1, -3]),
    Tree::new([2, 3, 8, 4, 7, 9, 8], [193, 89, 2, 72, 200, 190, 220], [-1, 2, -3, -1, 0, -1, 3, -1]),
    Tree::new([9, 7, 5, 10, 5, 0, 3], [69, 117, 84, 251, 215, 228, 68], [0, 1, -3, 0, -2, 1, 1, -2]),
    Tree::new([4, 2, 3, 5, 3, 5, 5], [14, 17, 48, 140, 0, 114, 133], [2, -1, -1, -4, 1, 3, 1, -3]),
    Tree::new([10, 5, 8, 10, 5, 1, 2], [223, 217, 167, 124, 221, 39, 180], [0, -3, 0, 0, 1, -1, -3, 0]),
    Tree::new([2, 0, 9, 7, 8, 5, 8], [156, 221, 158, 186, 13, 124, 2], [-2, 0, 0, 3, -2, 1, -1, 3]),
    Tree::new([10, 11, 8, 2, 10, 11, 8], [251, 128, 13, 167, 194, 191, 188], [-3, -1, -1, 1, -3, 2, 1, -3]),
    Tree::new([3, 4, 7, 5, 9, 0, 0], [211, 177, 234, 176, 141, 255, 255], [-1, 2, 0, 4, -3, -3, -1, -1]),
    Tree::new([9, 7, 10, 10, 2, 10, 5], [69, 117, 223, 251, 205, 124, 84], [0, 1, -3, 0, 0, -3, -1, 1]),
    Tree::new([2, 8, 11, 4, 5, 7, 8], [193, 125, 68, 81, 176, 226, 220], [-1, 1, -2, 1, -1, 0, 3, 1]),
    Tree::new([3, 4, 7, 0, 9, 0, 0], [211, 187, 234, 228, 141, 255, 255], [-1, 1, 0, 3, -3, -3, -1, -1]),
    Tree::new([3, 4, 7, 5, 9, 0, 2], [163, 175, 210, 176, 141, 255, 134], [-1, 1, 0, 3, -3, -3, -1, -1]),
    Tree::new([5, 5, 5, 6, 10, 2, 5], [140, 116, 168, 189, 216, 209, 242], [-2, 0, -2, 2, -5, 0, 1, -3]),
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
