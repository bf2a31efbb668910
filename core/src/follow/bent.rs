//! Surfaces of what is followed: fitted anew in every frame, from the shape in the frame before.
//!
//! In: a frame, and a track that is seen in it. Out: its surface, if it lies on one that is bent. A track that
//! a plane explained is tried again after [`RETRY`] frames. Memory: 84 bytes for each track. Cost: that of
//! converting the part of the frame that shows the track, and of `surface`: a third of it where the shape is
//! known.

use heapless::Vec;

use crate::base::capacity::{DETECTIONS, id};
use crate::base::geometry::Homography;
use crate::detect::buffers::Profile;
use crate::detect::detector::Detector;
use crate::detect::observer::{Laps, Observer};
use crate::detect::surface::{Shape, Surface, fit, may_be_bent};
use crate::follow::instance::{State, Track};
use crate::follow::sight::part_of;
use crate::image::frame::{Frame, FrameError};
use crate::model::parse::Model;

/// Number of frames until a surface is looked for again.
const RETRY: u8 = 8;

/// What is known of a track.
#[derive(Clone, Copy, Debug)]
struct Known {
    id: u32,
    /// The shape in the last frame; `None` when a plane explained what was seen.
    shape: Option<Shape>,
    /// Number of frames until a surface is looked for again.
    wait: u8,
}

/// The shapes of all tracks.
#[derive(Debug)]
pub(super) struct Surfaces(Vec<Known, DETECTIONS>);

impl Surfaces {
    pub(super) const NEW: Self = Self(Vec::new());

    /// The surface of a track that is seen in `frame`. The part of the frame that shows it becomes the
    /// frame of the detector.
    pub(super) fn of<P: Profile + ?Sized>(
        &mut self,
        detector: &mut Detector<P>,
        (frame, model): (&Frame<'_>, &Model<'_>),
        tracks: &[Track],
        track: &Track,
        observer: &mut dyn Observer,
    ) -> Result<Option<Surface>, FrameError> {
        let object = usize::from(track.detection.object);
        if track.state == State::Lost || object >= model.objects() || !may_be_bent(&track.detection) {
            return Ok(None);
        }
        self.0.retain(|k| tracks.iter().any(|t| t.id == k.id));
        let place = self.0.iter().position(|k| k.id == track.id);
        let mut known = place.map_or(Known { id: track.id, shape: None, wait: 0 }, |i| self.0[i]);
        if known.shape.is_none() && known.wait > 0 {
            known.wait -= 1;
        } else {
            let part = part_of(core::slice::from_ref(track), frame, model);
            detector.load_luma(frame, part, observer)?;
            let [x, y] = [part.x, part.y].map(|start| f32::from(id(start)));
            let within = track.detection.mapped(&Homography::affine([1.0, 0.0, -x, 0.0, 1.0, -y]));
            let start = known.shape.as_ref();
            let surface =
                fit(&detector.frame(), &model.object(object), &within, start, &mut Laps::new(observer)).map(|s| {
                    let to_frame = Homography::affine([1.0, 0.0, x, 0.0, 1.0, y]);
                    s.mapped(&to_frame)
                });
            known = Known { shape: surface.as_ref().map(Surface::shape), wait: RETRY, ..known };
            self.keep(place, known);
            return Ok(surface);
        }
        self.keep(place, known);
        Ok(None)
    }

    fn keep(&mut self, place: Option<usize>, known: Known) {
        match place {
            Some(i) => self.0[i] = known,
            // There is room for every track.
            None => drop(self.0.push(known)),
        }
    }
}
