//! Writes frames of the astronaut seen through a lens, with known poses: for `keygraph calibrate`, and for the pictures
//! of `docs/space.md`.
//!
//!     cargo run --release -p keygraph-tests --example lensed -- FOLDER FRAMES SEED FX,FY,CX,CY K1,K2,... [PICTURE]
//!
//! Four coefficients are those of a fisheye lens, five those of Brown and Conrady.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use keygraph::canvas::Canvas;
use keygraph::input::read_picture;
use keygraph::random::Random;
use keygraph_core::{Distortion, Lens};
use keygraph_tests::lensed::Lensed;
use keygraph_tests::motion::astronaut;
use keygraph_tests::scene::FRAME;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, frames, seed, camera, coefficients, picture @ ..] = arguments.as_slice() else {
        panic!("usage: lensed FOLDER FRAMES SEED FX,FY,CX,CY K1,K2,... [PICTURE]");
    };
    let numbers = |text: &str| text.split(',').map(|n| n.parse().unwrap()).collect::<Vec<f32>>();
    let (camera, k) = (numbers(camera), numbers(coefficients));
    let distortion = match *k.as_slice() {
        [a, b, c, d] => Distortion::Fisheye([a, b, c, d]),
        [a, b, c, d, e] => Distortion::Brown([a, b, c, d, e, 0.0, 0.0, 0.0]),
        _ => panic!("four or five coefficients"),
    };
    let lens = Lens::new(camera.try_into().unwrap(), distortion).unwrap();
    let picture = picture.first().map_or_else(astronaut, |path| read_picture(Path::new(path)).unwrap());
    let mut random = Random::new(seed.parse().unwrap());
    std::fs::create_dir_all(folder).unwrap();
    let mut between = |least: f32, most: f32| random.between(least, most);
    for i in 0..frames.parse::<usize>().unwrap() {
        let px = between(220.0, 420.0);
        let depth = lens.intrinsics()[0] / px;
        // In the middle of the frame, and in turn near each of its corners.
        let near = [[0.5, 0.5], [0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]][i % 5];
        let [x, y] = [0, 1].map(|k| (near[k] + between(-0.08, 0.08)) * FRAME[k] as f32);
        let [fx, fy, cx, cy] = lens.intrinsics();
        let ideal = lens.undistort([x, y]).unwrap();
        let middle = [(ideal[0] - cx) / fx * depth, (ideal[1] - cy) / fy * depth, depth];
        let turn = [between(-0.7, 0.7), between(-0.7, 0.7), between(-3.1, 3.1)];
        let frame = Lensed { picture: &picture, lens, turn, middle }.frame();
        Canvas::from_picture(&frame).save(&Path::new(folder).join(format!("{i:03}.png"))).unwrap();
    }
}
