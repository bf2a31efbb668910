//! Where an object is in space.
//!
//! In: a detection, the camera's intrinsics, the object's width. Out: two poses in mm. Memory: some 400
//! bytes of stack. Cost: some 40,000 operations.

use keygraph_core::{Distortion, Homography, Intrinsics, Lens, Pose, plane_pose};

use crate::boundary::{Outcome, put, shared, told};
use crate::detection::kg_detection;
use crate::model::{kg_object, object_size};
use crate::status::kg_status;

/// A pinhole camera without distortion, in px of the frame. Pixel centres lie at integers, as in OpenCV.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct kg_intrinsics {
    /// Focal length along x, px.
    pub fx: f32,
    /// Focal length along y, px.
    pub fy: f32,
    /// Principal point, x, px.
    pub cx: f32,
    /// Principal point, y, px.
    pub cy: f32,
}

/// A camera with a lens.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct kg_lens {
    /// Focal lengths and principal point, px of the frame.
    pub intrinsics: kg_intrinsics,
    /// 1 when the coefficients are those of a fisheye lens (k1 k2 k3 k4, then zeros), 0 when they are those of Brown and
    /// Conrady, in OpenCV's order (k1 k2 p1 p2 k3 k4 k5 k6).
    pub fisheye: u32,
    /// Coefficients.
    pub distortion: [f32; 8],
}

impl kg_lens {
    /// The lens of the core.
    pub(crate) fn of(&self) -> Outcome<Lens> {
        let i = &self.intrinsics;
        let distortion = match (self.fisheye, self.distortion) {
            (0, all) => Distortion::Brown(all),
            (1, [a, b, c, d, ..]) => Distortion::Fisheye([a, b, c, d]),
            _ => return Err(kg_status::KG_ERROR_OPTION),
        };
        Lens::new([i.fx, i.fy, i.cx, i.cy], distortion).map_err(|_| kg_status::KG_ERROR_INTRINSICS)
    }
}

/// A rigid motion from object to camera coordinates: rotation * p + translation. Both have x to the
/// right, y down and z away from the viewer; the object's origin is the middle of its picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct kg_pose {
    /// Rotation matrix, row-major.
    pub rotation: [f32; 9],
    /// The middle of the picture in camera coordinates, mm.
    pub translation_mm: [f32; 3],
    /// Distance between the points of the homography and those of the pose, px: root mean square.
    pub error_px: f32,
}

/// The two poses that a plane may have.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct kg_plane_pose {
    /// The pose that fits better.
    pub best: kg_pose,
    /// The pose whose tilt is mirrored about the line of sight.
    pub mirrored: kg_pose,
    /// 1 if the mirrored pose fits almost as well: take the tilt from elsewhere. Distance, place and the
    /// turn within the plane hold in both.
    pub ambiguous: u32,
}

fn plain(p: &Pose) -> kg_pose {
    kg_pose { rotation: p.rotation, translation_mm: p.translation_mm, error_px: p.error_px }
}

/// Computes where a detected object is before the camera, if its picture is truly `width_mm` mm wide. Through a lens,
/// put the homography of its kg_surface into the detection first. `object` is that of kg_model_object() for kg_detection.object.
///
/// Errors: KG_ERROR_INTRINSICS, KG_ERROR_SIZE, KG_ERROR_NO_POSE, KG_ERROR_NULL, KG_ERROR_ALIGNMENT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kg_detection_pose(
    detection: *const kg_detection,
    object: *const kg_object,
    intrinsics: *const kg_intrinsics,
    width_mm: f32,
    pose: *mut kg_plane_pose,
) -> kg_status {
    let run = || {
        // SAFETY: the pointers are the caller's to give.
        let d = unsafe { shared(detection) }?;
        // SAFETY: the pointers are the caller's to give.
        let size = unsafe { object_size(object) }?;
        // SAFETY: the pointers are the caller's to give.
        let i = unsafe { shared(intrinsics) }?;
        let camera = Intrinsics::new(i.fx, i.fy, i.cx, i.cy)?;
        let both = plane_pose(&Homography(d.homography), &camera, size, width_mm)?;
        let result = kg_plane_pose {
            best: plain(&both.best),
            mirrored: plain(&both.mirrored),
            ambiguous: u32::from(both.is_ambiguous()),
        };
        // SAFETY: the pointer is the caller's to give.
        unsafe { put(pose, result) }?;
        Ok(kg_status::KG_OK)
    };
    told(run())
}
