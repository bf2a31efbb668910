//! any keypoints and triples from a foreign finder. The search must not panic.
//!
//! In: the model to use, the number of keypoints per level, keypoints and triples. Out: nothing.
//! Cost: one qqvga frame without corner detection and triangulation.

use crate::{Input, PICTURE, check, detector, models, picture};
use keygraph_core::stages::corners::Corner;
use keygraph_core::stages::delaunay::Triple;
use keygraph_core::stages::finder::Finder;
use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::pace::Pace;
use keygraph_core::stages::plane::Plane;
use keygraph_core::{Frame, Model, PixelFormat, StageStats, heapless::VecView};

struct Foreign<'a> {
    input: Input<'a>,
    keypoints: usize,
    narrow: bool,
}

impl Finder for Foreign<'_> {
    fn keypoints(&mut self, _: Plane<'_, u8>, _: usize, out: &mut VecView<Corner>, _: &mut dyn Pace) -> StageStats {
        let mask = if self.narrow { 0x07ff } else { !0 };
        for _ in 0..self.keypoints {
            let [x, y] = [0; 2].map(|_| (self.input.word() & mask).cast_signed());
            if out.push(Corner { point: Point::new(x, y), strength: 1, radius2: 0 }).is_err() {
                break;
            }
        }
        StageStats::default()
    }

    fn triples(&mut self, points: &[Point], out: &mut VecView<Triple>, _: &mut dyn Pace) -> StageStats {
        // Triples of neighbouring indices, of spread indices, and of indices from the fuzzer.
        let n = u16::try_from(points.len()).unwrap_or(0);
        for i in 2..n {
            let _ = out.push([i - 2, i - 1, i]);
            let _ = out.push([i, i / 2, i / 3]);
            let _ = out.push([0; 3].map(|_| u16::from(self.input.byte())));
        }
        StageStats::default()
    }
}

/// Runs the target on one input.
pub fn finder(data: &[u8]) {
    let mut input = Input(data);
    let models = models();
    let model = Model::parse(&models[usize::from(input.byte()) % models.len()]).expect("it was trained");
    let keypoints = usize::from(input.byte());
    let narrow = input.byte() % 4 > 0;
    let frame = Frame::new(PixelFormat::Rgb8, PICTURE.0, PICTURE.1, picture()).expect("it has this size");
    let mut detector = detector();
    let mut finder = Foreign { input, keypoints, narrow };
    detector.detect_with(&frame, &model, 0.0, &mut || 0, &mut finder).expect("it fits the profile");
    check(&detector, &model);
}
