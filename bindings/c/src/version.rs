//! Versions of the interface and of the library. Memory: none. Cost: none.

use core::ffi::{CStr, c_char};

/// Version of the interface that the header describes. It changes when a program that was compiled
/// with another header cannot use the library.
pub const KG_ABI_VERSION: u32 = 1;

const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(text) => text,
    Err(_) => c"",
};

/// Returns the version of the interface that the library was built with. A program that loads the
/// library at run time compares it with KG_ABI_VERSION first.
#[unsafe(no_mangle)]
pub extern "C" fn kg_abi_version() -> u32 {
    KG_ABI_VERSION
}

/// Returns the version of the library as a text, three numbers with dots between them. It ends
/// with a zero byte and is never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn kg_version_text() -> *const c_char {
    VERSION.as_ptr()
}
