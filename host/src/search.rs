//! One frame through a detector of the core: scaled to the profile, searched or followed,
//! with results in the pixels of the input.
//!
//! In: a picture, a model, and a tracker when the picture is the next frame of a sequence.
//! Out: [`Found`]. Memory: a detector for each thread and profile, in statics. Cost: that
//! of the detector, and one pass over the picture to scale it.

use std::borrow::Cow;
use std::iter::repeat_with;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use keygraph_core::stages::digest::Digests;
use keygraph_core::stages::shrink::shrink;
use keygraph_core::{
    Buffer, CellMatch, Depth, Detection, Detector, Frame, FrameError, HdDetector, Homography, Model, Observer, Output,
    PixelFormat, QqvgaDetector, QvgaDetector, State, Stats, Surface, Surfaces, Track, Tracker, VgaDetector,
};

use crate::input::{Picture, Pixels};
use crate::picture::{Part, mirror_rows};
use crate::region::Unsuitable;
pub use crate::request::{Profile, Request, Shape, depth_of, parse_budget, parse_share, parse_threshold};
use crate::sensor::sense;
use crate::smooth::Smoother;

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
    /// The map from px of these pixels to px of the picture.
    pub to_picture: Homography,
    /// The part of the picture that these pixels show; `None` when they show all of it.
    pub part: Option<Part>,
}

impl Scaled<'_> {
    /// The pixels as a picture of their own; they must have a format that pictures have.
    #[must_use]
    pub fn picture(&self) -> Picture {
        let (width, height) = (u32::try_from(self.width).unwrap_or(0), u32::try_from(self.height).unwrap_or(0));
        let bytes = || self.data.to_vec();
        let pixels = match self.format {
            PixelFormat::Rgb8 => Pixels::Rgb8(bytes()),
            PixelFormat::I420 => Pixels::I420(bytes()),
            _ => Pixels::Gray8(bytes()),
        };
        Picture { width, height, pixels }
    }

    /// Mirrors the pixels left to right, of one of the formats that pictures have.
    fn mirror(&mut self) {
        let (w, n) = (self.width, self.width * self.height);
        let bytes = self.data.to_mut();
        match self.format {
            PixelFormat::Rgb8 => mirror_rows::<3>(bytes, w),
            PixelFormat::I420 => {
                let (luma, chroma) = bytes.split_at_mut(n);
                mirror_rows::<1>(luma, w);
                mirror_rows::<1>(chroma, w / 2);
            }
            _ => mirror_rows::<1>(bytes, w),
        }
        let last = w.saturating_sub(1) as f32;
        self.to_picture = self.to_picture.after(&Homography::affine([-1.0, 0.0, last, 0.0, 1.0, 0.0]));
    }
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
        let data = Cow::Borrowed(&bytes[..]);
        let to_picture = Homography::IDENTITY;
        return Scaled { format, width: w, height: h, data, scale: [1.0; 2], to_picture, part: None };
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
    let to_picture = Homography::scaling(scale.map(|s| 1.0 / s));
    Scaled { format, width: dw, height: dh, data: Cow::Owned(data), scale, to_picture, part: None }
}

/// Prepares `picture` for the detector of `request`: takes the region out, scales it down, mirrors it,
/// and converts it to the format of a sensor, as far as this is asked for.
///
/// # Errors
/// When the region does not suit the picture.
pub fn prepare<'a>(picture: &'a Picture, request: &Request) -> Result<Scaled<'a>, Unsuitable> {
    prepare_for(picture, request, |_| request.profile.limits())
}

/// Prepares `picture` as [`prepare`] does. `limits` tells how long a side may be and how many pixels there may be, when it
/// is given the size of the picture or of its part.
pub(crate) fn prepare_for<'a>(
    picture: &'a Picture,
    request: &Request,
    limits: impl Fn((usize, usize)) -> (usize, usize),
) -> Result<Scaled<'a>, Unsuitable> {
    let within = |picture: &Picture| limits((picture.width as usize, picture.height as usize));
    let mut scaled = match request.region {
        None => {
            let (side, pixels) = within(picture);
            fit(picture, side, pixels)
        }
        Some(region) => {
            let part = region.part(picture)?;
            let cut = picture.cut(part);
            let (side, pixels) = within(&cut);
            let scaled = fit(&cut, side, pixels);
            let corner = Homography::affine([1.0, 0.0, part.x as f32, 0.0, 1.0, part.y as f32]);
            let to_picture = corner.after(&scaled.to_picture);
            Scaled { data: Cow::Owned(scaled.data.into_owned()), to_picture, part: Some(part), ..scaled }
        }
    };
    if request.mirror {
        scaled.mirror();
    }
    let Some(format) = request.format else { return Ok(scaled) };
    let (width, height, data) = sense(scaled.format, (scaled.width, scaled.height), &scaled.data, format);
    Ok(Scaled { format, width, height, data: Cow::Owned(data), ..scaled })
}

/// Results of one frame, in px of the input.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Detections, best score first.
    pub detections: Vec<Detection>,
    /// For each detection: the other objects that could be at its place, and their scores, best
    /// first. It is empty for a frame of a sequence that was not searched.
    pub rivals: Vec<Vec<(u16, f32)>>,
    /// For each detection: the surface on which the object lies, [`Detector::surface`]; empty when none are looked for.
    pub surfaces: Vec<Option<Surface>>,
    /// Matched cells of each detection; empty without [`Request::matches`], and in sequences.
    pub matches: Vec<Vec<CellMatch>>,
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
    /// The part of the frame that was searched; `None` when it is all of the frame.
    pub part: Option<Part>,
    /// Whether the frame was mirrored before it was searched.
    pub mirrored: bool,
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
    /// The surface on which the object of detection `index` lies; `None` where a plane explains what is seen.
    #[must_use]
    pub fn surface(&self, index: usize) -> Option<&Surface> {
        self.surfaces.get(index).and_then(Option::as_ref)
    }

    /// Results with detections and counts; everything else is empty.
    #[must_use]
    pub const fn new(detections: Vec<Detection>, stats: Stats) -> Self {
        Self {
            detections,
            rivals: Vec::new(),
            surfaces: Vec::new(),
            matches: Vec::new(),
            stats,
            total_ns: 0,
            corners: Vec::new(),
            keygraphs: Vec::new(),
            supporters: Vec::new(),
            high_water: [0; Buffer::COUNT],
            digests: None,
            tracking: None,
            part: None,
            mirrored: false,
        }
    }

    /// What a tracker sees in a frame: number, detection, and surface where there is one.
    fn instances(&mut self) -> impl Iterator<Item = (u32, &mut Detection, Option<&mut Surface>)> {
        let surfaces = self.surfaces.iter_mut().map(Option::as_mut).chain(repeat_with(|| None));
        let seen = self.tracking.iter().flat_map(|t| &t.seen).map(|(id, _)| *id);
        seen.zip(&mut self.detections).zip(surfaces).map(|((id, d), surface)| (id, d, surface))
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

    /// Maps all coordinates from the frame that was searched to the input, as `to_picture` does
    /// ([`Scaled::to_picture`]).
    pub fn map_back(&mut self, to_picture: &Homography) {
        for d in self.all_detections() {
            *d = d.mapped(to_picture);
        }
        for m in self.matches.iter_mut().flatten() {
            m.frame = to_picture.apply(m.frame);
        }
        for s in self.surfaces.iter_mut().flatten() {
            *s = s.mapped(to_picture);
        }
        let triangles = self.keygraphs.iter_mut().chain(self.supporters.iter_mut().flatten());
        for p in self.corners.iter_mut().chain(triangles.flatten()) {
            *p = to_picture.apply(*p);
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
pub type AnyDetector = Detector<dyn keygraph_core::Profile>;

/// Maximum number of frames that are searched at once. Detectors live in statics, which
/// cost no memory until they are used. WebAssembly has no threads, and its statics cost memory.
pub const MAX_THREADS: usize = if cfg!(target_family = "wasm") { 1 } else { 8 };

static HD: [Mutex<HdDetector>; MAX_THREADS] = [const { Mutex::new(HdDetector::new()) }; MAX_THREADS];
static VGA: [Mutex<VgaDetector>; MAX_THREADS] = [const { Mutex::new(VgaDetector::new()) }; MAX_THREADS];
static QVGA: [Mutex<QvgaDetector>; MAX_THREADS] = [const { Mutex::new(QvgaDetector::new()) }; MAX_THREADS];
static QQVGA: [Mutex<QqvgaDetector>; MAX_THREADS] = [const { Mutex::new(QqvgaDetector::new()) }; MAX_THREADS];

/// Searches a frame that fits the detector, as `request` says. The results are in px of the frame;
/// profile, region, mirror, format and `wide` of the request are not used.
///
/// # Errors
/// When the frame is too large for the detector.
pub fn search_frame(
    detector: &mut AnyDetector,
    frame: &Frame<'_>,
    model: &Model<'_>,
    request: &Request,
) -> Result<Found, FrameError> {
    let mut watch = Watch { digests: request.digests.then(Digests::new), ..Watch::new(request) };
    set(detector, request);
    let mut detections = detector.detect(frame, model, request.threshold, &mut watch)?.to_vec();
    if request.all_names {
        detections.extend(detector.beaten());
        detections.sort_by(|a, b| b.score.total_cmp(&a.score));
    }
    let found = Found { rivals: rivals_of(detector, &detections), ..Found::new(detections, *detector.stats()) };
    let mut found = Found { digests: watch.digests.take(), high_water: *detector.high_water(), ..found };
    let surfaces = found.detections.iter().filter(|_| request.wants_surfaces());
    found.surfaces = surfaces.map(|d| detector.surface(model, d, request.known(), &mut watch)).collect();
    found.stats.stopped |= lacks_surfaces(&found, request, &mut watch);
    if request.matches {
        found.matches = matches_of(detector, model, &found);
    }
    if request.details {
        show_all_of(detector, frame, model, (request, &watch))?;
        found.add_details(detector, model);
    }
    Ok(found)
}

/// Sets a detector to search as `request` says.
fn set(detector: &mut AnyDetector, request: &Request) {
    detector.set_depth(request.depth);
    detector.set_min_visible(request.min_visible);
    #[cfg(feature = "crew")]
    detector.set_crew(crate::crew::crew(request.threads));
}

/// Whether the time was over before the surface of some detection was looked for.
fn lacks_surfaces(found: &Found, request: &Request, watch: &mut Watch) -> bool {
    let is_open = |(d, s): (&Detection, &Option<Surface>)| s.is_none() && request.known().wants_surface(d);
    !watch.goes_on() && found.detections.iter().zip(&found.surfaces).any(is_open)
}

/// The matched cells of each detection, near its surface or its plane.
fn matches_of(detector: &AnyDetector, model: &Model<'_>, found: &Found) -> Vec<Vec<CellMatch>> {
    let of = |(i, d): (usize, &Detection)| {
        let object = model.object(usize::from(d.object));
        let plane = || Surface::plane(&d.homography, [object.width as f32, object.height as f32]);
        detector.matches(model, d, &found.surface(i).copied().unwrap_or_else(plane)).to_vec()
    };
    found.detections.iter().enumerate().map(of).collect()
}

/// After a search in tiles, searches the frame once more as a whole, in what is left of the budget: the
/// corners and triangles of the detector are then those of the whole frame.
fn show_all_of(
    detector: &mut AnyDetector,
    frame: &Frame<'_>,
    model: &Model<'_>,
    (request, spent): (&Request, &Watch),
) -> Result<(), FrameError> {
    if detector.stats().tiles > 0 {
        detector.set_depth(Depth::Once);
        let mut watch = Watch { start: spent.start, budget: spent.budget, digests: None };
        detector.detect(frame, model, request.threshold, &mut watch)?;
    }
    Ok(())
}

/// The objects that lost the place of each detection, and their scores.
fn rivals_of(detector: &AnyDetector, detections: &[Detection]) -> Vec<Vec<(u16, f32)>> {
    detections.iter().map(|d| detector.rivals(d).map(|r| (r.object, r.score)).collect()).collect()
}

/// A tracker, and the surfaces of what it follows.
#[derive(Debug, Default)]
pub struct Follower {
    /// The tracker.
    pub tracker: Tracker,
    surfaces: Surfaces,
    smoother: Smoother,
}

/// Follows objects into the next frame of a sequence, which fits the detector. The rest is as in
/// [`search_frame`].
///
/// # Errors
/// When the frame is too large for the detector.
pub fn follow_frame(
    detector: &mut AnyDetector,
    follower: &mut Follower,
    frame: &Frame<'_>,
    model: &Model<'_>,
    request: &Request,
) -> Result<Found, FrameError> {
    let mut watch = Watch::new(request);
    set(detector, request);
    let Follower { tracker, surfaces, smoother } = follower;
    let tracks = tracker.track(detector, frame, model, request.threshold, &mut watch)?;
    let (lost, seen): (Vec<Track>, Vec<Track>) = tracks.iter().partition(|t| t.state == State::Lost);
    let mut found = Found::new(seen.iter().map(|t| t.detection).collect(), *tracker.stats());
    if tracker.searched() {
        found.rivals = rivals_of(detector, &found.detections);
    }
    if request.details {
        // A search that goes on in the next frame needs what is in the detector.
        if !found.stats.stopped {
            show_all_of(detector, frame, model, (request, &watch))?;
        }
        found.add_details(detector, model);
    }
    if request.wants_surfaces() {
        for track in &seen {
            found.surfaces.push(surfaces.surface(detector, frame, model, track, request.known(), &mut watch)?);
        }
    }
    found.stats.stopped |= lacks_surfaces(&found, request, &mut watch);
    let seen = seen.iter().map(|t| (t.id, t.state)).collect();
    found.tracking = Some(Tracking { seen, lost, searched: tracker.searched() });
    if request.smooth > 0 {
        smoother.smooth(found.instances(), model, request.smooth);
    }
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

/// Searches `picture` as `request` says, with the detector of thread `slot`. It does not search it squeezed:
/// [`search_widely`](crate::wide::search_widely) does.
///
/// # Errors
/// When the picture is too small.
pub fn search_for(picture: &Picture, model: &Model<'_>, request: &Request, slot: usize) -> Result<Found> {
    in_profile(picture, request, slot, |detector, frame, request| search_frame(detector, frame, model, request))
}

/// Follows the model's objects into `picture`, the next of a sequence; `follower` has
/// seen the pictures before it. Uses the detector of thread `slot`.
///
/// # Errors
/// When the picture is too small.
pub fn follow(
    picture: &Picture,
    model: &Model<'_>,
    request: &Request,
    slot: usize,
    follower: &mut Follower,
) -> Result<Found> {
    in_profile(picture, request, slot, |detector, frame, request| {
        follow_frame(detector, follower, frame, model, request)
    })
}

/// Prepares `picture`, calls `work` with it and with the detector of thread `slot`, and
/// maps the results to px of the picture.
fn in_profile(
    picture: &Picture,
    request: &Request,
    slot: usize,
    work: impl FnOnce(&mut AnyDetector, &Frame<'_>, &Request) -> Result<Found, FrameError>,
) -> Result<Found> {
    let start = Instant::now();
    let scaled = prepare(picture, request)?;
    let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).map_err(|e| {
        let (whole, at) = ((picture.width, picture.height), (scaled.width, scaled.height));
        let told = format!("{}x{} px, {}x{} at this profile", whole.0, whole.1, at.0, at.1);
        match request.region {
            None => anyhow!(e).context(told),
            Some(region) => Unsuitable(format!(
                "--roi {region} of {told}: {e}; give a region that is less elongated, or a larger --profile"
            ))
            .into(),
        }
    })?;
    let own = &request.within(&scaled.to_picture);
    let mut found = with_detector(request.profile, slot, |detector| work(detector, &frame, own))?;
    found.map_back(&scaled.to_picture);
    (found.part, found.mirrored) = (scaled.part, request.mirror);
    found.total_ns = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
    Ok(found)
}

/// Calls `work` with the detector of a profile and of thread `slot`.
pub fn with_detector<T>(profile: Profile, slot: usize, work: impl FnOnce(&mut AnyDetector) -> T) -> T {
    let slot = slot % MAX_THREADS;
    match profile {
        Profile::Hd => work(&mut *lock(&HD[slot])),
        Profile::Vga => work(&mut *lock(&VGA[slot])),
        Profile::Qvga => work(&mut *lock(&QVGA[slot])),
        Profile::Qqvga => work(&mut *lock(&QQVGA[slot])),
    }
}

fn lock<T>(m: &Mutex<T>) -> MutexGuard<'_, T> {
    // A detector keeps nothing from frame to frame that a panic could damage.
    m.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture whose every sample is another one than its neighbours.
    fn picture(kind: PixelFormat) -> Picture {
        let bytes = (0u32..).map(|i| i.wrapping_mul(2_654_435_761).to_be_bytes()[0]);
        let bytes: Vec<u8> = bytes.take(kind.bytes(64, 48)).collect();
        let pixels = match kind {
            PixelFormat::Rgb8 => Pixels::Rgb8(bytes),
            PixelFormat::I420 => Pixels::I420(bytes),
            _ => Pixels::Gray8(bytes),
        };
        Picture { width: 64, height: 48, pixels }
    }

    #[test]
    fn a_place_in_what_is_searched_is_the_same_pixel_of_the_picture() {
        let search = Request::new(Profile::Vga, 0.8);
        for kind in [PixelFormat::Rgb8, PixelFormat::Gray8, PixelFormat::I420] {
            let picture = picture(kind);
            let whole = prepare(&picture, &search).expect("prepares");
            for (roi, mirror) in [("10,6,30,20", false), ("10,6,30,20", true), ("0,0,100%,100%", true)] {
                let request = Request { region: roi.parse().ok(), mirror, ..search };
                let part = prepare(&picture, &request).expect("prepares");
                let (n, w) = (kind.row_bytes(1), part.width);
                for (x, y) in (0..part.height).flat_map(|y| (0..w).map(move |x| (x, y))) {
                    let at = part.to_picture.apply([x as f32, y as f32]);
                    assert_eq!(at.map(f32::fract), [0.0; 2], "whole px");
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places in the picture")]
                    let [u, v] = at.map(|v| v as usize);
                    let there = &whole.data[n * (v * 64 + u)..][..n];
                    assert_eq!(&part.data[n * (y * w + x)..][..n], there, "{kind:?} {roi} {mirror}: {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn mirrored_chroma_stays_with_its_pixels() {
        let picture = picture(PixelFormat::I420);
        let search = Request { mirror: true, ..Request::new(Profile::Vga, 0.8) };
        let (before, after) = (prepare(&picture, &Request { mirror: false, ..search }), prepare(&picture, &search));
        let (before, after) = (before.expect("prepares"), after.expect("prepares"));
        for plane in [64 * 48, 64 * 48 * 5 / 4] {
            for (x, y) in (0..24).flat_map(|y| (0..32).map(move |x| (x, y))) {
                assert_eq!(after.data[plane + 32 * y + x], before.data[plane + 32 * y + 31 - x], "{x}, {y}");
            }
        }
    }

    #[test]
    fn a_region_is_scaled_by_itself() {
        let picture = Picture { width: 1920, height: 1080, pixels: Pixels::Gray8(vec![7; 1920 * 1080]) };
        let search = Request::new(Profile::Vga, 0.8);
        let of = |roi: &str| prepare(&picture, &Request { region: roi.parse().ok(), ..search }).expect("prepares");
        let near = of("1000,500,640,480");
        assert_eq!((near.width, near.height, near.to_picture.apply([0.0; 2])), (640, 480, [1000.0, 500.0]));
        let half = of("600,100,1280,960");
        // The first pixel is the mean of two by two.
        assert_eq!((half.width, half.height, half.to_picture.apply([0.0; 2])), (640, 480, [600.5, 100.5]));
    }
}
