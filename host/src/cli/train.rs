//! `keygraph train`: a model of one picture.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::slice;

use anyhow::{Context, Result, bail};
#[cfg(feature = "live")]
use clap::error::ErrorKind;
#[cfg(feature = "live")]
use keygraph::camera::{arguments::Lesson, learn_from_camera};
use keygraph::learn::{Learned, Plan, Preset, has_colour, train_within};
use keygraph::notice::{is_quiet, notice};
use keygraph::output::{Inputs, check_model_output, check_name, is_plain, plain, print_line, tell_written, write_file};
use keygraph::picture::{Part, Picture, read_framed};
use keygraph::{advice, report, words};
use keygraph_core::Model;

use super::compare::{Shared, tell_beside};
use super::model_files::{parse, read_all};
#[cfg(feature = "live")]
use super::usage_error;
use super::values::model_size;

/// Arguments of `keygraph train`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Picture that shows the object, from the front, and nothing else
    #[cfg_attr(feature = "live", arg(required_unless_present = "from_camera", conflicts_with = "from_camera"))]
    #[cfg_attr(not(feature = "live"), arg(required = true))]
    picture: Option<PathBuf>,
    /// Part of the picture that shows the object, px [default: all that is opaque]
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
    crop: Option<Part>,
    /// Model file to write
    #[arg(short, long, value_name = "MODEL.kgm")]
    output: PathBuf,
    /// Name of the object [default: that of the picture's file, or of the model's]
    #[arg(long, value_parser = name)]
    name: Option<String>,
    /// How much the model holds
    #[arg(long, value_enum, default_value = "large")]
    preset: Preset,
    /// Maximum size of the model in bytes, instead of the preset's
    #[arg(long, value_name = "N", value_parser = model_size)]
    bytes: Option<usize>,
    /// Train on luma alone, for cameras without colour
    #[arg(long)]
    luma: bool,
    /// Models that will be used beside this one: which objects look like it is told
    #[arg(long, value_name = "MODEL.kgm", num_args = 1..)]
    beside: Vec<PathBuf>,
    #[command(flatten)]
    shared: Shared,
    /// Print the report as one JSON object
    #[arg(long)]
    json: bool,
    /// Add what training made and what the model holds, in numbers
    #[arg(short, long, conflicts_with = "json")]
    verbose: bool,
    /// How the picture is taken from a camera.
    #[cfg(feature = "live")]
    #[command(flatten, next_help_heading = "From a camera")]
    lesson: Box<Lesson>,
}

impl Arguments {
    /// Whether the picture is taken from a camera.
    #[cfg(feature = "live")]
    pub fn is_from_camera(&self) -> bool {
        self.lesson.from_camera
    }

    fn plan(&self) -> Plan {
        Plan { preset: self.preset, bytes: self.bytes.unwrap_or(self.preset.bytes()), luma: self.luma, mirror: false }
    }

    /// The name that was given, or else that of `file`.
    fn name_or_that_of(&self, file: &Path) -> String {
        self.name.clone().unwrap_or_else(|| name_of(file))
    }
}

/// The name of an object when none is given: that of its file, without the extension and
/// with `_` for control characters.
pub fn name_of(file: &Path) -> String {
    let stem = file.file_stem().map_or_else(|| "object".into(), |s| s.to_string_lossy());
    stem.replace(|c| !is_plain(c), "_")
}

/// Parses a name that is given to an object.
fn name(text: &str) -> Result<String, String> {
    check_name(text).map(|()| text.to_string()).map_err(|error| error.to_string())
}

/// Trains, writes the model and prints a report.
///
/// # Errors
/// When the picture cannot be read or used, or the model cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    #[cfg(feature = "live")]
    if !arguments.lesson.from_camera && arguments.lesson.origin.is_given() {
        usage_error(ErrorKind::ArgumentConflict, "a camera or --replay is only used with --from-camera");
    }
    // Training takes a second: what would fail after it is checked before it.
    let inputs = arguments.picture.iter().chain(&arguments.beside);
    #[cfg(feature = "live")]
    let inputs = inputs.chain(&arguments.lesson.origin.replay);
    check_model_output(&arguments.output, &Inputs::of(inputs.map(PathBuf::as_path)))?;
    let beside = read_all(&arguments.beside)?;
    for (bytes, file) in beside.iter().zip(&arguments.beside) {
        parse(bytes, slice::from_ref(file))?;
    }
    match &arguments.picture {
        Some(picture) => train_on_picture(arguments, picture, &beside),
        #[cfg(feature = "live")]
        None => train_from_camera(arguments, &beside),
        #[cfg(not(feature = "live"))]
        None => unreachable!("clap requires a picture"),
    }
}

fn train_on_picture(arguments: &Arguments, path: &Path, beside: &[Vec<u8>]) -> Result<()> {
    let framed = read_framed(path, arguments.crop)?;
    for said in advice::framing(&framed, path, arguments.crop) {
        notice(&plain(&said));
    }
    let (picture, label, plan) = (framed.picture, plain(&path.display().to_string()).into_owned(), arguments.plan());
    check_colour(&picture, &label, &plan)?;
    let name = arguments.name_or_that_of(path);
    let (model, trained) = train_within(&picture, &name, plan.preset, plan.luma, plan.bytes)
        .with_context(|| format!("cannot train on {label}"))?;
    // A model that would be refused is not left behind as a file.
    Model::parse(&model)?;
    write_file(&arguments.output, |file| Ok(file.write_all(&model)?))?;
    tell(arguments, &label, &Learned { name, picture, model, trained, found: None }, beside)
}

#[cfg(feature = "live")]
fn train_from_camera(arguments: &Arguments, beside: &[Vec<u8>]) -> Result<()> {
    let (plan, name) = (arguments.plan(), arguments.name_or_that_of(&arguments.output));
    let learned = learn_from_camera(&arguments.lesson, name, &arguments.output, &plan)?;
    let label = format!("the picture of {}", learned.name);
    check_colour(&learned.picture, &label, &plan)?;
    tell(arguments, &label, &learned, beside)
}

/// Warns that a picture has no colour, or refuses it where the preset needs colour.
pub fn check_colour(picture: &Picture, label: &str, plan: &Plan) -> Result<()> {
    match (has_colour(picture), plan.preset) {
        (false, Preset::Paper) if !plan.luma => {
            bail!("{label} has no colour, which the paper's features are made of: use another preset");
        }
        (false, _) if !plan.luma => notice(&format!("{label} has no colour: trained on luma alone")),
        _ => {}
    }
    Ok(())
}

/// Prints the report of a model that was written; `label` names its picture. `beside` are the models
/// that it will be used with.
fn tell(arguments: &Arguments, label: &str, learned: &Learned, beside: &[Vec<u8>]) -> Result<()> {
    let model = Model::parse(&learned.model)?;
    let review = advice::of_model(label, &learned.name, &learned.picture, &model, &learned.trained)?;
    review.warnings.iter().for_each(|said| notice(&plain(said)));
    let alike = tell_beside(&model.object(0), beside, &arguments.shared)?;
    if arguments.json {
        let mut object = report::model_object(&model);
        if !beside.is_empty() {
            object["alike"] = alike.iter().map(|p| report::alike_object(&p.object, &p.alike)).collect();
        }
        print_line(&object.to_string())?;
        tell_written(&arguments.output);
        return Ok(());
    }
    if is_quiet() {
        return Ok(());
    }
    let size = (learned.picture.width, learned.picture.height);
    print_line(&words::trained(&model, label, size, &review, &arguments.output))?;
    if arguments.verbose {
        print_line(&format!("\n{}\n{}", words::training(&learned.trained), words::model(&model, &arguments.output)))?;
    }
    Ok(())
}
