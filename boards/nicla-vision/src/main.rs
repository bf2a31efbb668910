//! Keygraph on the Arduino Nicla Vision: its GC2145 over DCMI and DMA into one buffer, results over the
//! serial port.
//!
//! In: frames of 320x240 px, YUYV. Out: a line per detection. Memory: the detector and the frame in AXI
//! SRAM, the stack in DTCM. Cost: the search; the next frame arrives meanwhile.
#![no_std]
#![no_main]

use core::mem::MaybeUninit;

use cortex_m::peripheral::DWT;
use embassy_executor::Spawner;
use embassy_stm32::dcmi::{self, Dcmi, HSyncDataInvalidLevel, VSyncDataInvalidLevel};
use embassy_stm32::gpio::OutputType;
use embassy_stm32::i2c::{self, I2c};
use embassy_stm32::rcc::{Pll, PllDiv, PllMul, PllPreDiv, PllSource, SupplyConfig};
use embassy_stm32::time::{Hertz, khz, mhz};
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
use embassy_stm32::usart::{self, UartTx};
use embassy_stm32::{SharedData, bind_interrupts, dma, peripherals};
use keygraph_boards::MODEL;
use keygraph_boards::search::{complain, serve};
use keygraph_boards::sensor::{Gc2145, HEIGHT, Sensor, WIDTH};
use keygraph_boards::stm32h7::{Buffer, Cached, Port, clocks};
use keygraph_core::{Model, QvgaDetector};
use static_cell::ConstStaticCell;

/// Clock of the camera.
const CAMERA_CLOCK: Hertz = mhz(12);

bind_interrupts!(struct Interrupts {
    DCMI => dcmi::InterruptHandler<peripherals::DCMI>;
    DMA2_STREAM1 => dma::InterruptHandler<peripherals::DMA2_CH1>;
});

/// 400 MHz of 64 MHz.
const PLL: Pll = Pll {
    source: PllSource::HSI,
    prediv: PllPreDiv::DIV4,
    mul: PllMul::MUL50,
    divp: Some(PllDiv::DIV2),
    divq: Some(PllDiv::DIV8),
    divr: None,
};

// All bytes of both are zero: they lie in .bss, and never on the stack.
static DETECTOR: ConstStaticCell<QvgaDetector> = ConstStaticCell::new(QvgaDetector::new());
static BUFFER: ConstStaticCell<Buffer> = ConstStaticCell::new(Buffer([0; WIDTH * HEIGHT / 2]));

/// What the HAL tells the other core.
#[unsafe(link_section = ".shared")]
static SHARED: MaybeUninit<SharedData> = MaybeUninit::uninit();

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let p = {
        let mut config = clocks(PLL);
        config.rcc.supply_config = SupplyConfig::LDO;
        embassy_stm32::init_primary(config, &SHARED)
    };
    let mut core = cortex_m::Peripherals::take().expect("nobody has taken them");
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    let mut clock = || u64::from(DWT::cycle_count());

    let mut port = Port(UartTx::new_blocking(p.USART1, p.PA9, usart::Config::default()).expect("the rate is usual"));
    let pin = PwmPin::new(p.PA7, OutputType::PushPull);
    let mut pwm = SimplePwm::new(p.TIM3, None, Some(pin), None, None, CAMERA_CLOCK, CountingMode::EdgeAlignedUp);
    let mut camera_clock = pwm.ch2();
    camera_clock.set_duty_cycle_fraction(1, 2);
    camera_clock.enable();

    let mut settings = i2c::Config::default();
    settings.frequency = khz(100);
    let mut bus = I2c::new_blocking(p.I2C3, p.PA8, p.PC9, settings);
    let Ok(model) = Model::parse(MODEL) else { return complain(&mut port, &"the model is damaged: build it in again") };
    if let Err(error) = Gc2145::start(&mut bus) {
        return complain(&mut port, &error);
    }
    let mut settings = dcmi::Config::default();
    settings.vsync_level = VSyncDataInvalidLevel::Low;
    settings.hsync_level = HSyncDataInvalidLevel::Low;
    let camera = Dcmi::new_8bit(
        p.DCMI, p.DMA2_CH1, Interrupts, p.PC6, p.PC7, p.PE0, p.PE1, p.PE4, p.PD3, p.PE5, p.PE6, p.PG9, p.PA4, p.PA6,
        settings,
    );

    let (detector, Buffer(buffer)) = (DETECTOR.take(), BUFFER.take());
    let mut camera = Cached { camera, cache: core.SCB };
    serve::<Gc2145>(&mut camera, buffer, (detector, &model), &mut port, &mut clock).await;
}
