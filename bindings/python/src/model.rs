//! Models: trained, packed, loaded, saved.
//!
//! In: pictures, files, bytes. Out: a [`Model`], which owns its bytes and has checked them once.
//! Memory: the bytes. Cost: half a second to train, a pass over the bytes to load.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use keygraph::advice;
use keygraph::file::read_whole;
use keygraph::learn::{Preset, has_colour, merge, slimmed, train_within};
use keygraph::output::{check_name, is_plain, write_file};
use keygraph::picture::{Framed, Part, read_framed};
use keygraph::repack::{Changes, repack};
use keygraph_core::{FeatureKind, Method};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyList, PyTuple, PyType};
use self_cell::self_cell;

use crate::errors::{TrainingError, exception, frame_error, value_error, warn};
use crate::frame::{Reading, frame, path_of};
use crate::sensor;

type View<'a> = keygraph_core::Model<'a>;

// The macro's own code is not safe by the compiler's measure; the crate is made for this.
#[allow(unsafe_code, missing_docs, missing_debug_implementations)]
mod owned {
    use super::{View, self_cell};
    self_cell!(
        /// Bytes, and the view of them.
        pub struct Owned {
            owner: Vec<u8>,
            #[covariant]
            dependent: View,
        }
    );
}
use owned::Owned;

/// One or many objects to find, trained from one picture each.
///
/// Make one with :func:`keygraph.train`, :func:`keygraph.pack` or :meth:`Model.load`. A model cannot
/// be changed. It can be pickled, compared and hashed, and shared between threads.
#[pyclass(frozen, module = "keygraph")]
pub struct Model {
    owned: Arc<Owned>,
    preset: Option<Preset>,
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Model({} bytes)", self.data().len())
    }
}

/// The preset with a name.
pub fn preset(name: &str) -> PyResult<Preset> {
    let found = Preset::NAMED.iter().find(|(known, _)| *known == name).map(|(_, preset)| *preset);
    found.ok_or_else(|| {
        PyValueError::new_err(format!(
            "preset: expected \"large\", \"standard\", \"compact\" or \"paper\", got \"{name}\""
        ))
    })
}

impl Model {
    /// Checks bytes. Models of the paper's method have its preset; of others it is not written in them.
    pub fn of(bytes: Vec<u8>, preset: Option<Preset>) -> PyResult<Self> {
        let owned = Owned::try_new(bytes, |bytes| View::parse(bytes)).map_err(|e| exception(&e.into()))?;
        let paper = owned.borrow_dependent().method() == Method::Paper;
        let preset = if paper { Some(Preset::Paper) } else { preset };
        Ok(Self { owned: Arc::new(owned), preset })
    }

    /// The view of the core.
    pub fn view(&self) -> &View<'_> {
        self.owned.borrow_dependent()
    }

    fn data(&self) -> &[u8] {
        self.owned.borrow_owner()
    }

    /// The model with the same bytes.
    pub fn share(&self) -> Self {
        Self { owned: Arc::clone(&self.owned), preset: self.preset }
    }

    /// The name of an object.
    pub fn name(&self, object: u16) -> &str {
        self.view().object(usize::from(object)).name
    }
}

/// An object of a model.
#[pyclass(frozen, module = "keygraph", get_all)]
#[derive(Debug)]
pub struct ModelObject {
    /// Name of the object.
    name: String,
    /// Width of the picture that it was trained from, px.
    width: u32,
    /// Height of that picture, px.
    height: u32,
}

#[pymethods]
impl ModelObject {
    fn __repr__(&self) -> String {
        format!("ModelObject(name={:?}, width={}, height={})", self.name, self.width, self.height)
    }
}

#[pymethods]
impl Model {
    /// Checks the bytes of a model.
    #[new]
    fn new(py: Python<'_>, data: PyBackedBytes) -> PyResult<Self> {
        py.detach(|| Self::of(data.to_vec(), None))
    }

    /// Reads a model file.
    #[classmethod]
    fn load(_class: &Bound<'_, PyType>, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| read(&path))
    }

    /// Writes the model to a file, whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_file(&path, |file| Ok(file.write_all(self.data())?)))
            .map_err(|e| PyOSError::new_err(format!("{e:#}")))
    }

    /// The model without the objects that have these names. The others keep their order. It is what packing
    /// their models gives.
    ///
    /// Raises:
    ///     ValueError: An object is not in the model, or none would be left.
    #[pyo3(signature = (*names))]
    fn without(&self, py: Python<'_>, names: Vec<String>) -> PyResult<Self> {
        let changes = Changes { remove: &names, ..Changes::default() };
        let changed = py.detach(|| repack(self.view(), &changes)).map_err(|e| exception(&e))?;
        Self::of(changed.model, self.preset)
    }

    /// The model without what a search for all its objects at once does not read. It finds the same, but for objects
    /// in doubt, and has a half to a fifth of the bytes. It cannot be packed again.
    ///
    /// Raises:
    ///     ValueError: The model has one object, or is of the paper's method.
    fn slim(&self, py: Python<'_>) -> PyResult<Self> {
        let slim = py.detach(|| slimmed(self.view())).map_err(|e| exception(&e.into()))?;
        Self::of(slim, self.preset)
    }

    /// The bytes of the model file.
    fn bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, self.data())
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        self.bytes(py)
    }

    /// The objects, in the order of their indices.
    #[getter]
    fn objects(&self, py: Python<'_>) -> PyResult<Py<PyTuple>> {
        let all = (0..self.view().objects()).map(|i| {
            let o = self.view().object(i);
            Py::new(py, ModelObject { name: o.name.into(), width: o.width, height: o.height })
        });
        Ok(PyTuple::new(py, all.collect::<PyResult<Vec<_>>>()?)?.unbind())
    }

    /// The names of the objects, in the order of their indices.
    #[getter]
    fn names(&self) -> Vec<String> {
        (0..self.view().objects()).map(|i| self.view().object(i).name.to_string()).collect()
    }

    /// The preset that the model was trained with; `None` when it is not known, since files do not tell.
    #[getter]
    fn preset(&self) -> Option<&'static str> {
        Preset::NAMED.iter().find(|(_, p)| Some(*p) == self.preset).map(|(name, _)| *name)
    }

    /// The length of the model, bytes.
    #[getter]
    fn nbytes(&self) -> usize {
        self.data().len()
    }

    /// The number of keypoints in all views.
    #[getter]
    fn keypoints(&self) -> usize {
        self.view().keypoints()
    }

    /// The number of keygraphs.
    #[getter]
    fn keygraphs(&self) -> usize {
        self.view().keygraphs()
    }

    /// Whether the model was trained on luma alone.
    #[getter]
    fn luma_only(&self) -> bool {
        self.view().feature() == FeatureKind::Luma
    }

    fn __len__(&self) -> usize {
        self.view().objects()
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.data() == other.data()
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.data().hash(&mut hasher);
        hasher.finish()
    }

    fn __repr__(&self) -> String {
        format!("Model({}, {} bytes)", self.names().join(", "), self.data().len())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let restore = py.import("keygraph._keygraph")?.getattr("_restore")?;
        Ok((restore, (self.bytes(py), self.preset()).into_bound_py_any(py)?))
    }
}

/// What a pickle holds, as a model.
#[pyfunction]
#[pyo3(name = "_restore")]
pub fn restore(data: PyBackedBytes, name: Option<&str>) -> PyResult<Model> {
    Model::of(data.to_vec(), name.map(preset).transpose()?)
}

/// Reads a model file.
fn read(path: &Path) -> PyResult<Model> {
    let bytes = read_whole(path).with_context(|| path.display().to_string()).map_err(|e| exception(&e))?;
    Model::of(bytes, None).map_err(|e| {
        Python::attach(|py| PyErr::from_type(e.get_type(py), format!("{}: {}", path.display(), e.value(py))))
    })
}

/// Merges models into one.
///
/// Args:
///     models: A list of Model, or of paths of `.kgm` files. Their objects keep their order.
///
/// Raises:
///     ModelFileError: The models differ in method or feature.
#[pyfunction]
pub fn pack(py: Python<'_>, models: &Bound<'_, PyAny>) -> PyResult<Model> {
    joined(py, models)
}

/// One model of a model, a path, or a list of them.
pub fn joined(py: Python<'_>, models: &Bound<'_, PyAny>) -> PyResult<Model> {
    let mut all = Vec::new();
    match one(models)? {
        Some(model) => all.push(model),
        None => {
            let Ok(several) = models.try_iter() else {
                return Err(not_a_model("models", models));
            };
            for model in several {
                let model = model?;
                all.push(one(&model)?.ok_or_else(|| not_a_model("models", &model))?);
            }
        }
    }
    match &all[..] {
        [] => Err(PyValueError::new_err("models: expected at least one model, got none")),
        [only] => Ok(only.share()),
        [first, ..] => {
            let preset = first.preset.filter(|_| all.iter().all(|m| m.preset == first.preset));
            let bytes: Vec<&[u8]> = all.iter().map(Model::data).collect();
            let merged = py.detach(|| merge(&bytes)).map_err(|e| exception(&e))?;
            Model::of(merged, preset)
        }
    }
}

/// A model, or the model of a path; `None` for anything else.
fn one(object: &Bound<'_, PyAny>) -> PyResult<Option<Model>> {
    if let Ok(model) = object.cast::<Model>() {
        return Ok(Some(model.get().share()));
    }
    let py = object.py();
    path_of(object)?.map(|path| py.detach(|| read(&path))).transpose()
}

fn not_a_model(what: &str, given: &Bound<'_, PyAny>) -> PyErr {
    let class = given.get_type().name().map(|n| n.to_string()).unwrap_or_default();
    PyTypeError::new_err(format!("{what}: expected a Model, a path of a .kgm file, or a list of them; got {class}"))
}

/// A part of a picture: four numbers, or `"x,y,width,height"`.
fn part(crop: &Bound<'_, PyAny>) -> PyResult<Part> {
    let text: String = match crop.extract::<(u32, u32, u32, u32)>() {
        Ok((x, y, width, height)) => format!("{x},{y},{width},{height}"),
        Err(_) => crop.extract().map_err(|_| PyTypeError::new_err("crop: expected (x, y, width, height), whole px"))?,
    };
    text.parse().map_err(|e| value_error(format!("crop: {e}")))
}

/// The picture to train on, and the name of its file.
pub fn framed(
    image: &Bound<'_, PyAny>,
    crop: Option<&Bound<'_, PyAny>>,
    reading: &Reading,
) -> PyResult<(Framed, PathBuf)> {
    let py = image.py();
    let crop = crop.map(part).transpose()?;
    let (framed, path) = match path_of(image)? {
        Some(path) => (py.detach(|| read_framed(&path, crop)).map_err(|e| exception(&e))?, path),
        None => {
            let given = frame(image, reading)?;
            let view = given.view()?;
            let whole = py.detach(|| sensor::picture(&view)).map_err(frame_error)?;
            let size = (whole.width, whole.height);
            let all = Part { x: 0, y: 0, width: size.0, height: size.1 };
            let part = crop.unwrap_or(all);
            let end = |start: u32, length: u32| u64::from(start) + u64::from(length);
            if end(part.x, part.width) > size.0.into() || end(part.y, part.height) > size.1.into() {
                return Err(PyValueError::new_err(format!(
                    "crop: the part ({}, {}, {}, {}) leaves the picture, which has {}x{} px",
                    part.x, part.y, part.width, part.height, size.0, size.1
                )));
            }
            let picture = if part == all { whole } else { whole.cut(part) };
            (Framed { picture, part, whole: size, transparent: false }, PathBuf::from("the picture"))
        }
    };
    for said in advice::framing(&framed, &path, crop) {
        warn(py, &said)?;
    }
    Ok((framed, path))
}

/// The name of an object: the one that was given, or else that of the picture's file.
pub fn name_of(name: Option<&str>, image: &Bound<'_, PyAny>) -> PyResult<String> {
    if let Some(name) = name {
        check_name(name).map_err(|e| exception(&e))?;
        return Ok(name.into());
    }
    let stem = path_of(image)?.and_then(|path| path.file_stem().map(|s| s.to_string_lossy().into_owned()));
    Ok(stem.map_or_else(|| "object".into(), |stem| stem.replace(|c| !is_plain(c), "_")))
}

/// Trains a model of one picture of an object, seen from the front with nothing else on it.
///
/// It takes half a second; the interpreter is released meanwhile. Trainings of several threads wait for
/// each other. What makes the model less useful than it looks is told as TrainingWarning.
///
/// Args:
///     image: The picture: a path, an array of uint8 of shape (H, W, 3) or (H, W), a PIL image, or raw
///         bytes with `format` and `size`. Files are turned upright by their EXIF orientation.
///     name: Name of the object; that of the file, or `"object"`, unless given.
///     preset: How much the model holds: `"large"` (up to 2 MB), `"standard"` (1.5 MB), `"compact"`
///         (512 KB), or `"paper"`, the method of the paper as written.
///     luma: Train on luma alone, for cameras without colour.
///     max_bytes: Maximum size of the model, instead of the preset's.
///     crop: The part of the picture that shows the object: (x, y, width, height), px.
///     order: `"rgb"`, or `"bgr"` as OpenCV has it.
///     format: The format of raw bytes, see Detector.detect.
///     size: Width and height of raw bytes, px.
///
/// Raises:
///     TrainingError: The picture is too small, or has too little texture.
///     TypeError, ValueError, OSError: As Detector.detect.
#[pyfunction]
#[pyo3(signature = (image, name=None, preset="large", *, luma=false, max_bytes=None, crop=None, order="rgb", format=None, size=None))]
#[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
pub fn train(
    image: &Bound<'_, PyAny>,
    name: Option<&str>,
    preset: &str,
    luma: bool,
    max_bytes: Option<usize>,
    crop: Option<&Bound<'_, PyAny>>,
    order: &str,
    format: Option<&str>,
    size: Option<(usize, usize)>,
) -> PyResult<Model> {
    let py = image.py();
    let preset = self::preset(preset)?;
    if max_bytes.is_some_and(|n| n > 64 << 20) {
        return Err(PyValueError::new_err("max_bytes: expected at most 67108864 bytes"));
    }
    let reading = Reading::new(order, format, size, None)?;
    let name = name_of(name, image)?;
    let (framed, _) = framed(image, crop, &reading)?;
    let picture = framed.picture;
    if !luma && !has_colour(&picture) {
        if preset == Preset::Paper {
            return Err(TrainingError::new_err(
                "the picture has no colour, which the features of preset=\"paper\" are made of: use another preset",
            ));
        }
        warn(py, "the picture has no colour: trained on luma alone")?;
    }
    let bytes = max_bytes.unwrap_or(preset.bytes());
    let trained = py.detach(|| train_within(&picture, &name, preset, luma, bytes));
    let (data, trained) = trained.context("cannot train on the picture").map_err(|e| exception(&e))?;
    let model = Model::of(data, Some(preset))?;
    let said = py.detach(|| advice::of_model("the picture", &name, &picture, model.view(), &trained));
    for said in said.map_err(|e| exception(&e))?.warnings {
        warn(py, &said)?;
    }
    Ok(model)
}

/// The objects of a model, for `__repr__` of what uses it.
pub fn listed(model: &Model) -> String {
    model.names().join(", ")
}

/// A list of the names and scores of rivals.
pub fn named_scores<'py>(py: Python<'py>, model: &Model, rivals: &[(u16, f32)]) -> PyResult<Bound<'py, PyList>> {
    PyList::new(py, rivals.iter().map(|&(object, score)| (model.name(object), score)))
}
