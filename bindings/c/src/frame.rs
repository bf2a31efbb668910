//! Frames of a camera, as C describes them.
//!
//! In: a [`kg_frame`]. Out: a frame of the core, and the window in it. Memory: none: no pixel is
//! copied. Cost: some comparisons. The pixel format is a number at run time, so the code of all eight
//! formats is linked.

use keygraph_core::{Frame, FrameError, PixelFormat, Window};

use crate::boundary::{Outcome, bytes, put, shared, told};
use crate::status::kg_status;

/// Layout of the pixels of a frame in memory: one of KG_FORMAT_...
pub type kg_format = u32;

/// 3 bytes a pixel: red, green, blue.
pub const KG_FORMAT_RGB8: kg_format = 0;
/// 1 byte a pixel.
pub const KG_FORMAT_GRAY8: kg_format = 1;
/// 4:2:2 packed, Y0 U Y1 V, 2 bytes a pixel. The width must be even.
pub const KG_FORMAT_YUYV: kg_format = 2;
/// 4:2:0, a Y plane, then interleaved U and V of half size. Both sides must be even.
pub const KG_FORMAT_NV12: kg_format = 3;
/// 4:2:0, a Y plane, then a U plane and a V plane of half size. Both sides must be even.
pub const KG_FORMAT_I420: kg_format = 4;
/// 2 bytes a pixel, little endian, red in the top five bits.
pub const KG_FORMAT_RGB565: kg_format = 5;
/// 4:2:2 packed, U Y0 V Y1, 2 bytes a pixel. The width must be even.
pub const KG_FORMAT_UYVY: kg_format = 6;
/// 2 bytes a pixel, big endian, red in the top five bits: as many sensors send their bytes.
pub const KG_FORMAT_RGB565_BE: kg_format = 7;

const _: () = {
    use PixelFormat as F;
    let numbers = [
        (F::Rgb8, KG_FORMAT_RGB8),
        (F::Gray8, KG_FORMAT_GRAY8),
        (F::Yuyv, KG_FORMAT_YUYV),
        (F::Nv12, KG_FORMAT_NV12),
        (F::I420, KG_FORMAT_I420),
        (F::Rgb565, KG_FORMAT_RGB565),
        (F::Uyvy, KG_FORMAT_UYVY),
        (F::Rgb565Be, KG_FORMAT_RGB565_BE),
    ];
    assert!(numbers.len() == F::ALL.len(), "every format has a number");
    let mut i = 0;
    while i < numbers.len() {
        assert!(numbers[i].0 as u32 == numbers[i].1 && F::ALL[i] as u32 == numbers[i].1, "the numbers differ");
        i += 1;
    }
};

/// A rectangular part of a frame, px. All zero stands for the whole frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct kg_window {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

/// One frame as the camera gave it. The bytes are read during the call alone.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct kg_frame {
    /// The first byte of the first row. It needs no alignment.
    pub data: *const u8,
    /// Number of bytes at `data`. Without a stride: exactly those of a frame. With one: at least.
    pub bytes: usize,
    /// Number of bytes from a row to the next, for rows with bytes between them; 0 for rows without.
    /// In NV12 and I420 it is the stride of luma, and the chroma planes follow after `stride * height`
    /// bytes: with this stride in NV12, with half of it in I420.
    pub stride: usize,
    /// Pixel format: KG_FORMAT_...
    pub format: kg_format,
    /// Width, px: 16 to 32,767, and no more than the profile takes.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// The part that is used; all zero for the whole frame. Results are in px of the whole frame. Only
    /// the part must fit the profile.
    pub window: kg_window,
}

/// Returns a number as a length. No target of the library has fewer than 32 bits.
const fn length(n: u32) -> usize {
    const { assert!(size_of::<usize>() >= size_of::<u32>(), "a length has 32 bits or more") };
    n as usize
}

const fn format_of(format: kg_format) -> Outcome<PixelFormat> {
    if length(format) < PixelFormat::ALL.len() {
        Ok(PixelFormat::ALL[length(format)])
    } else {
        Err(kg_status::KG_ERROR_FORMAT)
    }
}

fn whole<'a>(f: &kg_frame, format: PixelFormat, data: &'a [u8]) -> Result<Frame<'a>, FrameError> {
    let (width, height) = (length(f.width), length(f.height));
    match f.stride {
        0 => Frame::new(format, width, height, data),
        stride => Frame::with_stride(format, width, height, stride, data),
    }
}

/// Checks a frame from C. Returns the part that is used, and where that part is in the frame.
///
/// # Safety
/// If `frame` passes the checks, it leads to a frame, and its bytes stay as they are while they are
/// borrowed.
pub(crate) unsafe fn frame_of<'a>(frame: *const kg_frame) -> Outcome<(Frame<'a>, Option<Window>)> {
    // SAFETY: the contract is the same.
    let f = unsafe { shared(frame) }?;
    let format = format_of(f.format)?;
    // SAFETY: the contract is the same.
    let data = unsafe { bytes(f.data, f.bytes) }?;
    let frame = whole(f, format, data)?;
    if f.window == kg_window::default() {
        return Ok((frame, None));
    }
    let [x, y, width, height] = [f.window.x, f.window.y, f.window.width, f.window.height].map(length);
    let window = Window { x, y, width, height };
    Ok((frame.window(window)?, Some(window)))
}

/// Tells how many bytes a frame of this format, size and stride has (`stride` 0: rows without bytes
/// between them; with one: the bytes up to the end of the last row).
///
/// Returns KG_OK, or the error that kg_detector_detect() would return for such a frame.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_frame_bytes(
    format: kg_format,
    width: u32,
    height: u32,
    stride: usize,
    bytes: *mut usize,
) -> kg_status {
    let needed = || {
        let format = format_of(format)?;
        let frame =
            kg_frame { data: [].as_ptr(), bytes: 0, stride, format: 0, width, height, window: kg_window::default() };
        match whole(&frame, format, &[]) {
            Err(FrameError::WrongLength { expected, .. }) if isize::try_from(expected).is_ok() => Ok(expected),
            Err(FrameError::WrongLength { .. }) => Err(kg_status::KG_ERROR_LENGTH),
            Err(e) => Err(e.into()),
            Ok(_) => Ok(0),
        }
    };
    // SAFETY: the pointer is the caller's to give.
    told(needed().and_then(|n| unsafe { put(bytes, n) }).map(|()| kg_status::KG_OK))
}
