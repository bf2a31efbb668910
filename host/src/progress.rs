//! Shows on standard error how far a long run has come.
//!
//! In: one [`Progress::tick`] per frame. Out: a bar, or a counter if the number
//! of frames is not known; nothing at all unless standard error is a terminal.

use std::io::{IsTerminal, stderr};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A progress bar. It is cleared when finished or dropped.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// Starts at 0 of `len`, if that is known. `what` names the things that
    /// are counted, such as "frames".
    #[must_use]
    pub fn new(len: Option<u64>, what: &str) -> Self {
        if !stderr().is_terminal() {
            return Self { bar: ProgressBar::hidden() };
        }
        let template = match len {
            Some(_) => "{bar:30} {pos}/{len} {msg}, {per_sec}, {eta} left",
            None => "{spinner} {pos} {msg}, {per_sec}",
        };
        let bar = ProgressBar::with_draw_target(len, ProgressDrawTarget::stderr());
        // A wrong template leaves indicatif's own style.
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(what.to_string());
        Self { bar }
    }

    /// One more is done.
    pub fn tick(&self) {
        self.bar.inc(1);
    }

    /// Prints a line above the bar, or as it is if there is none, without
    /// tearing the bar.
    pub fn print(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// Runs `f`, which may write to the terminal, without tearing the bar.
    pub fn aside<T>(&self, f: impl FnOnce() -> T) -> T {
        self.bar.suspend(f)
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_with_and_without_a_length() {
        for len in [None, Some(0), Some(2)] {
            let progress = Progress::new(len, "frames");
            for _ in 0..3 {
                progress.tick();
            }
            assert_eq!(progress.bar.position(), 3);
            progress.finish();
        }
    }
}
