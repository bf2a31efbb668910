//! `keygraph pack`: models into one file.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use keygraph::notice::{is_quiet, notice};
use keygraph::output::{Inputs, check_model_output, print_line, write_file};
use keygraph::words;

use super::compare::{Shared, tell_among};
use super::model_files::{merged, parse, read_all};

/// Maximum number of objects that are compared without being asked.
const COMPARED: usize = 32;

/// Arguments of `keygraph pack`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Models to merge
    #[arg(required = true, value_name = "MODEL.kgm")]
    models: Vec<PathBuf>,
    /// Model file to write
    #[arg(short, long, value_name = "ALL.kgm")]
    output: PathBuf,
    /// Tell which objects look alike, however many there are [default: up to 32 objects]
    #[arg(long)]
    compare: bool,
    #[command(flatten)]
    shared: Shared,
}

/// Merges the models, writes the file and tells which objects look alike.
///
/// # Errors
/// When a model cannot be read or does not go with the others, or the file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { models, output, compare, shared } = arguments;
    check_model_output(output, &Inputs::of(models.iter().map(PathBuf::as_path)))?;
    let parts = read_all(models)?;
    let packed = merged(&parts, models)?;
    let model = parse(&packed, models)?;
    write_file(output, |file| Ok(file.write_all(&packed)?))?;
    if !is_quiet() {
        print_line(&format!("{} objects\n{}", model.objects(), words::model(&model, output)))?;
    }
    if *compare || model.objects() <= COMPARED {
        return tell_among(&parts, shared);
    }
    notice(&format!("{} objects are not compared with each other: --compare tells which look alike", model.objects()));
    Ok(())
}
