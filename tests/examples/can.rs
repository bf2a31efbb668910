//! Writes a frame of the astronaut as a label on a can: for the picture of `docs/space.md`.
//!
//!     cargo run --release -p keygraph-tests --example can -- FILE TURN SPIN LEAN (degrees)
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use keygraph::canvas::Canvas;
use keygraph_tests::can::Can;
use keygraph_tests::motion::astronaut;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, turn, spin, lean] = arguments.as_slice() else { panic!("usage: can FILE TURN SPIN LEAN") };
    let radians = |text: &str| text.parse::<f32>().unwrap().to_radians();
    let can = Can { picture: &astronaut(), turn: radians(turn), spin: radians(spin), lean: radians(lean) };
    Canvas::from_picture(&can.frame()).save(Path::new(file)).unwrap();
}
