//! This layer leads from the plane of the frame to the space before the camera.
//!
//! Rule: nothing here looks at pixels.

pub mod camera;
pub mod cylinder;
