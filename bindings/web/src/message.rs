//! Messages of the page and answers to them: a head, which is a JSON object, and bytes.
//!
//! In: the bytes of a message. Out: its head as a structure. Keys that are not known are errors: they are
//! options with a typing error. Memory: the message. Cost: some microseconds.

use serde::Deserialize;
use serde_json::Value;

/// What the page asks for. The keys are those of the options in `js/keygraph.d.ts`.
#[derive(Debug, Deserialize)]
#[serde(tag = "call", rename_all = "lowercase")]
pub enum Head {
    /// Trains on the picture in the bytes.
    Train(Train),
    /// Assesses the picture in the bytes, which come after the model's.
    Assess(Assess),
    /// Reads what the model in the bytes holds.
    Read(Nothing),
    /// Merges the models in the bytes.
    Pack(Pack),
    /// Opens a detector or a tracker for the model in the bytes.
    Open(Box<Open>),
    /// Searches the frame in the bytes, or follows objects into it.
    Look(Look),
    /// Makes the next frame the first of a new sequence.
    Restart(Nothing),
}

/// A call without options.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Nothing {}

/// Pixels in the bytes of a message.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pixels {
    /// `rgba`, `rgb`, `gray` or `i420`.
    pub format: Format,
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

/// The format of pixels: 4, 3, 1 or 1.5 bytes a pixel.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names say it")]
pub enum Format {
    Rgba,
    Rgb,
    Gray,
    I420,
}

/// Options of training.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Train {
    /// The picture.
    pub pixels: Pixels,
    /// Name of the object.
    #[serde(default = "object")]
    pub name: String,
    /// How much the model holds.
    #[serde(default = "large")]
    pub preset: String,
    /// Whether to train on luma alone.
    #[serde(default)]
    pub luma: bool,
    /// The corners of the object in the picture, px, its top left first, then clockwise. Without them the
    /// picture is the object.
    pub outline: Option<[[f32; 2]; 4]>,
}

/// Options of an assessment.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Assess {
    /// The picture, as it was trained on.
    pub pixels: Pixels,
    /// The length of the model, which comes before the picture, bytes.
    pub model: usize,
    /// Size of the frames.
    #[serde(default = "vga")]
    pub profile: String,
    /// Frames for each cell of the table.
    #[serde(default = "eight")]
    pub views: usize,
}

/// Lengths of models in the bytes, one after the other.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pack {
    /// The lengths, bytes.
    pub lengths: Vec<usize>,
}

/// Options of detectors and trackers.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Open {
    /// Whether frames are a sequence, in which objects are followed.
    #[serde(default)]
    pub track: bool,
    /// Size of the frames that are searched.
    #[serde(default = "vga")]
    pub profile: String,
    /// Minimum score.
    pub threshold: Option<f32>,
    /// Minimum share of an object that is seen.
    #[serde(default)]
    pub min_visible: f32,
    /// Whether all of each frame is searched, and again in tiles.
    #[serde(default)]
    pub thorough: bool,
    /// Whether frames are searched for what is seen from far to the side, too.
    #[serde(default)]
    pub wide: bool,
    /// Number of frames over which outlines that stand still are averaged; for trackers.
    #[serde(default)]
    pub smooth: u8,
    /// Whether all names at a place are reported.
    #[serde(default)]
    pub all_names: bool,
    /// Time after which a search is stopped, ms.
    pub budget_ms: Option<f64>,
    /// The part that is searched.
    pub roi: Option<String>,
    /// Whether frames are mirrored before they are searched.
    #[serde(default)]
    pub mirror: bool,
    /// Shape that objects may have.
    #[serde(default = "any")]
    pub surface: String,
    /// Whether digests of all stages are reported.
    #[serde(default)]
    pub digests: bool,
    /// Intrinsics of the camera, px of the frame: fx, fy, cx, cy.
    pub intrinsics: Option<[f32; 4]>,
    /// Coefficients of the lens, in OpenCV's order.
    pub distortion: Option<Vec<f32>>,
    /// Whether they are those of a fisheye lens.
    #[serde(default)]
    pub fisheye: bool,
    /// True widths of the objects, mm: a number for all, or one for each name.
    pub width_mm: Option<Widths>,
}

/// True widths of objects, mm.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub enum Widths {
    /// All objects have this width.
    All(f32),
    /// Each name has its own.
    Named(std::collections::BTreeMap<String, f32>),
}

/// A frame.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// The frame.
    pub pixels: Pixels,
    /// Name of its source in the answer.
    #[serde(default)]
    pub source: String,
    /// Index of the frame in its source.
    #[serde(default)]
    pub frame: u64,
    /// Whether corners, triangles and votes are reported.
    #[serde(default)]
    pub details: bool,
}

fn object() -> String {
    "object".into()
}

fn large() -> String {
    "large".into()
}

fn any() -> String {
    "any".into()
}

fn vga() -> String {
    "vga".into()
}

const fn eight() -> usize {
    8
}

/// An answer.
#[derive(Debug, Default)]
pub struct Answer {
    bytes: Vec<u8>,
    head: usize,
}

impl Answer {
    /// An answer without bytes.
    pub fn of(head: &Value) -> Self {
        let bytes = head.to_string().into_bytes();
        Self { head: bytes.len(), bytes }
    }

    /// The answer with bytes after those that it has.
    pub fn with(mut self, bytes: impl IntoIterator<Item = u8>) -> Self {
        self.bytes.extend(bytes);
        self
    }

    /// Head and bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The length of the head, bytes.
    pub const fn head(&self) -> usize {
        self.head
    }
}
