//! What a search has found, and what its stages did.
//!
//! In: a detector. Out: detections, rivals, surfaces, statistics, in arrays of the caller. Memory: none of its own.
//! Cost: copies; that of a surface stands beside it.

use keygraph_core::{Known, Lens, Model, Profile, Surface};

use crate::boundary::{Outcome, list, optional, put, told};
use crate::detection::{kg_detection, kg_surface};
use crate::detector::kg_detector;
use crate::model::{kg_model, model_of};
use crate::observer::{buffer_of, kg_buffer, kg_stats, put_stats};
use crate::pose::kg_lens;
use crate::slot::{Slot, idle, with_slot};
use crate::status::kg_status;

/// Writes detections: those so far of a search in pieces, or those of the last search.
///
/// # Safety
/// The slot comes from `with_slot`, and the pointers are the caller's to give.
unsafe fn put_detections<P: Profile>(
    slot: *mut Slot<P>,
    out: *mut kg_detection,
    room: usize,
    count: *mut usize,
) -> Outcome {
    // SAFETY: the slot is valid, and nobody works on it.
    let (search, window) = unsafe { ((*slot).search.as_ref(), (*slot).own.window) };
    if let Some(search) = search {
        let all = search.detections().iter().map(|d| kg_detection::new(d, window, 0));
        // SAFETY: the pointers are the caller's to give.
        unsafe { list(all, out, room, count) }?;
    } else {
        // SAFETY: the slot is valid.
        let (d, window) = unsafe { idle(slot) }?;
        let all = d.detections().iter().map(|found| kg_detection::new(found, window, d.rivals(found).count()));
        // SAFETY: the pointers are the caller's to give.
        unsafe { list(all, out, room, count) }?;
    }
    Ok(kg_status::KG_OK)
}

/// Writes the rivals of a detection.
///
/// # Safety
/// As for [`put_detections`].
unsafe fn put_rivals<P: Profile>(
    slot: *mut Slot<P>,
    index: usize,
    out: *mut kg_detection,
    room: usize,
    count: *mut usize,
) -> Outcome {
    // SAFETY: the slot is valid.
    let (d, window) = unsafe { idle(slot) }?;
    let found = d.detections().get(index).ok_or(kg_status::KG_ERROR_INDEX)?;
    let all = d.rivals(found).map(|rival| kg_detection::new(rival, window, 0));
    // SAFETY: the pointers are the caller's to give.
    unsafe { list(all, out, room, count) }?;
    Ok(kg_status::KG_OK)
}

/// Writes the surface of a detection.
///
/// # Safety
/// As for [`put_detections`].
unsafe fn put_surface<P: Profile>(
    slot: *mut Slot<P>,
    model: &Model<'_>,
    index: usize,
    lens: Option<&Lens>,
    out: *mut kg_surface,
) -> Outcome {
    // SAFETY: the slot is valid.
    let (d, window) = unsafe { idle(slot) }?;
    let found = d.detections().get(index).ok_or(kg_status::KG_ERROR_INDEX)?;
    if usize::from(found.object) >= model.objects() {
        return Err(kg_status::KG_ERROR_INDEX);
    }
    let object = model.object(usize::from(found.object));
    // The lens is that of the frame, and the detector has a window of it.
    let lens = lens.map(|lens| window.map_or(*lens, |w| lens.within(&w.to_frame())));
    let known = Known { lens: lens.as_ref(), is_flat: false };
    let size = [object.width as f32, object.height as f32];
    let surface = d.surface(model, found, known, &mut || 0);
    let surface = surface.unwrap_or_else(|| Surface::plane(&found.homography, size));
    // SAFETY: the pointer is the caller's to give.
    unsafe { put(out, kg_surface::new(&surface, window)) }?;
    Ok(kg_status::KG_OK)
}

/// Writes the detections of the last search into `out`, an array of `room` elements, best score first,
/// and how many there are into `count`, which may be more. KG_DETECTIONS is always enough. Between two
/// steps of a search in pieces, these are the detections so far.
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_detections(
    detector: *mut kg_detector,
    out: *mut kg_detection,
    room: usize,
    count: *mut usize,
) -> kg_status {
    let write = || {
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { put_detections(slot, out, room, count) })
    };
    told(write())
}

/// Writes the rivals of a detection into `out`: other objects that could be at its place, and are seen
/// less well there. `index` is that of the detection among the results. The rest is as in
/// kg_detector_detections().
///
/// Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_BUSY, KG_ERROR_NULL, KG_ERROR_ALIGNMENT,
/// KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_rivals(
    detector: *mut kg_detector,
    index: usize,
    out: *mut kg_detection,
    room: usize,
    count: *mut usize,
) -> kg_status {
    let write = || {
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { put_rivals(slot, index, out, room, count) })
    };
    told(write())
}

/// Writes the surface on which the object of a detection lies into `out`: that of a label on a can or of a page of
/// a book where a plane does not explain what is seen, else the plane. `model` is the one that was searched for,
/// `index` that of the detection among the results. `lens` is the camera's, px of the frame, and may be NULL; through
/// one a plane has curved sides. A bent surface takes about as long as the search of a frame that shows an object, and
/// some 14 KB of stack.
///
/// Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_INTRINSICS, KG_ERROR_OPTION, KG_ERROR_HANDLE, KG_ERROR_BUSY,
/// KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_surface(
    detector: *mut kg_detector,
    model: *const kg_model,
    index: usize,
    lens: *const kg_lens,
    out: *mut kg_surface,
) -> kg_status {
    let write = || {
        // SAFETY: the pointers are the caller's to give.
        let model = unsafe { model_of(model) }?;
        // SAFETY: the pointers are the caller's to give.
        let lens = unsafe { optional(lens) }?.map(kg_lens::of).transpose()?;
        // SAFETY: the pointers are the caller's to give.
        with_slot!(detector, slot => unsafe { put_surface(slot, &model, index, lens.as_ref(), out) })
    };
    told(write())
}

/// Tells what the stages did in the last frame.
///
/// Returns KG_OK, or KG_ERROR_HANDLE, KG_ERROR_BUSY (also between two steps of a search in pieces),
/// KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_stats(detector: *mut kg_detector, stats: *mut kg_stats) -> kg_status {
    let write = || {
        // SAFETY: the slot is valid.
        let told = with_slot!(detector, slot => unsafe { idle(slot) }.map(|(d, _)| d.stats()))?;
        // SAFETY: the pointer is the caller's to give.
        Ok(unsafe { put_stats(told, true, stats) })
    };
    told(write())
}

/// Tells size and use of a buffer of the detector: `index` from 0 to KG_BUFFERS - 1.
///
/// Returns KG_OK, or KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_BUSY (also between two steps of a search
/// in pieces), KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detector_buffer(
    detector: *mut kg_detector,
    index: u32,
    buffer: *mut kg_buffer,
) -> kg_status {
    let write = || {
        // SAFETY: the slot is valid.
        let told = with_slot!(detector, slot => unsafe { idle(slot) }.map(|(d, _)| buffer_of(d, index)))??;
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(buffer, told) }?;
        Ok(kg_status::KG_OK)
    };
    told(write())
}
