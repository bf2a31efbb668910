//! One frame through a detector of the core: as it is in memory where that is possible.
//!
//! In: pixels, a model, a request. Out: what was found, in px of the whole frame. Memory: a detector on
//! the heap, and a copy of frames that cannot be read in place. Cost: that of the core. A frame that is
//! scaled down, mirrored or gathered takes a pass over its pixels more.

use std::thread;
use std::time::Instant;

use keygraph::picture::{Part, Picture, Pixels};
use keygraph::search::{AnyDetector, Found, Profile, Request, prepare};
use keygraph::wide::{is_wanted, larger, search_squeezed_by};
use keygraph_core::{Frame, FrameError, HdDetector, PixelFormat, QqvgaDetector, QvgaDetector, VgaDetector, Window};
use pyo3::prelude::*;

use crate::errors::{defect, exception, frame_error};
use crate::frame::View;
use crate::model::Model;
use crate::sensor::{checked, picture};

/// A detector of the core in memory of its own, and memory for frames that are copied.
#[derive(Debug)]
pub struct Room {
    /// The detector.
    pub detector: AnyRoom,
    /// The detector of squeezed frames, [`larger`]; `None` when frames are not searched widely.
    pub larger: Option<AnyRoom>,
    /// Samples of a frame that cannot be read in place.
    pub scratch: Vec<u8>,
}

/// A detector of any profile.
#[derive(Debug)]
pub enum AnyRoom {
    Hd(Box<HdDetector>),
    Vga(Box<VgaDetector>),
    Qvga(Box<QvgaDetector>),
    Qqvga(Box<QqvgaDetector>),
}

/// A stack on which the largest detector can be made before it moves to the heap.
const STACK: usize = 32 << 20;

impl Room {
    /// The room of a detector for frames that are searched so.
    pub fn of(request: &Request) -> PyResult<Self> {
        let larger = request.wide.then(|| AnyRoom::new(larger(request.profile))).transpose()?;
        Ok(Self { detector: AnyRoom::new(request.profile)?, larger, scratch: Vec::new() })
    }
}

impl AnyRoom {
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

    pub fn any(&mut self) -> &mut AnyDetector {
        match self {
            Self::Hd(d) => &mut **d,
            Self::Vga(d) => &mut **d,
            Self::Qvga(d) => &mut **d,
            Self::Qqvga(d) => &mut **d,
        }
    }
}

/// A search of one frame.
#[derive(Debug)]
pub struct Search<'a> {
    /// The objects.
    pub model: &'a Model,
    /// How frames are searched.
    pub request: &'a Request,
    /// When the search began.
    pub start: Instant,
}

/// Why a frame was not searched.
#[derive(Debug)]
pub enum Refused {
    /// The frame is none that a detector takes.
    Frame(FrameError),
    /// Another reason.
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

/// A frame that is read in place, or a part of one.
struct InPlace<'a> {
    frame: Frame<'a>,
    part: Option<(Window, Part)>,
}

impl Search<'_> {
    /// Prepares the pixels, calls `work` with them, and maps the results to px of the whole frame.
    pub fn run(
        &self,
        view: &View<'_>,
        scratch: &mut Vec<u8>,
        work: impl FnOnce(&Frame<'_>, &Request) -> Result<Found, FrameError>,
    ) -> Result<Found, Refused> {
        let found = match self.in_place(view)? {
            Some(InPlace { frame, part: None }) => work(&frame, self.request)?,
            Some(InPlace { frame, part: Some((window, part)) }) => {
                let mut found = work(&frame, &self.request.within(&window.to_frame()))?;
                found.map_back(&window.to_frame());
                Found { part: Some(part), ..found }
            }
            None => self.copied(view, scratch, work)?,
        };
        let total_ns = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Ok(Found { mirrored: self.request.mirror, total_ns, ..found })
    }

    /// Adds what is seen from far to the side to what was found in a frame. The detector is a larger one.
    pub fn widen(&self, found: Found, view: &View<'_>, detector: &mut AnyDetector) -> Result<Found, Refused> {
        if !is_wanted(&found, self.model.view(), self.request) {
            return Ok(found);
        }
        let mut owned = None;
        let picture = as_picture(view, &mut owned)?;
        let request = (self.request, self.start);
        search_squeezed_by(detector, found, picture, self.model.view(), request).map_err(Refused::Other)
    }

    /// The frame as it is in memory, or a part of it, when it fits the detector so.
    fn in_place<'v>(&self, view: &View<'v>) -> Result<Option<InPlace<'v>>, Refused> {
        let (width, height) = view.size();
        let frame = match view {
            View::Raw(layout, data) => checked(layout, data)?,
            View::Picture(picture) if self.fits(width, height) => {
                let (format, bytes) = match &picture.pixels {
                    Pixels::Rgb8(b) => (PixelFormat::Rgb8, b),
                    Pixels::Gray8(b) => (PixelFormat::Gray8, b),
                    Pixels::I420(b) => (PixelFormat::I420, b),
                };
                Frame::new(format, width, height, bytes)?
            }
            _ => return Ok(None),
        };
        let Some(region) = self.request.region else {
            return Ok(self.fits(width, height).then_some(InPlace { frame, part: None }));
        };
        use PixelFormat::{Gray8, Rgb8, Rgb565, Rgb565Be};
        let shares = !matches!(frame.format(), Rgb8 | Gray8 | Rgb565 | Rgb565Be);
        let pixels = if shares { Pixels::I420(Vec::new()) } else { Pixels::Gray8(Vec::new()) };
        let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
        let outline = Picture { width: side(width), height: side(height), pixels };
        let part = region.part(&outline).map_err(|e| Refused::Other(e.into()))?;
        let [x, y, width, height] = [part.x, part.y, part.width, part.height].map(|v| v as usize);
        if !self.fits(width, height) {
            return Ok(None);
        }
        let window = Window { x, y, width, height };
        Ok(Some(InPlace { frame: frame.window(window)?, part: Some((window, part)) }))
    }

    /// Whether pixels of this size are searched without being scaled down or mirrored.
    fn fits(&self, width: usize, height: usize) -> bool {
        let (side, pixels) = self.request.profile.limits();
        !self.request.mirror && width.max(height) <= side && width * height <= pixels
    }

    /// Copies the pixels as far as needed: gathered, cut, scaled down, mirrored.
    fn copied(
        &self,
        view: &View<'_>,
        scratch: &mut Vec<u8>,
        work: impl FnOnce(&Frame<'_>, &Request) -> Result<Found, FrameError>,
    ) -> Result<Found, Refused> {
        let (width, height) = view.size();
        if self.request.region.is_none()
            && self.fits(width, height)
            && let Some(format) = view.gather(scratch)
        {
            return Ok(work(&Frame::new(format, width, height, scratch)?, self.request)?);
        }
        let mut owned = None;
        let picture = as_picture(view, &mut owned)?;
        let scaled = prepare(picture, self.request).map_err(|e| Refused::Other(e.into()))?;
        let frame = Frame::new(scaled.format, scaled.width, scaled.height, &scaled.data).map_err(|e| {
            let (width, height) = (scaled.width, scaled.height);
            let said =
                format!("the frame has {}x{} px, {width}x{height} at this profile", picture.width, picture.height);
            Refused::Other(anyhow::Error::from(e).context(said))
        })?;
        let mut found = work(&frame, &self.request.within(&scaled.to_picture))?;
        found.map_back(&scaled.to_picture);
        Ok(Found { part: scaled.part, ..found })
    }
}

/// The frame as a picture. What is not one yet is copied into `owned`.
fn as_picture<'a>(view: &'a View<'_>, owned: &'a mut Option<Picture>) -> Result<&'a Picture, Refused> {
    match view {
        View::Picture(picture) => Ok(picture),
        _ => Ok(owned.insert(picture(view)?)),
    }
}
