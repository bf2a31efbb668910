//! One frame through a detector of the core: scaled to the profile, searched or followed,
//! with results in the pixels of the input.
//!
//! In: a picture, a model, and a tracker when the picture is the next frame of a sequence.
//! Out: [`Found`]. Memory: a detector for each thread and profile, in statics. Cost: that
//! of the detector, and one pass over the picture to scale it.

use std::borrow::Cow;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use keygraph_core::stages::digest::Digests;
use keygraph_core::stages::shrink::shrink;
use keygraph_core::{
    Buffer, Depth, Detection, Detector, Frame, FrameError, HdDetector, Homography, Model, Observer, Output,
    PixelFormat, QqvgaDetector, QvgaDetector, Room, State, Stats, Track, Tracker, VgaDetector,
};

use crate::input::{Picture, Pixels};
use crate::sensor::sense;

/// A frame size that detectors are built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// 1280 x 720 px, 12 MB of memory.
    Hd,
    /// 640 x 480 px, 4 MB of memory.
    Vga,
    /// 320 x 240 px, 480 KB of memory.
    Qvga,
    /// 160 x 120 px, 160 KB of memory.
    Qqvga,
}

impl Profile {
    /// Maximum side and maximum number of pixels of a frame.
    #[must_use]
    pub const fn limits(self) -> (usize, usize) {
        match self {
            Self::Hd => (1280, 1280 * 720),
            Self::Vga => (640, 640 * 480),
            Self::Qvga => (320, 320 * 240),
            Self::Qqvga => (160, 160 * 120),
        }
    }

    /// The bytes of the detector, and its buffers.
    #[must_use]
    pub const fn memory(self) -> (usize, [Room; Buffer::COUNT]) {
        match self {
            Self::Hd => (size_of::<HdDetector>(), keygraph_core::Hd::ROOMS),
            Self::Vga => (size_of::<VgaDetector>(), keygraph_core::Vga::ROOMS),
            Self::Qvga => (size_of::<QvgaDetector>(), keygraph_core::Qvga::ROOMS),
            Self::Qqvga => (size_of::<QqvgaDetector>(), keygraph_core::Qqvga::ROOMS),
        }
    }
}

/// A picture in a format that the core takes, scaled down when it was too large.
#[derive(Debug)]
pub struct Scaled<'a> {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// The pixels.
    pub data: Cow<'a, [u8]>,
    /// Scaled px per original px, across and down.
    pub scale: [f32; 2],
}

/// Scales `picture` down until its longer side is at most `side` px and it has at most
/// `pixels` px. A picture that fits is borrowed as it is.
#[must_use]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "sizes of pictures")]
pub fn fit(picture: &Picture, side: usize, pixels: usize) -> Scaled<'_> {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let (format, bytes) = match &picture.pixels {
        Pixels::Rgb8(b) => (PixelFormat::Rgb8, b),
        Pixels::Gray8(b) => (PixelFormat::Gray8, b),
        Pixels::I420(b) => (PixelFormat::I420, b),
    };
    let f = (side as f64 / w.max(h) as f64).min((pixels as f64 / (w * h) as f64).sqrt()).min(1.0);
    if f >= 1.0 {
        return Scaled { format, width: w, height: h, data: Cow::Borrowed(bytes), scale: [1.0; 2] };
    }
    let even = if format == PixelFormat::I420 { !1 } else { !0 };
    let size = |v: usize| ((v as f64 * f + 1e-6) as usize & even).max(2);
    let (dw, dh) = (size(w), size(h));
    let mut data = vec![0; format.bytes(dw, dh)];
    match format {
        PixelFormat::I420 => {
            let (y, uv) = data.split_at_mut(dw * dh);
            let (u, v) = uv.split_at_mut(dw * dh / 4);
            shrink::<1>(bytes, (w, h), y, (dw, dh));
            shrink::<1>(&bytes[w * h..], (w / 2, h / 2), u, (dw / 2, dh / 2));
            shrink::<1>(&bytes[w * h * 5 / 4..], (w / 2, h / 2), v, (dw / 2, dh / 2));
        }
        PixelFormat::Rgb8 => shrink::<3>(bytes, (w, h), &mut data, (dw, dh)),
        _ => shrink::<1>(bytes, (w, h), &mut data, (dw, dh)),
    }
    let scale = [dw as f32 / w as f32, dh as f32 / h as f32];
    Scaled { format, width: dw, height: dh, data: Cow::Owned(data), scale }
}

/// Prepares `picture` for a detector of `profile`: scales it down, and converts it to the
/// format of a sensor when one is given.
#[must_use]
pub fn prepare(picture: &Picture, profile: Profile, format: Option<PixelFormat>) -> Scaled<'_> {
    let (side, pixels) = profile.limits();
    let scaled = fit(picture, side, pixels);
    let Some(format) = format else { return scaled };
    let (width, height, data) = sense(scaled.format, (scaled.width, scaled.height), &scaled.data, format);
    Scaled { format, width, height, data: Cow::Owned(data), scale: scaled.scale }
}

/// Results of one frame, in px of the input.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Detections, best score first.
    pub detections: Vec<Detection>,
    /// For each detection: the other objects that could be at its place, and their scores, best
    /// first. It is empty for a frame of a sequence that was not searched.
    pub rivals: Vec<Vec<(u16, f32)>>,
    /// Counts and times of the stages; ticks are nanoseconds.
    pub stats: Stats,
    /// Time from the decoded pixels to the detections, ns.
    pub total_ns: u64,
    /// Corners of the frame; empty without [`Request::details`].
    pub corners: Vec<[f32; 2]>,
    /// Triangles of the frame that were classified; empty without [`Request::details`].
    pub keygraphs: Vec<[[f32; 2]; 3]>,
    /// Triangles that agree with each detection; empty without [`Request::details`].
    pub supporters: Vec<Vec<[[f32; 2]; 3]>>,
    /// Maximum number of elements that each buffer of the detector held.
    pub high_water: [u32; Buffer::COUNT],
    /// A digest of each stage's output; `None` without [`Request::digests`].
    pub digests: Option<Digests>,
    /// The state of the tracker; `None` for a frame outside of a sequence.
    pub tracking: Option<Tracking>,
}

/// Results of a tracker beside the detections.
#[derive(Clone, Debug)]
pub struct Tracking {
    /// The id and the state of each detection.
    pub seen: Vec<(u32, State)>,
    /// Instances that were lost less than a second ago, at the place where they were seen
    /// last.
    pub lost: Vec<Track>,
    /// Whether this frame was searched; false when instances were only followed.
    pub searched: bool,
}

impl Found {
    /// Results with detections and counts; everything else is empty.
    #[must_use]
    pub const fn new(detections: Vec<Detection>, stats: Stats) -> Self {
        Self {
            detections,
            rivals: Vec::new(),
            stats,
            total_ns: 0,
            corners: Vec::new(),
            keygraphs: Vec::new(),
            supporters: Vec::new(),
            high_water: [0; Buffer::COUNT],
            digests: None,
            tracking: None,
        }
    }

    /// Adds corners, keygraphs and supporters of the last frame.
    fn add_details(&mut self, detector: &AnyDetector, model: &Model<'_>) {
        self.corners = detector.corners().collect();
        self.keygraphs = detector.keygraphs().collect();
        self.supporters = self.detections.iter().map(|d| detector.supporters(model, d).collect()).collect();
    }

    /// All detections, with those of lost instances.
    fn all_detections(&mut self) -> impl Iterator<Item = &mut Detection> {
        let lost = self.tracking.iter_mut().flat_map(|t| &mut t.lost);
        self.detections.iter_mut().chain(lost.map(|t| &mut t.detection))
    }

    /// Maps all coordinates from a scaled frame to the input. `[sx, sy]` is the number of
    /// px of the frame per px of the input, across and down.
    pub fn map_back(&mut self, [sx, sy]: [f32; 2]) {
        let back = Homography::scaling([1.0 / sx, 1.0 / sy]);
        for d in self.all_detections() {
            d.homography = back.after(&d.homography).normalised();
            d.corners = d.corners.map(|p| back.apply(p));
        }
        let triangles = self.keygraphs.iter_mut().chain(self.supporters.iter_mut().flatten());
        for p in self.corners.iter_mut().chain(triangles.flatten()) {
            *p = back.apply(*p);
        }
    }
}

/// How a frame is searched, and which results are reported.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Size of the detector.
    pub profile: Profile,
    /// Minimum score of a detection, 0 to 1.
    pub threshold: f32,
    /// Time after which a search is stopped: it then reports what it has found.
    pub budget: Option<Duration>,
    /// Minimum share of an object that must be seen, 0 to 1.
    pub min_visible: f32,
    /// Whether to report all names at a place, and not the best alone.
    pub all_names: bool,
    /// Whether to report corners, keygraphs and supporters.
    pub details: bool,
    /// The format of a sensor to which pixels are converted; `None` takes them as they were
    /// decoded.
    pub format: Option<PixelFormat>,
    /// How much of each frame is searched, and for how much of the model.
    pub depth: Depth,
    /// Whether to report digests. Frames of a sequence have none.
    pub digests: bool,
}

/// Parses the minimum share of an object that must be seen, 0 to 1.
///
/// # Errors
/// When `text` is no number from 0 to 1.
pub fn parse_share(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a share lies between 0 and 1".into())
}

/// Parses the minimum score of a detection, 0 to 1.
///
/// # Errors
/// When `text` is no number from 0 to 1.
pub fn parse_threshold(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a score lies between 0 and 1".into())
}

/// Parses the time of a search, ms.
///
/// # Errors
/// When `text` is no number above 0.
pub fn parse_budget(text: &str) -> Result<Duration, String> {
    let ms = text.parse().ok().filter(|ms: &f64| *ms > 0.0 && *ms <= 1e6);
    ms.map(|ms| Duration::from_secs_f64(ms / 1e3)).ok_or_else(|| "a budget is a number of ms above 0".into())
}

impl Request {
    /// A request for detections alone, on pixels as they were decoded.
    #[must_use]
    pub const fn new(profile: Profile, threshold: f32) -> Self {
        Self {
            profile,
            threshold,
            budget: None,
            min_visible: 0.0,
            all_names: false,
            details: false,
            format: None,
            depth: Depth::Usual,
            digests: false,
        }
    }
}

/// The observer of a detector: times the stages, makes digests on request, and keeps a budget.
struct Watch {
    start: Instant,
    budget: Option<Duration>,
    digests: Option<Digests>,
}

impl Watch {
    /// An observer that starts now, without digests.
    fn new(request: &Request) -> Self {
        Self { start: Instant::now(), budget: request.budget, digests: None }
    }
}

impl Observer for Watch {
    fn now(&mut self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn goes_on(&mut self) -> bool {
        self.budget.is_none_or(|most| self.start.elapsed() < most)
    }

    fn saw(&mut self, output: Output<'_>) {
        if let Some(digests) = &mut self.digests {
            digests.add(output);
        }
    }
}

/// A detector of any profile.
type AnyDetector = Detector<dyn keygraph_core::Profile>;

/// Maximum number of frames that are searched at once. Detectors live in statics, which
/// cost no memory until they are used.
pub const MAX_THREADS: usize = 8;

static HD: [Mutex<HdDetector>; MAX_THREADS] = [const { Mutex::new(HdDetector::new()) }; MAX_THREADS];
static VGA: [Mutex<VgaDetector>; MAX_THREADS] = [const { Mutex::new(VgaDetector::new()) }; MAX_THREADS];
static QVGA: [Mutex<QvgaDetector>; MAX_THREADS] = [const { Mutex::new(QvgaDetector::new()) }; MAX_THREADS];
static QQVGA: [Mutex<QqvgaDetector>; MAX_THREADS] = [const { Mutex::new(QqvgaDetector::new()) }; MAX_THREADS];

/// Searches a frame, and gathers what there is to report.
fn search_frame(
    detector: &mut AnyDetector,
    frame: &Frame<'_>,
    model: &Model<'_>,
    request: &Request,
) -> Result<Found, FrameError> {
    let mut watch = Watch { digests: request.digests.then(Digests::new), ..Watch::new(request) };
    detector.set_depth(request.depth);
    detector.set_min_visible(request.min_visible);
    let mut detections = detector.detect(frame, model, request.threshold, &mut watch)?.to_vec();
    if request.all_names {
        detections.extend(detector.beaten());
        detections.sort_by(|a, b| b.score.total_cmp(&a.score));
    }
    let found = Found { rivals: rivals_of(detector, &detections), ..Found::new(detections, *detector.stats()) };
    let mut found = Found { digests: watch.digests, high_water: *detector.high_water(), ..found };
    if request.details {
        show_all_of(detector, frame, model, request)?;
        found.add_details(detector, model);
    }
    Ok(found)
}

/// After a search in tiles, searches the frame once more as a whole: the corners and triangles of the
/// detector are then those of the whole frame.
fn show_all_of(
    detector: &mut AnyDetector,
    frame: &Frame<'_>,
    model: &Model<'_>,
    request: &Request,
) -> Result<(), FrameError> {
    if detector.stats().tiles > 0 {
        detector.set_depth(Depth::Once);
        detector.detect(frame, model, request.threshold, &mut Watch::new(request))?;
    }
    Ok(())
}

/// The objects that lost the place of each detection, and their scores.
fn rivals_of(detector: &AnyDetector, detections: &[Detection]) -> Vec<Vec<(u16, f32)>> {
    detections.iter().map(|d| detector.rivals(d).map(|r| (r.object, r.score)).collect()).collect()
}

/// Follows objects into the next frame of a sequence, and gathers what there is to report.
fn follow_frame(
    detector: &mut AnyDetector,
    tracker: &mut Tracker,
    frame: &Frame<'_>,
    model: &Model<'_>,
    request: &Request,
) -> Result<Found, FrameError> {
    let mut watch = Watch::new(request);
    detector.set_depth(request.depth);
    detector.set_min_visible(request.min_visible);
    let tracks = tracker.track(detector, frame, model, request.threshold, &mut watch)?;
    let (lost, seen): (Vec<Track>, Vec<Track>) = tracks.iter().partition(|t| t.state == State::Lost);
    let mut found = Found::new(seen.iter().map(|t| t.detection).collect(), *tracker.stats());
    if tracker.searched() {
        found.rivals = rivals_of(detector, &found.detections);
    }
    if request.details {
        show_all_of(detector, frame, model, request)?;
        found.add_details(detector, model);
    }
    let seen = seen.iter().map(|t| (t.id, t.state)).collect();
    found.tracking = Some(Tracking { seen, lost, searched: tracker.searched() });
    Ok(found)
}

/// Searches `picture` for the model's objects with the detector of thread `slot`. `details`
/// reports corners, keygraphs and supporters too.
///
/// # Errors
/// When the picture is too small.
pub fn search(
    picture: &Picture,
    model: &Model<'_>,
    profile: Profile,
    threshold: f32,
    details: bool,
    slot: usize,
) -> Result<Found> {
    search_for(picture, model, &Request { details, ..Request::new(profile, threshold) }, slot)
}

/// Searches `picture` as `request` says, with the detector of thread `slot`.
///
/// # Errors
/// When the picture is too small.
pub fn search_for(picture: &Picture, model: &Model<'_>, request: &Request, slot: usize) -> Result<Found> {
    in_profile(picture, request, slot, |detector, frame| search_frame(detector, frame, model, request))
}

/// Follows the model's objects into `picture`, the next of a sequence; `tracker` has seen
/// the pictures before it. Uses the detector of thread `slot`.
///
/// # Errors
/// When the picture is too small.
pub fn follow(
    picture: &Picture,
    model: &Model<'_>,
    request: &Request,
    slot: usize,
    tracker: &mut Tracker,
) -> Result<Found> {
    in_profile(picture, request, slot, |detector, frame| follow_frame(detector, tracker, frame, model, request))
}

/// Prepares `picture`, calls `work` with it and with the detector of thread `slot`, and
/// maps the results to px of the picture.
fn in_profile(
    picture: &Picture,
    request: &Request,
    slot: usize,
    work: impl FnOnce(&mut AnyDetector, &Frame<'_>) -> Result<Found, FrameError>,
) -> Result<Found> {
    let start = Instant::now();
    let scaled = prepare(picture, request.profile, request.format);
    let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).with_context(|| {
        format!("{}x{} px, {}x{} at this profile", picture.width, picture.height, scaled.width, scaled.height)
    })?;
    let slot = slot % MAX_THREADS;
    let mut found = match request.profile {
        Profile::Hd => work(&mut *lock(&HD[slot]), &frame),
        Profile::Vga => work(&mut *lock(&VGA[slot]), &frame),
        Profile::Qvga => work(&mut *lock(&QVGA[slot]), &frame),
        Profile::Qqvga => work(&mut *lock(&QQVGA[slot]), &frame),
    }?;
    found.map_back(scaled.scale);
    found.total_ns = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
    Ok(found)
}

fn lock<T>(m: &Mutex<T>) -> MutexGuard<'_, T> {
    // A detector keeps nothing from frame to frame that a panic could damage.
    m.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
