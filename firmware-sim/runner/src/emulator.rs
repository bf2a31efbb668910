//! Runs a firmware in the emulator.
//!
//! In: an ELF file, the bytes of a model for its region of flash, and the input that `wire`
//! defines. Out: the words that the board wrote, and the text that it sent over the serial port.
//! The log is decoded line by line while the emulator runs. After a line that reports a fault, one
//! further line per address gives the place in the source. Cost: about a second per frame.

use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use addr2line::Loader;
use anyhow::{Context, Result, anyhow, bail, ensure};
use defmt_decoder::{DecodeError, Table};
use keygraph_firmware_sim::wire::{FRAMES, ICOUNT, RESULTS};

use crate::board::{Contents, Machine};

const MODEL: &str = "model.kgm";
const SERIAL: &str = "serial.txt";

/// Output of a run.
#[derive(Clone, Debug)]
pub struct Output {
    /// Words of the result file.
    pub words: Vec<u32>,
    /// Text that the board sent over the serial port.
    pub serial: String,
}

/// A temporary folder that is removed when the value is dropped.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self> {
        let path = std::env::temp_dir().join(format!("keygraph-board-{}", std::process::id()));
        fs::create_dir_all(&path).with_context(|| format!("cannot make {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed is left to the system.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Runs `elf` until it ends. `frames` is the content of the file that the firmware reads. `model`
/// is loaded into flash before the start. `log` receives the log, line by line.
///
/// # Errors
/// Fails if the emulator is missing, or if the firmware panics or faults. The log then says where.
pub fn run(
    elf: &Path,
    contents: &Contents,
    machine: Machine,
    model: Option<&[u8]>,
    frames: &[u8],
    log: &mut dyn FnMut(&str),
) -> Result<Output> {
    let folder = Folder::new()?;
    let at = |name: &str| folder.0.join(name);
    fs::write(at(FRAMES.to_str()?), frames).context("cannot write the frames for the board")?;
    let mut qemu = Command::new("qemu-system-arm");
    qemu.args(["-machine", machine.emulated(), "-display", "none", "-monitor", "none", "-icount", ICOUNT])
        .args(["-semihosting-config", "enable=on,target=native"])
        .args(["-serial", &format!("file:{SERIAL}"), "-kernel"])
        .arg(elf.canonicalize().with_context(|| format!("cannot find {}", elf.display()))?);
    if let Some(bytes) = model {
        let (address, room) = contents.models;
        ensure!(
            bytes.len() as u64 <= room,
            "the model has {} bytes, the flash of {} has room for {room}: train it with --preset compact or --bytes {room}",
            bytes.len(),
            machine.modelled()
        );
        fs::write(at(MODEL), bytes).context("cannot write the model for the board")?;
        qemu.args(["-device", &format!("loader,file={MODEL},addr={address:#x},force-raw=on")]);
    }
    let mut child = match qemu.current_dir(&folder.0).stdin(Stdio::null()).stdout(Stdio::piped()).spawn() {
        Ok(child) => child,
        Err(e) if e.kind() == ErrorKind::NotFound => {
            bail!("qemu-system-arm is missing: install it with `sudo apt-get install qemu-system-arm`")
        }
        Err(e) => return Err(e).context("cannot run qemu-system-arm"),
    };
    let output = child.stdout.take().context("the emulator has an output")?;
    decode_log(elf, output, log)?;
    let status = child.wait()?;
    ensure!(status.success(), "the board stopped with {status}: its log above says where");
    let mut bytes = Vec::new();
    File::open(at(RESULTS.to_str()?))
        .and_then(|mut f| f.read_to_end(&mut bytes))
        .context("the board left no results")?;
    let words = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(Output { words, serial: fs::read_to_string(at(SERIAL)).unwrap_or_default() })
}

/// Decodes the log while it arrives.
fn decode_log(elf: &Path, mut output: impl Read, log: &mut dyn FnMut(&str)) -> Result<()> {
    let bytes = fs::read(elf)?;
    let table = Table::parse(&bytes)?.context("the firmware has no log table")?;
    let places = table.get_locations(&bytes)?;
    let mut decoder = table.new_stream_decoder();
    let mut buffer = [0; 4096];
    loop {
        let n = output.read(&mut buffer)?;
        if n == 0 {
            return Ok(());
        }
        decoder.received(&buffer[..n]);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("print", |l| l.as_str());
                    let place = places.get(&frame.index()).map_or_else(String::new, |p| {
                        let file = p.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                        format!(" ({file}:{})", p.line)
                    });
                    let message = frame.display_message().to_string();
                    log(&format!("{level}: {message}{place}"));
                    if level == "error" {
                        explain(elf, &message)?.iter().for_each(|line| log(line));
                    }
                }
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => log("a line of the log was lost"),
            }
        }
    }
}

/// Returns one line for each code address in `message`: the function with its file and line. If the
/// function is inlined, the line also names the functions around it.
fn explain(elf: &Path, message: &str) -> Result<Vec<String>> {
    let number = |(at, _)| u64::from_str_radix(message.get(at + 2..at + 10)?, 16).ok();
    let addresses: Vec<u64> = message.match_indices("0x").filter_map(number).collect();
    if addresses.is_empty() {
        return Ok(Vec::new());
    }
    let source = Loader::new(elf).map_err(|e| anyhow!("{}: {e}", elf.display()))?;
    let explained = addresses.iter().enumerate().filter_map(|(i, address)| {
        // Bit 0 marks Thumb code. The second address is a return address, which lies behind the call.
        let code = (address & !1).saturating_sub(2 * i as u64);
        let mut frames = source.find_frames(code).ok()?;
        let mut places = Vec::new();
        while let Ok(Some(frame)) = frames.next() {
            let name = frame.function.as_ref().and_then(|f| Some(f.demangle().ok()?.into_owned()));
            let place = frame.location.and_then(|l| {
                let file = Path::new(l.file?).file_name()?.to_string_lossy().into_owned();
                Some(format!(" ({file}:{})", l.line?))
            });
            places.push(name? + &place.unwrap_or_default());
        }
        (!places.is_empty()).then(|| format!("{address:#010x} is in {}", places.join(", within ")))
    });
    Ok(explained.collect())
}
