//! Frames in order, which show the object or something else. The tracker must not panic, and its
//! tracks must stay in order. The surfaces of its tracks, through lenses too, have places for all points.
//!
//! In: the model, the threshold, then for each frame: where the object is, which rows of it are
//! hidden, bytes that replace pixels, and when the search is stopped. The detector is sometimes used
//! for something else in between. Out: nothing. After half of the frames the model may be
//! another one. Cost: up to [`MOST`] qqvga frames, most of them followed without a search.

use keygraph_core::{Distortion, Frame, Known, Lens, Model, Observer, PixelFormat, State, Surfaces, TRACKS, Tracker};

use crate::{Input, PICTURE, detector, models, picture};

/// Maximum number of frames of an input.
const MOST: usize = 12;
const SIZE: (usize, usize) = (160, 120);

/// Stops a search after so many questions.
struct Budget(usize);

impl Observer for Budget {
    fn now(&mut self) -> u64 {
        0
    }

    fn goes_on(&mut self) -> bool {
        self.0 = self.0.saturating_sub(1);
        self.0 > 0
    }
}

/// Runs the target on one input.
pub fn sequence(data: &[u8]) {
    let mut input = Input(data);
    let models = models();
    let choice = usize::from(input.byte());
    let parsed = |i: usize| Model::parse(&models[i % models.len()]).expect("it was trained");
    let (first, second) = (parsed(choice), parsed(choice / 16));
    let threshold = f32::from(input.byte()) / 255.0;
    let (mut detector, mut tracker, mut surfaces) = (detector(), Tracker::new(), Surfaces::new());
    let lenses = lenses();
    let mut next = 0;
    for number in 0..MOST {
        if input.0.is_empty() {
            break;
        }
        let pixels = pixels(&mut input);
        // A frame may be smaller than the frame before.
        let height = SIZE.1 - usize::from(input.byte() % 4) * 20;
        let bytes = &pixels[..3 * SIZE.0 * height];
        let frame = Frame::new(PixelFormat::Rgb8, SIZE.0, height, bytes).expect("it has this size");
        let model = if number < MOST / 2 { &first } else { &second };
        let mut budget = Budget(if input.byte() < 128 { usize::MAX } else { input.byte().into() });
        if input.byte() > 250 {
            detector.detect(&frame, model, threshold, &mut budget).expect("it fits the profile");
        }
        let tracks = tracker.track(&mut detector, &frame, model, threshold, &mut budget).expect("it fits the profile");
        assert!(tracks.len() <= TRACKS);
        let mut newest = next;
        for (i, t) in tracks.iter().enumerate() {
            assert!(t.detection.corners.iter().flatten().all(|v| v.is_finite()), "{t:?}");
            assert!(t.detection.homography.0.iter().all(|v| v.is_finite()), "{t:?}");
            assert!((0.0..=1.0).contains(&t.detection.score), "{t:?}");
            assert!(usize::from(t.detection.object) < model.objects(), "{t:?}");
            assert_eq!(t.unseen == 0, t.state != State::Lost, "{t:?}");
            assert!(tracks[..i].iter().all(|other| other.id != t.id), "two tracks with id {}", t.id);
            assert!(t.id < next || t.state != State::Tracked, "a new track was found, not followed: {t:?}");
            newest = newest.max(t.id + 1);
        }
        next = newest;
        for t in tracker.tracks() {
            let lens = lenses[number % lenses.len()].as_ref();
            let known = Known { lens, is_flat: number % 5 == 4 };
            let surface = surfaces.surface(&mut detector, &frame, model, t, known, &mut budget);
            if let Some(surface) = surface.expect("it fits the profile") {
                assert!(surface.points.as_flattened().iter().all(|v| v.is_finite()), "{surface:?}");
                assert!(t.state != State::Lost && !(known.is_flat && surface.is_bent), "{t:?}");
                let mut flat = [0; 24 * 17];
                detector.flatten(&surface, [24, 17], &mut flat);
            }
        }
    }
}

/// No lens, one that folds within the frame, and a fisheye lens.
fn lenses() -> [Option<Lens>; 3] {
    let camera = [130.0, 131.0, 80.0, 61.0];
    let lens = |distortion| Lens::new(camera, distortion).ok();
    let folds = Distortion::Brown([-0.9, 0.1, 1e-3, -1e-3, 0.0, 0.0, 0.0, 0.0]);
    [None, lens(folds), lens(Distortion::Fisheye([0.1, -0.1, 0.05, -0.2]))]
}

/// Makes the pixels of the next frame.
fn pixels(input: &mut Input<'_>) -> Vec<u8> {
    let mut rgb = vec![input.byte(); 3 * SIZE.0 * SIZE.1];
    let copies = 1 + usize::from(input.byte().is_multiple_of(4));
    for _ in 0..copies {
        let (left, top) = (usize::from(input.byte()) % SIZE.0, usize::from(input.byte()) % SIZE.1);
        // Half of the objects are whole; of the others, the lower rows are hidden.
        let seen = usize::from(input.byte()) % (2 * PICTURE.1);
        let (shown, rows) = (PICTURE.0.min(SIZE.0 - left), PICTURE.1.min(SIZE.1 - top));
        for y in 0..rows.min(seen) {
            let row = &picture()[3 * y * PICTURE.0..][..3 * shown];
            rgb[3 * ((top + y) * SIZE.0 + left)..][..3 * shown].copy_from_slice(row);
        }
    }
    for _ in 0..input.byte() % 8 {
        let (at, value) = (usize::from(input.word()) * 3 % rgb.len(), input.byte());
        let end = rgb.len().min(at + 3 * usize::from(input.byte()));
        rgb[at..end].fill(value);
    }
    rgb
}
