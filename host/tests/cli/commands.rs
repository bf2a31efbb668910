//! The page that has the help of every command: `docs/commands.md`.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::program::assets;

/// The page, made of what the program says.
fn page() -> String {
    let mut page = String::from(
        "# All commands\n\n\
         What `keygraph help COMMAND` says. A test holds this page to it;\n\
         `KEYGRAPH_WRITE=1 cargo test -p keygraph --test cli commands` writes it again.\n\
         `keygraph extras DIR` writes it as pages of the manual, and completions for shells.\n",
    );
    let overview = keygraph!("help").ended_with(0).out;
    let commands = overview.lines().skip_while(|l| *l != "Commands:").skip(1).take_while(|l| !l.is_empty());
    let names = commands.filter(|l| !l.starts_with("   ")).filter_map(|l| l.split_whitespace().next());
    for name in names.filter(|name| *name != "help") {
        let help = keygraph!("help", name).ended_with(0).out;
        let text: Vec<_> = help.lines().map(str::trim_end).collect();
        write!(page, "\n## keygraph {name}\n\n```text\n{}\n```\n", text.join("\n").trim_end()).unwrap();
    }
    page
}

#[test]
fn the_page_of_commands_is_what_the_program_says() {
    let path: &Path = &assets().join("../docs/commands.md");
    let page = page();
    assert!(page.matches("\n## keygraph ").count() > 8, "{page}");
    if std::env::var_os("KEYGRAPH_WRITE").is_some() {
        fs::write(path, &page).unwrap();
    }
    let written = fs::read_to_string(path).unwrap();
    assert!(
        written == page,
        "docs/commands.md is out of date: KEYGRAPH_WRITE=1 cargo test -p keygraph --test cli commands"
    );
}
