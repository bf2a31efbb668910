//! Models: a checked view of bytes that stay where they are, in flash or in RAM.
//!
//! In: bytes. Out: a [`kg_model`] in the caller's memory, and facts about it. Memory: [`kg_model`];
//! the bytes are read in place. Cost: one pass over the bytes to open a model.

use core::ffi::c_char;

use keygraph_core::{FeatureKind, Method, Model, NAME_BYTES};

use crate::boundary::{Outcome, bytes, check, put, shared, told};
use crate::status::kg_status;

/// Bytes of a name with its zero byte.
pub const KG_NAME_BYTES: usize = 33;
const _: () = assert!(KG_NAME_BYTES == NAME_BYTES + 1, "the core's names have another length");

const _: () = assert!(size_of::<Opened>() <= size_of::<kg_model>() && align_of::<Opened>() <= align_of::<kg_model>());

const TAG: u32 = 0x6b67_4d4f;

/// A model that has been checked. What is in it is the library's. It may be copied, and needs no end.
/// It refers to the bytes of the model, which must stay where and as they are for as long as it is used.
#[repr(C)]
#[derive(Debug)]
pub struct kg_model {
    opaque: [u64; 24],
}

#[repr(C)]
struct Opened {
    tag: u32,
    model: Model<'static>,
}

/// What is known of a model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kg_model_info {
    /// Number of bytes.
    pub bytes: usize,
    /// Number of objects, 1 to 65,535.
    pub objects: u32,
    /// Number of views, over all objects.
    pub views: u32,
    /// Number of keypoints, over all views.
    pub keypoints: u32,
    /// Number of keygraphs. A keygraph that is also on a list of the likeliest counts twice.
    pub keygraphs: u32,
    /// 1 if the model was trained with the preset "paper", 0 if with any other. A model does not say
    /// which of the others it was.
    pub paper: u32,
    /// 1 if the model uses colour: it then finds more in frames that have some.
    pub colour: u32,
}

/// An object of a model.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kg_object {
    /// Name, UTF-8; it ends with a zero byte.
    pub name: [c_char; KG_NAME_BYTES],
    /// Width of the training picture, px. Homographies map from px of that picture.
    pub width: u32,
    /// Height of the training picture, px.
    pub height: u32,
    /// Number of keypoints, over all views.
    pub keypoints: u32,
}

/// Returns the model in an opened `kg_model`.
///
/// # Safety
/// If `model` passes the checks, it leads to a `kg_model`. If that was opened, its bytes are still as
/// they were.
pub(crate) unsafe fn model_of(model: *const kg_model) -> Outcome<Model<'static>> {
    check(model, 1)?;
    let opened = model.cast::<Opened>();
    // SAFETY: the memory is aligned and as large as a `kg_model`; a number has no invalid value.
    let tag = unsafe { (*opened).tag };
    if tag != TAG {
        return Err(kg_status::KG_ERROR_HANDLE);
    }
    // SAFETY: the tag is written after the model.
    Ok(unsafe { (*opened).model })
}

/// Checks that `bytes` bytes at `data` are exactly one model, and opens it. `data` needs no alignment.
/// It takes one pass over the bytes; nothing is copied.
///
/// A model that is refused leaves `model` without one.
///
/// Errors: KG_ERROR_NOT_A_MODEL to KG_ERROR_INCONSISTENT, KG_ERROR_NULL, KG_ERROR_ALIGNMENT of `model`,
/// KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_model_open(model: *mut kg_model, data: *const u8, bytes: usize) -> kg_status {
    let open = || {
        check(model, 1)?;
        let opened = model.cast::<Opened>();
        // SAFETY: the memory is aligned, large enough and the caller's to give.
        unsafe { (*opened).tag = 0 };
        // SAFETY: the caller keeps the bytes as they are for as long as the model is used.
        let data = unsafe { crate::boundary::bytes(data, bytes) }?;
        let parsed = Model::parse(data)?;
        // SAFETY: as above.
        unsafe { opened.write(Opened { tag: TAG, model: parsed }) };
        Ok(kg_status::KG_OK)
    };
    told(open())
}

/// Tells how many bytes a model has that begins at `data`, from its header, where more bytes may
/// follow: a partition of flash of `available` bytes. kg_model_open() then takes that many.
///
/// Errors: KG_ERROR_NOT_A_MODEL, KG_ERROR_NEWER_MODEL, KG_ERROR_OLDER_MODEL, KG_ERROR_TRUNCATED if the
/// model has more bytes than `available`, KG_ERROR_NULL, KG_ERROR_LENGTH.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_model_bytes(data: *const u8, available: usize, length: *mut usize) -> kg_status {
    let measure = || {
        // SAFETY: the caller vouches for the bytes.
        let data = unsafe { bytes(data, available) }?;
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(length, Model::length(data)?) }?;
        Ok(kg_status::KG_OK)
    };
    told(measure())
}

/// Returns a count as 32 bits. A model of 4 GB, which alone could hold more, is refused by its header.
fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

/// Tells what is known of an opened model.
///
/// Errors: KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_model_describe(model: *const kg_model, info: *mut kg_model_info) -> kg_status {
    let describe = || {
        // SAFETY: the pointer is the caller's to give.
        let model = unsafe { model_of(model) }?;
        let told = kg_model_info {
            bytes: model.bytes().len(),
            objects: count(model.objects()),
            views: count(model.views()),
            keypoints: count(model.keypoints()),
            keygraphs: count(model.keygraphs()),
            paper: u32::from(model.method() == Method::Paper),
            colour: u32::from(model.feature() != FeatureKind::Luma),
        };
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(info, told) }?;
        Ok(kg_status::KG_OK)
    };
    told(describe())
}

/// Tells name and size of an object of a model: `index` from 0 to kg_model_info.objects - 1.
///
/// Errors: KG_ERROR_INDEX, KG_ERROR_HANDLE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_model_object(model: *const kg_model, index: u32, object: *mut kg_object) -> kg_status {
    let describe = || {
        // SAFETY: the pointer is the caller's to give.
        let model = unsafe { model_of(model) }?;
        let index = usize::try_from(index).ok().filter(|&i| i < model.objects()).ok_or(kg_status::KG_ERROR_INDEX)?;
        let o = model.object(index);
        let mut told = kg_object { name: [0; KG_NAME_BYTES], width: o.width, height: o.height, keypoints: o.keypoints };
        // The last byte stays zero.
        for (to, from) in told.name[..NAME_BYTES].iter_mut().zip(o.name.bytes()) {
            *to = c_char::from_ne_bytes([from]);
        }
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(object, told) }?;
        Ok(kg_status::KG_OK)
    };
    told(describe())
}

/// Borrows an object from C.
///
/// # Safety
/// If the pointer passes the checks, it leads to a `kg_object`.
pub(crate) unsafe fn object_size(object: *const kg_object) -> Outcome<[f32; 2]> {
    // SAFETY: the contract is the same.
    let o = unsafe { shared(object) }?;
    Ok([o.width as f32, o.height as f32])
}
