//! The emulated board: its clock, flash, memory and files.
//!
//! In: nothing. Out: safe functions for the firmware programs. Memory: the raw frame. Cost: a clock
//! reading is one load; a file access stops the emulator.
//!
//! This is the only file with `unsafe`. It accesses registers, symbols of the linker, and memory
//! that is handed out once.
//!
//! A panic or a fault reports its place on the log and ends the emulator with status 101.

use core::arch::asm;
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut, read_volatile, write_volatile};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cortex_m_rt::{ExceptionFrame, exception};
use defmt_semihosting as _;
use semihosting::fs::File;
use semihosting::io::{Read, Write};

use crate::learn::Learner;
use crate::profile::{Detector, FRAME_BYTES};
use crate::wire::{FRAMES, FrameHeader, Job, RESULTS};

/// Exit status after a panic or a fault.
const FAILED: i32 = 101;

/// A timer that counts down: the registers of its control, of its value and of its start, what starts it, its
/// greatest value, and its ticks a microsecond.
struct Timer {
    control: *mut u32,
    value: *mut u32,
    reload: *mut u32,
    start: u32,
    most: u32,
    mhz: u64,
}

/// CMSDK timer 0 of the boards of ARMv7-M.
#[cfg(not(feature = "m55"))]
const TIMER: Timer = Timer {
    control: 0x4000_0000 as *mut u32,
    value: 0x4000_0004 as *mut u32,
    reload: 0x4000_0008 as *mut u32,
    start: 1,
    most: u32::MAX,
    mhz: 25,
};

/// The processor's own timer, on the board of the Cortex-M55.
#[cfg(feature = "m55")]
const TIMER: Timer = Timer {
    control: 0xe000_e010 as *mut u32,
    value: 0xe000_e018 as *mut u32,
    reload: 0xe000_e014 as *mut u32,
    start: 0b101,
    most: 0xff_ffff,
    mhz: 32,
};

/// Registers of CMSDK serial port 0: data, state, control, interrupts, divisor.
const UART: *mut u32 = if cfg!(feature = "m55") { 0x5930_3000 } else { 0x4000_4000 } as *mut u32;

/// Starts the clock.
pub fn start_clock() {
    // SAFETY: these are the timer's registers, and nothing else accesses them.
    unsafe {
        write_volatile(TIMER.reload, TIMER.most);
        write_volatile(TIMER.value, TIMER.most);
        write_volatile(TIMER.control, TIMER.start);
    }
}

/// Returns the ticks since the start of the clock, 25 million per second. It must be called at
/// least once in 171 s (Cortex-M55: 0.5 s): after that time the hardware timer starts again from zero.
#[must_use]
pub fn ticks() -> u64 {
    static LAST: AtomicU32 = AtomicU32::new(0);
    static ROUNDS: AtomicU32 = AtomicU32::new(0);
    // SAFETY: reading the value of the timer has no effect.
    let now = TIMER.most - unsafe { read_volatile(TIMER.value) };
    if now < LAST.swap(now, Ordering::Relaxed) {
        ROUNDS.fetch_add(1, Ordering::Relaxed);
    }
    let all = u64::from(ROUNDS.load(Ordering::Relaxed)) * (u64::from(TIMER.most) + 1) + u64::from(now);
    // Without a division where there is nothing to convert.
    if TIMER.mhz == 25 { all } else { 25 * all / TIMER.mhz }
}

unsafe extern "C" {
    static mut _stack_start: u32;
    static mut _stack_end: u32;
    static mut _model_start: u8;
    static mut _model_end: u8;
}

/// Returns the maximum stack use so far, bytes. A painted word that still has its paint was never used.
#[must_use]
pub fn stack_bytes() -> u32 {
    let (top, mut word) = (addr_of!(_stack_start), addr_of!(_stack_end));
    // SAFETY: these are whole words between the two ends of the stack, painted before main.
    // Nothing below the stack pointer is alive.
    while word < top && unsafe { read_volatile(word) } == cortex_m_rt::STACK_PAINT_VALUE {
        word = word.wrapping_add(1);
    }
    (top as usize - word as usize) as u32
}

/// The linked-in model, at the start of the region of flash for models.
#[cfg(feature = "sample")]
#[used]
#[unsafe(link_section = ".model")]
static SAMPLE: [u8; include_bytes!(concat!(env!("OUT_DIR"), "/model.kgm")).len()] =
    *include_bytes!(concat!(env!("OUT_DIR"), "/model.kgm"));

/// Returns the region of flash for models.
fn model_region() -> &'static [u8] {
    let (start, end) = (addr_of!(_model_start), addr_of!(_model_end));
    // SAFETY: the emulator fills this memory before the start. Only `program` writes it, at a
    // time when nobody has a slice of it.
    unsafe { core::slice::from_raw_parts(start, end as usize - start as usize) }
}

/// Returns the model in flash. Its header gives the length. The slice is empty if that length
/// exceeds the region.
#[must_use]
pub fn model() -> &'static [u8] {
    let region = model_region();
    let size = u32::from_le_bytes([region[8], region[9], region[10], region[11]]) as usize;
    region.get(..size).unwrap_or(&[])
}

/// Writes a model to flash, as a flash driver would, and returns it.
///
/// # Panics
/// Panics if the model does not fit, or if this is the second call: slices of the first model may
/// still be alive.
pub fn program(bytes: &[u8]) -> &'static [u8] {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    assert!(!TAKEN.swap(true, Ordering::Relaxed), "the flash is written once");
    assert!(bytes.len() <= model_region().len(), "the model does not fit the flash");
    // SAFETY: the model fits. The assertion above ensures that nobody reads the region yet: the
    // learning firmware does not call `model`.
    unsafe { addr_of_mut!(_model_start).copy_from_nonoverlapping(bytes.as_ptr(), bytes.len()) };
    &model_region()[..bytes.len()]
}

/// Returns the buffer of the raw frame.
///
/// # Panics
/// Panics at the second call.
pub fn frame_buffer() -> &'static mut [u8; FRAME_BYTES] {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    #[unsafe(link_section = ".frame")]
    static mut FRAME: MaybeUninit<[u8; FRAME_BYTES]> = MaybeUninit::uninit();
    assert!(!TAKEN.swap(true, Ordering::Relaxed), "there is one frame buffer");
    // SAFETY: the buffer is handed out once, and all of it is written before.
    unsafe {
        addr_of_mut!(FRAME).write_bytes(0, 1);
        (*addr_of_mut!(FRAME)).assume_init_mut()
    }
}

/// A type for which all bytes zero are a new value.
///
/// # Safety
/// All bytes zero must be a valid value, and dropping that value must do nothing.
pub unsafe trait Zeroed {}

// SAFETY: the detector consists of arrays of numbers, empty vectors of numbers, counters, and an
// absent reference. Nothing in it needs to be dropped.
unsafe impl Zeroed for Detector {}
// SAFETY: the learner consists of such data and of bytes.
unsafe impl Zeroed for Learner {}

/// Memory for values that are needed one after the other.
#[repr(C, align(8))]
pub struct Arena<const BYTES: usize>(MaybeUninit<[u8; BYTES]>);

impl<const BYTES: usize> Arena<BYTES> {
    /// Creates memory in which all bytes are zero.
    #[must_use]
    pub const fn new() -> Self {
        Self(MaybeUninit::zeroed())
    }

    /// Creates a new `T` in this memory.
    pub fn make<T: Zeroed>(&mut self) -> &mut T {
        const { assert!(size_of::<T>() <= BYTES && align_of::<T>() <= 8, "the arena is too small") };
        self.0 = MaybeUninit::zeroed();
        // SAFETY: the memory is large enough, aligned, all zero, and borrowed for as long as `self`.
        unsafe { &mut *self.0.as_mut_ptr().cast::<T>() }
    }
}

/// The connection to the laptop. It delivers frames as a sensor would, and takes results.
pub struct Link {
    frames: File,
    results: File,
}

impl Link {
    /// Opens both files, and reads the job.
    ///
    /// # Panics
    /// Panics if a file cannot be opened, or if there is no job.
    #[must_use]
    pub fn open() -> (Self, Job) {
        let frames = File::open(FRAMES).ok().expect("the file of frames is there");
        let results = File::create(RESULTS).ok().expect("the file of results can be made");
        let mut link = Self { frames, results };
        let job = link.words().expect("the file of frames starts with a job");
        (link, Job::decode(job))
    }

    fn words<const N: usize>(&mut self) -> Option<[u32; N]> {
        let mut words = [0; N];
        for word in &mut words {
            let mut bytes = [0; 4];
            self.frames.read_exact(&mut bytes).ok()?;
            *word = u32::from_le_bytes(bytes);
        }
        Some(words)
    }

    /// Reads the next frame into the start of `buffer`. Returns `None` after the last frame.
    ///
    /// # Panics
    /// Panics if the frame is larger than the buffer or incomplete.
    pub fn next_frame(&mut self, buffer: &mut [u8]) -> Option<FrameHeader> {
        let header = FrameHeader::decode(self.words()?).expect("the format exists");
        let bytes = buffer.get_mut(..header.bytes()).expect("the frame fits its buffer");
        self.frames.read_exact(bytes).ok().expect("the frame is whole");
        Some(header)
    }

    /// Writes one word.
    ///
    /// # Panics
    /// Panics if the disk is full.
    pub fn put(&mut self, word: u32) {
        self.results.write_all(&word.to_le_bytes()).ok().expect("results can be written");
    }
}

/// The first serial port, for text.
pub struct Port(());

impl Port {
    /// Switches the port on.
    #[must_use]
    pub fn open() -> Self {
        // SAFETY: these are the port's registers (divisor, control), and nothing else accesses them.
        unsafe {
            write_volatile(UART.add(4), 16);
            write_volatile(UART.add(2), 1);
        }
        Self(())
    }
}

impl core::fmt::Write for Port {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        for byte in text.bytes() {
            // SAFETY: these are the port's registers. Bit 0 of the second register means busy.
            unsafe {
                while read_volatile(UART.add(1)) & 1 != 0 {}
                write_volatile(UART, u32::from(byte));
            }
        }
        Ok(())
    }
}

/// Switches interrupts off.
#[inline]
fn disable_interrupts() {
    // SAFETY: this only sets PRIMASK. Without `nomem`, no access to memory is moved across it.
    unsafe { asm!("cpsid i", options(nostack, preserves_flags)) };
}

/// Critical sections of a processor with one core, for the log: interrupts are off meanwhile.
struct OneCore;
critical_section::set_impl!(OneCore);

// SAFETY: only interrupts can run code between acquire and release, and they are off. Release
// restores the state that acquire returned, so sections can be nested.
unsafe impl critical_section::Impl for OneCore {
    unsafe fn acquire() -> u32 {
        let primask: u32;
        // SAFETY: this reads PRIMASK, without an effect.
        unsafe { asm!("mrs {}, PRIMASK", out(reg) primask, options(nomem, nostack, preserves_flags)) };
        disable_interrupts();
        primask
    }

    unsafe fn release(primask: u32) {
        // SAFETY: this is the state before the critical section. Without `nomem`, no access to
        // memory is moved across it.
        unsafe { asm!("msr PRIMASK, {}", in(reg) primask, options(nostack, preserves_flags)) };
    }
}

/// Executes an instruction that no processor has.
#[inline(always)]
pub fn undefined_instruction() -> ! {
    // SAFETY: the processor faults here and does not go on.
    unsafe { asm!("udf #0", options(noreturn, nomem, nostack)) }
}

/// Number of interrupts of the emulated boards.
const INTERRUPTS: usize = 32;

unsafe extern "C" {
    fn DefaultHandler();
}

/// Handlers of the board's interrupts: none is used, and each one that comes is an error.
// SAFETY: the table has the place and the form that the processor reads; no other static has this
// name, because the crate that would make one leaves it to us (feature `device`).
#[unsafe(no_mangle)]
#[unsafe(link_section = ".vector_table.interrupts")]
static __INTERRUPTS: [unsafe extern "C" fn(); INTERRUPTS] = [DefaultHandler; INTERRUPTS];

/// Ends the emulator with status 0.
pub fn finish() -> ! {
    semihosting::process::exit(0)
}

/// Reports an error, and ends the emulator with a status that is not 0.
pub fn fail(what: &str, error: impl defmt::Format) -> ! {
    defmt::error!("{=str}: {}", what, error);
    semihosting::process::exit(FAILED)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    disable_interrupts();
    // Formatting the message here would take three kilobytes of flash.
    let said = info.message().as_str().unwrap_or("");
    if let Some(place) = info.location() {
        defmt::error!("panicked at {=str}:{=u32}:{=u32}:\n{=str}", place.file(), place.line(), place.column(), said);
    }
    semihosting::process::exit(FAILED)
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("fault at {=u32:#010x}, called from {=u32:#010x}", frame.pc(), frame.lr());
    semihosting::process::exit(FAILED)
}
