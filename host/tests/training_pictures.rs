//! Training pictures as people take them: large, small, gray, cut out, on a table, upside
//! down.
//!
//! In: pictures made from those of the repository. Out: the object is found in a frame at
//! the right place; or the picture is refused, or trained with a warning, and the message
//! says what to do.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod program;

use std::ffi::OsStr;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, GrayImage, ImageEncoder, Rgb, RgbImage, Rgba, RgbaImage};
use program::{CLEAR, Folder, Map, Run, keygraph, numbers, photograph, picture, pixels};
use serde_json::Value;

/// Map from the astronaut (512 x 512 px) to the frame: some 200 px wide, turned by 25
/// degrees and tilted.
const SHOWN: Map = [0.38, -0.16, 220.0, 0.17, 0.36, 110.0, 1e-4, -5e-5, 1.0];
const SIDE: f64 = 512.0;

fn train(picture: &Path, options: &[&str]) -> (PathBuf, Run) {
    let model = picture.with_extension("kgm");
    let mut arguments: Vec<&OsStr> = vec!["train".as_ref(), picture.as_ref(), "-o".as_ref(), model.as_ref()];
    arguments.extend(["--preset", "compact", "--json"].iter().chain(options).map(OsStr::new));
    let run = keygraph(&arguments);
    (model, run)
}

/// What was said on standard error, besides where the model is.
fn advice(run: &Run) -> String {
    run.err.lines().filter(|line| !line.starts_with("keygraph: written: ")).collect()
}

/// Runs `detect --json` on one frame.
fn detect(model: &Path, frame: &Path) -> Run {
    keygraph(&["detect".as_ref(), "-m".as_ref(), model.as_os_str(), frame.as_ref(), "--json".as_ref()]).ended_with(0)
}

fn apply(m: &Map, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = m[6] * x + m[7] * y + m[8];
    [(m[0] * x + m[1] * y + m[2]) / w, (m[3] * x + m[4] * y + m[5]) / w]
}

/// Renders a frame that shows the astronaut at `map`, and returns the only detection in it.
#[track_caller]
fn find(folder: &Folder, model: &Path, map: &Map) -> Value {
    let frame = folder.join("frame.png");
    photograph("astronaut", map, (640, 480), &CLEAR, &frame);
    let run = detect(model, &frame);
    let found = run.lines()[0]["detections"].as_array().unwrap().clone();
    assert_eq!(found.len(), 1, "detections: {}", run.out);
    found[0].clone()
}

/// Asserts that the corners lie where `map` puts those of the part from `(x, y)` to
/// `(x1, y1)`. The mean error is below 2 % of the part's size.
#[track_caller]
fn assert_corners(found: &Value, map: &Map, [x, y, x1, y1]: [f64; 4]) {
    let truth = [[x, y], [x1, y], [x1, y1], [x, y1]].map(|p| apply(map, p));
    let corners: Vec<[f64; 2]> = found["corners"].as_array().unwrap().iter().map(numbers::<2>).collect();
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let error = truth.iter().zip(&corners).map(|(a, b)| distance(*a, *b)).sum::<f64>() / 4.0;
    let size = distance(truth[0], truth[2]) / 2f64.sqrt();
    assert!(error < 0.02 * size, "{error:.1} px off, of {size:.0}: {corners:?}, not {truth:?}");
}

/// Asserts that the astronaut's whole picture is found at its place.
#[track_caller]
fn assert_found(folder: &Folder, model: &Path) {
    assert_corners(&find(folder, model, &SHOWN), &SHOWN, [0.0, 0.0, SIDE, SIDE]);
}

/// Width and height of the only object of a model, as `train --json` reports them.
fn trained_size(run: &Run) -> (u64, u64) {
    let object = &run.lines()[0]["objects"][0];
    (object["width"].as_u64().unwrap(), object["height"].as_u64().unwrap())
}

#[test]
fn a_picture_4000_px_wide() {
    let folder = Folder::new("4000");
    let path = folder.join("large.jpg");
    imageops::resize(&pixels(&picture("astronaut")), 4000, 4000, FilterType::CatmullRom).save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    let run = run.ended_with(0);
    assert_eq!((advice(&run).as_str(), trained_size(&run)), ("", (4000, 4000)));
    assert_found(&folder, &model);
}

#[test]
fn a_picture_of_120_px() {
    let folder = Folder::new("120");
    let path = folder.join("small.png");
    imageops::resize(&pixels(&picture("astronaut")), 120, 120, FilterType::Lanczos3).save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    assert_eq!(advice(&run.ended_with(0)), "");
    assert_found(&folder, &model);
    let small: Map = [0.2, -0.08, 320.0, 0.08, 0.2, 160.0, 0.0, 0.0, 1.0];
    assert_corners(&find(&folder, &model, &small), &small, [0.0, 0.0, SIDE, SIDE]);
}

#[test]
fn a_gray_picture_is_found_in_colour() {
    let folder = Folder::new("gray");
    let path = folder.join("gray.jpg");
    imageops::grayscale(&pixels(&picture("astronaut"))).save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    run.ended_with(0).said(&["no colour", "luma"]);
    assert_found(&folder, &model);
}

/// Orientation 3 is upside down; 6 and 8 are turned by a quarter.
#[test]
fn a_photograph_with_exif_orientation_is_turned_upright() {
    let folder = Folder::new("exif");
    let upright = pixels(&picture("coffee"));
    let map: Map = [0.5, -0.2, 200.0, 0.2, 0.5, 80.0, 0.0, 0.0, 1.0];
    let frame = folder.join("coffee.png");
    photograph("coffee", &map, (640, 480), &CLEAR, &frame);
    for (orientation, stored) in
        [(3, imageops::rotate180(&upright)), (6, imageops::rotate270(&upright)), (8, imageops::rotate90(&upright))]
    {
        let path = folder.join(&format!("exif{orientation}.jpg"));
        // A TIFF header and one entry: tag 0x0112, type short, count 1.
        let mut exif = b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
        exif.extend([orientation, 0, 0, 0, 0, 0, 0]);
        let mut encoder = JpegEncoder::new_with_quality(BufWriter::new(std::fs::File::create(&path).unwrap()), 92);
        encoder.set_exif_metadata(exif).unwrap();
        encoder.write_image(&stored, stored.width(), stored.height(), ExtendedColorType::Rgb8).unwrap();
        let (model, run) = train(&path, &[]);
        assert_eq!(trained_size(&run.ended_with(0)), (600, 400), "orientation {orientation}");
        assert_corners(&detect(&model, &frame).lines()[0]["detections"][0], &map, [0.0, 0.0, 600.0, 400.0]);
    }
}

#[test]
fn a_cut_out_is_trained_on_its_opaque_part() {
    let folder = Folder::new("cut-out");
    let path = folder.join("cut.png");
    let photo = pixels(&picture("astronaut"));
    // The colours of transparent pixels must not matter: they are a busy pattern.
    let cut =
        RgbaImage::from_fn(900, 700, |x, y| match photo.get_pixel_checked(x.wrapping_sub(180), y.wrapping_sub(120)) {
            Some(&Rgb([r, g, b])) => Rgba([r, g, b, 255]),
            None => Rgba([(x * y) as u8, (x * 31) as u8, (y * 17) as u8, 0]),
        });
    cut.save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    let run = run.ended_with(0).said(&["transparent around 180,120,512,512", "outline"]);
    assert_eq!(trained_size(&run), (512, 512));
    assert_found(&folder, &model);

    let nothing = folder.join("nothing.png");
    RgbaImage::from_pixel(300, 300, Rgba([200, 10, 10, 0])).save(&nothing).unwrap();
    let (model, run) = train(&nothing, &[]);
    run.ended_with(1).said(&["nothing.png", "transparent everywhere"]);
    assert!(!model.exists());
}

/// The astronaut's picture on a plain table that is lit from one side.
fn on_a_table() -> RgbImage {
    let photo = pixels(&picture("astronaut"));
    RgbImage::from_fn(1000, 900, |x, y| match photo.get_pixel_checked(x.wrapping_sub(250), y.wrapping_sub(200)) {
        Some(&pixel) => pixel,
        None => {
            let noise = (x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)).wrapping_mul(2_654_435_761) >> 29;
            Rgb([150, 140, 120].map(|v: u32| (v + x / 25 + noise) as u8))
        }
    })
}

#[test]
fn wide_margins_are_told_and_can_be_cropped() {
    let folder = Folder::new("margins");
    let path = folder.join("table.png");
    on_a_table().save(&path).unwrap();

    // Without --crop it is found, with the outline of the whole picture, as the message says.
    let (model, run) = train(&path, &[]);
    let run = run.ended_with(0).said(&["table.png has plain margins", "outline of the whole picture", "--crop "]);
    assert_eq!(trained_size(&run), (1000, 900));
    assert_corners(&find(&folder, &model, &SHOWN), &SHOWN, [-250.0, -200.0, 750.0, 700.0]);

    // With the --crop of the message it has the object's own outline, without a message.
    let crop = run.err.split("--crop ").nth(1).unwrap().split_whitespace().next().unwrap().to_string();
    let advised: Vec<f64> = crop.split(',').map(|n| n.parse().unwrap()).collect();
    for (a, b) in advised.iter().zip([250.0, 200.0, 512.0, 512.0]) {
        assert!((a - b).abs() <= 10.0, "--crop {crop}, and the print lies at 250,200,512,512");
    }
    let (model, run) = train(&path, &["--crop", "250,200,512,512"]);
    let run = run.ended_with(0);
    assert_eq!((advice(&run).as_str(), trained_size(&run)), ("", (512, 512)));
    assert_found(&folder, &model);
}

#[test]
fn a_crop_that_is_none_is_refused() {
    let folder = Folder::new("crop");
    let path = folder.join("photo.png");
    pixels(&picture("astronaut")).save(&path).unwrap();
    for crop in ["1,2,3", "0,0,0,10", "a,b,c,d", "-1,0,10,10"] {
        train(&path, &["--crop", crop]).1.ended_with(2).said(&["x,y,width,height"]);
    }
    let (model, run) = train(&path, &["--crop", "400,0,200,200"]);
    run.ended_with(1).said(&["400,0,200,200", "photo.png", "512x512 px"]);
    assert!(!model.exists());
}

#[test]
fn a_picture_without_anything_is_refused() {
    let folder = Folder::new("flat");
    let path = folder.join("flat.png");
    let shaded = GrayImage::from_fn(400, 300, |x, y| [(80 + (x + y) / 10) as u8].into());
    shaded.save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    run.ended_with(1).said(&["flat.png", "too little to hold on to", "more texture"]);
    assert!(!model.exists());
}

#[test]
fn a_poor_picture_is_trained_with_a_warning_that_says_what_to_do() {
    let folder = Folder::new("poor");
    let photo = pixels(&picture("astronaut"));
    for (name, picture, words) in [
        ("blurred.png", imageops::blur(&photo, 12.0), ["little to hold on to", "sharper"]),
        (
            "tiny.png",
            imageops::resize(&photo, 40, 40, FilterType::Lanczos3),
            ["little to hold on to", "120 px or more"],
        ),
        (
            "long.png",
            imageops::crop_imm(&photo, 0, 200, 512, 30).to_image(),
            ["little to hold on to", "less elongated"],
        ),
        (
            "slim.png",
            imageops::crop_imm(&photo, 0, 200, 512, 100).to_image(),
            ["missed where it is seen small", "less elongated"],
        ),
    ] {
        let path = folder.join(name);
        picture.save(&path).unwrap();
        let (model, run) = train(&path, &[]);
        run.ended_with(0).said(&[name]).said(&words);
        assert!(model.exists(), "{name}");
    }
}

/// A soft picture has few keygraphs, which training must share out among the views.
#[test]
fn a_soft_picture_is_trained() {
    let folder = Folder::new("soft");
    let path = folder.join("soft.png");
    imageops::blur(&pixels(&picture("astronaut")), 9.0).save(&path).unwrap();
    let (model, run) = train(&path, &[]);
    let _ = run.ended_with(0);
    assert!(model.exists());
}

#[test]
fn good_pictures_are_trained_without_advice() {
    let folder = Folder::new("good");
    for name in ["astronaut", "coffee", "rocket", "chelsea", "hubble"] {
        let copy = folder.join(name).with_extension("jpg");
        std::fs::copy(picture(name), &copy).unwrap();
        let run = train(&copy, &[]).1.ended_with(0);
        assert_eq!(advice(&run), "", "{name}");
    }
}
