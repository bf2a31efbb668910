//! `keygraph demo`: the whole path on the pictures of the repository.

use std::path::PathBuf;

use anyhow::Result;
use keygraph::demo::demo;

/// Arguments of `keygraph demo`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The repository's assets
    #[arg(long, default_value = "assets")]
    assets: PathBuf,
    /// Folder for models and annotated frames
    #[arg(long, default_value = "out/demo")]
    out: PathBuf,
}

/// Trains, searches and prints a summary.
///
/// # Errors
/// When the assets cannot be read, or the folder cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    demo(&arguments.assets, &arguments.out).map(|_| ())
}
