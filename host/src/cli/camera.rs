//! `keygraph camera`: live, in front of a camera.

use std::path::PathBuf;

use anyhow::Result;
use clap::error::ErrorKind;
use keygraph::camera::{arguments, camera};
use keygraph::region::Unsuitable;

use super::model_files::expanded;
use super::usage_error;

/// Arguments of `keygraph camera`.
#[derive(Debug, clap::Args)]
#[group(skip)]
pub struct Arguments {
    /// File with these options, in TOML: `threshold = 0.7`. Those of the command line and of the environment win
    #[arg(long, value_name = "FILE.toml")]
    #[allow(dead_code, reason = "super::config reads it before the other arguments")]
    config: Option<PathBuf>,
    #[command(flatten)]
    all: arguments::Arguments,
}

/// Searches the camera's frames until it is told to stop.
///
/// # Errors
/// When a model or the source cannot be read, or the page's address cannot be bound.
pub fn run(arguments: &Arguments) -> Result<()> {
    let arguments = &arguments.all;
    let arguments = arguments::Arguments { models: expanded(&arguments.models)?, ..arguments.clone() };
    match camera(&arguments) {
        Err(e) if e.is::<Unsuitable>() => usage_error(ErrorKind::ValueValidation, format!("{e:#}")),
        ended => ended,
    }
}
