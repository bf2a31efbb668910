//! Shows the progress of a long run on standard error.
//!
//! In: one [`Progress::tick`] a frame. Out: a bar; a counter when the number of frames is
//! not known; nothing unless standard error is a terminal.

use std::io::{IsTerminal, stderr};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A progress bar. It is cleared when finished or dropped.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// Starts at 0 of `len`; `None` when the number is not known. `what` names what is
    /// counted, such as "frames".
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
        // With a wrong template, indicatif keeps its own style.
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(what.to_string());
        Self { bar }
    }

    /// Counts one more.
    pub fn tick(&self) {
        self.bar.inc(1);
    }

    /// Prints a line on standard error, above the bar if there is one.
    pub fn print(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// Hides the bar while `f` runs, which may write to the terminal.
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
