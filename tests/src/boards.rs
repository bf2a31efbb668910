//! The boards that the detector fits on: the contents of `docs/fits-on.md`.
//!
//! In: the sizes of the core's types, the measurements on the emulated boards, and the makers'
//! figures of their boards. Out: the page as text. `tests/tests/fits_on.rs` compares it with the
//! file, and writes the file if it is told to. Cost: negligible.

use std::fmt::Write;
use std::sync::LazyLock;

use keygraph::learn::Preset;
use keygraph::search::Profile as Size;
use serde_json::Value;

/// Figures that `scripts/board --renew` measured on the emulated boards (qqvga on the Cortex-M4,
/// qvga and vga on the M7; the firmware is built for size), and that `scripts/instructions --renew`
/// counted on x86-64.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Maximum stack use, bytes.
    pub stack: usize,
    /// Size of code and constants without the model, bytes.
    pub code: usize,
    /// Million instructions per searched frame (median), by profile: qqvga, qvga, vga.
    pub instructions: [f64; 3],
    /// Million instructions of the hardest of 51 frames that are made to be hard, by profile.
    pub hardest: [f64; 3],
    /// Million instructions per searched vga frame (mean) on a processor with vectors.
    pub with_vectors: f64,
}

/// Figures of this version, from `firmware-sim/baseline.json` and `benches/instructions.json`.
pub static MEASURED: LazyLock<Measured> = LazyLock::new(|| {
    let baseline: Value = serde_json::from_str(include_str!("../../firmware-sim/baseline.json")).unwrap_or_default();
    let boards = ["m4, qqvga", "m7, qvga", "n6, vga"].map(|name| &baseline["boards"][name]);
    let most = |key: &str| boards.iter().filter_map(|b| b[key].as_u64()).max().and_then(|n| usize::try_from(n).ok());
    let total = |board: &Value| {
        let row = board["instructions"].as_array()?.iter().find(|row| row[0] == "total")?;
        row[1].as_f64()
    };
    let laptop: Value = serde_json::from_str(include_str!("../../benches/instructions.json")).unwrap_or_default();
    let millions = |count: Option<f64>| count.unwrap_or(f64::NAN) / 1e6;
    Measured {
        stack: most("stack").unwrap_or(0),
        code: most("code").unwrap_or(0),
        instructions: boards.map(|board| millions(total(board))),
        hardest: boards.map(|board| millions(board["worst"].as_f64())),
        with_vectors: millions(laptop["total"].as_f64()),
    }
});

/// Flash that the firmware reserves for code, bytes.
const CODE_REGION: usize = 128 << 10;

/// A detector and its frame size.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// Name of the profile on the command line.
    pub name: &'static str,
    /// Width and height of the frames, px.
    pub frame: (usize, usize),
    /// Size of the detector, bytes.
    pub detector: usize,
}

impl Profile {
    /// Returns the RAM that the profile needs, bytes: the detector, one raw frame with two bytes
    /// per pixel, and the stack.
    #[must_use]
    pub fn ram(&self) -> usize {
        self.detector + 2 * self.frame.0 * self.frame.1 + MEASURED.stack
    }
}

/// All profiles, smallest first.
pub const PROFILES: [Profile; 4] = [
    Profile { name: "qqvga", frame: (160, 120), detector: Size::Qqvga.memory().0 },
    Profile { name: "qvga", frame: (320, 240), detector: Size::Qvga.memory().0 },
    Profile { name: "vga", frame: (640, 480), detector: Size::Vga.memory().0 },
    Profile { name: "hd", frame: (1280, 720), detector: Size::Hd.memory().0 },
];

/// A board with the figures of its maker.
#[derive(Clone, Copy, Debug)]
struct Board {
    name: &'static str,
    core: &'static str,
    mhz: usize,
    /// RAM on the chip that the profile can use, KB: the largest piece of it. On the STM32F405 it
    /// is both pieces, the detector in one, frame and stack in the other.
    piece_kb: usize,
    /// RAM on the chip, and RAM beside the chip, KB.
    ram_kb: [usize; 2],
    /// Flash on the chip, and flash beside the chip, KB. Models are read in place from either.
    flash_kb: [usize; 2],
    /// Pages of the maker, with short names in place of addresses.
    source: &'static str,
}

const OPENMV: &str = "https://docs.openmv.io/openmvcam/quickref";
const NICLA: &str = "https://docs.arduino.cc/resources/datasheets/ABX00051-datasheet.pdf";
const PORTENTA: &str = "https://docs.arduino.cc/resources/datasheets/ABX00042-ABX00045-ABX00046-datasheet.pdf";
const STM32H7: &str = "https://www.st.com/resource/en/datasheet/stm32h743bi.pdf";
const STM32F405: &str = "https://www.st.com/resource/en/datasheet/stm32f405rg.pdf";
const RT1060: &str = "https://www.nxp.com/docs/en/data-sheet/IMXRT1060CEC.pdf";
const RP2350: &str = "https://datasheets.raspberrypi.com/rp2350/rp2350-datasheet.pdf";
const PICO: &str = "https://www.raspberrypi.com/documentation/microcontrollers/pico-series.html";
const RASPBERRY: &str = "https://www.raspberrypi.com/documentation/computers/processors.html";

/// Boards with a microcontroller.
const BOARDS: [Board; 8] = [
    Board {
        name: "STM32F405",
        core: "Cortex-M4",
        mhz: 168,
        piece_kb: 192,
        ram_kb: [192, 0],
        flash_kb: [1 << 10, 0],
        source: "[chip](STM32F405)",
    },
    Board {
        name: "Raspberry Pi Pico 2 (RP2350)",
        core: "Cortex-M33",
        mhz: 150,
        piece_kb: 520,
        ram_kb: [520, 0],
        flash_kb: [0, 4 << 10],
        source: "[board](PICO), [chip](RP2350)",
    },
    Board {
        name: "OpenMV Cam H7 (STM32H743)",
        core: "Cortex-M7",
        mhz: 480,
        piece_kb: 512,
        ram_kb: [1 << 10, 0],
        flash_kb: [2 << 10, 0],
        source: "[board](OPENMV/openmv-cam-h7.html), [pieces](STM32H7)",
    },
    Board {
        name: "Arduino Nicla Vision (STM32H747)",
        core: "Cortex-M7",
        mhz: 480,
        piece_kb: 512,
        ram_kb: [1 << 10, 0],
        flash_kb: [2 << 10, 16 << 10],
        source: "[board](NICLA), [pieces](STM32H7)",
    },
    Board {
        name: "Arduino Portenta H7 (STM32H747), Vision Shield",
        core: "Cortex-M7",
        mhz: 480,
        piece_kb: 512,
        ram_kb: [1 << 10, 8 << 10],
        flash_kb: [2 << 10, 16 << 10],
        source: "[board](PORTENTA), [pieces](STM32H7)",
    },
    Board {
        name: "OpenMV Cam H7 Plus (STM32H743)",
        core: "Cortex-M7",
        mhz: 480,
        piece_kb: 512,
        ram_kb: [1 << 10, 32 << 10],
        flash_kb: [2 << 10, 32 << 10],
        source: "[board](OPENMV/openmv-cam-h7-plus.html), [pieces](STM32H7)",
    },
    Board {
        name: "OpenMV Cam RT1062",
        core: "Cortex-M7",
        mhz: 600,
        piece_kb: 512,
        ram_kb: [1 << 10, 32 << 10],
        flash_kb: [0, 16 << 10],
        source: "[board](OPENMV/openmv-rt1062.html), [pieces](RT1060)",
    },
    Board {
        name: "OpenMV N6 (STM32N657)",
        core: "Cortex-M55",
        mhz: 800,
        piece_kb: 4200,
        ram_kb: [4200, 64 << 10],
        flash_kb: [0, 32 << 10],
        source: "[board](OPENMV/openmv-n6.html)",
    },
];

/// Boards that run Linux. They always have enough RAM, so every profile fits.
const LINUX: [Board; 2] = [
    Board {
        name: "Raspberry Pi Zero 2 W",
        core: "Cortex-A53",
        mhz: 1000,
        piece_kb: 0,
        ram_kb: [0, 512 << 10],
        flash_kb: [0, 0],
        source: "[chip](RASPBERRY)",
    },
    Board {
        name: "Raspberry Pi 4",
        core: "Cortex-A72",
        mhz: 1500,
        piece_kb: 0,
        ram_kb: [0, 1 << 20],
        flash_kb: [0, 0],
        source: "[chip](RASPBERRY)",
    },
];

/// Returns the largest profile that fits `kb` KB of RAM, as an index into `PROFILES`.
fn largest(kb: usize) -> Option<usize> {
    PROFILES.iter().rposition(|p| p.ram() <= kb << 10)
}

/// Returns the largest preset that fits the flash on the chip and the flash beside it, KB. Code
/// takes its share of the flash on the chip, or of the flash beside it if the chip has none.
fn preset([inside, beside]: [usize; 2]) -> &'static str {
    let presets = [(Preset::Large, "large"), (Preset::Standard, "standard"), (Preset::Compact, "compact")];
    let room = (inside << 10).saturating_sub(CODE_REGION);
    let beside = (beside << 10).saturating_sub(if inside == 0 { CODE_REGION } else { 0 });
    presets.iter().find(|(p, _)| p.bytes() <= room.max(beside)).map_or("`train --bytes`", |(_, name)| name)
}

/// Replaces the short names of pages by their addresses.
fn linked(source: &str) -> String {
    let pages = [
        ("OPENMV", OPENMV),
        ("STM32H7", STM32H7),
        ("NICLA", NICLA),
        ("PORTENTA", PORTENTA),
        ("RP2350", RP2350),
        ("STM32F405", STM32F405),
        ("RT1060", RT1060),
        ("PICO", PICO),
        ("RASPBERRY", RASPBERRY),
    ];
    pages.iter().fold(source.into(), |s: String, (name, url)| s.replace(&format!("]({name}"), &format!("]({url}")))
}

fn kb(bytes: usize) -> String {
    format!("{} KB", bytes.div_ceil(1024))
}

fn size(kb: usize) -> String {
    match kb {
        0 => "—".into(),
        kb if kb % 1024 == 0 => format!("{} MB", kb >> 10),
        kb => format!("{kb} KB"),
    }
}

/// Returns the frames per second at one instruction per cycle, as text.
#[allow(clippy::cast_precision_loss, reason = "MHz are small")]
fn rate(millions: f64, mhz: usize) -> String {
    format!("{:.1} (computed)", mhz as f64 / millions)
}

/// Returns the million instructions of a profile, and how they are known. The figure of hd is
/// computed from that of vga, in proportion to the number of pixels.
fn instructions(profile: usize) -> (f64, &'static str) {
    if let Some(&millions) = MEASURED.instructions.get(profile) {
        return (millions, "measured");
    }
    #[allow(clippy::cast_precision_loss, reason = "pixels of a frame")]
    let [pixels, vga] = [profile, 2].map(|i| (PROFILES[i].frame.0 * PROFILES[i].frame.1) as f64);
    (MEASURED.instructions[2] * (pixels / vga), "computed")
}

/// Returns the whole text of `docs/fits-on.md`.
#[must_use]
pub fn page() -> String {
    let mut page = String::from(HEAD);
    let _ = writeln!(
        page,
        "| profile | frame | detector | raw frame | stack | RAM in all | instructions a frame | hardest frame |"
    );
    let _ = writeln!(page, "| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (i, p) in PROFILES.iter().enumerate() {
        let (w, h) = p.frame;
        let (millions, how) = instructions(i);
        let (detector, frame, stack, ram) = (kb(p.detector), kb(2 * w * h), kb(MEASURED.stack), kb(p.ram()));
        let hardest = MEASURED.hardest.get(i).map_or("—".into(), |millions| format!("{millions:.1} M (measured)"));
        let _ = writeln!(
            page,
            "| {} | {w}x{h} | {detector} (measured) | {frame} (computed) | {stack} (measured) | {ram} (computed) | {millions:.1} M ({how}) | {hardest} |",
            p.name
        );
    }
    let _ = writeln!(page, "\nCode and constants without the model: {} (measured).", kb(MEASURED.code));
    let _ = writeln!(
        page,
        "On a processor with vectors, such as a laptop or an ARM Linux board, vga takes {:.1} M (measured on x86-64).",
        MEASURED.with_vectors
    );
    page.push_str(BOARDS_HEAD);
    for b in &BOARDS {
        let inside = largest(b.piece_kb);
        let beside = largest(b.ram_kb[1]).filter(|&p| inside.is_none_or(|i| p > i));
        let name = |p: Option<usize>| p.map_or("—".into(), |p| format!("{} (computed)", PROFILES[p].name));
        let speed = inside.map_or("—".into(), |p| rate(instructions(p).0, b.mhz));
        let _ = writeln!(
            page,
            "| {} | {} {} MHz | {}, {} | {} | {} | {} | {} | {} | {} (computed) | {speed} | {} |",
            b.name,
            b.core,
            b.mhz,
            size(b.ram_kb[0]),
            size(b.piece_kb),
            size(b.ram_kb[1]),
            size(b.flash_kb[0]),
            size(b.flash_kb[1]),
            name(inside),
            name(beside),
            preset(b.flash_kb),
            linked(b.source)
        );
    }
    page.push_str(LINUX_HEAD);
    for b in &LINUX {
        let _ = writeln!(
            page,
            "| {} | {} {} MHz | {} | any | any | {} | {} |",
            b.name,
            b.core,
            b.mhz,
            size(b.ram_kb[1]),
            rate(MEASURED.with_vectors, b.mhz),
            linked(b.source)
        );
    }
    page
}

const HEAD: &str = "\
# Boards it fits on

Nobody has run Keygraph on these boards yet. *Measured* is a figure that the compiler or the
emulated board counted. *Computed* is a figure that follows from measured figures. The figures
of the boards (processor, RAM, flash) come from their makers, on the pages named in the last
column.

A test writes this page from the sizes of the types, from `firmware-sim/baseline.json` and from
`benches/instructions.json`, so that the page is true of this version. To write it again, run
`KEYGRAPH_WRITE=1 cargo test -p keygraph-tests --test fits_on`, or `scripts/board --renew`, which
also measures again. Instructions are the median of four frames that show the object whole, from
the side, small, and not at all. The model is `compact`; the figure with vectors is the mean with
a `large` model. These frames are harder than most: the median of 144 others is 15.9 M with qvga
([decision 0012](decisions/0012-sixteen-million.md)). The hardest frame is that of 51 which are made
to be hard: patterns, noise, copies and look-alikes of the object
([decision 0015](decisions/0015-worst-case.md)). The instructions of hd are computed from
those of vga, in proportion to the pixels, which are three times as many.

## What it takes

";

const BOARDS_HEAD: &str = "
## Microcontrollers

A profile fits if the detector, one raw frame and the stack fit the RAM on the chip. If that RAM
comes in pieces, they must fit the largest piece: 512 KB of AXI SRAM on the STM32H743 and H747, and
512 KB of OCRAM on the RT1062. The other half of the RAM is five pieces on the STM32H743 and H747,
and tightly coupled memory on the RT1062. The STM32F405 has pieces of 128 and 64 KB: the detector
lies in the first, frame and stack lie in the second. RAM beside the chip holds larger profiles,
but is several times slower. The application must fit the remaining RAM; a second frame buffer is not needed,
since the next frame arrives while the search goes on ([firmwares for three of these boards](../boards/README.md)).
The preset is the largest that fits the flash beside the code. If there is flash on the chip
and beside it, the larger counts; the model is read in place. One model may hold many objects.

Frames per second are for searching every frame, with the largest profile that fits the RAM on
the chip, at one instruction per cycle: no board gives that. The true ratio depends on the processor, on the
compiler and above all on memory. The figure of the Cortex-M55 is for the code of the M7, which it
runs without its vectors; with them a frame takes a fifth fewer instructions. The cameras of the
Vision Shield have no colour: train with `--luma` for them.

What a frame moves can be counted (qvga, `compact`, the four frames of the sample; on x86-64 by valgrind's lackey,
2026-11-29): it reads 0.5 to 0.6 MB of the model where the object is seen plainly and 1.9 to 2.8 MB where it is not, of
which 41 to 49 KB and 203 to 245 KB are different lines of 32 bytes. From flash on QSPI at 50 MB/s, without a cache, that
takes 10 to 56 ms a frame; with a cache that holds those lines 1 to 5 ms. Of the detector it reads 4 to 16 MB and writes
1 to 4 MB. Copy a model into RAM where there is room for it.

| board | processor | RAM on the chip, of it for the profile | RAM beside it | flash on the chip | flash beside it | profile | with the RAM beside | preset | frames a second | source |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
";

const LINUX_HEAD: &str = "
## Linux boards

`scripts/build-arm` makes one static file for any of these boards. They always have enough memory.
Frames per second are for searching every vga frame on one core, at one instruction per cycle, with
as many instructions as on x86-64.

| board | processor | RAM | profile | preset | frames a second | source |
| --- | --- | --- | --- | --- | --- | --- |
";
