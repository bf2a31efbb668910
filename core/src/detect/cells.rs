//! Lays the cells of a template over a grid of places in the frame.
//!
//! In: a level of a template, and where a grid of its points lies in the frame. Out: for each of 8 x 8 cells the
//! error sums of an alignment step, how it is lit, and how many cells agree. Between the points of the grid places are
//! bilinear, so the grid may be that of a surface of any shape. Planes are laid over the frame by `overlay`, which is
//! faster.
//!
//! Memory: 4 KB for the cells. Cost: one bilinear sample for each pixel of the level.

use crate::base::geometry::area;
use crate::base::math;
use crate::base::pace::Pace;
use crate::detect::appearance::level_of_area;
use crate::detect::light::{LEAST_WEIGHT, Moments, Shade, agreement};
use crate::image::plane::Plane;
use crate::image::pyramid::{PyramidView, into_level};
use crate::model::parse::Object;

/// Number of cells in each direction.
pub(crate) const CELLS: usize = 8;
/// Number of cells.
pub(crate) const ALL: usize = CELLS * CELLS;
/// Number of columns of grid points, and of rows.
pub const SIDE: usize = CELLS + 1;
/// Number of grid points.
pub const POINTS: usize = SIDE * SIDE;

/// Places of the grid points, row by row.
pub(crate) type Grid = [[f32; 2]; POINTS];

/// Grid points at the corners of a cell: above, then below, left before right.
pub(crate) fn corners(cell: usize) -> [usize; 4] {
    let first = cell / CELLS * SIDE + cell % CELLS;
    [first, first + 1, first + SIDE, first + SIDE + 1]
}

/// Signed area of a cell, square px of the grid.
pub(crate) fn area_of(cell: usize, grid: &Grid) -> f32 {
    let [a, b, c, d] = corners(cell).map(|n| grid[n]);
    area(&[a, b, d, c])
}

/// A level of the template, divided into cells.
pub(crate) struct Level<'a> {
    luma: Plane<'a, u8>,
    /// First column and row of each cell, and the end of the last.
    starts: [[usize; SIDE]; 2],
    /// From px of the level to cells, along each axis: factor and offset.
    pub(crate) scale: [[f32; 2]; 2],
    /// Number of cells along the side of a block of one light.
    block: usize,
}

impl<'a> Level<'a> {
    pub(crate) fn new(o: &Object<'a>, level: usize, block: usize) -> Self {
        let luma = o.template.luma(level);
        let step = f32::from(1u8 << level);
        // `picture`, `whole` and `side` are the lengths of the picture, of the template and of its level, px.
        let axis = |picture: u32, whole: usize, side: usize| {
            let scale = step * CELLS as f32 / whole as f32;
            let offset = scale / 2.0 - CELLS as f32 / 2.0 / picture as f32;
            let start = |c: usize| {
                let before = math::floor((offset - c as f32) / scale);
                usize::try_from(-before).unwrap_or(0).min(side)
            };
            ([scale, offset], core::array::from_fn(start))
        };
        let (across, columns) = axis(o.width, o.template.width, luma.width());
        let (down, rows) = axis(o.height, o.template.height, luma.height());
        Self { luma, starts: [columns, rows], scale: [across, down], block }
    }

    /// The first cell of the block that a cell belongs to.
    fn block_of(&self, cell: usize) -> usize {
        let [x, y] = [cell % CELLS, cell / CELLS].map(|v| v / self.block * self.block);
        y * CELLS + x
    }
}

/// What a look at a level tells of each cell.
pub(crate) struct Scene {
    /// Weighted sums of the products of the template's steps, `x x`, `x y`, `y y`, and of each step and the
    /// error: what the frame shows minus what the template says.
    pub(crate) errors: [[f32; 5]; ALL],
    /// As [`Moments::new`] wants them; for a block, at its first cell.
    pairs: [[f32; 6]; ALL],
    /// How the cells are lit; for a block, at its first cell.
    pub(crate) light: [Shade; ALL],
    /// Number of cells that have texture, and lie in the frame.
    pub(crate) textured: f32,
}

const NO_SHADE: Shade = Shade { scale_t: 0.0, scale_f: 0.0, offset: 0.0, weight: 0.0, flat: 0.0 };

impl Scene {
    /// Before a level has been looked at.
    pub(crate) const EMPTY: Self =
        Self { errors: [[0.0; 5]; ALL], pairs: [[0.0; 6]; ALL], light: [NO_SHADE; ALL], textured: 0.0 };

    /// Lays a level over the frame: its cells over those of `grid`, frame px. Sums the errors in the light of
    /// the look before, or none with `anew`. Then renews the light, and returns the number of cells that
    /// agree.
    #[inline(never)]
    pub(crate) fn look(
        &mut self,
        view: &PyramidView<'_>,
        level: &Level<'_>,
        grid: &Grid,
        anew: bool,
        pace: &mut dyn Pace,
    ) -> f32 {
        self.errors.as_flattened_mut().fill(0.0);
        self.pairs.as_flattened_mut().fill(0.0);
        for cell in 0..ALL {
            pace.goes_on();
            let px2 = area_of(cell, grid).abs();
            if px2.is_finite() {
                let source = level_of_area(px2 * level.scale[0][0] * level.scale[1][0]);
                let into = into_level(source);
                let at = corners(cell).map(|n| into.apply_affine(grid[n]));
                let first = level.block_of(cell);
                let shade = if anew { &NO_SHADE } else { &self.light[first] };
                let pairs = &mut self.pairs[first];
                add_cell(&view.luma(source), level, cell, &at, shade, &mut self.errors[cell], pairs);
            }
        }
        let (mut agreeing, mut textured) = (0.0, 0.0);
        for (shade, &pairs) in self.light.iter_mut().zip(&self.pairs) {
            let m = Moments::new(pairs);
            if m.is_textured() {
                agreeing += agreement(m.correlation());
                textured += 1.0;
            }
            *shade = Shade::new(&m);
        }
        let cells = (level.block * level.block) as f32;
        self.textured = textured * cells;
        agreeing * cells
    }
}

/// Adds the pixels of a cell whose corners lie at `at`, px of `plane`.
fn add_cell(
    plane: &Plane<'_, u8>,
    level: &Level<'_>,
    cell: usize,
    &[a, b, c, d]: &[[f32; 2]; 4],
    shade: &Shade,
    errors: &mut [f32; 5],
    pairs: &mut [f32; 6],
) {
    let ([columns, rows], [i, j]) = (&level.starts, [cell % CELLS, cell / CELLS]);
    let part = |px: usize, [scale, offset]: [f32; 2], cell: usize| px as f32 * scale + offset - cell as f32;
    let mix = |p: [f32; 2], q: [f32; 2], t: f32| [0, 1].map(|k| p[k] + (q[k] - p[k]) * t);
    let last = level.luma.height() - 1;
    for y in rows[j]..rows[j + 1] {
        let t = part(y, level.scale[1], j);
        let (left, right) = (mix(a, c, t), mix(b, d, t));
        let [above, row, below] = [y.saturating_sub(1), y, (y + 1).min(last)].map(|y| level.luma.row(y));
        for x in columns[i]..columns[i + 1] {
            let [u, v] = mix(left, right, part(x, level.scale[0], i));
            let Some(f) = plane.sample_one(u, v) else { continue };
            let t = f32::from(row[x]);
            add(pairs, [1.0, t, f, t * t, f * f, t * f]);
            let has_neighbours = x > 0 && x + 1 < row.len() && y > 0 && y < last;
            if shade.weight >= LEAST_WEIGHT && has_neighbours {
                let step = |before: u8, after: u8| (f32::from(after) - f32::from(before)) * shade.scale_t;
                let (gx, gy) = (step(row[x - 1], row[x + 1]), step(above[x], below[x]));
                let e = f * shade.scale_f - t * shade.scale_t + shade.offset;
                let weight = shade.weight / (1.0 + e * e);
                add(errors, [gx * gx, gx * gy, gy * gy, gx * e, gy * e].map(|v| v * weight));
            }
        }
    }
}

fn add<const N: usize>(sums: &mut [f32; N], values: [f32; N]) {
    for (sum, v) in sums.iter_mut().zip(values) {
        *sum += v;
    }
}
