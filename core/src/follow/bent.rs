//! Surfaces of what is followed: fitted anew in every frame, from the shape in the frame before.
//!
//! In: a frame, and a track that is seen in it. Out: its surface, if it lies on one that is bent. A track that
//! a plane explained is tried again after [`RETRY`] frames. Memory: some 5.5 KB in [`Surfaces`]. Cost: that of
//! converting the part of the frame that shows the track, and of `surface`: half of it where the shape is
//! known. Full: of more tracks than a frame holds, the shapes that have not been asked for longest are forgotten.

use heapless::Vec;

use crate::base::capacity::DETECTIONS;
use crate::base::geometry::Homography;
use crate::detect::buffers::Profile;
use crate::detect::detector::Detector;
use crate::detect::observer::{Laps, Observer};
use crate::detect::surface::{Eye, Known, Shape, Surface, fit};
use crate::follow::instance::{State, Track};
use crate::follow::sight::part_of;
use crate::image::frame::{Frame, FrameError};
use crate::model::parse::Model;

/// Number of frames until a surface is looked for again.
const RETRY: u8 = 8;

/// Maximum number of tracks whose shapes are known.
const MOST: usize = DETECTIONS;

/// What is known of a track.
#[derive(Clone, Copy, Debug)]
struct Shaped {
    id: u32,
    /// The shape in the last frame; `None` when a plane explained what was seen.
    shape: Option<Shape>,
    /// Number of frames until a surface is looked for again.
    wait: u8,
}

/// The shapes of the instances of one [`Tracker`](crate::Tracker).
#[derive(Debug, Default)]
pub struct Surfaces {
    /// Shapes in the order in which they were asked for, the oldest first.
    shapes: Vec<Shaped, MOST>,
}

impl Surfaces {
    /// No shapes.
    #[must_use]
    pub const fn new() -> Self {
        Self { shapes: Vec::new() }
    }

    /// The surface on which an instance lies. `frame` is the one that was tracked last; the surface and the lens of
    /// `known` are in px of it. `None` when the instance is lost, and otherwise as [`Detector::surface`] says. Call it
    /// for every frame: it starts from the shape in the frame before. The part of the frame that shows the instance
    /// becomes the frame of the detector.
    ///
    /// # Errors
    /// [`FrameError::TooLarge`] when the frame exceeds the profile of the detector.
    pub fn surface<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        frame: &Frame<'_>,
        model: &Model<'_>,
        track: &Track,
        known: Known<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Option<Surface>, FrameError> {
        let object = usize::from(track.detection.object);
        if track.state == State::Lost || object >= model.objects() || !known.wants_surface(&track.detection) {
            return Ok(None);
        }
        let mut shaped = self.take(track.id);
        let waits = shaped.shape.is_none() && shaped.wait > 0;
        shaped.wait = shaped.wait.saturating_sub(1);
        let mut surface = None;
        if !waits || known.lens.is_some() {
            let part = part_of(core::slice::from_ref(track), frame, model);
            detector.load_luma(frame, part, observer)?;
            let to_frame = part.to_frame();
            let corner = to_frame.apply([0.0; 2]);
            let within = track.detection.mapped(&Homography::affine([1.0, 0.0, -corner[0], 0.0, 1.0, -corner[1]]));
            let lens = known.lens.map(|lens| lens.within(&to_frame));
            // While a track waits, its plane alone is laid under the lens.
            let here = Known { lens: lens.as_ref(), is_flat: known.is_flat || waits };
            let eye = Eye::of_frame([frame.width(), frame.height()], corner);
            let mut laps = Laps::new(observer);
            let how = (here, shaped.shape.as_ref(), &eye);
            let fitted = fit(&detector.frame(), &model.object(object), &within, how, &mut laps);
            // What was stopped says nothing of the shape.
            if !laps.stopped && !waits {
                let bent = fitted.as_ref().filter(|s| s.is_bent);
                shaped = Shaped { shape: bent.map(Surface::shape), wait: RETRY, ..shaped };
            }
            surface = fitted.map(|s| s.mapped(&to_frame));
        }
        // `take` has made room.
        let _ = self.shapes.push(shaped);
        Ok(surface)
    }

    /// Takes out what is known of a track, and leaves room for one.
    fn take(&mut self, id: u32) -> Shaped {
        if let Some(i) = self.shapes.iter().position(|k| k.id == id) {
            return self.shapes.remove(i);
        }
        if self.shapes.is_full() {
            self.shapes.remove(0);
        }
        Shaped { id, shape: None, wait: 0 }
    }
}
