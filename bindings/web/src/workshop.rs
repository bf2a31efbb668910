//! Models: trained, assessed, packed, read.
//!
//! In: pictures, models. Out: answers. Memory: the trainer (a static), the model and the picture. Cost: a
//! second or two to train, some twenty to assess on one thread.

use std::path::Path;

use keygraph::advice;
use keygraph::assess::{Assessment, assess as host_assess};
use keygraph::cutout::cut_out;
use keygraph::heat::Heat;
use keygraph::learn::{Preset, has_colour, merge, train_within};
use keygraph::output::check_name;
use keygraph::report::{assessment_object, model_object};
use keygraph::search::Profile;
use keygraph::sweep::{Options, all_frames};
use keygraph_core::Model;
use serde_json::json;

use crate::failure::{Failure, in_page};
use crate::message::{Answer, Assess, Pack, Train};
use crate::pixels;

/// What is said of a picture that has no name.
const LABEL: &str = "the picture";

/// The value with a name.
pub fn named<T: Copy>(what: &str, name: &str, known: &[(&str, T)]) -> Result<T, Failure> {
    known.iter().find(|(n, _)| *n == name).map(|(_, v)| *v).ok_or_else(|| {
        let names: Vec<String> = known.iter().map(|(n, _)| format!("\"{n}\"")).collect();
        Failure::value(format!("{what}: expected {}; got \"{name}\"", names.join(", ")))
    })
}

/// Trains on a picture. The bytes of the answer are the model, and then the picture that it was trained on,
/// RGB; `picture` of the head has its size. `warnings` say what makes the model less useful than it looks.
pub fn train(options: &Train, bytes: &[u8]) -> Result<Answer, Failure> {
    let preset = named("preset", &options.preset, &Preset::NAMED)?;
    check_name(&options.name)?;
    let mut warnings = Vec::new();
    let picture = match &options.outline {
        None => {
            let framed = pixels::picture(&options.pixels, bytes)?;
            warnings = advice::framing(&framed, Path::new(LABEL), None);
            framed.picture
        }
        Some(outline) => cut_out(&pixels::frame(&options.pixels, bytes)?, outline)?,
    };
    if !options.luma && !has_colour(&picture) {
        warnings.push(format!("{LABEL} has no colour: trained on luma alone"));
    }
    let (model, trained) = train_within(&picture, &options.name, preset, options.luma, preset.bytes())?;
    let view = Model::parse(&model)?;
    warnings.extend(advice::of_model(LABEL, &options.name, &picture, &view, &trained)?.warnings);
    let mut head = model_object(&view);
    head["warnings"] = warnings.iter().map(|said| in_page(said)).collect();
    head["picture"] = json!([picture.width, picture.height]);
    let rgb = keygraph::canvas::Canvas::from_picture(&picture);
    Ok(Answer::of(&head).with(model).with(rgb.rgb().iter().copied()))
}

/// Assesses a picture in rendered frames. The bytes of the answer are the picture in the colours of its
/// keygraphs, RGB, of the size of the picture.
pub fn assess(options: &Assess, bytes: &[u8], progress: impl Fn(u32, u32)) -> Result<Answer, Failure> {
    let profile = named("profile", &options.profile, &Profile::NAMED)?;
    if !(1..=1000).contains(&options.views) {
        return Err(Failure::value(format!("views: expected 1 to 1000, got {}", options.views)));
    }
    let (model, picture) = bytes.split_at(options.model.min(bytes.len()));
    let (model, picture) = (Model::parse(model)?, pixels::frame(&options.pixels, picture)?);
    if model.objects() != 1 {
        return Err(Failure::value(format!(
            "model: expected one object, got {}: assess them one by one",
            model.objects()
        )));
    }
    let sweep = Options { profile, views: options.views, threads: 1 };
    let (mut done, all) = (0, u32::try_from(all_frames(options.views)).unwrap_or(u32::MAX));
    let tick = || {
        done += 1;
        progress(done, all);
    };
    let own: Assessment = host_assess(&model, 0, Some(&picture), &sweep, tick)?;
    let empty = Heat::new(picture.width, picture.height);
    let heat = own.sweep.as_ref().map_or(&empty, |s| &s.heat).draw(&picture);
    Ok(Answer::of(&assessment_object(&own)).with(heat.rgb().iter().copied()))
}

/// Reads what a model holds.
pub fn read(bytes: &[u8]) -> Result<Answer, Failure> {
    Ok(Answer::of(&model_object(&Model::parse(bytes)?)))
}

/// Merges models. The bytes of the answer are the merged model.
pub fn pack(options: &Pack, bytes: &[u8]) -> Result<Answer, Failure> {
    let mut rest = bytes;
    let mut models = Vec::new();
    for &length in &options.lengths {
        let (model, after) = rest.split_at(length.min(rest.len()));
        models.push(model);
        rest = after;
    }
    let merged = merge(&models)?;
    let head = model_object(&Model::parse(&merged)?);
    Ok(Answer::of(&head).with(merged))
}
