//! Objects of a packed model added, replaced and removed, without the models that it was packed from.
//!
//! In: a model; models to add, or to put in the places of objects; names of objects to remove. Out: the bytes of
//! the new model. They are those that packing the models of its objects in this order gives, with the two
//! exceptions that packing has (`core/src/model/pack.rs`). Names stand for one object each in what is added.
//! Memory: the new model. Cost: that of packing it.

use std::collections::{HashMap, HashSet};

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use keygraph_core::{Model, Part};

use crate::learn::joined;
use crate::output::plain;

/// Maximum number of names that a message tells.
const TOLD: usize = 16;

/// What is changed in a model.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes<'a> {
    /// Models whose objects come after the others.
    pub add: &'a [Model<'a>],
    /// Models whose objects take the places of the objects of their names.
    pub replace: &'a [Model<'a>],
    /// Names of the objects to remove. All objects of a name are removed.
    pub remove: &'a [String],
    /// Maximum number of keygraphs of each object in the lists of the new model; `None` for as many as packing takes.
    pub listed: Option<usize>,
}

/// A model with changed objects.
#[derive(Clone, Debug)]
pub struct Repacked {
    /// The bytes of the model.
    pub model: Vec<u8>,
    /// Whether each object of the model before is still there.
    pub kept: Vec<bool>,
}

/// An object: the index of its model, and its index in the model. Model 0 is the one that is changed.
type Place = (usize, usize);

/// Changes the objects of `model`. Objects are removed first, then replaced, then added.
///
/// # Errors
/// When a name to remove or to replace is not in the model, one to add is there already, a name is new twice,
/// nothing would be left, or the models do not go together.
pub fn repack(model: &Model<'_>, changes: &Changes<'_>) -> Result<Repacked> {
    let models: Vec<_> = [model].into_iter().chain(changes.replace).chain(changes.add).copied().collect();
    let added = 1 + changes.replace.len();
    let name = |&(m, i): &Place| models[m].object(i).name;
    let shown = |place: &Place| plain(name(place)).into_owned();
    let objects = |m: usize| (0..models[m].objects()).map(move |i| (m, i));

    let removed: HashSet<_> = changes.remove.iter().map(String::as_str).collect();
    let names: HashSet<_> = objects(0).map(|o| name(&o)).collect();
    if let Some(none) = changes.remove.iter().find(|n| !names.contains(n.as_str())) {
        return Err(unknown(none, model));
    }
    let mut places: Vec<Place> = objects(0).filter(|o| !removed.contains(name(o))).collect();

    let mut of_name: HashMap<_, Vec<usize>> = HashMap::new();
    for (at, place) in places.iter().enumerate() {
        of_name.entry(name(place)).or_default().push(at);
    }
    for new in (1..added).flat_map(objects) {
        match of_name.get(name(&new)).map(Vec::as_slice) {
            None => return Err(unknown(name(&new), model)),
            Some(&[at]) => {
                ensure!(places[at].0 == 0, "{} is to be replaced twice: give it once", shown(&new));
                places[at] = new;
            }
            Some(several) => {
                bail!("there are {} objects {}: remove them and add the new one", several.len(), shown(&new))
            }
        }
    }
    let mut known: HashSet<_> = of_name.into_keys().collect();
    for new in (added..models.len()).flat_map(objects) {
        ensure!(
            known.insert(name(&new)),
            "there is an object {} already: replace it, or train the new one with another name",
            shown(&new)
        );
        places.push(new);
    }
    ensure!(!places.is_empty(), "no object would be left: remove the file instead");
    if let Some(other) = places.iter().find(|(m, _)| models[*m].method() != models[places[0].0].method()) {
        bail!(
            "{} was trained by another method than {}: train all with `--preset paper`, or none",
            shown(other),
            shown(&places[0])
        );
    }

    let mut kept = vec![false; model.objects()];
    places.iter().filter(|(m, _)| *m == 0).for_each(|&(_, i)| kept[i] = true);
    let runs = places.chunk_by(|a, b| *b == (a.0, a.1 + 1));
    let part = |run: &[Place]| {
        let (m, first) = run[0];
        Part::of(models[m], first..first + run.len())
            .with_context(|| format!("the records of {} do not lie together: train and pack again", shown(&run[0])))
    };
    let parts = runs.map(part).collect::<Result<Vec<_>>>()?;
    Ok(Repacked { model: joined(&parts, changes.listed)?, kept })
}

fn unknown(name: &str, model: &Model<'_>) -> Error {
    let (objects, told) = (model.objects(), model.objects().min(TOLD));
    let mut names = (0..told).map(|i| plain(model.object(i).name).into_owned()).collect::<Vec<_>>().join(", ");
    if told < objects {
        names += &format!(" and {} others", objects - told);
    }
    anyhow!("there is no object {}: there are {names}", plain(name))
}
