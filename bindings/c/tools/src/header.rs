//! The header. In: the sources of the crate, and cbindgen.toml. Out: include/keygraph.h.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

fn crate_folder() -> Result<&'static Path> {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("the tools lie in bindings/c")
}

fn path() -> Result<PathBuf> {
    Ok(crate_folder()?.join("include/keygraph.h"))
}

fn made() -> Result<String> {
    let folder = crate_folder()?;
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).map_err(anyhow::Error::msg)?;
    let mut text = Vec::new();
    cbindgen::Builder::new().with_crate(folder).with_config(config).generate()?.write(&mut text);
    Ok(String::from_utf8(text)?)
}

/// Fails if the file is not what the crate makes.
pub fn compare() -> Result<()> {
    let (made, there) = (made()?, fs::read_to_string(path()?).unwrap_or_default());
    if let Some((n, (ours, _))) = (1..).zip(made.lines().zip(there.lines())).find(|(_, (a, b))| a != b) {
        bail!("include/keygraph.h differs from the crate in line {n}, which should be:\n{ours}\n{HOW}");
    }
    if made != there {
        bail!("include/keygraph.h has another length than the crate makes\n{HOW}");
    }
    Ok(())
}

const HOW: &str = "run: cargo run --manifest-path bindings/c/Cargo.toml -p keygraph-c-tools -- header --write";

/// Writes the file.
pub fn write() -> Result<()> {
    fs::write(path()?, made()?).context("include/keygraph.h")
}
