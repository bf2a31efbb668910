//! What happens if the library panics: a defect of it, or memory that somebody else has written.
//!
//! In: a function that the program sets. Out: a call of it, and then the end of the program by an
//! instruction that no processor executes. Nothing unwinds into C. Memory: a pointer. Cost: none.

use core::ffi::c_char;
#[cfg(feature = "panic-handler")]
use core::sync::atomic::{AtomicPtr, Ordering};

/// Function that is told of a panic: the source file, the number of bytes of its name, which no zero
/// byte ends, and the line. It may log, and reset the device; if it returns, the program ends.
pub type kg_panic_handler = Option<unsafe extern "C" fn(file: *const c_char, file_bytes: usize, line: u32)>;

#[cfg(feature = "panic-handler")]
static HANDLER: AtomicPtr<()> = AtomicPtr::new(core::ptr::null_mut());

/// Sets the function that is told of a panic, or none with NULL.
///
/// The library panics only if it has a defect, or if its memory has been overwritten. It then ends
/// the program: by an undefined instruction, which a debugger and the fault handler of a board see.
/// Nothing is unwound, and no call returns.
#[unsafe(no_mangle)]
pub extern "C" fn kg_set_panic_handler(handler: kg_panic_handler) {
    #[cfg(feature = "panic-handler")]
    HANDLER.store(handler.map_or(core::ptr::null_mut(), |f| f as *mut ()), Ordering::Release);
    // In a program of Rust, that program has the panic handler.
    #[cfg(not(feature = "panic-handler"))]
    let _ = handler;
}

#[cfg(feature = "panic-handler")]
#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    // A panic in the handler does not call it again.
    let handler = HANDLER.load(Ordering::Acquire);
    HANDLER.store(core::ptr::null_mut(), Ordering::Release);
    // SAFETY: null is `None`, and anything else was stored as a function of this type.
    let handler = unsafe { core::mem::transmute::<*mut (), kg_panic_handler>(handler) };
    if let (Some(handler), Some(place)) = (handler, info.location()) {
        // SAFETY: the program has given the function for this call.
        unsafe { handler(place.file().as_ptr().cast(), place.file().len(), place.line()) };
    }
    end()
}

/// Executes an instruction that no processor has.
#[cfg(feature = "panic-handler")]
fn end() -> ! {
    #[cfg(target_arch = "arm")]
    // SAFETY: the processor faults here and does not go on.
    unsafe {
        core::arch::asm!("udf #0", options(noreturn, nomem, nostack))
    }
    #[cfg(target_arch = "aarch64")]
    // SAFETY: the processor faults here and does not go on.
    unsafe {
        core::arch::asm!("udf #0", options(noreturn, nomem, nostack))
    }
    #[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
    // SAFETY: the processor faults here and does not go on.
    unsafe {
        core::arch::asm!("unimp", options(noreturn, nomem, nostack))
    }
    #[cfg(target_arch = "x86_64")]
    // SAFETY: the processor faults here and does not go on.
    unsafe {
        core::arch::asm!("ud2", options(noreturn, nomem, nostack))
    }
    #[cfg(not(any(
        target_arch = "arm",
        target_arch = "aarch64",
        target_arch = "riscv32",
        target_arch = "riscv64",
        target_arch = "x86_64"
    )))]
    loop {}
}
