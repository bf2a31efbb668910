//! Pairs the triangle of a match in the model with that in the frame.
//!
//! In: a scene, a model and a match. Out: both triangles, the weight of the match's vote, and the vote.
//!
//! Memory: none. Cost: that of `verify` for a weight, and of `vote` for a vote.

use crate::base::geometry::Point;
use crate::base::math;
use crate::detect::classify::Match;
use crate::detect::scene::{Scene, vertices};
use crate::detect::verify::likeness;
use crate::detect::vote::{Vote, cast};
use crate::extract::feature::FeatureKind;
use crate::model::parse::{Model, Object, View};

/// A match with the triangles that it pairs.
pub(crate) struct Pairing<'a> {
    /// Index of the keygraph of the frame, and the match.
    matched: (u16, Match),
    object: Object<'a>,
    view: View,
    /// The vertices in the view, and in level 0 of the frame, px.
    triangles: [[[f32; 2]; 3]; 2],
}

impl<'a> Pairing<'a> {
    /// The pairing of keygraph `i` of the frame by the match `m`.
    #[inline(never)]
    pub(crate) fn new(scene: &Scene<'_>, model: &Model<'a>, i: u16, m: Match) -> Self {
        let to = vertices(scene.points, &scene.keygraphs[usize::from(i)]).map(|(_, p)| p);
        let (v, from) = model.keygraph(m.keygraph as usize);
        let view = model.view(v);
        let object = model.object(usize::from(view.object));
        Self { matched: (i, m), object, view, triangles: [from.map(Point::px), to] }
    }

    /// Weight of the vote, 1 to 16; `None` when the surroundings of the triangles are not alike enough.
    #[inline(never)]
    pub(crate) fn weight(&self, scene: &Scene<'_>, model: &Model<'_>) -> Option<u8> {
        let Some(least) = model.method().parameters().verify else { return Some(1) };
        let Self { object: o, view, triangles: [from, to], .. } = self;
        let to_template = o.template.from_picture(o.width as f32, o.height as f32).after(&view.to_picture);
        let from = from.map(|p| to_template.apply_affine(p));
        let l = likeness(&scene.pyramid, &o.template, &from, to, model.feature() == FeatureKind::Luma);
        (l >= least).then(|| u8::try_from(math::round(1.0 + 15.0 * (l - least) / (2.0 - least))).unwrap_or(1))
    }

    /// The vote, with this weight; `None` for degenerate triangles.
    #[inline(never)]
    pub(crate) fn vote(&self, weight: u8) -> Option<Vote> {
        let (i, m) = self.matched;
        cast(&self.object, &self.view, m, i, self.triangles, weight)
    }

    /// The vertices in level 0 of the frame, px.
    pub(crate) const fn in_frame(&self) -> [[f32; 2]; 3] {
        self.triangles[1]
    }
}
