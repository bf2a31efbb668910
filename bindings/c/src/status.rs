//! What every function of the interface returns.
//!
//! In: the errors of the core. Out: a number and a sentence that says what to do. Memory: the
//! sentences, in flash. Cost: none.

use core::ffi::{CStr, c_char};

use keygraph_core::{CameraError, FrameError, ModelError, TrainError};

/// Makes the enum and the sentences from one table.
macro_rules! statuses {
    ($($(#[$doc:meta])* $name:ident = $number:literal, $text:literal;)+) => {
        /// Result of a call. Zero and above: the call did its work. Below zero: it did nothing, and
        /// outputs keep what they held, unless the function says otherwise.
        #[repr(i32)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum kg_status {
            $($(#[$doc])* $name = $number,)+
        }

        /// Returns a sentence that says what a status means and what to do. It is English, ends with a
        /// zero byte, and is never NULL. Any number may be passed.
        #[unsafe(no_mangle)]
        pub extern "C" fn kg_status_text(status: i32) -> *const c_char {
            let text: &CStr = match status {
                $($number => $text,)+
                _ => c"this is no status of this version of the library",
            };
            text.as_ptr()
        }

        #[cfg(test)]
        const ALL: &[kg_status] = &[$(kg_status::$name),+];
    };
}

statuses! {
    /// All is well.
    KG_OK = 0, c"ok";
    /// The observer, or its budget, has stopped the search. What was found until then are the results.
    KG_STOPPED = 1, c"the search was stopped: the results are those of what was searched";
    /// The search in pieces goes on: call kg_detector_step() again.
    KG_MORE = 2, c"the search goes on";
    /// A pointer is NULL that must not be.
    KG_ERROR_NULL = -1, c"a pointer is NULL";
    /// A pointer is not aligned: to KG_ALIGNMENT for the memory of an object, else to its type.
    KG_ERROR_ALIGNMENT = -2, c"a pointer is not aligned: memory for objects needs KG_ALIGNMENT bytes";
    /// The memory is shorter than the header says: give KG_..._BYTES.
    KG_ERROR_MEMORY = -3, c"the memory is too short: give as many bytes as the header says";
    /// A length leads around the end of the address space.
    KG_ERROR_LENGTH = -4, c"a length is larger than any memory";
    /// The memory holds no object of this kind: call its init or open function first.
    KG_ERROR_HANDLE = -5, c"this memory holds no such object: initialise it first";
    /// The object is at work: it was called from a callback, from an interrupt or a second thread; or
    /// a search in pieces is not at its end: finish it, or call kg_detector_cancel().
    KG_ERROR_BUSY = -6, c"the object is at work: end the search first, and do not call from callbacks";
    /// There is no such profile.
    KG_ERROR_PROFILE = -7, c"there is no such profile";
    /// There is no such pixel format.
    KG_ERROR_FORMAT = -8, c"there is no such pixel format";
    /// An option is out of its range.
    KG_ERROR_OPTION = -9, c"an option is out of its range";
    /// There is no element with this index.
    KG_ERROR_INDEX = -10, c"there is no element with this index";
    /// A name is not UTF-8, is empty, or has more than KG_NAME_BYTES - 1 bytes.
    KG_ERROR_NAME = -11, c"a name is empty, too long, or not UTF-8";
    /// There is no such preset.
    KG_ERROR_PRESET = -12, c"there is no such preset";
    /// No search has begun: call kg_detector_begin() first.
    KG_ERROR_NO_SEARCH = -13, c"no search has begun";
    /// The buffer does not hold exactly one frame, or with a stride at least one: kg_frame_bytes() says
    /// how many bytes that is.
    KG_ERROR_FRAME_LENGTH = -20, c"the buffer does not have the bytes of a frame of this size and format";
    /// The width is odd, and the format shares chroma between columns.
    KG_ERROR_ODD_WIDTH = -21, c"the width is odd: this format needs an even width";
    /// The height is odd, and the format shares chroma between rows.
    KG_ERROR_ODD_HEIGHT = -22, c"the height is odd: this format needs an even height";
    /// A side of the frame or of the window has less than 16 px.
    KG_ERROR_TOO_SMALL = -23, c"a side of the frame or the window has less than 16 px";
    /// The frame, or its window, does not fit the profile: scale it down, or use a larger profile.
    KG_ERROR_TOO_LARGE = -24, c"the frame does not fit the profile: scale it down, or use a larger profile";
    /// The stride is shorter than a row, or odd in I420.
    KG_ERROR_STRIDE = -25, c"the stride is shorter than a row, or odd in I420";
    /// The window leaves the frame.
    KG_ERROR_WINDOW = -26, c"the window leaves the frame";
    /// The window begins between pixels that share chroma: begin at an even x, in NV12 and I420 at an
    /// even y too.
    KG_ERROR_WINDOW_ODD = -27, c"the window begins between pixels that share chroma: begin at an even x and y";
    /// The bytes do not begin as a model does.
    KG_ERROR_NOT_A_MODEL = -40, c"this is not a keygraph model";
    /// A newer version wrote the model: update the library, or train again.
    KG_ERROR_NEWER_MODEL = -41, c"a newer version wrote the model: update the library, or train again";
    /// An older version wrote the model: train again.
    KG_ERROR_OLDER_MODEL = -42, c"an older version wrote the model: train again";
    /// The bytes end before the model does.
    KG_ERROR_TRUNCATED = -43, c"the model is cut off: copy it again";
    /// Bytes follow the model: kg_model_bytes() says how many it has.
    KG_ERROR_TRAILING = -44, c"bytes follow the model: pass as many as kg_model_bytes() says";
    /// The checksum does not match: the model is damaged.
    KG_ERROR_CHECKSUM = -45, c"the model is damaged: copy it again";
    /// The checksum matches, and the content contradicts itself: train again.
    KG_ERROR_INCONSISTENT = -46, c"the model contradicts itself: train again";
    /// The buffer for the model cannot hold even an empty one.
    KG_ERROR_BUFFER = -60, c"the buffer cannot hold the model: give more bytes";
    /// The picture has too few corners: use one with more texture, sharper or brighter.
    KG_ERROR_NO_TEXTURE = -61, c"the picture has too little to hold on to: use one with more texture";
    /// A side of the picture is too short: use a larger picture.
    KG_ERROR_TOO_NARROW = -62, c"the picture is too small or too narrow: use a larger one";
    /// A side of the original picture is not from 1 to 1,048,576 px.
    KG_ERROR_ORIGINAL = -63, c"the size of the original is out of its range";
    /// Intrinsics are four finite numbers, the focal lengths above zero.
    KG_ERROR_INTRINSICS = -80, c"intrinsics are finite, and the focal lengths above zero: calibrate the camera";
    /// A size is not above zero, or not finite.
    KG_ERROR_SIZE = -81, c"the object's size must be above zero: give its width in mm";
    /// No pose has this homography: it shows the plane from behind or edge on.
    KG_ERROR_NO_POSE = -82, c"no pose has this homography: it shows the plane from behind or edge on";
    /// The core reports an error that this interface does not know.
    KG_ERROR_UNKNOWN = -99, c"an error that this interface does not know";
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
