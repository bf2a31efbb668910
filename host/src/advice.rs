//! Is this a good picture? The one place that answers: facts, thresholds and words.
//!
//! In: a picture and what training made of it, or the facts and the rendered frames of an
//! assessment. Out: sentences that say what is wrong and what to do about it. Memory: the
//! sentences. Cost: [`framing`] looks for margins, one pass over the picture; [`of_model`]
//! searches the picture once; the rest compares numbers.

use std::path::Path;

use anyhow::Result;
use keygraph_core::{DEFAULT_THRESHOLD, Method, Model, NAME_BYTES, Trained};

use crate::alike::Alike;
use crate::margins::within_margins;
use crate::picture::{Framed, Part, Picture};
use crate::search::{Profile, search};
use crate::structure::{Structure, structure};
use crate::sweep::{Cell, Condition, MILD, RELIABLE, Row, Sweep, frames};

/// Minimum number of keypoints in all views. The poor pictures of the tests have up to 250,
/// photographs 700 to 1,700.
const FEW_KEYPOINTS: usize = 300;
/// Minimum number of likely keygraphs. With 20,000 and more, nearly all of 16 rendered
/// frames were right; with fewer, some pictures were found in none. Photographs have 58,000
/// to 110,000.
const FEW_KEYGRAPHS: u32 = 20_000;
/// Minimum length of the picture's longer side, px. Photographs scaled to 120 px score
/// within 4 of 100 as well as at 400 px; scaled to 90 px they are found less often where
/// they are seen small, and at 40 px one scores 48.
const SMALL_PX: u32 = 120;
/// Maximum ratio of the sides. Longer pictures were found only where they were seen 250 px
/// long or more.
const ELONGATED: u32 = 4;
/// Minimum share of the picture that has keypoints. The poor pictures of the tests lie
/// below, photographs above; the same holds for [`CONTRAST`].
const SPREAD: f32 = 0.5;
/// Minimum standard deviation of the luma, of 255.
const CONTRAST: f32 = 12.0;
/// Maximum correlation of the picture with itself at another place. The repeated patterns
/// of the tests lie above, photographs (0.12 to 0.2) below.
const REPETITION: f32 = 0.6;
/// Maximum number of wrong outlines a frame.
const WRONG: f32 = 0.02;
/// Maximum rate at which look-alikes of which only a quarter is the same may be taken for the
/// object.
const TAKEN: f32 = 0.25;

/// Whether a picture of this size, px, has too little detail for its smallness.
fn is_small((width, height): (u32, u32)) -> bool {
    width.max(height) < SMALL_PX
}

/// Whether a picture of this size, px, is too long for its width.
fn is_elongated((width, height): (u32, u32)) -> bool {
    width.max(height) > ELONGATED * width.min(height)
}

// ------------------------------------------------------------------ training

/// Says which part of a picture is taken for the object, where that may surprise. `crop` is
/// the part that was asked for.
#[must_use]
pub fn framing(framed: &Framed, path: &Path, crop: Option<Part>) -> Vec<String> {
    let (path, Part { x, y, width, height }) = (path.display(), framed.part);
    let mut said = Vec::new();
    if crop.is_none() && (width, height) != framed.whole {
        said.push(format!(
            "{path} is transparent around {x},{y},{width},{height}: trained on that part, whose outline will be reported"
        ));
    }
    if framed.transparent {
        said.push(format!("{path} is transparent in places: white is taken there"));
    }
    if let Some(m) = within_margins(&framed.picture).filter(|_| crop.is_none()) {
        said.push(format!(
            "{path} has plain margins, and the outline of the whole picture will be reported: if the object is only what is within them, train with --crop {},{},{},{}",
            x + m.x,
            y + m.y,
            m.width,
            m.height
        ));
    }
    said
}

/// What is said of a new model.
#[derive(Clone, Debug)]
pub struct Review {
    /// What makes it less useful than it looks, and what to do: a name that was cut, a picture that gives too little
    /// or repeats itself, an object that is not found in its own picture.
    pub warnings: Vec<String>,
    /// How the object is found in its own picture; `None` when it is not.
    pub found: Option<Own>,
    /// What else about the picture makes the object harder to find. That it has no colour is not among it.
    pub limits: Vec<Limit>,
    /// Whether nothing about the picture makes the object hard to find; `None` when it is not judged.
    pub is_good: Option<bool>,
}

/// How an object is found in its own picture.
#[derive(Clone, Copy, Debug)]
pub struct Own {
    /// Score, 0 to 1.
    pub score: f32,
    /// Mean distance of the outline's corners from those of the picture, px of the picture.
    pub off_px: f32,
}

/// Looks at a new model, and searches its picture for the object. `label` names the picture, `name` is the object's
/// as it was given.
///
/// # Errors
/// When the picture cannot be searched.
pub fn of_model(label: &str, name: &str, picture: &Picture, model: &Model<'_>, trained: &Trained) -> Result<Review> {
    let mut warnings = Vec::new();
    if name.len() > NAME_BYTES {
        warnings.push(format!("the name was cut to {NAME_BYTES} bytes: {}", model.object(0).name));
    }
    let own = search(picture, model, Profile::Vga, DEFAULT_THRESHOLD, false, 0)?;
    let found = own.detections.first().map(|d| {
        let (w, h) = (picture.width as f32, picture.height as f32);
        let whole = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
        let off = d.corners.iter().zip(whole).map(|(c, at)| (c[0] - at[0]).hypot(c[1] - at[1]));
        Own { score: d.score, off_px: off.sum::<f32>() / 4.0 }
    });
    let (mut limits, mut is_good) = (Vec::new(), None);
    // The paper's method is for comparison: its models need no advice.
    if model.method() == Method::Keygraph {
        let structure = structure(model, 0);
        let (few, repeats) = (warning(picture, trained), repeats(&structure));
        limits = limits_of_picture(&structure);
        // What a warning says already.
        limits.retain(|l| match l.kind {
            "repeated pattern" => repeats.is_none(),
            "few corners" | "small" | "elongated" => few.is_none(),
            kind => kind != "no chroma",
        });
        is_good = Some(limits.is_empty() && few.is_none() && repeats.is_none() && found.is_some());
        warnings.extend(few.into_iter().chain(repeats).map(|told| format!("{label} {told}")));
        if found.is_none() {
            warnings.push(not_found_in_itself(label));
        }
    }
    Ok(Review { warnings, found, limits, is_good })
}

/// Says what is wrong with a picture that gave training too little, and what to do; the
/// sentence goes on from the picture's name. `None` when the picture gave enough.
#[must_use]
pub fn warning(picture: &Picture, trained: &Trained) -> Option<String> {
    let size = (picture.width, picture.height);
    let keypoints: usize = trained.view_keypoints.iter().copied().map(usize::from).sum();
    let keygraphs = trained.keygraphs.seen;
    let what = if keypoints < FEW_KEYPOINTS || keygraphs < FEW_KEYGRAPHS {
        format!(
            "has little to hold on to ({keypoints} keypoints in all views, {keygraphs} likely keygraphs) and may often be missed"
        )
    } else if is_elongated(size) {
        format!("is more than {ELONGATED} times as long as wide and will be missed where it is seen small")
    } else {
        return None;
    };
    let remedy = match (is_small(size), is_elongated(size)) {
        (true, _) => format!("take a larger one, of {SMALL_PX} px or more"),
        (_, true) => "train on a less elongated part of the object".into(),
        _ => "take a sharper one, or one of a part with more texture".into(),
    };
    Some(format!("{what}: {remedy}"))
}

/// Says what to do when the object is not found in the picture that it was trained on;
/// `label` names the picture.
#[must_use]
pub fn not_found_in_itself(label: &str) -> String {
    format!(
        "the object is not found even in {label} itself: use a picture with more texture, a larger one, or a less elongated part of the object"
    )
}

/// Says that a picture repeats itself, and what follows; the sentence goes on from the picture's
/// name. `None` when it does not.
#[must_use]
pub fn repeats(structure: &Structure) -> Option<String> {
    (structure.repetition > REPETITION).then(|| {
        format!(
            "repeats itself (correlation {:.2} where it is shifted) and may be found in the wrong place, or in a picture of the same pattern: take a part that is nowhere else",
            structure.repetition
        )
    })
}

/// Says that one object looks like another, and what to do. `shown` and `taken` are their names.
#[must_use]
pub fn looks_like(alike: &Alike, shown: &str, taken: &str) -> String {
    format!(
        "{shown} looks like {taken}: {:.0} % of it; load the models of both, so that each gets its own name, or search with --min-visible",
        100.0 * alike.share
    )
}

// ---------------------------------------------------------------- assessment

/// Something that makes the picture harder to find.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limit {
    /// The key of the limit, for programs.
    pub kind: &'static str,
    /// What the limit is and what to do about it.
    pub text: String,
}

/// What limits an object: first facts about the picture, then results in frames.
#[must_use]
pub fn limits(structure: &Structure, sweep: Option<&Sweep>) -> Vec<Limit> {
    let mut limits = limits_of_picture(structure);
    if let Some(sweep) = sweep {
        limits.extend(limits_in_frames(sweep));
    }
    limits
}

/// Adds a limit when its condition holds.
fn add(limits: &mut Vec<Limit>, holds: bool, kind: &'static str, text: String) {
    if holds {
        limits.push(Limit { kind, text });
    }
}

/// Limits by facts about the picture.
fn limits_of_picture(s: &Structure) -> Vec<Limit> {
    let mut limits = Vec::new();
    let (w, h) = s.size;
    add(
        &mut limits,
        s.repetition > REPETITION,
        "repeated pattern",
        format!(
            "repeated pattern: shifted, the picture is like itself (correlation {:.2}); take a part that is nowhere else",
            s.repetition
        ),
    );
    add(
        &mut limits,
        s.keypoints < FEW_KEYPOINTS || s.spread < SPREAD,
        "few corners",
        format!(
            "few corners: {} keypoints, in {:.0} % of the picture; cut off what is plain, or take a part with more texture",
            s.keypoints,
            100.0 * s.spread
        ),
    );
    add(
        &mut limits,
        s.contrast < CONTRAST,
        "low contrast",
        format!("low contrast: luma varies by {:.0} of 255; take the picture in better light", s.contrast),
    );
    add(
        &mut limits,
        is_small(s.size),
        "small",
        format!("small: {w}x{h} px show little detail; take a larger one, of {SMALL_PX} px or more"),
    );
    add(
        &mut limits,
        is_elongated(s.size),
        "elongated",
        format!("elongated: {w}x{h} px; take a part that is more nearly square"),
    );
    add(
        &mut limits,
        s.luma_only,
        "no chroma",
        "no chroma: luma alone tells it from others; if object and camera have colour, take a picture in colour".into(),
    );
    limits
}

/// Limits by results in rendered frames.
fn limits_in_frames(sweep: &Sweep) -> Vec<Limit> {
    let mut limits = Vec::new();
    add(
        &mut limits,
        sweep.wrong as f32 > WRONG * frames(sweep.views) as f32,
        "wrong places",
        format!(
            "wrong places: {} outlines in {} frames are not where the picture is; raise --threshold in `keygraph detect`",
            sweep.wrong,
            frames(sweep.views)
        ),
    );
    let taken = sweep.taken.last().map_or(0.0, |c| c.rate(sweep.views));
    add(
        &mut limits,
        taken > TAKEN,
        "look-alikes",
        format!(
            "look-alikes: pictures of which only a quarter is the same are taken for it ({:.0} %); where such are about, load their models too, or raise --min-visible in `keygraph detect`",
            100.0 * taken
        ),
    );
    let turned = sweep.rows.iter().filter(|r| r.condition == Condition::Rotation).map(|r| r.rate(sweep.views));
    let weak = turned.clone().any(|rate| rate < RELIABLE);
    add(
        &mut limits,
        weak,
        "weak",
        format!(
            "weak: found in {:.0} % of mild frames, {:.0} to {:.0} % as long as the frame; show it larger, or take a part with more and sharper texture",
            100.0 * turned.sum::<f32>(),
            MILD.side_px.start / 6.4,
            MILD.side_px.end / 6.4
        ),
    );
    // An object that is weak in mild conditions is not lost to the other conditions.
    let own = |l: &Limit| !weak || l.kind == "lost when small";
    limits.extend(sweep.rows.iter().filter_map(|row| limit_of_row(row, sweep.views)).filter(own));
    limits
}

/// The value of a condition at which the object is no longer found, when that is sooner
/// than one may expect.
fn limit_of_row(row: &Row, views: usize) -> Option<Limit> {
    // The object should be found up to this cell, for scale from this cell on.
    let (expected, kind, advice) = match row.condition {
        // Mild frames show all rotations.
        Condition::Rotation => return None,
        Condition::Scale => (1, "lost when small", "come closer, or search larger frames (--profile hd)"),
        Condition::Tilt => (3, "lost when tilted", "look at it from nearer to the front"),
        Condition::Blur => (1, "lost when blurred", "its detail is fine: hold the camera still and focus"),
        Condition::Darkness => (1, "lost in the dark", "give it more light"),
        Condition::Noise => (1, "lost in noise", "give it more light"),
    };
    let reliable = |c: &Cell| c.rate(views) >= RELIABLE;
    let (held, to) = match row.condition {
        Condition::Scale => (row.cells.iter().position(reliable), "from"),
        _ => (row.cells.iter().take_while(|c| reliable(c)).count().checked_sub(1), "to"),
    };
    let enough = held.is_some_and(|i| if to == "from" { i <= expected } else { i >= expected });
    let range = held.map_or_else(
        || "at no value of the table".into(),
        |i| format!("only {to} {} {}", row.cells[i].value, row.condition.unit()),
    );
    let text = format!("{kind}: found reliably {range}; {advice}");
    (!enough).then_some(Limit { kind, text })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::tests::sweep;

    const GOOD: Structure = Structure {
        keypoints: 1120,
        keygraphs: 60_000,
        spread: 0.9,
        contrast: 50.0,
        repetition: 0.2,
        size: (600, 400),
        luma_only: false,
    };

    fn texts(structure: &Structure, sweep: &Sweep) -> Vec<String> {
        limits(structure, Some(sweep)).into_iter().map(|l| l.text).collect()
    }

    #[test]
    fn a_good_picture_has_no_limits() {
        assert_eq!(texts(&GOOD, &sweep(|_, _| 4)), [""; 0]);
    }

    #[test]
    fn what_the_picture_lacks_is_named() {
        let poor = [
            (Structure { keypoints: 200, ..GOOD }, "few corners: 200 keypoints"),
            (Structure { spread: 0.3, ..GOOD }, "in 30 % of the picture"),
            (Structure { contrast: 8.0, ..GOOD }, "low contrast: luma varies by 8"),
            (Structure { repetition: 0.9, ..GOOD }, "repeated pattern"),
            (Structure { size: (90, 60), ..GOOD }, "small: 90x60"),
            (Structure { size: (800, 100), ..GOOD }, "elongated: 800x100"),
            (Structure { luma_only: true, ..GOOD }, "no chroma"),
        ];
        for (structure, words) in poor {
            let texts = texts(&structure, &sweep(|_, _| 4));
            assert!(texts.len() == 1 && texts[0].contains(words), "{words:?} is not {texts:?}");
        }
    }

    #[test]
    fn what_the_frames_show_is_named() {
        let scale = sweep(|c, i| if c == Condition::Scale && i < 2 { 2 } else { 4 });
        assert!(texts(&GOOD, &scale)[0].contains("only from 210 px"), "{:?}", texts(&GOOD, &scale));
        let tilt = sweep(|c, i| if c == Condition::Tilt && i > 2 { 0 } else { 4 });
        assert!(texts(&GOOD, &tilt)[0].contains("only to 30 degrees"), "{:?}", texts(&GOOD, &tilt));
        let dark = sweep(|c, _| if c == Condition::Darkness { 0 } else { 4 });
        assert!(texts(&GOOD, &dark)[0].contains("at no value"), "{:?}", texts(&GOOD, &dark));
        let wrong = Sweep { wrong: 20, ..sweep(|_, _| 4) };
        assert!(texts(&GOOD, &wrong)[0].contains("20 outlines in 108 frames"), "{:?}", texts(&GOOD, &wrong));
        let taken = Cell { value: 75.0, found: 2 };
        let fooled = Sweep { taken: vec![taken], ..sweep(|_, _| 4) };
        assert!(texts(&GOOD, &fooled)[0].contains("taken for it (50 %)"), "{:?}", texts(&GOOD, &fooled));
        let weak = texts(&GOOD, &sweep(|c, i| if c == Condition::Scale && i > 1 { 4 } else { 2 }));
        assert!(weak.len() == 2 && weak[0].contains("found in 50 % of mild frames"), "{weak:?}");
    }
}
