//! A searched frame in the form that viewers get: picture and outlines in one piece, so
//! that neither is behind the other.
//!
//! In: a frame, its JSON line, and corners and triangles when they are wanted. Out: a body
//! of bytes for the page, and the line for programs. The body, little endian:
//!
//! | bytes | |
//! | --- | --- |
//! | 4 | length of the header |
//! | that length | header: `{"number", "jpeg": bytes, "corners": n, "keygraphs": n, "votes": n, "seen": [{"object", "ms"}, ...], "line": {...}}` |
//! | `jpeg` | the picture, a JPEG |
//! | 4 x `corners` | x and y, `i16`, quarter pixels |
//! | 12 x `keygraphs` | three such points each: the triangles that were classified |
//! | 12 x `votes` | the triangles that agree with a detection |
//!
//! A viewer that does not ask for corners and triangles gets a body without them. `seen` has the
//! objects that were seen last, newest first, and the time from then to this frame. Programs
//! that show pictures alone get a JPEG, plain or with outlines in it.
//!
//! Memory: the body, some 60 KB at 640x480, and the other JPEG. Cost: encoding a JPEG, unless
//! the camera gave one; another one with outlines when it is wanted.

use std::ops::Range;
use std::time::{Duration, Instant};

use anyhow::Result;
use axum::body::Bytes;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use serde_json::{Value, json};

use super::Captured;
use crate::annotate::{Canvas, Outline, draw_outlines, draw_part};
use crate::picture::Part;
use crate::search::Found;

/// JPEG quality of pictures for the page, of 100. Models are learned from them.
const QUALITY: u8 = 88;

/// A searched frame that is not encoded yet.
#[derive(Debug)]
pub struct Work {
    /// The frame.
    pub captured: Captured,
    /// The JSON line of the frame, as `--json` prints it.
    pub line: Value,
    /// Corners and triangles, when a viewer wants them.
    pub details: Option<Found>,
    /// Whether a viewer wants the picture.
    pub watched: bool,
    /// The objects that were seen last, newest first, and the time since.
    pub seen: Vec<(String, Duration)>,
    /// What is drawn into a picture, when a viewer wants one.
    pub drawing: Option<Drawing>,
}

/// What is drawn into a picture of a frame.
#[derive(Debug, Default)]
pub struct Drawing {
    /// The part that was searched, if it was not all of the frame.
    pub part: Option<Part>,
    /// The outlines of the detections, with their names.
    pub outlines: Vec<Outline>,
}

/// A searched frame in the form that viewers get.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Index of the frame in its source.
    pub number: u64,
    /// When the frame was captured.
    pub at: Instant,
    /// The JSON line of the frame, without a line break.
    pub line: String,
    /// The body, with corners and triangles if a viewer wanted them; `None` when there was no
    /// viewer.
    pub body: Option<Bytes>,
    /// Length of the body without corners and triangles, bytes.
    pub lean: usize,
    /// The JPEG in the body.
    picture: Range<usize>,
    /// The JPEG with outlines in it, when a viewer wanted one.
    drawn: Option<Bytes>,
}

impl Shot {
    /// The frame as a JPEG, with outlines in it if `drawn`. `None` when nobody wanted it.
    #[must_use]
    pub fn jpeg(&self, drawn: bool) -> Option<Bytes> {
        if drawn { self.drawn.clone() } else { self.body.as_ref().map(|body| body.slice(self.picture.clone())) }
    }

    /// Encodes a searched frame.
    ///
    /// # Errors
    /// When the picture cannot be encoded.
    pub fn new(work: Work) -> Result<Self> {
        let Work { captured, line, details, watched, seen, drawing } = work;
        let (number, at, text) = (captured.number, captured.at, line.to_string());
        let drawn = drawing.map(|drawing| draw(&captured, &drawing)).transpose()?;
        if !watched {
            return Ok(Self { number, at, line: text, body: None, lean: 0, picture: 0..0, drawn });
        }
        let jpeg = match captured.jpeg {
            Some(jpeg) => jpeg,
            None => encode(&Canvas::from_picture(&captured.picture))?,
        };
        let none = Found::default();
        let found = details.as_ref().unwrap_or(&none);
        let votes = found.supporters.iter().flatten();
        let seen = seen.iter().map(|(name, since)| json!({"object": name, "ms": since.as_millis()}));
        let header = json!({
            "number": number,
            "jpeg": jpeg.len(),
            "corners": found.corners.len(),
            "keygraphs": found.keygraphs.len(),
            "votes": votes.clone().count(),
            "seen": seen.collect::<Vec<_>>(),
            "line": line,
        })
        .to_string();
        let mut body = u32::try_from(header.len())?.to_le_bytes().to_vec();
        body.extend(header.as_bytes());
        let start = body.len();
        body.extend(&jpeg);
        let lean = body.len();
        for p in found.corners.iter().chain(found.keygraphs.iter().chain(votes).flatten()) {
            body.extend(p.map(quarter_px).as_flattened());
        }
        Ok(Self { number, at, line: text, body: Some(body.into()), lean, picture: start..lean, drawn })
    }
}

/// A frame as a JPEG with outlines and names in it.
fn draw(captured: &Captured, drawing: &Drawing) -> Result<Bytes> {
    let mut canvas = Canvas::from_picture(&captured.picture);
    if let Some(part) = drawing.part {
        draw_part(&mut canvas, part);
    }
    draw_outlines(&mut canvas, &drawing.outlines);
    Ok(encode(&canvas)?.into())
}

#[allow(clippy::cast_possible_truncation, reason = "a cast saturates, beyond any frame")]
fn quarter_px(v: f32) -> [u8; 2] {
    ((v * 4.0).round() as i16).to_le_bytes()
}

fn encode(canvas: &Canvas) -> Result<Vec<u8>> {
    let mut jpeg = Vec::new();
    let (w, h) = (canvas.width(), canvas.height());
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode(canvas.rgb(), w, h, ExtendedColorType::Rgb8)?;
    Ok(jpeg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::{Picture, Pixels};

    fn work(details: Option<Found>, watched: bool) -> Work {
        let picture = Picture { width: 16, height: 16, pixels: Pixels::Gray8(vec![90; 256]) };
        let captured = Captured { number: 7, at: Instant::now(), picture, jpeg: Some(vec![1, 2, 3]) };
        let seen = vec![("cup".to_string(), Duration::from_millis(1500))];
        Work { captured, line: json!({"frame": 7}), details, watched, seen, drawing: None }
    }

    #[test]
    fn the_body_is_laid_out_as_described() {
        let triangle = [[1.0, 2.0], [3.0, 4.0], [5.0, -0.5]];
        let found = Found {
            corners: vec![[0.25, 10.0]],
            keygraphs: vec![triangle],
            supporters: vec![vec![triangle]; 2],
            ..Found::default()
        };
        let shot = Shot::new(work(Some(found), true)).expect("encodes");
        assert_eq!((shot.jpeg(false).as_deref(), shot.jpeg(true)), (Some(&[1, 2, 3][..]), None));
        let body = shot.body.expect("watched");
        let header = 4 + u32::from_le_bytes(body[..4].try_into().expect("four")) as usize;
        let said: Value = serde_json::from_slice(&body[4..header]).expect("JSON");
        assert_eq!(
            said,
            json!({
                "number": 7, "jpeg": 3, "corners": 1, "keygraphs": 1, "votes": 2,
                "seen": [{"object": "cup", "ms": 1500}], "line": {"frame": 7},
            })
        );
        assert_eq!(body[header..shot.lean], [1, 2, 3]);
        let corner = [1, 0, 40, 0];
        let triangle = [4, 0, 8, 0, 12, 0, 16, 0, 20, 0, 0xFE, 0xFF];
        assert_eq!(body[shot.lean..], [&corner[..], &triangle, &triangle, &triangle].concat());
    }

    #[test]
    fn nothing_is_encoded_for_nobody() {
        let shot = Shot::new(work(None, false)).expect("nothing to fail");
        assert_eq!((shot.jpeg(false), shot.jpeg(true)), (None, None));
        assert_eq!((shot.body, shot.line.as_str()), (None, r#"{"frame":7}"#));
    }

    #[test]
    fn outlines_are_drawn_into_a_jpeg_of_their_own() {
        let outline = Outline {
            corners: [[4.0, 4.0], [12.0, 4.0], [12.0, 12.0], [4.0, 12.0]],
            surface: None,
            label: String::new(),
            colour_index: 0,
        };
        let drawing = Some(Drawing { part: None, outlines: vec![outline] });
        let shot = Shot::new(Work { drawing, ..work(None, false) }).expect("encodes");
        let drawn = image::load_from_memory(&shot.jpeg(true).expect("wanted")).expect("decodes").into_rgb8();
        let green = |x, y| i32::from(drawn.get_pixel(x, y).0[1]) - i32::from(drawn.get_pixel(x, y).0[2]);
        assert!(green(8, 12) > 40 && green(14, 1).abs() < 20, "{} and {}", green(8, 12), green(14, 1));
        assert!(shot.jpeg(false).is_none() && shot.body.is_none(), "nobody wanted these");
    }
}
