//! Keygraph on the OpenMV Cam H7: its OV7725 over DCMI and DMA into one buffer, results over the serial
//! port, as two tasks of RTIC.
//!
//! In: frames of 320x240 px, YUYV. Out: a line per detection. Memory: the detector and the frame in AXI
//! SRAM, the stack in DTCM. Cost: the search; the next frame arrives meanwhile.
#![no_std]
#![no_main]

use embassy_stm32::dcmi::{self, HSyncDataInvalidLevel, VSyncDataInvalidLevel};
use embassy_stm32::rcc::{Pll, PllDiv, PllMul, PllPreDiv, PllSource};
use embassy_stm32::{bind_interrupts, dma, peripherals};

bind_interrupts!(struct Interrupts {
    DCMI => dcmi::InterruptHandler<peripherals::DCMI>;
    DMA2_STREAM1 => dma::InterruptHandler<peripherals::DMA2_CH1>;
});

/// 400 MHz of 64 MHz.
const PLL: Pll = Pll {
    source: PllSource::HSI,
    prediv: PllPreDiv::DIV4,
    mul: PllMul::MUL50,
    fracn: None,
    divp: Some(PllDiv::DIV2),
    divq: Some(PllDiv::DIV8),
    divr: None,
};

/// Levels of the camera's lines while nothing is valid.
fn levels() -> dcmi::Config {
    let mut settings = dcmi::Config::default();
    settings.vsync_level = VSyncDataInvalidLevel::High;
    settings.hsync_level = HSyncDataInvalidLevel::Low;
    settings
}

#[rtic::app(device = embassy_stm32::pac, peripherals = false, dispatchers = [UART7])]
mod app {
    use cortex_m::peripheral::DWT;
    use embassy_stm32::gpio::{Level, Output, OutputType, Speed};
    use embassy_stm32::i2c::{self, I2c};
    use embassy_stm32::time::{khz, mhz};
    use embassy_stm32::timer::low_level::CountingMode;
    use embassy_stm32::timer::simple_pwm::{PwmPin, SimplePwm};
    use embassy_stm32::usart::{self, UartTx};
    use keygraph_boards::MODEL;
    use keygraph_boards::search::{complain, serve};
    use keygraph_boards::sensor::{HEIGHT, Ov7725, Sensor, WIDTH};
    use keygraph_boards::stm32h7::{Buffer, Cached, Port, clocks};
    use keygraph_core::{Model, QvgaDetector};
    use static_cell::ConstStaticCell;

    use super::{Interrupts, PLL, levels};
    use embassy_stm32::dcmi::Dcmi;

    // All bytes of both are zero: they lie in .bss, and never on the stack.
    static DETECTOR: ConstStaticCell<QvgaDetector> = ConstStaticCell::new(QvgaDetector::new());
    static BUFFER: ConstStaticCell<Buffer> = ConstStaticCell::new(Buffer([0; WIDTH * HEIGHT / 2]));

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        camera: Cached,
        port: Port,
    }

    #[init]
    fn init(context: init::Context) -> (Shared, Local) {
        let p = embassy_stm32::init(clocks(PLL));
        let mut core = context.core;
        core.SCB.enable_icache();
        core.SCB.enable_dcache(&mut core.CPUID);
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();

        let port = UartTx::new_blocking(p.USART3, p.PB10, usart::Config::default()).expect("the rate is usual");
        let mut port = Port(port);
        // The camera wakes up when its power-down line is low and its reset line high.
        let awake = [Output::new(p.PD7, Level::Low, Speed::Low), Output::new(p.PA10, Level::High, Speed::Low)];
        // Both stay so.
        core::mem::forget(awake);
        let pin = PwmPin::new(p.PA8, OutputType::PushPull);
        let mut pwm = SimplePwm::new(p.TIM1, Some(pin), None, None, None, mhz(12), CountingMode::EdgeAlignedUp);
        pwm.ch1().set_duty_cycle_fraction(1, 2);
        pwm.ch1().enable();
        // It goes on for ever.
        core::mem::forget(pwm);

        let mut settings = i2c::Config::default();
        settings.frequency = khz(100);
        let mut bus = I2c::new_blocking(p.I2C1, p.PB8, p.PB9, settings);
        match Ov7725::start(&mut bus) {
            Ok(()) => look::spawn().expect("it runs once"),
            Err(error) => complain(&mut port, &error),
        }
        let camera = Dcmi::new_8bit(
            p.DCMI,
            p.DMA2_CH1,
            Interrupts,
            p.PC6,
            p.PC7,
            p.PE0,
            p.PE1,
            p.PE4,
            p.PB6,
            p.PE5,
            p.PE6,
            p.PB7,
            p.PA4,
            p.PA6,
            levels(),
        );
        (Shared {}, Local { camera: Cached { camera, cache: core.SCB }, port })
    }

    /// Searches every frame.
    #[task(local = [camera, port], priority = 1)]
    async fn look(context: look::Context) {
        let look::LocalResources { camera, port, .. } = context.local;
        let mut clock = || u64::from(DWT::cycle_count());
        let Ok(model) = Model::parse(MODEL) else {
            return complain(port, &"the model is damaged: build it in again");
        };
        let (detector, Buffer(buffer)) = (DETECTOR.take(), BUFFER.take());
        serve::<Ov7725>(camera, buffer, (detector, &model), port, &mut clock).await;
    }
}
