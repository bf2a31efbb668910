//! One instance of an object in a frame.
//!
//! In: an object and a homography. Out: the outline of the object, and whether two outlines stand
//! for one instance. Memory: none. Cost: 72 points for each pair of outlines.

use heapless::Vec;

use crate::base::capacity::DETECTIONS;
use crate::base::geometry::{Homography, area, contains};
use crate::detect::appearance::{Appearance, is_plausible};
use crate::model::parse::Model;

/// Minimum area of an outline, square px.
const MIN_AREA_PX: f32 = 144.0;
/// Maximum ratio between a side of an outline and the opposite side.
const MAX_RATIO: f32 = 4.0;
/// Maximum ratio between the areas of two outlines that compete for a place.
const MAX_RIVAL: f32 = 4.0;

/// One instance of an object in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Detection {
    /// Index of the object in the model.
    pub object: u16,
    /// Map from picture px to frame px; its last element is 1.
    pub homography: Homography,
    /// Corners of the picture, `(0,0) (w,0) (w,h) (0,h)`, in the frame, px.
    pub corners: [[f32; 2]; 4],
    /// Estimated probability that the detection is right, 0 to 1.
    pub score: f32,
    /// Number of keygraphs of which all three vertices agree with the pose.
    pub votes: u16,
    /// Number of distinct frame corners that agree with the pose.
    pub agreeing: u16,
    /// Appearance of the frame at the detection.
    pub appearance: Appearance,
}

/// Detections in a frame, best score first.
pub(crate) type Detections = Vec<Detection, DETECTIONS>;

/// Whether a place lies in the outline of a detection, frame px.
#[inline(never)]
pub(crate) fn is_inside(detections: &[Detection], at: [f32; 2]) -> bool {
    detections.iter().any(|d| contains(&d.corners, at))
}

impl Detection {
    /// Creates a detection without evidence: score, votes and appearance are zero. `width` and
    /// `height` are the size of the object's picture, px. Programs that use detections can make
    /// tests with it.
    #[must_use]
    pub fn new(object: u16, homography: &Homography, [width, height]: [f32; 2]) -> Self {
        Self {
            object,
            homography: *homography,
            corners: homography.outline(width, height),
            score: 0.0,
            votes: 0,
            agreeing: 0,
            appearance: Appearance::default(),
        }
    }

    /// Returns the detection in px of a frame, where it is in px of a part of it. `to_frame` maps from
    /// the part to the frame: [`Window::to_frame`](crate::Window::to_frame) for a window, and
    /// [`Homography::scaling`] for a frame that was scaled.
    #[must_use]
    pub fn mapped(&self, to_frame: &Homography) -> Self {
        let homography = to_frame.after(&self.homography).normalised();
        Self { homography, corners: self.corners.map(|p| to_frame.apply(p)), ..*self }
    }

    /// Creates a detection of an object of `model` without evidence.
    #[inline(never)]
    pub(crate) fn at(model: &Model<'_>, object: u16, homography: &Homography) -> Self {
        let o = model.object(usize::from(object));
        Self::new(object, homography, [o.width as f32, o.height as f32])
    }

    /// Whether the outline can be that of a picture in front of a camera.
    pub(crate) fn is_plausible(&self) -> bool {
        is_plausible(&self.corners, MIN_AREA_PX, MAX_RATIO)
    }

    /// Whether the detection and `other` say of one place that different objects are there. An
    /// object that lies on another and is much smaller is no rival of it. Both are in px of a frame that is not mirrored.
    #[inline(never)]
    #[must_use]
    pub fn is_rival(&self, other: &Self) -> bool {
        let (a, b) = (area(&self.corners), area(&other.corners));
        let alike = a < MAX_RIVAL * b && b < MAX_RIVAL * a;
        alike && self.object != other.object && overlap(&self.corners, &other.corners)
    }

    /// Whether the detection names a place better than `other`, a rival, does: by the parts in which their objects
    /// differ.
    #[inline(never)]
    #[must_use]
    pub fn beats(&self, other: &Self) -> bool {
        let (fit, others) = (self.fit(), other.fit());
        (fit > others || (fit == others && self.object < other.object)) && self.is_rival(other)
    }

    /// How much of the object agrees with the frame, 0 to 1, and how well. It does not saturate: of
    /// two pictures that share parts, it tells which the other parts are of.
    #[must_use]
    pub fn fit(&self) -> f32 {
        self.appearance.support / f32::from(self.appearance.blocks.max(1))
    }

    /// Whether the detection and `other` stand for the same instance. Both are in px of a frame that is not mirrored.
    #[inline(never)]
    #[must_use]
    pub fn is_twin(&self, other: &Self) -> bool {
        self.object == other.object && overlap(&self.corners, &other.corners)
    }
}

/// Whether two outlines of one object stand for one instance: at least a quarter of one outline
/// lies inside the other. Two planar objects cannot be at one place. A pattern that repeats itself
/// gives shifted copies of the outline, and these overlap.
pub(crate) fn overlap(a: &[[f32; 2]; 4], b: &[[f32; 2]; 4]) -> bool {
    const SIDE: u8 = 6;
    let share = |inner: &[[f32; 2]; 4], outer: &[[f32; 2]; 4]| {
        let mix = |p: [f32; 2], q: [f32; 2], t: f32| [p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t];
        let at = |i: u8| (f32::from(i) + 0.5) / f32::from(SIDE);
        let point = |x: u8, y: u8| mix(mix(inner[0], inner[1], at(x)), mix(inner[3], inner[2], at(x)), at(y));
        let inside = |i: &u8| contains(outer, point(i % SIDE, i / SIDE));
        (0..SIDE * SIDE).filter(inside).count()
    };
    4 * share(a, b).max(share(b, a)) >= usize::from(SIDE * SIDE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_of_one_instance_overlap() {
        let at = |x: f32| [[x, 0.0], [x + 10.0, 0.0], [x + 10.0, 10.0], [x, 10.0]];
        assert!(overlap(&at(0.0), &at(6.5)), "a third");
        assert!(!overlap(&at(0.0), &at(8.5)), "a sixth");
        let small = [[2.0, 2.0], [4.0, 2.0], [4.0, 4.0], [2.0, 4.0]];
        assert!(overlap(&at(0.0), &small) && overlap(&small, &at(0.0)));
    }
}
