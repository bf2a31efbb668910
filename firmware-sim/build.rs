//! Gives the linker the memory of the modelled board: what does not fit does not link.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let board = ["stm32f405", "stm32h743"];
    let chosen: Vec<&str> =
        board.into_iter().filter(|b| env::var(format!("CARGO_FEATURE_{}", b.to_uppercase())).is_ok()).collect();
    println!("cargo:rerun-if-changed=memory");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let [board] = chosen[..] else {
        panic!("choose one board: --features stm32f405 or --features stm32h743");
    };
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(format!("memory/{board}.x"), out.join("memory.x")).expect("memory/ holds a file for each board");
    println!("cargo:rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg={argument}");
    }
}
