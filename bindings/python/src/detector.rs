//! Detectors and trackers.
//!
//! In: models, options, frames. Out: [`Answer`]s. Memory: a detector of the core for each object, on the
//! heap (1.2 MB for the profile vga). Cost: that of the core, and some microseconds. The interpreter is
//! released from the pixels to the results; a second thread that uses the same detector waits.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use keygraph::picture::{Picture, Pixels};
use keygraph::region::Region;
use keygraph::search::{AnyDetector, Found, Profile, Request, depth_of, follow_frame, prepare, search_frame};
use keygraph_core::{
    Frame, FrameError, HdDetector, Homography, PixelFormat, QqvgaDetector, QvgaDetector, VgaDetector, Window,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::errors::{defect, exception, frame_error, value_error};
use crate::frame::{Reading, View, frame, path_of};
use crate::model::{Model, joined, listed};
use crate::result::{Answer, detections};
use crate::sensor::{checked, picture};

/// A detector of the core in memory of its own.
#[derive(Debug)]
enum Room {
    Hd(Box<HdDetector>),
    Vga(Box<VgaDetector>),
    Qvga(Box<QvgaDetector>),
    Qqvga(Box<QqvgaDetector>),
}

/// A stack on which the largest detector can be made before it moves to the heap.
const STACK: usize = 32 << 20;

impl Room {
    /// A new detector. A thread with a large stack makes it: that of the caller may be small.
    fn new(profile: Profile) -> PyResult<Self> {
        let make = move || match profile {
            Profile::Hd => Self::Hd(Box::default()),
            Profile::Vga => Self::Vga(Box::default()),
            Profile::Qvga => Self::Qvga(Box::default()),
            Profile::Qqvga => Self::Qqvga(Box::default()),
        };
        let maker = thread::Builder::new().stack_size(STACK).spawn(make)?;
        maker.join().map_err(|_| defect("the detector cannot be made"))
    }

    fn any(&mut self) -> &mut AnyDetector {
        match self {
            Self::Hd(d) => &mut **d,
            Self::Vga(d) => &mut **d,
            Self::Qvga(d) => &mut **d,
            Self::Qqvga(d) => &mut **d,
        }
    }
}

/// The profiles, by name.
const PROFILES: [(&str, Profile); 4] =
    [("hd", Profile::Hd), ("vga", Profile::Vga), ("qvga", Profile::Qvga), ("qqvga", Profile::Qqvga)];

/// The profile with a name.
pub fn profile(name: &str) -> PyResult<Profile> {
    let found = PROFILES.iter().find(|(known, _)| *known == name).map(|(_, profile)| *profile);
    found.ok_or_else(|| {
        PyValueError::new_err(format!("profile: expected \"hd\", \"vga\", \"qvga\" or \"qqvga\", got \"{name}\""))
    })
}

fn profile_name(profile: Profile) -> &'static str {
    PROFILES.iter().find(|(_, p)| *p == profile).map_or("", |(name, _)| *name)
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

/// Searches a frame in the memory of a detector.
struct Search<'a> {
    model: &'a Model,
    request: &'a Request,
    start: Instant,
}

/// Why a frame was not searched.
enum Refused {
    Frame(FrameError),
    Other(anyhow::Error),
}

impl From<FrameError> for Refused {
    fn from(e: FrameError) -> Self {
        Self::Frame(e)
    }
}

impl From<Refused> for PyErr {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Frame(e) => frame_error(e),
            Refused::Other(e) => exception(&e),
        }
    }
}

impl Search<'_> {
    /// Prepares the pixels, calls `work` with them, and maps the results to px of the whole frame.
    fn run(
        &self,
        view: &View<'_>,
        work: impl FnOnce(&Frame<'_>) -> Result<Found, FrameError>,
    ) -> Result<Found, Refused> {
        let found = match self.directly(view)? {
            Ok((frame, to_picture, part)) => {
                let mut found = work(&frame)?;
                if part.is_some() {
                    found.map_back(&to_picture);
                }
                Found { part, ..found }
            }
            Err(()) => self.prepared(view, work)?,
        };
        let total_ns = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Ok(Found { mirrored: self.request.mirror, total_ns, ..found })
    }

    /// The frame as it is in memory, or a part of it, when it fits the detector so.
    #[allow(clippy::type_complexity, reason = "what is searched, and where it lies")]
    fn directly<'v>(
        &self,
        view: &View<'v>,
    ) -> Result<Result<(Frame<'v>, Homography, Option<keygraph::picture::Part>), ()>, Refused> {
        let View::Raw(layout, data) = view else { return self.borrowed(view) };
        let frame = checked(layout, data)?;
        let Some(region) = self.request.region else {
            let fits = self.fits(layout.width, layout.height);
            return Ok(if fits { Ok((frame, Homography::IDENTITY, None)) } else { Err(()) });
        };
        let shares = !matches!(
            layout.format,
            PixelFormat::Rgb8 | PixelFormat::Gray8 | PixelFormat::Rgb565 | PixelFormat::Rgb565Be
        );
        let pixels = if shares { Pixels::I420(Vec::new()) } else { Pixels::Gray8(Vec::new()) };
        let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let outline = Picture { width: side(layout.width), height: side(layout.height), pixels };
        let part = region.part(&outline).map_err(|e| Refused::Other(e.into()))?;
        let [x, y, width, height] = [part.x, part.y, part.width, part.height].map(|v| v as usize);
        if !self.fits(width, height) {
            return Ok(Err(()));
        }
        let window = Window { x, y, width, height };
        Ok(Ok((frame.window(window)?, window.to_frame(), Some(part))))
    }

    /// A picture of the host as a frame, when all of it is searched as it is.
    #[allow(clippy::type_complexity, reason = "as above")]
    fn borrowed<'v>(
        &self,
        view: &View<'v>,
    ) -> Result<Result<(Frame<'v>, Homography, Option<keygraph::picture::Part>), ()>, Refused> {
        let View::Picture(picture) = view else { return Ok(Err(())) };
        let (width, height) = view.size();
        if self.request.region.is_some() || !self.fits(width, height) {
            return Ok(Err(()));
        }
        let (format, bytes) = match &picture.pixels {
            Pixels::Rgb8(b) => (PixelFormat::Rgb8, b),
            Pixels::Gray8(b) => (PixelFormat::Gray8, b),
            Pixels::I420(b) => (PixelFormat::I420, b),
        };
        Ok(Ok((Frame::new(format, width, height, bytes)?, Homography::IDENTITY, None)))
    }

    /// Whether pixels of this size are searched without being scaled down or mirrored.
    fn fits(&self, width: usize, height: usize) -> bool {
        let (side, pixels) = self.request.profile.limits();
        !self.request.mirror && width.max(height) <= side && width * height <= pixels
    }

    /// Copies the pixels as far as needed: gathered, cut, scaled down, mirrored.
    fn prepared(
        &self,
        view: &View<'_>,
        work: impl FnOnce(&Frame<'_>) -> Result<Found, FrameError>,
    ) -> Result<Found, Refused> {
        let (width, height) = view.size();
        if self.request.region.is_none()
            && self.fits(width, height)
            && let Some((format, bytes)) = view.gathered()
        {
            return Ok(work(&Frame::new(format, width, height, &bytes)?)?);
        }
        let owned;
        let picture = match view {
            View::Picture(picture) => picture,
            _ => {
                owned = picture(view)?;
                &owned
            }
        };
        let scaled = prepare(picture, self.request).map_err(|e| Refused::Other(e.into()))?;
        let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).map_err(|e| {
            let (width, height) = (scaled.width, scaled.height);
            let said =
                format!("the frame has {}x{} px, {width}x{height} at this profile", picture.width, picture.height);
            Refused::Other(anyhow::Error::from(e).context(said))
        })?;
        let mut found = work(&frame)?;
        found.map_back(&scaled.to_picture);
        Ok(Found { part: scaled.part, ..found })
    }
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
    let answer = Answer::new(model.clone_ref(py), found, view.size(), source);
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
///     all_names: Report all objects that could be at a place, and not the best alone.
///     budget_ms: Stop the search of a frame after this time, ms, and report what was found.
///     roi: Search this part of each frame alone, at its own resolution: (x, y, width, height), each px or
///         a string such as `"25%"`. Results stay in px of the whole frame.
///     mirror: Search frames mirrored left to right, as those of selfie cameras are.
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
    #[pyo3(signature = (models, profile="vga", threshold=0.8, *, min_visible=0.0, thorough=false, all_names=false, budget_ms=None, roi=None, mirror=false, digests=false))]
    #[allow(clippy::too_many_arguments, reason = "the arguments of Python, which have names")]
    fn new(
        py: Python<'_>,
        models: &Bound<'_, PyAny>,
        profile: &str,
        threshold: f32,
        min_visible: f32,
        thorough: bool,
        all_names: bool,
        budget_ms: Option<f64>,
        roi: Option<&Bound<'_, PyAny>>,
        mirror: bool,
        digests: bool,
    ) -> PyResult<Self> {
        let request = Request {
            min_visible: share("min_visible", min_visible)?,
            depth: depth_of(thorough),
            all_names,
            budget: budget_ms.map(budget).transpose()?,
            region: roi.map(region).transpose()?,
            mirror,
            digests,
            ..Request::new(self::profile(profile)?, share("threshold", threshold)?)
        };
        let room = Mutex::new(py.detach(|| Room::new(request.profile))?);
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
            let mut room = lock(&self.room);
            search.run(view, |frame| search_frame(room.any(), frame, search.model.view(), search.request))
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
    tracker: keygraph_core::Tracker,
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
    #[pyo3(signature = (models, profile="vga", threshold=0.8, *, min_visible=0.0, thorough=false, budget_ms=None, roi=None, mirror=false))]
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
    ) -> PyResult<Self> {
        let Detector { model, request, room } =
            Detector::new(py, models, profile, threshold, min_visible, thorough, false, budget_ms, roi, mirror, false)?;
        let room = room.into_inner().unwrap_or_else(PoisonError::into_inner);
        let trail = Mutex::new(Trail { room, tracker: keygraph_core::Tracker::new(), size: None });
        Ok(Self { model, request, trail })
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
            let Trail { room, tracker, size } = &mut *trail;
            // The size is put back below, when the frame was tracked.
            if size.take().is_none_or(|before| before != view.size()) {
                tracker.reset();
            }
            let found = search
                .run(view, |frame| follow_frame(room.any(), tracker, frame, search.model.view(), search.request))?;
            *size = Some(view.size());
            Ok(found)
        })
    }

    /// Forgets all objects: the next frame is the first of another video. Ids are not used again.
    fn reset(&self, py: Python<'_>) {
        py.detach(|| lock(&self.trail).tracker.reset());
    }

    /// Makes the next frame be searched, even when all objects are in view.
    fn search_next(&self, py: Python<'_>) {
        py.detach(|| lock(&self.trail).tracker.search_next());
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
