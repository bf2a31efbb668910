//! The modelled boards, and the firmware for them.
//!
//! In: a board, a profile, a firmware program, the model to link in. Out: the ELF file, built, and
//! its contents: the sizes of its sections, and the region of flash for models. Cost: a build, if
//! anything has changed.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSection, ObjectSymbol};

/// Maximum size of the stack, bytes.
pub const STACK_LIMIT: u32 = 8 << 10;

/// A processor, together with the board whose memory is modelled around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Machine {
    /// Cortex-M4F with the memory of an STM32F405: 1 MB of flash, 128 + 64 KB of RAM
    M4,
    /// Cortex-M7 with the memory of an STM32H743: 2 MB of flash, 512 KB of RAM
    M7,
    /// Cortex-M7 with the memory of an STM32N657, whose M55 runs the same code: 4 MB of RAM
    N6,
    /// Cortex-M55 with its vectors (MVE), with as much RAM: the code is compiled for it
    M55,
}

impl Machine {
    /// Returns the name of the machine on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::M4 => "m4",
            Self::M7 => "m7",
            Self::N6 => "n6",
            Self::M55 => "m55",
        }
    }

    /// Returns the emulator's name of the machine.
    #[must_use]
    pub const fn emulated(self) -> &'static str {
        match self {
            Self::M4 => "mps2-an386",
            Self::M7 | Self::N6 => "mps2-an500",
            Self::M55 => "mps3-an547",
        }
    }

    /// Returns the name of the board whose memory is modelled.
    #[must_use]
    pub const fn modelled(self) -> &'static str {
        match self {
            Self::M4 => "stm32f405",
            Self::M7 => "stm32h743",
            Self::N6 => "stm32n657",
            Self::M55 => "m55",
        }
    }

    /// Returns the Rust target of the processor.
    #[must_use]
    pub const fn target(self) -> &'static str {
        match self {
            Self::M55 => "thumbv8m.main-none-eabihf",
            _ => "thumbv7em-none-eabihf",
        }
    }

    /// Returns the compiler's flags for the processor.
    const fn flags(self) -> &'static [&'static str] {
        match self {
            Self::M55 => &["-Ctarget-cpu=cortex-m55"],
            _ => &[],
        }
    }
}

/// Size of the frames on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Frames {
    /// 640 x 480 px
    Vga,
    /// 320 x 240 px
    Qvga,
    /// 160 x 120 px
    Qqvga,
}

impl Frames {
    /// Returns the name of the firmware's feature for this size.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vga => "vga",
            Self::Qvga => "qvga",
            Self::Qqvga => "qqvga",
        }
    }
}

/// A firmware program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// Finds the objects of the model.
    Detect,
    /// Learns an object from the first frame.
    Learn,
    /// Runs the main loop of `examples/camera.rs`.
    Camera,
    /// Panics. The tests use it.
    Panic,
    /// Faults. The tests use it.
    Fault,
}

impl Program {
    /// Returns the maximum size of code and constants without a model, bytes.
    #[must_use]
    pub const fn code_limit(self, machine: Machine) -> u64 {
        match (self, machine) {
            // Loops for several numbers at once take more code, and such processors have the room.
            (_, Machine::M55) => 256 << 10,
            // This program holds the trainer too.
            (Self::Learn, _) => 112 << 10,
            _ => 96 << 10,
        }
    }

    /// Returns cargo's option for the kind of the program, its name, and its path in the build folder.
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

/// Returns the root folder of the repository.
///
/// # Errors
/// Fails if the runner is not inside the repository.
pub fn root() -> Result<&'static Path> {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("the runner lies in firmware-sim")
}

/// Returns the folder for build results.
///
/// # Errors
/// Fails if [`root`] fails.
pub fn targets() -> Result<PathBuf> {
    Ok(env::var_os("CARGO_TARGET_DIR").map_or(root()?.join("target"), PathBuf::from))
}

/// Returns compiler flags that shorten the paths of source files, which panics tell and which
/// therefore lie in flash. Without them the size of the firmware depends on the place of the
/// repository.
fn short_paths() -> Result<Vec<String>> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| env::var_os("HOME").map(|home| PathBuf::from(home).join(".cargo")));
    let mut flags = vec![format!("--remap-path-prefix={}/=", root()?.display())];
    // Each registry has a folder of its own.
    let registries = home.and_then(|home| fs::read_dir(home.join("registry/src")).ok());
    for registry in registries.into_iter().flatten().flatten() {
        flags.push(format!("--remap-path-prefix={}/=", registry.path().display()));
    }
    Ok(flags)
}

/// Builds a firmware program and returns the path of its ELF file. The firmware logs from level
/// `log` on. `model` is linked in if there is one.
///
/// # Errors
/// Fails if cargo fails. A firmware that does not fit the board does not link.
pub fn build(program: Program, machine: Machine, frames: Frames, log: &str, model: Option<&Path>) -> Result<PathBuf> {
    // Each level has its own folder, because another level rebuilds everything.
    let folder = targets()?.join(format!("board-{log}"));
    let target = machine.target();
    let flags: Vec<_> = short_paths()?.into_iter().chain(machine.flags().iter().map(ToString::to_string)).collect();
    let (kind, name, place) = program.selection();
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    if machine == Machine::M55 {
        // What is built for size has no vectors, whatever its crates are built for.
        cargo.args(["--config", "profile.release.opt-level=3"]);
    }
    cargo
        .arg("--config")
        .arg(format!("build.rustflags={flags:?}"))
        .args(["build", "--quiet", "--release", "--locked", "--target", target, kind, name, "--manifest-path"])
        .arg(root()?.join("firmware-sim/Cargo.toml"))
        .args(["-p", "keygraph-firmware-sim", "--features"])
        .arg(format!("{},{}{}", machine.modelled(), frames.name(), if model.is_some() { ",sample" } else { "" }))
        .arg("--target-dir")
        .arg(&folder)
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
    Ok(folder.join(target).join("release").join(place))
}

/// Contents of an ELF file.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Sections that the board holds: name and size in bytes.
    pub sections: Vec<(String, u64)>,
    /// Region of flash for models: address and size in bytes.
    pub models: (u64, u64),
    /// Space between the two ends of the stack, bytes.
    pub stack_room: u64,
}

impl Contents {
    /// Reads the contents of `elf`.
    ///
    /// # Errors
    /// Fails if the file is not a firmware of this project.
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

    /// Returns the size of code and constants, bytes.
    #[must_use]
    pub fn code(&self) -> u64 {
        self.sections.iter().filter(|(name, _)| IN_FLASH.contains(&name.as_str())).map(|(_, bytes)| bytes).sum()
    }

    /// Checks that code and constants do not exceed the limit of the program.
    ///
    /// # Errors
    /// Fails if they exceed it. The message gives both figures.
    pub fn check_code(&self, program: Program, machine: Machine) -> Result<()> {
        let (code, limit) = (self.code(), program.code_limit(machine));
        ensure!(code <= limit, "code and constants take {code} bytes; at most {limit} are allowed");
        Ok(())
    }
}

const IN_FLASH: [&str; 4] = [".vector_table", ".text", ".rodata", ".data"];
const HELD: [&str; 8] = [".vector_table", ".text", ".rodata", ".model", ".data", ".bss", ".uninit", ".frame"];
