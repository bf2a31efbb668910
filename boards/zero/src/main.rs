//! Idle detectors, trainers and a tracker as statics. The linker puts a static into `.bss` only if all of its bytes
//! are zero or nobody's: `scripts/boards` looks whether all of them are there.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use keygraph_core::{
    HdDetector, QqvgaDetector, QqvgaTrainer, QvgaDetector, Surfaces, Tracker, VgaDetector, VgaTrainer,
};
use static_cell::ConstStaticCell;

/// A value of each type that a board places.
type All = (HdDetector, VgaDetector, QvgaDetector, QqvgaDetector, VgaTrainer, QqvgaTrainer, Tracker, Surfaces);

#[used]
static ALL: ConstStaticCell<All> = ConstStaticCell::new((
    HdDetector::new(),
    VgaDetector::new(),
    QvgaDetector::new(),
    QqvgaDetector::new(),
    VgaTrainer::new(),
    QqvgaTrainer::new(),
    Tracker::new(),
    Surfaces::new(),
));

/// Where the program would begin.
// SAFETY: no other function has this name.
#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    panic!()
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}
