//! `keygraph order`: which models cameras are to run, for the topic that they follow.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use keygraph::camera::mqtt::order::Order;
use keygraph::output::print_line;
use keygraph_core::{Model, packed_len};

use super::model_files::{parse_all, read_all};

/// Arguments of `keygraph order`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Models that all cameras are to run
    #[arg(required = true, value_name = "MODEL.kgm")]
    models: Vec<PathBuf>,
    /// Address of the folder on the web server from which cameras fetch the files, under their names
    #[arg(long, value_name = "URL")]
    url: String,
    /// Name of this order, which cameras report [default: one made of the files' hashes]
    #[arg(long)]
    version: Option<String>,
}

/// Prints the order.
///
/// # Errors
/// When a model cannot be read, is damaged, or does not go with the others.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { models: paths, url, version } = arguments;
    let read = read_all(paths)?;
    let models = parse_all(&read, paths)?;
    // A single one need not be packed, and may be slim.
    if models.len() > 1 {
        if let Some(slim) = models.iter().position(Model::is_slim) {
            bail!("{} is slim: it must be the only model", paths[slim].display());
        }
        packed_len(&models).context("the models do not go together")?;
    }
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let files: Vec<_> = paths.iter().map(|path| name(path)).zip(read).collect();
    print_line(&serde_json::to_string(&Order::of_files(url, version.clone(), &files)?)?)
}
