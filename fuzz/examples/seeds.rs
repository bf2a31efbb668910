//! Writes the first inputs of every fuzz target: real pixels, models and corners.
//!
//! In: a folder. Out: `FOLDER/TARGET/NAME`, a few files for each target. Cost: less than a second.
//! `scripts/fuzz` runs this program.

use std::io::Cursor;
use std::path::Path;
use std::{env, fs, io};

use image::{DynamicImage, ImageFormat, RgbImage};
use keygraph_core::{Frame, Model, PixelFormat};
use keygraph_fuzz::{KINDS, PICTURE, detector, models, packs, picture};

fn main() -> io::Result<()> {
    let folder = env::args().nth(1).unwrap_or_else(|| "seeds".into());
    let write = |target: &str, name: String, bytes: &[u8]| {
        let path = Path::new(&folder).join(target);
        fs::create_dir_all(&path)?;
        fs::write(path.join(name), bytes)
    };
    for (i, bytes) in models().iter().enumerate() {
        write("model", format!("{i}.kgm"), bytes)?;
    }
    for (name, bytes) in ["lists.kgm", "second-tiers.kgm"].into_iter().zip(packs()) {
        write("model", name.into(), &bytes)?;
    }
    let (w, h) = PICTURE;
    let sides = [w, h].map(|v| u8::try_from(v - 16).unwrap_or(0));
    for (f, format) in (0u8..).zip(PixelFormat::ALL) {
        let pixels = convert(format, picture(), w);
        let part: Vec<u8> = picture().chunks(3 * w).flat_map(|row| &row[..3 * 64]).copied().collect();
        let part = convert(format, &part, 64);
        for k in (0u8..).zip(KINDS).map(|(k, _)| k) {
            let head = [k, f, sides[0], sides[1]];
            write("frame", format!("{format:?}-{k}"), &[&head[..], &pixels].concat())?;
            // Three views of 24 keypoints each, from the front and tilted; 200 keygraphs,
            // 50 per subset, 40,000 bytes.
            let views = [24, 96, 255, 0, 24, 80, 180, 30, 24, 64, 255, 0];
            let numbers = [200, 0, 50, 64, 156, 95];
            let head = [&[k | 3 << 6][..], &views, &numbers, &[f, 48, 48]].concat();
            write("picture", format!("{format:?}-{k}"), &[&head[..], &part].concat())?;
        }
    }
    let points = corners();
    write("points", "corners".into(), &[&[25, 60, 1][..], &points].concat())?;
    write("points", "grid".into(), &grid())?;
    for k in (0u8..).zip(KINDS).map(|(k, _)| k) {
        write("finder", format!("corners-{k}"), &[&[k, 40, 1][..], &points].concat())?;
    }
    // Object in view; then it moves, is hidden in part, and comes back.
    let frames: Vec<u8> =
        (0..12u8).flat_map(|i| [90, 1, 10 + 2 * i, 20, [127, 30][usize::from(i == 7)], 0, 0]).collect();
    for k in (0u8..).zip(KINDS).map(|(k, _)| k) {
        write("sequence", format!("moves-{k}"), &[&[k << 4 | k, 128][..], &frames].concat())?;
    }
    for (name, head, bytes) in
        [("mono", "Cmono", 8 * 6), ("420", "C420jpeg", 72), ("422", "C422 F30:1 Ip", 96), ("444", "C444", 144)]
    {
        let frame = [&b"FRAME\n"[..], &picture()[..bytes]].concat();
        let head = format!("YUV4MPEG2 W8 H6 {head}\n");
        write("stream", name.into(), &[head.as_bytes(), &frame, &frame].concat())?;
    }
    for (name, bytes) in files() {
        write("file", name.into(), &bytes)?;
    }
    let lines = "localhost:8080\nhttp://localhost:8080\nBearer 5ecret\n5ecret\n10,10, 90,12,95.5,80,8,70";
    for kind in 0..4 {
        write("request", format!("learn-{kind}"), &[&[kind, 99, 99][..], lines.as_bytes()].concat())?;
    }
    write("request", "token".into(), b"\0\x40\x40[::1]:80\nnull\n\n5ecret\n0,0,64,0,64,64,0,64")?;
    Ok(())
}

/// Returns PNG and JPEG files of a part of the picture: gray, colour, with alpha, and 16 bits.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let rgb: Vec<u8> = picture().chunks(3 * PICTURE.0).take(16).flat_map(|row| &row[..3 * 16]).copied().collect();
    let image = DynamicImage::ImageRgb8(RgbImage::from_raw(16, 16, rgb).expect("it has this size"));
    let png = ImageFormat::Png;
    [
        ("rgb.jpg", image.clone(), ImageFormat::Jpeg),
        ("gray.jpg", image.to_luma8().into(), ImageFormat::Jpeg),
        ("rgb.png", image.clone(), png),
        ("gray.png", image.to_luma8().into(), png),
        ("alpha.png", image.to_rgba8().into(), png),
        ("16.png", image.to_luma_alpha16().into(), png),
    ]
    .into_iter()
    .map(|(name, image, format)| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).expect("it can be encoded");
        (name, file.into_inner())
    })
    .collect()
}

/// Returns the corners of the picture, 4 bytes each.
fn corners() -> Vec<u8> {
    let frame = Frame::new(PixelFormat::Rgb8, PICTURE.0, PICTURE.1, picture()).expect("it has this size");
    let model = Model::parse(&models()[0]).expect("it was trained");
    let mut detector = detector();
    detector.detect(&frame, &model, 0.5, &mut || 0).expect("it fits the profile");
    detector.corners().flat_map(|p| p.map(|v| ((v * 16.0) as u16).to_le_bytes())).flatten().collect()
}

/// Returns points on a grid of eight by eight. Many of them share a line or a circle.
fn grid() -> Vec<u8> {
    let places = (0..64u8).flat_map(|i| [i % 8, 0, i / 8, 0]);
    [25, 64, 3].into_iter().chain(places).collect()
}

/// Converts RGB pixels, `w` per row, to another format. A 2x2 block takes the chroma of its first pixel.
fn convert(format: PixelFormat, rgb: &[u8], w: usize) -> Vec<u8> {
    let h = rgb.len() / 3 / w;
    let at = |x: usize, y: usize| [0, 1, 2].map(|c| i32::from(rgb[3 * (y * w + x) + c]));
    // Conversion of BT.601, limited range.
    let byte = |v: i32| u8::try_from((v + 128) >> 8).unwrap_or(0);
    let luma = |x, y| {
        let [r, g, b] = at(x, y);
        byte(66 * r + 129 * g + 25 * b + (16 << 8))
    };
    let u = |x, y| {
        let [r, g, b] = at(x, y);
        byte(-38 * r - 74 * g + 112 * b + (128 << 8))
    };
    let v = |x, y| {
        let [r, g, b] = at(x, y);
        byte(112 * r - 94 * g - 18 * b + (128 << 8))
    };
    let places = || (0..h).flat_map(move |y| (0..w).map(move |x| (x, y)));
    let blocks = || places().filter(|(x, y)| x % 2 == 0 && y % 2 == 0);
    let yuv = |(x, y): (usize, usize)| [luma(x, y), if x % 2 == 0 { u(x, y) } else { v(x - 1, y) }];
    let rgb565 = |(x, y)| {
        let [r, g, b] = at(x, y);
        let packed = (r >> 3) << 11 | (g >> 2) << 5 | b >> 3;
        [packed.to_le_bytes()[0], packed.to_le_bytes()[1]]
    };
    let swapped = |[a, b]: [u8; 2]| [b, a];
    match format {
        PixelFormat::Rgb8 => rgb.to_vec(),
        PixelFormat::Gray8 => places().map(|(x, y)| luma(x, y)).collect(),
        PixelFormat::Rgb565 => places().flat_map(rgb565).collect(),
        PixelFormat::Rgb565Be => places().map(rgb565).flat_map(swapped).collect(),
        PixelFormat::Yuyv => places().flat_map(yuv).collect(),
        PixelFormat::Uyvy => places().map(yuv).flat_map(swapped).collect(),
        PixelFormat::Nv12 => {
            places().map(|(x, y)| luma(x, y)).chain(blocks().flat_map(|(x, y)| [u(x, y), v(x, y)])).collect()
        }
        PixelFormat::I420 => places()
            .map(|(x, y)| luma(x, y))
            .chain(blocks().map(|(x, y)| u(x, y)))
            .chain(blocks().map(|(x, y)| v(x, y)))
            .collect(),
    }
}
