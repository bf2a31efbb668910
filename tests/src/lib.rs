//! Parts that the tests share: paths, pictures, small models, and the places of a model's sections.
//! The places follow `docs/model-format.md`, and do not use the code of core.

pub mod boards;
pub mod can;
pub mod lensed;
pub mod motion;
pub mod scene;

use std::path::{Path, PathBuf};

use keygraph_core::stages::model::crc32;
use keygraph_core::stages::scrutiny::Scrutiny;
use keygraph_core::{
    Detection, FeatureKind, Frame, Method, Observer, Output, PixelFormat, TrainParams, Trained, Trainer, ViewSpec,
    chroma_bytes, luma_bytes,
};

/// Keeps the poses that a search looks at closely, in their order.
#[derive(Debug, Default)]
pub struct Poses(pub Vec<(Detection, Scrutiny)>);

impl Observer for Poses {
    fn now(&mut self) -> u64 {
        0
    }

    fn saw(&mut self, output: Output<'_>) {
        if let Output::Scrutinised(d, seen) = output {
            self.0.push((*d, *seen));
        }
    }
}

/// Returns the path of a file of the repository.
#[must_use]
pub fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// A part of a picture, RGB.
#[derive(Clone, Debug)]
pub struct Crop {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Pixels in rows: `width * height` times red, green, blue.
    pub rgb: Vec<u8>,
}

impl Crop {
    /// Cuts `width` x `height` px out of `assets/pictures/NAME`, from column `x` and row `y` on.
    ///
    /// # Panics
    /// Panics if there is no such picture, or if the part reaches beyond it.
    #[must_use]
    #[allow(clippy::unwrap_used, reason = "a missing picture ends the test")]
    pub fn of(name: &str, [x, y]: [u32; 2], [width, height]: [u32; 2]) -> Self {
        let picture = image::open(file("assets/pictures").join(name)).unwrap();
        let crop = picture.crop_imm(x, y, width, height).into_rgb8();
        assert_eq!(crop.dimensions(), (width, height), "{name} is smaller");
        Self { width: width as usize, height: height as usize, rgb: crop.into_raw() }
    }

    /// Returns the part as a frame.
    ///
    /// # Panics
    /// Panics if the part is smaller than the smallest frame.
    #[must_use]
    #[allow(clippy::unwrap_used, reason = "a wrong crop ends the test")]
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(PixelFormat::Rgb8, self.width, self.height, &self.rgb).unwrap()
    }
}

/// Returns the picture of the small models: 128 x 64 px of the astronaut. Its template has 96 x 48 px.
#[must_use]
pub fn small_picture() -> Crop {
    Crop::of("astronaut.jpg", [160, 60], [128, 64])
}

/// Trains a model of [`small_picture`] with two views of up to `keypoints` corners each. It has
/// some ten thousand bytes, few enough to damage each byte in turn.
///
/// # Panics
/// Panics if the picture cannot be trained.
#[must_use]
#[allow(clippy::unwrap_used, reason = "training is tested elsewhere")]
pub fn small_model(method: Method, feature: FeatureKind, keypoints: u8) -> Vec<u8> {
    let picture = small_picture();
    let view = |side_px, squeeze| ViewSpec { side_px, squeeze, direction_deg: 0.0, keypoints };
    let views = [view(128.0, 1.0), view(96.0, 0.8)];
    let params = TrainParams::new("astronaut", method, feature, &views).capped(60, 50);
    let mut trainer: Box<Trainer<{ luma_bytes(128 * 64) }, { chroma_bytes(128 * 64) }, 128, 400>> = Box::default();
    let mut model = vec![0; 1 << 16];
    let Trained { bytes, .. } = trainer.train(&picture.frame(), (128, 64), &params, &mut model).unwrap();
    model.truncate(bytes);
    model
}

/// Offsets of the sections of a model, bytes. They are computed from the counts in its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sections {
    /// Start of the object records.
    pub objects: usize,
    /// Start of the view records.
    pub views: usize,
    /// Start of the keypoint records.
    pub keypoints: usize,
    /// Start of the subset table.
    pub cells: usize,
    /// Start of the keys.
    pub keys: usize,
    /// Start of the vertex records.
    pub vertices: usize,
    /// Start of the features.
    pub features: usize,
    /// Start of the sketches.
    pub sketches: usize,
    /// Start of the templates.
    pub templates: usize,
    /// End of the model.
    pub end: usize,
}

impl Sections {
    /// Size of the header, bytes.
    pub const HEADER: usize = 44;
    /// Size of an object record, bytes.
    pub const OBJECT: usize = 56;
    /// Size of a view record, bytes.
    pub const VIEW: usize = 44;
    /// Size of a keypoint record, bytes.
    pub const KEYPOINT: usize = 4;
    /// Number of subsets of a tier.
    pub const CELLS: usize = 864;
    /// Size of a key, bytes.
    pub const KEY: usize = 5;
    /// Size of a vertex record, bytes.
    pub const VERTICES: usize = 5;
    /// Size of a sketch, bytes.
    pub const SKETCH: usize = 8;

    /// Computes the offsets for `model`, which must have a whole header.
    ///
    /// # Panics
    /// Panics if the header is incomplete.
    #[must_use]
    pub fn of(model: &[u8]) -> Self {
        let count = |i: usize| read_u32(model, 20 + 4 * i) as usize;
        let feature_bytes = match (model[16], model[17]) {
            (0, 1) | (1, 2) => 12,
            (0, 2) | (1, 1) => 24,
            _ => 36,
        };
        let objects = Self::HEADER;
        let views = objects + Self::OBJECT * count(0);
        let keypoints = views + Self::VIEW * count(1);
        let cells = keypoints + Self::KEYPOINT * count(2);
        // There are two lists or none, and one or two tiers per object.
        let tiers = usize::from(model[18] & 4) / 2 + count(0) * (1 + usize::from(model[18] & 2) / 2);
        let keys = cells + 4 * (tiers * Self::CELLS + 1);
        let vertices = keys + Self::KEY * count(3);
        let features = vertices + Self::VERTICES * count(3);
        let sketches = features + feature_bytes * count(3);
        let templates = sketches + Self::SKETCH * count(5);
        let end = templates + count(4);
        Self { objects, views, keypoints, cells, keys, vertices, features, sketches, templates, end }
    }
}

/// Reads the little-endian `u32` at offset `at`.
///
/// # Panics
/// Panics if the number lies beyond the end.
#[must_use]
pub fn read_u32(bytes: &[u8], at: usize) -> u32 {
    (0..4).map(|i| u32::from(bytes[at + i]) << (8 * i)).sum()
}

/// Overwrites the bytes from offset `at` on.
///
/// # Panics
/// Panics if the new bytes reach beyond the end.
pub fn put(bytes: &mut [u8], at: usize, new: &[u8]) {
    bytes[at..at + new.len()].copy_from_slice(new);
}

/// Corrects length and checksum after a change.
///
/// # Panics
/// Panics if the header is incomplete.
pub fn seal(model: &mut [u8]) {
    let length = u32::try_from(model.len()).unwrap_or(u32::MAX);
    put(model, 8, &length.to_le_bytes());
    let crc = crc32(&model[16..]);
    put(model, 12, &crc.to_le_bytes());
}
