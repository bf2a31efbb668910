//! Numbers for those who watch the program: `GET /metrics`.
//!
//! In: what happens. Out: counters, as text in the format of Prometheus. Memory and cost:
//! some numbers.

use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The counters.
#[derive(Debug, Default)]
pub struct Tally {
    frames: AtomicU64,
    detections: AtomicU64,
    searches: AtomicU64,
    search_us: AtomicU64,
    lines_dropped: AtomicU64,
    viewers: AtomicU64,
}

/// Numbers that others count.
#[derive(Clone, Copy, Debug)]
pub struct Others {
    /// Frames that nobody took.
    pub dropped: u64,
    /// Damaged frames.
    pub damaged: u64,
    /// Models in use.
    pub models: usize,
    /// Whether frames arrive.
    pub camera: bool,
}

impl Tally {
    /// Counts a frame, its detections, and the time of its search if it was searched.
    pub fn frame(&self, detections: usize, search: Option<Duration>) {
        self.frames.fetch_add(1, Ordering::Relaxed);
        self.detections.fetch_add(detections as u64, Ordering::Relaxed);
        if let Some(time) = search {
            self.searches.fetch_add(1, Ordering::Relaxed);
            self.search_us.fetch_add(u64::try_from(time.as_micros()).unwrap_or(0), Ordering::Relaxed);
        }
    }

    /// Counts a line that nobody read.
    pub fn line_dropped(&self) {
        self.lines_dropped.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a viewer that came.
    pub fn viewer_came(&self) {
        self.viewers.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a viewer that left.
    pub fn viewer_left(&self) {
        self.viewers.fetch_sub(1, Ordering::Relaxed);
    }

    /// All numbers as text.
    pub fn text(&self, others: &Others) -> String {
        let of = |number: &AtomicU64| number.load(Ordering::Relaxed);
        let mut text = String::new();
        let mut add = |name: &str, kind: &str, help: &str, samples: &[(&str, String)]| {
            let _ = writeln!(text, "# HELP keygraph_{name} {help}\n# TYPE keygraph_{name} {kind}");
            for (suffix, value) in samples {
                let _ = writeln!(text, "keygraph_{name}{suffix} {value}");
            }
        };
        let one = |value: u64| [("", value.to_string())];
        add("frames_total", "counter", "Frames that were searched or followed.", &one(of(&self.frames)));
        add("frames_dropped_total", "counter", "Frames replaced by newer ones.", &one(others.dropped));
        add("frames_damaged_total", "counter", "Damaged frames.", &one(others.damaged));
        add("detections_total", "counter", "Detections in all frames.", &one(of(&self.detections)));
        let seconds = of(&self.search_us) as f64 / 1e6;
        let search = [("_sum", seconds.to_string()), ("_count", of(&self.searches).to_string())];
        add("search_seconds", "summary", "Time of the frames that were searched.", &search);
        add("lines_dropped_total", "counter", "JSON lines that nobody read.", &one(of(&self.lines_dropped)));
        add("viewers", "gauge", "Connections that look at frames or events.", &one(of(&self.viewers)));
        add("models", "gauge", "Models in use.", &one(others.models as u64));
        add("camera_up", "gauge", "Whether frames arrive: 0 or 1.", &one(others.camera.into()));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_that_were_counted() {
        let tally = Tally::default();
        tally.frame(2, Some(Duration::from_millis(1500)));
        tally.frame(1, None);
        tally.line_dropped();
        tally.viewer_came();
        let text = tally.text(&Others { dropped: 5, damaged: 6, models: 7, camera: true });
        for line in [
            "keygraph_frames_total 2",
            "keygraph_detections_total 3",
            "keygraph_search_seconds_sum 1.5",
            "keygraph_search_seconds_count 1",
            "keygraph_lines_dropped_total 1",
            "keygraph_viewers 1",
            "keygraph_models 7",
            "keygraph_camera_up 1",
            "# TYPE keygraph_search_seconds summary",
        ] {
            assert!(text.lines().any(|l| l == line), "{line} is not in\n{text}");
        }
        tally.viewer_left();
        assert!(
            tally.text(&Others { dropped: 0, damaged: 0, models: 0, camera: false }).contains("keygraph_viewers 0")
        );
    }
}
