//! The command line.
use std::path::PathBuf;
use anyhow::{Context, Result};
use clap::{Parser, Subcommand};
use keygraph::learn::{Preset, train};
use keygraph::search::{Profile, search};
use keygraph::{input, report};
use keygraph_core::model::Model;

#[derive(Parser)]
struct Cli { #[command(subcommand)] command: Command }
#[derive(Subcommand)]
enum Command {
    Train { picture: PathBuf, #[arg(short)] output: PathBuf, #[arg(long)] name: Option<String>, #[arg(long, value_enum, default_value="large")] preset: Preset, #[arg(long)] luma: bool, #[arg(long)] json: bool },
    Detect { #[arg(short)] model: PathBuf, input: Vec<PathBuf>, #[arg(long)] json: bool, #[arg(long, value_enum, default_value="vga")] profile: Profile, #[arg(long, default_value_t=0.5)] threshold: f32, #[arg(long)] threads: Option<usize> },
}
fn main() -> Result<()> {
    match Cli::parse().command {
        Command::Train { picture, output, name, preset, luma, json: _ } => {
            let p = input::read_picture(&picture)?;
            let name = name.unwrap_or_else(|| picture.file_stem().unwrap_or_default().to_string_lossy().into_owned());
            let t = std::time::Instant::now();
            let (bytes, trained) = train(&p, &name, preset, luma)?;
            eprintln!("{:?} {:?} {:?}", t.elapsed(), trained.view_keypoints, trained.keygraphs);
            std::fs::write(&output, &bytes)?;
            println!("{}", report::model_object(&Model::parse(&bytes)?));
        }
        Command::Detect { model, input, profile, threshold, .. } => {
            let bytes = std::fs::read(&model).context("model")?;
            let model = Model::parse(&bytes)?;
            for f in input::Source::open(&input)? {
                let p = f.picture?;
                let found = search(&p, &model, profile, threshold, false, 0)?;
                println!("{}", report::frame_line(&f.source, f.frame, (p.width, p.height), &model, &found));
            }
        }
    }
    Ok(())
}
