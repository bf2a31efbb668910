//! What the firmwares for real boards share.
//!
//! - [`sensor`]: cameras, and how they start
//! - [`search`]: a search that gives others their turn, and its report
//!
//! In: the model and the camera's registers, by the environment (see `build.rs`). Memory: the model, in
//! flash. A firmware depends on this crate also for what happens at a panic: nothing more.
#![no_std]

pub mod search;
pub mod sensor;

/// The bytes of the model. They stay in flash, and are read in place.
pub static MODEL: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/model.kgm"));

/// Stops, where a debugger sees it. A watchdog of the application would start the board again.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}
