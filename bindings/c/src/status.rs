//! What every function of the interface returns.
//!
//! In: the errors of the core. Out: a number and a sentence that says what to do. Memory: the
//! sentences, in flash. Cost: none.

use core::ffi::{CStr, c_char};

use keygraph_core::{CameraError, FrameError, ModelError, TrainError};

/// Result of a call. Zero and above: the call did its work. Below zero: it did nothing, and outputs keep
/// what they held, unless the function says otherwise.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum kg_status {
    /// All is well.
    KG_OK = 0,
    /// The observer, or its budget, has stopped the search. What was found until then are the results.
    KG_STOPPED = 1,
    /// The search in pieces goes on: call kg_detector_step() again.
    KG_MORE = 2,
    /// A pointer is NULL that must not be.
    KG_ERROR_NULL = -1,
    /// A pointer is not aligned: to KG_ALIGNMENT for the memory of an object, else to its type.
    KG_ERROR_ALIGNMENT = -2,
    /// The memory is shorter than the header says: give KG_..._BYTES.
    KG_ERROR_MEMORY = -3,
    /// A length leads around the end of the address space.
    KG_ERROR_LENGTH = -4,
    /// The memory holds no object of this kind: call its init or open function first.
    KG_ERROR_HANDLE = -5,
    /// The object is at work: it was called from a callback, from an interrupt or a second thread; or
    /// a search in pieces is not at its end: finish it, or call kg_detector_cancel().
    KG_ERROR_BUSY = -6,
    /// There is no such profile.
    KG_ERROR_PROFILE = -7,
    /// There is no such pixel format.
    KG_ERROR_FORMAT = -8,
    /// An option is out of its range.
    KG_ERROR_OPTION = -9,
    /// There is no element with this index.
    KG_ERROR_INDEX = -10,
    /// A name is not UTF-8, is empty, or has more than KG_NAME_BYTES - 1 bytes.
    KG_ERROR_NAME = -11,
    /// There is no such preset.
    KG_ERROR_PRESET = -12,
    /// No search has begun: call kg_detector_begin() first.
    KG_ERROR_NO_SEARCH = -13,
    /// The buffer does not hold exactly one frame, or with a stride at least one: kg_frame_bytes() says
    /// how many bytes that is.
    KG_ERROR_FRAME_LENGTH = -20,
    /// The width is odd, and the format shares chroma between columns.
    KG_ERROR_ODD_WIDTH = -21,
    /// The height is odd, and the format shares chroma between rows.
    KG_ERROR_ODD_HEIGHT = -22,
    /// A side of the frame or of the window has less than 16 px.
    KG_ERROR_TOO_SMALL = -23,
    /// The frame, or its window, does not fit the profile: scale it down, or use a larger profile.
    KG_ERROR_TOO_LARGE = -24,
    /// The stride is shorter than a row, or odd in I420.
    KG_ERROR_STRIDE = -25,
    /// The window leaves the frame.
    KG_ERROR_WINDOW = -26,
    /// The window begins between pixels that share chroma: begin at an even x, in NV12 and I420 at an
    /// even y too.
    KG_ERROR_WINDOW_ODD = -27,
    /// The bytes do not begin as a model does.
    KG_ERROR_NOT_A_MODEL = -40,
    /// A newer version wrote the model: update the library, or train again.
    KG_ERROR_NEWER_MODEL = -41,
    /// An older version wrote the model: train again.
    KG_ERROR_OLDER_MODEL = -42,
    /// The bytes end before the model does.
    KG_ERROR_TRUNCATED = -43,
    /// Bytes follow the model: kg_model_bytes() says how many it has.
    KG_ERROR_TRAILING = -44,
    /// The checksum does not match: the model is damaged.
    KG_ERROR_CHECKSUM = -45,
    /// The checksum matches, and the content contradicts itself: train again.
    KG_ERROR_INCONSISTENT = -46,
    /// The buffer for the model cannot hold even an empty one.
    KG_ERROR_BUFFER = -60,
    /// The picture has too few corners: use one with more texture, sharper or brighter.
    KG_ERROR_NO_TEXTURE = -61,
    /// A side of the picture is too short: use a larger picture.
    KG_ERROR_TOO_NARROW = -62,
    /// A side of the original picture is not from 1 to 1,048,576 px.
    KG_ERROR_ORIGINAL = -63,
    /// Intrinsics are four finite numbers, the focal lengths above zero.
    KG_ERROR_INTRINSICS = -80,
    /// A size is not above zero, or not finite.
    KG_ERROR_SIZE = -81,
    /// No pose has this homography: it shows the plane from behind or edge on.
    KG_ERROR_NO_POSE = -82,
    /// The core reports an error that this interface does not know.
    KG_ERROR_UNKNOWN = -99,
}

/// Makes a table of the sentences, one for each status.
macro_rules! texts {
    ($($name:ident => $text:literal;)+) => {
        /// Returns the sentence of a status, which may be any number.
        const fn text_of(status: i32) -> &'static CStr {
            $(if status == kg_status::$name as i32 {
                return $text;
            })+
            c"this is no status of this version of the library"
        }

        /// A status without a sentence does not compile.
        const _: fn(kg_status) = |status| match status {
            $(kg_status::$name => (),)+
        };

        #[cfg(test)]
        const ALL: &[kg_status] = &[$(kg_status::$name),+];
    };
}

texts! {
    KG_OK => c"ok";
    KG_STOPPED => c"the search was stopped: the results are those of what was searched";
    KG_MORE => c"the search goes on";
    KG_ERROR_NULL => c"a pointer is NULL";
    KG_ERROR_ALIGNMENT => c"a pointer is not aligned: memory for objects needs KG_ALIGNMENT bytes";
    KG_ERROR_MEMORY => c"the memory is too short: give as many bytes as the header says";
    KG_ERROR_LENGTH => c"a length is larger than any memory";
    KG_ERROR_HANDLE => c"this memory holds no such object: initialise it first";
    KG_ERROR_BUSY => c"the object is at work: end the search first, and do not call from callbacks";
    KG_ERROR_PROFILE => c"there is no such profile";
    KG_ERROR_FORMAT => c"there is no such pixel format";
    KG_ERROR_OPTION => c"an option is out of its range";
    KG_ERROR_INDEX => c"there is no element with this index";
    KG_ERROR_NAME => c"a name is empty, too long, or not UTF-8";
    KG_ERROR_PRESET => c"there is no such preset";
    KG_ERROR_NO_SEARCH => c"no search has begun";
    KG_ERROR_FRAME_LENGTH => c"the buffer does not have the bytes of a frame of this size and format";
    KG_ERROR_ODD_WIDTH => c"the width is odd: this format needs an even width";
    KG_ERROR_ODD_HEIGHT => c"the height is odd: this format needs an even height";
    KG_ERROR_TOO_SMALL => c"a side of the frame or the window has less than 16 px";
    KG_ERROR_TOO_LARGE => c"the frame does not fit the profile: scale it down, or use a larger profile";
    KG_ERROR_STRIDE => c"the stride is shorter than a row, or odd in I420";
    KG_ERROR_WINDOW => c"the window leaves the frame";
    KG_ERROR_WINDOW_ODD => c"the window begins between pixels that share chroma: begin at an even x and y";
    KG_ERROR_NOT_A_MODEL => c"this is not a keygraph model";
    KG_ERROR_NEWER_MODEL => c"a newer version wrote the model: update the library, or train again";
    KG_ERROR_OLDER_MODEL => c"an older version wrote the model: train again";
    KG_ERROR_TRUNCATED => c"the model is cut off: copy it again";
    KG_ERROR_TRAILING => c"bytes follow the model: pass as many as kg_model_bytes() says";
    KG_ERROR_CHECKSUM => c"the model is damaged: copy it again";
    KG_ERROR_INCONSISTENT => c"the model contradicts itself: train again";
    KG_ERROR_BUFFER => c"the buffer cannot hold the model: give more bytes";
    KG_ERROR_NO_TEXTURE => c"the picture has too little to hold on to: use one with more texture";
    KG_ERROR_TOO_NARROW => c"the picture is too small or too narrow: use a larger one";
    KG_ERROR_ORIGINAL => c"the size of the original is out of its range";
    KG_ERROR_INTRINSICS => c"intrinsics are finite, and the focal lengths above zero: calibrate the camera";
    KG_ERROR_SIZE => c"the object's size must be above zero: give its width in mm";
    KG_ERROR_NO_POSE => c"no pose has this homography: it shows the plane from behind or edge on";
    KG_ERROR_UNKNOWN => c"an error that this interface does not know";
}

/// Returns a sentence that says what a status means and what to do. It is English, ends with a zero
/// byte, and is never NULL. Any number may be passed.
#[unsafe(no_mangle)]
pub extern "C" fn kg_status_text(status: i32) -> *const c_char {
    text_of(status).as_ptr()
}

impl From<FrameError> for kg_status {
    fn from(e: FrameError) -> Self {
        match e {
            FrameError::WrongLength { .. } => Self::KG_ERROR_FRAME_LENGTH,
            FrameError::OddWidth { .. } => Self::KG_ERROR_ODD_WIDTH,
            FrameError::OddHeight { .. } => Self::KG_ERROR_ODD_HEIGHT,
            FrameError::TooSmall { .. } => Self::KG_ERROR_TOO_SMALL,
            FrameError::TooLarge { .. } => Self::KG_ERROR_TOO_LARGE,
            FrameError::WrongStride { .. } => Self::KG_ERROR_STRIDE,
            FrameError::Outside { .. } => Self::KG_ERROR_WINDOW,
            FrameError::OddPlace { .. } => Self::KG_ERROR_WINDOW_ODD,
            _ => Self::KG_ERROR_UNKNOWN,
        }
    }
}

impl From<ModelError> for kg_status {
    fn from(e: ModelError) -> Self {
        match e {
            ModelError::NotAModel => Self::KG_ERROR_NOT_A_MODEL,
            ModelError::NewerVersion { .. } => Self::KG_ERROR_NEWER_MODEL,
            ModelError::OlderVersion { .. } => Self::KG_ERROR_OLDER_MODEL,
            ModelError::Truncated { .. } => Self::KG_ERROR_TRUNCATED,
            ModelError::TrailingBytes { .. } => Self::KG_ERROR_TRAILING,
            ModelError::Checksum { .. } => Self::KG_ERROR_CHECKSUM,
            ModelError::Inconsistent { .. } => Self::KG_ERROR_INCONSISTENT,
            _ => Self::KG_ERROR_UNKNOWN,
        }
    }
}

impl From<TrainError> for kg_status {
    fn from(e: TrainError) -> Self {
        match e {
            TrainError::Picture(e) => e.into(),
            TrainError::NoRoom { .. } => Self::KG_ERROR_BUFFER,
            TrainError::NothingToHold { .. } => Self::KG_ERROR_NO_TEXTURE,
            TrainError::TooNarrow { .. } => Self::KG_ERROR_TOO_NARROW,
            TrainError::Original { .. } => Self::KG_ERROR_ORIGINAL,
            _ => Self::KG_ERROR_UNKNOWN,
        }
    }
}

impl From<CameraError> for kg_status {
    fn from(e: CameraError) -> Self {
        match e {
            CameraError::Intrinsics => Self::KG_ERROR_INTRINSICS,
            CameraError::Size => Self::KG_ERROR_SIZE,
            CameraError::Homography => Self::KG_ERROR_NO_POSE,
            _ => Self::KG_ERROR_UNKNOWN,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test")]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_status_has_a_text_of_its_own() {
        // SAFETY: the texts end with a zero byte.
        let text = |status| unsafe { CStr::from_ptr(kg_status_text(status)) }.to_str().unwrap();
        let texts: BTreeSet<&str> = ALL.iter().map(|&s| text(s as i32)).collect();
        assert_eq!(texts.len(), ALL.len());
        let unknown = text(77);
        assert_eq!([i32::MIN, 3, i32::MAX].map(text), [unknown; 3]);
        assert!(!texts.contains(unknown));
    }
}
