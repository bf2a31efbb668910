//! Frames that are hard on a search: much to look at, and nothing to find.
//!
//! In: a picture of an object, and the size of the frames. Out: checkerboards, gratings, crossed
//! gratings, noise, dots, a wall of text, corners in a cluster, on a line and on a circle, twelve
//! copies of the object, the object with its parts exchanged, and two copies among ten of those. The
//! same size gives the same pixels
//! on every machine. Memory: a frame. Cost: some ten milliseconds a frame.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use embedded_graphics::mono_font::{MonoTextStyle, ascii};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::{Drawable, Point, RgbColor};
use embedded_graphics::text::Text;

use crate::canvas::Canvas;
use crate::exchange::exchange;
use crate::picture::{Picture, Pixels};
use crate::random::Random;
use crate::render::{Exposure, Pose, Print, Scene};

/// Periods of patterns, px.
const PERIODS: [f32; 9] = [3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0];

/// Writes the frames whose names are `wanted` into a folder, as PNG files. Returns their paths.
///
/// # Errors
/// When a file cannot be written.
pub fn write(picture: &Picture, size: [u32; 2], folder: &Path, wanted: impl Fn(&str) -> bool) -> Result<Vec<PathBuf>> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let mut paths = Vec::new();
    let mut save = |name: &str, make: &mut dyn FnMut() -> Canvas| {
        if wanted(name) {
            let path = folder.join(format!("{name}.png"));
            make().save_png(&path)?;
            paths.push(path);
        }
        Ok(())
    };
    patterns(size, &mut save)?;
    scenes(picture, size, &mut save)?;
    Ok(paths)
}

/// Takes the name of a frame, and what makes it.
type Save<'a> = dyn FnMut(&str, &mut dyn FnMut() -> Canvas) -> Result<()> + 'a;

/// A frame whose pixels are functions of their place.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
fn drawn([width, height]: [u32; 2], mut gray: impl FnMut(f32, f32) -> f32) -> Canvas {
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels = places.map(|(x, y)| gray(x as f32, y as f32).clamp(0.0, 255.0) as u8).collect();
    Canvas::from_picture(&Picture { width, height, pixels: Pixels::Gray8(pixels) })
}

/// Bright where `is`, dark elsewhere.
const fn either(is: bool) -> f32 {
    if is { 225.0 } else { 30.0 }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places in a frame")]
fn patterns(size: [u32; 2], save: &mut Save<'_>) -> Result<()> {
    let odd = |v: f32| v.rem_euclid(2.0) >= 1.0;
    for p in PERIODS {
        save(&format!("checkerboard-{p}"), &mut || drawn(size, |x, y| either(odd(x / p) != odd(y / p))))?;
        save(&format!("grating-{p}"), &mut || drawn(size, |x, y| either(odd((x + 0.3 * y) / p))))?;
        let wave = |v: f32| (v * core::f32::consts::TAU / p).sin();
        save(&format!("crossed-{p}"), &mut || {
            drawn(size, |x, y| 128.0 + 55.0 * (wave(x + 0.2 * y) + wave(y - 0.27 * x)))
        })?;
        let dot = |v: f32| (v / p).fract() - 0.5;
        save(&format!("dots-{p}"), &mut || drawn(size, |x, y| either(dot(x).hypot(dot(y)) < 0.3)))?;
    }
    let at = |x: f32, y: f32, side: f32| Random::of(&[side as u64, (x / side) as u64, (y / side) as u64]);
    save("specks", &mut || drawn(size, |x, y| either(at(x, y, 1.0).unit() < 0.02)))?;
    for side in [1.0, 2.0, 4.0, 8.0] {
        save(&format!("noise-{side}"), &mut || drawn(size, |x, y| at(x, y, side).between(0.0, 255.0)))?;
    }
    // Strong corners in one part of the frame and weak ones elsewhere.
    let weak = |x: f32, y: f32| odd(x / 9.0) != odd(y / 7.0);
    let far = |x: f32, y: f32| {
        if x < size[0] as f32 / 5.0 { either(weak(x, y)) } else { 120.0 + 12.0 * f32::from(u8::from(weak(x, y))) }
    };
    save("clustered", &mut || drawn(size, far))?;
    // Every corner is a little stronger than the one before it.
    let ramp = |x: f32, y: f32| if weak(x, y) { 60.0 + 190.0 * x / size[0] as f32 } else { 50.0 };
    save("ramp", &mut || drawn(size, ramp))?;
    let [w, h] = size.map(|v| v as f32);
    let on_line = |x: f32, y: f32| (y - 0.5 * h - 0.2 * (x - 0.5 * w)).abs() < 5.0 && odd(x / 7.0);
    save("line", &mut || drawn(size, |x, y| either(on_line(x, y))))?;
    let on_circle = |x: f32, y: f32| {
        let (u, v) = (x - 0.5 * w, y - 0.5 * h);
        (u.hypot(v) - 0.4 * h).abs() < 5.0 && odd(v.atan2(u) * 0.4 * h / 7.0)
    };
    save("circle", &mut || drawn(size, |x, y| either(on_circle(x, y))))?;
    save("text", &mut || wall_of_text(size))
}

fn wall_of_text(size: [u32; 2]) -> Canvas {
    let mut wall = drawn(size, |_, _| 240.0);
    for line in 0..size[1] / 10 {
        let letter = |i: u32| char::from(b'!' + ((i * 31 + line * 17 + i * i * line) % 90) as u8);
        let text: String = (0..size[0] / 6).map(letter).collect();
        let place = Point::new(0, 9 + 10 * line.cast_signed());
        Text::new(&text, place, MonoTextStyle::new(&ascii::FONT_6X10, Rgb888::BLACK))
            .draw(&mut wall)
            .unwrap_or_default();
    }
    wall
}

fn scenes(picture: &Picture, size: [u32; 2], save: &mut Save<'_>) -> Result<()> {
    let exchanged = |n: u64| -> Vec<Print> {
        (0..n).map(|i| Print::new(&exchange(picture, 1.0, &mut Random::of(&[n, i])))).collect()
    };
    save("leaves", &mut || scene_of(Vec::new(), size, 1))?;
    save("copies", &mut || scene_of(vec![Print::new(picture); 12], size, 4))?;
    // Two are found, and the frame is searched again for more.
    let crowd = || [vec![Print::new(picture); 2], exchanged(10)].concat();
    save("crowd", &mut || scene_of(crowd(), size, 4))?;
    save("exchanged", &mut || scene_of(exchanged(1), size, 1))?;
    save("exchanged-12", &mut || scene_of(exchanged(12), size, 4))
}

/// A scene with prints in so many columns.
fn scene_of(prints: Vec<Print>, [w, h]: [u32; 2], columns: usize) -> Canvas {
    let mut random = Random::new(prints.len() as u64);
    let mut scene = Scene::dead_leaves(w as usize, h as usize, &mut random);
    let cell = [w as f32 / columns as f32, h as f32 / prints.len().div_ceil(columns) as f32];
    for (i, print) in prints.iter().enumerate() {
        let centre = [(i % columns) as f32 + 0.5, (i / columns) as f32 + 0.5];
        let centre = [centre[0] * cell[0], centre[1] * cell[1]];
        let side_px = 0.8 * cell[0].min(cell[1]);
        let rotation_deg = 25.0 * i as f32;
        scene.lay(print, &Pose { side_px, rotation_deg, tilt_deg: 10.0, axis_deg: 30.0, centre });
    }
    Canvas::from_picture(&scene.expose(&Exposure { gain: 0.9, blur_px: 0.5, noise: 2.0 }, &mut random))
}
