//! `keygraph assess`: how well a picture will be found.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::slice;

use anyhow::{Context, Result, ensure};
use keygraph::assess::{Assessment, assess};
use keygraph::heat::Heat;
use keygraph::learn::{Preset, train};
use keygraph::notice::notice;
use keygraph::output::{Inputs, check_output, plain, print_line, tell_written};
use keygraph::picture::{EXTENSIONS, Part, Picture, extension, read_framed};
use keygraph::progress::Progress;
use keygraph::search::Profile;
use keygraph::sweep::{Options, all_frames};
use keygraph::{advice, report, words};
use keygraph_core::{MAGIC, TrainError};

use super::model_files::{load, parse};
use super::train::name_of;
use super::values::Threads;

/// Arguments of `keygraph assess`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Picture of the object, or a model
    #[arg(value_name = "PICTURE|MODEL.kgm")]
    input: PathBuf,
    /// Picture that the model was made from, to assess that very model; give one for each
    /// object of the model, in order
    #[arg(long, value_name = "PICTURE")]
    picture: Vec<PathBuf>,
    /// Part of the picture that shows the object, px [default: all that is opaque]
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
    crop: Option<Part>,
    /// How much the model of the picture holds
    #[arg(long, value_enum, default_value = "large")]
    preset: Preset,
    /// Train on luma alone, for cameras without colour
    #[arg(long)]
    luma: bool,
    /// Size of the frames
    #[arg(long, value_enum, default_value = "vga")]
    profile: Profile,
    /// Number of frames for each cell of the table
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    views: u16,
    #[command(flatten)]
    threads: Threads,
    /// Print one JSON line an object
    #[arg(long)]
    json: bool,
    /// Picture to write: bright where the object's keygraphs are found, dark where none is
    #[arg(long, value_name = "FILE")]
    annotate: Option<PathBuf>,
}

impl Arguments {
    /// Prints an assessment.
    fn show(&self, a: &Assessment) -> Result<()> {
        print_line(&if self.json { report::assessment_object(a).to_string() } else { words::assessment(a) })
    }

    /// Writes the picture of `--annotate`.
    fn draw(&self, heat: &Heat, picture: &Picture) -> Result<()> {
        let Some(path) = &self.annotate else { return Ok(()) };
        heat.draw(picture).save(path)?;
        tell_written(path);
        Ok(())
    }

    /// Checks that the file of `--annotate` can be written and is not an input, before any
    /// frame is searched.
    fn check_annotate(&self) -> Result<()> {
        let Some(path) = &self.annotate else { return Ok(()) };
        ensure!(
            EXTENSIONS.contains(&extension(path).as_str()),
            "--annotate {} is no picture: its name must end with .png, .jpg or .jpeg",
            path.display()
        );
        let inputs = Inputs::of(self.picture.iter().chain([&self.input]).map(PathBuf::as_path));
        check_output(path, &inputs).context("--annotate")
    }
}

/// What is assessed: a model, and the pictures that it was made from, as far as they are
/// known.
struct Subject {
    model: Vec<u8>,
    pictures: Vec<Picture>,
}

/// Assesses the objects and prints a result for each.
///
/// # Errors
/// When an input cannot be read, pictures and model do not go together, or the file of
/// `--annotate` cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.check_annotate()?;
    let input = &arguments.input;
    let is_model = is_model(input);
    let subject = if is_model { Some(of_model(arguments)?) } else { of_picture(arguments, input)? };
    subject.map_or(Ok(()), |subject| assess_objects(arguments, &subject))
}

/// Whether a file starts like a model. A pipe is not asked: its first bytes would be lost.
fn is_model(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    path.is_file() && File::open(path).is_ok_and(|mut f| f.read_exact(&mut start).is_ok()) && start == MAGIC
}

/// The model that was given, and its pictures.
fn of_model(arguments: &Arguments) -> Result<Subject> {
    let Arguments { input, picture: paths, crop, .. } = arguments;
    ensure!(crop.is_none() || paths.len() == 1, "--crop goes with one picture, and {} were given", paths.len());
    let pictures = paths.iter().map(|p| Ok(read_framed(p, *crop)?.picture)).collect::<Result<Vec<_>>>()?;
    Ok(Subject { model: load(slice::from_ref(input))?, pictures })
}

/// The picture that was given, and a model of it. `None` when training refuses the picture:
/// that is an answer, which is printed here.
fn of_picture(arguments: &Arguments, path: &Path) -> Result<Option<Subject>> {
    ensure!(arguments.picture.is_empty(), "--picture goes with a model, and {} is none: leave it out", path.display());
    let framed = read_framed(path, arguments.crop)?;
    for said in advice::framing(&framed, path, arguments.crop) {
        notice(&plain(&said));
    }
    let (picture, name) = (framed.picture, name_of(path));
    match train(&picture, &name, arguments.preset, arguments.luma) {
        Ok((model, _)) => Ok(Some(Subject { model, pictures: vec![picture] })),
        Err(e) if e.is::<TrainError>() => {
            arguments.show(&Assessment::refused(&name, &e.to_string()))?;
            arguments.draw(&Heat::new(picture.width, picture.height), &picture)?;
            Ok(None)
        }
        Err(e) => Err(e.context(format!("cannot train on {}", path.display()))),
    }
}

fn assess_objects(arguments: &Arguments, subject: &Subject) -> Result<()> {
    let Subject { model, pictures } = subject;
    let model = parse(model, slice::from_ref(&arguments.input))?;
    let objects = model.objects();
    ensure!(
        pictures.is_empty() || pictures.len() == objects,
        "the model has {objects} objects and {} pictures were given: give --picture once for each, in the order of `keygraph inspect`",
        pictures.len()
    );
    if arguments.annotate.is_some() {
        ensure!(!pictures.is_empty(), "--annotate draws on the picture that the model was made from: give --picture");
        ensure!(objects == 1, "--annotate takes one object and the model has {objects}: assess them one by one");
    }
    let views = usize::from(arguments.views);
    let options = Options { profile: arguments.profile, views, threads: arguments.threads.count() };
    let progress = Progress::new(Some((pictures.len() * all_frames(views)) as u64), "frames");
    for index in 0..objects {
        let picture = pictures.get(index);
        let assessment = assess(&model, index, picture, &options, || progress.tick())?;
        progress.aside(|| arguments.show(&assessment))?;
        if let (Some(sweep), Some(picture)) = (&assessment.sweep, picture) {
            progress.aside(|| arguments.draw(&sweep.heat, picture))?;
        }
    }
    progress.finish();
    if pictures.is_empty() {
        notice("a model holds no picture to render: for the score and the table, give --picture");
    }
    Ok(())
}
