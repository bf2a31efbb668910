//! What is in the memory of a detector, and who may use it when.
//!
//! In: memory that `kg_detector_init` has made a detector of. Out: the detector, for reading or for
//! work. Memory: none of its own. Cost: some comparisons.
//!
//! A search in pieces keeps a reference to the detector in the slot, for as long as it goes on. Until
//! it ends or is dropped, no other reference to the detector is made.

use keygraph_core::{Detector, Model, Ongoing, Profile, Window};

use crate::boundary::Outcome;
use crate::detector::kg_options;
use crate::place::Head;
use crate::status::kg_status;

/// Says that memory holds a detector.
pub(crate) const TAG: u32 = 0x6b67_4445;

#[repr(C)]
pub(crate) struct Slot<P: Profile + 'static> {
    pub(crate) own: Own,
    /// Search in pieces that has begun and not ended.
    pub(crate) search: Option<Ongoing<'static, P>>,
    pub(crate) detector: Detector<P>,
}

/// What this interface keeps of a detector of any profile.
#[repr(C)]
pub(crate) struct Own {
    head: Head,
    /// Part of the frame that the last search looked at.
    pub(crate) window: Option<Window>,
    /// Model of the search in pieces.
    pub(crate) model: Option<Model<'static>>,
    /// When that search began.
    pub(crate) start: u64,
}

/// Does something with the slot of a detector, whose profile is known at run time alone. A detector
/// behind `dyn Profile` would link everything that prints one.
macro_rules! with_slot {
    ($detector:expr, $slot:ident => $body:expr) => {{
        // SAFETY: the caller vouches for the pointer.
        let head = unsafe { crate::place::Head::of($detector.cast(), crate::slot::TAG) }?;
        // SAFETY: the head is valid.
        match unsafe { (*head).profile } {
            crate::detector::KG_PROFILE_QQVGA => {
                let $slot = head.cast::<crate::slot::Slot<keygraph_core::Qqvga>>();
                $body
            }
            crate::detector::KG_PROFILE_QVGA => {
                let $slot = head.cast::<crate::slot::Slot<keygraph_core::Qvga>>();
                $body
            }
            crate::detector::KG_PROFILE_VGA => {
                let $slot = head.cast::<crate::slot::Slot<keygraph_core::Vga>>();
                $body
            }
            _ => {
                let $slot = head.cast::<crate::slot::Slot<keygraph_core::Hd>>();
                $body
            }
        }
    }};
}
pub(crate) use with_slot;

/// Returns the detector for reading, unless a search in pieces has it, and the part of the frame that it
/// looked at.
///
/// # Safety
/// The slot comes from `with_slot`; it stays as it is while the detector is borrowed.
pub(crate) unsafe fn idle<'a, P: Profile>(slot: *mut Slot<P>) -> Outcome<(&'a Detector<P>, Option<Window>)> {
    // SAFETY: the slot is valid, and nobody works on it.
    let searching = unsafe { (*slot).search.is_some() };
    if searching {
        return Err(kg_status::KG_ERROR_BUSY);
    }
    // SAFETY: no search in pieces has the detector, and nobody works on it.
    Ok(unsafe { (&(*slot).detector, (*slot).own.window) })
}

/// A detector that is at work: until this is dropped, all calls that would use it are refused.
pub(crate) struct Work {
    head: *mut Head,
}

impl Work {
    /// Takes a detector, ends a search in pieces, and sets the options.
    ///
    /// # Safety
    /// The slot comes from `with_slot`; nobody else uses it until the work is dropped.
    pub(crate) unsafe fn begin<P: Profile>(
        slot: *mut Slot<P>,
        options: &kg_options,
        window: Option<Window>,
    ) -> Outcome<(Self, &'static mut Detector<P>)> {
        // SAFETY: the slot is valid, and nobody works on it.
        unsafe {
            (*slot).search = None;
            (*slot).own.window = window;
        }
        // SAFETY: the search in pieces that had a reference is gone.
        let d = unsafe { &mut (*slot).detector };
        d.set_depth(options.depth()?);
        d.set_min_visible(options.min_visible);
        // SAFETY: the slot is valid, and begins with a head.
        Ok((unsafe { Self::on(slot.cast()) }, d))
    }

    /// Marks an object as at work.
    ///
    /// # Safety
    /// The head is valid, and stays so until the work is dropped.
    pub(crate) unsafe fn on(head: *mut Head) -> Self {
        // SAFETY: the contract is the same.
        unsafe { Head::set_working(head, true) };
        Self { head }
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        // SAFETY: it was valid when the work began, and nobody else could use it since.
        unsafe { Head::set_working(self.head, false) };
    }
}
