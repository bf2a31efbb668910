//! Shows the progress of a long run on standard error.
//!
//! In: one [`Progress::tick`] a frame. Out: a bar, the rate and the time that is left; a counter when the number of
//! frames is not known; nothing unless standard error is a terminal, and nothing with `--quiet`.

use std::fmt::Write;
use std::io::{IsTerminal, stderr};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::notice::{self, is_quiet};

/// A progress bar. It is cleared when finished or dropped.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// Starts at 0 of `len`; `None` when the number is not known. `what` names what is
    /// counted, such as "frames".
    #[must_use]
    pub fn new(len: Option<u64>, what: &'static str) -> Self {
        if !stderr().is_terminal() || is_quiet() {
            return Self { bar: ProgressBar::hidden() };
        }
        let bar = ProgressBar::with_draw_target(len, ProgressDrawTarget::stderr());
        let template = match len {
            Some(_) => "{bar:30} {pos} of {len} {msg}{pace}{left}",
            None => "{spinner} {pos} {msg}{pace}",
        };
        // With a wrong template, indicatif keeps its own style.
        if let Ok(style) = ProgressStyle::with_template(template) {
            let style = style
                .with_key("pace", move |state: &ProgressState, text: &mut dyn Write| {
                    let _ = text.write_str(&pace(state.per_sec(), what));
                })
                .with_key("left", |state: &ProgressState, text: &mut dyn Write| {
                    let _ = text.write_str(&left(state.eta()));
                });
            bar.set_style(style);
        }
        bar.set_message(what);
        Self { bar }
    }

    /// Counts one more.
    pub fn tick(&self) {
        self.bar.inc(1);
    }

    /// Says on standard error that something failed, above the bar if there is one.
    pub fn error(&self, text: &str) {
        self.aside(|| notice::error(text));
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

/// A rate with two digits, by the second or by the minute; empty while there is none.
fn pace(per_second: f64, what: &str) -> String {
    let round = |v: f64| {
        let two = format!("{v:.1e}").parse().unwrap_or(v);
        if two < 10.0 { format!("{two:.1}") } else { format!("{two:.0}") }
    };
    match per_second {
        v if !v.is_finite() || v * 60.0 < 0.05 => String::new(),
        v if v < 1.0 => format!(", {} {what}/minute", round(v * 60.0)),
        v => format!(", {} {what}/s", round(v)),
    }
}

/// The time that is left, in a round number of the largest unit; empty when it is not known.
fn left(time: Duration) -> String {
    let told = |n: u64, unit: &str| format!(", about {n} {unit}{} left", if n == 1 { "" } else { "s" });
    match time.as_secs() {
        // What indicatif says before it has seen two steps, and at the end.
        0 => String::new(),
        s @ 1..10 => told(s, "second"),
        s @ 10..55 => told((s + 2) / 5 * 5, "second"),
        s @ 55..5400 => told((s + 30) / 60, "minute"),
        s @ 5400..172_800 => told((s + 1800) / 3600, "hour"),
        s => told((s + 43_200) / 86_400, "day"),
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

    #[test]
    fn rates_have_two_digits() {
        for (rate, told) in [
            (0.0, ""),
            (f64::NAN, ""),
            (f64::INFINITY, ""),
            (0.02, ", 1.2 frames/minute"),
            (0.5, ", 30 frames/minute"),
            (1.0, ", 1.0 frames/s"),
            (9.94, ", 9.9 frames/s"),
            (9.96, ", 10 frames/s"),
            (99.6, ", 100 frames/s"),
            (143.2, ", 140 frames/s"),
            (1260.0, ", 1300 frames/s"),
        ] {
            assert_eq!(pace(rate, "frames"), told, "{rate}");
        }
    }

    #[test]
    fn the_time_left_is_round() {
        for (seconds, told) in [
            (0, ""),
            (1, ", about 1 second left"),
            (9, ", about 9 seconds left"),
            (12, ", about 10 seconds left"),
            (54, ", about 55 seconds left"),
            (55, ", about 1 minute left"),
            (130, ", about 2 minutes left"),
            (5399, ", about 90 minutes left"),
            (5400, ", about 2 hours left"),
            (172_800, ", about 2 days left"),
        ] {
            assert_eq!(left(Duration::from_secs(seconds)), told, "{seconds} s");
        }
    }
}
