//! any picture and any parameters of training. Training must refuse them, or give a
//! model that parses and that the search takes without a panic.
//!
//! In: the kind of model, up to three views, the size of the original, the room for the model, then
//! a picture. Out: nothing. Cost: training on at most 64 x 64 px, and one qqvga frame.

use crate::{Input, KINDS, check, detector, frame_bytes, trainer};
use keygraph_core::{Frame, Model, TrainParams, ViewSpec};

/// Reads a view from the input. With `wild`, its numbers may be any floats.
fn view(input: &mut Input<'_>, wild: bool) -> ViewSpec {
    let keypoints = input.byte() % 40;
    if wild {
        return ViewSpec { side_px: input.float(), squeeze: input.float(), direction_deg: input.float(), keypoints };
    }
    let [side, squeeze, direction] = [0; 3].map(|_| f32::from(input.byte()));
    ViewSpec { side_px: side, squeeze: (1.0 + squeeze) / 256.0, direction_deg: direction * 1.5, keypoints }
}

/// Runs the target on one input.
pub fn picture(data: &[u8]) {
    let mut input = Input(data);
    let choice = input.byte();
    let (method, feature) = KINDS[usize::from(choice) % KINDS.len()];
    let (wild, large) = (choice & 16 > 0, choice & 32 > 0);
    let views: Vec<ViewSpec> = (0..choice >> 6).map(|_| view(&mut input, wild)).collect();
    let (max_keygraphs, max_per_cell, room) =
        (usize::from(input.word()), usize::from(input.byte()), usize::from(input.word()));
    let original = if large { (input.long(), input.long()) } else { (1 + u32::from(input.byte()), 300) };
    let (format, w, h, pixels) = frame_bytes(&mut input, (64, 64));
    let frame = Frame::new(format, w, h, &pixels).expect("it has this size");
    let params = TrainParams::new("any\u{1f4d6}", method, feature, &views).capped(max_keygraphs, max_per_cell);
    let mut out = vec![0; room];
    let trained = match trainer().train(&frame, original, &params, &mut out) {
        Ok(trained) => trained,
        Err(e) => {
            assert!(!e.to_string().is_empty());
            return;
        }
    };
    let model = Model::parse(&out[..trained.bytes]).expect("what was trained is a model");
    assert_eq!(model.keygraphs(), trained.keygraphs.kept as usize);
    let mut detector = detector();
    detector.detect(&frame, &model, 0.0, &mut || 0).expect("it fits the profile");
    check(&detector, &model);
}
