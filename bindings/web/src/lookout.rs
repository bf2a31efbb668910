//! Frames through a detector or a tracker.
//!
//! In: a model, options, frames. Out: for each frame the line that the command line prints, and on request
//! the corners, triangles and votes, 32-bit floats in px of the frame. Memory: the model, and the host's
//! detector in a static. Cost: that of the search, and a copy of the frame.

use keygraph::pose::{Calibration, Width};
use keygraph::report::frame_line;
use keygraph::search::{Found, Profile, Request, Shape, depth_of};
use keygraph::trail::Trail;
use keygraph::wide::search_widely;
use keygraph_core::{DEFAULT_THRESHOLD, Intrinsics, Lens, Model};
use serde_json::json;

use crate::failure::Failure;
use crate::message::{Answer, Look, Open, Widths};
use crate::pixels;
use crate::workshop::named;

/// What searches frames, one after the other.
#[derive(Debug)]
pub struct Lookout {
    model: Model<'static>,
    request: Request,
    calibration: Option<Calibration>,
    trail: Option<Trail<u32>>,
    sequence: u32,
}

fn share(what: &str, v: f32) -> Result<f32, Failure> {
    if (0.0..=1.0).contains(&v) { Ok(v) } else { Err(Failure::value(format!("{what}: expected 0 to 1, got {v}"))) }
}

/// The camera and the widths of the objects, where they are given.
fn calibration(options: &Open, model: &Model<'_>) -> Result<Option<Calibration>, Failure> {
    let (intrinsics, widths) = match (&options.intrinsics, &options.width_mm) {
        (None, None) => return Ok(None),
        (Some(_), None) if options.distortion.is_some() => return Ok(None),
        (Some(intrinsics), Some(widths)) => (intrinsics, widths),
        _ => return Err(Failure::value("poses need both intrinsics and widthMm")),
    };
    let [fx, fy, cx, cy] = *intrinsics;
    let intrinsics = Intrinsics::new(fx, fy, cx, cy).map_err(|e| Failure::value(format!("intrinsics: {e}")))?;
    let texts: Vec<String> = match widths {
        Widths::All(mm) => vec![mm.to_string()],
        Widths::Named(each) => each.iter().map(|(name, mm)| format!("{name}={mm}")).collect(),
    };
    let widths: Result<Vec<Width>, _> = texts.iter().map(|t| t.parse()).collect();
    let widths = widths.map_err(|e| Failure::value(format!("widthMm: {e}")))?;
    Ok(Some(Calibration::new(intrinsics, &widths, model)?.through(lens(options)?)))
}

/// The camera's lens, where it is given.
fn lens(options: &Open) -> Result<Option<Lens>, Failure> {
    let Some(k) = &options.distortion else { return Ok(None) };
    let Some(intrinsics) = options.intrinsics else {
        return Err(Failure::value("distortion needs intrinsics"));
    };
    if options.mirror {
        return Err(Failure::value("mirror: a lens is that of frames that are not mirrored"));
    }
    let distortion = keygraph::lens::distortion(options.fisheye, k)
        .ok_or_else(|| Failure::value("distortion: expected 4, 5 or 8 numbers in OpenCV's order, or 4 with fisheye"))?;
    let lens = Lens::new(intrinsics, distortion).map_err(|e| Failure::value(format!("distortion: {e}")))?;
    Ok(Some(lens))
}

impl Lookout {
    /// Opens a detector or a tracker for a model.
    pub fn open(options: &Open, model: &[u8]) -> Result<Self, Failure> {
        Model::parse(model)?;
        let profile = named("profile", &options.profile, &Profile::NAMED)?;
        let budget = match options.budget_ms {
            Some(ms) if !(ms > 0.0 && ms <= 1e6) => {
                return Err(Failure::value(format!("budgetMs: expected a number of ms above 0, got {ms}")));
            }
            ms => ms.map(|ms| std::time::Duration::from_secs_f64(ms / 1e3)),
        };
        if options.track && options.wide {
            return Err(Failure::value("wide: for detectors; a tracker searches as they do without it"));
        }
        if options.wide && (options.distortion.is_some() || options.digests) {
            return Err(Failure::value("wide: leave out distortion and digests"));
        }
        if !options.track && options.smooth > 0 {
            return Err(Failure::value("smooth: for trackers; a detector takes each frame by itself"));
        }
        let region = options.roi.as_deref().map(str::parse).transpose();
        let request = Request {
            budget,
            min_visible: share("minVisible", options.min_visible)?,
            all_names: options.all_names,
            shape: named("surface", &options.surface, &Shape::NAMED)?,
            lens: lens(options)?,
            region: region.map_err(|e| Failure::value(format!("roi: {e}")))?,
            mirror: options.mirror,
            depth: depth_of(options.thorough),
            wide: options.wide,
            smooth: options.smooth,
            digests: options.digests,
            ..Request::new(profile, share("threshold", options.threshold.unwrap_or(DEFAULT_THRESHOLD))?)
        };
        // A page opens one for each module, and ends the module with it.
        let model = Model::parse(Vec::leak(model.to_vec()))?;
        let calibration = calibration(options, &model)?;
        let trail = options.track.then(Trail::default);
        Ok(Self { model, request, calibration, trail, sequence: 0 })
    }

    /// Searches a frame, or follows objects into it.
    pub fn look(&mut self, look: &Look, bytes: &[u8]) -> Result<Answer, Failure> {
        let picture = pixels::frame(&look.pixels, bytes)?;
        let request = Request { details: look.details, ..self.request };
        let found = match &mut self.trail {
            Some(trail) => {
                if look.details {
                    // Frames that are only followed have no corners and triangles.
                    trail.search_next();
                }
                trail.next(self.sequence, &picture, &self.model, &request, 0)?
            }
            None => search_widely(&picture, &self.model, &request, 0..1)?,
        };
        let places = self.calibration.as_ref().map(|c| c.places(&self.model, &found));
        let size = (picture.width, picture.height);
        let mut line = frame_line(&look.source, look.frame, size, &self.model, &found, places.as_deref());
        if !look.details {
            return Ok(Answer::of(&line));
        }
        line["details"] = json!([found.corners.len(), found.keygraphs.len(), votes(&found).count()]);
        let points = found.corners.iter().chain(found.keygraphs.iter().flatten()).chain(votes(&found).flatten());
        let floats = points.flatten().flat_map(|v| v.to_le_bytes());
        Ok(Answer::of(&line).with(floats))
    }

    /// Makes the next frame the first of a new sequence.
    pub const fn restart(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
    }
}

/// The triangles that agree with detections.
fn votes(found: &Found) -> impl Iterator<Item = &[[f32; 2]; 3]> {
    found.supporters.iter().flatten()
}
