//! The detector, in memory that the caller gives.
//!
//! In: memory, models, frames. Out: a searched frame, see `results`. Memory: KG_..._DETECTOR_BYTES by profile,
//! and the stack that the README states. Cost: that of the core's detector.
//!
//! What is in the caller's memory, and who may use it when, is said in `slot`.

use core::ffi::c_void;
use core::ptr::addr_of_mut;

use keygraph_core::stages::digest::Digests;
use keygraph_core::{
    DEFAULT_THRESHOLD, DETECTIONS, Depth, Detector, Frame, Hd, Model, Observer, Profile, Qqvga, Qvga, Vga, Window,
};

use crate::boundary::{Outcome, optional, put, told};
use crate::frame::{frame_of, kg_frame};
use crate::model::{kg_model, model_of};
use crate::observer::{Digesting, Watch, kg_observer};
use crate::place::{Head, KG_ALIGNMENT, Zeroed, zeroed};
use crate::slot::{Own, Slot, TAG, Work, idle, with_slot};
use crate::status::kg_status;

/// Size of the frames that a detector takes: one of KG_PROFILE_...
pub type kg_profile = u32;

/// Frames of up to 160 x 120 px.
pub const KG_PROFILE_QQVGA: kg_profile = 0;
/// Frames of up to 320 x 240 px.
pub const KG_PROFILE_QVGA: kg_profile = 1;
/// Frames of up to 640 x 480 px.
pub const KG_PROFILE_VGA: kg_profile = 2;
/// Frames of up to 1280 x 720 px.
pub const KG_PROFILE_HD: kg_profile = 3;

/// Bytes of a detector of the profile qqvga.
pub const KG_QQVGA_DETECTOR_BYTES: usize = 123_328;
/// Bytes of a detector of the profile qvga.
pub const KG_QVGA_DETECTOR_BYTES: usize = 329_984;
/// Bytes of a detector of the profile vga.
pub const KG_VGA_DETECTOR_BYTES: usize = 1_189_376;
/// Bytes of a detector of the profile hd.
pub const KG_HD_DETECTOR_BYTES: usize = 2_982_464;

/// Most bytes by which a constant may exceed what an object takes: pointers differ between targets.
const SLACK: usize = 1024;

/// Whether a constant of the header suits a type.
pub(crate) const fn suits<T>(bytes: usize) -> bool {
    size_of::<T>() <= bytes && bytes - size_of::<T>() <= SLACK && align_of::<T>() <= KG_ALIGNMENT
}
const _: () = assert!(suits::<Slot<Qqvga>>(KG_QQVGA_DETECTOR_BYTES), "KG_QQVGA_DETECTOR_BYTES");
const _: () = assert!(suits::<Slot<Qvga>>(KG_QVGA_DETECTOR_BYTES), "KG_QVGA_DETECTOR_BYTES");
const _: () = assert!(suits::<Slot<Vga>>(KG_VGA_DETECTOR_BYTES), "KG_VGA_DETECTOR_BYTES");
const _: () = assert!(suits::<Slot<Hd>>(KG_HD_DETECTOR_BYTES), "KG_HD_DETECTOR_BYTES");

/// Most detections in a frame. An array of that many holds every result.
pub const KG_DETECTIONS: usize = 64;
const _: () = assert!(KG_DETECTIONS == DETECTIONS, "the core reports another number of detections");

/// How much of a frame is searched: one of KG_DEPTH_...
pub type kg_depth = u32;

/// The search stops when nothing is in doubt. Where two objects are found, small ones are searched for
/// in nine parts of the frame too.
pub const KG_DEPTH_USUAL: kg_depth = 0;
/// As usual, but never in parts: the hardest frame takes about twice as long as an ordinary one.
pub const KG_DEPTH_ONCE: kg_depth = 1;
/// All of the frame is searched for all of the model, in every case.
pub const KG_DEPTH_THOROUGH: kg_depth = 2;

/// Threshold that is used where no options are given.
pub const KG_DEFAULT_THRESHOLD: f32 = 0.8;
const _: () = assert!(KG_DEFAULT_THRESHOLD == DEFAULT_THRESHOLD, "the core has another threshold");

/// What a search looks for. NULL in place of it stands for KG_DEFAULT_THRESHOLD, 0, KG_DEPTH_USUAL.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct kg_options {
    /// Minimum score of a detection, 0 to 1. A tracker needs it for what appears.
    pub threshold: f32,
    /// Minimum share of an object that must be seen, 0 to 1; 0 leaves that to the score.
    pub min_visible: f32,
    /// KG_DEPTH_...
    pub depth: kg_depth,
}

/// A detector, in the memory that was given to kg_detector_init(). It needs no end: the memory may be
/// used for anything else when it is not needed any more. It must not be moved.
#[derive(Debug)]
pub struct kg_detector {
    _opaque: (),
}

impl kg_options {
    const DEFAULT: Self = Self { threshold: KG_DEFAULT_THRESHOLD, min_visible: 0.0, depth: KG_DEPTH_USUAL };

    /// Checks options from C; null stands for the usual ones.
    ///
    /// # Safety
    /// If the pointer passes the checks, it leads to options.
    pub(crate) unsafe fn of(options: *const Self) -> Outcome<Self> {
        // SAFETY: the contract is the same.
        let options = unsafe { optional(options) }?.copied().unwrap_or(Self::DEFAULT);
        let valid = |v: f32| (0.0..=1.0).contains(&v);
        options.depth()?;
        if valid(options.threshold) && valid(options.min_visible) {
            Ok(options)
        } else {
            Err(kg_status::KG_ERROR_OPTION)
        }
    }

    pub(crate) const fn depth(&self) -> Outcome<Depth> {
        Ok(match self.depth {
            KG_DEPTH_USUAL => Depth::Usual,
            KG_DEPTH_ONCE => Depth::Once,
            KG_DEPTH_THOROUGH => Depth::Thorough,
            _ => return Err(kg_status::KG_ERROR_OPTION),
        })
    }
}

/// Makes a detector in memory of at least KG_..._DETECTOR_BYTES bytes of its profile, at a multiple of
/// KG_ALIGNMENT. The memory need not be cleared. `detector` receives the detector, which is at the
/// start of the memory. It takes a memset, and next to no stack.
///
/// Errors: KG_ERROR_PROFILE, KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_init(
    memory: *mut c_void,
    bytes: usize,
    profile: kg_profile,
    detector: *mut *mut kg_detector,
) -> kg_status {
    const fn zeroes<P: Profile>(needed: usize) -> usize
    where
        Detector<P>: Zeroed,
    {
        needed
    }
    fn idle_at<P: Profile + 'static>(head: *mut Head) {
        // SAFETY: the memory has room for a slot of the profile, and is aligned.
        unsafe { addr_of_mut!((*head.cast::<Slot<P>>()).search).write(None) };
    }
    let init = || {
        let needed = match profile {
            KG_PROFILE_QQVGA => zeroes::<Qqvga>(KG_QQVGA_DETECTOR_BYTES),
            KG_PROFILE_QVGA => zeroes::<Qvga>(KG_QVGA_DETECTOR_BYTES),
            KG_PROFILE_VGA => zeroes::<Vga>(KG_VGA_DETECTOR_BYTES),
            KG_PROFILE_HD => zeroes::<Hd>(KG_HD_DETECTOR_BYTES),
            _ => return Err(kg_status::KG_ERROR_PROFILE),
        };
        crate::boundary::check(detector, 1)?;
        // SAFETY: the memory is the caller's to give.
        let head = unsafe { zeroed(memory, bytes, needed) }?;
        let own = head.cast::<Own>();
        // SAFETY: the memory has room for a slot of the profile, is aligned, and its detector is zero,
        // which is a new one.
        unsafe {
            Head::mark(head, TAG, profile);
            addr_of_mut!((*own).window).write(None);
            addr_of_mut!((*own).model).write(None);
        }
        match profile {
            KG_PROFILE_QQVGA => idle_at::<Qqvga>(head),
            KG_PROFILE_QVGA => idle_at::<Qvga>(head),
            KG_PROFILE_VGA => idle_at::<Vga>(head),
            _ => idle_at::<Hd>(head),
        }
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(detector, head.cast()) }?;
        Ok(kg_status::KG_OK)
    };
    told(init())
}

/// Tells how many bytes a detector of a profile takes: the constants of the header, for programs that
/// load the library at run time.
///
/// Errors: KG_ERROR_PROFILE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_bytes(profile: kg_profile, bytes: *mut usize) -> kg_status {
    let needed = match profile {
        KG_PROFILE_QQVGA => KG_QQVGA_DETECTOR_BYTES,
        KG_PROFILE_QVGA => KG_QVGA_DETECTOR_BYTES,
        KG_PROFILE_VGA => KG_VGA_DETECTOR_BYTES,
        KG_PROFILE_HD => KG_HD_DETECTOR_BYTES,
        _ => return kg_status::KG_ERROR_PROFILE,
    };
    // SAFETY: the pointer is the caller's to give.
    told(unsafe { put(bytes, needed) }.map(|()| kg_status::KG_OK))
}

/// What a search needs, checked.
struct Task<'a> {
    model: Model<'static>,
    frame: Frame<'a>,
    window: Option<Window>,
    options: kg_options,
}

impl Task<'_> {
    /// # Safety
    /// As for the functions that check each of the pointers.
    unsafe fn new(model: *const kg_model, frame: *const kg_frame, options: *const kg_options) -> Outcome<Self> {
        // SAFETY: the contract is the same.
        let model = unsafe { model_of(model) }?;
        // SAFETY: the contract is the same.
        let (frame, window) = unsafe { frame_of(frame) }?;
        // SAFETY: the contract is the same.
        let options = unsafe { kg_options::of(options) }?;
        Ok(Self { model, frame, window, options })
    }
}

/// Searches a frame.
///
/// # Safety
/// As for [`Work::begin`].
unsafe fn search<P: Profile>(slot: *mut Slot<P>, task: &Task<'_>, observer: &mut dyn Observer) -> Outcome {
    // SAFETY: the contract is the same.
    let (_work, d) = unsafe { Work::begin(slot, &task.options, task.window) }?;
    d.detect(&task.frame, &task.model, task.options.threshold, observer)?;
    Ok(if d.stats().stopped { kg_status::KG_STOPPED } else { kg_status::KG_OK })
}

/// Checks that there is a detector that is not at work.
///
/// # Safety
/// As for [`Head::of`].
unsafe fn check_detector(detector: *mut kg_detector) -> Outcome<()> {
    // SAFETY: the contract is the same.
    unsafe { Head::of(detector.cast(), TAG) }.map(|_| ())
}

/// Searches a frame for the objects of a model. kg_detector_detections() then gives the results.
/// `options` and `observer` may be NULL. A search in pieces that is not at its end is given up.
///
/// Returns KG_OK, KG_STOPPED, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_OPTION, KG_ERROR_FORMAT,
/// KG_ERROR_FRAME_LENGTH to KG_ERROR_WINDOW_ODD, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
/// After KG_ERROR_TOO_LARGE there are no results; after the other errors those of before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_detect(
    detector: *mut kg_detector,
    model: *const kg_model,
    frame: *const kg_frame,
    options: *const kg_options,
    observer: *const kg_observer,
) -> kg_status {
    let detect = || {
        // SAFETY: the pointers are the caller's to give.
        unsafe { check_detector(detector) }?;
        // SAFETY: the pointers are the caller's to give.
        let task = unsafe { Task::new(model, frame, options) }?;
        // SAFETY: the pointers are the caller's to give.
        let mut watch = unsafe { Watch::new(observer, None) }?;
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { search(slot, &task, &mut watch) })
    };
    told(detect())
}

/// Does what kg_detector_detect() does, and writes a digest of what each stage made into `digests`, an
/// array of KG_STAGES numbers. Two machines whose digests agree made the same, bit for bit. It takes
/// some more time, which is counted for no stage.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_detect_with_digests(
    detector: *mut kg_detector,
    model: *const kg_model,
    frame: *const kg_frame,
    options: *const kg_options,
    observer: *const kg_observer,
    digests: *mut u32,
) -> kg_status {
    let detect = || {
        // SAFETY: the pointers are the caller's to give.
        unsafe { check_detector(detector) }?;
        crate::boundary::check(digests, crate::observer::KG_STAGES)?;
        // SAFETY: the pointers are the caller's to give.
        let task = unsafe { Task::new(model, frame, options) }?;
        // SAFETY: the pointers are the caller's to give.
        let watch = unsafe { Watch::new(observer, None) }?;
        let mut digesting = Digesting { watch, digests: Digests::new() };
        // SAFETY: the pointers are the caller's to give.
        let status = with_slot!(detector, slot => unsafe { search(slot, &task, &mut digesting) })?;
        // SAFETY: the pointers are the caller's to give.
        unsafe { digesting.put(digests) }?;
        Ok(status)
    };
    told(detect())
}

/// Begins a search in pieces: of a frame and a window of it, or of the frame that was read last.
///
/// # Safety
/// As for [`Work::begin`].
unsafe fn begin_search<P: Profile>(
    slot: *mut Slot<P>,
    model: Model<'static>,
    frame: Option<(&Frame<'_>, Option<Window>)>,
    options: &kg_options,
    watch: &mut Watch,
) -> Outcome {
    // SAFETY: the slot is valid, and nobody works on it.
    let window = frame.map_or_else(|| unsafe { (*slot).own.window }, |(_, window)| window);
    // SAFETY: the contract is the same.
    let (_work, d) = unsafe { Work::begin(slot, options, window) }?;
    // SAFETY: no search is left that refers to the model of the last one, and nobody else uses the slot.
    let kept = unsafe { &mut (*slot).own.model };
    let model = &*kept.insert(model);
    let ongoing = match frame {
        Some((frame, _)) => d.begin(frame, model, options.threshold, watch)?,
        None => d.begin_again(model, options.threshold),
    };
    // SAFETY: as above. The search refers to the detector and to the model in the slot, which stay
    // where they are; both are left alone until the search is dropped.
    unsafe {
        (*slot).search = Some(ongoing);
        (*slot).own.start = watch.start();
    }
    Ok(kg_status::KG_MORE)
}

/// Does the next piece of a search.
///
/// # Safety
/// As for [`Work::begin`].
unsafe fn step_search<P: Profile>(slot: *mut Slot<P>, observer: *const kg_observer) -> Outcome {
    // SAFETY: the slot is valid.
    let start = unsafe { (*slot).own.start };
    // SAFETY: the pointer is the caller's to give.
    let mut watch = unsafe { Watch::new(observer, Some(start)) }?;
    // SAFETY: the slot is valid, and nobody works on it.
    let search = unsafe { (*slot).search.as_mut() }.ok_or(kg_status::KG_ERROR_NO_SEARCH)?;
    // SAFETY: the slot is valid; its head is not borrowed.
    let work = unsafe { Work::on(slot.cast()) };
    let more = search.step(&mut watch);
    drop(work);
    if more {
        return Ok(kg_status::KG_MORE);
    }
    // SAFETY: the search is at its end, and its reference to the detector goes.
    unsafe { (*slot).search = None };
    // SAFETY: the slot is valid.
    let (d, _) = unsafe { idle(slot) }?;
    Ok(if d.stats().stopped { kg_status::KG_STOPPED } else { kg_status::KG_OK })
}

/// Begins a search in pieces, for a program that must do something else in between. The frame is read
/// here, and its buffer may be used again; the bytes of the model must stay. The rest is as in
/// kg_detector_detect().
///
/// Returns KG_MORE, or an error.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_begin(
    detector: *mut kg_detector,
    model: *const kg_model,
    frame: *const kg_frame,
    options: *const kg_options,
    observer: *const kg_observer,
) -> kg_status {
    let begin = || {
        // SAFETY: the pointers are the caller's to give.
        unsafe { check_detector(detector) }?;
        // SAFETY: the pointers are the caller's to give.
        let task = unsafe { Task::new(model, frame, options) }?;
        // SAFETY: the pointers are the caller's to give.
        let mut watch = unsafe { Watch::new(observer, None) }?;
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe {
            begin_search(slot, task.model, Some((&task.frame, task.window)), &task.options, &mut watch)
        })
    };
    told(begin())
}

/// Begins to search the frame that was read last for the objects of another model, such as one that lies
/// elsewhere in flash: the frame's buffer may hold the next frame by now, and models need not be
/// merged. What was found so far is given up: take it before. A detector that has read no frame finds
/// nothing. The rest is as in kg_detector_begin().
///
/// Returns KG_MORE, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_OPTION, KG_ERROR_FORMAT, KG_ERROR_NULL,
/// KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_begin_again(
    detector: *mut kg_detector,
    model: *const kg_model,
    options: *const kg_options,
    observer: *const kg_observer,
) -> kg_status {
    let begin = || {
        // SAFETY: the pointers are the caller's to give.
        unsafe { check_detector(detector) }?;
        // SAFETY: the pointers are the caller's to give.
        let (model, options) = unsafe { (model_of(model)?, kg_options::of(options)?) };
        // SAFETY: the pointers are the caller's to give.
        let mut watch = unsafe { Watch::new(observer, None) }?;
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { begin_search(slot, model, None, &options, &mut watch) })
    };
    told(begin())
}

/// Does the next piece of a search. The longest one finds the corners and triangles of the finest
/// level. The budget of the observer counts from kg_detector_begin() on.
///
/// Returns KG_MORE, KG_OK after the last piece, KG_STOPPED if the observer has stopped the search, or
/// KG_ERROR_NO_SEARCH, KG_ERROR_BUSY, KG_ERROR_HANDLE, KG_ERROR_OPTION, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_step(detector: *mut kg_detector, observer: *const kg_observer) -> kg_status {
    let step = || {
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { step_search(slot, observer) })
    };
    told(step())
}

/// Gives up a search in pieces. There are no results then. Without a search it does nothing.
///
/// Returns KG_OK, or KG_ERROR_BUSY, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_cancel(detector: *mut kg_detector) -> kg_status {
    let cancel = || {
        // SAFETY: the slot is valid, and nobody works on it.
        with_slot!(detector, slot => unsafe { (*slot).search = None });
        Ok(kg_status::KG_OK)
    };
    told(cancel())
}
