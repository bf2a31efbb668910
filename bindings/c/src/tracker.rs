//! The tracker, in memory that the caller gives.
//!
//! In: the frames of one camera in order, a detector, a model. Out: tracks. Memory:
//! KG_TRACKER_BYTES, beside the detector, whose buffers it uses. Cost: that of the core's tracker.

use core::ffi::c_void;
use core::ptr::addr_of_mut;

use keygraph_core::{Frame, Model, Profile, State, TRACKS, Track, Tracker, Window};

use crate::boundary::{Outcome, list, put, told};
use crate::detection::kg_detection;
use crate::detector::{kg_detector, kg_options, suits};
use crate::frame::{frame_of, kg_frame};
use crate::model::{kg_model, model_of};
use crate::observer::{Watch, kg_observer, kg_stats, put_stats};
use crate::place::{Head, Zeroed, zeroed};
use crate::slot::{self, Work, with_slot};
use crate::status::kg_status;

/// Bytes of a tracker.
pub const KG_TRACKER_BYTES: usize = 15_296;
const _: () = assert!(suits::<Slot>(KG_TRACKER_BYTES), "KG_TRACKER_BYTES");

/// Most tracks. An array of that many holds every result.
pub const KG_TRACKS: usize = 64;
const _: () = assert!(KG_TRACKS == TRACKS, "the core follows another number of instances");

/// State of a track: one of KG_TRACK_...
pub type kg_track_state = u32;

/// A search found the instance; it was not seen in the frame before.
pub const KG_TRACK_FOUND: kg_track_state = 0;
/// The instance was seen in the frame before, and in this one.
pub const KG_TRACK_TRACKED: kg_track_state = 1;
/// The instance is not seen. Its detection is the last one that it had.
pub const KG_TRACK_LOST: kg_track_state = 2;

/// An instance that is followed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct kg_track {
    /// Id of the instance. No other one of the tracker gets it, unless 2^32 have been given.
    pub id: u32,
    /// KG_TRACK_FOUND, KG_TRACK_TRACKED or KG_TRACK_LOST.
    pub state: kg_track_state,
    /// Number of frames since the instance was seen; 0 when it is seen in this one.
    pub unseen: u32,
    /// Detection in this frame, or the last one.
    pub detection: kg_detection,
}

/// A tracker, in the memory that was given to kg_tracker_init(). It needs no end, and must not be moved.
#[derive(Debug)]
pub struct kg_tracker {
    _opaque: (),
}

const TAG: u32 = 0x6b67_5452;

#[repr(C)]
struct Slot {
    head: Head,
    /// Part of the frame that the last call looked at.
    window: Option<Window>,
    /// Whether the last frame was searched.
    searched: bool,
    tracker: Tracker,
}

/// Checks a tracker from C.
///
/// # Safety
/// If the pointer passes the checks, it leads to memory that was given to `kg_tracker_init`.
unsafe fn slot_of(tracker: *mut kg_tracker) -> Outcome<*mut Slot> {
    // SAFETY: the contract is the same.
    Ok(unsafe { Head::of(tracker.cast(), TAG) }?.cast())
}

/// Makes a tracker without tracks in memory of at least KG_TRACKER_BYTES bytes, at a multiple of
/// KG_ALIGNMENT. The memory need not be cleared. `tracker` receives the tracker.
///
/// Errors: KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_init(
    memory: *mut c_void,
    bytes: usize,
    tracker: *mut *mut kg_tracker,
) -> kg_status {
    const fn zeroes<T: Zeroed>(needed: usize) -> usize {
        needed
    }
    let init = || {
        crate::boundary::check(tracker, 1)?;
        // SAFETY: the memory is the caller's to give.
        let head = unsafe { zeroed(memory, bytes, zeroes::<Tracker>(KG_TRACKER_BYTES)) }?;
        let slot = head.cast::<Slot>();
        // SAFETY: the memory has room for a slot and is aligned, and its tracker is zero, which is a
        // new one.
        unsafe {
            Head::mark(head, TAG, 0);
            addr_of_mut!((*slot).window).write(None);
            addr_of_mut!((*slot).searched).write(false);
        }
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(tracker, head.cast()) }?;
        Ok(kg_status::KG_OK)
    };
    told(init())
}

/// Follows the objects of a model in the next frame.
///
/// # Safety
/// Both slots are valid, and nobody works on the tracker's.
unsafe fn follow<P: Profile>(
    slot: *mut Slot,
    detector: *mut slot::Slot<P>,
    (frame, window): (&Frame<'_>, Option<Window>),
    model: &Model<'_>,
    options: &kg_options,
    watch: &mut Watch,
) -> Outcome {
    // SAFETY: the contract is the same.
    let (_detector, d) = unsafe { Work::begin(detector, options, window) }?;
    // SAFETY: the slot is valid, and nobody works on it. The head, which a callback may read, is not
    // borrowed.
    let (tracker, last, searched) = unsafe { (&mut (*slot).tracker, &mut (*slot).window, &mut (*slot).searched) };
    if *last != window {
        tracker.reset();
        *last = window;
    }
    // SAFETY: the slot is valid.
    let _tracker = unsafe { Work::on(slot.cast()) };
    tracker.track(d, frame, model, options.threshold, watch)?;
    *searched = tracker.searched();
    Ok(if tracker.stats().stopped { kg_status::KG_STOPPED } else { kg_status::KG_OK })
}

/// Follows the objects of a model in the next frame, and searches the frame where needed: when nothing
/// is in sight, when something is in doubt or lost, and every tenth frame. A frame that shows what the
/// last searched frame showed is not searched again, except one in thirty. kg_tracker_tracks() then
/// gives the results. The tracker works in the buffers of `detector`, whose results are lost.
///
/// The frames must have one size and one window. With another window all tracks are forgotten.
/// `options` and `observer` may be NULL. When the observer stops a search, the piece that has begun comes to
/// its end; the search goes on in the next frame, unless `detector` was used for something else. What is
/// known is followed all the same.
///
/// Returns KG_OK, KG_STOPPED, or the errors of kg_detector_detect().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_track(
    tracker: *mut kg_tracker,
    detector: *mut kg_detector,
    model: *const kg_model,
    frame: *const kg_frame,
    options: *const kg_options,
    observer: *const kg_observer,
) -> kg_status {
    let track = || {
        // SAFETY: the pointers are the caller's to give.
        let slot = unsafe { slot_of(tracker) }?;
        // SAFETY: the pointers are the caller's to give.
        let model = unsafe { model_of(model) }?;
        // SAFETY: the pointers are the caller's to give.
        let (frame, window) = unsafe { frame_of(frame) }?;
        // SAFETY: the pointers are the caller's to give.
        let options = unsafe { kg_options::of(options) }?;
        // SAFETY: the pointers are the caller's to give.
        let mut watch = unsafe { Watch::new(observer, None) }?;
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, at => unsafe { follow(slot, at, (&frame, window), &model, &options, &mut watch) })
    };
    told(track())
}

fn state_of(state: State) -> kg_track_state {
    match state {
        State::Found => KG_TRACK_FOUND,
        State::Tracked => KG_TRACK_TRACKED,
        State::Lost => KG_TRACK_LOST,
    }
}

/// Writes the tracks into `out`, an array of `room` elements, and how many there are into `count`, which
/// may be more: first those that are seen, best score first, then those that are lost. What is not seen
/// for 30 frames is forgotten. KG_TRACKS elements are always enough.
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_tracks(
    tracker: *mut kg_tracker,
    out: *mut kg_track,
    room: usize,
    count: *mut usize,
) -> kg_status {
    let write = || {
        // SAFETY: the pointer is the caller's to give.
        let slot = unsafe { slot_of(tracker) }?;
        // SAFETY: the slot is valid, and nobody works on it.
        let slot = unsafe { &*slot };
        let all = slot.tracker.tracks().iter().map(|t: &Track| kg_track {
            id: t.id,
            state: state_of(t.state),
            unseen: t.unseen,
            detection: kg_detection::new(&t.detection, slot.window, 0),
        });
        // SAFETY: the pointers are the caller's to give.
        unsafe { list(all, out, room, count) }?;
        Ok(kg_status::KG_OK)
    };
    told(write())
}

/// Calls a function with a tracker from C.
///
/// # Safety
/// As for [`slot_of`]; nobody else uses the tracker.
unsafe fn with(tracker: *mut kg_tracker, f: impl FnOnce(&mut Tracker)) -> kg_status {
    // SAFETY: the contract is the same.
    let slot = unsafe { slot_of(tracker) };
    told(slot.map(|slot| {
        // SAFETY: the slot is valid, and nobody works on it.
        f(unsafe { &mut (*slot).tracker });
        kg_status::KG_OK
    }))
}

/// Makes the tracker search the next frame, even if everything is in sight.
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_search_next(tracker: *mut kg_tracker) -> kg_status {
    // SAFETY: the pointer is the caller's to give.
    unsafe { with(tracker, |t| t.search_next()) }
}

/// Forgets all tracks. Their ids are not used again.
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_reset(tracker: *mut kg_tracker) -> kg_status {
    // SAFETY: the pointer is the caller's to give.
    unsafe { with(tracker, Tracker::reset) }
}

/// Tells what the stages did with the last frame. Following counts as the stage "accept".
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_tracker_stats(tracker: *mut kg_tracker, stats: *mut kg_stats) -> kg_status {
    // SAFETY: the pointer is the caller's to give.
    let slot = unsafe { slot_of(tracker) };
    told(slot.map(|slot| {
        // SAFETY: the slot is valid, and nobody works on it.
        let (stats_of, searched) = unsafe { ((*slot).tracker.stats(), (*slot).searched) };
        // SAFETY: the pointer is the caller's to give.
        unsafe { put_stats(stats_of, searched, stats) }
    }))
}
