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

/// Log-odds without any tree, in steps: as fitted, and 68 more, so that half-hidden objects are found.
const BIAS: i32 = 65;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0023-small-cells.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([6, 5, 3, 11, 3, 5, 2], [204, 177, 88, 109, 81, 84, 227], [-7, -2, 0, -4, 3, 8, 0, 0]),
    Tree::new([11, 5, 3, 6, 3, 5, 5], [121, 61, 68, 236, 88, 81, 0], [-8, 0, 0, -7, 3, 7, 1, 0]),
    Tree::new([6, 5, 3, 7, 3, 5, 3], [208, 61, 88, 241, 72, 84, 93], [-7, 0, 0, -6, 2, 6, 0, 0]),
    Tree::new([3, 5, 7, 4, 9, 2, 5], [88, 81, 225, 211, 89, 206, 127], [-2, 2, -2, 5, -7, -2, -2, -2]),
    Tree::new([5, 6, 3, 11, 11, 4, 5], [61, 236, 69, 145, 139, 61, 99], [-6, -3, -1, 2, 2, 6, -1, -6]),
    Tree::new([11, 10, 8, 6, 5, 5, 2], [123, 251, 151, 238, 60, 81, 211], [-6, 0, -5, 0, 0, 5, 0, 1]),
    Tree::new([3, 5, 7, 4, 8, 2, 0], [93, 81, 223, 211, 151, 206, 53], [-2, 2, 4, -2, -6, -2, -2, -2]),
    Tree::new([6, 7, 11, 5, 5, 7, 1], [207, 203, 145, 180, 61, 186, 29], [-5, 0, -5, 0, 0, 2, 5, 2]),
    Tree::new([5, 6, 3, 4, 8, 4, 5], [61, 235, 72, 208, 8, 14, 91], [-5, -2, -1, 2, 0, 4, -1, -5]),
    Tree::new([10, 11, 8, 6, 6, 7, 5], [251, 153, 151, 234, 209, 203, 176], [-5, -1, -1, 3, 0, 5, -5, 1]),
    Tree::new([5, 2, 3, 0, 8, 9, 7], [81, 166, 88, 230, 98, 147, 222], [-5, 1, 3, -2, 0, 4, -5, -1]),
    Tree::new([11, 6, 1, 5, 10, 9, 7], [97, 180, 34, 176, 251, 148, 198], [-5, -3, -3, -1, 1, 3, -1, 1]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [244, 228, 130, 159, 173, 203, 176], [-5, -2, -2, 2, 0, 4, -4, 1]),
    Tree::new([5, 11, 3, 0, 1, 8, 7], [61, 142, 96, 221, 27, 130, 223], [-5, -2, 2, -2, 2, -1, -5, -1]),
    Tree::new([10, 11, 8, 2, 8, 7, 2], [251, 153, 178, 191, 87, 203, 215], [-5, -1, 2, -1, 0, 4, -5, 1]),
    Tree::new([5, 2, 3, 0, 8, 4, 7], [81, 156, 69, 232, 119, 8, 208], [-4, 1, 3, -2, 0, 3, -4, -1]),
    Tree::new([9, 7, 5, 2, 2, 4, 3], [71, 122, 81, 60, 206, 192, 151], [1, 0, -5, 0, -3, 1, 2, -4]),
    Tree::new([10, 6, 8, 11, 10, 1, 2], [230, 228, 178, 179, 173, 39, 215], [-5, -3, -2, 1, 2, -2, -5, 0]),
    Tree::new([10, 6, 8, 11, 10, 7, 2], [244, 234, 178, 159, 173, 203, 215], [-5, -1, -1, 3, 0, 3, -5, 1]),
    Tree::new([6, 7, 9, 4, 8, 3, 7], [234, 198, 191, 13, 178, 39, 163], [-4, -1, 1, -4, 4, 1, 1, 3]),
    Tree::new([3, 5, 5, 2, 10, 0, 5], [151, 84, 0, 166, 251, 91, 204], [-2, 2, -2, 2, -2, -2, -4, -2]),
    Tree::new([9, 7, 5, 2, 2, 4, 3], [71, 123, 81, 60, 206, 192, 163], [1, 0, -5, 0, -3, 2, 1, -4]),
    Tree::new([2, 0, 9, 4, 5, 8, 8], [156, 221, 148, 14, 133, 98, 2], [-3, 0, 3, 0, 2, -2, -1, 4]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [230, 228, 146, 179, 173, 194, 176], [-5, -2, -2, 1, 0, 2, -4, 1]),
    Tree::new([10, 6, 8, 11, 10, 7, 5], [230, 228, 130, 179, 201, 186, 176], [-4, -2, -2, 1, 0, 2, -3, 1]),
    Tree::new([3, 4, 5, 6, 9, 0, 7], [163, 121, 0, 231, 147, 99, 222], [-1, 2, 0, 4, -2, -2, -4, -2]),
    Tree::new([2, 0, 11, 4, 5, 9, 9], [156, 229, 80, 13, 133, 171, 105], [-3, 0, 3, 0, -2, 1, 1, 3]),
    Tree::new([10, 0, 8, 2, 10, 8, 5], [251, 231, 188, 172, 173, 13, 203], [-3, -1, -1, 3, -2, 1, -4, 0]),
    Tree::new([9, 7, 5, 10, 5, 2, 3], [69, 117, 84, 251, 215, 156, 68], [0, 1, -4, 0, -2, 1, 2, -2]),
    Tree::new([3, 4, 5, 2, 10, 0, 7], [163, 121, 0, 15, 230, 104, 222], [2, -1, -2, 3, -2, -2, -4, -2]),
    Tree::new([5, 5, 5, 5, 5, 9, 0], [204, 140, 242, 116, 170, 51, 183], [-1, 2, -6, 0, -2, 4, -3, 0]),
    Tree::new([10, 5, 8, 10, 5, 11, 2], [223, 217, 178, 109, 221, 97, 204], [0, -4, 0, 0, -1, 1, -3, 0]),
    Tree::new([2, 0, 11, 7, 8, 0, 9], [156, 221, 68, 186, 13, 156, 104], [-3, 0, 0, 3, -2, 1, 1, 3]),
    Tree::new([9, 7, 5, 10, 5, 5, 5], [69, 117, 191, 251, 215, 140, 242], [0, 1, -4, 0, 1, -3, 3, -3]),
    Tree::new([10, 5, 9, 10, 5, 3, 2], [223, 217, 247, 109, 221, 163, 99], [0, -3, 0, 0, 1, -3, -3, 0]),
    Tree::new([2, 8, 8, 4, 7, 8, 0], [193, 130, 220, 72, 156, 2, 255], [-1, 1, 2, -3, -1, 3, -1, -1]),
    Tree::new([9, 2, 5, 5, 1, 0, 3], [58, 193, 84, 215, 28, 110, 57], [-4, 0, 1, 0, -3, 0, 1, -2]),
    Tree::new([4, 2, 3, 5, 7, 5, 5], [14, 15, 48, 140, 205, 114, 133], [2, -2, -3, 0, 1, 3, 1, -3]),
    Tree::new([10, 5, 8, 10, 5, 8, 2], [223, 216, 188, 124, 221, 13, 182], [0, -3, 0, 0, -2, 1, -3, 0]),
    Tree::new([2, 2, 11, 9, 4, 6, 8], [156, 27, 94, 191, 72, 183, 183], [2, -2, -2, 0, -2, 1, 3, 1]),
    Tree::new([10, 6, 8, 7, 10, 7, 8], [251, 227, 13, 212, 173, 35, 188], [-3, -1, -1, 1, 1, -4, 1, -3]),
    Tree::new([3, 4, 7, 5, 9, 0, 0], [211, 177, 234, 176, 141, 255, 255], [-1, 1, 0, 4, -3, -3, -1, -1]),
    Tree::new([9, 2, 9, 5, 1, 5, 6], [58, 193, 247, 215, 28, 140, 236], [-4, 0, 1, 0, 1, -1, -3, 1]),
    Tree::new([10, 11, 8, 0, 10, 7, 5], [230, 143, 178, 230, 173, 198, 203], [-3, -2, -2, 1, 0, 1, -3, 1]),
    Tree::new([3, 4, 7, 0, 9, 0, 9], [163, 143, 210, 228, 93, 255, 149], [-1, 1, -1, 3, -3, -3, -1, -1]),
    Tree::new([5, 5, 5, 6, 5, 9, 0], [191, 140, 242, 189, 168, 51, 183], [-1, 1, -5, 0, -2, 3, -3, 0]),
    Tree::new([2, 2, 11, 9, 8, 5, 9], [156, 27, 68, 191, 8, 189, 104], [2, -2, -4, 0, -1, 0, 0, 2]),
    Tree::new([8, 11, 0, 9, 10, 7, 9], [13, 195, 205, 191, 173, 186, 171], [-1, -4, 0, 2, -2, 0, 4, 1]),
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
