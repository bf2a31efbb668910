//! Leaves out of a packed model what a search for all its objects at once does not read.
//!
//! In: a model with lists. Out: the bytes of a model with the same objects and lists in the caller's buffer. The tiers
//! of its objects are empty. It finds what the whole model finds, but that a pose in doubt has only the votes of the
//! lists. It cannot be packed again, since lists are made of the tiers.
//!
//! Memory: none of its own. Cost: one copy of the bytes that are left, and their checksum.

use crate::extract::keygraph::CELLS;
use crate::model::format::{Counts, ENTRY, Layout, START, Tiers, write_header};
use crate::model::pack::PackError;
use crate::model::parse::Model;

/// The tiers, the counts and the layout of the slim form of a model.
fn plan(model: &Model<'_>) -> Result<(Tiers, Counts, Layout), PackError> {
    if !model.has_lists() {
        return Err(PackError::NoLists);
    }
    let (all, tiers) = (model.counts(), Tiers { lists: true, second: false });
    let counts = Counts { keygraphs: all.listed, ..*all };
    let layout = Layout::new(&counts, tiers, model.feature_bytes()).ok_or(PackError::TooMany)?;
    Ok((tiers, counts, layout))
}

/// Length of the model that [`slim`] makes, bytes.
///
/// # Errors
/// [`PackError::NoLists`] when the model has no lists.
pub fn slim_len(model: &Model<'_>) -> Result<usize, PackError> {
    plan(model).map(|(.., layout)| layout.end)
}

/// Writes a model without the tiers of its objects at the start of `out`. Returns its length, bytes.
///
/// # Errors
/// [`PackError::NoLists`] when the model has no lists, [`PackError::NoRoom`] when `out` is too short.
pub fn slim(model: &Model<'_>, out: &mut [u8]) -> Result<usize, PackError> {
    let (tiers, counts, to) = plan(model)?;
    let listed = counts.listed;
    let given = out.len();
    let out = out.get_mut(..to.end).ok_or(PackError::NoRoom { needed: to.end, given })?;
    let (from, bytes) = (model.layout(), model.bytes());
    let mut copy = |to: usize, from: usize, n: usize| out[to..to + n].copy_from_slice(&bytes[from..from + n]);
    // Up to the index nothing moves, and the index begins with the lists.
    copy(0, 0, from.index + ENTRY * 2 * CELLS);
    let n = model.feature_bytes();
    for ((to, each), (from, _)) in to.parts(n).into_iter().zip(from.parts(n)) {
        copy(to, from, each * listed);
    }
    copy(to.sketches, from.sketches, from.end - from.sketches);
    for entry in out[to.index + ENTRY * 2 * CELLS..to.keys].chunks_exact_mut(ENTRY) {
        START.put_size(entry, listed);
    }
    write_header(out, model.method(), model.feature(), tiers, &counts);
    Ok(out.len())
}
