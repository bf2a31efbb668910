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
const BIAS: i32 = 56;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0014-look-alikes.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 48] = [
    Tree::new([9, 15, 6, 4, 12, 13, 9], [85, 138, 99, 28, 2, 79, 111], [0, -7, 0, 6, 2, 8, -7, 2]),
    Tree::new([9, 15, 6, 4, 13, 13, 9], [85, 126, 95, 28, 235, 79, 111], [-1, -6, 4, 0, 1, 7, -6, 1]),
    Tree::new([15, 9, 9, 10, 14, 15, 6], [107, 101, 85, 219, 244, 140, 120], [-6, -1, -2, 0, 0, 4, 6, 0]),
    Tree::new([9, 15, 6, 14, 11, 14, 11], [85, 136, 120, 251, 180, 244, 217], [-7, -3, 1, 5, 1, 6, -5, 1]),
    Tree::new([9, 15, 13, 14, 8, 11, 12], [111, 117, 73, 251, 52, 222, 167], [-6, -2, 4, 0, -3, 1, 6, -1]),
    Tree::new([9, 15, 6, 14, 12, 12, 9], [85, 138, 99, 251, 2, 146, 111], [-6, -2, 0, 3, 5, 1, -4, 1]),
    Tree::new([15, 10, 9, 9, 3, 8, 6], [107, 211, 81, 89, 19, 0, 120], [-5, -2, 0, -2, 3, 0, 5, 0]),
    Tree::new([9, 15, 13, 14, 8, 11, 12], [111, 123, 73, 251, 48, 222, 167], [-5, -1, 3, 0, -3, 1, 5, -1]),
    Tree::new([9, 0, 3, 8, 4, 12, 9], [85, 236, 41, 0, 199, 146, 111], [0, -4, 6, 2, 5, 2, -3, 2]),
    Tree::new([15, 10, 9, 9, 3, 8, 6], [90, 206, 81, 89, 19, 0, 88], [-4, -2, 0, -2, 2, 0, 4, 0]),
    Tree::new([14, 10, 12, 15, 13, 13, 11], [244, 230, 135, 164, 104, 229, 221], [-6, -1, 0, 3, 3, -2, -5, 0]),
    Tree::new([9, 8, 6, 14, 0, 12, 11], [64, 0, 102, 251, 236, 125, 217], [-2, 2, -5, -2, 4, 0, -5, 0]),
    Tree::new([14, 10, 12, 15, 13, 5, 11], [244, 228, 146, 163, 104, 20, 235], [-5, -1, 0, 2, 4, 0, -4, 2]),
    Tree::new([9, 8, 6, 4, 0, 12, 9], [33, 0, 102, 58, 238, 125, 103], [-2, 2, -5, -2, 4, 0, -4, 0]),
    Tree::new([0, 8, 4, 4, 4, 6, 3], [236, 61, 199, 59, 37, 124, 9], [-1, 2, -1, -4, 5, 2, 2, 2]),
    Tree::new([14, 10, 12, 15, 13, 11, 4], [244, 228, 167, 164, 104, 205, 22], [-5, -1, 0, 2, 0, 3, 0, -5]),
    Tree::new([9, 8, 6, 15, 0, 12, 11], [29, 0, 120, 75, 238, 125, 217], [-2, 1, -5, -2, 3, 0, -4, 0]),
    Tree::new([4, 0, 5, 12, 8, 12, 9], [23, 217, 22, 29, 195, 2, 111], [-1, 1, 4, 2, 0, 3, -2, 0]),
    Tree::new([14, 10, 12, 15, 10, 11, 4], [244, 221, 167, 153, 230, 205, 37], [-5, -2, 0, 2, 0, 3, 0, -4]),
    Tree::new([0, 12, 4, 2, 15, 6, 5], [236, 2, 87, 142, 68, 124, 12], [1, -6, -3, 1, 4, 2, 2, 2]),
    Tree::new([14, 15, 12, 11, 13, 2, 11], [251, 152, 146, 238, 254, 167, 224], [-4, -1, 2, 0, 3, 0, -4, 0]),
    Tree::new([4, 0, 4, 12, 8, 0, 8], [23, 217, 58, 29, 195, 227, 63], [-1, 1, 4, 2, -4, 3, 2, -3]),
    Tree::new([9, 8, 8, 4, 10, 12, 0], [64, 0, 58, 65, 233, 103, 217], [-1, 1, -4, -1, 4, 1, -2, 1]),
    Tree::new([14, 10, 12, 15, 0, 12, 4], [244, 221, 167, 153, 136, 2, 37], [-4, -2, -1, 1, -3, 1, 0, -4]),
    Tree::new([0, 5, 7, 12, 9, 6, 2], [237, 19, 104, 2, 81, 124, 240], [0, 2, -2, 0, 4, 2, 2, 2]),
    Tree::new([4, 0, 4, 13, 12, 7, 15], [29, 219, 58, 149, 8, 18, 59], [2, -1, 2, 4, -4, 1, -3, 1]),
    Tree::new([14, 0, 12, 4, 6, 12, 4], [237, 198, 130, 44, 84, 2, 170], [-2, -4, 1, 0, -3, 2, -3, 1]),
    Tree::new([0, 2, 11, 14, 7, 4, 12], [120, 129, 193, 244, 70, 32, 93], [-4, 0, -4, -1, 3, 0, 5, 0]),
    Tree::new([14, 15, 8, 4, 10, 7, 4], [251, 158, 63, 170, 175, 62, 37], [-4, -1, 0, 2, 0, 3, 0, -3]),
    Tree::new([0, 12, 7, 7, 15, 6, 3], [237, 13, 104, 77, 59, 124, 30], [-4, 1, -2, 1, 3, 1, 1, 1]),
    Tree::new([14, 0, 12, 4, 6, 11, 4], [237, 198, 167, 44, 84, 199, 37], [-1, -4, 1, 0, 0, 2, 0, -3]),
    Tree::new([0, 11, 12, 13, 13, 11, 6], [236, 194, 2, 206, 146, 128, 88], [0, -4, -2, 1, 2, 1, 4, 1]),
    Tree::new([0, 2, 11, 14, 7, 4, 12], [122, 153, 182, 244, 124, 32, 93], [-3, 0, -4, 0, 2, 0, 4, 0]),
    Tree::new([9, 0, 13, 5, 7, 0, 7], [120, 237, 51, 19, 104, 255, 6], [1, -1, 3, 1, -3, -3, 0, 3]),
    Tree::new([14, 15, 12, 4, 12, 11, 5], [251, 158, 2, 170, 93, 44, 19], [-3, -1, 2, 0, 1, -4, 3, 0]),
    Tree::new([4, 12, 15, 11, 0, 3, 2], [23, 18, 59, 52, 160, 16, 129], [1, -1, 0, 3, -1, -3, 2, -1]),
    Tree::new([12, 14, 4, 10, 12, 3, 9], [167, 237, 37, 225, 2, 27, 117], [-4, 1, -2, 1, 0, 0, -3, 0]),
    Tree::new([12, 13, 11, 13, 2, 10, 12], [103, 210, 217, 53, 170, 225, 167], [-4, 2, 1, -3, -3, 1, 2, -2]),
    Tree::new([0, 11, 12, 13, 4, 15, 1], [236, 194, 2, 189, 50, 138, 53], [0, -3, -3, 1, 1, 1, 3, 1]),
    Tree::new([14, 10, 12, 15, 11, 8, 11], [237, 225, 114, 164, 186, 63, 215], [-4, -1, 1, 0, 2, -1, -2, 1]),
    Tree::new([4, 0, 4, 13, 12, 13, 13], [29, 219, 58, 149, 18, 175, 147], [1, -1, 1, 3, 1, -3, -2, 1]),
    Tree::new([15, 14, 1, 10, 12, 4, 7], [169, 244, 30, 225, 2, 157, 18], [-3, 0, -3, 0, 3, 2, 1, 1]),
    Tree::new([12, 13, 11, 14, 2, 0, 15], [82, 208, 219, 230, 170, 171, 75], [-2, 2, 1, -2, -2, 1, -1, 2]),
    Tree::new([6, 0, 11, 2, 7, 8, 5], [120, 113, 217, 129, 10, 63, 41], [0, -1, 0, 2, -1, -4, -1, -1]),
    Tree::new([10, 2, 4, 15, 0, 9, 4], [244, 165, 78, 59, 113, 104, 99], [-2, 1, -4, 0, 3, 1, 1, 1]),
    Tree::new([14, 10, 12, 4, 14, 11, 5], [251, 231, 2, 170, 173, 66, 19], [-3, 0, 0, 2, 1, -3, 2, 0]),
    Tree::new([12, 11, 4, 4, 4, 3, 9], [167, 194, 37, 37, 50, 27, 117], [1, -2, -3, 1, 0, 0, -3, 0]),
    Tree::new([12, 11, 11, 0, 4, 2, 13], [82, 180, 129, 225, 58, 125, 146], [-2, 1, -3, 3, 0, 3, -3, 0]),
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
