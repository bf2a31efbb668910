//! Detectors and trackers.
//!
//! In: models, options, frames. Out: lists of detections. Memory: a detector of the core for each object
//! of Python, on the heap (1.2 MB for the profile vga). Cost: that of the search, and some microseconds.
//! The interpreter is released from the pixels to the results. A second thread that uses the same
//! detector waits.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use keygraph::region::Region;
use keygraph::search::{Follower, Found, MAX_THREADS, Profile, Request, Shape, depth_of, follow_frame, search_frame};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::errors::{defect, value_error};
use crate::frame::{Reading, View, frame, path_of};
use crate::model::{Model, joined, listed};
use crate::result::{Answer, detections};
use crate::search::{Refused, Room, Search};
use crate::space::lens_of;

/// The profile with a name.
pub fn profile(name: &str) -> PyResult<Profile> {
    let found = Profile::NAMED.iter().find(|(known, _)| *known == name).map(|(_, profile)| *profile);
    found.ok_or_else(|| {
        PyValueError::new_err(format!("profile: expected \"hd\", \"vga\", \"qvga\" or \"qqvga\", got \"{name}\""))
    })
}

/// The shapes that objects may have, of these names.
fn shape(name: &str) -> PyResult<Shape> {
    let found = Shape::NAMED.iter().find(|(known, _)| *known == name).map(|(_, shape)| *shape);
    found.ok_or_else(|| PyValueError::new_err(format!("surface: expected \"any\" or \"plane\", got \"{name}\"")))
}

fn profile_name(profile: Profile) -> &'static str {
    Profile::NAMED.iter().find(|(_, p)| *p == profile).map_or("", |(name, _)| *name)
}

/// The part of each frame that is searched: four lengths in px or percent, or one string of them.
fn region(roi: &Bound<'_, PyAny>) -> PyResult<Region> {
    let text = match roi.extract::<String>() {
        Ok(text) => text,
        Err(_) => {
            let wrong = || {
                PyTypeError::new_err("roi: expected (x, y, width, height), each whole px or a string such as \"25%\"")
            };
            let lengths = roi.try_iter().map_err(|_| wrong())?;
            let lengths = lengths.map(|v| Ok(v?.str()?.to_string())).collect::<PyResult<Vec<_>>>()?;
            lengths.join(",")
        }
    };
    text.parse().map_err(|e| value_error(format!("roi: {e}")))
}

fn share(name: &str, v: f32) -> PyResult<f32> {
    if (0.0..=1.0).contains(&v) {
        Ok(v)
    } else {
        Err(PyValueError::new_err(format!("{name}: expected 0 to 1, got {v}")))
    }
}

/// The time of `budget_ms`.
fn budget(ms: f64) -> PyResult<Duration> {
    if ms > 0.0 && ms <= 1e6 {
        return Ok(Duration::from_secs_f64(ms / 1e3));
    }
    Err(PyValueError::new_err(format!("budget_ms: expected a number of ms above 0, got {ms}")))
}

/// The lock of a detector. A detector keeps nothing from frame to frame that a panic could damage.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads a frame, and searches it with `work` while the interpreter is released.
fn answer<'py>(
    object: &Bound<'py, PyAny>,
    reading: &Reading,
    (model, request): (&Py<Model>, &Request),
    work: impl Send + FnOnce(&Search<'_>, &View<'_>) -> Result<Found, Refused>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = object.py();
    let source: Option<PathBuf> = path_of(object)?;
    let given = frame(object, reading)?;
    let view = given.view()?;
    let start = Instant::now();
    let search = Search { model: model.get(), request, start };
    let found = py.detach(|| catch_unwind(AssertUnwindSafe(|| work(&search, &view))));
    let found = found.map_err(|_| defect("the search failed"))??;
    let answer = Answer::new(model.clone_ref(py), found, (view.size(), request.lens), source);
    detections(answer, object, reading)
}

/// Finds the objects of models in frames, each frame by itself.
///
/// A detector may be used by several threads, which then wait for each other. To search in parallel,
/// make one for each thread: they share the model's bytes.
///
/// Args:
///     models: A Model, a path of a `.kgm` file, or a list of them. Each gets its own name in results.
///     profile: Size that frames are searched at, larger ones are scaled down: `"hd"` (1280x720 px),
///         `"vga"` (640x480), `"qvga"` (320x240) or `"qqvga"` (160x120).
///     threshold: Minimum score of a detection, 0 to 1.
///     min_visible: Minimum share of an object that must be seen and agree, 0 to 1.
///     thorough: Search all of each frame for all of the models, and again in tiles: finds small objects,
///         in three times the time of a frame that shows nothing.
///     wide: Search for what is seen from far to the side, too, up to some 80 degrees: each frame is searched eight
///         times more, as it looks squeezed along eight directions, unless the one object of the models is found
///         without doubt. It takes a second detector, of the next larger profile (3 MB for `"vga"`).
///     all_names: Report all objects that could be at a place, and not the best alone.
///     budget_ms: Stop the search of a frame after this time, ms, and report what was found.
///     roi: Search this part of each frame alone, at its own resolution: (x, y, width, height), each px or
///         a string such as `"25%"`. Results stay in px of the whole frame.
///     mirror: Search frames mirrored left to right, as those of selfie cameras are.
///     surface: With `"any"`, an object that a plane does not explain, such as a label on a can, has a
///         `surface`; with `"plane"` none has.
///     intrinsics: With `distortion`: (fx, fy, cx, cy), px of the frame, or a camera matrix of shape (3, 3).
///     distortion: Coefficients of the lens in OpenCV's order: 4, 5 or 8, or 4 with `fisheye`. Each detection then
///         has a `surface`, flat or bent, seen through the lens, and `pose()` takes it into account.
///     fisheye: Whether the coefficients are those of `cv2.fisheye`.
///     threads: Threads that search a frame together, 1 to 8. The results are the same. In a child that was forked,
///         one thread searches.
///     digests: Report a digest of each stage's output in `to_dict()`, to compare machines by.
#[pyclass(frozen, module = "keygraph")]
#[derive(Debug)]
pub struct Detector {
    model: Py<Model>,
    request: Request,
    room: Mutex<Room>,
}

#[pymethods]
impl Detector {
    #[new]
    #[pyo3(signature = (models, profile="vga", threshold=0.8, *, min_visible=0.0, thorough=false, wide=false, all_names=false, budget_ms=None, roi=None, mirror=false, surface="any", intrinsics=None, distortion=None, fisheye=false, threads=1, digests=false))]
    #[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
    fn new(
        py: Python<'_>,
        models: &Bound<'_, PyAny>,
        profile: &str,
        threshold: f32,
        min_visible: f32,
        thorough: bool,
        wide: bool,
        all_names: bool,
        budget_ms: Option<f64>,
        roi: Option<&Bound<'_, PyAny>>,
        mirror: bool,
        surface: &str,
        intrinsics: Option<&Bound<'_, PyAny>>,
        distortion: Option<&Bound<'_, PyAny>>,
        fisheye: bool,
        threads: usize,
        digests: bool,
    ) -> PyResult<Self> {
        let lens = lens_of(intrinsics, distortion, fisheye)?;
        if mirror && lens.is_some() {
            return Err(PyValueError::new_err("mirror: a lens is that of frames that are not mirrored"));
        }
        if wide && (lens.is_some() || digests) {
            return Err(PyValueError::new_err("wide: leave out distortion and digests"));
        }
        if !(1..=MAX_THREADS).contains(&threads) {
            return Err(PyValueError::new_err(format!("threads: expected 1 to {MAX_THREADS}, got {threads}")));
        }
        let request = Request {
            min_visible: share("min_visible", min_visible)?,
            depth: depth_of(thorough),
            wide,
            all_names,
            shape: shape(surface)?,
            lens,
            budget: budget_ms.map(budget).transpose()?,
            region: roi.map(region).transpose()?,
            mirror,
            threads,
            digests,
            ..Request::new(self::profile(profile)?, share("threshold", threshold)?)
        };
        let room = Mutex::new(py.detach(|| Room::of(&request))?);
        Ok(Self { model: Py::new(py, joined(py, models)?)?, request, room })
    }

    /// Finds the objects in a frame. The interpreter is released meanwhile.
    ///
    /// Args:
    ///     frame: An array of uint8 of shape (H, W, 3) or (H, W), a PIL image, a path, or raw bytes. Views
    ///         are read in place when the pixels of a row stand one after the other.
    ///     order: `"rgb"`, or `"bgr"` as OpenCV has it (one copy).
    ///     format: The format of raw bytes: `"yuyv"`, `"uyvy"`, `"nv12"`, `"i420"`, `"rgb565"`,
    ///         `"rgb565be"`, `"rgb"` or `"gray"`.
    ///     size: Width and height of raw bytes, px.
    ///     stride: Bytes from a row to the next of raw bytes. Without it, rows have nothing between them.
    ///
    /// Returns:
    ///     A list of Detection, best score first, in px of the frame as it came.
    ///
    /// Raises:
    ///     TypeError: The object is none of these, or its dtype is not uint8.
    ///     ValueError: The shape, the size or the format does not fit.
    ///     OSError: The file cannot be read.
    #[pyo3(signature = (frame, *, order="rgb", format=None, size=None, stride=None))]
    fn detect<'py>(
        &self,
        frame: &Bound<'py, PyAny>,
        order: &str,
        format: Option<&str>,
        size: Option<(usize, usize)>,
        stride: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let reading = Reading::new(order, format, size, stride)?;
        answer(frame, &reading, (&self.model, &self.request), |search, view| {
            let Room { detector, larger, scratch } = &mut *lock(&self.room);
            let found = search.run(view, scratch, |frame, request| {
                search_frame(detector.any(), frame, search.model.view(), request)
            })?;
            match larger {
                Some(larger) => search.widen(found, view, larger.any()),
                None => Ok(found),
            }
        })
    }

    /// The objects that are searched for, as one model.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    /// The size that frames are searched at.
    #[getter]
    fn profile(&self) -> &'static str {
        profile_name(self.request.profile)
    }

    /// The minimum score of a detection.
    #[getter]
    fn threshold(&self) -> f32 {
        self.request.threshold
    }

    fn __repr__(&self) -> String {
        format!(
            "Detector({}, profile=\"{}\", threshold={})",
            listed(self.model.get()),
            self.profile(),
            self.threshold()
        )
    }
}

/// What a tracker knows from the frames before.
#[derive(Debug)]
struct Trail {
    room: Room,
    follower: Follower,
    size: Option<(usize, usize)>,
}

/// Follows the objects of models through the frames of one camera, in order.
///
/// Args:
///     models: A Model, a path of a `.kgm` file, or a list of them. Each gets its own name in results.
///     profile: Size that frames are searched at, larger ones are scaled down: `"hd"` (1280x720 px),
///         `"vga"` (640x480), `"qvga"` (320x240) or `"qqvga"` (160x120).
///     threshold: Minimum score of a detection, 0 to 1.
///     min_visible: Minimum share of an object that must be seen and agree, 0 to 1.
///     thorough: Search all of each frame for all of the models, and again in tiles: finds small objects,
///         in three times the time of a frame that shows nothing.
///     budget_ms: Stop the search of a frame after this time, ms, and report what was found.
///     roi: Search this part of each frame alone, at its own resolution: (x, y, width, height), each px or
///         a string such as `"25%"`. Results stay in px of the whole frame.
///     mirror: Search frames mirrored left to right, as those of selfie cameras are.
///     surface: With `"any"`, an object that a plane does not explain, such as a label on a can, has a
///         `surface`; with `"plane"` none has.
///     intrinsics: With `distortion`: (fx, fy, cx, cy), px of the frame, or a camera matrix of shape (3, 3).
///     distortion: Coefficients of the lens in OpenCV's order: 4, 5 or 8, or 4 with `fisheye`. Each detection then
///         has a `surface`, flat or bent, seen through the lens, and `pose()` takes it into account.
///     fisheye: Whether the coefficients are those of `cv2.fisheye`.
///     threads: Threads that search a frame together, 1 to 8. The results are the same. In a child that was forked,
///         one thread searches.
///     smooth: Average outlines over this many frames while they stand still, 1 to 255; 0 leaves them as they are.
///         They tremble less, and lag by less than a pixel of the searched frame.
#[pyclass(frozen, module = "keygraph")]
#[derive(Debug)]
pub struct Tracker {
    model: Py<Model>,
    request: Request,
    trail: Mutex<Trail>,
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (models, profile="vga", threshold=0.8, *, min_visible=0.0, thorough=false, budget_ms=None, roi=None, mirror=false, surface="any", intrinsics=None, distortion=None, fisheye=false, threads=1, smooth=0))]
    #[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
    fn new(
        py: Python<'_>,
        models: &Bound<'_, PyAny>,
        profile: &str,
        threshold: f32,
        min_visible: f32,
        thorough: bool,
        budget_ms: Option<f64>,
        roi: Option<&Bound<'_, PyAny>>,
        mirror: bool,
        surface: &str,
        intrinsics: Option<&Bound<'_, PyAny>>,
        distortion: Option<&Bound<'_, PyAny>>,
        fisheye: bool,
        threads: usize,
        smooth: i64,
    ) -> PyResult<Self> {
        let frames = u8::try_from(smooth);
        let smooth = frames.map_err(|_| PyValueError::new_err(format!("smooth: expected 0 to 255, got {smooth}")))?;
        let Detector { model, request, room } = Detector::new(
            py,
            models,
            profile,
            threshold,
            min_visible,
            thorough,
            false,
            false,
            budget_ms,
            roi,
            mirror,
            surface,
            intrinsics,
            distortion,
            fisheye,
            threads,
            false,
        )?;
        let room = room.into_inner().unwrap_or_else(PoisonError::into_inner);
        let trail = Mutex::new(Trail { room, follower: Follower::default(), size: None });
        Ok(Self { model, request: Request { smooth, ..request }, trail })
    }

    /// Follows the objects into the next frame, and searches it where needed. Each detection then has an
    /// `id` that stays with it, and a `state`; what is gone is in `lost` for 30 frames. A frame of another
    /// size starts anew.
    ///
    /// Args:
    ///     frame: An array of uint8 of shape (H, W, 3) or (H, W), a PIL image, a path, or raw bytes. Views
    ///         are read in place when the pixels of a row stand one after the other.
    ///     order: `"rgb"`, or `"bgr"` as OpenCV has it (one copy).
    ///     format: The format of raw bytes: `"yuyv"`, `"uyvy"`, `"nv12"`, `"i420"`, `"rgb565"`,
    ///         `"rgb565be"`, `"rgb"` or `"gray"`.
    ///     size: Width and height of raw bytes, px.
    ///     stride: Bytes from a row to the next of raw bytes. Without it, rows have nothing between them.
    ///
    /// Returns:
    ///     A list of Detection, best score first, in px of the frame as it came.
    ///
    /// Raises:
    ///     TypeError: The object is none of these, or its dtype is not uint8.
    ///     ValueError: The shape, the size or the format does not fit.
    ///     OSError: The file cannot be read.
    #[pyo3(signature = (frame, *, order="rgb", format=None, size=None, stride=None))]
    fn track<'py>(
        &self,
        frame: &Bound<'py, PyAny>,
        order: &str,
        format: Option<&str>,
        size: Option<(usize, usize)>,
        stride: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let reading = Reading::new(order, format, size, stride)?;
        answer(frame, &reading, (&self.model, &self.request), |search, view| {
            let mut trail = lock(&self.trail);
            let Trail { room: Room { detector, scratch, .. }, follower, size } = &mut *trail;
            // The size is put back below, when the frame was tracked.
            if size.take().is_none_or(|before| before != view.size()) {
                follower.tracker.reset();
            }
            let found = search.run(view, scratch, |frame, request| {
                follow_frame(detector.any(), follower, frame, search.model.view(), request)
            })?;
            *size = Some(view.size());
            Ok(found)
        })
    }

    /// Forgets all objects: the next frame is the first of another video. Ids are not used again.
    fn reset(&self, py: Python<'_>) {
        py.detach(|| lock(&self.trail).follower.tracker.reset());
    }

    /// Makes the next frame be searched, even when all objects are in view.
    fn search_next(&self, py: Python<'_>) {
        py.detach(|| lock(&self.trail).follower.tracker.search_next());
    }

    /// The objects that are searched for, as one model.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    /// The size that frames are searched at.
    #[getter]
    fn profile(&self) -> &'static str {
        profile_name(self.request.profile)
    }

    /// The minimum score of a new detection.
    #[getter]
    fn threshold(&self) -> f32 {
        self.request.threshold
    }

    fn __repr__(&self) -> String {
        format!("Tracker({}, profile=\"{}\", threshold={})", listed(self.model.get()), self.profile(), self.threshold())
    }
}
