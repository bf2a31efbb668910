//! Checks the rules of core that a compiler does not check. A file imports only from files above
//! it, says at its top what goes in, what comes out and what it costs, and is short enough to read.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use keygraph_tests::file;

const MAX_LINES: usize = 900;

/// Words that the opening comment of a file must contain, in small or capital letters.
const OPENING: [&str; 4] = ["in:", "out:", "memory", "cost"];

/// Files whose opening comment may leave out some of these words, and the reason.
const WITHOUT: [(&str, &[&str]); 3] = [
    // This file is no stage. It holds constants and names.
    ("capacity", &["in:", "out:", "memory", "cost"]),
    // These files hold pure functions of a few numbers. They use no memory, and their code shows the cost.
    ("math", &["memory", "cost"]),
    ("geometry", &["memory", "cost"]),
];

fn source(name: &str) -> String {
    std::fs::read_to_string(file("core/src").join(format!("{name}.rs"))).unwrap()
}

/// Returns the modules in the order in which `lib.rs` declares them.
fn modules() -> Vec<String> {
    let declared = |line: &str| Some(line.trim().strip_prefix("pub mod ")?.strip_suffix(';')?.to_string());
    source("lib").lines().filter_map(declared).collect()
}

/// Returns the part of a file before its test module, without comments and strings.
fn code(text: &str) -> String {
    let mut out = String::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        if line.trim() == "#[cfg(test)]" && lines.peek().is_some_and(|l| l.starts_with("mod ")) {
            break;
        }
        let line = line.split("//").next().unwrap_or_default();
        // Every second piece between quotation marks lies in a string.
        out.extend(line.split('"').step_by(2));
        out.push('\n');
    }
    out
}

/// Returns the first name of every path that starts at the crate's root. Takes the lists of `use
/// crate::{a::X, b::Y}` apart.
fn imports(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for start in ["crate::", "super::"] {
        for (at, _) in code.match_indices(start) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == '$' || c == ':') {
                continue;
            }
            let rest = &code[at + start.len()..];
            match rest.strip_prefix('{') {
                Some(list) => found.extend(heads(list)),
                None => found.extend(name(rest)),
            }
        }
    }
    found
}

fn name(text: &str) -> Option<String> {
    let text = text.trim_start();
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    (end > 0).then(|| text[..end].to_string())
}

/// Returns the first name of each entry of a list, up to the bracket that closes the list.
fn heads(list: &str) -> Vec<String> {
    let (mut depth, mut entry, mut found) = (0, 0, Vec::new());
    for (i, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                found.extend(name(&list[entry..i]));
                entry = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    found
}

#[test]
fn imports_are_found_in_every_form() {
    let text = "use crate::a::X;\nuse crate::{b::{Y, Z}, c};\nlet v = crate::d::f(super::e::G); // crate::no\n\
                let s = \"crate::no\"; fn x() -> crate::h::I {}\n#[cfg(test)]\nmod tests { use crate::no; }";
    assert_eq!(imports(&code(text)), ["a", "b", "c", "d", "h", "e"]);
}

#[test]
fn every_file_is_declared() {
    let modules = modules();
    assert!(modules.len() >= 15, "lib.rs declares only {modules:?}");
    for entry in std::fs::read_dir(file("core/src")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_string();
        assert!(path.is_file(), "{name}: core has no folders, a stage is a file");
        assert!(name == "lib" || modules.contains(&name), "core/src/{name}.rs is not declared in lib.rs");
    }
}

#[test]
fn files_import_only_from_files_above_them() {
    let modules = modules();
    let mut wrong = Vec::new();
    for (place, module) in modules.iter().enumerate() {
        for import in imports(&code(&source(module))) {
            match modules.iter().position(|m| *m == import) {
                Some(above) if above < place => {}
                Some(_) => wrong.push(format!("{module} imports {import}, which lib.rs declares below it")),
                None => wrong.push(format!("{module} imports crate::{import}, which is no file of core")),
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn files_open_with_what_goes_in_and_out_and_what_it_costs() {
    let mut missing = Vec::new();
    for module in modules() {
        let text = source(&module);
        let opening: Vec<&str> = text.lines().take_while(|l| l.starts_with("//!")).collect();
        let opening = opening.join("\n").to_lowercase();
        let excused = WITHOUT.iter().find(|(m, _)| *m == module).map_or(&[][..], |(_, w)| w);
        for word in OPENING {
            if opening.is_empty() || !(opening.contains(word) || excused.contains(&word)) {
                missing.push(format!("core/src/{module}.rs opens without {word:?}"));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
}

#[test]
fn files_are_short_enough_to_read() {
    for module in modules() {
        let lines = source(&module).lines().count();
        assert!(lines <= MAX_LINES, "core/src/{module}.rs has {lines} lines, more than {MAX_LINES}: split it");
    }
}
