//! What firmwares for the STM32H7 share: clocks, the frame's buffer, the serial port, and the camera behind the cache.
//!
//! In: peripherals of embassy-stm32, whose chip the firmware chooses. Out: a [`Camera`]. Memory: what the firmware
//! places. Cost: that of the cache's invalidation, one pass over the frame's lines.

use core::fmt::{self, Write};

use cortex_m::peripheral::SCB;
use embassy_stm32::dcmi::Dcmi;
use embassy_stm32::rcc::{AHBPrescaler, APBPrescaler, HSIPrescaler, Pll, Sysclk, VoltageScale};
use embassy_stm32::usart::UartTx;
use embassy_stm32::{Config, mode, peripherals};

use crate::search::Camera;
use crate::sensor::{HEIGHT, WIDTH};

/// The raw frame: whole lines of the data cache.
#[repr(C, align(32))]
pub struct Buffer(pub [u32; WIDTH * HEIGHT / 2]);

/// The processor at the rate of `pll`, which is fed by the internal oscillator of 64 MHz; the buses at half and a
/// quarter of it.
#[must_use]
pub fn clocks(pll: Pll) -> Config {
    let mut config = Config::default();
    config.rcc.hsi = Some(HSIPrescaler::DIV1);
    config.rcc.pll1 = Some(pll);
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    (config.rcc.apb1_pre, config.rcc.apb2_pre) = (APBPrescaler::DIV2, APBPrescaler::DIV2);
    (config.rcc.apb3_pre, config.rcc.apb4_pre) = (APBPrescaler::DIV2, APBPrescaler::DIV2);
    config.rcc.voltage_scale = VoltageScale::Scale1;
    config
}

/// A serial port that takes text.
pub struct Port(pub UartTx<'static, mode::Blocking>);

impl Write for Port {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.blocking_write(text.as_bytes()).map_err(|_| fmt::Error)
    }
}

/// The camera, and the data cache between its frames and the processor.
pub struct Cached {
    /// The camera.
    pub camera: Dcmi<'static, peripherals::DCMI>,
    /// The cache.
    pub cache: SCB,
}

impl Camera for Cached {
    async fn capture(&mut self, buffer: &mut [u32]) -> bool {
        self.camera.capture(buffer).await.is_ok()
    }

    fn refresh(&mut self, buffer: &mut [u32]) {
        // SAFETY: the buffer fills whole lines of the cache, and nothing has been written to it since the DMA
        // began: no line holds what memory does not.
        unsafe { self.cache.invalidate_dcache_by_slice(buffer) };
    }
}
