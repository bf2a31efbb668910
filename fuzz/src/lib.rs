//! Parts that the fuzz targets share.
//!
//! In: the fuzzer's bytes. Out: frames, models and pictures made from them, and checks that every
//! result of a detector must pass. Cost: models are trained once per process; a qqvga frame with
//! debug assertions takes some milliseconds.

pub mod targets;

use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

use keygraph_core::stages::model::crc32;
use keygraph_core::{
    Detection, FeatureKind, Frame, Intrinsics, MAGIC, Method, Model, PixelFormat, QqvgaDetector, QqvgaTrainer,
    TrainParams, VERSION, ViewSpec, pack, packed_len, plane_pose,
};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;

/// Every kind of model that training makes. A byte of the fuzzer selects one.
pub const KINDS: [(Method, FeatureKind); 4] = [
    (Method::Keygraph, FeatureKind::Both),
    (Method::Keygraph, FeatureKind::Luma),
    (Method::Keygraph, FeatureKind::Chroma),
    (Method::Paper, FeatureKind::Chroma),
];

/// Width and height of [`picture`], px.
pub const PICTURE: (usize, usize) = (128, 64);

static DETECTOR: Mutex<QqvgaDetector> = Mutex::new(QqvgaDetector::new());
static TRAINER: Mutex<QqvgaTrainer> = Mutex::new(QqvgaTrainer::new());

/// Returns the detector of this process.
pub fn detector() -> MutexGuard<'static, QqvgaDetector> {
    DETECTOR.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the trainer of this process.
pub fn trainer() -> MutexGuard<'static, QqvgaTrainer> {
    TRAINER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns a part of a real photograph, RGB. It is the object of all models.
pub fn picture() -> &'static [u8] {
    static RGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let file = include_bytes!("../../assets/pictures/astronaut.jpg");
        let mut decoder = JpegDecoder::new(ZCursor::new(file));
        let whole = decoder.decode().expect("the asset is a picture");
        let (width, _) = decoder.dimensions().expect("it was decoded");
        let row = |y: usize| &whole[3 * (y * width + 160)..][..3 * PICTURE.0];
        (60..60 + PICTURE.1).flat_map(row).copied().collect()
    });
    &RGB
}

/// Returns a model of [`picture`] for each of [`KINDS`]. Each model has some ten thousand bytes.
pub fn models() -> &'static [Vec<u8>; KINDS.len()] {
    static MODELS: LazyLock<[Vec<u8>; KINDS.len()]> = LazyLock::new(|| KINDS.map(|(m, f)| train(m, f, 90)));
    &MODELS
}

/// Returns models of several objects with lists: without second tiers, and with second tiers.
pub fn packs() -> [Vec<u8>; 2] {
    let large = train(Method::Keygraph, FeatureKind::Luma, 2300);
    let parse = |bytes| Model::parse(bytes).expect("it was trained");
    let (small, large) = (parse(&models()[1]), parse(&large));
    assert!(large.has_second_tiers(), "{} keygraphs", large.keygraphs());
    [packed(&[small, small, small]), packed(&[large, small])]
}

fn packed(models: &[Model<'_>]) -> Vec<u8> {
    let mut out = vec![0; packed_len(models).expect("they are alike")];
    pack(models, &mut out).expect("it has this length");
    let model = Model::parse(&out).expect("packing gives a model");
    assert!(model.has_lists() && model.objects() == models.len());
    let mut mended = out.clone();
    mend(&mut mended);
    assert_eq!(mended, out, "mending leaves a whole pack as it is");
    out
}

fn train(method: Method, feature: FeatureKind, keygraphs: usize) -> Vec<u8> {
    let (w, h) = PICTURE;
    let frame = Frame::new(PixelFormat::Rgb8, w, h, picture()).expect("it has this size");
    let view = |side_px, squeeze| ViewSpec { side_px, squeeze, direction_deg: 0.0, keypoints: 40 };
    let views = [view(128.0, 1.0), view(96.0, 0.8)];
    let params = TrainParams::new("astronaut", method, feature, &views).capped(keygraphs, 50.max(keygraphs / 10));
    let mut model = vec![0; 1 << 18];
    let trained = trainer().train(&frame, (128, 64), &params, &mut model).expect("the picture has texture");
    model.truncate(trained.bytes);
    let mut mended = model.clone();
    mend(&mut mended);
    assert_eq!(mended, model, "mending leaves a whole model as it is");
    model
}

/// Corrects magic, version, lengths, the number of listed keygraphs and checksum, and gives the
/// templates the bytes that the other sections leave. The fuzzer's changes then reach the later
/// checks of the parser. Second tiers and lists stay.
pub fn mend(model: &mut [u8]) {
    if model.len() < 44 {
        return;
    }
    model[..4].copy_from_slice(&MAGIC);
    model[4..6].copy_from_slice(&VERSION.to_le_bytes());
    model[6..8].copy_from_slice(&44u16.to_le_bytes());
    let length = model.len() as u32;
    model[8..12].copy_from_slice(&length.to_le_bytes());
    model[18] &= 6;
    model[19] = 0;
    let (second, lists) = (u64::from(model[18] >> 1 & 1), u64::from(model[18] >> 2));
    let number =
        |at: usize| model.get(at..at + 4).map_or(0, |b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let [objects, views, keypoints, keygraphs] = [20, 24, 28, 32].map(number);
    let feature = match (model[16], model[17]) {
        (0, 1) | (1, 2) => 12,
        (0, 2) | (1, 1) => 24,
        _ => 36,
    };
    let index = 44 + 56 * objects + 44 * views + 4 * keypoints;
    // The entry after the two lists.
    let listed = lists * number(usize::try_from(index + 2 * 3456).unwrap_or(usize::MAX - 4));
    model[40..44].copy_from_slice(&(listed as u32).to_le_bytes());
    let tiers = objects * (1 + second) + 2 * lists;
    let before = index + 3456 * tiers + 4 + (5 + 5 + feature) * keygraphs + 8 * listed;
    if let Some(templates) = (model.len() as u64).checked_sub(before) {
        model[36..40].copy_from_slice(&(templates as u32).to_le_bytes());
    }
    let crc = crc32(&model[16..]);
    model[12..16].copy_from_slice(&crc.to_le_bytes());
}

/// Reads numbers from the front of the fuzzer's bytes, and zeros after their end.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a>(pub &'a [u8]);

impl Input<'_> {
    /// Returns the next byte.
    pub fn byte(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    /// Returns the next two bytes, little endian.
    pub fn word(&mut self) -> u16 {
        u16::from_le_bytes(self.array())
    }

    /// Returns the next four bytes, little endian.
    pub fn long(&mut self) -> u32 {
        u32::from_le_bytes(self.array())
    }

    /// Returns the next four bytes as a float. It may be infinite, tiny, or not a number.
    pub fn float(&mut self) -> f32 {
        f32::from_bits(self.long())
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let (front, rest) = self.0.split_at(N.min(self.0.len()));
        self.0 = rest;
        let mut out = [0; N];
        out[..front.len()].copy_from_slice(front);
        out
    }

    /// Returns `n` bytes: the rest of the input, repeated as often as needed.
    pub fn fill(&self, n: usize) -> Vec<u8> {
        if self.0.is_empty() { vec![0; n] } else { self.0.iter().copied().cycle().take(n).collect() }
    }
}

/// Makes a frame from the fuzzer's bytes: format, width and height first, then pixels. The sides
/// are valid for the format and at most `max`.
pub fn frame_bytes(input: &mut Input<'_>, max: (usize, usize)) -> (PixelFormat, usize, usize, Vec<u8>) {
    let format = PixelFormat::ALL[usize::from(input.byte()) % PixelFormat::ALL.len()];
    let (odd_width, odd_height) = match format {
        PixelFormat::Yuyv | PixelFormat::Uyvy => (0, 1),
        PixelFormat::Nv12 | PixelFormat::I420 => (0, 0),
        _ => (1, 1),
    };
    let mut side = |max: usize, odd: usize| {
        let v = 16 + usize::from(input.byte()) % (max - 15);
        v - (v % 2) * (1 - odd)
    };
    let (w, h) = (side(max.0, odd_width), side(max.1, odd_height));
    (format, w, h, input.fill(format.bytes(w, h)))
}

/// Checks the result of the last frame of `detector`. It must hold for every frame and model.
pub fn check(detector: &QqvgaDetector, model: &Model<'_>) {
    let camera = Intrinsics::new(200.0, 200.0, 80.0, 60.0).expect("these are intrinsics");
    for d in detector.detections() {
        check_detection(d, model);
        let size = model.object(usize::from(d.object));
        let _ = plane_pose(&d.homography, &camera, [size.width as f32, size.height as f32], 100.0);
        for triangle in detector.supporters(model, d) {
            assert!(triangle.iter().flatten().all(|v| v.is_finite()), "a supporter at {triangle:?}");
        }
    }
    assert!(detector.corners().flatten().all(f32::is_finite));
    assert!(detector.keygraphs().flatten().flatten().all(f32::is_finite));
}

fn check_detection(d: &Detection, model: &Model<'_>) {
    assert!(usize::from(d.object) < model.objects(), "object {}", d.object);
    assert!((0.0..=1.0).contains(&d.score), "score {}", d.score);
    assert!(d.homography.0.iter().all(|v| v.is_finite()), "{:?}", d.homography);
    assert!(d.corners.iter().flatten().all(|v| v.is_finite()), "corners {:?}", d.corners);
}
