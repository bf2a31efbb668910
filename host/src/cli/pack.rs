//! `keygraph pack`: models into one file, and its objects added, replaced and removed.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Error, Result, ensure};
use clap::{ArgGroup, value_parser};
use keygraph::learn;
use keygraph::notice::{is_quiet, notice};
use keygraph::output::{Inputs, check_model_output, print_line, write_file};
use keygraph::repack::{self, Repacked, repack};
use keygraph::words;
use keygraph_core::{Model, PackError};

use super::compare::{Shared, tell_among};
use super::model_files::{joined, parse_all, read_all};

/// Maximum number of pairs of objects that are compared without being asked: those of 32 objects.
const COMPARED: usize = 32 * 31 / 2;

/// Arguments of `keygraph pack`.
#[derive(Debug, clap::Args)]
#[command(group(ArgGroup::new("what").multiple(true)))]
#[command(override_usage = "keygraph pack [OPTIONS] -o <ALL.kgm> <MODEL.kgm>...\n       \
                            keygraph pack [OPTIONS] -m <ALL.kgm> [--add <NEW.kgm>...] [--replace <NEW.kgm>...] \
                            [--remove <NAME>...]\n       \
                            keygraph pack -m <ALL.kgm> --slim [--listed <N>] -o <SLIM.kgm>")]
pub struct Arguments {
    /// Models to merge
    #[arg(required_unless_present = "model", conflicts_with_all = ["model", "changes"], value_name = "MODEL.kgm")]
    models: Vec<PathBuf>,
    /// Model file to write [default: that of -m]
    #[arg(short, long, required_unless_present = "model", value_name = "ALL.kgm")]
    output: Option<PathBuf>,
    /// Model whose objects are changed; the models that it was packed from are not needed
    #[arg(short, long, requires = "what", value_name = "ALL.kgm")]
    model: Option<PathBuf>,
    #[command(flatten)]
    changes: Changes,
    /// Leave out what a search for all objects at once does not read, half to four fifths of the file
    ///
    /// What is seen plainly is found as with the whole file. A slim file cannot be changed or packed again: keep the
    /// models, or the whole file.
    #[arg(long, group = "what")]
    slim: bool,
    /// Maximum number of keygraphs of each object that a search for many objects compares
    ///
    /// With fewer a search takes less time, and finds a little less. Without the option there are 6,848, and fewer with
    /// more than 558 objects.
    #[arg(long, group = "what", value_name = "N", value_parser = value_parser!(u32).range(1..))]
    listed: Option<u32>,
    /// Tell which objects look alike, however many there are [default: up to 496 pairs, those of 32 objects]
    #[arg(long)]
    compare: bool,
    #[command(flatten)]
    shared: Shared,
}

/// What is changed in a model.
#[derive(Debug, clap::Args)]
#[group(id = "changes", multiple = true)]
struct Changes {
    /// Models whose objects come after those of ALL.kgm
    #[arg(long, num_args = 1.., requires = "model", group = "what", value_name = "NEW.kgm")]
    add: Vec<PathBuf>,
    /// Models whose objects take the places of those with their names
    #[arg(long, num_args = 1.., requires = "model", group = "what", value_name = "NEW.kgm")]
    replace: Vec<PathBuf>,
    /// Objects to remove, before others are replaced or added
    #[arg(long, num_args = 1.., requires = "model", group = "what", value_name = "NAME")]
    remove: Vec<String>,
}

impl Arguments {
    fn listed(&self) -> Option<usize> {
        self.listed.map(|n| n as usize)
    }
}

/// Merges models or changes one, writes the file and tells which objects look alike.
///
/// # Errors
/// When a model cannot be read or does not go with the others, a name is not known or not new, or the file
/// cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    match (&arguments.model, &arguments.output) {
        (Some(all), output) => change(arguments, all, output.as_deref()),
        (None, Some(output)) => merge(arguments, output),
        (None, None) => Ok(()),
    }
}

fn merge(arguments: &Arguments, output: &Path) -> Result<()> {
    let models = &arguments.models;
    check_model_output(output, &Inputs::of(models.iter().map(PathBuf::as_path)))?;
    let parts = read_all(models)?;
    let parts = parse_all(&parts, models)?;
    write(&joined(&parts, models, arguments.listed())?, arguments, output, "")?;
    let counts: Vec<_> = parts.iter().map(Model::objects).collect();
    compare(arguments, &parts, &counts, |_| true)
}

fn change(arguments: &Arguments, all: &Path, output: Option<&Path>) -> Result<()> {
    let Changes { add, replace, remove } = &arguments.changes;
    ensure!(
        output.is_some() || all.is_file() || !all.exists(),
        "{} is no file: say with -o which file to write",
        all.display()
    );
    ensure!(
        output.is_some() || !arguments.slim,
        "a slim file cannot be changed later: say with -o which file to write, and keep {}",
        all.display()
    );
    let new: Vec<_> = replace.iter().chain(add).cloned().collect();
    let output = output.unwrap_or(all);
    // A whole file that its slim form replaced would be lost.
    let read = new.iter().map(PathBuf::as_path).chain(arguments.slim.then_some(all));
    check_model_output(output, &Inputs::of(read))?;

    let paths: Vec<_> = [all.to_path_buf()].into_iter().chain(new).collect();
    let bytes = read_all(&paths)?;
    let models = parse_all(&bytes, &paths)?;
    if let Some(index) = models.iter().position(Model::is_slim) {
        return Err(PackError::Slim { index }).with_context(|| paths[index].display().to_string());
    }
    let (before, new) = (&models[0], &models[1..]);
    // Its lists are those that it has.
    if new.is_empty() && remove.is_empty() && arguments.listed.is_none() {
        return write(&bytes[0], arguments, output, "").with_context(|| all.display().to_string());
    }
    let (replace, add) = new.split_at(replace.len());
    let Repacked { model, kept: is_kept } =
        repack(before, &repack::Changes { add, replace, remove, listed: arguments.listed() })
            .with_context(|| all.display().to_string())?;

    let kept = is_kept.iter().filter(|&&kept| kept).count();
    let [added, replaced] = [add, replace].map(|models| models.iter().map(Model::objects).sum::<usize>());
    let counts = [(added, "added"), (replaced, "replaced"), (before.objects() - kept - replaced, "removed")];
    let said: String = counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!(", {n} {what}")).collect();
    write(&model, arguments, output, &said)?;
    drop(model);
    let counts: Vec<_> = [kept].into_iter().chain(new.iter().map(Model::objects)).collect();
    if new.is_empty() {
        return Ok(());
    }
    compare(arguments, &models, &counts, |(m, i)| m > 0 || is_kept[i])
}

/// Writes the bytes of a model, or of its slim form, and tells what is in it. `changes` is said after the number of
/// objects.
fn write(packed: &[u8], arguments: &Arguments, output: &Path, changes: &str) -> Result<()> {
    let slim = arguments.slim.then(|| learn::slimmed(&Model::parse(packed)?).map_err(Error::from)).transpose()?;
    let packed = slim.as_deref().unwrap_or(packed);
    let model = Model::parse(packed)?;
    write_file(output, |file| Ok(file.write_all(packed)?))?;
    if arguments.listed.is_some() && !model.has_lists() {
        notice("--listed changes nothing: one object has no lists, and neither have models of the method `paper`");
    }
    if is_quiet() {
        return Ok(());
    }
    print_line(&format!("{} objects{changes}\n{}", model.objects(), words::model(&model, output)))
}

/// Tells which objects of different models look alike, if they are few or if it was asked for. `counts` are the
/// numbers of objects that count, those that `counts_too` names by model and index.
fn compare(
    arguments: &Arguments,
    models: &[Model<'_>],
    counts: &[usize],
    counts_too: impl Fn((usize, usize)) -> bool,
) -> Result<()> {
    let (objects, squares) = counts.iter().fold((0, 0), |(sum, squares), n| (sum + n, squares + n * n));
    let pairs = (objects * objects - squares) / 2;
    if arguments.compare || pairs <= COMPARED {
        return tell_among(models, counts_too, &arguments.shared);
    }
    notice(&format!("{pairs} pairs of objects are not compared with each other: --compare tells which look alike"));
    Ok(())
}
