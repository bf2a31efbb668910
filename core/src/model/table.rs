//! Chooses the keygraphs of a picture that a model keeps, and the place of each.
//!
//! In: the subset and the cost of each keygraph, twice in the same order. Out: its place in the
//! model, if it is kept. A maximum for each subset of the partition and a maximum for the model
//! drop the most expensive keygraphs. Of the cost that is kept in part, evenly spread keygraphs are
//! kept.
//!
//! The keygraphs are enumerated twice, and only counts are held in between. The first pass counts
//! them, the second assigns the places.
//!
//! Memory: 45 KB. Cost: a few operations for each keygraph. Full: a keygraph without a place is not
//! kept.

use crate::base::capacity::count;
use crate::extract::keygraph::{CELLS, COSTS};
use crate::model::format::{ENTRY, START};

/// Whether item `i` is chosen when `n` of `of` items are chosen, evenly spread.
pub(crate) const fn is_one_of(n: usize, of: usize, i: usize) -> bool {
    of > 0 && (i as u64 + 1) * n as u64 / of as u64 != i as u64 * n as u64 / of as u64
}

/// Number of keygraphs of each cost in each subset, and the places of the kept ones.
#[derive(Debug)]
pub(crate) struct Table {
    counts: [[u16; COSTS]; CELLS],
    /// Start of each subset in the model: the subsets of the first tier, then those of the second.
    starts: [u32; 2 * CELLS + 1],
    /// Number of keygraphs placed so far in each subset of each tier.
    placed: [u32; 2 * CELLS],
    /// Two counters for each subset. The first counts the keygraphs seen so far of the cost that is
    /// kept in part. The second counts the kept keygraphs so far of the cost that the first tier
    /// takes in part.
    partial: [[u16; 2]; CELLS],
}

/// The costs that fill a number of places: all costs less than `below`, and part of the cost
/// `below`.
#[derive(Debug)]
struct Cut {
    below: usize,
    /// Number of places left for the cost `below`.
    left: usize,
    /// Number of keygraphs with the cost `below` that the maximum for each subset admits.
    next: usize,
}

/// Whether the next item is chosen when `n` of `of` items are chosen, evenly spread. `seen` counts
/// the items, but only when some and not all are chosen.
fn is_next_of(n: usize, of: usize, seen: &mut u16) -> bool {
    if n == 0 || n == of {
        return n > 0;
    }
    let t = usize::from(*seen);
    *seen = seen.saturating_add(1);
    is_one_of(n, of, t)
}

impl Table {
    pub(crate) const fn new() -> Self {
        Self {
            counts: [[0; COSTS]; CELLS],
            starts: [0; 2 * CELLS + 1],
            placed: [0; 2 * CELLS],
            partial: [[0; 2]; CELLS],
        }
    }

    pub(crate) fn clear(&mut self) {
        self.counts.as_flattened_mut().fill(0);
        self.placed.fill(0);
        self.partial.as_flattened_mut().fill(0);
    }

    pub(crate) fn count(&mut self, cell: usize, cost: u32) {
        let c = &mut self.counts[cell][cost as usize];
        *c = c.saturating_add(1);
    }

    pub(crate) fn total(&self) -> u32 {
        self.counts.iter().flatten().map(|&n| u32::from(n)).sum()
    }

    /// Number of keygraphs in `cell` that cost less than `below`, at most `cap`.
    fn cheaper(&self, cell: usize, below: usize, cap: usize) -> usize {
        self.counts[cell][..below].iter().map(|&n| usize::from(n)).sum::<usize>().min(cap)
    }

    /// Finds the costs that fill `total` places with at most `cap` keygraphs in a subset.
    fn cut(&self, total: usize, cap: usize) -> Cut {
        let all = |below| (0..CELLS).map(|c| self.cheaper(c, below, cap)).sum::<usize>();
        let mut below = 0;
        while below < COSTS && all(below + 1) <= total {
            below += 1;
        }
        let taken = all(below);
        let next = if below < COSTS { all(below + 1) - taken } else { 0 };
        Cut { below, left: total - taken, next }
    }

    /// Number of keygraphs in a subset that a cut keeps. Of the cost that the cut keeps in part,
    /// every subset keeps the same fraction.
    fn kept(&self, cell: usize, cut: &Cut, cap: usize) -> usize {
        let sure = self.cheaper(cell, cut.below, cap);
        let more = if cut.below < COSTS { self.cheaper(cell, cut.below + 1, cap) - sure } else { 0 };
        sure + (more * cut.left).checked_div(cut.next).unwrap_or(0)
    }

    /// Distributes `total` places among the subsets, cheap keygraphs first, at most `cap` in a
    /// subset. Returns the number of places taken. The cheapest keygraphs, about `first` of them,
    /// form the first tier.
    pub(crate) fn allot(&mut self, total: usize, cap: usize, first: usize) -> usize {
        let cut = self.cut(total, cap);
        let kept = (0..CELLS).map(|c| self.kept(c, &cut, cap)).sum::<usize>();
        let first_cut = self.cut(first.min(total), cap);
        let mut start = 0;
        for slot in 0..2 * CELLS {
            let (tier, cell) = (slot / CELLS, slot % CELLS);
            let first = self.kept(cell, &first_cut, cap);
            let n = if tier == 0 { first } else { self.kept(cell, &cut, cap) - first };
            self.starts[slot] = start;
            start += count(n);
        }
        self.starts[2 * CELLS] = start;
        kept
    }

    /// Range of a subset in the model. `slot` is the subset in the first tier, or [`CELLS`] plus
    /// the subset in the second tier.
    pub(crate) fn range(&self, slot: usize) -> core::ops::Range<usize> {
        self.starts[slot] as usize..self.starts[slot + 1] as usize
    }

    /// Returns the place of the next keygraph of this subset and cost, if it is kept. Of the cost
    /// that is kept in part, evenly spread keygraphs are kept. Of the cost that the first tier
    /// takes in part, evenly spread keygraphs go to the first tier.
    pub(crate) fn place(&mut self, cell: usize, cost: u32) -> Option<usize> {
        let [first, second] = [self.range(cell).len(), self.range(CELLS + cell).len()];
        let counts = self.counts[cell];
        let sure = counts[..cost as usize].iter().map(|&n| usize::from(n)).sum();
        let kept = (first + second).saturating_sub(sure).min(counts[cost as usize].into());
        let [seen, seen_kept] = &mut self.partial[cell];
        if !is_next_of(kept, counts[cost as usize].into(), seen) {
            return None;
        }
        let in_first = is_next_of(first.saturating_sub(sure).min(kept), kept, seen_kept);
        let slot = if in_first { cell } else { CELLS + cell };
        let range = self.range(slot);
        let at = range.start + self.placed[slot] as usize;
        (at < range.end).then(|| {
            self.placed[slot] += 1;
            at
        })
    }

    pub(crate) fn write(&self, out: &mut [u8]) {
        for (entry, &start) in out.chunks_exact_mut(ENTRY).zip(&self.starts) {
            START.put(entry, start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_go_to_the_cheap_and_every_place_is_filled() {
        let mut t = std::boxed::Box::new(Table::new());
        let fed: std::vec::Vec<(usize, u32)> = [(0, 0, 10), (0, 1, 10), (1, 0, 4), (1, 1, 20)]
            .iter()
            .flat_map(|&(c, k, n)| std::vec![(c, k); n])
            .collect();
        fed.iter().for_each(|&(c, k)| t.count(c, k));
        assert_eq!((t.total(), t.allot(20, 12, 20)), (44, 19));
        assert_eq!((t.range(0), t.range(1), t.range(2)), (0..11, 11..19, 19..19));
        let mut taken = std::vec![0; 19];
        let mut kept = [[0; 2]; 2];
        for &(c, k) in &fed {
            if let Some(at) = t.place(c, k) {
                taken[at] += 1;
                kept[c][k as usize] += 1;
            }
        }
        assert!(taken.iter().all(|&n| n == 1), "{taken:?}");
        assert_eq!(kept, [[10, 1], [4, 4]], "all cheap ones, some of the next");
    }

    #[test]
    fn keygraphs_too_dear_to_keep_take_no_places() {
        let mut t = std::boxed::Box::new(Table::new());
        // The order is that of training: expensive keygraphs come between those kept in part.
        let fed: std::vec::Vec<u32> = [0, 2, 2, 1, 2, 1, 0, 2, 1, 1, 2, 2].into();
        fed.iter().for_each(|&cost| t.count(0, cost));
        assert_eq!(t.allot(4, 12, 4), 4);
        let kept: std::vec::Vec<u32> = fed.into_iter().filter(|&cost| t.place(0, cost).is_some()).collect();
        assert_eq!(kept, [0, 1, 0, 1], "both of cost 0, every other of cost 1, none of cost 2");
    }
}
