//! What the firmwares for real boards share.
//!
//! - [`sensor`]: cameras, and how they start
//! - `stm32h7` (a feature): what firmwares for the STM32H7 share
//! - [`search`]: the loop that serves a camera
//!
//! In: the model and the camera's registers, by the environment (see `build.rs`). Memory: the model, in
//! flash. A firmware depends on this crate also for what happens at a panic: nothing more.
#![no_std]

pub mod search;
pub mod sensor;
#[cfg(feature = "stm32h7")]
pub mod stm32h7;

/// The bytes of the model. They stay in flash, and are read in place.
pub static MODEL: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/model.kgm"));

/// Stops, where a debugger sees it. A watchdog of the application would start the board again.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    cortex_m::asm::udf()
}
