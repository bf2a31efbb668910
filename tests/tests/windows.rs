//! Windows of frames, and rows with bytes between them: pixels that are not copied give what their
//! copies give, in planes and in detections.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::sync::Mutex;

use keygraph::input::{Pixels, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::sensor::sense;
use keygraph_core::{DEFAULT_THRESHOLD, Detection, Frame, Model, PixelFormat, VgaDetector, Window};
use keygraph_tests::file;

/// Returns the planes of a frame of any size.
fn all_planes(frame: &Frame<'_>) -> (Vec<u8>, Vec<i8>, Vec<i8>) {
    let (w, h) = (frame.width(), frame.height());
    let (mut l, mut a, mut b) = (vec![0; w * h], vec![0; (w / 2) * (h / 2)], vec![0; (w / 2) * (h / 2)]);
    frame.convert(&mut l, &mut a, &mut b);
    (l, a, b)
}

/// A frame with rows of padding, of which windows are taken.
struct Padded {
    format: PixelFormat,
    size: [usize; 2],
    stride: usize,
    data: Vec<u8>,
}

impl Padded {
    fn new(format: PixelFormat, size: [usize; 2], padding: usize) -> Self {
        let stride = format.row_bytes(size[0]) + padding;
        let data = (0..3 * stride * size[1]).map(|i| (i as u32).wrapping_mul(2_654_435_761).to_be_bytes()[0]);
        Self { format, size, stride, data: data.collect() }
    }

    fn frame(&self) -> Frame<'_> {
        Frame::with_stride(self.format, self.size[0], self.size[1], self.stride, &self.data).unwrap()
    }

    /// Copies the rows of a window, plane by plane.
    fn copied(&self, window: Window) -> Vec<u8> {
        let Window { x, y, width, height } = window;
        let mut out = Vec::new();
        let mut plane = |start: usize, stride: usize, [x, y]: [usize; 2], [bytes, rows]: [usize; 2]| {
            (y..y + rows).for_each(|y| out.extend(&self.data[start + y * stride + x..][..bytes]));
        };
        let (stride, luma) = (self.stride, self.stride * self.size[1]);
        plane(0, stride, [self.format.row_bytes(x), y], [self.format.row_bytes(width), height]);
        match self.format {
            PixelFormat::Nv12 => plane(luma, stride, [x, y / 2], [width, height / 2]),
            PixelFormat::I420 => [luma, luma + luma / 4]
                .into_iter()
                .for_each(|start| plane(start, stride / 2, [x / 2, y / 2], [width / 2, height / 2])),
            _ => {}
        }
        out
    }
}

#[test]
fn a_window_gives_the_planes_of_its_pixels_copied_out() {
    for format in PixelFormat::ALL {
        for padding in [0, 2, 26] {
            let padded = Padded::new(format, [64, 40], padding);
            for (x, y, width, height) in
                [(0, 0, 64, 40), (0, 0, 64, 16), (2, 4, 16, 16), (46, 22, 18, 18), (8, 24, 56, 16)]
            {
                let window = Window { x, y, width, height };
                let copied = padded.copied(window);
                let expected = all_planes(&Frame::new(format, width, height, &copied).unwrap());
                let seen = padded.frame().window(window).unwrap();
                assert_eq!(all_planes(&seen), expected, "{format:?} with {padding}: {window:?}");
                let mut luma = vec![0; width * height];
                seen.convert_luma(&mut luma);
                assert_eq!(luma, expected.0, "luma alone, {format:?} with {padding}: {window:?}");
            }
        }
    }
}

#[test]
fn a_window_of_a_window_is_a_window() {
    for format in PixelFormat::ALL {
        let padded = Padded::new(format, [64, 48], 6);
        let outer = padded.frame().window(Window { x: 4, y: 8, width: 50, height: 36 }).unwrap();
        let inner = outer.window(Window { x: 6, y: 2, width: 40, height: 20 }).unwrap();
        let direct = padded.frame().window(Window { x: 10, y: 10, width: 40, height: 20 }).unwrap();
        assert_eq!(all_planes(&inner), all_planes(&direct), "{format:?}");
    }
}

static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());

/// Searches a frame for the astronaut.
fn search(frame: &Frame<'_>, model: &Model<'_>) -> Vec<Detection> {
    DETECTOR.lock().unwrap().detect(frame, model, DEFAULT_THRESHOLD, &mut || 0).unwrap().to_vec()
}

#[test]
fn a_window_is_searched_as_its_pixels_copied_out_and_told_in_px_of_the_frame() {
    let picture = read_picture(&file("assets/pictures/astronaut.jpg")).unwrap();
    let (bytes, _) = train(&picture, "astronaut", Preset::Compact, false).unwrap();
    let model = Model::parse(&bytes).unwrap();
    let Pixels::Rgb8(rgb) = read_picture(&file("assets/sequence/0000.jpg")).unwrap().pixels else { panic!("no RGB") };
    for format in [PixelFormat::Uyvy, PixelFormat::Rgb565Be, PixelFormat::Nv12] {
        let (_, _, data) = sense(PixelFormat::Rgb8, (640, 480), &rgb, format);
        let padded = Padded { format, size: [640, 480], stride: format.row_bytes(640), data };
        let whole = search(&padded.frame(), &model);
        let [of_whole] = &whole[..] else { panic!("{format:?}: {whole:?}") };
        let [[least_x, most_x], [least_y, most_y]] = [0, 1].map(|i| {
            let along = of_whole.corners.map(|p| p[i]);
            [along.iter().copied().fold(f32::MAX, f32::min), along.iter().copied().fold(0.0, f32::max)]
        });
        // The object, with a margin of 12 px.
        let (x, y) = ((least_x as usize - 12) & !1, (least_y as usize - 12) & !1);
        let (right, bottom) = ((most_x as usize + 12).min(640) & !1, (most_y as usize + 12).min(480) & !1);
        let window = Window { x, y, width: right - x, height: bottom - y };
        let found = search(&padded.frame().window(window).unwrap(), &model);
        let copied = padded.copied(window);
        assert_eq!(found, search(&Frame::new(format, window.width, window.height, &copied).unwrap(), &model));
        let [of_window] = &found[..] else { panic!("{format:?}: {found:?}") };
        let mapped = of_window.mapped(&window.to_frame());
        for (i, (a, b)) in mapped.corners.iter().zip(of_whole.corners).enumerate() {
            let off = (a[0] - b[0]).hypot(a[1] - b[1]);
            assert!(off < 2.0, "{format:?}: corner {i} is {off} px away from {b:?}");
        }
        let outline = mapped.homography.outline(picture.width as f32, picture.height as f32);
        for (a, b) in mapped.corners.iter().zip(outline) {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.01, "{format:?}: {a:?} is not {b:?}");
        }
    }
}
