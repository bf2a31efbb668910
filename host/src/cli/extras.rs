//! `keygraph extras`: completions of shells and pages of the manual, as files.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::CommandFactory;
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use keygraph::output::{print_line, write_file};

use super::Cli;

/// Arguments of `keygraph extras`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Folder to write; it gets the folders `completions` and `man1`
    folder: PathBuf,
}

/// Writes the files.
///
/// # Errors
/// When a file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let [completions, manual] = ["completions", "man1"].map(|name| arguments.folder.join(name));
    for folder in [&completions, &manual] {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let mut command = Cli::command();
    command.build();
    let mut files = Vec::new();
    for (shell, name) in [(Shell::Bash, "keygraph"), (Shell::Zsh, "_keygraph"), (Shell::Fish, "keygraph.fish")] {
        let mut text = Vec::new();
        generate(shell, &mut command, "keygraph", &mut text);
        files.push((completions.join(name), text));
    }
    let commands = command.get_subcommands().filter(|c| c.get_name() != "help");
    for page in std::iter::once(&command).chain(commands) {
        // A page of a command is named as those of git are: keygraph-train.
        let name =
            if page.get_name() == "keygraph" { "keygraph".into() } else { format!("keygraph-{}", page.get_name()) };
        let mut text = Vec::new();
        Man::new(page.clone().display_name(name.clone())).title(name.clone()).render(&mut text)?;
        files.push((manual.join(format!("{name}.1")), text));
    }
    for (path, text) in &files {
        write_file(path, |file| Ok(file.write_all(text)?))?;
        print_line(&path.display().to_string())?;
    }
    Ok(())
}
