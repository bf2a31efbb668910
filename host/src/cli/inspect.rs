//! `keygraph inspect`: what is in a model.

use std::path::PathBuf;
use std::slice;

use anyhow::Result;
use keygraph::output::print_line;
use keygraph::{report, words};

use super::model_files::{load, parse};

/// Arguments of `keygraph inspect`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Model to look into
    #[arg(value_name = "MODEL.kgm")]
    model: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Prints what is in the model.
///
/// # Errors
/// When the model cannot be read.
pub fn run(arguments: &Arguments) -> Result<()> {
    let paths = slice::from_ref(&arguments.model);
    let bytes = load(paths)?;
    let model = parse(&bytes, paths)?;
    if arguments.json {
        return print_line(&report::model_object(&model).to_string());
    }
    print_line(&words::objects(&model))?;
    print_line(&words::model(&model, &arguments.model))
}
