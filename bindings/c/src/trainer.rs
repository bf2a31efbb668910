//! The trainer, in memory that the caller gives.
//!
//! In: memory, one picture, a buffer for the model. Out: a model. Memory: KG_..._TRAINER_BYTES by
//! profile, and the buffer. Cost: that of the core's trainer. Its code exists once for each of the
//! three profiles.

use core::ffi::{c_char, c_void};

use keygraph_core::{Frame, Preset, QqvgaTrainer, TrainParams, Trained, Trainer, VgaTrainer, chroma_bytes, luma_bytes};

use crate::boundary::{Outcome, bytes_mut, put, shared, text, told};
use crate::detector::{KG_PROFILE_QQVGA, KG_PROFILE_QVGA, KG_PROFILE_VGA, kg_profile, suits};
use crate::frame::{frame_of, kg_frame};
use crate::model::KG_NAME_BYTES;
use crate::place::{Head, Zeroed, zeroed};
use crate::status::kg_status;

type QvgaTrainer = Trainer<{ luma_bytes(320 * 240) }, { chroma_bytes(320 * 240) }, 320, 800>;

/// Bytes of a trainer for pictures of up to 160 x 120 px.
pub const KG_QQVGA_TRAINER_BYTES: usize = 139_072;
/// Bytes of a trainer for pictures of up to 320 x 240 px.
pub const KG_QVGA_TRAINER_BYTES: usize = 383_936;
/// Bytes of a trainer for pictures of up to 640 x 480 px.
pub const KG_VGA_TRAINER_BYTES: usize = 1_330_752;

const _: () = assert!(suits::<Slot<QqvgaTrainer>>(KG_QQVGA_TRAINER_BYTES), "KG_QQVGA_TRAINER_BYTES");
const _: () = assert!(suits::<Slot<QvgaTrainer>>(KG_QVGA_TRAINER_BYTES), "KG_QVGA_TRAINER_BYTES");
const _: () = assert!(suits::<Slot<VgaTrainer>>(KG_VGA_TRAINER_BYTES), "KG_VGA_TRAINER_BYTES");

/// How much a model holds: one of KG_PRESET_...
pub type kg_preset = u32;

/// Up to 2,000,000 bytes. A larger model finds no more.
pub const KG_PRESET_LARGE: kg_preset = 0;
/// Up to 1,500,000 bytes: fits the flash of the larger boards.
pub const KG_PRESET_STANDARD: kg_preset = 1;
/// Up to 524,288 bytes: fits most boards.
pub const KG_PRESET_COMPACT: kg_preset = 2;
/// Up to 65,536 bytes, from a picture of at most 240 x 180 px: the preset for training on a board.
pub const KG_PRESET_LEARNT: kg_preset = 3;
/// The method of the paper as written, up to 8,388,608 bytes.
pub const KG_PRESET_PAPER: kg_preset = 4;

const _: () = {
    use Preset as P;
    let all = [
        (P::Large, KG_PRESET_LARGE, 2_000_000),
        (P::Standard, KG_PRESET_STANDARD, 1_500_000),
        (P::Compact, KG_PRESET_COMPACT, 524_288),
        (P::Learnt, KG_PRESET_LEARNT, 65_536),
        (P::Paper, KG_PRESET_PAPER, 8_388_608),
    ];
    assert!(all.len() == P::ALL.len(), "every preset has a number");
    let mut i = 0;
    while i < all.len() {
        assert!(P::ALL[i] as u32 == all[i].1 && all[i].0 as u32 == all[i].1, "the numbers differ");
        assert!(all[i].0.bytes() == all[i].2, "the sizes in the header differ");
        i += 1;
    }
};

/// What is trained.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kg_training {
    /// Name of the object: UTF-8 of 1 to KG_NAME_BYTES - 1 bytes, and a zero byte.
    pub name: *const c_char,
    /// KG_PRESET_...
    pub preset: kg_preset,
    /// Not 0 to leave out colour, for pictures and cameras without it.
    pub luma_only: u32,
    /// Width of the picture that the given one is a scaled copy of, px; poses are in px of it. 0 in both
    /// members: the given picture, or the window of it.
    pub original_width: u32,
    /// Height of that picture, px.
    pub original_height: u32,
}

/// Result of a training.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct kg_trained {
    /// Length of the model, at the start of the buffer, bytes.
    pub bytes: usize,
    /// Number of keypoints, over all views.
    pub keypoints: u32,
    /// Number of keygraphs in the model.
    pub keygraphs: u32,
    /// Number of keygraphs that exceeded a maximum or the buffer.
    pub dropped: u32,
}

/// A trainer, in the memory that was given to kg_trainer_init(). It needs no end, and must not be moved.
/// After training, the memory may hold a detector instead.
#[derive(Debug)]
pub struct kg_trainer {
    _opaque: (),
}

const TAG: u32 = 0x6b67_5441;

#[repr(C)]
struct Slot<T> {
    head: Head,
    trainer: T,
}

/// Makes a trainer for pictures of a profile (not hd) in memory of at least KG_..._TRAINER_BYTES bytes, at
/// a multiple of KG_ALIGNMENT. The memory need not be cleared. `trainer` receives the trainer.
///
/// Errors: KG_ERROR_PROFILE, KG_ERROR_MEMORY, KG_ERROR_ALIGNMENT, KG_ERROR_NULL, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_trainer_init(
    memory: *mut c_void,
    bytes: usize,
    profile: kg_profile,
    trainer: *mut *mut kg_trainer,
) -> kg_status {
    const fn zeroes<T: Zeroed>(needed: usize) -> usize {
        needed
    }
    let init = || {
        let needed = match profile {
            KG_PROFILE_QQVGA => zeroes::<QqvgaTrainer>(KG_QQVGA_TRAINER_BYTES),
            KG_PROFILE_QVGA => zeroes::<QvgaTrainer>(KG_QVGA_TRAINER_BYTES),
            KG_PROFILE_VGA => zeroes::<VgaTrainer>(KG_VGA_TRAINER_BYTES),
            _ => return Err(kg_status::KG_ERROR_PROFILE),
        };
        crate::boundary::check(trainer, 1)?;
        // SAFETY: the memory is the caller's to give.
        let head = unsafe { zeroed(memory, bytes, needed) }?;
        // SAFETY: the memory has room for a slot of the profile and is aligned, and its trainer is
        // zero, which is a new one.
        unsafe { Head::mark(head, TAG, profile) };
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(trainer, head.cast()) }?;
        Ok(kg_status::KG_OK)
    };
    told(init())
}

/// Trains in a slot.
///
/// # Safety
/// The slot was made for this trainer, and nobody else uses it.
#[inline(never)]
unsafe fn train<const L: usize, const C: usize, const S: usize, const K: usize>(
    head: *mut Head,
    picture: &Frame<'_>,
    original: (u32, u32),
    params: &TrainParams<'_>,
    out: &mut [u8],
) -> Outcome<Trained> {
    let slot = head.cast::<Slot<Trainer<L, C, S, K>>>();
    // SAFETY: the contract is the same.
    let trainer = unsafe { &mut (*slot).trainer };
    Ok(trainer.train(picture, original, params, out)?)
}

/// Trains a model from one picture: the object from the front, and nothing else; a window of a frame will
/// do. The model is written to the start of `out`, which has `room` bytes and needs no alignment; what the
/// preset allows is never exceeded. `trained` receives its length. kg_model_open() then takes it.
///
/// A model that has less room than its preset allows holds the likeliest keygraphs. It takes up to some
/// seconds on a board. After an error the content of `out` is not defined.
///
/// Errors: KG_ERROR_BUFFER to KG_ERROR_ORIGINAL, KG_ERROR_NAME, KG_ERROR_PRESET, KG_ERROR_FORMAT,
/// KG_ERROR_FRAME_LENGTH to KG_ERROR_WINDOW_ODD, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT,
/// KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_trainer_train(
    trainer: *mut kg_trainer,
    picture: *const kg_frame,
    training: *const kg_training,
    out: *mut u8,
    room: usize,
    trained: *mut kg_trained,
) -> kg_status {
    let run = || {
        // SAFETY: the pointers are the caller's to give.
        let head = unsafe { Head::of(trainer.cast(), TAG) }?;
        // SAFETY: the pointers are the caller's to give.
        let (picture, _) = unsafe { frame_of(picture) }?;
        // SAFETY: the pointers are the caller's to give.
        let training = unsafe { shared(training) }?;
        // SAFETY: the pointers are the caller's to give.
        let name = unsafe { text(training.name.cast(), KG_NAME_BYTES) }?;
        if name.is_empty() {
            return Err(kg_status::KG_ERROR_NAME);
        }
        let preset = usize::try_from(training.preset).ok().and_then(|p| Preset::ALL.get(p).copied());
        let preset = preset.ok_or(kg_status::KG_ERROR_PRESET)?;
        let own = || Some((u32::try_from(picture.width()).ok()?, u32::try_from(picture.height()).ok()?));
        let original = match (training.original_width, training.original_height) {
            (0, 0) => own().ok_or(kg_status::KG_ERROR_TOO_LARGE)?,
            sides => sides,
        };
        crate::boundary::check(trained, 1)?;
        // SAFETY: the pointers are the caller's to give.
        let out = unsafe { bytes_mut(out, room) }?;
        let most = room.min(preset.bytes());
        let (params, out) = (preset.params(name, training.luma_only != 0), &mut out[..most]);
        // SAFETY: the head is valid, and says for which profile the slot was made.
        let result = unsafe {
            match (*head).profile {
                KG_PROFILE_QQVGA => train::<{ luma_bytes(160 * 120) }, { chroma_bytes(160 * 120) }, 160, 320>(
                    head, &picture, original, &params, out,
                ),
                KG_PROFILE_QVGA => train::<{ luma_bytes(320 * 240) }, { chroma_bytes(320 * 240) }, 320, 800>(
                    head, &picture, original, &params, out,
                ),
                _ => train::<{ luma_bytes(640 * 480) }, { chroma_bytes(640 * 480) }, 640, 1600>(
                    head, &picture, original, &params, out,
                ),
            }
        }?;
        let result = kg_trained {
            bytes: result.bytes,
            keypoints: u32::try_from(result.keypoints()).unwrap_or(u32::MAX),
            keygraphs: result.keygraphs.kept,
            dropped: result.keygraphs.dropped,
        };
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(trained, result) }?;
        Ok(kg_status::KG_OK)
    };
    told(run())
}
