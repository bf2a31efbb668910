//! Checks the statements of the README and of the pages in docs that a machine can check.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use keygraph::input::read_picture;
use keygraph::learn::{Preset, train};
use keygraph::search::Profile as Size;
use keygraph_core::Model;
use keygraph_tests::file;

/// Maximum number of lines of the README.
const MAX_LINES: usize = 200;

/// The page with the memory table.
const BOARD: &str = "docs/tutorials/board.md";

/// Returns the README and all pages in docs: the path of each from the repository's folder, and its text.
fn pages() -> Vec<(String, String)> {
    fn collect(folder: &Path, name: &str, out: &mut Vec<(String, String)>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = format!("{name}/{}", path.file_name().unwrap().to_string_lossy());
            if path.is_dir() {
                collect(&path, &name, out);
            } else if path.extension().is_some_and(|e| e == "md") {
                out.push((name, fs::read_to_string(&path).unwrap()));
            }
        }
    }
    let mut out = vec![("README.md".to_string(), fs::read_to_string(file("README.md")).unwrap())];
    collect(&file("docs"), "docs", &mut out);
    out
}

/// Checks that the README can be read in one go.
#[test]
fn the_readme_is_short() {
    let lines = fs::read_to_string(file("README.md")).unwrap().lines().count();
    assert!(lines <= MAX_LINES, "README.md has {lines} lines; it may have {MAX_LINES}: move a part to a page in docs");
}

/// Checks that the memory table gives the sizes of the types.
#[test]
fn sizes_of_the_detectors() {
    let profiles = [
        ("qqvga", 160, 120, Size::Qqvga.memory().0),
        ("qvga", 320, 240, Size::Qvga.memory().0),
        ("vga", 640, 480, Size::Vga.memory().0),
        ("hd", 1280, 720, Size::Hd.memory().0),
    ];
    let rows: Vec<String> = profiles
        .iter()
        .map(|(name, w, h, size)| {
            let with_frame = size + 2 * w * h;
            format!("| {name} | {w}x{h} | {} KB | {} KB |", size.div_ceil(1024), with_frame.div_ceil(1024))
        })
        .collect();
    let page = fs::read_to_string(file(BOARD)).unwrap();
    let missing: Vec<&String> = rows.iter().filter(|r| !page.contains(*r)).collect();
    assert!(missing.is_empty(), "{BOARD} lacks these rows of its memory table:\n{missing:#?}");
}

/// Checks that the scripts that the README and the pages in docs name exist.
#[test]
fn commands_exist() {
    let mut count = 0;
    let mut missing = Vec::new();
    for (page, text) in pages() {
        for (at, _) in text.match_indices("scripts/") {
            let rest = &text[at..];
            let command = rest.split(|c: char| !c.is_ascii_alphanumeric() && !"/-_.".contains(c)).next().unwrap_or("");
            // The full stop of a sentence is no part of a name.
            let path = file(command.trim_end_matches('.'));
            count += 1;
            // A Python package is run by the name of its folder.
            if !path.is_file() && !path.join("__main__.py").is_file() {
                missing.push(format!("{page}: {command}"));
            }
        }
    }
    assert!(count > 40, "{count} are too few to be all");
    assert!(missing.is_empty(), "these scripts do not exist:\n{missing:#?}");
}

/// Formats a number with commas between thousands, or a range of two.
fn range(values: &[u64]) -> String {
    let with_commas = |n: u64| {
        let digits = n.to_string();
        let parts: Vec<_> =
            digits.as_bytes().rchunks(3).rev().map(|c| String::from_utf8(c.to_vec()).unwrap()).collect();
        parts.join(",")
    };
    let (low, high) = (*values.iter().min().unwrap(), *values.iter().max().unwrap());
    if low == high { with_commas(low) } else { format!("{} to {}", with_commas(low), with_commas(high)) }
}

/// Checks that the table beside the paper gives the sizes of models that are trained now.
#[test]
fn the_sizes_beside_the_paper_are_those_of_models() {
    let mut rows = [const { Vec::new() }; 5];
    for preset in [Preset::Paper, Preset::Standard, Preset::Large] {
        let mut values = [const { Vec::new() }; 5];
        for name in ["astronaut", "coffee", "chelsea"] {
            let picture = read_picture(&file(&format!("assets/pictures/{name}.jpg"))).unwrap();
            let (bytes, trained) = train(&picture, name, preset, false).unwrap();
            let model = Model::parse(&bytes).unwrap();
            let (used, largest) = model.occupancy();
            let of = [trained.keypoints(), model.object(0).triples as usize, model.keygraphs(), used, largest];
            values.iter_mut().zip(of).for_each(|(all, v)| all.push(v as u64));
        }
        rows.iter_mut().zip(values).for_each(|(row, v)| row.push(range(&v)));
    }
    let page = fs::read_to_string(file("docs/measured.md")).unwrap();
    for (name, row) in ["keypoints", "triples possible", "keygraphs", "subsets used", "largest subset"].iter().zip(rows)
    {
        let mut section = page.lines().skip_while(|l| *l != "## The paper, and ours");
        let line = section.find(|l| l.starts_with(&format!("| {name} |"))).unwrap();
        assert!(
            line.ends_with(&format!("| {} |", row.join(" | "))),
            "{name} of this build: {row:?}; on the page: {line}"
        );
    }
}

/// Returns the anchors of a page: those that its headings get, as GitHub and mdBook make them.
fn anchors(text: &str) -> Vec<String> {
    let mut code = false;
    let mut out = Vec::new();
    for line in text.lines() {
        code ^= line.trim_start().starts_with("```");
        if line.starts_with('#') && !code {
            let title = line.trim_start_matches('#').trim().to_lowercase();
            out.push(
                title
                    .chars()
                    .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
                    .collect::<String>()
                    .replace(' ', "-"),
            );
        }
    }
    out
}

/// Returns the targets of the links of a page, outside of code.
fn links(text: &str) -> Vec<String> {
    let mut outside = String::new();
    let mut code = false;
    for line in text.lines() {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        if !code && !fence {
            // Every second piece between backquotes is code.
            outside.extend(line.split('`').step_by(2));
            outside.push('\n');
        }
    }
    let ends = |at: usize| Some(outside[at + 2..].split_once(')')?.0.to_string());
    outside.match_indices("](").filter_map(|(at, _)| ends(at)).collect()
}

/// Checks that every link between pages of the repository leads to a file, and to a heading of it.
#[test]
fn links_lead_somewhere() {
    let more = [
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "SECURITY.md",
        "assets/README.md",
        "boards/README.md",
        "firmware-sim/README.md",
        "bindings/c/README.md",
        "bindings/python/README.md",
        "bindings/web/README.md",
        "bindings/gstreamer/README.md",
    ];
    let mut all = pages();
    all.extend(more.map(|page| (page.to_string(), fs::read_to_string(file(page)).unwrap())));
    let (mut count, mut wrong) = (0, Vec::new());
    for (page, text) in &all {
        for link in links(text).iter().filter(|l| !l.contains("://")) {
            count += 1;
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { file(page) } else { file(page).parent().unwrap().join(path) };
            if !target.exists() {
                wrong.push(format!("{page}: no file {link}"));
            } else if !anchor.is_empty()
                && !anchors(&fs::read_to_string(&target).unwrap()).contains(&anchor.to_string())
            {
                wrong.push(format!("{page}: no heading {link}"));
            }
        }
    }
    assert!(count > 150, "only {count} links");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Checks that the site has every page in docs.
#[test]
fn the_site_has_every_page() {
    let summary = fs::read_to_string(file("docs/SUMMARY.md")).unwrap();
    let listed = links(&summary);
    let pages = pages().into_iter().filter_map(|(page, _)| Some(page.strip_prefix("docs/")?.to_string()));
    let missing: Vec<_> = pages.filter(|page| page != "SUMMARY.md" && !listed.contains(page)).collect();
    assert!(missing.is_empty(), "docs/SUMMARY.md lacks {missing:?}");
}
