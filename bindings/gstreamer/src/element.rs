//! The element `keygraphdetect`: finds objects in the frames that pass through it.
//!
//! In: frames (I420, NV12, RGB, GRAY8; `videoconvert` makes these of all others), a model. Out: the same frames,
//! each with a region-of-interest meta for each object, a message `keygraph` on the bus with the line of
//! docs/detection.md, and on request the outlines drawn in. Memory: a detector of the host, shared by at most
//! a few elements, a tracker and a copy of the frame. Cost: that of the search.

use std::fmt::Debug;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use gst::glib;
use gst::prelude::*;
use gst::subclass::prelude::*;
use gst_base::subclass::BaseTransformMode;
use gst_base::subclass::prelude::*;
use gst_video::{VideoCapsBuilder, VideoFrameRef, VideoInfo, VideoRegionOfInterestMeta};
use gstreamer as gst;
use gstreamer_base as gst_base;
use gstreamer_video as gst_video;
use keygraph::learn::merge;
use keygraph::report::frame_line;
use keygraph::search::{Found, MAX_THREADS, Profile, Request, Shape, depth_of};
use keygraph::trail::Trail;
use keygraph::wide::search_widely;
use keygraph_core::{DEFAULT_THRESHOLD, Model};

use crate::drawing::outline;
use crate::pixels::{FORMATS, picture};

static LOG: LazyLock<gst::DebugCategory> = LazyLock::new(|| {
    gst::DebugCategory::new("keygraphdetect", gst::DebugColorFlags::empty(), Some("Planar objects from one picture"))
});

// The macro's own code is not safe by the compiler's measure; the crate is made for this.
#[allow(unsafe_code, missing_docs, missing_debug_implementations)]
mod owned {
    use keygraph_core::Model;
    self_cell::self_cell!(
        /// The bytes of a model, and the view of them.
        pub struct Owned {
            owner: Vec<u8>,
            #[covariant]
            dependent: Model,
        }
    );
}
use owned::Owned;

/// What the user sets.
#[derive(Clone, Debug)]
struct Settings {
    /// Paths of models, with commas between them.
    model: String,
    profile: String,
    threshold: f32,
    min_visible: f32,
    surface: String,
    roi: String,
    mirror: bool,
    thorough: bool,
    wide: bool,
    all_names: bool,
    /// Time of a search, ms; 0 for any.
    budget_ms: f64,
    track: bool,
    smooth: u32,
    overlay: bool,
    messages: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            model: String::new(),
            profile: "vga".into(),
            threshold: DEFAULT_THRESHOLD,
            min_visible: 0.0,
            surface: "any".into(),
            roi: String::new(),
            mirror: false,
            thorough: false,
            wide: false,
            all_names: false,
            budget_ms: 0.0,
            track: true,
            smooth: 0,
            overlay: false,
            messages: true,
        }
    }
}

/// What an element has while it runs.
struct Running {
    model: Owned,
    request: Request,
    trail: Option<Trail<u32>>,
    /// The number of the sequence: a seek starts another one.
    sequence: u32,
    frame: u64,
    /// The host's detector that this element uses.
    slot: usize,
    info: Option<VideoInfo>,
}

impl Running {
    fn start(settings: &Settings) -> Result<Self> {
        if settings.model.is_empty() {
            bail!("set model=FILE.kgm, which `keygraph train` makes; several have commas between them");
        }
        let read = |path: &str| std::fs::read(path.trim()).with_context(|| path.trim().to_string());
        let mut models = settings.model.split(',').map(read).collect::<Result<Vec<_>>>()?;
        let model = if models.len() == 1 { models.swap_remove(0) } else { merge(&models)? };
        let model = Owned::try_new(model, |bytes| Model::parse(bytes)).with_context(|| settings.model.clone())?;
        let profile = named("profile", &settings.profile, &Profile::NAMED)?;
        if settings.track && settings.wide {
            bail!("wide: set track=false; a tracker searches as it does without it");
        }
        if !settings.track && settings.smooth > 0 {
            bail!("smooth: for outlines that are followed; leave track as it is");
        }
        let region = Some(settings.roi.as_str()).filter(|roi| !roi.is_empty()).map(str::parse).transpose();
        let request = Request {
            min_visible: settings.min_visible,
            shape: named("surface", &settings.surface, &Shape::NAMED)?,
            region: region.map_err(|e| anyhow!("roi: {e}"))?,
            mirror: settings.mirror,
            depth: depth_of(settings.thorough),
            wide: settings.wide,
            all_names: settings.all_names,
            budget: (settings.budget_ms > 0.0).then(|| Duration::from_secs_f64(settings.budget_ms / 1e3)),
            smooth: u8::try_from(settings.smooth).unwrap_or(u8::MAX),
            ..Request::new(profile, settings.threshold)
        };
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let slot = NEXT.fetch_add(1, Ordering::Relaxed) % MAX_THREADS;
        let trail = settings.track.then(Trail::default);
        Ok(Self { model, request, trail, sequence: 0, frame: 0, slot, info: None })
    }
}

/// The value of this name.
fn named<T: Copy>(what: &str, name: &str, all: &[(&str, T)]) -> Result<T> {
    let names = || all.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    let known = all.iter().find(|(known, _)| *known == name);
    known.map(|&(_, value)| value).with_context(|| format!("{what}: expected one of {}; got {name}", names()))
}

impl Debug for Running {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Running").field("request", &self.request).finish_non_exhaustive()
    }
}

/// The element's own part.
#[derive(Debug, Default)]
pub struct Own {
    settings: Mutex<Settings>,
    running: Mutex<Option<Running>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[glib::object_subclass]
impl ObjectSubclass for Own {
    const NAME: &'static str = "GstKeygraphDetect";
    type Type = KeygraphDetect;
    type ParentType = gst_base::BaseTransform;
}

impl ObjectImpl for Own {
    fn properties() -> &'static [glib::ParamSpec] {
        static PROPERTIES: LazyLock<Vec<glib::ParamSpec>> = LazyLock::new(|| {
            let all = Settings::default();
            let string = |name: &str, blurb: &str, default: &str| {
                glib::ParamSpecString::builder(name).blurb(blurb).default_value(default).mutable_ready().build()
            };
            let share = |name: &str, blurb: &str, default: f32| {
                let spec = glib::ParamSpecFloat::builder(name).blurb(blurb).minimum(0.0).maximum(1.0);
                spec.default_value(default).mutable_ready().build()
            };
            let flag = |name: &str, blurb: &str, default: bool| {
                glib::ParamSpecBoolean::builder(name).blurb(blurb).default_value(default).mutable_ready().build()
            };
            let milliseconds = |name: &str, blurb: &str| {
                glib::ParamSpecDouble::builder(name).blurb(blurb).minimum(0.0).maximum(1e6).mutable_ready().build()
            };
            let frames = |name: &str, blurb: &str| {
                glib::ParamSpecUInt::builder(name).blurb(blurb).maximum(u8::MAX.into()).mutable_ready().build()
            };
            vec![
                string("model", "Model file (.kgm); several have commas between them", ""),
                string("profile", "Size that frames are searched at: hd, vga, qvga, qqvga", &all.profile),
                share("threshold", "Minimum score of a detection", all.threshold),
                share("min-visible", "Minimum share of an object that must be seen and agree", all.min_visible),
                string("surface", "Shape that objects may have: any, plane", &all.surface),
                string("roi", "Part of each frame that is searched: x,y,width,height, px or percent", &all.roi),
                flag("mirror", "Search frames mirrored left to right", all.mirror),
                flag("thorough", "Search all of each frame, and again in tiles", all.thorough),
                flag("wide", "Without track: find what is seen from far to the side, too", all.wide),
                flag("all-names", "Report all objects that could be at a place", all.all_names),
                milliseconds("budget-ms", "Time after which the search of a frame is stopped, ms; 0: none"),
                frames("smooth", "With track: frames over which outlines that stand still are averaged; 0: none"),
                flag("track", "Follow objects from frame to frame, instead of searching every frame", all.track),
                flag("overlay", "Draw outlines into the frames", all.overlay),
                flag("messages", "Post a message `keygraph` for each frame, whose `json` is its line", all.messages),
            ]
        });
        &PROPERTIES
    }

    fn set_property(&self, _id: usize, value: &glib::Value, spec: &glib::ParamSpec) {
        let mut settings = lock(&self.settings);
        // GLib has checked the type of the value.
        let text = || value.get::<Option<String>>().ok().flatten().unwrap_or_default();
        match spec.name() {
            "model" => settings.model = text(),
            "profile" => settings.profile = text(),
            "threshold" => settings.threshold = value.get().unwrap_or(DEFAULT_THRESHOLD),
            "min-visible" => settings.min_visible = value.get().unwrap_or_default(),
            "surface" => settings.surface = text(),
            "roi" => settings.roi = text(),
            "mirror" => settings.mirror = value.get().unwrap_or_default(),
            "thorough" => settings.thorough = value.get().unwrap_or_default(),
            "wide" => settings.wide = value.get().unwrap_or_default(),
            "all-names" => settings.all_names = value.get().unwrap_or_default(),
            "budget-ms" => settings.budget_ms = value.get().unwrap_or_default(),
            "smooth" => settings.smooth = value.get().unwrap_or_default(),
            "track" => settings.track = value.get().unwrap_or(true),
            "overlay" => settings.overlay = value.get().unwrap_or_default(),
            _ => settings.messages = value.get().unwrap_or(true),
        }
    }

    fn property(&self, _id: usize, spec: &glib::ParamSpec) -> glib::Value {
        let settings = lock(&self.settings);
        match spec.name() {
            "model" => settings.model.to_value(),
            "profile" => settings.profile.to_value(),
            "threshold" => settings.threshold.to_value(),
            "min-visible" => settings.min_visible.to_value(),
            "surface" => settings.surface.to_value(),
            "roi" => settings.roi.to_value(),
            "mirror" => settings.mirror.to_value(),
            "thorough" => settings.thorough.to_value(),
            "wide" => settings.wide.to_value(),
            "all-names" => settings.all_names.to_value(),
            "budget-ms" => settings.budget_ms.to_value(),
            "smooth" => settings.smooth.to_value(),
            "track" => settings.track.to_value(),
            "overlay" => settings.overlay.to_value(),
            _ => settings.messages.to_value(),
        }
    }
}

impl GstObjectImpl for Own {}

impl ElementImpl for Own {
    fn metadata() -> Option<&'static gst::subclass::ElementMetadata> {
        static METADATA: LazyLock<gst::subclass::ElementMetadata> = LazyLock::new(|| {
            gst::subclass::ElementMetadata::new(
                "Keygraph detector",
                "Filter/Analyzer/Video",
                "Finds planar objects from one picture of each: books, posters, boxes, signs",
                "The Keygraph project",
            )
        });
        Some(&METADATA)
    }

    fn pad_templates() -> &'static [gst::PadTemplate] {
        static TEMPLATES: LazyLock<Vec<gst::PadTemplate>> = LazyLock::new(|| {
            let caps = VideoCapsBuilder::new().format_list(FORMATS).build();
            let template = |name: &str, direction| {
                gst::PadTemplate::new(name, direction, gst::PadPresence::Always, &caps).into_iter()
            };
            template("sink", gst::PadDirection::Sink).chain(template("src", gst::PadDirection::Src)).collect()
        });
        &TEMPLATES
    }
}

impl BaseTransformImpl for Own {
    const MODE: BaseTransformMode = BaseTransformMode::AlwaysInPlace;
    const PASSTHROUGH_ON_SAME_CAPS: bool = false;
    const TRANSFORM_IP_ON_PASSTHROUGH: bool = false;

    fn start(&self) -> Result<(), gst::ErrorMessage> {
        let settings = lock(&self.settings).clone();
        let running = Running::start(&settings)
            .map_err(|e| gst::error_msg!(gst::ResourceError::Settings, ["keygraphdetect: {e:#}"]))?;
        *lock(&self.running) = Some(running);
        Ok(())
    }

    fn stop(&self) -> Result<(), gst::ErrorMessage> {
        *lock(&self.running) = None;
        Ok(())
    }

    fn set_caps(&self, sink: &gst::Caps, _src: &gst::Caps) -> Result<(), gst::LoggableError> {
        let info = VideoInfo::from_caps(sink).map_err(|_| gst::loggable_error!(LOG, "no video: {sink}"))?;
        if let Some(running) = &mut *lock(&self.running) {
            running.info = Some(info);
            running.sequence += 1;
        }
        Ok(())
    }

    fn sink_event(&self, event: gst::Event) -> bool {
        // After a seek, the next frame has nothing to do with the last one.
        if event.type_() == gst::EventType::FlushStop
            && let Some(running) = &mut *lock(&self.running)
        {
            running.sequence += 1;
        }
        self.parent_sink_event(event)
    }

    fn transform_ip(&self, buffer: &mut gst::BufferRef) -> Result<gst::FlowSuccess, gst::FlowError> {
        let settings = lock(&self.settings).clone();
        let mut running = lock(&self.running);
        let Some(Running { model, request, trail, sequence, frame, slot, info: Some(info) }) = &mut *running else {
            return Err(gst::FlowError::NotNegotiated);
        };
        let shown = VideoFrameRef::from_buffer_ref_readable(buffer, info).map_err(|_| gst::FlowError::Error)?;
        let picture = picture(&shown);
        drop(shown);
        let model = model.borrow_dependent();
        let found = match trail {
            Some(trail) => trail.next(*sequence, &picture, model, request, *slot),
            None => search_widely(&picture, model, request, *slot..*slot + 1),
        };
        let found = found.map_err(|e| {
            gst::element_imp_error!(self, gst::StreamError::Failed, ["keygraphdetect: {e:#}"]);
            gst::FlowError::Error
        })?;
        if settings.messages {
            let size = (picture.width, picture.height);
            let line = frame_line(&self.obj().name(), *frame, size, model, &found, None).to_string();
            let structure = gst::Structure::builder("keygraph").field("json", line).field("pts", buffer.pts()).build();
            // A pipeline that ends takes no messages any more.
            let _ = self.obj().post_message(gst::message::Element::builder(structure).src(&*self.obj()).build());
        }
        *frame += 1;
        add_metas(buffer, model, &found, (picture.width, picture.height));
        if settings.overlay {
            let mut drawn = VideoFrameRef::from_buffer_ref_writable(buffer, info).map_err(|_| gst::FlowError::Error)?;
            found.detections.iter().for_each(|d| outline(&mut drawn, &d.corners));
        }
        Ok(gst::FlowSuccess::Ok)
    }
}

/// Adds a region of interest for each detection: the upright rectangle around its outline, as far as it lies in
/// the frame. Its type is the name of the object; its parameter `keygraph` has score, corners and, of a tracker,
/// id.
fn add_metas(buffer: &mut gst::BufferRef, model: &Model<'_>, found: &Found, (width, height): (u32, u32)) {
    for (i, d) in found.detections.iter().enumerate() {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited to the frame")]
        let span = |axis: usize, most: u32| {
            let all = d.corners.iter().map(|c| c[axis].clamp(0.0, most as f32));
            let (low, high) = all.fold((most as f32, 0.0f32), |(a, b), v| (a.min(v), b.max(v)));
            (low.floor() as u32, (high.ceil() - low.floor()) as u32)
        };
        let ((x, w), (y, h)) = (span(0, width), span(1, height));
        let name = model.object(usize::from(d.object)).name;
        let corners = gst::Array::new(d.corners.iter().flatten().map(|&v| f64::from(v)));
        let mut told = gst::Structure::builder("keygraph").field("score", f64::from(d.score)).field("corners", corners);
        if let Some((id, _)) = found.tracking.as_ref().and_then(|t| t.seen.get(i)) {
            told = told.field("id", *id);
        }
        VideoRegionOfInterestMeta::add(buffer, name, (x, y, w, h)).add_param(told.build());
    }
}

glib::wrapper! {
    /// The element.
    pub struct KeygraphDetect(ObjectSubclass<Own>) @extends gst_base::BaseTransform, gst::Element, gst::Object;
}

/// Registers the element.
pub fn register(plugin: &gst::Plugin) -> Result<(), glib::BoolError> {
    gst::Element::register(Some(plugin), "keygraphdetect", gst::Rank::NONE, KeygraphDetect::static_type())
}
