//! Results as plain structs. In: detections of the core. Out: [`kg_detection`]. Memory: none. Cost:
//! none.

use keygraph_core::{Detection, Window};

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
