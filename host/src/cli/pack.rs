//! `keygraph pack`: models into one file.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use keygraph::output::print_line;
use keygraph::words;

use super::model_files::{load, parse};

/// Arguments of `keygraph pack`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Models to merge
    #[arg(required = true, value_name = "MODEL.kgm")]
    models: Vec<PathBuf>,
    /// Model file to write
    #[arg(short, long, value_name = "ALL.kgm")]
    output: PathBuf,
}

/// Merges the models and writes the file.
///
/// # Errors
/// When a model cannot be read or does not go with the others, or the file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { models, output } = arguments;
    let packed = load(models)?;
    let model = parse(&packed, models)?;
    fs::write(output, &packed).with_context(|| format!("cannot write {}", output.display()))?;
    print_line(&format!("{} objects\n{}", model.objects(), words::model(&model, output)))
}
