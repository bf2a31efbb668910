//! Checks the rules of the house that a compiler does not check.
//!
//! A file imports only from files above it: in core, where folders are layers, and in host. A file
//! of core says at its top what goes in, what comes out and what it costs. ARCHITECTURE.md lists
//! the files in their order. No file has more than 600 lines without a reason given in it.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::fs;
use std::path::{Path, PathBuf};

use keygraph_tests::file;

/// Maximum number of lines of a file that gives no reason for more.
const MAX_LINES: usize = 600;

/// Words with which a file gives its reason for more lines.
const REASON: &str = "More than 600 lines: ";

/// Words that the opening comment of a file must contain, in small or capital letters.
const OPENING: [&str; 4] = ["in:", "out:", "memory", "cost"];

/// Files whose opening comment may leave out some of these words, and the reason.
const WITHOUT: [(&str, &[&str]); 3] = [
    // This file is no stage. It holds constants and names.
    ("base::capacity", &["in:", "out:", "memory", "cost"]),
    // These files hold pure functions of a few numbers. They use no memory, and their code shows the cost.
    ("base::math", &["memory", "cost"]),
    ("base::geometry", &["memory", "cost"]),
];

/// A file of a package.
struct Module {
    /// Path of the file from the crate's root, such as `image::frame`.
    path: String,
    text: String,
}

/// Returns the names of the modules that a file declares, in their order. Modules that only tests
/// have are left out.
fn declared(text: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut test = false;
    for line in text.lines().map(str::trim) {
        let rest = line.strip_prefix("pub ").unwrap_or(line);
        if let Some(name) = rest.strip_prefix("mod ").and_then(|r| r.strip_suffix(';'))
            && !test
        {
            names.push(name.to_string());
        }
        test = line == "#[cfg(test)]";
    }
    names
}

/// Returns the files of a package in the order in which its `lib.rs`, and the `mod.rs` of its
/// folders, declare them. The `mod.rs` of a folder comes after the files of the folder.
fn modules(root: &str) -> Vec<Module> {
    fn collect(folder: &Path, prefix: &str, text: &str, out: &mut Vec<Module>) {
        for name in declared(text) {
            let path = format!("{prefix}{name}");
            let inner = folder.join(&name);
            let source = if inner.is_dir() { inner.join("mod.rs") } else { folder.join(format!("{name}.rs")) };
            let text = fs::read_to_string(&source).unwrap_or_else(|e| panic!("{}: {e}", source.display()));
            if inner.is_dir() {
                collect(&inner, &format!("{path}::"), &text, out);
            }
            out.push(Module { path, text });
        }
    }
    let mut out = Vec::new();
    let folder = file(root);
    let text = fs::read_to_string(folder.join("lib.rs")).unwrap();
    collect(&folder, "", &text, &mut out);
    out
}

/// Returns the part of a file before its test module, without comments and strings.
fn code(text: &str) -> String {
    let mut out = String::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let tests = |l: &&str| l.starts_with("mod ") || l.starts_with("pub(crate) mod ");
        if line.trim() == "#[cfg(test)]" && lines.peek().is_some_and(tests) {
            break;
        }
        let line = line.split("//").next().unwrap_or_default();
        // Every second piece between quotation marks lies in a string.
        out.extend(line.split('"').step_by(2));
        out.push('\n');
    }
    out
}

/// Returns the paths in `code` that start at the crate's root, such as `image::frame::Frame`.
/// Takes the lists of `use crate::{a::X, b::Y}` apart. A path that starts with `super` starts at
/// `parent`.
fn imports(code: &str, parent: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (start, prefix) in [("crate::", ""), ("super::", parent)] {
        for (at, _) in code.match_indices(start) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '$' || c == ':') {
                continue;
            }
            // A module inside of the file imports from the file itself.
            let line = code[..at].rsplit('\n').next().unwrap_or_default();
            if start == "super::" && line.starts_with(' ') && line.trim() == "use" {
                continue;
            }
            expand(prefix, &code[at + start.len()..], &mut found);
        }
    }
    found
}

/// Appends the paths that `text` starts with: one, or those of a list in brackets.
fn expand(prefix: &str, text: &str, found: &mut Vec<String>) {
    let text = text.trim_start();
    if let Some(list) = text.strip_prefix('{') {
        let (mut depth, mut entry) = (0, 0);
        for (i, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' | '}' if depth == 0 => {
                    if !list[entry..i].trim().is_empty() {
                        expand(prefix, &list[entry..i], found);
                    }
                    entry = i + 1;
                    if c == '}' {
                        break;
                    }
                }
                _ => {}
            }
        }
        return;
    }
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    let path = if prefix.is_empty() { text[..end].to_string() } else { format!("{prefix}::{}", &text[..end]) };
    match text[end..].strip_prefix("::") {
        Some(rest) => expand(&path, rest, found),
        None if end > 0 => found.push(path),
        None => {}
    }
}

#[test]
fn imports_are_found_in_every_form() {
    let text = "use crate::a::X;\nuse crate::{b::{Y, sub::Z}, c};\nlet v = crate::d::f(super::e::G); // crate::no\n\
                let s = \"crate::no\"; fn x() -> crate::h::I {}\n#[cfg(test)]\nmod tests { use crate::no; }";
    assert_eq!(imports(&code(text), "p"), ["a::X", "b::Y", "b::sub::Z", "c", "d::f", "h::I", "p::e::G"]);
}

/// Checks that the files of a package import only from files above them. Paths name a file by the
/// longest module that they start with. `depth` is the number of names that count: with 1, a
/// folder is one room.
fn check_order(root: &str, depth: usize) {
    let cut = |path: &str| path.split("::").take(depth).collect::<Vec<_>>().join("::");
    let modules = modules(root);
    let mut rooms: Vec<String> = Vec::new();
    for m in &modules {
        if rooms.last() != Some(&cut(&m.path)) {
            rooms.push(cut(&m.path));
        }
    }
    assert!(rooms.len() >= 15, "{root}/lib.rs declares only {rooms:?}");
    let mut wrong = Vec::new();
    for m in &modules {
        let parent = m.path.rsplit_once("::").map_or("", |(parent, _)| parent);
        let place = rooms.iter().position(|r| *r == cut(&m.path)).unwrap();
        for import in imports(&code(&m.text), parent) {
            // The longest room that the path starts with.
            let starts = |room: &&String| import == **room || import.starts_with(&format!("{room}::"));
            match rooms.iter().filter(starts).max_by_key(|r| r.len()) {
                None => wrong.push(format!("{}: crate::{import} is in no file", m.path)),
                Some(room) => {
                    let above = rooms.iter().position(|r| r == room).unwrap();
                    if above > place || (above == place && *room != cut(&m.path)) {
                        wrong.push(format!("{} imports {import}, which is declared below it", m.path));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn files_of_core_import_only_from_files_above_them() {
    check_order("core/src", 2);
}

#[test]
fn files_of_host_import_only_from_files_above_them() {
    check_order("host/src", 1);
}

/// Returns all Rust files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.unwrap().path();
        if path.is_dir() {
            if !path.ends_with("target") {
                out.extend(files(&path));
            }
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
    out
}

#[test]
fn every_file_of_core_is_declared() {
    let declared = modules("core/src").len() + 1;
    assert_eq!(files(&file("core/src")).len(), declared, "some file of core/src is declared nowhere");
}

#[test]
fn every_layer_of_core_states_its_rule() {
    for m in modules("core/src").iter().filter(|m| !m.path.contains("::")) {
        assert!(m.text.starts_with("//!") && m.text.contains("//! Rule: "), "core/src/{}/mod.rs has no rule", m.path);
        let code = code(&m.text);
        let only_declares = code.lines().map(str::trim).all(|l| l.is_empty() || l.starts_with("pub mod "));
        assert!(only_declares, "core/src/{}/mod.rs does more than declare its files", m.path);
    }
}

#[test]
fn files_open_with_what_goes_in_and_out_and_what_it_costs() {
    let mut missing = Vec::new();
    for m in modules("core/src").iter().filter(|m| m.path.contains("::")) {
        let opening: Vec<&str> = m.text.lines().take_while(|l| l.starts_with("//!")).collect();
        let opening = opening.join("\n").to_lowercase();
        let excused = WITHOUT.iter().find(|(path, _)| *path == m.path).map_or(&[][..], |(_, w)| w);
        for word in OPENING {
            if opening.is_empty() || !(opening.contains(word) || excused.contains(&word)) {
                missing.push(format!("{} opens without {word:?}", m.path));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

/// Returns the names in code style in the first cells of the tables of a section.
fn first_cells(text: &str, section: &str) -> Vec<String> {
    let body = text.split("\n## ").find(|s| s.starts_with(section));
    let body = body.unwrap_or_else(|| panic!("ARCHITECTURE.md has no section {section:?}"));
    let cells = body.lines().filter(|l| l.starts_with("| `")).filter_map(|l| l.split('|').nth(1));
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2).map(String::from)).collect()
}

#[test]
fn the_architecture_lists_the_files_in_their_order() {
    let text = fs::read_to_string(file("ARCHITECTURE.md")).unwrap();
    let core = modules("core/src").into_iter().map(|m| m.path).filter(|p| p.contains("::"));
    let core: Vec<String> = core.map(|p| p.rsplit_once("::").unwrap().1.to_string()).collect();
    assert_eq!(first_cells(&text, "Core"), core, "core's tables beside core/src");
    let host = modules("host/src").into_iter().map(|m| m.path).filter(|p| !p.contains("::"));
    let host: Vec<String> = host.chain(["main".into(), "cli".into()]).collect();
    assert_eq!(first_cells(&text, "Host"), host, "host's table beside host/src");
}

#[test]
fn files_are_short_enough_to_read_or_say_why_not() {
    for package in ["core", "host", "tests", "benches", "fuzz", "firmware-sim", "bindings", "boards"] {
        for path in files(&file(package)) {
            let text = fs::read_to_string(&path).unwrap();
            let lines = text.lines().count();
            let reason = text.lines().any(|l| l.starts_with("//! ") && l.contains(REASON));
            assert!(lines <= MAX_LINES || reason, "{} has {lines} lines: split it", path.display());
        }
    }
}
