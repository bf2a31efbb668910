//! `keygraph explain`: why an object is found in a frame, or is not.

use std::fmt::Write;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::error::ErrorKind;
use keygraph::explain::{Topic, explain};
use keygraph::input::{Source, is_stdin, shown};
use keygraph::output::{Inputs, check_output, plain, print_line, tell_written, write_file};
use keygraph::picture::read_framed;
use keygraph::search::{Profile, Request, depth_of, parse_threshold};
use keygraph_core::{DEFAULT_THRESHOLD, Model};

use super::find::model_of;
use super::model_files::is_model;
use super::usage_error;

/// Arguments of `keygraph explain`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Picture that shows the object, from the front, and nothing else
    picture: PathBuf,
    /// Picture, video or address in which it is looked for
    frame: PathBuf,
    /// Folder to write: explain.md, and a picture of each stage
    #[arg(short, long, value_name = "DIR", default_value = "explain")]
    output: PathBuf,
    /// Index of the frame in a video
    #[arg(long, default_value_t = 0, value_name = "N")]
    index: u64,
    /// Size that the frame is searched at; a larger one is scaled down
    #[arg(long, value_enum, default_value = "vga")]
    profile: Profile,
    /// Minimum score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD, value_parser = parse_threshold)]
    threshold: f32,
    /// Search all of the frame, as `detect --thorough` does
    #[arg(long)]
    thorough: bool,
}

/// Explains the search of one frame.
///
/// # Errors
/// When the picture or the frame cannot be read, or a file cannot be written.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { picture, frame, output, .. } = arguments;
    for path in [picture, frame] {
        if is_model(path) {
            let shown = plain(&path.display().to_string()).into_owned();
            usage_error(
                ErrorKind::ValueValidation,
                format!("{shown} is a model: give the picture that it was trained on"),
            );
        }
    }
    // Before the work: what would not be written is said at once.
    fs::create_dir_all(output).with_context(|| format!("cannot make the folder {}", output.display()))?;
    let inputs = Inputs::of([picture.as_path(), frame.as_path()]);
    for name in Topic::ALL.map(Topic::file_name).into_iter().chain(["explain.md".into()]) {
        check_output(&output.join(name), &inputs)?;
    }
    let framed = read_framed(picture, None)?;
    let bytes = model_of(picture, &framed)?;
    let model = Model::parse(&bytes)?;
    let seen = nth_frame(frame, arguments.index)?;
    let request =
        Request { depth: depth_of(arguments.thorough), ..Request::new(arguments.profile, arguments.threshold) };
    let explanation = explain(&model, &framed.picture, &seen, &request)?;
    let [of, within] = [picture, frame].map(|path| plain(&shown(path)).replace('`', "'"));
    let mut page = format!("# Why\n\n`{of}` in `{within}`: {}\n", plain(&explanation.verdict));
    print_line(&plain(&explanation.verdict))?;
    if !explanation.advice.is_empty() {
        page.push_str("\n## What to do\n\n");
    }
    for advice in &explanation.advice {
        writeln!(page, "- {advice}")?;
        print_line(&format!("- {advice}"))?;
    }
    for topic in Topic::ALL {
        let (title, name) = (topic.title(), topic.file_name());
        let path = output.join(&name);
        let Some(chapter) = explanation.chapters.iter().find(|c| c.topic == topic) else {
            // That of a run before would show another frame.
            let _ = fs::remove_file(&path);
            continue;
        };
        chapter.canvas.save(&path)?;
        write!(page, "\n## {title}\n\n{}\n\n![{title}]({name})\n", chapter.text)?;
    }
    let path = output.join("explain.md");
    write_file(&path, |file| Ok(file.write_all(page.as_bytes())?))?;
    tell_written(&path);
    Ok(ExitCode::SUCCESS)
}

/// Frame `index` of an input.
fn nth_frame(path: &Path, index: u64) -> Result<keygraph::input::Picture> {
    let name = if is_stdin(path) { "standard input".into() } else { shown(path) };
    let mut source = Source::open(std::slice::from_ref(&path.to_path_buf()))?;
    let frame = source.nth(usize::try_from(index)?);
    frame.with_context(|| format!("{name} has no frame {index}"))?.picture
}
