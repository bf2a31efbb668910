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
const BIAS: i32 = 103;

const _: () = assert!(PROPERTIES <= 16, "a property has four bits in a tree");

// docs/decisions/0014-look-alikes.md says on what they were fitted.
#[rustfmt::skip]
const TREES: [Tree; 37] = [
    Tree::new([13, 9, 0, 6, 3, 12, 2], [87, 120, 104, 169, 213, 104, 43], [-22, -5, -12, -5, -4, 0, 4, 0]),
    Tree::new([13, 11, 4, 6, 9, 8, 6], [91, 68, 207, 174, 104, 2, 88], [-13, -8, -8, -3, -3, 2, 5, 0]),
    Tree::new([13, 11, 3, 6, 9, 6, 8], [82, 59, 92, 167, 135, 11, 2], [-10, -7, -6, -3, 5, 1, -3, 1]),
    Tree::new([13, 9, 3, 15, 8, 0, 8], [91, 105, 92, 146, 8, 255, 2], [-10, -1, -8, -1, 4, 4, -1, 1]),
    Tree::new([0, 9, 2, 15, 8, 8, 12], [105, 105, 43, 153, 2, 66, 94], [-8, -1, -8, -1, 3, 1, -1, 1]),
    Tree::new([5, 2, 8, 13, 11, 11, 9], [23, 33, 2, 70, 80, 107, 104], [2, 4, 0, 2, -9, 0, -7, 0]),
    Tree::new([1, 9, 4, 6, 5, 8, 13], [132, 96, 207, 32, 116, 2, 99], [0, -7, 0, -6, 0, 2, 0, 4]),
    Tree::new([4, 13, 13, 9, 8, 0, 4], [205, 77, 99, 167, 2, 255, 207], [-5, -2, -2, 1, -1, -1, 2, 4]),
    Tree::new([5, 2, 8, 2, 11, 9, 8], [12, 30, 2, 17, 85, 230, 82], [4, 2, 0, 2, -2, -10, 0, -4]),
    Tree::new([15, 9, 2, 6, 7, 9, 12], [154, 150, 50, 51, 148, 146, 101], [0, -4, 0, -5, 1, 3, 0, 1]),
    Tree::new([3, 13, 8, 0, 6, 9, 9], [92, 98, 2, 255, 3, 231, 95], [0, 0, 4, 2, -2, -9, -5, 1]),
    Tree::new([4, 11, 9, 2, 5, 9, 2], [206, 80, 146, 50, 24, 145, 65], [-1, -3, 2, -1, 2, -2, 4, 0]),
    Tree::new([4, 8, 9, 8, 6, 2, 1], [208, 130, 146, 2, 56, 20, 116], [-2, 0, 1, -6, 2, -2, 0, 4]),
    Tree::new([3, 13, 8, 0, 6, 9, 8], [92, 98, 2, 255, 3, 231, 50], [0, 0, 3, 1, -1, -7, 2, -1]),
    Tree::new([9, 6, 8, 9, 15, 5, 6], [81, 31, 114, 73, 167, 121, 72], [0, 1, -5, 0, 1, -4, 1, -5]),
    Tree::new([9, 6, 12, 3, 9, 2, 8], [149, 15, 104, 9, 145, 57, 40], [0, 3, -2, -7, 1, -2, 4, 1]),
    Tree::new([9, 6, 8, 9, 7, 5, 7], [81, 31, 130, 73, 59, 141, 73], [0, 1, 0, -4, 1, -4, 1, -5]),
    Tree::new([4, 11, 9, 2, 5, 2, 9], [208, 80, 146, 50, 24, 20, 230], [0, -2, 2, 0, 2, -2, 4, 1]),
    Tree::new([9, 6, 8, 9, 15, 8, 3], [81, 31, 103, 73, 167, 2, 217], [0, 1, -4, 0, -1, 1, -4, 0]),
    Tree::new([3, 6, 8, 15, 9, 9, 10], [87, 3, 2, 192, 164, 231, 223], [0, 3, -2, 1, -1, -6, -5, 0]),
    Tree::new([4, 11, 9, 2, 8, 2, 9], [208, 80, 146, 50, 45, 20, 230], [0, -2, 1, 0, 2, -2, 3, 1]),
    Tree::new([4, 10, 9, 12, 9, 9, 9], [208, 223, 146, 96, 242, 145, 230], [-6, 1, 0, -3, 1, -2, 3, 1]),
    Tree::new([8, 9, 6, 5, 8, 0, 7], [130, 74, 56, 11, 2, 255, 73], [0, -4, -1, 1, 1, 1, 0, -5]),
    Tree::new([3, 1, 9, 3, 0, 9, 6], [92, 227, 244, 45, 255, 149, 43], [-2, 2, 3, 3, -1, 1, -5, 1]),
    Tree::new([8, 5, 6, 11, 8, 4, 7], [66, 110, 49, 59, 8, 139, 148], [-1, 1, -5, -1, 3, 0, -1, -5]),
    Tree::new([13, 8, 8, 4, 10, 9, 6], [69, 8, 50, 134, 251, 228, 33], [-5, -1, -3, -1, 1, -1, 2, -1]),
    Tree::new([2, 5, 8, 9, 4, 6, 10], [15, 43, 2, 221, 157, 30, 223], [3, 2, 1, 1, -3, 0, -4, 0]),
    Tree::new([9, 5, 8, 15, 8, 11, 6], [74, 11, 135, 139, 151, 80, 72], [-1, 1, -4, -2, 0, 1, 1, -4]),
    Tree::new([3, 6, 8, 15, 9, 6, 8], [87, 3, 2, 192, 164, 57, 45], [0, 3, -2, 1, -3, 1, 1, -1]),
    Tree::new([9, 6, 14, 9, 8, 13, 7], [164, 15, 61, 163, 2, 115, 148], [3, -1, -4, -1, -5, 0, 2, 0]),
    Tree::new([1, 10, 0, 12, 8, 0, 0], [227, 223, 255, 96, 8, 255, 255], [-5, 1, -1, 0, 3, 3, 3, 3]),
    Tree::new([9, 5, 8, 15, 8, 9, 6], [74, 11, 135, 139, 151, 228, 72], [-1, 1, -3, -2, 0, -1, 1, -4]),
    Tree::new([5, 3, 10, 4, 7, 9, 9], [12, 186, 223, 229, 162, 183, 230], [0, 3, 3, 0, -4, 0, 0, -3]),
    Tree::new([8, 13, 6, 8, 6, 6, 3], [50, 68, 33, 8, 49, 4, 224], [-4, -1, 0, 2, -1, 3, -2, 0]),
    Tree::new([4, 10, 1, 12, 4, 3, 0], [203, 223, 227, 101, 175, 45, 255], [-4, 1, 0, -1, -2, 1, 3, 3]),
    Tree::new([1, 4, 3, 10, 13, 1, 8], [133, 191, 165, 244, 130, 227, 82], [-2, 0, -6, 0, 0, 3, 3, 0]),
    Tree::new([9, 5, 8, 15, 8, 8, 4], [74, 11, 140, 139, 151, 8, 97], [-1, 1, -3, -1, -1, 0, 1, -3]),
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

    /// An object that is seen whole, and one of which a third agrees here and there.
    const WHOLE: [u8; PROPERTIES] = [255, 240, 0, 10, 240, 0, 0, 128, 0, 200, 255, 100, 110, 150, 100, 200];
    const SCATTERED: [u8; PROPERTIES] = [20, 25, 60, 240, 40, 140, 20, 230, 90, 120, 255, 28, 42, 40, 50, 70];

    #[test]
    fn what_is_seen_whole_is_believed_and_what_agrees_here_and_there_is_not() {
        let (whole, scattered) = (believe(&Scrutiny(WHOLE)), believe(&Scrutiny(SCATTERED)));
        assert!(whole > 0.95 && scattered < 0.8, "{whole} {scattered}");
        assert!(believe(&Scrutiny::STRANGE) < 0.2);
    }

    #[test]
    fn more_agreement_is_never_believed_less() {
        for name in ["good", "agree", "votes", "agreeing", "strong", "support"] {
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
