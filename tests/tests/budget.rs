//! A search that is told to stop ends at once and says so; a tracker goes on with it in the next frame,
//! and does not search what has not changed.
#![allow(clippy::unwrap_used, clippy::cast_possible_truncation)]

use std::sync::Mutex;

use keygraph::crew::crew;
use keygraph_core::{
    DEFAULT_THRESHOLD, Frame, Model, Observer, PixelFormat, Preset, RECHECK, Tracker, VgaDetector, VgaTrainer, pack,
    packed_len,
};

/// Lets a search ask a number of times, then stops it.
struct Budget {
    asked: u32,
    most: u32,
}

impl Observer for Budget {
    fn now(&mut self) -> u64 {
        0
    }

    fn goes_on(&mut self) -> bool {
        self.asked += 1;
        assert!(self.asked <= self.most, "a search that was stopped asks no more");
        self.asked < self.most
    }
}

/// A picture of random blocks of 12 px.
fn picture(w: usize, h: usize, seed: u32) -> Vec<u8> {
    blocks(w, h, seed, 12)
}

/// A picture of random blocks of this side, px.
fn blocks(w: usize, h: usize, seed: u32, side: usize) -> Vec<u8> {
    let value = |i: usize| {
        let block = u64::from(seed) << 32 | (((i / w / side) << 12) + i % w / side) as u64;
        let z = (block ^ block >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z >> 40) as u8
    };
    (0..w * h).map(value).collect()
}

fn model(pixels: &[u8], side: usize) -> Vec<u8> {
    static TRAINER: Mutex<VgaTrainer> = Mutex::new(VgaTrainer::new());
    let frame = Frame::new(PixelFormat::Gray8, side, side, pixels).unwrap();
    let params = Preset::Compact.params("blocks", true);
    let mut bytes = vec![0; 512 << 10];
    let trained = TRAINER.lock().unwrap().train(&frame, (side as u32, side as u32), &params, &mut bytes).unwrap();
    bytes.truncate(trained.bytes);
    bytes
}

/// Puts an object into a frame of 640x480 px; what lies beyond its right edge is cut off.
fn put(frame: &mut [u8], object: &[u8], side: usize, [x, y]: [usize; 2]) {
    let shown = side.min(640 - x);
    for (row, line) in object.chunks(side).enumerate() {
        frame[(y + row) * 640 + x..][..shown].copy_from_slice(&line[..shown]);
    }
}

fn scene(object: &[u8], side: usize) -> Vec<u8> {
    let mut frame = picture(640, 480, 77);
    put(&mut frame, object, side, [180, 100]);
    frame
}

/// An object, its model, and a frame that shows it.
struct Sample {
    model: Vec<u8>,
    pixels: Vec<u8>,
}

impl Sample {
    fn new(seed: u32) -> Self {
        let object = picture(240, 240, seed);
        Self { model: model(&object, 240), pixels: scene(&object, 240) }
    }

    fn lend(&self) -> (Model<'_>, Frame<'_>) {
        (Model::parse(&self.model).unwrap(), Frame::new(PixelFormat::Gray8, 640, 480, &self.pixels).unwrap())
    }
}

#[test]
fn a_search_ends_wherever_it_is_told_to_and_says_so() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let sample = Sample::new(5);
    let (model, frame) = sample.lend();
    let mut detector = DETECTOR.lock().unwrap();
    for threads in [1, 2] {
        detector.set_crew(crew(threads));
        let mut whole = Budget { asked: 0, most: u32::MAX };
        let all = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut whole).unwrap().to_vec();
        assert_eq!(all.len(), 1);
        assert!(!detector.stats().stopped);
        let mut found = Vec::new();
        // How often one of two threads asks depends on who comes first.
        let surely = if threads == 1 { whole.asked } else { whole.asked / 4 };
        for most in (1..surely).step_by(97).chain([surely]) {
            let mut budget = Budget { asked: 0, most };
            let part = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut budget).unwrap().to_vec();
            assert!(detector.stats().stopped, "{most}");
            assert!(part.iter().all(|d| all.contains(d)), "what is found early is what is found at last");
            found.push(part.len());
        }
        assert!(threads > 1 || found[0] == 0 && found.is_sorted(), "more time finds no less: {found:?}");
    }
}

#[test]
fn a_tracker_goes_on_where_it_was_stopped_until_the_object_is_found() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let sample = Sample::new(6);
    let (model, frame) = sample.lend();
    let mut detector = DETECTOR.lock().unwrap();
    let whole = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut || 0).unwrap().to_vec();
    // The same frames, with room for a few pieces of a search in each.
    for (most, last) in [(2, 400), (9, 400), (40, 200)] {
        let mut tracker = Tracker::new();
        let mut track = |most: u32| {
            let mut budget = Budget { asked: 0, most };
            let seen = tracker.track(&mut detector, &frame, &model, DEFAULT_THRESHOLD, &mut budget).unwrap().to_vec();
            (seen, tracker.searched(), tracker.stats().stopped)
        };
        let mut frames = 1;
        let found = loop {
            let (seen, searched, stopped) = track(most);
            assert!(searched, "{most} in frame {frames}");
            if !seen.is_empty() {
                break seen[0];
            }
            assert!(stopped, "{most}: a search that is not over says so in frame {frames}");
            frames += 1;
            assert!(frames < last, "{most}: never found");
        };
        assert!(frames > 1, "{most}: the time was short");
        let away =
            |i: usize| (0..2).map(|d| (found.detection.corners[i][d] - whole[0].corners[i][d]).abs()).sum::<f32>();
        assert!((0..4).all(|i| away(i) < 1.0), "{most}: {:?} and {:?}", found.detection.corners, whole[0].corners);
        for _ in 0..12 {
            let (seen, ..) = track(1);
            assert_eq!((seen.len(), seen[0].id), (1, found.id), "{most}: what is known is followed");
        }
    }
}

#[test]
fn a_detector_that_was_used_otherwise_in_between_begins_anew() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let (sample, other) = (Sample::new(6), Sample::new(9));
    let (model, frame) = sample.lend();
    let (other_model, other_frame) = other.lend();
    let (mut tracker, mut detector) = (Tracker::new(), DETECTOR.lock().unwrap());
    let mut track = |detector: &mut VgaDetector, (model, frame): &(Model<'_>, Frame<'_>), most: u32| {
        let mut budget = Budget { asked: 0, most };
        tracker.track(detector, frame, model, DEFAULT_THRESHOLD, &mut budget).unwrap().len()
    };
    for i in 0..12 {
        assert_eq!(track(&mut detector, &(model, frame), 2 + i), 0);
        detector.detect(&other_frame, &other_model, DEFAULT_THRESHOLD, &mut || 0).unwrap();
    }
    for i in 0..12 {
        let one = if i % 2 == 0 { (model, frame) } else { (other_model, other_frame) };
        assert_eq!(track(&mut detector, &one, 2 + i), 0, "another model ends the search");
    }
    assert_eq!(track(&mut detector, &(model, frame), u32::MAX), 1);
}

#[test]
fn beside_what_is_followed_the_rest_is_searched_part_by_part() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    const SIDE: usize = 150;
    let objects = [21, 22].map(|seed| picture(SIDE, SIDE, seed));
    let models = objects.each_ref().map(|pixels| model(pixels, SIDE));
    let parsed = models.each_ref().map(|bytes| Model::parse(bytes).unwrap());
    let mut bytes = vec![0; packed_len(&parsed).unwrap()];
    pack(&parsed, &mut bytes).unwrap();
    let model = Model::parse(&bytes).unwrap();
    let [one, both] = [1, 2].map(|shown| {
        let mut frame = blocks(640, 480, 77, 31);
        for (pixels, corner) in objects.iter().zip([[30, 40], [450, 310]]).take(shown) {
            put(&mut frame, pixels, SIDE, corner);
        }
        frame
    });
    let (mut tracker, mut detector) = (Tracker::new(), DETECTOR.lock().unwrap());
    let mut track = |pixels: &[u8], most: u32| {
        let frame = Frame::new(PixelFormat::Gray8, 640, 480, pixels).unwrap();
        let mut budget = Budget { asked: 0, most };
        let seen = tracker.track(&mut detector, &frame, &model, DEFAULT_THRESHOLD, &mut budget).unwrap().len();
        (seen, budget.asked)
    };
    let (seen, whole) = track(&one, u32::MAX);
    assert_eq!(seen, 1);
    // A third of the time of a whole search.
    let frames = (1..25).find(|_| track(&both, whole / 3).0 == 2).unwrap_or(25);
    assert!((2..25).contains(&frames), "{frames}: ten frames until it is searched, ten parts");
}

/// A still scene of a camera, with the noise and the light, thousandths, of each frame.
fn shot(pixels: &[u8], seed: u32, gain: u32) -> Vec<u8> {
    let noise = picture(pixels.len(), 1, seed);
    let z = |i: usize| (i as u64 * 0x9e37_79b9 + u64::from(noise[i])).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 58;
    let lit = |i: usize, v: u8| u32::from(v) * gain / 1000 + (z(i) >> 2) as u32;
    pixels.iter().enumerate().map(|(i, &v)| lit(i, v).min(255) as u8).collect()
}

#[test]
fn a_still_scene_is_not_searched_again_and_nothing_that_appears_is_missed() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    const SIDE: usize = 150;
    let object = picture(SIDE, SIDE, 31);
    let bytes = model(&object, SIDE);
    let model = Model::parse(&bytes).unwrap();
    let mut detector = DETECTOR.lock().unwrap();
    let mut track = |tracker: &mut Tracker, pixels: &[u8]| {
        let frame = Frame::new(PixelFormat::Gray8, 640, 480, pixels).unwrap();
        let seen = tracker.track(&mut detector, &frame, &model, DEFAULT_THRESHOLD, &mut || 0).unwrap().len();
        (seen, tracker.searched())
    };
    let empty = picture(640, 480, 77);
    // Lamps that flicker, and a light that fades.
    let light = |i: u32| (1000 - 4 * i) * (100 - 7 * (i % 2)) / 100;
    let mut tracker = Tracker::new();
    let searched = (0..60).filter(|&i| track(&mut tracker, &shot(&empty, i, light(i))) == (0, true)).count();
    assert_eq!(searched, 2, "the first frame, and one in {RECHECK}");
    // An object slides in from the right, 3 px a frame; another tracker searches each frame.
    let mut eager = Tracker::new();
    let mut appears = |tracker: &mut Tracker, always: bool| {
        (0..60u32).find(|&i| {
            let mut scene = empty.clone();
            put(&mut scene, &object, SIDE, [640 - 3 * i as usize, 170]);
            if always {
                tracker.search_next();
            }
            track(tracker, &shot(&scene, 100 + i, light(i))).0 == 1
        })
    };
    let (at, earliest) = (appears(&mut tracker, false), appears(&mut eager, true));
    assert!(at.is_some() && at == earliest, "{at:?} and {earliest:?}");
    // One that is there from one frame to the next is found in that frame, in whatever light.
    for gain in [500, 800, 1000] {
        let mut tracker = Tracker::new();
        for i in 0..5 {
            assert_eq!(track(&mut tracker, &shot(&empty, i, gain)), (0, i == 0), "{gain}");
        }
        let mut scene = empty.clone();
        put(&mut scene, &object, SIDE, [300, 170]);
        assert_eq!(track(&mut tracker, &shot(&scene, 9, gain)), (1, true), "{gain}");
    }
}

#[test]
fn a_search_in_pieces_finds_what_a_search_finds() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let sample = Sample::new(7);
    let (model, frame) = sample.lend();
    let mut detector = DETECTOR.lock().unwrap();
    let mut clock = || 0;
    for (threshold, threads) in [(DEFAULT_THRESHOLD, 1), (1.1, 1), (DEFAULT_THRESHOLD, 2), (1.1, 2)] {
        detector.set_crew(crew(threads));
        detector.detect(&frame, &model, threshold, &mut clock).unwrap();
        let whole = (detector.detections().to_vec(), *detector.stats(), *detector.high_water());
        let mut search = detector.begin(&frame, &model, threshold, &mut clock).unwrap();
        assert!(search.detections().is_empty());
        let mut pieces = 1;
        while search.step(&mut clock) {
            pieces += 1;
        }
        assert!(!search.step(&mut clock), "it stays at its end");
        assert_eq!(search.detections(), whole.0);
        assert_eq!((*detector.stats(), *detector.high_water()), (whole.1, whole.2));
        // With others, all up to the first decision is one piece.
        assert!(pieces > if threads == 1 { 20 } else { 5 }, "{pieces}");
        // Told to stop, it ends within a few pieces, and says so.
        let mut search = detector.begin(&frame, &model, threshold, &mut clock).unwrap();
        assert!(search.step(&mut clock));
        let mut left = 0;
        while search.step(&mut Budget { asked: 0, most: 1 + u32::from(left > 0) }) {
            left += 1;
        }
        assert!(left < 12 && detector.stats().stopped, "{left}");
    }
}

#[test]
fn several_models_are_searched_for_in_a_frame_that_is_read_once() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let [sample, other] = [Sample::new(7), Sample::new(8)];
    let ((model, frame), (absent, _)) = (sample.lend(), other.lend());
    let mut detector = DETECTOR.lock().unwrap();
    let mut clock = || 0;
    let found = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut clock).unwrap().to_vec();
    let seen = detector.stats().stages;
    assert_eq!(found.len(), 1);
    for (model, expected) in [(&absent, &found[..0]), (&model, &found[..]), (&absent, &found[..0])] {
        let mut search = detector.begin_again(model, DEFAULT_THRESHOLD);
        assert!(search.detections().is_empty());
        while search.step(&mut clock) {}
        assert_eq!(search.detections(), expected);
    }
    let mut search = detector.begin_again(&model, DEFAULT_THRESHOLD);
    while search.step(&mut clock) {}
    assert_eq!(detector.stats().stages, seen, "the same search");
    // Before any frame there is nothing to find.
    static IDLE: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let mut idle = IDLE.lock().unwrap();
    for threads in [1, 2] {
        idle.set_crew(crew(threads));
        let mut search = idle.begin_again(&model, DEFAULT_THRESHOLD);
        while search.step(&mut clock) {}
        assert!(search.detections().is_empty());
    }
}
