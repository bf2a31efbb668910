//! The boards that are modelled, and the firmware for them.
//!
//! In: board, profile, which firmware, the model to link in. Out: its ELF file, built, and what is in it: the
//! sizes of its sections and where models lie. Cost: a build, if anything has changed.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, ObjectSymbol};

/// Most bytes of stack.
pub const STACK_LIMIT: u32 = 8 << 10;

/// The rust target of all boards.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// A processor, and the board whose memory is modelled around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Machine {
    /// Cortex-M4F as in an STM32F405: 1 MB of flash, 128 + 64 KB of RAM
    M4,
    /// Cortex-M7 as in an STM32H743: 2 MB of flash, 512 KB of RAM
    M7,
    /// A Cortex-M7 with memory as in an STM32N657, whose M55 runs the same code: 4 MB of RAM
    N6,
}

impl Machine {
    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::M4 => "m4",
            Self::M7 => "m7",
            Self::N6 => "n6",
        }
    }

    /// The emulator's name for it.
    #[must_use]
    pub const fn emulated(self) -> &'static str {
        match self {
            Self::M4 => "mps2-an386",
            Self::M7 | Self::N6 => "mps2-an500",
        }
    }

    /// The board whose memory it has.
    #[must_use]
    pub const fn modelled(self) -> &'static str {
        match self {
            Self::M4 => "stm32f405",
            Self::M7 => "stm32h743",
            Self::N6 => "stm32n657",
        }
    }
}

/// Size of frames on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Frames {
    /// 640 x 480
    Vga,
    /// 320 x 240
    Qvga,
    /// 160 x 120
    Qqvga,
}

impl Frames {
    /// The firmware's feature.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vga => "vga",
            Self::Qvga => "qvga",
            Self::Qqvga => "qqvga",
        }
    }
}

/// Which firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Finds what is in the model.
    Detect,
    /// Learns from the first frame.
    Learn,
    /// The main loop to copy.
    Camera,
    /// Panics, for the tests.
    Panic,
    /// Faults, for the tests.
    Fault,
}

impl Program {
    /// Most bytes of code and constants, without a model.
    #[must_use]
    pub const fn code_limit(self) -> u64 {
        match self {
            // The trainer too.
            Self::Learn => 112 << 10,
            _ => 96 << 10,
        }
    }

    /// How cargo selects it, and where it puts it.
    const fn selection(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Detect => ("--bin", "detect", "detect"),
            Self::Learn => ("--bin", "learn", "learn"),
            Self::Camera => ("--example", "camera", "examples/camera"),
            Self::Panic => ("--bin", "panic", "panic"),
            Self::Fault => ("--bin", "fault", "fault"),
        }
    }
}

/// The repository.
///
/// # Errors
/// When the runner does not lie in it.
pub fn root() -> Result<&'static Path> {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("the runner lies in firmware-sim")
}

/// The folder of what is built.
///
/// # Errors
/// Those of [`root`].
pub fn targets() -> Result<PathBuf> {
    Ok(env::var_os("CARGO_TARGET_DIR").map_or(root()?.join("target"), PathBuf::from))
}

/// Builds a firmware that logs from level `log` on, with `model` linked in if there is
/// one; its ELF file.
///
/// # Errors
/// When cargo fails: what does not fit the board does not link.
pub fn build(program: Program, machine: Machine, frames: Frames, log: &str, model: Option<&Path>) -> Result<PathBuf> {
    // A folder for each level: another level is another build of everything.
    let target = targets()?.join(format!("board-{log}"));
    let (kind, name, place) = program.selection();
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .args(["build", "--quiet", "--release", "--locked", "--target", TARGET, kind, name, "--manifest-path"])
        .arg(root()?.join("firmware-sim/Cargo.toml"))
        .args(["-p", "keygraph-firmware-sim", "--features"])
        .arg(format!("{},{}{}", machine.modelled(), frames.name(), if model.is_some() { ",sample" } else { "" }))
        .arg("--target-dir")
        .arg(&target)
        .env("DEFMT_LOG", log)
        .stdout(Stdio::null());
    if let Some(model) = model {
        cargo.env("KEYGRAPH_MODEL", model);
    }
    let status = cargo.status().context("cannot run cargo")?;
    ensure!(
        status.success(),
        "the firmware for {} with {} frames cannot be built; if the linker says that a region overflowed, it does not fit that board: use --profile qqvga or --machine m7",
        machine.modelled(),
        frames.name()
    );
    Ok(target.join(TARGET).join("release").join(place))
}

/// What is in an ELF file.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Sections that the board holds: name and bytes.
    pub sections: Vec<(String, u64)>,
    /// Address of the region of flash for models, and its size in bytes.
    pub models: (u64, u64),
    /// Bytes between the stack's ends.
    pub stack_room: u64,
}

impl Contents {
    /// Reads `elf`.
    ///
    /// # Errors
    /// When it is not a firmware of ours.
    pub fn read(elf: &Path) -> Result<Self> {
        let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
        let file = object::File::parse(&*bytes).context("the firmware")?;
        let symbol = |name: &str| {
            let found = file.symbols().find(|s| s.name() == Ok(name)).map(|s| s.address());
            found.with_context(|| format!("the firmware has no {name}"))
        };
        let named = |s: object::Section<'_, '_>| Some((s.name().ok()?.to_string(), s.size()));
        let held = |(name, bytes): &(String, u64)| *bytes > 0 && HELD.contains(&name.as_str());
        let sections = file.sections().filter_map(named).filter(held).collect();
        let models = (symbol("_model_start")?, symbol("_model_end")? - symbol("_model_start")?);
        Ok(Self { sections, models, stack_room: symbol("_stack_start")? - symbol("_stack_end")? })
    }

    /// Bytes of code and constants.
    #[must_use]
    pub fn code(&self) -> u64 {
        self.sections.iter().filter(|(name, _)| IN_FLASH.contains(&name.as_str())).map(|(_, bytes)| bytes).sum()
    }

    /// Refuses code that exceeds its limit.
    ///
    /// # Errors
    /// With both figures.
    pub fn check_code(&self, program: Program) -> Result<()> {
        let (code, limit) = (self.code(), program.code_limit());
        ensure!(code <= limit, "code and constants take {code} bytes; at most {limit} are allowed");
        Ok(())
    }
}

const IN_FLASH: [&str; 4] = [".vector_table", ".text", ".rodata", ".data"];
const HELD: [&str; 8] = [".vector_table", ".text", ".rodata", ".model", ".data", ".bss", ".uninit", ".frame"];
