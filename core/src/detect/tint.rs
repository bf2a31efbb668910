//! Lays the chroma of a template over the frame.
//!
//! In: the frame's pyramid, a template and a pose. Out: for a pixel of the template's chroma, the chroma of the template
//! and that of the frame at its place.
//!
//! Memory: 120 bytes. Cost: a division a pixel.

use crate::base::capacity::LEVELS;
use crate::base::geometry::Homography;
use crate::base::math;
use crate::detect::overlay::number;
use crate::image::pixels::NO_CHROMA;
use crate::image::plane::{Plane, nearest};
use crate::image::pyramid::{PyramidView, into_level};
use crate::model::parse::Template;

/// Chroma of a template, and the level of the frame that it is laid over.
pub(crate) struct Tint<'a> {
    source: [Plane<'a, u8>; 2],
    planes: [Plane<'a, i8>; 2],
    /// Map from px of the template's chroma to px of the frame's.
    map: Homography,
}

impl<'a> Tint<'a> {
    /// Lays a template over level `level` of the frame, under the map `h` from px of its luma to px of the frame.
    #[inline(never)]
    pub(crate) fn new(view: &PyramidView<'a>, template: &Template<'a>, h: &Homography, level: usize) -> Self {
        // Chroma px are twice as large in template and frame, so the same level fits.
        let map = into_level(level + 1).after(&h.after(&Homography::affine([2.0, 0.0, 0.5, 0.0, 2.0, 0.5])));
        Self { source: template.chroma(0), planes: view.chroma(level.min(LEVELS - 1)), map }
    }

    /// Chroma of the template at pixel `(x, y)` of its chroma, which must lie inside, and of the frame there: each is
    /// [`NO_CHROMA`] where there is none, the frame's also outside the frame.
    #[inline(never)]
    pub(crate) fn at(&self, [x, y]: [usize; 2]) -> [[i8; 2]; 2] {
        let [u, v] = self.map.apply([number(x), number(y)]);
        let inside = u >= 0.0 && v >= 0.0 && u < number(self.planes[0].width()) && v < number(self.planes[0].height());
        let f = if inside { nearest(self.planes, math::whole(u), math::whole(v)) } else { [NO_CHROMA; 2] };
        [self.source.map(|c| c.row(y)[x].cast_signed()), f]
    }
}
