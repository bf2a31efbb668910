//! Gives the linker the memory layout of the chosen board. A program that does not fit the board
//! does not link.
//! With the feature `sample`, gives the compiler the model to link in.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let board = ["stm32f405", "stm32h743", "stm32n657", "m55"];
    let chosen: Vec<&str> =
        board.into_iter().filter(|b| env::var(format!("CARGO_FEATURE_{}", b.to_uppercase())).is_ok()).collect();
    println!("cargo:rerun-if-changed=memory");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let [board] = chosen[..] else {
        panic!("choose one board: --features stm32f405, stm32h743, stm32n657 or m55");
    };
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(format!("memory/{board}.x"), out.join("memory.x")).expect("memory/ holds a file for each board");
    // The firmware has no handlers of its own for the interrupts of its board.
    fs::write(out.join("device.x"), "").expect("OUT_DIR can be written");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-env-changed=KEYGRAPH_MODEL");
    if env::var_os("CARGO_FEATURE_SAMPLE").is_some() {
        let model = env::var("KEYGRAPH_MODEL").expect("set KEYGRAPH_MODEL to the model to link in, a .kgm file");
        println!("cargo:rerun-if-changed={model}");
        fs::copy(&model, out.join("model.kgm")).unwrap_or_else(|e| panic!("cannot read {model}: {e}"));
    }
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg={argument}");
    }
}
