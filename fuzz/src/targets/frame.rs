//! any pixels in any format as a frame. The search must not panic.
//!
//! In: the model to use, format, width, height, pixels. Out: nothing. Cost: one qqvga frame.

use crate::{Input, check, detector, frame_bytes, models};
use keygraph_core::{Frame, Model};

/// Runs the target on one input.
pub fn frame(data: &[u8]) {
    let mut input = Input(data);
    let models = models();
    let model = Model::parse(&models[usize::from(input.byte()) % models.len()]).expect("it was trained");
    let (format, w, h, pixels) = frame_bytes(&mut input, (160, 120));
    let frame = Frame::new(format, w, h, &pixels).expect("it has this size");
    let mut detector = detector();
    detector.detect(&frame, &model, 0.0, &mut || 0).expect("it fits the profile");
    check(&detector, &model);
}
