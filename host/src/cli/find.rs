//! `keygraph find`: the object of one picture in others, without a model file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::slice;

use anyhow::{Context, Result};
use clap::error::ErrorKind;
use keygraph::advice;
use keygraph::learn::{Plan, train};
use keygraph::notice::notice;
use keygraph::output::plain;
use keygraph::picture::{Framed, read_framed};
use keygraph_core::Model;

use super::detect::{Search, search};
use super::model_files::is_model;
use super::train::{check_colour, name_of};
use super::usage_error;

/// Arguments of `keygraph find`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Picture that shows the object, from the front, and nothing else
    picture: PathBuf,
    #[command(flatten)]
    search: Search,
}

/// Trains on the picture, and searches the inputs.
///
/// # Errors
/// When the picture cannot be read or used, and as `detect`.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    arguments.search.check();
    let path = &arguments.picture;
    if is_model(path) {
        let shown = plain(&path.display().to_string()).into_owned();
        usage_error(ErrorKind::ValueValidation, format!("{shown} is a model: use `keygraph detect -m {shown}`"));
    }
    let model = model_of(path, &read_framed(path, None)?)?;
    search(&model, slice::from_ref(path), &arguments.search)
}

/// The model of a picture that was read from `path`. What makes it less useful than it looks is said.
///
/// # Errors
/// When the picture cannot be used.
pub fn model_of(path: &Path, framed: &Framed) -> Result<Vec<u8>> {
    let label = plain(&path.display().to_string()).into_owned();
    for said in advice::framing(framed, path, None) {
        notice(&plain(&said));
    }
    let (plan, name) = (Plan::default(), name_of(path));
    check_colour(&framed.picture, &label, &plan)?;
    let trained = train(&framed.picture, &name, plan.preset, plan.luma);
    let (bytes, trained) = trained.with_context(|| format!("cannot train on {label}"))?;
    for said in advice::of_model(&label, &name, &framed.picture, &Model::parse(&bytes)?, &trained)?.warnings {
        notice(&plain(&said));
    }
    Ok(bytes)
}
