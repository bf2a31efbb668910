//! The interface as C uses it, from Rust, so that miri can watch: `scripts/miri` runs these tests.
//!
//! The model is the example of `docs/model-format.md`, and the frames are small, since miri is slow. What
//! needs a trained model is left out there.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests")]

use std::ffi::{CStr, c_void};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

use keygraph_c::kg_status::*;
use keygraph_c::*;

/// Memory from an allocator, at a multiple of 8 bytes, with something in it.
fn memory(bytes: usize) -> Vec<u64> {
    vec![0xa5a5_a5a5_a5a5_a5a5; bytes.div_ceil(8)]
}

fn place(memory: &mut [u64]) -> *mut c_void {
    memory.as_mut_ptr().cast()
}

/// Returns the model in the hex block of the page. Its lines are like `offset | aa [bb] x 3 | meaning`.
fn example() -> Vec<u8> {
    let page = include_str!("../../../docs/model-format.md");
    let block = page.split("```hex\n").nth(1).unwrap().split("```").next().unwrap();
    let mut bytes = Vec::new();
    let hex = |digits: &str| u8::from_str_radix(digits, 16).unwrap();
    for line in block.lines() {
        let mut rest = line.split('|').nth(1).unwrap().trim();
        while !rest.is_empty() {
            let (piece, after) = match rest.strip_prefix('[') {
                Some(group) => {
                    let (group, after) = group.split_once(']').unwrap();
                    let (times, after) = after.trim_start()[1..]
                        .trim_start()
                        .split_once(' ')
                        .unwrap_or((after.trim_start()[1..].trim(), ""));
                    let group: Vec<u8> = group.split_whitespace().map(hex).collect();
                    (group.repeat(times.parse().unwrap()), after)
                }
                None => {
                    let (byte, after) = rest.split_once(' ').unwrap_or((rest, ""));
                    (vec![hex(byte)], after)
                }
            };
            bytes.extend(piece);
            rest = after.trim_start();
        }
    }
    bytes
}

/// Random blocks of `side` px.
fn blocks(width: usize, height: usize, side: usize) -> Vec<u8> {
    let shade = |i: usize| {
        let mut seed = u32::try_from(i / width / side * 64 + i % width / side + 1).unwrap();
        for _ in 0..3 {
            seed = (seed ^ seed >> 15).wrapping_mul(0x2c1b_3c6d);
        }
        seed.to_le_bytes()[3]
    };
    (0..width * height).map(shade).collect()
}

fn gray(data: &[u8], width: u32, height: u32) -> kg_frame {
    let window = kg_window::default();
    kg_frame { data: data.as_ptr(), bytes: data.len(), stride: 0, format: KG_FORMAT_GRAY8, width, height, window }
}

fn open(bytes: &[u8]) -> MaybeUninit<kg_model> {
    let mut model = MaybeUninit::uninit();
    // SAFETY: the memory is that of a model, and the bytes outlive it in every test.
    assert_eq!(unsafe { kg_model_open(model.as_mut_ptr(), bytes.as_ptr(), bytes.len()) }, KG_OK);
    model
}

fn detector(memory: &mut [u64]) -> *mut kg_detector {
    let mut d = null_mut();
    // SAFETY: the memory is the caller's.
    let status = unsafe { kg_detector_init(place(memory), 8 * memory.len(), KG_PROFILE_QQVGA, &raw mut d) };
    assert_eq!(status, KG_OK);
    d
}

fn detections(d: *mut kg_detector) -> Vec<kg_detection> {
    let mut out = vec![kg_detection::default(); KG_DETECTIONS];
    let mut count = 0;
    // SAFETY: there is room for all of them.
    assert_eq!(unsafe { kg_detector_detections(d, out.as_mut_ptr(), out.len(), &raw mut count) }, KG_OK);
    out.truncate(count);
    out
}

/// Searches in pieces, and looks at the detections in between.
fn in_pieces(d: *mut kg_detector, model: *const kg_model, frame: &kg_frame) -> (usize, Vec<kg_detection>) {
    // SAFETY: the pointers are those of live objects.
    assert_eq!(unsafe { kg_detector_begin(d, model, frame, null(), null()) }, KG_MORE);
    for steps in 1.. {
        detections(d);
        // SAFETY: as above.
        match unsafe { kg_detector_step(d, null()) } {
            KG_MORE => {}
            KG_OK => return (steps, detections(d)),
            other => panic!("{other:?}"),
        }
    }
    unreachable!("a search ends")
}

#[test]
fn a_model_is_opened_and_described() {
    let bytes = example();
    let model = open(&bytes);
    let (mut info, mut object) = (MaybeUninit::uninit(), MaybeUninit::uninit());
    // SAFETY: the pointers are those of live objects.
    unsafe {
        assert_eq!(kg_model_describe(model.as_ptr(), info.as_mut_ptr()), KG_OK);
        assert_eq!(kg_model_object(model.as_ptr(), 0, object.as_mut_ptr()), KG_OK);
        assert_eq!(kg_model_object(model.as_ptr(), 1, object.as_mut_ptr()), KG_ERROR_INDEX);
    }
    // SAFETY: both were written.
    let (info, object) = unsafe { (info.assume_init(), object.assume_init()) };
    assert_eq!((info.bytes, info.objects), (bytes.len(), 1));
    // SAFETY: a name ends with a zero byte.
    assert!(!unsafe { CStr::from_ptr(object.name.as_ptr()) }.to_str().unwrap().is_empty());

    let mut longer = bytes.clone();
    longer.extend([0xff; 100]);
    let mut length = 0;
    // SAFETY: the pointers are those of live objects.
    assert_eq!(unsafe { kg_model_bytes(longer.as_ptr(), longer.len(), &raw mut length) }, KG_OK);
    assert_eq!(length, bytes.len());
}

#[test]
fn memory_without_an_object_is_refused() {
    let mut memory = vec![0u64; 1 << 15];
    let m = place(&mut memory);
    let mut count = 0;
    // SAFETY: the memory is large enough for any object that is looked for.
    unsafe {
        assert_eq!(kg_detector_detections(m.cast(), null_mut(), 0, &raw mut count), KG_ERROR_HANDLE);
        assert_eq!(kg_tracker_reset(m.cast()), KG_ERROR_HANDLE);
        assert_eq!(kg_model_object(m.cast(), 0, null_mut()), KG_ERROR_HANDLE);
        assert_eq!(kg_detector_init(m, 100, KG_PROFILE_QQVGA, &raw mut count as *mut _), KG_ERROR_MEMORY);
        let odd = m.wrapping_byte_add(4);
        assert_eq!(kg_detector_init(odd, 1 << 17, KG_PROFILE_QQVGA, &raw mut count as *mut _), KG_ERROR_ALIGNMENT);
        assert_eq!(kg_tracker_init(odd, 1 << 17, &raw mut count as *mut _), KG_ERROR_ALIGNMENT);
    }
}

/// What borrows what is what miri looks at here.
#[test]
fn a_small_frame_is_searched_in_every_way() {
    let bytes = example();
    let model = open(&bytes);
    let side = if cfg!(miri) { 24 } else { 96 };
    let data = blocks(side, side, 6);
    let frame = gray(&data, u32::try_from(side).unwrap(), u32::try_from(side).unwrap());
    let mut memory = memory(KG_QQVGA_DETECTOR_BYTES);
    let d = detector(&mut memory);
    // SAFETY: the pointers are those of live objects.
    assert_eq!(unsafe { kg_detector_detect(d, model.as_ptr(), &raw const frame, null(), null()) }, KG_OK);
    let whole = detections(d);
    let (steps, pieces) = in_pieces(d, model.as_ptr(), &frame);
    assert!(steps > 1);
    assert_eq!(pieces, whole);
    let other = open(&bytes);
    // SAFETY: the pointers are those of live objects.
    unsafe {
        assert_eq!(kg_detector_begin_again(d, other.as_ptr(), null(), null()), KG_MORE);
        while kg_detector_step(d, null()) == KG_MORE {}
    }
    assert_eq!(detections(d), whole);

    let mut stats = kg_stats::default();
    // SAFETY: as above.
    unsafe {
        assert_eq!(kg_detector_begin(d, model.as_ptr(), &raw const frame, null(), null()), KG_MORE);
        assert_eq!(kg_detector_stats(d, &raw mut stats), KG_ERROR_BUSY);
        assert_eq!(kg_detector_cancel(d), KG_OK);
        assert_eq!(kg_detector_step(d, null()), KG_ERROR_NO_SEARCH);
        assert_eq!(kg_detector_stats(d, &raw mut stats), KG_OK);
    }
    let mut digests = [0; KG_STAGES];
    let digest = |to: *mut u32| {
        // SAFETY: as above.
        unsafe { kg_detector_detect_with_digests(d, model.as_ptr(), &raw const frame, null(), null(), to) }
    };
    assert_eq!(digest(digests.as_mut_ptr()), KG_OK);
    assert!(digests.iter().any(|&d| d != digests[0]));
    assert_eq!(digest(null_mut()), KG_ERROR_NULL);

    let mut memory = self::memory(KG_TRACKER_BYTES);
    let mut t = null_mut();
    let mut count = 0;
    // SAFETY: as above.
    unsafe {
        assert_eq!(kg_tracker_init(place(&mut memory), 8 * memory.len(), &raw mut t), KG_OK);
        assert_eq!(kg_tracker_track(t, d, model.as_ptr(), &raw const frame, null(), null()), KG_OK);
        assert_eq!(kg_tracker_tracks(t, null_mut(), 0, &raw mut count), KG_OK);
        assert_eq!(kg_tracker_search_next(t), KG_OK);
        assert_eq!(kg_tracker_stats(t, &raw mut stats), KG_OK);
    }
    assert_eq!((count, stats.searched), (0, 1));
}

/// What a callback knows.
struct Caller {
    detector: *mut kg_detector,
    tracker: *mut kg_tracker,
    refused: usize,
}

unsafe extern "C" fn call_back(context: *mut c_void) -> i32 {
    let caller = context.cast::<Caller>();
    let mut count = 0;
    // SAFETY: the context is a caller, which nobody else uses now.
    let told = unsafe {
        [
            kg_detector_detections((*caller).detector, null_mut(), 0, &raw mut count),
            kg_detector_step((*caller).detector, null()),
            kg_detector_cancel((*caller).detector),
            kg_tracker_tracks((*caller).tracker, null_mut(), 0, &raw mut count),
            kg_tracker_reset((*caller).tracker),
        ]
    };
    // SAFETY: as above.
    unsafe { (*caller).refused += told.iter().filter(|&&s| s == KG_ERROR_BUSY).count() };
    0
}

#[test]
fn a_callback_finds_its_objects_at_work_and_stops_the_search() {
    let bytes = example();
    let model = open(&bytes);
    let data = blocks(24, 24, 6);
    let frame = gray(&data, 24, 24);
    let mut memory = memory(KG_QQVGA_DETECTOR_BYTES);
    let mut more = self::memory(KG_TRACKER_BYTES);
    let mut tracker = null_mut();
    // SAFETY: the memory is the test's.
    assert_eq!(unsafe { kg_tracker_init(place(&mut more), 8 * more.len(), &raw mut tracker) }, KG_OK);
    let mut caller = Caller { detector: detector(&mut memory), tracker, refused: 0 };
    let d = caller.detector;
    let context = (&raw mut caller).cast();
    let observer = kg_observer { context, now: None, goes_on: Some(call_back), budget: 0 };
    // SAFETY: the pointers are those of live objects.
    let status = unsafe { kg_tracker_track(tracker, d, model.as_ptr(), &raw const frame, null(), &raw const observer) };
    assert_eq!(status, KG_STOPPED);
    // SAFETY: the callback is not running.
    assert_eq!(unsafe { (*context.cast::<Caller>()).refused }, 5);
    detections(d);
}

#[test]
#[cfg_attr(miri, ignore = "learns: hours")]
fn a_picture_is_learnt_and_found_as_the_core_does() {
    use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, PixelFormat, Preset, QqvgaDetector, QqvgaTrainer};
    let data = blocks(160, 120, 10);
    let frame = gray(&data, 160, 120);
    let mut m = memory(KG_QQVGA_TRAINER_BYTES);
    let mut trainer = null_mut();
    let training = kg_training {
        name: c"blocks".as_ptr(),
        preset: KG_PRESET_LEARNT,
        luma_only: 1,
        original_width: 0,
        original_height: 0,
    };
    let (mut out, mut trained) = (vec![0; 1 << 17], kg_trained::default());
    // SAFETY: the pointers are those of live objects.
    unsafe {
        assert_eq!(kg_trainer_init(place(&mut m), 8 * m.len(), KG_PROFILE_QQVGA, &raw mut trainer), KG_OK);
        let status = kg_trainer_train(
            trainer,
            &raw const frame,
            &raw const training,
            out.as_mut_ptr(),
            out.len(),
            &raw mut trained,
        );
        assert_eq!(status, KG_OK);
    }
    out.truncate(trained.bytes);

    let picture = Frame::new(PixelFormat::Gray8, 160, 120, &data).unwrap();
    let mut by_core = vec![0; Preset::Learnt.bytes()];
    let params = Preset::Learnt.params("blocks", true);
    let done = QqvgaTrainer::new().train(&picture, (160, 120), &params, &mut by_core).unwrap();
    assert!(out == by_core[..done.bytes], "the models differ");

    let model = open(&out);
    let mut m = memory(KG_QQVGA_DETECTOR_BYTES);
    let d = detector(&mut m);
    // SAFETY: the pointers are those of live objects.
    assert_eq!(unsafe { kg_detector_detect(d, model.as_ptr(), &raw const frame, null(), null()) }, KG_OK);
    let found = detections(d);
    assert_eq!(in_pieces(d, model.as_ptr(), &frame).1, found);
    let parsed = Model::parse(&out).unwrap();
    let mut core = Box::<QqvgaDetector>::default();
    let by_core = core.detect(&picture, &parsed, DEFAULT_THRESHOLD, &mut || 0).unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].homography, found[0].outline), (by_core[0].homography.0, by_core[0].corners));
}

/// The memory table of the README is that of the constants.
#[test]
fn the_readme_states_the_sizes() {
    let readme = include_str!("../README.md");
    let rows = [
        ("qqvga", "160 x 120", KG_QQVGA_DETECTOR_BYTES, Some(KG_QQVGA_TRAINER_BYTES)),
        ("qvga", "320 x 240", KG_QVGA_DETECTOR_BYTES, Some(KG_QVGA_TRAINER_BYTES)),
        ("vga", "640 x 480", KG_VGA_DETECTOR_BYTES, Some(KG_VGA_TRAINER_BYTES)),
        ("hd", "1280 x 720", KG_HD_DETECTOR_BYTES, None),
    ];
    for (name, frame, detector, trainer) in rows {
        let trainer = trainer.map_or("none".into(), |t| t.to_string());
        let row = format!("| {name} | {frame} | {detector} | {trainer} |");
        assert!(readme.contains(&row), "bindings/c/README.md lacks this row:\n{row}");
    }
    let tracker = format!("A tracker takes {KG_TRACKER_BYTES} bytes");
    assert!(readme.contains(&tracker), "bindings/c/README.md lacks: {tracker}");
}
