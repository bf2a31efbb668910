//! Matches the cells of a picture one by one with the frame, for the calibration of a camera.
//!
//! In: the frame's pyramid, an object, and a surface near the right one. Out: for each cell that has steps in both
//! directions, a place of the picture and where the frame shows it. A cell is moved by one step of its own.
//!
//! Memory: 5 KB of stack, and 20 bytes a cell. Cost: two looks at the finest level of the template.

use heapless::Vec;

use crate::base::pace::Steady;
use crate::detect::cells::{ALL, CELLS, Level, Scene};
use crate::detect::surface::Surface;
use crate::image::pyramid::PyramidView;
use crate::model::parse::Object;

/// A place of the picture and where it is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellMatch {
    /// Place of the picture, px.
    pub picture: [f32; 2],
    /// Place in the frame, px.
    pub frame: [f32; 2],
    /// How well the cell around them agrees, 0 to 1.
    pub weight: f32,
}

/// Minimum weight of a cell that is matched, and minimum strength of its steps in the weaker direction, as a share
/// of the mean of all cells.
const LEAST_MATCHED: f32 = 0.3;
const LEAST_STEEP: f32 = 0.1;
/// Maximum distance of a match from where the surface has it, px of the template.
const FARTHEST_MATCH: f32 = 2.5;

/// Matches the cells of the picture one by one, near where a surface has them.
pub(crate) fn matches(view: &PyramidView<'_>, object: &Object<'_>, surface: &Surface) -> Vec<CellMatch, ALL> {
    let (mut scene, level) = (Scene::EMPTY, Level::new(object, 0, 1));
    if view.luma(0).width() == 0 {
        return Vec::new();
    }
    scene.look(view, &level, &surface.points, true, &mut Steady);
    scene.look(view, &level, &surface.points, false, &mut Steady);
    let size = [object.width as f32, object.height as f32];
    let mean = scene.errors.iter().map(|e| e[0] + e[2]).sum::<f32>() / ALL as f32;
    let mut all = Vec::new();
    for (cell, (&[xx, xy, yy, xe, ye], shade)) in scene.errors.iter().zip(&scene.light).enumerate() {
        // A cell with steps in one direction alone slides along the other. The errors are of steps over two px.
        let det = xx * yy - xy * xy;
        let weaker = det / (xx + yy).max(1e-6);
        if shade.weight < LEAST_MATCHED || weaker < LEAST_STEEP * mean {
            continue;
        }
        let off = [2.0 * (yy * xe - xy * ye) / det, 2.0 * (xx * ye - xy * xe) / det];
        if off[0] * off[0] + off[1] * off[1] > FARTHEST_MATCH * FARTHEST_MATCH {
            continue;
        }
        let at = [cell % CELLS, cell / CELLS].map(|v| (v as f32 + 0.5) / CELLS as f32);
        let moved = [0, 1].map(|i| at[i] + off[i] * level.scale[i][0] / CELLS as f32);
        let picture = [0, 1].map(|i| moved[i] * size[i]);
        let matched = CellMatch { picture, frame: surface.at(at), weight: shade.weight };
        // There is room for all.
        let _ = all.push(matched);
    }
    all
}
