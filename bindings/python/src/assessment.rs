//! How well a picture will be found, before it is used.
//!
//! In: a picture, and perhaps the model that was made of it. Out: an [`Assessment`]. Memory: that of the
//! host's sweep. Cost: 33 rendered frames for each view, some 20 ms each, on all processors.

use anyhow::Result;
use keygraph::heat::Heat;
use keygraph::learn::train as train_on;
use keygraph::picture::Picture;
use keygraph::run::default_threads;
use keygraph::search::MAX_THREADS;
use keygraph::sweep::Options;
use keygraph::{assess as host, report};
use keygraph_core::TrainError;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::detector::profile;
use crate::drawing::{encoded, rgb};
use crate::errors::{exception, in_python};
use crate::frame::Reading;
use crate::json::object;
use crate::model::{Model, framed, name_of, preset};

/// How well a picture will be found.
#[pyclass(frozen, module = "keygraph")]
#[derive(Debug)]
pub struct Assessment {
    own: host::Assessment,
    picture: Picture,
}

impl Assessment {
    fn drawn(&self) -> keygraph::canvas::Canvas {
        match &self.own.sweep {
            Some(sweep) => sweep.heat.draw(&self.picture),
            None => Heat::new(self.picture.width, self.picture.height).draw(&self.picture),
        }
    }
}

#[pymethods]
impl Assessment {
    /// Name of the object.
    #[getter]
    fn object(&self) -> &str {
        &self.own.name
    }

    /// Score from 0 to 100; 0 for a picture that training refuses.
    #[getter]
    fn score(&self) -> u8 {
        self.own.score.unwrap_or(0)
    }

    /// What limits the score, and what to do: pairs of a key and a sentence.
    #[getter]
    fn limits(&self) -> Vec<(&'static str, String)> {
        self.own.limits.iter().map(|l| (l.kind, in_python(&l.text))).collect()
    }

    /// For each condition: its values and the share of frames in which the object was found.
    #[getter]
    fn table<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyDict>> {
        let table = pyo3::types::PyDict::new(py);
        if let Some(sweep) = &self.own.sweep {
            for row in &sweep.rows {
                let cells: Vec<(f32, f32)> = row.cells.iter().map(|c| (c.value, c.rate(sweep.views))).collect();
                table.set_item(row.condition.name(), cells)?;
            }
        }
        Ok(table)
    }

    /// Array of shape (H, W, 3), uint8: bright where the object's keygraphs were found.
    #[getter]
    fn heat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rgb(py, &self.drawn())
    }

    /// The object that `keygraph assess --json` prints.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        object(py, &report::assessment_object(&self.own))
    }

    fn __str__(&self) -> String {
        in_python(&keygraph::words::assessment(&self.own))
    }

    fn __repr__(&self) -> String {
        let limits: Vec<&str> = self.own.limits.iter().map(|l| l.kind).collect();
        format!("Assessment({:?}, score={}, limits={limits:?})", self.own.name, self.score())
    }

    fn _repr_png_(&self, py: Python<'_>) -> PyResult<std::borrow::Cow<'static, [u8]>> {
        let bytes = py.detach(|| encoded(&self.drawn())).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(bytes.into())
    }
}

/// Renders frames of a picture, searches them, and tells how often it was found.
///
/// It takes some seconds; the interpreter is released meanwhile.
///
/// Args:
///     image: The picture, as for train.
///     model: The model that was made of this picture; without it, one is trained.
///     name, preset, luma, crop, order, format, size: As for train.
///     profile: Size of the frames, as for Detector.
///     views: Number of frames for each cell of the table, 1 to 1000.
///     threads: Frames searched at once, 1 to 8; one for each processor unless given.
#[pyfunction]
#[pyo3(signature = (image, model=None, *, name=None, preset="large", luma=false, profile="vga", views=8, threads=None, crop=None, order="rgb", format=None, size=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
pub fn assess(
    image: &Bound<'_, PyAny>,
    model: Option<&Bound<'_, Model>>,
    name: Option<&str>,
    preset: &str,
    luma: bool,
    profile: &str,
    views: usize,
    threads: Option<usize>,
    crop: Option<&Bound<'_, PyAny>>,
    order: &str,
    format: Option<&str>,
    size: Option<(usize, usize)>,
) -> PyResult<Assessment> {
    let py = image.py();
    let threads = threads.unwrap_or_else(default_threads);
    if !(1..=1000).contains(&views) {
        return Err(PyValueError::new_err(format!("views: expected 1 to 1000, got {views}")));
    }
    if !(1..=MAX_THREADS).contains(&threads) {
        return Err(PyValueError::new_err(format!("threads: expected 1 to {MAX_THREADS}, got {threads}")));
    }
    let options = Options { profile: self::profile(profile)?, views, threads };
    let preset = self::preset(preset)?;
    let model = model.map(Bound::get);
    if let Some(model) = model.filter(|m| m.view().objects() != 1) {
        let objects = model.view().objects();
        return Err(PyValueError::new_err(format!(
            "model: expected one object, got {objects}: assess them one by one"
        )));
    }
    let reading = Reading::new(order, format, size, None)?;
    let name = name_of(name, image)?;
    let (framed, _) = framed(image, crop, &reading)?;
    let picture = framed.picture;
    let own = py.detach(|| {
        if let Some(model) = model {
            return host::assess(model.view(), 0, Some(&picture), &options, || {});
        }
        match train_on(&picture, &name, preset, luma) {
            Ok((bytes, _)) => trained(&bytes, &picture, &options),
            Err(e) if e.is::<TrainError>() => Ok(host::Assessment::refused(&name, &e.to_string())),
            Err(e) => Err(e),
        }
    });
    Ok(Assessment { own: own.map_err(|e| exception(&e))?, picture })
}

fn trained(bytes: &[u8], picture: &Picture, options: &Options) -> Result<host::Assessment> {
    host::assess(&keygraph_core::Model::parse(bytes)?, 0, Some(picture), options, || {})
}
