//! Memory and cost of a board as Markdown tables.
//!
//! In: the contents of the firmware's file, and the reports of the board. Out: text.

use std::fmt::Write;

use keygraph_core::{Buffer, Stage};
use keygraph_firmware_sim::wire::{Report, instructions};

use crate::board::{Contents, Frames, Machine, Program, STACK_LIMIT};

/// Figures of a run.
#[derive(Clone, Debug)]
pub struct Run {
    /// Firmware program, board and size of the frames.
    pub of: (Program, Machine, Frames),
    /// Contents of the firmware's file.
    pub contents: Contents,
    /// Size of the detector, and of each of its buffers, bytes.
    pub detector: (u32, Vec<u32>),
    /// Reports of the board, one per frame.
    pub reports: Vec<Report>,
}

impl Run {
    /// Returns the maximum stack use, bytes.
    #[must_use]
    pub fn stack(&self) -> u32 {
        self.reports.iter().map(|r| r.stack_bytes).max().unwrap_or(0)
    }

    /// Returns the most instructions between two questions whether a search goes on.
    #[must_use]
    pub fn longest(&self) -> u64 {
        self.reports.iter().map(|r| instructions(r.longest)).max().unwrap_or(0)
    }

    /// Returns name and size in bytes of each buffer of the detector. The last entry is the rest of
    /// the detector.
    #[must_use]
    pub fn buffers(&self) -> Vec<(&'static str, u32)> {
        let (whole, parts) = &self.detector;
        let mut named: Vec<_> = Buffer::ALL.iter().map(|b| b.name()).zip(parts.iter().copied()).collect();
        named.push(("all else", whole - parts.iter().sum::<u32>()));
        named
    }

    /// Returns the instructions of each stage and of the whole search: name, median and maximum
    /// over the frames.
    #[must_use]
    pub fn cost(&self) -> Vec<(&'static str, u64, u64)> {
        let row = |name: &'static str, count: &dyn Fn(&Report) -> u64| {
            let mut counts: Vec<u64> = self.reports.iter().map(count).collect();
            counts.sort_unstable();
            (name, counts.get(counts.len() / 2).copied().unwrap_or(0), counts.last().copied().unwrap_or(0))
        };
        let stages = Stage::ALL.iter().enumerate();
        let mut rows: Vec<_> = stages.map(|(i, stage)| row(stage.name(), &|r| r.instructions()[i])).collect();
        rows.push(row("total", &|r| r.instructions().iter().sum()));
        rows
    }

    /// Returns the table of memory.
    #[must_use]
    pub fn memory_table(&self) -> String {
        let (program, machine, frames) = self.of;
        let mut out = format!("| memory: {}, {} | bytes |\n| --- | --- |\n", machine.modelled(), frames.name());
        let mut row = |name: &str, bytes: u64| {
            // Writing to a string cannot fail.
            let _ = writeln!(out, "| {name} | {bytes} |");
        };
        for (name, bytes) in &self.contents.sections {
            row(name, *bytes);
        }
        row(&format!("code and constants (limit {})", program.code_limit(machine)), self.contents.code());
        let room = self.contents.stack_room;
        row(&format!("stack, most used (limit {STACK_LIMIT}, room {room})"), u64::from(self.stack()));
        row("detector, within .bss", u64::from(self.detector.0));
        for (name, bytes) in self.buffers() {
            row(&format!("— {name}"), u64::from(bytes));
        }
        out
    }

    /// Returns the table of instructions by stage.
    #[must_use]
    pub fn cost_table(&self) -> String {
        let frames = self.reports.len();
        let mut out = format!("| stage, {frames} frames | instructions, median | most |\n| --- | --- | --- |\n");
        for (name, median, most) in self.cost() {
            let _ = writeln!(out, "| {name} | {median} | {most} |");
        }
        out
    }
}
