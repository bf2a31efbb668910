//! Makes objects in memory that the caller gives, without a copy on the stack.
//!
//! In: memory, its length, and the bytes that the header demands. Out: the memory, all zero. Memory:
//! the caller's. Cost: a `memset`.
//!
//! Each object begins with a tag that says what it is, and a flag that says that it is at work.

use core::ffi::c_void;

use keygraph_core::{Detector, Profile, Tracker, Trainer};

use crate::boundary::{Outcome, check};
use crate::status::kg_status;

/// Alignment of the memory that is given for an object, bytes.
pub const KG_ALIGNMENT: usize = 8;

/// A type for which bytes that are all zero are a new value.
///
/// # Safety
/// All bytes zero must be a valid value.
pub(crate) unsafe trait Zeroed {}

// SAFETY: a detector is numbers, arrays of numbers, vectors of plain data with a length, and enums
// whose first variant is zero; it holds no reference that could be null. `Detector::new` documents
// that its bytes are zero. A test compares every field of both; the
// searches that miri watches begin with such zeros.
unsafe impl<P: Profile> Zeroed for Detector<P> {}
// SAFETY: as for a detector. A tracker is a vector with a length, numbers, and the place of a search, an enum
// whose first variant is zero.
unsafe impl Zeroed for Tracker {}
// SAFETY: as for a detector. `Trainer::new` documents that its bytes are zero.
unsafe impl<const L: usize, const C: usize, const S: usize, const K: usize> Zeroed for Trainer<L, C, S, K> {}

/// The beginning of every object in the caller's memory.
#[repr(C)]
pub(crate) struct Head {
    /// Says what the object is.
    tag: u32,
    /// Number of the profile, for objects that have one.
    pub(crate) profile: u32,
    /// Not zero while a function works on the object.
    working: u32,
}

/// Checks memory for an object of `needed` bytes, and makes it zero.
///
/// # Safety
/// `bytes` bytes at `memory` are the caller's to give.
pub(crate) unsafe fn zeroed(memory: *mut c_void, bytes: usize, needed: usize) -> Outcome<*mut Head> {
    let memory = memory.cast::<u8>();
    check(memory, bytes)?;
    if !memory.addr().is_multiple_of(KG_ALIGNMENT) {
        return Err(kg_status::KG_ERROR_ALIGNMENT);
    }
    if bytes < needed {
        return Err(kg_status::KG_ERROR_MEMORY);
    }
    // SAFETY: the memory is the caller's to give, and has at least that many bytes.
    unsafe { memory.write_bytes(0, needed) };
    Ok(memory.cast())
}

impl Head {
    /// Marks zeroed memory as an object.
    ///
    /// # Safety
    /// `head` leads to memory from [`zeroed`].
    pub(crate) unsafe fn mark(head: *mut Self, tag: u32, profile: u32) {
        // SAFETY: the memory has room for a head, and is aligned.
        unsafe { head.write(Self { tag, profile, working: 0 }) };
    }

    /// Checks that there is an object of this kind that is not at work. Makes no reference: a callback
    /// may come here while the object is borrowed.
    ///
    /// # Safety
    /// If `object` passes the checks, it leads to memory with at least a head.
    pub(crate) unsafe fn of(object: *mut Self, tag: u32) -> Outcome<*mut Self> {
        check(object, 1)?;
        if !object.addr().is_multiple_of(KG_ALIGNMENT) {
            return Err(kg_status::KG_ERROR_ALIGNMENT);
        }
        // SAFETY: the pointer is aligned, and the caller vouches for the memory.
        let found = unsafe { (*object).tag };
        if found != tag {
            return Err(kg_status::KG_ERROR_HANDLE);
        }
        // SAFETY: as above.
        let working = unsafe { (*object).working };
        if working == 0 { Ok(object) } else { Err(kg_status::KG_ERROR_BUSY) }
    }

    /// Says whether a function is at work on the object.
    ///
    /// # Safety
    /// `head` comes from [`Head::of`].
    pub(crate) unsafe fn set_working(head: *mut Self, working: bool) {
        // SAFETY: there is an object, and no reference to its head exists.
        unsafe { (*head).working = u32::from(working) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use keygraph_core::{Buffers, chroma_bytes, luma_bytes};
    use std::boxed::Box;
    use std::format;

    fn zero<T: Zeroed>() -> Box<T> {
        // SAFETY: that is what the trait says.
        unsafe { Box::<T>::new_zeroed().assume_init() }
    }

    /// Sizes do not matter for this, so they are small.
    type Small = Detector<Buffers<{ luma_bytes(1024) }, { chroma_bytes(1024) }, 32, 32, 32, 32, 32>>;
    type SmallTrainer = Trainer<{ luma_bytes(1024) }, { chroma_bytes(1024) }, 32, 32>;

    /// Prints every field.
    #[test]
    #[cfg_attr(miri, ignore = "prints tens of thousands of numbers: more than ten minutes")]
    fn zeros_are_new_objects() {
        assert_eq!(format!("{:?}", zero::<Small>()), format!("{:?}", Small::new()));
        assert_eq!(format!("{:?}", zero::<Tracker>()), format!("{:?}", Tracker::new()));
        assert_eq!(format!("{:?}", zero::<SmallTrainer>()), format!("{:?}", SmallTrainer::new()));
    }
}
