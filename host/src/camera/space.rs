//! Where objects are in space, live.
//!
//! In: the camera and its lens, the true widths of objects, and what is found. Out: a pose of each object whose width is
//! known, steady from frame to frame, and its axes in px of the frame. Memory: a rotation for each instance. Cost: some
//! microseconds for each detection.

use anyhow::{Result, anyhow};
use keygraph_core::{Intrinsics, Lens, Model};
use serde_json::{Value, json};

use crate::input::Picture;
use crate::lens::Optics;
use crate::pose::{Calibration, CameraArguments, Place, Steady, Width};
use crate::region::Unsuitable;
use crate::report::px;
use crate::search::Found;

/// The camera and what is known of the objects before it.
#[derive(Debug, Default)]
pub struct Space {
    optics: Option<Optics>,
    intrinsics: Option<Intrinsics>,
    widths: Vec<Width>,
    /// For the model of now.
    calibration: Option<Calibration>,
    /// For the size of the newest frame.
    lens: Option<Lens>,
    steady: Steady,
}

impl Space {
    /// As a command line says.
    ///
    /// # Errors
    /// When a file of a lens cannot be read, or something is missing.
    pub fn new(arguments: &CameraArguments) -> Result<Self> {
        if let Some(message) = arguments.lacks() {
            return Err(anyhow!(Unsuitable(message.into())));
        }
        let optics = arguments.optics()?;
        let intrinsics = arguments.intrinsics(optics.as_ref())?;
        Ok(Self { optics, intrinsics, widths: arguments.widths().to_vec(), ..Self::default() })
    }

    /// Takes over the objects of a model.
    pub fn meet(&mut self, model: Option<&Model<'_>>) {
        let known = self.intrinsics.zip(model);
        self.calibration = known.map(|(intrinsics, model)| Calibration::of_any(intrinsics, &self.widths, model));
    }

    /// The lens for a frame.
    ///
    /// # Errors
    /// [`Unsuitable`] when its calibration is of frames with other proportions.
    pub fn lens(&mut self, picture: &Picture) -> Result<Option<Lens>> {
        let of_frame = self.optics.map(|o| o.of_size(picture.width, picture.height)).transpose();
        self.lens = of_frame.map_err(|e| anyhow!(Unsuitable(e.to_string())))?;
        Ok(self.lens)
    }

    /// Where what is found is; `None` when poses are not asked for.
    pub fn places(&mut self, model: &Model<'_>, found: &Found) -> Option<Vec<Place>> {
        let mut places = self.calibration.as_ref()?.through(self.lens).places(model, found);
        if let Some(tracking) = &found.tracking {
            let seen = tracking.seen.iter().zip(&mut places);
            self.steady.order(seen.map(|((id, _), place)| (*id, place.pose.as_mut())));
        }
        Some(places)
    }

    /// Adds the axes of each object to the line of a frame.
    pub fn draw(&self, line: &mut Value, found: &Found, places: Option<&[Place]>) {
        let Some(calibration) = self.calibration.as_ref().map(|c| c.through(self.lens)) else { return };
        for (i, (d, place)) in found.detections.iter().zip(places.unwrap_or_default()).enumerate() {
            if let Some(pose) = &place.pose {
                let axes = calibration.axes(d, pose).map(|p| p.map(px));
                line["detections"][i]["axes"] = json!(axes);
            }
        }
    }
}
