//! Memory and cost of a board as Markdown tables.
//!
//! In: what the firmware's file holds and what the board told. Out: text.

use std::fmt::Write;

use keygraph_core::capacity::Stage;
use keygraph_core::detect::QvgaDetector;
use keygraph_firmware_sim::wire::Report;

use crate::board::{Contents, Frames, Machine, Program, STACK_LIMIT};

/// Where the bytes are.
#[must_use]
pub fn memory(
    (program, machine, frames): (Program, Machine, Frames),
    contents: &Contents,
    detector: u32,
    buffers: &[u32],
    stack: u32,
) -> String {
    let mut out = format!("| memory: {}, {} | bytes |\n| --- | --- |\n", machine.modelled(), frames.name());
    let mut row = |name: &str, bytes: u64| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "| {name} | {bytes} |");
    };
    for (name, bytes) in &contents.sections {
        row(name, *bytes);
    }
    row(&format!("code and constants (limit {})", program.code_limit()), contents.code());
    row(&format!("stack, most used (limit {STACK_LIMIT}, room {})", contents.stack_room), u64::from(stack));
    row("detector, within .bss", u64::from(detector));
    // The names are the same for every profile.
    for ((name, _), bytes) in QvgaDetector::BUFFERS.iter().zip(buffers) {
        row(&format!("— {name}"), u64::from(*bytes));
    }
    row("— all else", u64::from(detector - buffers.iter().sum::<u32>()));
    out
}

/// What the stages cost.
#[must_use]
pub fn cost(reports: &[Report]) -> String {
    let mut out = format!("| stage, {} frames | instructions, median | most |\n| --- | --- | --- |\n", reports.len());
    let mut row = |name: &str, mut counts: Vec<u64>| {
        counts.sort_unstable();
        let (median, most) = (counts.get(counts.len() / 2).copied(), counts.last().copied());
        // Writing to a string does not fail.
        let _ = writeln!(out, "| {name} | {} | {} |", median.unwrap_or(0), most.unwrap_or(0));
    };
    for (i, stage) in Stage::ALL.iter().enumerate() {
        row(stage.name(), reports.iter().map(|r| r.instructions()[i]).collect());
    }
    row("total", reports.iter().map(|r| r.instructions().iter().sum()).collect());
    out
}
