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
const BIAS: i32 = 57;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0014-look-alikes.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 40] = [
    Tree::new([5, 11, 3, 2, 9, 9, 5], [85, 136, 97, 28, 239, 79, 111], [0, -7, 6, 1, 2, 8, -7, 2]),
    Tree::new([11, 5, 5, 6, 10, 11, 3], [112, 89, 85, 219, 244, 139, 119], [-7, -1, -5, 1, 1, 5, 7, 1]),
    Tree::new([5, 11, 3, 2, 9, 9, 5], [85, 126, 97, 28, 228, 79, 111], [-1, -5, 4, 0, 1, 6, -6, 1]),
    Tree::new([5, 11, 3, 2, 9, 9, 7], [85, 138, 119, 29, 249, 79, 219], [0, -5, 4, 0, 0, 6, -6, 0]),
    Tree::new([11, 10, 5, 6, 8, 3, 3], [107, 251, 81, 231, 140, 0, 119], [-7, 0, 0, -5, 3, 0, 5, 0]),
    Tree::new([5, 11, 9, 10, 11, 7, 8], [111, 123, 73, 251, 152, 222, 167], [-6, -2, 1, 4, -3, 1, 6, -1]),
    Tree::new([5, 11, 9, 6, 1, 2, 8], [111, 117, 73, 210, 30, 85, 167], [-4, -1, 3, -1, 1, -3, 5, -1]),
    Tree::new([5, 0, 9, 10, 2, 7, 8], [111, 236, 73, 251, 87, 222, 167], [-5, -1, 6, 2, -2, 1, 5, -1]),
    Tree::new([5, 0, 3, 3, 2, 8, 5], [85, 236, 104, 0, 87, 146, 103], [0, -4, 5, 1, 4, 1, -4, 1]),
    Tree::new([11, 6, 9, 5, 3, 10, 2], [94, 218, 222, 89, 74, 244, 78], [-4, -2, 0, -2, 0, 4, 0, 2]),
    Tree::new([10, 6, 8, 11, 9, 9, 7], [244, 230, 135, 163, 104, 229, 221], [-6, -1, 0, 3, 3, -2, -5, 0]),
    Tree::new([5, 3, 3, 11, 5, 8, 7], [81, 0, 86, 94, 29, 146, 210], [-1, 2, -5, -1, 4, 0, -4, 0]),
    Tree::new([10, 6, 8, 11, 3, 7, 7], [244, 228, 146, 163, 86, 205, 235], [-5, -2, 2, 0, 0, 4, -4, 2]),
    Tree::new([3, 5, 5, 0, 8, 11, 6], [104, 41, 103, 237, 125, 159, 174], [-2, 4, 4, -1, -5, -2, -2, -2]),
    Tree::new([10, 11, 11, 6, 0, 8, 2], [244, 158, 68, 230, 122, 71, 61], [-5, -1, 0, 2, 0, -4, 0, 3]),
    Tree::new([2, 0, 2, 9, 3, 0, 9], [23, 217, 58, 149, 153, 227, 147], [1, -1, 4, 2, -5, 3, -3, 2]),
    Tree::new([3, 5, 7, 0, 10, 7, 3], [119, 64, 217, 237, 237, 43, 131], [-2, 4, -2, 3, -2, -5, -2, -2]),
    Tree::new([10, 6, 8, 11, 3, 7, 2], [244, 221, 167, 153, 101, 196, 22], [-5, -2, 2, -1, -1, 3, 0, -4]),
    Tree::new([2, 0, 2, 8, 10, 0, 11], [23, 219, 58, 29, 173, 227, 59], [-1, 1, 2, 4, -4, 2, -4, 1]),
    Tree::new([3, 0, 5, 7, 7, 7, 2], [104, 113, 103, 219, 193, 218, 97], [-2, 0, 0, 4, -5, -2, -2, -2]),
    Tree::new([10, 11, 8, 7, 6, 8, 7], [251, 152, 130, 238, 175, 2, 217], [-4, -1, 0, 2, -2, 2, -3, 0]),
    Tree::new([0, 8, 4, 7, 10, 3, 1], [237, 2, 104, 44, 237, 123, 21], [0, -5, -4, 0, 4, 2, 2, 2]),
    Tree::new([5, 3, 9, 0, 7, 0, 10], [120, 104, 51, 120, 218, 255, 237], [-2, 1, -4, -2, -3, -3, 0, 3]),
    Tree::new([0, 7, 2, 9, 2, 3, 3], [237, 196, 102, 208, 50, 123, 13], [-1, -4, -4, 1, 4, 1, 1, 1]),
    Tree::new([8, 10, 2, 6, 7, 11, 7], [167, 244, 37, 225, 205, 94, 239], [-4, 2, 0, 3, 0, 0, -4, 0]),
    Tree::new([2, 0, 2, 9, 10, 4, 7], [23, 219, 58, 149, 173, 18, 180], [1, -1, 2, 3, -4, 2, -3, 1]),
    Tree::new([8, 9, 7, 10, 2, 6, 8], [114, 222, 217, 230, 78, 225, 167], [-3, 2, -3, 1, -4, 1, 2, -3]),
    Tree::new([11, 10, 1, 6, 8, 6, 2], [169, 251, 30, 228, 2, 202, 61], [-3, 1, -3, 1, 2, 3, 1, 2]),
    Tree::new([11, 8, 7, 9, 7, 0, 9], [68, 61, 209, 211, 134, 237, 148], [-1, -1, -1, -3, -1, 3, -1, 3]),
    Tree::new([0, 2, 7, 5, 9, 2, 8], [122, 67, 182, 87, 146, 33, 93], [-4, 0, -3, 0, 2, 0, 4, 0]),
    Tree::new([3, 0, 7, 7, 7, 7, 5], [119, 120, 217, 220, 180, 43, 55], [-1, 0, 0, 3, -1, -4, -1, -1]),
    Tree::new([8, 8, 2, 7, 10, 8, 7], [167, 2, 37, 44, 251, 194, 239], [2, -4, -2, 1, 0, 0, -4, 0]),
    Tree::new([11, 2, 3, 0, 5, 2, 5], [59, 35, 0, 160, 101, 63, 64], [-1, -1, -3, -1, 1, 3, -1, 1]),
    Tree::new([0, 8, 2, 4, 8, 3, 7], [236, 2, 87, 77, 82, 41, 100], [-4, 0, 1, -1, 3, 1, 1, 1]),
    Tree::new([3, 4, 7, 2, 5, 5, 5], [119, 77, 217, 29, 64, 114, 63], [2, -1, -1, 3, -4, -1, -1, -1]),
    Tree::new([8, 7, 2, 2, 10, 8, 7], [167, 199, 37, 33, 244, 194, 239], [2, -2, -3, 2, 0, 0, -3, 0]),
    Tree::new([11, 10, 1, 6, 8, 2, 2], [169, 244, 30, 225, 2, 157, 61], [-3, 1, -3, 0, 3, 2, 1, 1]),
    Tree::new([8, 7, 2, 0, 9, 8, 7], [167, 209, 37, 127, 128, 194, 239], [-2, 0, -2, 2, 0, 0, -3, 0]),
    Tree::new([3, 2, 5, 6, 7, 4, 3], [0, 65, 33, 240, 183, 210, 119], [0, 2, 0, 3, -4, 0, 0, -2]),
    Tree::new([0, 2, 8, 9, 9, 7, 1], [236, 59, 2, 175, 121, 103, 53], [1, -3, -3, 1, 1, 1, 3, 1]),
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
    const WHOLE: [u8; PROPERTIES] = [255, 0, 0, 13, 0, 128, 255, 0, 0, 191, 255, 100];
    const SCATTERED: [u8; PROPERTIES] = [90, 60, 90, 120, 90, 128, 140, 160, 60, 190, 255, 60];

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
