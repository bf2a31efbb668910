//! Tests parameters with which no picture can be trained. Training must refuse them with a message.
//! It must not panic, and it must not write a model that cannot be read.
#![allow(clippy::unwrap_used)]

use keygraph_core::{FeatureKind, Method, Model, QqvgaTrainer, TrainError, TrainParams, Trained, ViewSpec};
use keygraph_tests::small_picture;

const FRONT: ViewSpec = ViewSpec { side_px: 96.0, squeeze: 1.0, direction_deg: 0.0, keypoints: 40 };

fn train(view: ViewSpec, original: (u32, u32), model: &mut [u8]) -> Result<Trained, TrainError> {
    let views = [FRONT, view];
    let params = TrainParams::new("astronaut", Method::Keygraph, FeatureKind::Both, &views).capped(60, 50);
    Box::<QqvgaTrainer>::default().train(&small_picture().frame(), original, &params, model)
}

/// Regression: in views almost edge on, the pixels of a picture lay beyond the range of `i32`.
#[test]
fn views_that_are_none_are_refused() {
    let mut model = vec![0; 1 << 16];
    for (what, view) in [
        ("edge on", ViewSpec { squeeze: 0.0, direction_deg: 45.0, ..FRONT }),
        ("almost edge on", ViewSpec { squeeze: 1e-9, direction_deg: 45.0, ..FRONT }),
        ("from behind", ViewSpec { squeeze: -1.0, ..FRONT }),
        ("stretched", ViewSpec { squeeze: 1e9, ..FRONT }),
        ("of no squeeze", ViewSpec { squeeze: f32::NAN, ..FRONT }),
        ("of no size", ViewSpec { side_px: f32::NAN, ..FRONT }),
        ("of size zero", ViewSpec { side_px: 0.0, ..FRONT }),
        ("turned for ever", ViewSpec { direction_deg: f32::INFINITY, ..FRONT }),
    ] {
        let result = train(view, (128, 64), &mut model).map(|t| t.bytes);
        assert_eq!(result, Err(TrainError::Views), "a view {what}");
    }
    assert!(TrainError::Views.to_string().contains("squeeze from 0.01 to 1"));
}

/// Training must render the steepest view that it accepts.
#[test]
fn the_steepest_view_is_trained() {
    let mut model = vec![0; 1 << 16];
    for direction_deg in [0.0, 45.0, 90.0, -1e30] {
        let view = ViewSpec { squeeze: 0.01, direction_deg, ..FRONT };
        let bytes = train(view, (128, 64), &mut model).unwrap().bytes;
        assert!(Model::parse(&model[..bytes]).is_ok(), "{direction_deg} degrees");
    }
}

/// Regression: training wrote a model of a picture without width, which could not be read again.
#[test]
fn originals_that_no_model_holds_are_refused() {
    let mut model = vec![0; 1 << 16];
    for (width, height) in [(0, 64), (128, 0), (1 << 20 | 1, 64), (128, u32::MAX)] {
        let error = train(FRONT, (width, height), &mut model).map(|t| t.bytes).unwrap_err();
        assert_eq!(error, TrainError::Original { width, height });
        assert!(error.to_string().contains(&format!("{width}x{height} px")), "{error}");
    }
    for original in [(1, 1), (1 << 20, 1 << 20), (1 << 20, 1)] {
        let bytes = train(FRONT, original, &mut model).unwrap().bytes;
        assert!(Model::parse(&model[..bytes]).is_ok(), "{original:?}");
    }
}
