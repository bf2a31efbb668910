//! What is said on standard error: errors, and notices, which `--quiet` leaves out.
//!
//! In: a sentence. Out: a line, with its start in colour where the terminal shows colours. `--color` and the
//! environment (`NO_COLOR`, `CLICOLOR_FORCE`) decide that for the whole program: clap's messages, these lines and the
//! log of `camera`. Memory and cost: the text.

use std::io::stderr;
use std::sync::atomic::{AtomicBool, Ordering};

use anstream::{AutoStream, ColorChoice, eprintln};
use clap::builder::styling::{AnsiColor, Style};

/// Whether notices are left out.
static QUIET: AtomicBool = AtomicBool::new(false);

/// The start of an error.
const RED: Style = AnsiColor::Red.on_default().bold();

/// Leaves out notices and progress from now on.
pub fn keep_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether only errors are said.
#[must_use]
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Decides when colours are shown from now on, on standard output too.
pub fn set_colours(when: clap::ColorChoice) {
    match when {
        clap::ColorChoice::Auto => ColorChoice::Auto,
        clap::ColorChoice::Always => ColorChoice::Always,
        clap::ColorChoice::Never => ColorChoice::Never,
    }
    .write_global();
}

/// Whether standard error shows colours.
#[must_use]
pub fn has_colours() -> bool {
    AutoStream::choice(&stderr()) != ColorChoice::Never
}

/// Says something that is no error.
pub fn notice(text: &str) {
    if !is_quiet() {
        eprintln!("keygraph: {text}");
    }
}

/// Says that something failed.
pub fn error(text: &str) {
    eprintln!("{RED}keygraph:{RED:#} {text}");
}
