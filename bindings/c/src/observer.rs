//! What watches a search: a clock, a question whether it goes on, a budget, digests.
//!
//! In: a [`kg_observer`]. Out: an observer of the core. Memory: some 40 bytes of stack. Cost: calls
//! of the program's functions, the question every 200,000 instructions or more often.

use core::ffi::{c_char, c_void};

use keygraph_core::stages::digest::Digests;
use keygraph_core::{Buffer, Detector, Observer, Output, Profile, Stage, Stats};

use crate::boundary::{Outcome, check, optional, put, told};
use crate::status::kg_status;

/// Number of stages of a search.
pub const KG_STAGES: usize = 11;
const _: () = assert!(KG_STAGES == Stage::COUNT, "the core has another number of stages");

/// Number of buffers of a detector that grow with its profile.
pub const KG_BUFFERS: usize = 12;
const _: () = assert!(KG_BUFFERS == Buffer::COUNT, "the core has another number of buffers");

/// Returns the ticks of a clock that counts up. A clock of 32 bits may start again at 0.
pub type kg_clock = Option<unsafe extern "C" fn(context: *mut c_void) -> u64>;

/// Returns not 0 if the search goes on, 0 to stop it. It is asked every 200,000 instructions or more
/// often, so that others can be given their turn too. After it has returned 0 it is not asked again.
pub type kg_goes_on = Option<unsafe extern "C" fn(context: *mut c_void) -> i32>;

/// Watches a search. Every member may be 0. The functions must return: no longjmp, no C++ exception.
/// They must not use the detector or the tracker that is at work; such calls return KG_ERROR_BUSY.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kg_observer {
    /// Passed to the functions.
    pub context: *mut c_void,
    /// Clock; without it, ticks are 0.
    pub now: kg_clock,
    /// Question whether the search goes on.
    pub goes_on: kg_goes_on,
    /// Number of ticks after which the search is stopped, from the call that begins it on; 0: it has all
    /// the time. It needs a clock. Only the conversion of the frame is never cut short.
    pub budget: u64,
}

/// What one stage did in one frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct kg_stage {
    /// Ticks of the observer's clock.
    pub ticks: u64,
    /// Number of candidates that came in.
    pub seen: u32,
    /// Number of results that were passed on.
    pub kept: u32,
    /// Number of results that were lost to a full buffer. A full buffer is no error.
    pub dropped: u32,
    /// 0.
    pub reserved: u32,
}

/// What the stages did in one frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct kg_stats {
    /// The stages in their order; kg_stage_name() has their names.
    pub stages: [kg_stage; KG_STAGES],
    /// Number of times that a tile of the frame was searched.
    pub tiles: u32,
    /// 1 if the search was stopped before its end.
    pub stopped: u32,
    /// 1 if the frame was searched, 0 if a tracker only followed what it knew.
    pub searched: u32,
    /// 0.
    pub reserved: u32,
}

/// One buffer of a detector.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct kg_buffer {
    /// Size, bytes.
    pub bytes: usize,
    /// Maximum number of elements.
    pub capacity: usize,
    /// Most elements that it held in the last frame.
    pub most: usize,
}

/// Returns the name of a stage, `index` from 0 to KG_STAGES - 1, or NULL. It ends with a zero byte.
#[unsafe(no_mangle)]
pub extern "C" fn kg_stage_name(index: u32) -> *const c_char {
    const NAMES: [&core::ffi::CStr; KG_STAGES] = [
        c"convert",
        c"pyramid",
        c"corners",
        c"delaunay",
        c"keygraphs",
        c"features",
        c"classify",
        c"verify",
        c"vote",
        c"pose",
        c"accept",
    ];
    name(&NAMES, index)
}

/// Returns the name of a buffer, `index` from 0 to KG_BUFFERS - 1, or NULL. It ends with a zero byte.
#[unsafe(no_mangle)]
pub extern "C" fn kg_buffer_name(index: u32) -> *const c_char {
    const NAMES: [&core::ffi::CStr; KG_BUFFERS] = [
        c"luma",
        c"chroma",
        c"corner rows",
        c"corners",
        c"keypoints",
        c"triangulation",
        c"triples",
        c"keygraphs",
        c"features",
        c"votes",
        c"bins of votes",
        c"vertex pairs",
    ];
    name(&NAMES, index)
}

fn name(names: &[&core::ffi::CStr], index: u32) -> *const c_char {
    let named = usize::try_from(index).ok().and_then(|i| names.get(i));
    named.map_or(core::ptr::null(), |name| name.as_ptr())
}

/// Observer of a search that C watches.
pub(crate) struct Watch {
    observer: kg_observer,
    /// When the search began.
    start: u64,
}

impl Watch {
    /// Checks an observer from C; null stands for none. `start` is when the search began, or `None` if
    /// it begins now.
    ///
    /// # Safety
    /// If the pointer passes the checks, it leads to an observer whose functions may be called.
    pub(crate) unsafe fn new(observer: *const kg_observer, start: Option<u64>) -> Outcome<Self> {
        let none = kg_observer { context: core::ptr::null_mut(), now: None, goes_on: None, budget: 0 };
        // SAFETY: the contract is the same.
        let observer = unsafe { optional(observer) }?.copied().unwrap_or(none);
        if observer.budget > 0 && observer.now.is_none() {
            return Err(kg_status::KG_ERROR_OPTION);
        }
        let mut watch = Self { observer, start: 0 };
        watch.start = start.unwrap_or_else(|| watch.now());
        Ok(watch)
    }

    pub(crate) const fn start(&self) -> u64 {
        self.start
    }
}

impl Observer for Watch {
    fn now(&mut self) -> u64 {
        match self.observer.now {
            // SAFETY: whoever made the watch vouches for its functions.
            Some(now) => unsafe { now(self.observer.context) },
            None => 0,
        }
    }

    fn goes_on(&mut self) -> bool {
        if self.observer.budget > 0 {
            let (start, now) = (self.start, self.now());
            let ticks = now.wrapping_sub(start);
            // A clock of 32 bits has started again.
            let passed = if now < start { ticks & 0xffff_ffff } else { ticks };
            if passed >= self.observer.budget {
                return false;
            }
        }
        match self.observer.goes_on {
            // SAFETY: whoever made the watch vouches for its functions.
            Some(goes_on) => unsafe { goes_on(self.observer.context) != 0 },
            None => true,
        }
    }
}

/// A watch that also makes digests. It is a type of its own so that their code is linked only into
/// programs that ask for them.
pub(crate) struct Digesting {
    pub(crate) watch: Watch,
    pub(crate) digests: Digests,
}

impl Observer for Digesting {
    fn now(&mut self) -> u64 {
        self.watch.now()
    }

    fn goes_on(&mut self) -> bool {
        self.watch.goes_on()
    }

    fn saw(&mut self, output: Output<'_>) {
        self.digests.add(output);
    }
}

impl Digesting {
    /// Writes the digests, one for each stage.
    ///
    /// # Safety
    /// If the pointer passes the checks, it leads to room for them.
    pub(crate) unsafe fn put(&self, out: *mut u32) -> Outcome<()> {
        check(out, KG_STAGES)?;
        let values = Stage::ALL.map(|stage| self.digests.of(stage));
        // SAFETY: there is room for all of them.
        unsafe { put(out.cast(), values) }
    }
}

/// Writes the statistics of a frame.
///
/// # Safety
/// If the pointer passes the checks, it leads to room for them.
pub(crate) unsafe fn put_stats(stats: &Stats, searched: bool, out: *mut kg_stats) -> kg_status {
    let mut told_stats = kg_stats {
        tiles: u32::from(stats.tiles),
        stopped: u32::from(stats.stopped),
        searched: u32::from(searched),
        ..kg_stats::default()
    };
    for (i, stage) in told_stats.stages.iter_mut().enumerate() {
        let s = stats.stages[i];
        *stage = kg_stage { ticks: stats.ticks[i], seen: s.seen, kept: s.kept, dropped: s.dropped, reserved: 0 };
    }
    // SAFETY: the contract is the same.
    told(unsafe { put(out, told_stats) }.map(|()| kg_status::KG_OK))
}

/// Returns a buffer of a detector.
pub(crate) fn buffer_of<P: Profile>(detector: &Detector<P>, index: u32) -> Outcome<kg_buffer> {
    let index = usize::try_from(index).ok().filter(|&i| i < KG_BUFFERS).ok_or(kg_status::KG_ERROR_INDEX)?;
    let (room, most) = (detector.rooms()[index], detector.high_water()[index]);
    Ok(kg_buffer { bytes: room.bytes, capacity: room.capacity, most: usize::try_from(most).unwrap_or(usize::MAX) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::ffi::CStr;

    #[test]
    fn names_are_those_of_the_core() {
        for (i, stage) in (0..).zip(Stage::ALL) {
            // SAFETY: the names end with a zero byte.
            assert_eq!(unsafe { CStr::from_ptr(kg_stage_name(i)) }.to_str(), Ok(stage.name()));
        }
        for (i, buffer) in (0..).zip(Buffer::ALL) {
            // SAFETY: the names end with a zero byte.
            assert_eq!(unsafe { CStr::from_ptr(kg_buffer_name(i)) }.to_str(), Ok(buffer.name()));
        }
        assert!(kg_stage_name(11).is_null() && kg_buffer_name(u32::MAX).is_null());
    }
}
