//! Keygraph on the Raspberry Pi Pico 2: an HM01B0 over PIO and DMA into one buffer, results over the
//! serial port.
//!
//! In: frames of 320x240 px, gray. Out: a line per detection. Memory: detector, frame and stack in the
//! 512 KB of RAM. Cost: the search; the next frame arrives meanwhile.
#![no_std]
#![no_main]

use core::fmt::{self, Write};

use cortex_m::peripheral::DWT;
use embassy_executor::Spawner;
use embassy_rp::i2c::{self, I2c};
use embassy_rp::pio::program::pio_asm;
use embassy_rp::pio::{self, Pio, ShiftConfig, ShiftDirection, StateMachine};
use embassy_rp::pwm::{self, Pwm};
use embassy_rp::uart::{self, UartTx};
use embassy_rp::{bind_interrupts, dma, peripherals};
use keygraph_boards::MODEL;
use keygraph_boards::search::{Camera, complain, serve};
use keygraph_boards::sensor::{HEIGHT, Hm01b0, Sensor, WIDTH};
use keygraph_core::{Model, QvgaDetector};
use static_cell::ConstStaticCell;

bind_interrupts!(struct Interrupts {
    PIO0_IRQ_0 => pio::InterruptHandler<peripherals::PIO0>;
    DMA_IRQ_0 => dma::InterruptHandler<peripherals::DMA_CH0>;
});

/// Words of a raw frame.
const WORDS: usize = WIDTH * HEIGHT / 4;

// All bytes of both are zero: they lie in .bss, and never on the stack.
static DETECTOR: ConstStaticCell<QvgaDetector> = ConstStaticCell::new(QvgaDetector::new());
static BUFFER: ConstStaticCell<[u32; WORDS]> = ConstStaticCell::new([0; WORDS]);

/// A serial port that takes text.
struct Port(UartTx<'static, uart::Blocking>);

impl Write for Port {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.blocking_write(text.as_bytes()).map_err(|_| fmt::Error)
    }
}

/// The camera's pins: a state machine of the PIO waits for a frame, and takes eight bits at each rising edge of the
/// pixel clock while a row is valid.
struct Pins {
    machine: StateMachine<'static, peripherals::PIO0, 0>,
    dma: dma::Channel<'static>,
    /// The first instruction of the program.
    start: u8,
}

impl Camera for Pins {
    async fn capture(&mut self, buffer: &mut [u32]) -> bool {
        // What came after the last frame is dropped, and the program waits for the start of one again.
        self.machine.set_enable(false);
        self.machine.clear_fifos();
        self.machine.restart();
        // SAFETY: the address is that of the program's first instruction.
        unsafe { self.machine.exec_jmp(self.start) };
        self.machine.set_enable(true);
        self.machine.rx().dma_pull(&mut self.dma, buffer, false).await;
        true
    }

    fn refresh(&mut self, _: &mut [u32]) {
        // There is no cache before the RAM.
    }
}

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let p = embassy_rp::init(embassy_rp::config::Config::default());
    let mut core = cortex_m::Peripherals::take().expect("nobody has taken them");
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    let mut clock = || u64::from(DWT::cycle_count());

    let mut port = Port(UartTx::new_blocking(p.UART0, p.PIN_12, uart::Config::default()));
    // The clock of the camera: 150 MHz divided by 6 is 25 MHz, and the camera takes up to 36 MHz.
    let mut settings = pwm::Config::default();
    (settings.top, settings.compare_b) = (5, 3);
    let _camera_clock = Pwm::new_output_b(p.PWM_SLICE5, p.PIN_11, settings);

    let mut settings = i2c::Config::default();
    settings.frequency = 100_000;
    let mut bus = I2c::new_blocking(p.I2C0, p.PIN_21, p.PIN_20, settings);
    let Ok(model) = Model::parse(MODEL) else { return complain(&mut port, &"the model is damaged: build it in again") };
    if let Err(error) = Hm01b0::start(&mut bus) {
        return complain(&mut port, &error);
    }

    // Pins from D0 on: data 0 to 7, then the pixel clock, the row is valid, the frame is valid.
    let program = pio_asm!(
        "wait 0 pin 10",
        "wait 1 pin 10",
        ".wrap_target",
        "wait 1 pin 9",
        "wait 1 pin 8",
        "in pins, 8",
        "wait 0 pin 8",
        ".wrap",
    );
    let Pio { mut common, sm0: mut machine, .. } = Pio::new(p.PIO0, Interrupts);
    let pins = [
        common.make_pio_pin(p.PIN_0),
        common.make_pio_pin(p.PIN_1),
        common.make_pio_pin(p.PIN_2),
        common.make_pio_pin(p.PIN_3),
        common.make_pio_pin(p.PIN_4),
        common.make_pio_pin(p.PIN_5),
        common.make_pio_pin(p.PIN_6),
        common.make_pio_pin(p.PIN_7),
        common.make_pio_pin(p.PIN_8),
        common.make_pio_pin(p.PIN_9),
        common.make_pio_pin(p.PIN_10),
    ];
    let pins = pins.each_ref();
    let loaded = common.load_program(&program.program);
    let mut settings = pio::Config::default();
    settings.use_program(&loaded, &[]);
    settings.set_in_pins(&pins);
    // The first of four bytes becomes the lowest one.
    settings.shift_in = ShiftConfig { threshold: 32, direction: ShiftDirection::Right, auto_fill: true };
    settings.fifo_join = pio::FifoJoin::RxOnly;
    machine.set_config(&settings);
    machine.set_pin_dirs(pio::Direction::In, &pins);
    let mut camera = Pins { machine, dma: dma::Channel::new(p.DMA_CH0, Interrupts), start: loaded.origin };

    let (detector, buffer) = (DETECTOR.take(), BUFFER.take());
    serve::<Hm01b0>(&mut camera, buffer, (detector, &model), &mut port, &mut clock).await;
}
