//! The cost of the sample at the last measurement (`firmware-sim/baseline.json`), and the tables of
//! `firmware-sim/README.md`, which are written from it.
//!
//! In: runs on the sample. Out: a message for each figure that exceeds the baseline by more than
//! its margin, or both files, written again. Cost: negligible.
//!
//! Instructions are counted, not timed: every run of one build gives the same counts. The margins
//! allow for changes of inlining that a change elsewhere causes. For another compiler the margins
//! are [`OTHER_COMPILER`] times wider.

use std::env;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

use crate::board::{Machine, STACK_LIMIT, root};
use crate::tables::Run;

/// Maximum growth of the total, percent.
pub const TOTAL_MARGIN: u64 = 3;
/// Maximum growth of a stage, percent.
pub const STAGE_MARGIN: u64 = 10;
/// Growth that is always allowed for a stage, instructions.
pub const STAGE_FLOOR: u64 = 100_000;
/// Factor by which the margins are wider for another compiler.
pub const OTHER_COMPILER: u64 = 5;

/// Lines that stand before and behind the tables in the README.
const MARKS: [&str; 2] = ["<!-- figures: written by `scripts/board --renew` -->\n", "<!-- end of figures -->\n"];

/// Returns the path of the baseline.
///
/// # Errors
/// Fails if the runner is not inside the repository.
pub fn path() -> Result<PathBuf> {
    Ok(root()?.join("firmware-sim/baseline.json"))
}

/// Returns the path of the file with the tables.
fn readme() -> Result<PathBuf> {
    Ok(root()?.join("firmware-sim/README.md"))
}

/// Returns the name of a run in the baseline: board and profile.
fn name(run: &Run) -> String {
    let (_, machine, frames) = run.of;
    format!("{}, {}", machine.name(), frames.name())
}

/// Returns the version of the compiler that builds the firmware.
fn compiler() -> Result<String> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("--version").output().context("cannot run rustc")?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_string())
}

/// Returns the figures of a run, by name.
fn figures(run: &Run) -> Value {
    let buffers: Vec<Value> = run.buffers().iter().map(|(name, bytes)| json!([name, bytes])).collect();
    let cost: Vec<Value> = run.cost().iter().map(|(name, median, _)| json!([name, median])).collect();
    let frame = run.contents.sections.iter().find(|(name, _)| name == ".frame").map_or(0, |(_, bytes)| *bytes);
    json!({
        "code": run.contents.code(), "stack": run.stack(), "frame": frame,
        "detector": run.detector.0, "buffers": buffers, "instructions": cost,
    })
}

/// Returns the most instructions that a frame of a run took.
fn most(run: &Run) -> u64 {
    run.cost().last().map_or(0, |(_, _, most)| *most)
}

/// Most instructions between two questions whether a search goes on. With the vectors of a Cortex-M55 one stretch of the
/// hardest frames took 208,082 when this was written.
const fn longest(machine: Machine) -> u64 {
    if matches!(machine, Machine::M55) { 250_000 } else { 200_000 }
}

/// Compares a run on the sample, and one on hard frames, with the baseline. Returns one line for each
/// figure that grew beyond its margin.
///
/// # Errors
/// Fails if the baseline cannot be read, or if it has no entry for the run.
pub fn compare(run: &Run, worst: &Run) -> Result<Vec<String>> {
    let path = path()?;
    let text = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let baseline: Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let name = name(run);
    let was = baseline["boards"].get(&name).with_context(|| format!("{} has nothing of {name}", path.display()))?;
    let wider = if baseline["compiler"] == compiler()? { 1 } else { OTHER_COMPILER };
    let mut lines: Vec<String> = grown(was, &figures(run), wider).iter().map(|l| format!("{name}: {l}")).collect();
    let (before, now) = (was["worst"].as_u64().unwrap_or(0), most(worst));
    if now > before + before * wider * TOTAL_MARGIN / 100 {
        lines.push(format!("{name}: the hardest frame takes {now} instructions, more than {before}"));
    }
    let silent = run.longest().max(worst.longest());
    let most = longest(run.of.1);
    if silent > most {
        lines.push(format!("{name}: {silent} instructions pass without a question, more than {most}"));
    }
    Ok(lines)
}

/// Returns one line for each figure of `is` that exceeds `was` by more than its margin.
fn grown(was: &Value, is: &Value, wider: u64) -> Vec<String> {
    let count =
        |of: &Value, stage: &Value| of["instructions"].as_array()?.iter().find(|row| row[0] == *stage)?[1].as_u64();
    let mut lines = Vec::new();
    for row in is["instructions"].as_array().into_iter().flatten() {
        let (stage, now) = (&row[0], row[1].as_u64().unwrap_or(0));
        let Some(before) = count(was, stage) else {
            lines.push(format!("{stage} is not in the baseline"));
            continue;
        };
        let percent = wider * if stage == "total" { TOTAL_MARGIN } else { STAGE_MARGIN };
        let margin = (before * percent / 100).max(if stage == "total" { 0 } else { wider * STAGE_FLOOR });
        if now > before + margin {
            let by = 100.0 * (now as f64 / before as f64 - 1.0);
            lines.push(format!(
                "{stage} takes {now} instructions, {by:.1} % more than {before}; the margin is {percent} %"
            ));
        }
    }
    lines
}

/// Writes the baseline, and the tables that follow from it.
///
/// # Errors
/// Fails if a file cannot be read or written, or if the README has no place for the tables.
pub fn renew(runs: &[Run], worst: &[Run]) -> Result<()> {
    let board = |(run, worst): (&Run, &Run)| {
        let mut figures = figures(run);
        figures["worst"] = most(worst).into();
        (name(run), figures)
    };
    let boards: serde_json::Map<_, _> = runs.iter().zip(worst).map(board).collect();
    let baseline = json!({"compiler": compiler()?, "boards": boards});
    fs::write(path()?, format!("{}\n", serde_json::to_string_pretty(&baseline)?))
        .context("cannot write the baseline")?;
    let text = fs::read_to_string(readme()?).context("cannot read the README")?;
    let places = [text.find(MARKS[0]), text.find(MARKS[1])];
    let [Some(start), Some(end)] = places else { bail!("firmware-sim/README.md has no place for figures") };
    let whole = [&text[..start + MARKS[0].len()], "\n", &tables(&baseline), "\n", &text[end..]].concat();
    fs::write(readme()?, whole).context("cannot write the README")
}

/// Returns the tables of a baseline: two with one column per board, and what the vectors of a Cortex-M55 save.
fn tables(baseline: &Value) -> String {
    let boards: Vec<(&String, &Value)> = baseline["boards"].as_object().into_iter().flatten().rev().collect();
    let Some((_, first)) = boards.first() else { return String::new() };
    let names: Vec<&str> = boards.iter().map(|(name, _)| name.as_str()).collect();
    let head = |title: &str| format!("| {title} | {} |\n| --- |{}\n", names.join(" | "), " --- |".repeat(names.len()));
    let row = |name: &str, cell: &dyn Fn(&Value) -> String| {
        let cells: Vec<String> = boards.iter().map(|(_, board)| cell(board)).collect();
        format!("| {name} | {} |\n", cells.join(" | "))
    };
    let listed = |key: &str| first[key].as_array().into_iter().flatten().map(|row| row[0].as_str().unwrap_or_default());

    let mut out = head("bytes");
    for (key, title) in [
        ("code", format!("vectors, code, constants (limit {}, m55 {})", thousands(96 << 10), thousands(256 << 10))),
        ("stack", format!("stack, most used (limit {})", thousands(STACK_LIMIT.into()))),
        ("frame", "raw frame".into()),
        ("detector", "detector".into()),
    ] {
        out += &row(&title, &|board| thousands(board[key].as_u64().unwrap_or(0)));
    }
    for (i, name) in listed("buffers").enumerate() {
        out += &row(&format!("— {name}"), &|board| thousands(board["buffers"][i][1].as_u64().unwrap_or(0)));
    }
    out += "\n";
    out += &head("million instructions, median of 4 frames");
    for (i, name) in listed("instructions").enumerate() {
        out += &row(name, &|board| format!("{:.1}", board["instructions"][i][1].as_f64().unwrap_or(0.0) / 1e6));
    }
    out += &row("total, hardest of 51 frames", &|board| format!("{:.1}", board["worst"].as_f64().unwrap_or(0.0) / 1e6));
    out + "\n" + &vectors(&baseline["boards"])
}

/// Returns the table of what the vectors of a Cortex-M55 save: the same frames, by the code of a Cortex-M7 and by its own.
fn vectors(boards: &Value) -> String {
    let mut out = String::from(
        "| million instructions, vga, median of 4 frames | code of the M7 | code of the M55 | ratio |\n\
         | --- | --- | --- | --- |\n",
    );
    let rows = |name: &str| boards[name]["instructions"].as_array().into_iter().flatten();
    for (plain, vectors) in rows("n6, vga").zip(rows("m55, vga")) {
        let [a, b] = [plain, vectors].map(|row| row[1].as_f64().unwrap_or(0.0) / 1e6);
        let stage = plain[0].as_str().unwrap_or_default();
        out += &format!("| {stage} | {a:.1} | {b:.1} | {:.2} |\n", a / b.max(1e-6));
    }
    out
}

/// Formats a number with commas between the thousands.
fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let grouped: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|c| str::from_utf8(c).unwrap_or_default()).collect();
    grouped.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(corners: u64, vote: u64, total: u64) -> Value {
        json!({"instructions": [["corners", corners], ["vote", vote], ["total", total]]})
    }

    #[test]
    fn only_what_grows_beyond_its_margin_is_told() {
        let was = of(40_000_000, 50_000, 100_000_000);
        assert_eq!(grown(&was, &of(44_000_000, 150_000, 103_000_000), 1), [""; 0], "just within");
        assert_eq!(grown(&was, &of(10, 10, 10), 1), [""; 0], "less is well");
        let lines = grown(&was, &of(44_000_001, 150_001, 103_000_001), 1);
        assert_eq!(lines.len(), 3, "{lines:?}");
        assert!(lines[2].contains("\"total\" takes 103000001 instructions, 3.0 % more"), "{}", lines[2]);
        assert_eq!(grown(&was, &of(44_000_001, 150_001, 103_000_001), 5), [""; 0], "another compiler");
        let lines = grown(&json!({"instructions": []}), &was, 1);
        assert_eq!(lines[0], "\"corners\" is not in the baseline");
    }

    #[test]
    fn the_readme_has_the_tables_of_the_baseline() {
        let baseline: Value = serde_json::from_str(&fs::read_to_string(path().unwrap()).unwrap()).unwrap();
        let readme = fs::read_to_string(readme().unwrap()).unwrap();
        let tables = tables(&baseline);
        assert!(tables.contains("| total | "), "{tables}");
        assert!(readme.contains(&tables), "write it anew: scripts/board --renew\n{tables}");
    }

    #[test]
    fn numbers_have_commas() {
        assert_eq!([7, 1000, 98_304, 1_234_567].map(thousands), ["7", "1,000", "98,304", "1,234,567"]);
    }
}
