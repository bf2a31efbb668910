//! A search that is told to stop ends at once and says so, and what is known is followed.
#![allow(clippy::unwrap_used, clippy::cast_possible_truncation)]

use std::sync::Mutex;

use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, Observer, PixelFormat, Preset, Tracker, VgaDetector, VgaTrainer};

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

/// A picture of random blocks, and a frame that shows it small before other blocks.
fn picture(w: usize, h: usize, seed: u32) -> Vec<u8> {
    let value = |i: usize| {
        let block = u64::from(seed) << 32 | (((i / w / 12) << 12) + i % w / 12) as u64;
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

fn scene(object: &[u8], side: usize) -> Vec<u8> {
    let (w, h) = (640, 480);
    let mut frame = picture(w, h, 77);
    for y in 0..side {
        frame[(y + 100) * w + 180..][..side].copy_from_slice(&object[y * side..][..side]);
    }
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
    let mut whole = Budget { asked: 0, most: u32::MAX };
    let all = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut whole).unwrap().to_vec();
    assert_eq!(all.len(), 1);
    assert!(!detector.stats().stopped);
    let mut found = Vec::new();
    for most in (1..whole.asked).step_by(97).chain([whole.asked]) {
        let mut budget = Budget { asked: 0, most };
        let part = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut budget).unwrap().to_vec();
        assert!(detector.stats().stopped, "{most}");
        assert!(part.iter().all(|d| all.contains(d)), "what is found early is what is found at last");
        found.push(part.len());
    }
    assert!(found[0] == 0 && found.is_sorted(), "more time finds no less: {found:?}");
}

#[test]
fn a_tracker_follows_what_it_knows_however_short_the_time_is() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let sample = Sample::new(6);
    let (model, frame) = sample.lend();
    let (mut tracker, mut detector) = (Tracker::new(), DETECTOR.lock().unwrap());
    let mut track = |most: u32| {
        let mut budget = Budget { asked: 0, most };
        let seen = tracker.track(&mut detector, &frame, &model, DEFAULT_THRESHOLD, &mut budget).unwrap().len();
        (seen, tracker.searched(), tracker.stats().stopped)
    };
    for _ in 0..6 {
        assert_eq!(track(200), (0, true, true), "too short a time finds nothing and says so, in each frame");
    }
    assert_eq!(track(u32::MAX), (1, true, false), "with enough time the object is found");
    for _ in 0..12 {
        assert_eq!(track(1).0, 1, "what is known is followed");
    }
}

#[test]
fn a_search_in_pieces_finds_what_a_search_finds() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let sample = Sample::new(7);
    let (model, frame) = sample.lend();
    let mut detector = DETECTOR.lock().unwrap();
    let mut clock = || 0;
    for threshold in [DEFAULT_THRESHOLD, 1.1] {
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
        assert!(pieces > 20, "{pieces}");
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
