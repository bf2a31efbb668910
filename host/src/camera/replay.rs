//! A file in place of a camera: plays a video or a folder of pictures again and again, at
//! its frame rate.
//!
//! In: a path. Out: frames into the slot, each at its time. As with a camera, a frame does
//! not wait until the frame before it is taken.
//!
//! Memory: one frame. Cost: decoding.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};

use super::Captured;
use super::damage::Damage;
use super::slot::Slot;
use crate::input::{Kind, Source};

/// Default rate of a folder's pictures, frames a second.
const FOLDER_FPS: f64 = 25.0;
/// Maximum delay that the source makes up for. When it is later, it goes on from now.
const PATIENCE: Duration = Duration::from_secs(1);

/// Plays `path` into `frames` until that is closed, at `fps` frames a second or else at the
/// file's own rate. Frames that cannot be read are counted in `damage`.
///
/// # Errors
/// When no frame of the file can be read.
pub fn replay(path: &Path, fps: Option<f64>, frames: &Slot<Captured>, damage: &Damage) -> Result<()> {
    let name = path.display().to_string();
    let inputs = [PathBuf::from(path)];
    let mut number = 0;
    let mut due = Instant::now();
    loop {
        let mut trouble = None;
        let before = number;
        for frame in Source::open(&inputs)? {
            let picture = match frame.picture {
                Ok(picture) => picture,
                Err(error) => {
                    damage.note(&name, &error);
                    trouble = Some(error);
                    continue;
                }
            };
            let rate = fps.unwrap_or(match frame.kind {
                Kind::Still => FOLDER_FPS,
                Kind::Video { fps: (n, d) } => f64::from(n) / f64::from(d.max(1)),
            });
            thread::sleep(due.saturating_duration_since(Instant::now()));
            due += Duration::from_secs_f64(1.0 / rate.max(0.1));
            if due + PATIENCE < Instant::now() {
                due = Instant::now();
            }
            if !frames.put(Captured { number, at: Instant::now(), picture, jpeg: None }) {
                return Ok(());
            }
            number += 1;
        }
        if number == before {
            let trouble = trouble.unwrap_or_else(|| anyhow!("it has no frames"));
            return Err(trouble).with_context(|| format!("cannot replay {name}"));
        }
    }
}
