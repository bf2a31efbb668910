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

/// Log-odds without any tree, in steps.
const BIAS: i32 = 54;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0014-look-alikes.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([15, 9, 9, 10, 6, 15, 6], [117, 111, 85, 219, 78, 149, 69], [-7, -3, 1, -5, 1, 5, 8, 1]),
    Tree::new([9, 15, 6, 14, 12, 13, 15], [111, 136, 76, 251, 2, 72, 107], [-8, -4, 0, 5, 2, 7, -5, 1]),
    Tree::new([9, 15, 6, 10, 8, 12, 13], [111, 123, 69, 217, 54, 151, 146], [-6, -2, 4, 0, 7, 2, -5, 2]),
    Tree::new([15, 9, 9, 10, 6, 15, 6], [104, 119, 85, 209, 87, 154, 69], [-6, -2, 0, -4, 0, 4, 6, 0]),
    Tree::new([9, 15, 6, 14, 11, 13, 13], [119, 135, 69, 251, 181, 72, 146], [-6, -2, 1, 5, 2, 6, -4, 2]),
    Tree::new([9, 15, 6, 8, 8, 13, 11], [85, 138, 76, 0, 0, 76, 206], [-1, -5, 4, 0, 1, 5, -5, 0]),
    Tree::new([15, 9, 9, 0, 6, 8, 6], [101, 96, 81, 235, 78, 0, 76], [-4, 0, 0, -4, 3, 0, 5, 0]),
    Tree::new([9, 15, 6, 14, 11, 13, 13], [119, 114, 63, 251, 195, 72, 146], [-5, -2, -1, 3, 2, 5, -3, 2]),
    Tree::new([9, 0, 6, 8, 8, 12, 11], [85, 237, 83, 0, 184, 146, 217], [0, -4, 6, 1, 4, 0, -4, 0]),
    Tree::new([14, 15, 12, 10, 0, 11, 9], [244, 159, 146, 230, 127, 204, 120], [-6, -1, -1, 3, 1, 5, -5, 1]),
    Tree::new([6, 9, 8, 0, 12, 11, 11], [87, 64, 66, 237, 146, 198, 226], [-2, 4, 4, -2, -2, -2, -5, -3]),
    Tree::new([14, 0, 12, 9, 6, 9, 9], [244, 196, 156, 163, 81, 81, 124], [-6, -2, 3, -1, 0, 3, -5, 0]),
    Tree::new([15, 10, 1, 11, 9, 8, 11], [90, 202, 30, 215, 63, 51, 204], [-4, -2, -2, 0, 4, 1, 0, 1]),
    Tree::new([14, 15, 12, 10, 12, 11, 9], [251, 150, 151, 223, 77, 203, 118], [-5, -1, 3, 0, 0, 4, -4, 0]),
    Tree::new([14, 0, 12, 9, 6, 1, 0], [244, 195, 167, 163, 81, 35, 155], [-5, -1, 2, -1, 2, -1, -4, 1]),
    Tree::new([9, 8, 13, 9, 0, 11, 14], [119, 57, 72, 64, 220, 151, 237], [-1, 3, -4, -1, 0, -4, -1, 3]),
    Tree::new([15, 14, 0, 10, 6, 5, 13], [152, 251, 112, 229, 87, 33, 239], [-4, 1, 1, -3, 1, 1, 4, 2]),
    Tree::new([0, 8, 7, 9, 9, 8, 4], [237, 61, 79, 64, 111, 189, 41], [-1, 2, -4, -1, 5, 2, 2, 2]),
    Tree::new([14, 10, 12, 9, 15, 11, 0], [244, 219, 167, 160, 158, 206, 152], [-5, -2, 0, 2, 0, 3, -4, 1]),
    Tree::new([0, 11, 11, 15, 13, 0, 12], [116, 207, 191, 136, 96, 237, 109], [-4, -1, -4, 0, 0, 4, 5, 0]),
    Tree::new([9, 8, 6, 4, 9, 0, 11], [81, 0, 63, 61, 33, 116, 197], [-1, 2, -4, -1, 1, 4, -3, 1]),
    Tree::new([14, 0, 12, 9, 6, 13, 11], [244, 195, 130, 163, 81, 235, 226], [-4, -1, 2, 0, 2, -2, -3, 2]),
    Tree::new([15, 11, 2, 6, 9, 14, 0], [68, 132, 165, 83, 152, 251, 237], [-1, -1, -3, -1, -1, 3, -1, 3]),
    Tree::new([0, 12, 4, 2, 8, 8, 3], [236, 2, 92, 159, 61, 183, 17], [0, -6, 1, -2, 4, 1, 1, 1]),
    Tree::new([9, 8, 6, 4, 9, 0, 11], [81, 0, 87, 61, 33, 118, 198], [-1, 2, -3, -1, 0, 3, -4, 0]),
    Tree::new([14, 0, 12, 4, 10, 12, 0], [230, 198, 178, 168, 227, 2, 160], [-4, -2, 0, 1, -3, 1, -4, 0]),
    Tree::new([4, 10, 11, 13, 12, 0, 4], [30, 229, 194, 149, 13, 134, 57], [1, -2, 2, 5, -5, -1, -4, 1]),
    Tree::new([13, 11, 9, 11, 11, 8, 6], [72, 228, 81, 151, 229, 0, 89], [1, -4, 1, 0, 1, -2, 2, -2]),
    Tree::new([0, 11, 4, 13, 4, 12, 2], [227, 192, 68, 203, 50, 8, 57], [-1, -4, -4, 1, 2, 5, 2, 1]),
    Tree::new([14, 15, 12, 9, 0, 2, 0], [244, 158, 178, 160, 127, 153, 160], [-4, -1, 0, 2, 2, -1, -4, 0]),
    Tree::new([12, 12, 11, 11, 5, 0, 15], [125, 2, 226, 52, 23, 142, 75], [2, -4, 3, 0, -3, 1, -1, 3]),
    Tree::new([4, 10, 11, 13, 12, 13, 0], [33, 229, 181, 149, 18, 170, 118], [1, -2, 1, 4, 0, -4, -1, 2]),
    Tree::new([14, 0, 12, 4, 10, 13, 11], [230, 198, 130, 168, 227, 237, 226], [-4, -2, 0, 1, 1, -2, -2, 1]),
    Tree::new([14, 10, 2, 4, 9, 15, 0], [251, 218, 165, 155, 81, 59, 113], [-3, -1, 0, 2, -2, 2, -4, 0]),
    Tree::new([13, 11, 15, 11, 11, 11, 13], [72, 228, 165, 151, 229, 208, 249], [1, -4, 1, 0, -1, 1, 2, 1]),
    Tree::new([0, 2, 4, 15, 13, 12, 2], [230, 213, 77, 75, 206, 8, 57], [-2, 1, 0, -5, 1, 4, 1, 1]),
    Tree::new([14, 0, 12, 4, 10, 12, 0], [230, 194, 178, 168, 227, 2, 160], [-4, -1, 0, 1, -2, 1, -3, 0]),
    Tree::new([4, 10, 11, 13, 12, 9, 13], [33, 232, 192, 159, 18, 156, 148], [1, -2, 1, 4, -2, 2, -2, 1]),
    Tree::new([0, 2, 11, 13, 0, 13, 8], [135, 153, 180, 146, 102, 145, 54], [-2, 0, -4, -1, 3, 0, 3, 0]),
    Tree::new([0, 12, 12, 2, 12, 11, 1], [237, 2, 2, 159, 87, 128, 44], [0, -4, 1, -1, 1, 1, 3, 1]),
    Tree::new([14, 15, 11, 9, 0, 0, 12], [244, 158, 211, 160, 127, 131, 183], [-3, -1, 0, 2, -2, 1, 2, -3]),
    Tree::new([7, 6, 8, 0, 9, 12, 0], [199, 93, 102, 131, 111, 156, 255], [-1, 1, -3, -1, 4, 1, -1, -1]),
    Tree::new([4, 10, 12, 2, 9, 13, 6], [167, 244, 2, 213, 115, 160, 93], [0, -2, 4, 1, 0, -2, 3, -1]),
    Tree::new([14, 0, 12, 4, 10, 11, 12], [230, 177, 2, 168, 225, 64, 87], [-3, -1, 0, 1, 1, -4, 1, 0]),
    Tree::new([7, 6, 13, 0, 9, 8, 8], [152, 83, 148, 131, 111, 41, 102], [-1, 1, -4, -1, 0, -1, 3, -1]),
    Tree::new([11, 4, 4, 0, 9, 7, 12], [194, 37, 60, 219, 160, 69, 114], [0, 3, -2, 2, -3, 1, 3, -1]),
    Tree::new([14, 15, 2, 10, 4, 15, 0], [251, 104, 144, 225, 155, 59, 102], [-3, -1, -1, 2, -1, 2, -3, 0]),
    Tree::new([12, 11, 12, 10, 11, 13, 11], [18, 52, 77, 226, 176, 239, 128], [0, 1, -4, 0, 2, -1, 2, -1]),
];

/// Estimates the probability that a pose is right.
#[inline(never)]
pub(crate) fn believe(s: &Scrutiny) -> f32 {
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
    const WHOLE: [u8; PROPERTIES] = [255, 0, 255, 13, 0, 77, 13, 0, 77, 128, 255, 0, 0, 191, 255, 100];
    const SCATTERED: [u8; PROPERTIES] = [90, 60, 120, 80, 90, 150, 120, 90, 160, 128, 140, 160, 60, 190, 255, 60];

    #[test]
    fn what_is_seen_whole_is_believed_and_what_agrees_here_and_there_is_not() {
        let (whole, scattered) = (believe(&Scrutiny(WHOLE)), believe(&Scrutiny(SCATTERED)));
        assert!(whole > 0.95 && scattered < 0.8, "{whole} {scattered}");
    }

    #[test]
    fn more_agreement_is_never_believed_less() {
        for name in ["agree", "clump", "votes"] {
            let i = NAMES.iter().position(|&n| n == name).unwrap();
            for start in [WHOLE, SCATTERED] {
                let scores = (0..=255).map(|v| {
                    let mut s = start;
                    s[i] = v;
                    believe(&Scrutiny(s))
                });
                assert!(scores.is_sorted(), "{name}");
            }
        }
    }
}
