//! What the tests share: paths, pictures, small models and the places of a
//! model's sections, worked out from `docs/model-format.md` and not from core.

pub mod boards;
pub mod motion;

use std::path::{Path, PathBuf};

use keygraph_core::capacity::{chroma_bytes, luma_bytes};
use keygraph_core::feature::FeatureKind;
use keygraph_core::frame::{Frame, PixelFormat};
use keygraph_core::model::{Method, crc32};
use keygraph_core::train::{TrainParams, Trained, Trainer, ViewSpec};

/// A file of the repository.
#[must_use]
pub fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// Part of a picture, as RGB.
#[derive(Clone, Debug)]
pub struct Crop {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// `width * height` times red, green, blue.
    pub rgb: Vec<u8>,
}

impl Crop {
    /// `width` x `height` px of `assets/pictures/NAME` from column `x`, row `y`.
    ///
    /// # Panics
    /// When there is no such picture, or the part reaches beyond it.
    #[must_use]
    #[allow(clippy::unwrap_used, reason = "a missing picture ends the test")]
    pub fn of(name: &str, [x, y]: [u32; 2], [width, height]: [u32; 2]) -> Self {
        let picture = image::open(file("assets/pictures").join(name)).unwrap();
        let crop = picture.crop_imm(x, y, width, height).into_rgb8();
        assert_eq!(crop.dimensions(), (width, height), "{name} is smaller");
        Self { width: width as usize, height: height as usize, rgb: crop.into_raw() }
    }

    /// The part as a frame.
    ///
    /// # Panics
    /// When it is smaller than a frame may be.
    #[must_use]
    #[allow(clippy::unwrap_used, reason = "a wrong crop ends the test")]
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(PixelFormat::Rgb8, self.width, self.height, &self.rgb).unwrap()
    }
}

/// The picture of the small models: 128 x 64 px of the astronaut, so that a
/// template has 96 x 48.
#[must_use]
pub fn small_picture() -> Crop {
    Crop::of("astronaut.jpg", [160, 60], [128, 64])
}

/// A model of [`small_picture`] with two views of up to `keypoints` corners: some
/// ten thousand bytes, so that every byte can be damaged in turn.
///
/// # Panics
/// When the picture cannot be trained.
#[must_use]
#[allow(clippy::unwrap_used, reason = "training is tested elsewhere")]
pub fn small_model(method: Method, feature: FeatureKind, keypoints: u8) -> Vec<u8> {
    let picture = small_picture();
    let view = |side_px, squeeze| ViewSpec { side_px, squeeze, direction_deg: 0.0, keypoints };
    let params = TrainParams {
        name: "astronaut",
        method,
        feature,
        views: &[view(128.0, 1.0), view(96.0, 0.8)],
        max_keygraphs: 60,
        max_per_cell: 50,
    };
    let mut trainer: Box<Trainer<{ luma_bytes(128 * 64) }, { chroma_bytes(128 * 64) }, 128, 400>> = Box::default();
    let mut model = vec![0; 1 << 16];
    let Trained { bytes, .. } = trainer.train(&picture.frame(), (128, 64), &params, &mut model).unwrap();
    model.truncate(bytes);
    model
}

/// Where the sections of a model start, from the counts in its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sections {
    /// Object records.
    pub objects: usize,
    /// View records.
    pub views: usize,
    /// Keypoint records.
    pub keypoints: usize,
    /// Subset table.
    pub cells: usize,
    /// Key records.
    pub keys: usize,
    /// Vertex records.
    pub vertices: usize,
    /// Features.
    pub features: usize,
    /// Sketches.
    pub sketches: usize,
    /// Templates.
    pub templates: usize,
    /// End of the model.
    pub end: usize,
}

impl Sections {
    /// Header bytes.
    pub const HEADER: usize = 44;
    /// Bytes of an object record.
    pub const OBJECT: usize = 56;
    /// Bytes of a view record.
    pub const VIEW: usize = 44;
    /// Bytes of a keypoint record.
    pub const KEYPOINT: usize = 4;
    /// Subsets of a tier.
    pub const CELLS: usize = 864;
    /// Bytes of a key record.
    pub const KEY: usize = 5;
    /// Bytes of a vertex record.
    pub const VERTICES: usize = 5;
    /// Bytes of a sketch.
    pub const SKETCH: usize = 8;

    /// Reads the counts of `model`, which must have a whole header.
    ///
    /// # Panics
    /// When the header is cut off.
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
        // Two lists, and one or two tiers an object.
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

/// The little-endian `u32` at `at`.
///
/// # Panics
/// When it lies beyond the end.
#[must_use]
pub fn read_u32(bytes: &[u8], at: usize) -> u32 {
    (0..4).map(|i| u32::from(bytes[at + i]) << (8 * i)).sum()
}

/// Overwrites the bytes at `at`.
///
/// # Panics
/// When they reach beyond the end.
pub fn put(bytes: &mut [u8], at: usize, new: &[u8]) {
    bytes[at..at + new.len()].copy_from_slice(new);
}

/// Makes length and checksum right again after a change.
///
/// # Panics
/// When the header is cut off.
pub fn seal(model: &mut [u8]) {
    let length = u32::try_from(model.len()).unwrap_or(u32::MAX);
    put(model, 8, &length.to_le_bytes());
    let crc = crc32(&model[16..]);
    put(model, 12, &crc.to_le_bytes());
}
