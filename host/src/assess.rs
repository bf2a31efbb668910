//! How well a picture will be found, before it is used.
//!
//! In: a model and the picture that it was made from. Out: an [`Assessment`]: how often the
//! detector finds the object in rendered frames ([`sweep`](mod@crate::sweep)), a score, and
//! what limits it in words ([`advice`](crate::advice)). Without the picture, only the facts
//! that the model tells: a model holds a small copy of its picture, and frames rendered
//! from that would show the blur of the copy, not the object.
//!
//! The rate of a condition is the mean of its cells. The score is 100 times the weighted
//! mean of the rates. Scale and tilt count three times and blur twice: frames of real
//! cameras differ most in these. One more view in which the object is found never lowers
//! the score.
//!
//! Memory and cost: those of the sweep.

use anyhow::{Result, ensure};
use keygraph_core::Model;

use crate::advice::{Limit, limits};
use crate::picture::Picture;
use crate::structure::{Structure, structure};
use crate::sweep::{Options, Row, Sweep, sweep};

/// All that is known about one object.
#[derive(Clone, Debug)]
pub struct Assessment {
    /// Name of the object.
    pub name: String,
    /// Facts from the model; `None` when training refused the picture.
    pub structure: Option<Structure>,
    /// Results in rendered frames; `None` without the picture.
    pub sweep: Option<Sweep>,
    /// Score from 0 to 100; `None` without the picture.
    pub score: Option<u8>,
    /// What limits the score: first facts about the picture, then results in frames.
    pub limits: Vec<Limit>,
}

impl Assessment {
    /// The assessment of a picture that training refuses for `reason`: its score is 0.
    #[must_use]
    pub fn refused(name: &str, reason: &str) -> Self {
        let limits = vec![Limit { kind: "refused", text: reason.into() }];
        Self { name: name.into(), structure: None, sweep: None, score: Some(0), limits }
    }
}

/// Assesses object `index` of `model`; in rendered frames when its picture is given. `tick`
/// is called after each frame.
///
/// # Errors
/// When the picture has another size than the one that the model was made from.
pub fn assess(
    model: &Model<'_>,
    index: usize,
    picture: Option<&Picture>,
    options: &Options,
    tick: impl FnMut(),
) -> Result<Assessment> {
    let object = model.object(index);
    if let Some(p) = picture {
        ensure!(
            (p.width, p.height) == (object.width, object.height),
            "{} was trained on a picture of {}x{} px, and this one has {}x{}: give the picture, and the --crop, that the model was made from",
            object.name,
            object.width,
            object.height,
            p.width,
            p.height
        );
    }
    let structure = structure(model, index);
    let sweep = picture.map(|p| sweep(model, index, p, options, tick)).transpose()?;
    let score = sweep.as_ref().map(score);
    let limits = limits(&structure, sweep.as_ref());
    Ok(Assessment { name: object.name.into(), structure: Some(structure), sweep, score, limits })
}

/// The score of a sweep, 0 to 100; the formula is in the file's opening.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 100")]
fn score(sweep: &Sweep) -> u8 {
    let weighted = |row: &Row| row.condition.weight() * row.rate(sweep.views);
    let weights: f32 = sweep.rows.iter().map(|r| r.condition.weight()).sum();
    (100.0 * sweep.rows.iter().map(weighted).sum::<f32>() / weights + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::Condition;
    use crate::sweep::tests::sweep;

    #[test]
    fn the_score_is_the_weighted_mean_of_the_rows() {
        assert_eq!(score(&sweep(|_, _| 0)), 0);
        assert_eq!(score(&sweep(|_, _| 4)), 100);
        // Three of eleven parts, and half of one.
        assert_eq!(score(&sweep(|c, _| if c == Condition::Scale { 4 } else { 0 })), 27);
        assert_eq!(score(&sweep(|c, _| if c == Condition::Noise { 2 } else { 0 })), 5);
    }
}
