//! Frames into the core's detectors: scaling to the profile, one detector a
//! thread, results in the pixels of the input.
//!
//! In: a picture, a model, and a tracker where the picture is the next frame of a
//! sequence. Out: what was found.

use std::borrow::Cow;
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

use anyhow::{Context, Result};
use keygraph_core::capacity::{Buffer, Room};
use keygraph_core::detect::{Detection, HdDetector, Observer, Output, QqvgaDetector, QvgaDetector, Stats, VgaDetector};
use keygraph_core::digest::Digests;
use keygraph_core::frame::{Frame, FrameError, PixelFormat};
use keygraph_core::model::Model;
use keygraph_core::shrink::shrink;
use keygraph_core::track::{State, Track, Tracker};

use crate::input::{Picture, Pixels};
use crate::scaling::scaling;
use crate::sensor::sense;

/// A frame size that detectors are built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// 1280 x 720, 12 MB.
    Hd,
    /// 640 x 480, 4 MB.
    Vga,
    /// 320 x 240, 480 KB.
    Qvga,
    /// 160 x 120, 160 KB.
    Qqvga,
}

impl Profile {
    /// Longest side and most pixels of a frame.
    #[must_use]
    pub const fn limits(self) -> (usize, usize) {
        match self {
            Self::Hd => (1280, 1280 * 720),
            Self::Vga => (640, 640 * 480),
            Self::Qvga => (320, 320 * 240),
            Self::Qqvga => (160, 160 * 120),
        }
    }

    /// Bytes of the detector, and its buffers.
    #[must_use]
    pub const fn memory(self) -> (usize, [Room; Buffer::COUNT]) {
        match self {
            Self::Hd => (size_of::<HdDetector>(), HdDetector::BUFFERS),
            Self::Vga => (size_of::<VgaDetector>(), VgaDetector::BUFFERS),
            Self::Qvga => (size_of::<QvgaDetector>(), QvgaDetector::BUFFERS),
            Self::Qqvga => (size_of::<QqvgaDetector>(), QqvgaDetector::BUFFERS),
        }
    }
}

/// A picture as the core takes it, scaled down where it had to be.
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
    /// Scaled px per original px, both ways.
    pub scale: [f32; 2],
}

/// Scales `picture` down until its longer side is at most `side` px and it has at
/// most `pixels` px.
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

/// `picture` as a detector of this profile takes it: scaled down, and in the format of
/// a sensor where one is wanted.
#[must_use]
pub fn prepare(picture: &Picture, profile: Profile, format: Option<PixelFormat>) -> Scaled<'_> {
    let (side, pixels) = profile.limits();
    let scaled = fit(picture, side, pixels);
    let Some(format) = format else { return scaled };
    let (width, height, data) = sense(scaled.format, (scaled.width, scaled.height), &scaled.data, format);
    Scaled { format, width, height, data: Cow::Owned(data), scale: scaled.scale }
}

/// What was found in one frame, in px of the input.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Detections, best score first.
    pub detections: Vec<Detection>,
    /// What the stages did; ticks are nanoseconds.
    pub stats: Stats,
    /// Everything from the decoded pixels to the detections, ns.
    pub total_ns: u64,
    /// Corners of the frame, if asked for.
    pub corners: Vec<[f32; 2]>,
    /// Triangles of the frame that were classified, if asked for.
    pub keygraphs: Vec<[[f32; 2]; 3]>,
    /// Triangles that agree with each detection, if asked for.
    pub supporters: Vec<Vec<[[f32; 2]; 3]>>,
    /// Most elements that each of the detector's buffers held.
    pub high_water: [u32; Buffer::COUNT],
    /// A digest of each stage's output, if asked for.
    pub digests: Option<Digests>,
    /// Which instances these are, if they were followed.
    pub tracking: Option<Tracking>,
}

/// What a tracker says besides detections.
#[derive(Clone, Debug)]
pub struct Tracking {
    /// Id and state of each detection.
    pub seen: Vec<(u32, State)>,
    /// Instances that were lost less than a second ago, where they were last seen.
    pub lost: Vec<Track>,
    /// Whether this frame was searched, and not only followed.
    pub searched: bool,
}

impl Found {
    /// What a detector has told so far; nothing else yet.
    #[must_use]
    pub const fn new(detections: Vec<Detection>, stats: Stats) -> Self {
        Self {
            detections,
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

    /// All detections, those of lost instances too.
    fn all_detections(&mut self) -> impl Iterator<Item = &mut Detection> {
        let lost = self.tracking.iter_mut().flat_map(|t| &mut t.lost);
        self.detections.iter_mut().chain(lost.map(|t| &mut t.detection))
    }

    /// Carries everything from a frame with so many px per px of the input to the px
    /// of the input.
    pub fn map_back(&mut self, [sx, sy]: [f32; 2]) {
        let back = scaling([1.0 / sx, 1.0 / sy]);
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

/// What is wanted of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Size of the detector.
    pub profile: Profile,
    /// Least score of a detection.
    pub threshold: f32,
    /// Whether to tell corners, keygraphs and supporters.
    pub details: bool,
    /// The format of the sensor that is to be stood in for; else the pixels are taken
    /// as they were decoded.
    pub format: Option<PixelFormat>,
    /// Whether to search all of each frame for all of the model:
    /// [`keygraph_core::detect::Detector::set_thorough`].
    pub thorough: bool,
    /// Whether to tell digests; of what is searched alone, not of what is followed.
    pub digests: bool,
}

/// Parses the minimum score of a detection, 0 to 1.
///
/// # Errors
/// When `text` is no number from 0 to 1.
pub fn parse_threshold(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v| (0.0..=1.0).contains(v)).ok_or_else(|| "a score lies between 0 and 1".into())
}

impl Request {
    /// Detections alone, of pixels as they were decoded.
    #[must_use]
    pub const fn new(profile: Profile, threshold: f32) -> Self {
        Self { profile, threshold, details: false, format: None, thorough: false, digests: false }
    }
}

/// Times the stages, and makes digests if asked for.
struct Watch {
    start: Instant,
    digests: Option<Digests>,
}

impl Observer for Watch {
    fn now(&mut self) -> u64 {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn saw(&mut self, output: Output<'_>) {
        if let Some(digests) = &mut self.digests {
            digests.add(output);
        }
    }
}

/// A detector of any profile.
pub trait Engine {
    /// [`keygraph_core::detect::Detector::detect`] and what there is to tell.
    ///
    /// # Errors
    /// As the core.
    fn run(&mut self, frame: &Frame<'_>, model: &Model<'_>, request: &Request) -> Result<Found, FrameError>;

    /// The same for the next frame of a sequence, by [`Tracker::track`].
    ///
    /// # Errors
    /// As the core.
    fn follow(
        &mut self,
        tracker: &mut Tracker,
        frame: &Frame<'_>,
        model: &Model<'_>,
        request: &Request,
    ) -> Result<Found, FrameError>;
}

macro_rules! engine {
    ($($detector:ty, $pool:ident;)*) => {$(
        static $pool: [Mutex<$detector>; MAX_THREADS] = [const { Mutex::new(<$detector>::new()) }; MAX_THREADS];

        impl Engine for $detector {
            fn run(&mut self, frame: &Frame<'_>, model: &Model<'_>, request: &Request) -> Result<Found, FrameError> {
                let mut watch = Watch { start: Instant::now(), digests: request.digests.then(Digests::new) };
                self.set_thorough(request.thorough);
                let detections = self.detect(frame, model, request.threshold, &mut watch)?.to_vec();
                let mut found = Found { digests: watch.digests, high_water: *self.high_water(), ..Found::new(detections, *self.stats()) };
                if request.details {
                    found.corners = self.corners().collect();
                    found.keygraphs = self.keygraphs().collect();
                    found.supporters = found.detections.iter().map(|d| self.supporters(model, d).collect()).collect();
                }
                Ok(found)
            }

            fn follow(&mut self, tracker: &mut Tracker, frame: &Frame<'_>, model: &Model<'_>, request: &Request) -> Result<Found, FrameError> {
                let mut watch = Watch { start: Instant::now(), digests: None };
                self.set_thorough(request.thorough);
                let tracks = tracker.track(self, frame, model, request.threshold, &mut watch)?;
                let (lost, seen): (Vec<Track>, Vec<Track>) = tracks.iter().partition(|t| t.state == State::Lost);
                let mut found = Found::new(seen.iter().map(|t| t.detection).collect(), *tracker.stats());
                if request.details {
                    found.corners = self.corners().collect();
                    found.keygraphs = self.keygraphs().collect();
                    found.supporters = found.detections.iter().map(|d| self.supporters(model, d).collect()).collect();
                }
                let seen = seen.iter().map(|t| (t.id, t.state)).collect();
                found.tracking = Some(Tracking { seen, lost, searched: tracker.searched() });
                Ok(found)
            }
        }
    )*};
}

/// Most frames that are searched at once: detectors live in statics, which cost
/// nothing until they are used.
pub const MAX_THREADS: usize = 8;

engine! {
    HdDetector, HD;
    VgaDetector, VGA;
    QvgaDetector, QVGA;
    QqvgaDetector, QQVGA;
}

/// Looks for the model's objects in `picture` with the detector of thread `slot`.
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

/// The same, with everything that can be asked for.
///
/// # Errors
/// When the picture is too small.
pub fn search_for(picture: &Picture, model: &Model<'_>, request: &Request, slot: usize) -> Result<Found> {
    in_profile(picture, request, slot, |engine, frame| engine.run(frame, model, request))
}

/// The same for the next picture of a sequence, of which `tracker` has seen the ones
/// before.
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
    in_profile(picture, request, slot, |engine, frame| engine.follow(tracker, frame, model, request))
}

/// Prepares `picture`, lets `work` have it and the detector of thread `slot`, and takes
/// what was found back to px of the picture.
fn in_profile(
    picture: &Picture,
    request: &Request,
    slot: usize,
    work: impl FnOnce(&mut dyn Engine, &Frame<'_>) -> Result<Found, FrameError>,
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
    // A detector carries nothing from frame to frame that a panic could harm.
    m.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}
