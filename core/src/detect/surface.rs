//! Fits a bent surface to an object that a plane does not explain: a label on a can, the page of a book.
//!
//! In: the frame's pyramid, the object's template and a detection. Out: a [`Surface`], a grid of places of
//! the picture in the frame; or none when a plane explains the frame as well.
//!
//! The surface is paper that bends along one direction ([`Bend`]): eight numbers beside the eight of the
//! homography. So few that a part with little texture follows from the others. They are fitted as those of a
//! plane are: Gauss-Newton on gradients, light normalised block by block, each block weighted by its
//! correlation, from coarse to fine. The steps of the template are compared with the frame's errors cell by
//! cell, and what is unknown moves the middle of a cell (S. Baker, I. Matthews, *Lucas-Kanade 20 Years
//! On*, IJCV 2004). The coarsest level starts from eight shapes: four directions, bent to the camera and away
//! from it.
//!
//! Memory: about 12 KB of stack. Cost: some 160,000 bilinear samples for a surface; none for an object that a
//! plane explains wholly.

use heapless::Vec;

use crate::base::geometry::Homography;
use crate::base::lens::Lens;
use crate::base::math;
use crate::base::pace::Pace;
use crate::base::sort::sort;
use crate::detect::bend::{Bend, SHAPE, Sheet, normal};
use crate::detect::cells::{ALL, CELLS, Grid, Level, POINTS, SIDE, Scene, area_of, corners};
use crate::detect::detection::Detection;
use crate::detect::pose::solve;
use crate::image::plane::Plane;
use crate::image::pyramid::PyramidView;
use crate::model::parse::Object;

/// Number of unknowns: those of a homography and of a shape.
const UNKNOWNS: usize = 8 + SHAPE;

/// Share of an object that a plane must leave unexplained before a surface is tried.
const LEAST_BENT: f32 = 0.01;
/// A surface is taken when this many times as many cells agree as on a plane, and so many more. Of 1,482 flat
/// objects in rendered and real frames, some of them hidden in part, three gained as much.
const BETTER: [f32; 2] = [1.12, 3.0];

/// Angle at `bend::REACH` from the middle of the picture in the shapes that the fit starts from, radians.
const START_TURN: f32 = 0.7;

/// Steps of the fit on one level: the template's level; cells along the side of a block of one light; maximum
/// number of steps; a step that moves less than this, px of the level, is the last; number of unknowns that
/// change, first those of the plane.
struct Stage {
    level: usize,
    block: usize,
    times: usize,
    still: f32,
    unknowns: usize,
}
/// A stage that moves the plane and bends it.
const fn bends([level, block, times]: [usize; 3], still: f32) -> Stage {
    Stage { level, block, times, still, unknowns: UNKNOWNS }
}
/// For a plane that is seen through a lens: the plane alone.
const PLANE: [Stage; 3] = [
    Stage { level: 2, block: 2, times: 5, still: 0.05, unknowns: 8 },
    Stage { level: 1, block: 1, times: 6, still: 0.03, unknowns: 8 },
    Stage { level: 0, block: 1, times: 4, still: 0.03, unknowns: 8 },
];
/// For each of the starts.
const FIRST: Stage = bends([2, 2, 3], 0.05);
/// For the best [`KEPT`] of them.
const SECOND: [Stage; 2] = [bends([2, 2, 4], 0.05), bends([1, 1, 2], 0.05)];
const KEPT: usize = 2;
/// For the best of those.
const THIRD: [Stage; 2] = [bends([1, 1, 6], 0.03), bends([0, 1, 6], 0.03)];
/// Number of starts.
const STARTS: u8 = 8;

/// Where the picture of an object lies in a frame, on a surface that need not be flat.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Surface {
    /// Places in the frame of a grid of [`SIDE`] x [`SIDE`] points of the picture, px: row by row from its
    /// top left corner to its bottom right corner.
    pub points: [[f32; 2]; POINTS],
    /// Whether the surface is bent. If not, it is a plane, seen through a lens.
    pub is_bent: bool,
    /// The plane: from picture px to px of the ideal frame, whose straight lines are straight. Without a lens that
    /// is the frame itself. Of a bent surface it is the plane of its mean direction through the middle of the picture.
    pub homography: Homography,
    shape: Shape,
}

/// How a picture is bent, for the fit in the next frame: the bend, and the map of its plane into that of the
/// detection.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Shape {
    bend: Bend,
    to_plane: Homography,
}

impl Shape {
    const FLAT: Self = Self { bend: Bend::FLAT, to_plane: Homography::IDENTITY };
}

impl Surface {
    /// The plane of a picture of `width` x `height` px under `homography`, from picture px to frame px.
    #[must_use]
    pub fn plane(homography: &Homography, [width, height]: [f32; 2]) -> Self {
        let at = |i: usize| i as f32 / CELLS as f32;
        let points = core::array::from_fn(|i| homography.apply([at(i % SIDE) * width, at(i / SIDE) * height]));
        Self { points, is_bent: false, homography: *homography, shape: Shape::FLAT }
    }

    /// The surface in px of a frame, where it is in px of a part of it.
    #[must_use]
    pub fn mapped(&self, to_frame: &Homography) -> Self {
        let homography = to_frame.after(&self.homography).normalised();
        Self { points: self.points.map(|p| to_frame.apply(p)), homography, ..*self }
    }

    pub(crate) const fn shape(&self) -> Shape {
        self.shape
    }

    /// Direction along which the picture bends, radians from its x axis; and the turn from its middle to
    /// `bend::REACH` if the curvature were the same everywhere, radians.
    pub(crate) const fn direction_and_turn(&self) -> [f32; 2] {
        [self.shape.bend.0[0], self.shape.bend.0[4]]
    }

    /// Returns the surface with another direction and turn.
    #[cfg(test)]
    pub(crate) fn with_turn(mut self, direction: f32, turn: f32) -> Self {
        self.shape.bend = Bend::new(direction, [0.0; 3], turn);
        self
    }

    /// The grid points on the border, from the picture's top left corner clockwise.
    pub fn border(&self) -> impl Iterator<Item = [f32; 2]> + '_ {
        let at = |i: usize| match (i / CELLS, i % CELLS) {
            (0, k) => k,
            (1, k) => k * SIDE + CELLS,
            (2, k) => POINTS - 1 - k,
            (_, k) => (CELLS - k) * SIDE,
        };
        (0..4 * CELLS).map(move |i| self.points[at(i)])
    }

    /// The place in the frame of a place of the picture, whose sides are 1.
    #[must_use]
    pub fn at(&self, place: [f32; 2]) -> [f32; 2] {
        let [x, y] = place.map(|v| v * CELLS as f32);
        let [i, j] = [x, y].map(|v| usize::try_from(math::floor(v)).unwrap_or(0).min(CELLS - 1));
        let (a, b) = (x - i as f32, y - j as f32);
        let [p, q, r, s] = corners(j * CELLS + i).map(|n| self.points[n]);
        [0, 1].map(|k| (p[k] * (1.0 - a) + q[k] * a) * (1.0 - b) + (r[k] * (1.0 - a) + s[k] * a) * b)
    }
}

/// A surface on its way to the right one: the map of the plane into the frame, and the shape.
#[derive(Clone, Copy)]
struct Fit<'a> {
    h: Homography,
    bend: Bend,
    /// Sides of the picture; the longer one is 1.
    size: [f32; 2],
    /// The lens through which the plane of `h` is seen.
    lens: Option<&'a Lens>,
}

/// Step of a number of the shape for its derivative.
const STEP: f32 = 0.01;
/// What is added to the diagonal of the equations: a share of itself, and of the mean of the homography's. It
/// holds the numbers that the frame says little about.
const OF_PLANE: [f32; 2] = [0.01, 1e-5];
const OF_SHAPE: [f32; 2] = [0.05, 1e-3];
/// Maximum change of a number of the shape in a step.
const LONGEST: f32 = 0.5;

impl Fit<'_> {
    /// A place of the flat picture: `x` and `y` from its top left corner, in cells.
    fn flat(&self, x: f32, y: f32) -> [f32; 2] {
        [(x / CELLS as f32 - 0.5) * self.size[0], (y / CELLS as f32 - 0.5) * self.size[1]]
    }

    /// The grid in the plane.
    fn plane(&self, sheet: &Sheet) -> Grid {
        core::array::from_fn(|i| sheet.at(self.flat((i % SIDE) as f32, (i / SIDE) as f32)))
    }

    /// The grid in the frame.
    fn grid(&self) -> Grid {
        self.plane(&self.bend.sheet()).map(|p| {
            let p = self.h.apply(p);
            self.lens.map_or(p, |lens| lens.distort(p))
        })
    }

    /// The grid in the frame. `None` when a point has no place or a cell is turned over.
    fn sound_grid(&self) -> Option<Grid> {
        let grid = self.grid();
        let side = area_of(ALL / 2 + CELLS / 2, &grid);
        let is_finite = grid.as_flattened().iter().all(|v| v.is_finite());
        (is_finite && (0..ALL).all(|cell| area_of(cell, &grid) * side > 0.0)).then_some(grid)
    }

    /// Takes the steps of a stage. Returns the number of cells that agree; `None` when they lead nowhere.
    fn improve(
        &mut self,
        scene: &mut Scene,
        (view, object): (&PyramidView<'_>, &Object<'_>),
        stage: &Stage,
        pace: &mut dyn Pace,
    ) -> Option<f32> {
        let level = Level::new(object, stage.level, stage.block);
        scene.look(view, &level, &self.grid(), true, pace);
        for _ in 0..stage.times {
            scene.look(view, &level, &self.grid(), false, pace);
            if self.step(&scene.errors, &level, stage.unknowns)? < stage.still {
                break;
            }
        }
        let agreeing = scene.look(view, &level, &self.grid(), true, pace);
        pace.goes_on().then_some(agreeing)
    }

    /// Takes the steps of several stages.
    fn improve_by(
        &mut self,
        scene: &mut Scene,
        what: (&PyramidView<'_>, &Object<'_>),
        stages: &[Stage],
        pace: &mut dyn Pace,
    ) -> Option<f32> {
        stages.iter().try_fold(0.0, |_, stage| self.improve(scene, what, stage, pace))
    }

    /// Takes one Gauss-Newton step of the first `unknowns`. Returns about how far it moves, px of the level.
    #[inline(never)]
    fn step(&mut self, errors: &[[f32; 5]; ALL], level: &Level<'_>, unknowns: usize) -> Option<f32> {
        let mut equations = [[0.0; UNKNOWNS + 1]; UNKNOWNS];
        let sheet = self.bend.sheet();
        // A plane alone needs no others.
        let mut others = [const { Sheet::FLAT }; SHAPE];
        for (k, other) in others.iter_mut().enumerate().take(unknowns - 8) {
            let mut bend = self.bend;
            bend.0[k] += STEP;
            other.set(&bend);
        }
        // From differences over two px of the level to those over a cell.
        let per_cell = level.scale.map(|[scale, _]| 0.5 / scale);
        for (cell, errors) in errors.iter().enumerate() {
            if let Some(moves) = self.moves(cell, &sheet, &others) {
                add_equations(&mut equations, &moves[..unknowns], errors, per_cell);
            }
        }
        let mean = (0..8).map(|i| equations[i][i]).sum::<f32>() / 8.0;
        for (i, row) in equations.iter_mut().enumerate() {
            let [own, of_mean] = if i < 8 { OF_PLANE } else { OF_SHAPE };
            row[i] += own * row[i] + of_mean * mean;
        }
        let d = solve(&mut equations, unknowns)?;
        let step = Homography([1.0 + d[0], d[1], d[2], d[3], 1.0 + d[4], d[5], d[6], d[7], 1.0]);
        self.h = self.h.after(&step).normalised();
        for (v, d) in self.bend.0.iter_mut().zip(&d[8..]) {
            *v += d.clamp(-LONGEST, LONGEST);
        }
        let is_finite = self.h.0.iter().chain(&self.bend.0).all(|v| v.is_finite());
        let longest = d.iter().fold(0.0, |longest, v| math::max(longest, v.abs()));
        is_finite.then_some(longest * CELLS as f32 / level.scale[0][0])
    }

    /// How each unknown moves the middle of a cell, in cells; `others` are the sheets with one number of the shape
    /// more by [`STEP`]. `None` for a cell that is seen from its edge.
    fn moves(&self, cell: usize, sheet: &Sheet, others: &[Sheet; SHAPE]) -> Option<[[f32; 2]; UNKNOWNS]> {
        let (i, j) = ((cell % CELLS) as f32, (cell / CELLS) as f32);
        // A cell's sides in the plane, and the map from the plane into cells.
        let side = |a: [f32; 2], b: [f32; 2]| {
            let (a, b) = (sheet.at(self.flat(a[0], a[1])), sheet.at(self.flat(b[0], b[1])));
            [b[0] - a[0], b[1] - a[1]]
        };
        let x = side([i, j + 0.5], [i + 1.0, j + 0.5]);
        let y = side([i + 0.5, j], [i + 0.5, j + 1.0]);
        let det = x[0] * y[1] - x[1] * y[0];
        if det.abs() < 1e-6 {
            return None;
        }
        let into = |[u, v]: [f32; 2]| [(u * y[1] - v * y[0]) / det, (v * x[0] - u * x[1]) / det];
        let middle = self.flat(i + 0.5, j + 0.5);
        let [u, v] = sheet.at(middle);
        let of_plane =
            [[u, 0.0], [v, 0.0], [1.0, 0.0], [0.0, u], [0.0, v], [0.0, 1.0], [-u * u, -u * v], [-u * v, -v * v]];
        let of_shape = others.iter().map(|other| {
            let [p, q] = other.at(middle);
            [(p - u) / STEP, (q - v) / STEP]
        });
        let mut moves = [[0.0; 2]; UNKNOWNS];
        for (to, from) in moves.iter_mut().zip(of_plane.into_iter().chain(of_shape)) {
            *to = into(from);
        }
        Some(moves)
    }
}

/// Adds the errors of a cell to the upper triangle of the normal equations, and to their right side.
fn add_equations(
    equations: &mut [[f32; UNKNOWNS + 1]; UNKNOWNS],
    moves: &[[f32; 2]],
    &[xx, xy, yy, xe, ye]: &[f32; 5],
    [kx, ky]: [f32; 2],
) {
    let [xx, xy, yy, xe, ye] = [xx * kx * kx, xy * kx * ky, yy * ky * ky, xe * kx, ye * ky];
    for (i, p) in moves.iter().enumerate() {
        let by = [xx * p[0] + xy * p[1], xy * p[0] + yy * p[1]];
        for (j, q) in moves.iter().enumerate().skip(i) {
            equations[i][j] += by[0] * q[0] + by[1] * q[1];
        }
        equations[i][UNKNOWNS] -= p[0] * xe + p[1] * ye;
    }
}

/// What is known before a surface is fitted.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known<'a> {
    /// The camera and its lens, px of the frame.
    pub lens: Option<&'a Lens>,
    /// Whether the object is flat.
    pub is_flat: bool,
}

impl Known<'_> {
    /// Whether a surface is looked for: a plane leaves some of the object unexplained, or is seen through a lens.
    #[must_use]
    pub fn wants_surface(&self, d: &Detection) -> bool {
        self.lens.is_some() || !self.is_flat && d.appearance.visible < 1.0 - LEAST_BENT
    }
}

/// The camera that is guessed where none is known: the middle of its frame and its focal length, px.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    centre: [f32; 2],
    focal: f32,
}

impl Eye {
    /// The eye of frames of `width` x `height` px, in px of the part of one that begins at `corner`.
    pub(crate) fn of_frame([width, height]: [usize; 2], corner: [f32; 2]) -> Self {
        let size = [width as f32, height as f32];
        Self { centre: [0, 1].map(|i| size[i] / 2.0 - corner[i]), focal: math::max(size[0], size[1]) }
    }

    fn through(lens: &Lens) -> Self {
        let [fx, _, cx, cy] = lens.intrinsics();
        Self { centre: [cx, cy], focal: fx }
    }
}

/// Fits a surface to a detection in the frame of `view`, from the shape `start` if it is given. Without a lens it is
/// `None` when a plane explains what is seen as well. With one it is `None` when nothing is seen through the lens
/// where the object is. It is `None`, too, when `pace` says to stop.
pub(crate) fn fit(
    view: &PyramidView<'_>,
    object: &Object<'_>,
    d: &Detection,
    (known, start, eye): (Known<'_>, Option<&Shape>, &Eye),
    pace: &mut dyn Pace,
) -> Option<Surface> {
    if view.luma(0).width() == 0 || !known.wants_surface(d) {
        return None;
    }
    let Known { lens, is_flat } = known;
    let [w, h] = [object.width as f32, object.height as f32];
    let side = w.max(h);
    let unit = Homography::affine([side, 0.0, w / 2.0, 0.0, side, h / 2.0]);
    let ideal = match lens {
        None => d.homography,
        Some(lens) => without(lens, &d.homography, [w, h])?,
    };
    let size = [w / side, h / side];
    let mut plane = Fit { h: ideal.after(&unit).normalised(), bend: Bend::FLAT, size, lens };
    let (what, mut scene) = ((view, object), Scene::EMPTY);
    let finest = Level::new(object, 0, 1);
    let flat = match lens {
        None => scene.look(view, &finest, &plane.grid(), true, pace),
        Some(_) => plane.improve_by(&mut scene, what, &PLANE, pace)?,
    };
    let onto = plane.h;
    let [times, more] = BETTER;
    if !is_flat && (lens.is_none() || flat < LEAST_PLAIN * scene.textured) {
        let known = start.map(|shape| Fit { h: onto.after(&shape.to_plane), bend: shape.bend, ..plane });
        // Where the shape of the frame before leads nowhere, the search for one begins anew.
        for anew in [false, true] {
            let fit = if anew { begin((&plane, eye), &mut scene, what, pace) } else { known };
            let Some(mut fit) = fit else { continue };
            let agreeing = fit.improve_by(&mut scene, what, &THIRD, pace);
            if agreeing.is_some_and(|agreeing| agreeing > times * flat + more)
                && let Some(points) = fit.sound_grid()
            {
                let shape = Shape { bend: fit.bend, to_plane: onto.inverse()?.after(&fit.h).normalised() };
                let homography = fit.h.after(&unit.inverse()?).normalised();
                return Some(Surface { points, is_bent: true, homography, shape });
            }
        }
    }
    lens?;
    let homography = plane.h.after(&unit.inverse()?).normalised();
    Some(Surface { points: plane.sound_grid()?, is_bent: false, homography, shape: Shape::FLAT })
}

/// Share of the cells that agree from which on a plane explains what is seen through a lens.
const LEAST_PLAIN: f32 = 0.8;

/// The map to the ideal frame of what `h` maps to the frame of a lens: the middle half of the picture, of `size`
/// px, lies where it lay.
fn without(lens: &Lens, h: &Homography, [w, height]: [f32; 2]) -> Option<Homography> {
    let mut places = [[0.0; 2]; 4];
    for (i, place) in places.iter_mut().enumerate() {
        let at = [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]][i];
        *place = lens.undistort(h.apply([at[0] * w, at[1] * height]))?;
    }
    let middle = Homography::onto(&places, [w / 2.0, height / 2.0]);
    Some(middle.after(&Homography::affine([1.0, 0.0, -w / 4.0, 0.0, 1.0, -height / 4.0])).normalised())
}

/// The best of several shapes on the coarse levels.
fn begin<'a>(
    (plane, eye): (&Fit<'a>, &Eye),
    scene: &mut Scene,
    what: (&PyramidView<'_>, &Object<'_>),
    pace: &mut dyn Pace,
) -> Option<Fit<'a>> {
    // Without a lens the camera is a guess; the fit moves the normal.
    let eye = plane.lens.map_or(*eye, Eye::through);
    let normal = normal(&plane.h, eye.centre, eye.focal)?;
    let mut starts: Vec<(Fit<'_>, f32), { STARTS as usize }> = Vec::new();
    for start in 0..STARTS {
        let angle = f32::from(start / 2) * core::f32::consts::FRAC_PI_4;
        let turn = if start.is_multiple_of(2) { START_TURN } else { -START_TURN };
        let mut fit = Fit { bend: Bend::new(angle, normal, turn), ..*plane };
        if let Some(agreeing) = fit.improve(scene, what, &FIRST, pace) {
            // There is room for all.
            let _ = starts.push((fit, agreeing));
        }
    }
    best_first(&mut starts);
    starts.truncate(KEPT);
    for (fit, agreeing) in &mut starts {
        *agreeing = fit.improve_by(scene, what, &SECOND, pace).unwrap_or(0.0);
    }
    best_first(&mut starts);
    starts.first().map(|(fit, _)| *fit)
}

/// Samples a plane of a frame on a surface, `width` x `height` px, row by row, into `out`.
pub(crate) fn flatten(plane: &Plane<'_, u8>, surface: &Surface, [width, height]: [usize; 2], out: &mut [u8]) {
    let at = |px: usize, side: usize| px as f32 / side as f32;
    for (i, out) in out.iter_mut().enumerate() {
        let [x, y] = surface.at([at(i % width, width), at(i / width, height)]);
        let seen = if plane.width() > 0 { plane.sample_one(x, y) } else { None };
        *out = seen.map_or(u8::MAX, |v| u8::try_from(math::round(v)).unwrap_or(u8::MAX));
    }
}

/// Sorts fits by the number of cells that agree.
fn best_first(fits: &mut [(Fit<'_>, f32)]) {
    sort(fits, |a, b| a.1.total_cmp(&b.1).is_gt());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::pace::Steady;
    use crate::detect::appearance::appearance;
    use crate::detect::appearance::tests::{SIDE as PX, setup_bent, template};
    use crate::image::pyramid::Pyramid;

    const SIZE: [f32; 2] = [PX as f32; 2];
    const EYE: Eye = Eye { centre: [120.0, 90.0], focal: 240.0 };
    /// Radius of a can on which the picture goes a quarter of the way around, px.
    const RADIUS: f32 = PX as f32 / core::f32::consts::FRAC_PI_2;

    /// From a place of the plane to that of the label on a can, whose axis is parallel to y.
    fn unroll([x, y]: [f32; 2]) -> [f32; 2] {
        let middle = SIZE[0] / 2.0;
        let sine = ((x - middle) / RADIUS).clamp(-1.0, 1.0);
        [middle + RADIUS * sine.asin(), y]
    }

    fn object(data: &[u8]) -> Object<'_> {
        let (width, height) = (PX as u32, PX as u32);
        Object { name: "label", width, height, triples: 0, keypoints: 0, template: template(data) }
    }

    fn found(p: &Pyramid<60_000, 15_000>, o: &Object<'_>, h: &Homography) -> Detection {
        let mut d = Detection::new(0, h, SIZE);
        d.appearance = appearance(&p.view(), &o.template, h, SIZE, &mut Steady);
        d
    }

    /// Mean distance of the grid points from where they are, px.
    fn error(surface: &Surface, h: &Homography) -> f32 {
        let middle = SIZE[0] / 2.0;
        let truth = |i: usize| {
            let at = |k: usize| k as f32 / CELLS as f32 * SIZE[0];
            let x = middle + RADIUS * ((at(i % SIDE) - middle) / RADIUS).sin();
            h.apply([x, at(i / SIDE)])
        };
        let off = |(i, p): (usize, &[f32; 2])| (p[0] - truth(i)[0]).hypot(p[1] - truth(i)[1]);
        surface.points.iter().enumerate().map(off).sum::<f32>() / POINTS as f32
    }

    #[test]
    fn a_label_on_a_can_is_fitted_and_flattened() {
        for hide in [false, true] {
            let (p, data, h) = setup_bent(hide, &unroll);
            let o = object(&data);
            // The plane touches the can along the middle of the label.
            let d = found(&p, &o, &h);
            let before = error(&Surface::plane(&d.homography, SIZE), &h);
            let surface = fit(&p.view(), &o, &d, (Known::default(), None, &EYE), &mut Steady).expect("a surface");
            let after = error(&surface, &h);
            assert!(before > 1.5 && after < if hide { 1.5 } else { 0.4 }, "{before} px became {after} px");
            // From where it was, it is fitted again.
            let again = fit(&p.view(), &o, &d, (Known::default(), Some(&surface.shape), &EYE), &mut Steady).unwrap();
            assert!(error(&again, &h) < after + 0.2, "{} px", error(&again, &h));
            if !hide {
                let mut flat = [0; PX * PX];
                flatten(&p.view().luma(0), &surface, [PX; 2], &mut flat);
                let template = o.template.luma(0);
                let off = |i: usize| (f32::from(flat[i]) - 10.0 - 0.6 * f32::from(template.row(i / PX)[i % PX])).abs();
                let worst = (0..PX * PX).map(off).sum::<f32>() / (PX * PX) as f32;
                assert!(worst < 6.0, "gray levels are {worst} off");
            }
        }
    }

    #[test]
    fn a_flat_picture_stays_on_its_plane() {
        for hide in [false, true] {
            let (p, data, h) = setup_bent(hide, &|place| place);
            let o = object(&data);
            let d = found(&p, &o, &h);
            assert_eq!(Known::default().wants_surface(&d), hide, "{:?}", d.appearance);
            assert!(fit(&p.view(), &o, &d, (Known::default(), None, &EYE), &mut Steady).is_none());
        }
    }

    #[test]
    fn the_border_runs_clockwise_and_places_lie_between_grid_points() {
        let surface = Surface::plane(&Homography::affine([2.0, 0.0, 10.0, 0.0, 2.0, 20.0]), [40.0, 80.0]);
        let border: std::vec::Vec<_> = surface.border().collect();
        assert_eq!(border.len(), 4 * CELLS);
        assert_eq!([0, 8, 16, 24].map(|i| border[i]), [[10.0, 20.0], [90.0, 20.0], [90.0, 180.0], [10.0, 180.0]]);
        let [x, y] = surface.at([0.3, 0.7]);
        assert!((x - 34.0).abs() < 1e-3 && (y - 132.0).abs() < 1e-3, "{x}, {y}");
        assert_eq!(surface.at([1.0, 1.0]), [90.0, 180.0]);
    }
}
