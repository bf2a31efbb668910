//! Results of a frame, as objects of Python.
//!
//! In: what a search found. Out: a [`Answer`], which holds it once, and a [`Detection`] for each object.
//! Arrays and dicts are made when they are asked for. Memory: some 2 KB a frame. Cost: a microsecond for
//! each detection.

use std::path::PathBuf;

use keygraph::report::{detection_entry, frame_line, lost_entry};
use keygraph::search::Found;
use keygraph_core::stages::surface::SIDE;
use keygraph_core::{Lens, Stage, State, Surface};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList, PyType};

use crate::frame::Reading;
use crate::json::object;
use crate::model::{Model, named_scores};

/// What was found in one frame.
#[pyclass(frozen, module = "keygraph._keygraph")]
#[derive(Debug)]
pub struct Answer {
    model: Py<Model>,
    found: Found,
    lens: Option<Lens>,
    size: (usize, usize),
    source: Option<PathBuf>,
}

impl Answer {
    /// The results of a frame of `size` px, seen through `lens`. `source` is the path that the frame was read from.
    pub fn new(
        model: Py<Model>,
        found: Found,
        (size, lens): ((usize, usize), Option<Lens>),
        source: Option<PathBuf>,
    ) -> Self {
        Self { model, found, lens, size, source }
    }
}

/// A list of `keygraph.Detections` of an answer.
pub fn detections<'py>(answer: Answer, frame: &Bound<'py, PyAny>, reading: &Reading) -> PyResult<Bound<'py, PyAny>> {
    let py = frame.py();
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let class = CLASS.import(py, "keygraph._detections", "Detections")?;
    let count = answer.found.detections.len();
    let answer = Py::new(py, answer)?;
    let seen = (0..count).map(|i| Py::new(py, Detection { answer: answer.clone_ref(py), place: Place::Seen(i) }));
    let seen = PyList::new(py, seen.collect::<PyResult<Vec<_>>>()?)?;
    class.call1((seen, answer, frame, reading.arguments(py)?))
}

#[pymethods]
impl Answer {
    #[getter]
    fn width(&self) -> usize {
        self.size.0
    }

    #[getter]
    fn height(&self) -> usize {
        self.size.1
    }

    /// Whether the search came to its end; false when `budget_ms` stopped it.
    #[getter]
    fn complete(&self) -> bool {
        !self.found.stats.stopped
    }

    /// Whether a tracker searched the frame; `None` without a tracker.
    #[getter]
    fn searched(&self) -> Option<bool> {
        self.found.tracking.as_ref().map(|t| t.searched)
    }

    #[getter]
    fn source(&self) -> Option<String> {
        self.source.as_ref().map(|path| path.display().to_string())
    }

    /// Time of each stage and in total, ms.
    #[getter]
    fn time_ms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let times = PyDict::new(py);
        times.set_item("total", self.found.total_ns as f64 / 1e6)?;
        for (stage, ticks) in Stage::ALL.iter().zip(self.found.stats.ticks) {
            times.set_item(stage.name(), ticks as f64 / 1e6)?;
        }
        Ok(times)
    }

    /// The instances that a tracker has lost less than 30 frames ago.
    fn lost<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyList>> {
        let count = slf.get().found.tracking.as_ref().map_or(0, |t| t.lost.len());
        let lost =
            (0..count).map(|i| Py::new(slf.py(), Detection { answer: slf.clone().unbind(), place: Place::Lost(i) }));
        PyList::new(slf.py(), lost.collect::<PyResult<Vec<_>>>()?)
    }

    /// The line of the command line.
    fn line<'py>(&self, py: Python<'py>, source: Option<&str>, frame: u64) -> PyResult<Bound<'py, PyAny>> {
        let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let size = (side(self.size.0), side(self.size.1));
        let own = self.source().unwrap_or_default();
        let line = frame_line(source.unwrap_or(&own), frame, size, self.model.get().view(), &self.found, None);
        object(py, &line)
    }
}

/// Which of the results of a frame.
#[derive(Clone, Copy, Debug)]
enum Place {
    Seen(usize),
    Lost(usize),
}

/// An object that was found in a frame.
#[pyclass(frozen, module = "keygraph")]
#[derive(Debug)]
pub struct Detection {
    answer: Py<Answer>,
    place: Place,
}

impl Detection {
    /// The model that the object is from.
    pub fn model(&self) -> &Model {
        self.answer.get().model.get()
    }

    /// The lens that the frame was seen through.
    pub fn lens(&self) -> Option<Lens> {
        self.answer.get().lens
    }

    /// The surface on which the object lies.
    pub fn bent(&self) -> Option<&Surface> {
        let Place::Seen(i) = self.place else { return None };
        self.answer.get().found.surface(i)
    }

    /// The detection of the core.
    pub fn core(&self) -> &keygraph_core::Detection {
        let found = &self.answer.get().found;
        match (self.place, &found.tracking) {
            (Place::Lost(i), Some(tracking)) => &tracking.lost[i].detection,
            (Place::Lost(i) | Place::Seen(i), _) => &found.detections[i],
        }
    }

    /// Whether the frame was searched mirrored.
    pub fn is_mirrored(&self) -> bool {
        self.answer.get().found.mirrored
    }

    /// The id, the state and the frames since it was seen.
    fn track(&self) -> Option<(u32, State, u32)> {
        let tracking = self.answer.get().found.tracking.as_ref()?;
        match self.place {
            Place::Seen(i) => tracking.seen.get(i).map(|&(id, state)| (id, state, 0)),
            Place::Lost(i) => tracking.lost.get(i).map(|t| (t.id, t.state, t.unseen)),
        }
    }

    /// The text of a label: the name, the id if there is one, and the score.
    pub fn label(&self) -> String {
        let id = self.id().map_or_else(String::new, |id| format!(" #{id}"));
        format!("{}{id} {:.2}", self.object(), self.core().score)
    }
}

#[pymethods]
impl Detection {
    /// Name of the object.
    #[getter]
    fn object(&self) -> String {
        self.model().name(self.core().object).into()
    }

    /// Index of the object in the model.
    #[getter]
    fn index(&self) -> u16 {
        self.core().object
    }

    /// Estimated probability that the detection is right, 0 to 1.
    #[getter]
    fn score(&self) -> f32 {
        self.core().score
    }

    /// Share of the object that is seen and agrees, 0 to 1.
    #[getter]
    fn visible(&self) -> f32 {
        self.core().appearance.visible
    }

    /// Number of keygraphs of which all vertices agree with the pose.
    #[getter]
    fn votes(&self) -> u16 {
        self.core().votes
    }

    /// Number of corners of the frame that agree with the pose.
    #[getter]
    fn agreeing(&self) -> u16 {
        self.core().agreeing
    }

    /// Array of shape (4, 2), float32, px of the frame.
    #[getter]
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        PyArray1::from_slice(py, self.core().corners.as_flattened()).reshape([4, 2])
    }

    /// Array of shape (3, 3), float64: from px of the picture to px of the frame.
    #[getter]
    fn homography<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.core().homography.0.map(f64::from)).reshape([3, 3])
    }

    /// Array of shape (4,), float32: left, top, right and bottom of the upright box, px.
    #[getter]
    fn xyxy<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        let start = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        let sides =
            self.core().corners.iter().fold(start, |[l, t, r, b], &[x, y]| [l.min(x), t.min(y), r.max(x), b.max(y)]);
        PyArray1::from_slice(py, &sides)
    }

    /// Where the picture lies when a plane does not explain what is seen, such as a label on a can: array of
    /// shape (9, 9, 2), float32, points of the picture row by row, px of the frame. `None` for a plane.
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        let array = |s: &Surface| PyArray1::from_slice(py, s.points.as_flattened()).reshape([SIDE, SIDE, 2]);
        self.bent().map(array).transpose()
    }

    /// The other objects that could be at this place: their names and scores, best first.
    #[getter]
    fn rivals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let rivals = match self.place {
            Place::Seen(i) => self.answer.get().found.rivals.get(i).map_or(&[][..], Vec::as_slice),
            Place::Lost(_) => &[],
        };
        named_scores(py, self.model(), rivals)
    }

    /// Number that stays with the instance while a tracker follows it; `None` without a tracker.
    #[getter]
    fn id(&self) -> Option<u32> {
        self.track().map(|(id, ..)| id)
    }

    /// `"found"`, `"tracked"` or `"lost"`.
    #[getter]
    fn state(&self) -> &'static str {
        self.track().map_or(State::Found, |(_, state, _)| state).name()
    }

    /// Number of frames since the instance was seen; 0 when it is seen in this frame.
    #[getter]
    fn unseen(&self) -> u32 {
        self.track().map_or(0, |(.., unseen)| unseen)
    }

    /// The object of the line that `keygraph detect --json` prints.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (model, found) = (self.model().view(), &self.answer.get().found);
        let entry = match (self.place, &found.tracking) {
            (Place::Lost(i), Some(tracking)) => lost_entry(model, &tracking.lost[i]),
            (Place::Lost(i) | Place::Seen(i), _) => detection_entry(model, found, i),
        };
        object(py, &entry)
    }

    fn __repr__(&self) -> String {
        let corners: Vec<String> = self.core().corners.iter().map(|[x, y]| format!("({x:.0}, {y:.0})")).collect();
        let track =
            self.track().map_or_else(String::new, |(id, state, _)| format!(", id={id}, state=\"{}\"", state.name()));
        format!(
            "Detection({:?}, score={:.2}{track}, corners=[{}])",
            self.object(),
            self.core().score,
            corners.join(", ")
        )
    }

    /// A table of the values, and the outline in its frame, for notebooks.
    fn _repr_html_(&self) -> String {
        let escaped = self.object().replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let (width, height) = self.answer.get().size;
        let points: Vec<String> = self.core().corners.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let id = self.id().map_or_else(String::new, |id| format!(" #{id}, {}", self.state()));
        format!(
            "<svg viewBox=\"0 0 {width} {height}\" width=\"160\" style=\"background:#ddd;vertical-align:middle\">\
             <polygon points=\"{}\" fill=\"#40dc5080\" stroke=\"#186428\" stroke-width=\"{}\"/></svg> \
             <b>{escaped}</b>{id}, score {:.2}, visible {:.0} %",
            points.join(" "),
            width.div_ceil(150),
            self.core().score,
            100.0 * self.core().appearance.visible
        )
    }
}
