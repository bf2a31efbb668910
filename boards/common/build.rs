//! Gives the compiler the model and the camera's registers, which the environment names:
//!
//! - `KEYGRAPH_MODEL`: the model to find, a `.kgm` file
//! - `KEYGRAPH_REGISTERS`: the registers to write at the start, a text file with an address and a value
//!   a line, such as `0xfe 0x00`; after `#` comes a comment. Without it, none is written.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-env-changed=KEYGRAPH_MODEL");
    println!("cargo:rerun-if-env-changed=KEYGRAPH_REGISTERS");
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let model =
        env::var("KEYGRAPH_MODEL").expect("set KEYGRAPH_MODEL to the model to find: a .kgm file, by its whole path");
    println!("cargo:rerun-if-changed={model}");
    fs::copy(&model, out.join("model.kgm")).unwrap_or_else(|e| panic!("cannot read {model}: {e}"));
    let registers = env::var("KEYGRAPH_REGISTERS").map_or_else(|_| Vec::new(), |file| registers(Path::new(&file)));
    let list = registers.iter().fold(String::new(), |mut list, (address, value)| {
        // Writing to a string cannot fail.
        let _ = write!(list, "({address:#x}, {value:#x}), ");
        list
    });
    fs::write(out.join("registers.rs"), format!("&[{list}]")).expect("OUT_DIR can be written");
}

/// The addresses and values in a file.
fn registers(file: &Path) -> Vec<(u16, u8)> {
    println!("cargo:rerun-if-changed={}", file.display());
    let text = fs::read_to_string(file).unwrap_or_else(|e| panic!("cannot read {}: {e}", file.display()));
    let number = |word: &str| match word.strip_prefix("0x") {
        Some(digits) => u16::from_str_radix(digits, 16).ok(),
        None => word.parse().ok(),
    };
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim()).enumerate();
    let pair = |(i, line): (usize, &str)| {
        let mut words = line.split_whitespace().map(number);
        let value = |word: Option<Option<u16>>| word.flatten().and_then(|v| u8::try_from(v).ok());
        let (address, value, more) = (words.next().flatten(), value(words.next()), words.next());
        match (address, value, more) {
            (Some(address), Some(value), None) => (address, value),
            _ => panic!("{}:{}: expected an address and a value, such as 0xfe 0x00", file.display(), i + 1),
        }
    };
    lines.filter(|(_, line)| !line.is_empty()).map(pair).collect()
}
