//! Firmware that panics, for the tests: the place must be told.
//!
//! In: none. Out: a line of the log, and a status that is not zero. Memory: none.
//! Cost: none.
#![no_std]
#![no_main]

use keygraph_firmware_sim as _;

#[cortex_m_rt::entry]
fn main() -> ! {
    panic!("on purpose")
}
