//! Results as plain structs. In: detections of the core. Out: [`kg_detection`]. Memory: none. Cost:
//! none.

use keygraph_core::{Detection, Surface, Window};

/// One instance of an object in a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct kg_detection {
    /// Index of the object in the model.
    pub object: u32,
    /// Estimated probability that the detection is right, 0 to 1.
    pub score: f32,
    /// Map from px of the training picture to px of the frame, row-major; the last element is 1.
    pub homography: [f32; 9],
    /// Corners of the picture, (0,0) (w,0) (w,h) (0,h), in the frame: x and y, px.
    pub outline: [[f32; 2]; 4],
    /// Share of the object that is seen and agrees, 0 to 1. What lies outside the frame does not count.
    pub visible: f32,
    /// Number of keygraphs of which all three vertices agree with the pose.
    pub votes: u32,
    /// Number of distinct corners of the frame that agree with the pose.
    pub agreeing: u32,
    /// Number of other objects that could be at this place, kg_detector_rivals(). 0 in tracks and while
    /// a search in pieces goes on.
    pub rivals: u32,
}

impl kg_detection {
    /// Makes a plain struct of a detection in a window of a frame, in px of the frame.
    pub(crate) fn new(d: &Detection, window: Option<Window>, rivals: usize) -> Self {
        let d = window.map_or(*d, |w| d.mapped(&w.to_frame()));
        Self {
            object: u32::from(d.object),
            score: d.score,
            homography: d.homography.0,
            outline: d.corners,
            visible: d.appearance.visible,
            votes: u32::from(d.votes),
            agreeing: u32::from(d.agreeing),
            rivals: u32::try_from(rivals).unwrap_or(u32::MAX),
        }
    }
}

/// Columns of the grid of a surface, and rows.
pub const KG_SURFACE_SIDE: usize = 9;
const _: () = assert!(KG_SURFACE_SIDE == keygraph_core::stages::surface::SIDE, "the core has another grid");

/// Where the picture of an object lies in a frame, on a plane or on a surface that is bent.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct kg_surface {
    /// 1 when the surface is bent, 0 when a plane explains what is seen.
    pub bent: u32,
    /// Map from px of the training picture to px of the ideal frame, whose straight lines are straight, row-major;
    /// the last element is 1. Without a lens that is the frame. Of a bent surface it is that of the plane of its mean
    /// direction through the middle of the picture.
    pub homography: [f32; 9],
    /// Places in the frame of a grid of points of the picture: x and y, px, row by row from the picture's
    /// top left corner to its bottom right corner.
    pub points: [[[f32; 2]; KG_SURFACE_SIDE]; KG_SURFACE_SIDE],
}

impl kg_surface {
    /// Makes a plain struct of a surface in a window of a frame, in px of the frame.
    pub(crate) fn new(surface: &Surface, window: Option<Window>) -> Self {
        let surface = window.map_or(*surface, |w| surface.mapped(&w.to_frame()));
        let mut points = [[[0.0; 2]; KG_SURFACE_SIDE]; KG_SURFACE_SIDE];
        for (to, from) in points.as_flattened_mut().iter_mut().zip(surface.points) {
            *to = from;
        }
        Self { bent: u32::from(surface.is_bent), homography: surface.homography.0, points }
    }
}
