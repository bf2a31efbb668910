//! Trains on a pattern and finds it in a frame, with the published crate alone: no file, no heap for the search.

use std::error::Error;
use std::sync::Mutex;

use keygraph_core::{DEFAULT_THRESHOLD, Frame, Model, PixelFormat, Preset, QqvgaDetector, QqvgaTrainer};

static TRAINER: Mutex<QqvgaTrainer> = Mutex::new(QqvgaTrainer::new());
static DETECTOR: Mutex<QqvgaDetector> = Mutex::new(QqvgaDetector::new());

fn main() -> Result<(), Box<dyn Error>> {
    // A picture with texture: random blocks.
    let mut seed = 1u32;
    let mut blocks = [0u8; 16 * 12];
    for b in &mut blocks {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *b = (seed >> 24) as u8;
    }
    let picture: Vec<u8> = (0..160 * 120).map(|i| blocks[i / 160 / 10 * 16 + i % 160 / 10]).collect();
    let frame = Frame::new(PixelFormat::Gray8, 160, 120, &picture)?;
    let mut flash = vec![0; 128 << 10];
    let trainer = &mut *TRAINER.lock().map_err(|e| e.to_string())?;
    let trained = trainer.train(&frame, (160, 120), &Preset::Learnt.params("blocks", true), &mut flash)?;
    let model = Model::parse(&flash[..trained.bytes])?;
    let detector = &mut *DETECTOR.lock().map_err(|e| e.to_string())?;
    let found = detector.detect(&frame, &model, DEFAULT_THRESHOLD, &mut || 0)?;
    println!("{} found, score {:.2}", model.object(usize::from(found[0].object)).name, found[0].score);
    Ok(())
}
