//! Asserts the sizes that the header asserts too (`cbindgen.toml`), so that both sides agree.
//! Memory: none. Cost: none.

use core::ffi::c_void;

use crate::*;

const POINTER: usize = size_of::<*const c_void>();
/// What the alignment of 64-bit targets, and that of 32-bit targets, adds.
const ON_64: usize = if POINTER == 8 { 4 } else { 0 };
const ON_32: usize = if POINTER == 4 { 4 } else { 0 };

const _: () = {
    assert!(size_of::<kg_status>() == 4);
    assert!(size_of::<kg_model>() == 192);
    assert!(size_of::<kg_object>() == 48);
    assert!(size_of::<kg_window>() == 16);
    assert!(size_of::<kg_options>() == 12);
    assert!(size_of::<kg_detection>() == 92);
    assert!(size_of::<kg_track>() == 104);
    assert!(size_of::<kg_stage>() == 24);
    assert!(size_of::<kg_stats>() == 280);
    assert!(size_of::<kg_intrinsics>() == 16);
    assert!(size_of::<kg_plane_pose>() == 108);
    assert!(size_of::<kg_frame>() == 3 * POINTER + 28 + ON_64);
    assert!(size_of::<kg_observer>() == 3 * POINTER + 8 + ON_32);
    assert!(size_of::<kg_training>() == POINTER + 16);
    assert!(size_of::<kg_trained>() == POINTER + 12 + ON_64);
    assert!(size_of::<kg_model_info>() == POINTER + 24);
    assert!(size_of::<kg_buffer>() == 3 * POINTER);
};
