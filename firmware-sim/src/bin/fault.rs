//! Firmware that faults. The tests check that the log names the place.
//!
//! In: nothing. Out: a line of the log, and an exit status that is not zero. Memory: none.
//! Cost: none.
#![no_std]
#![no_main]

use keygraph_firmware_sim::board::undefined_instruction;

#[cortex_m_rt::entry]
fn main() -> ! {
    // No processor has this instruction.
    undefined_instruction()
}
