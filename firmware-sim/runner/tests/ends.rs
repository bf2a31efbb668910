//! Tests how a firmware ends, and what `scripts/board` shows of its log.
//!
//! The tests need qemu-system-arm and the Rust target. Without these they are skipped with a
//! message, or fail if KEYGRAPH_MUST_NOT_SKIP is set.

use std::env;
use std::process::{Command, Output};

use keygraph_board::board::Machine;
use keygraph_board::sample;

/// Runs the program behind `scripts/board`. Returns `None` if the emulator or the target is missing.
fn board(arguments: &[&str]) -> Option<Output> {
    let output = |program: &str, argument: &str| Command::new(program).arg(argument).output();
    let target = Machine::M7.target();
    let emulator = output("qemu-system-arm", "--version").is_ok();
    let has_target = output("rustc", "--print=sysroot").is_ok_and(|o| {
        let sysroot = String::from_utf8_lossy(&o.stdout).trim().to_string();
        std::path::Path::new(&sysroot).join("lib/rustlib").join(target).is_dir()
    });
    if !emulator || !has_target {
        let missing = if emulator { target } else { "qemu-system-arm" };
        assert!(env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "{missing} is missing, and nothing may be skipped");
        eprintln!("SKIPPED: {missing} is missing; scripts/board installs it");
        return None;
    }
    let run = Command::new(env!("CARGO_BIN_EXE_keygraph-board")).args(arguments).output();
    Some(run.expect("the runner was built"))
}

/// Returns the text on standard error.
fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_panic_says_where() {
    let Some(output) = board(&["--ends", "panic"]) else { return };
    let told = told(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("board: error: panicked at src/bin/panic.rs:12:5:\non purpose"), "{told}");
    assert!(told.contains("board: the board stopped with exit status: 101"), "{told}");
    assert!(output.stdout.is_empty(), "there are no results");
}

#[test]
fn a_fault_says_where() {
    let Some(output) = board(&["--ends", "fault"]) else { return };
    let told = told(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("board: error: fault at 0x"), "{told}");
    assert!(told.contains("within __cortex_m_rt_main (fault.rs:13)"), "the source of the address: {told}");
    assert!(told.contains("board: the board stopped with exit status: 101"), "{told}");
}

#[test]
fn the_log_is_shown() {
    let frame = &sample::frames().expect("the frames are there")[0];
    let arguments = ["-v", "--profile", "qqvga", frame.to_str().expect("a path in UTF-8")];
    let Some(output) = board(&arguments) else { return };
    let told = told(&output);
    assert!(output.status.success(), "{told}");
    for start in ["debug: corners: seen ", "debug: found astronaut, score ", "info: 160 px x 120 px: 1 found"] {
        let is = |l: &str| l.strip_prefix("board: ").is_some_and(|l| l.starts_with(start));
        assert!(told.lines().any(is), "no line starts with {start:?}: {told}");
    }
    let results = String::from_utf8_lossy(&output.stdout);
    assert!(results.contains("\"object\":\"astronaut\""), "the linked-in model is found: {results}");
    assert_eq!(results.lines().count(), 1, "the log is not among the results");
}
