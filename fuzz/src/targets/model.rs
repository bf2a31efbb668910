//! any bytes as a model. The parser must refuse them, or the search must not panic.
//!
//! In: bytes. Their header is mended so that it looks like the header of a model. Out: nothing. An
//! accepted model is searched for in a frame that shows the object of the seeds, or in a frame of
//! noise; the checksum selects which. The model is then packed with itself, and the pack and its slim form are
//! searched for too. Each of its objects is packed alone. Cost: three qqvga frames.

use std::sync::LazyLock;

use crate::{PICTURE, check, detector, mend, picture};
use keygraph_core::{Frame, Model, Part, PixelFormat, pack, pack_parts, packed_len, packed_parts_len, slim, slim_len};

const NOISE: (usize, usize) = (96, 64);

static NOISY: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut seed = 1u32;
    let mut next = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 24) as u8
    };
    (0..NOISE.0 * NOISE.1 * 2).map(|_| next()).collect()
});

/// Runs the target on one input.
pub fn model(data: &[u8]) {
    if let Err(e) = Model::parse(data) {
        assert!(!e.to_string().is_empty());
    }
    let mut bytes = data.to_vec();
    mend(&mut bytes);
    let Ok(model) = Model::parse(&bytes) else { return };
    // One model in four is searched for in noise. The others have matches to work on.
    let frame = match bytes[12] % 4 {
        0 => Frame::new(PixelFormat::Yuyv, NOISE.0, NOISE.1, &NOISY),
        _ => Frame::new(PixelFormat::Rgb8, PICTURE.0, PICTURE.1, picture()),
    };
    let frame = frame.expect("it has this size");
    let mut detector = detector();
    detector.detect(&frame, &model, 0.0, &mut || 0).expect("it fits the profile");
    check(&detector, &model);
    if let Ok(n) = packed_len(&[model, model]) {
        let mut packed = vec![0; n];
        assert_eq!(pack(&[model, model], &mut packed), Ok(n));
        let both = Model::parse(&packed).expect("packing keeps models whole");
        assert_eq!(both.objects(), 2 * model.objects());
        // A pack is searched by its lists.
        detector.detect(&frame, &both, 0.0, &mut || 0).expect("it fits the profile");
        check(&detector, &both);
        if let Ok(n) = slim_len(&both) {
            let mut lists = vec![0; n];
            assert_eq!(slim(&both, &mut lists), Ok(n));
            let lists = Model::parse(&lists).expect("its lists are whole");
            detector.detect(&frame, &lists, 0.0, &mut || 0).expect("it fits the profile");
            check(&detector, &lists);
        }
    }
    for object in 0..model.objects() {
        let Some(part) = Part::of(model, object..object + 1) else { continue };
        let Ok(n) = packed_parts_len(std::slice::from_ref(&part), usize::MAX) else { continue };
        let mut alone = vec![0; n];
        assert_eq!(pack_parts(&[part], usize::MAX, &mut alone), Ok(n));
        assert_eq!(Model::parse(&alone).expect("a part is whole").objects(), 1);
    }
}
