//! Training on an object in a frame, or on a picture of it.
//!
//! In: a frame and the outline of the object in it, or a picture that shows nothing else; a name,
//! and a plan. Out: the model, and whether it finds the object in that same frame or picture.
//!
//! Memory: the picture and the model. Cost: a training, some seconds.

use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc::Sender;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result, ensure};
use keygraph_core::{DEFAULT_THRESHOLD, Model, NAME_BYTES};

use crate::cutout::{Outline, cut_out};
use crate::input::Picture;
use crate::learn::{Learned, Plan, Preset, has_colour, train_within};
use crate::output::{check_name, write_file};
use crate::search::{Profile, Request, search_for};

/// The task of `keygraph train --from-camera`: it waits for the first object that is
/// learned.
#[derive(Debug)]
pub struct Errand {
    /// The default name of the object.
    pub name: String,
    /// The file of the model, which the page shows.
    pub output: PathBuf,
    /// The channel that takes the object; `None` once it has one.
    pub sender: Mutex<Option<Sender<Learned>>>,
}

impl Errand {
    /// Writes the model, and hands the object over.
    ///
    /// # Errors
    /// When the model cannot be written: another object may still be learned. When an object
    /// was learned before.
    pub fn hand_over(&self, learned: Learned) -> Result<()> {
        let mut sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
        let waiting = sender.as_ref().context("an object was learned already, and the program is ending")?;
        write_file(&self.output, |file| Ok(file.write_all(&learned.model)?))?;
        waiting.send(learned).context("the program is ending")?;
        *sender = None;
        Ok(())
    }
}

/// Trains on the part of `frame` within `outline`, and searches the frame for it.
///
/// # Errors
/// When the name is empty, too long or has control characters, the outline cannot be used, or the part has too
/// little texture.
pub fn learn(frame: &Picture, outline: &Outline, name: &str, plan: &Plan) -> Result<Learned> {
    let name = named(name)?;
    let mut picture = cut_out(frame, outline)?;
    if plan.mirror {
        picture.mirror();
    }
    train(picture, Some(frame), name, plan)
}

/// Trains on a picture that shows the object from the front and nothing else, and searches it for
/// the object. It is taken as it is, whether frames are mirrored or not.
///
/// # Errors
/// When the name is empty, too long or has control characters, or the picture has too little texture.
pub fn learn_picture(picture: Picture, name: &str, plan: &Plan) -> Result<Learned> {
    train(picture, None, named(name)?, &Plan { mirror: false, ..plan.clone() })
}

/// A name without blanks around it.
fn named(name: &str) -> Result<&str> {
    let name = name.trim();
    ensure!(!name.is_empty() && name.len() <= NAME_BYTES, "give the object a name of 1 to {NAME_BYTES} bytes");
    check_name(name)?;
    Ok(name)
}

/// Trains on `picture`, and searches `frame` for it; without a frame, the picture itself.
fn train(picture: Picture, frame: Option<&Picture>, name: &str, plan: &Plan) -> Result<Learned> {
    ensure!(
        plan.preset != Preset::Paper || plan.luma || has_colour(&picture),
        "the object has no colour, which the paper's features are made of: use another preset"
    );
    let (model, trained) = train_within(&picture, name, plan.preset, plan.luma, plan.bytes)?;
    let request = Request { mirror: plan.mirror, ..Request::new(Profile::Vga, DEFAULT_THRESHOLD) };
    let own = search_for(frame.unwrap_or(&picture), &Model::parse(&model)?, &request, 1)?;
    let found = own.detections.first().map(|d| d.score);
    Ok(Learned { name: name.to_string(), picture, model, trained, found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Pixels, read_picture};
    use crate::scratch::{Folder, assert_says};
    use std::fs;
    use std::sync::mpsc::channel;

    fn blank() -> Picture {
        Picture { width: 2, height: 1, pixels: Pixels::Gray8(vec![0; 2]) }
    }

    #[test]
    fn an_object_is_handed_over_once_its_model_is_written() {
        let folder = Folder::new("errand");
        let output = folder.0.join("out.kgm");
        let (sender, learned) = channel();
        let errand = Errand { name: "a".into(), output: output.clone(), sender: Mutex::new(Some(sender)) };
        let object = |model: &[u8]| Learned {
            name: "a".into(),
            picture: blank(),
            model: model.to_vec(),
            trained: keygraph_core::Trained::default(),
            found: None,
        };
        fs::create_dir(&output).expect("in the way");
        assert_says(errand.hand_over(object(b"one")), "cannot write");
        assert!(learned.try_recv().is_err(), "the command waits on");
        fs::remove_dir(&output).expect("out of the way");
        errand.hand_over(object(b"two")).expect("hands over");
        assert_says(errand.hand_over(object(b"three")), "learned already");
        assert_eq!(learned.try_recv().expect("there").model, b"two");
        assert_eq!(fs::read(&output).expect("there"), b"two");
    }

    #[test]
    fn an_object_in_a_mirrored_frame_is_learned_as_it_is() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pictures/coffee.jpg");
        let frame = read_picture(&file).expect("a picture");
        let [w, h] = [frame.width, frame.height].map(|v| v as f32 - 1.0);
        let outline = [[20.0, 10.0], [w - 60.0, 10.0], [w - 60.0, h - 30.0], [20.0, h - 30.0]];
        let plan = Plan { preset: Preset::Compact, bytes: Preset::Compact.bytes(), ..Plan::default() };
        let plain = learn(&frame, &outline, "coffee", &plan).expect("a model");
        let mut mirrored = frame;
        mirrored.mirror();
        let outline = [[60.0, 10.0], [w - 20.0, 10.0], [w - 20.0, h - 30.0], [60.0, h - 30.0]];
        let learned = learn(&mirrored, &outline, "coffee", &Plan { mirror: true, ..plan }).expect("a model");
        let (Pixels::Rgb8(a), Pixels::Rgb8(b)) = (&learned.picture.pixels, &plain.picture.pixels) else {
            unreachable!()
        };
        // Both are interpolated, from the other side: up to a pixel lies between them.
        let sum: u64 = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        assert!(a.len() == b.len() && sum < 8 * a.len() as u64, "{sum} over {} bytes", a.len());
        assert!(learned.found.is_some(), "it is found as the camera will see it");
    }

    #[test]
    fn a_picture_is_learned_as_it_is_whether_frames_are_mirrored_or_not() {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/pictures/coffee.jpg");
        let picture = read_picture(&file).expect("a picture");
        let plan = Plan { preset: Preset::Compact, bytes: Preset::Compact.bytes(), ..Plan::default() };
        let plain = learn_picture(picture.clone(), " coffee ", &plan).expect("a model");
        let mirrored = learn_picture(picture.clone(), "coffee", &Plan { mirror: true, ..plan }).expect("a model");
        assert!(mirrored.model == plain.model && mirrored.picture == picture);
        assert!(mirrored.found.is_some_and(|score| score > 0.9), "it is found in itself: {:?}", mirrored.found);
    }

    #[test]
    fn a_name_is_needed_without_control_characters() {
        let outline = Outline::default();
        assert_says(learn(&blank(), &outline, " ", &Plan::default()), "name of 1 to");
        assert_says(learn(&blank(), &outline, "a\u{7}b", &Plan::default()), "control characters");
    }
}
