//! Cameras on a bus of two wires (I2C, SCCB), and how they start.
//!
//! In: a bus. Out: a camera that delivers frames of [`Sensor::FORMAT`], 320x240 px. Memory: none. Cost: a
//! few ms on the bus.
//!
//! The registers of a mode come from the maker of the camera. Its lists have no licence that would let
//! them stand here: `KEYGRAPH_REGISTERS` names a file of yours. Without it, the camera is only asked who
//! it is.

use core::fmt;

use embedded_hal::i2c::I2c;
use keygraph_core::PixelFormat;

/// Width of frames, px.
pub const WIDTH: usize = 320;
/// Height of frames, px.
pub const HEIGHT: usize = 240;

/// The registers to write at the start: addresses and values, in order.
const REGISTERS: &[(u16, u8)] = include!(concat!(env!("OUT_DIR"), "/registers.rs"));

/// A kind of camera.
pub trait Sensor {
    /// The name for people.
    const NAME: &str;
    /// The address on the bus, 7 bits.
    const ADDRESS: u8;
    /// Whether addresses of registers have 16 bits, and not 8.
    const IS_WIDE: bool;
    /// The registers that hold the number of the kind, and what they hold.
    const IDENTITY: [(u16, u8); 2];
    /// The format of frames.
    const FORMAT: PixelFormat;
    /// Registers that start the camera after all others.
    const STREAM: &[(u16, u8)];

    /// Asks the camera who it is, and writes its registers.
    ///
    /// # Errors
    /// [`StartError`], which says what to look at.
    fn start<B: I2c>(bus: &mut B) -> Result<(), StartError> {
        for (register, expected) in Self::IDENTITY {
            let found = Self::read(bus, register)?;
            if found != expected {
                return Err(StartError::Other { sensor: Self::NAME, register, expected, found });
            }
        }
        for &(register, value) in REGISTERS.iter().chain(Self::STREAM) {
            Self::write(bus, register, value)?;
        }
        Ok(())
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`StartError::Silent`].
    fn read<B: I2c>(bus: &mut B, register: u16) -> Result<u8, StartError> {
        let (mut value, [high, low]) = ([0], register.to_be_bytes());
        let address: &[u8] = if Self::IS_WIDE { &[high, low] } else { &[low] };
        let answered = bus.write_read(Self::ADDRESS, address, &mut value);
        answered.map(|()| value[0]).map_err(|_| StartError::Silent { sensor: Self::NAME, address: Self::ADDRESS })
    }

    /// Writes a register.
    ///
    /// # Errors
    /// [`StartError::Silent`].
    fn write<B: I2c>(bus: &mut B, register: u16, value: u8) -> Result<(), StartError> {
        let [high, low] = register.to_be_bytes();
        let bytes: &[u8] = if Self::IS_WIDE { &[high, low, value] } else { &[low, value] };
        bus.write(Self::ADDRESS, bytes).map_err(|_| StartError::Silent { sensor: Self::NAME, address: Self::ADDRESS })
    }
}

/// Why a camera did not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartError {
    /// Nobody answers.
    Silent {
        /// The camera.
        sensor: &'static str,
        /// The address that was asked, 7 bits.
        address: u8,
    },
    /// Another camera answers.
    Other {
        /// The camera that was expected.
        sensor: &'static str,
        /// The register that tells.
        register: u16,
        /// What it should hold.
        expected: u8,
        /// What it holds.
        found: u8,
    },
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent { sensor, address } => {
                write!(f, "the {sensor} does not answer at {address:#04x}: check its power, its clock, SDA and SCL")
            }
            Self::Other { sensor, register, expected, found } => {
                write!(f, "this is no {sensor}: register {register:#06x} has {found:#04x}, and not {expected:#04x}")
            }
        }
    }
}

/// GalaxyCore GC2145, 1600x1200 px, colour: the camera of the Arduino Nicla Vision.
#[derive(Clone, Copy, Debug)]
pub struct Gc2145;

impl Sensor for Gc2145 {
    const NAME: &str = "GC2145";
    const ADDRESS: u8 = 0x3c;
    const IS_WIDE: bool = false;
    const IDENTITY: [(u16, u8); 2] = [(0xf0, 0x21), (0xf1, 0x45)];
    const FORMAT: PixelFormat = PixelFormat::Yuyv;
    const STREAM: &[(u16, u8)] = &[];
}

/// OmniVision OV7725, 640x480 px, colour: the camera of the OpenMV Cam H7.
#[derive(Clone, Copy, Debug)]
pub struct Ov7725;

impl Sensor for Ov7725 {
    const NAME: &str = "OV7725";
    const ADDRESS: u8 = 0x21;
    const IS_WIDE: bool = false;
    const IDENTITY: [(u16, u8); 2] = [(0x0a, 0x77), (0x0b, 0x21)];
    const FORMAT: PixelFormat = PixelFormat::Yuyv;
    const STREAM: &[(u16, u8)] = &[];
}

/// Himax HM01B0, 320x320 px, gray: small, slow and frugal.
#[derive(Clone, Copy, Debug)]
pub struct Hm01b0;

impl Sensor for Hm01b0 {
    const NAME: &str = "HM01B0";
    const ADDRESS: u8 = 0x24;
    const IS_WIDE: bool = true;
    const IDENTITY: [(u16, u8); 2] = [(0x0000, 0x01), (0x0001, 0xb0)];
    const FORMAT: PixelFormat = PixelFormat::Gray8;
    /// The mode: streaming.
    const STREAM: &[(u16, u8)] = &[(0x0100, 0x01)];
}
