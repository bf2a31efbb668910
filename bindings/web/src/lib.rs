//! The core and the host as WebAssembly, for `js/engine.js`.
//!
//! In: a message of the page, which is a JSON object (the head) and bytes that belong to it (pixels, models).
//! Out: an answer, a head and bytes as well. Memory: both messages, the model, and a detector in statics;
//! nothing grows from frame to frame. Cost: a copy of the pixels, and that of the core.
//!
//! How to call it: [`reserve`] gives room for a message. The page writes the head and then the bytes there,
//! and calls [`call`] with the length of the head. [`answer`], [`answer_length`] and [`answer_head`] give
//! place and lengths of the answer, until the next call. An error is an answer, too: its head has the keys
//! `error` and `kind`. A panic traps; the module cannot be used after that.
//!
//! A file uses only files above it:
//!
//! - [`failure`]: errors, with a kind that programs can read
//! - [`message`]: heads and bytes
//! - [`pixels`]: bytes as pictures
//! - [`workshop`]: training, assessing, packing
//! - [`lookout`]: frames through a detector or a tracker

mod failure;
mod message;
mod pixels;
mod workshop;
mod lookout;

use std::cell::RefCell;

use failure::Failure;
use lookout::Lookout;
use message::{Answer, Head};

/// What is kept from call to call. A module is one thread.
#[derive(Debug, Default)]
struct Room {
    message: Vec<u8>,
    answer: Answer,
    lookout: Option<Lookout>,
}

thread_local! {
    static ROOM: RefCell<Room> = RefCell::default();
}

#[cfg(target_family = "wasm")]
#[allow(unsafe_code, reason = "foreign functions, each with its reason")]
mod page {
    #[link(wasm_import_module = "keygraph")]
    unsafe extern "C" {
        // Two numbers can do no harm in the page.
        #[link_name = "progress"]
        safe fn page_progress(done: u32, all: u32);
    }

    /// Tells the page, while a picture is assessed, how many frames are done, and of how many.
    pub fn progress(done: u32, all: u32) {
        page_progress(done, all);
    }

    unsafe extern "C" {
        fn __wasm_call_ctors();
    }

    /// Prepares the module. It is called once, before all else, as WASI says of modules that are no programs.
    #[unsafe(no_mangle)]
    pub extern "C" fn _initialize() {
        // SAFETY: the linker makes this function, which initialises the C library. Without a call of it,
        // the linker would call it in each exported function.
        unsafe { __wasm_call_ctors() }
    }
}

#[cfg(not(target_family = "wasm"))]
mod page {
    pub const fn progress(_done: u32, _all: u32) {}
}

/// Makes room for a message of `length` bytes, and gives its place.
#[allow(unsafe_code, reason = "no other function has this name")]
#[unsafe(no_mangle)]
pub extern "C" fn reserve(length: usize) -> *mut u8 {
    ROOM.with_borrow_mut(|room| {
        room.message.clear();
        room.message.shrink_to(2 * length);
        room.message.resize(length, 0);
        room.message.as_mut_ptr()
    })
}

/// Takes the message, whose head has `head` bytes, and makes the answer.
#[allow(unsafe_code, reason = "no other function has this name")]
#[unsafe(no_mangle)]
pub extern "C" fn call(head: usize) {
    ROOM.with_borrow_mut(|room| {
        let (head, bytes) = room.message.split_at(head.min(room.message.len()));
        room.answer = serde_json::from_slice(head)
            .map_err(Failure::from)
            .and_then(|head| answer_to(head, bytes, &mut room.lookout))
            .unwrap_or_else(|failure| failure.answer());
    });
}

fn answer_to(head: Head, bytes: &[u8], lookout: &mut Option<Lookout>) -> Result<Answer, Failure> {
    match head {
        Head::Train(train) => workshop::train(&train, bytes),
        Head::Assess(assess) => workshop::assess(&assess, bytes, page::progress),
        Head::Read(_) => workshop::read(bytes),
        Head::Pack(pack) => workshop::pack(&pack, bytes),
        Head::Open(open) => {
            *lookout = Some(Lookout::open(&open, bytes)?);
            Ok(Answer::default())
        }
        Head::Look(look) => lookout.as_mut().ok_or_else(|| Failure::state("open a detector first"))?.look(&look, bytes),
        Head::Restart(_) => {
            lookout.as_mut().ok_or_else(|| Failure::state("open a tracker first"))?.restart();
            Ok(Answer::default())
        }
    }
}

/// The place of the answer.
#[allow(unsafe_code, reason = "no other function has this name")]
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    ROOM.with_borrow(|room| room.answer.bytes().as_ptr())
}

/// The length of the answer, bytes.
#[allow(unsafe_code, reason = "no other function has this name")]
#[unsafe(no_mangle)]
pub extern "C" fn answer_length() -> usize {
    ROOM.with_borrow(|room| room.answer.bytes().len())
}

/// The length of the answer's head, bytes.
#[allow(unsafe_code, reason = "no other function has this name")]
#[unsafe(no_mangle)]
pub extern "C" fn answer_head() -> usize {
    ROOM.with_borrow(|room| room.answer.head())
}
