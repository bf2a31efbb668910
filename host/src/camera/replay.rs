//! A file or a stream in place of a camera: plays a video or a folder of pictures again and again, at
//! its frame rate; takes the frames of an address or of standard input as they come.
//!
//! In: a path, an address, or `-`. Out: frames into the slot, each at its time. As with a camera, a frame does
//! not wait until the frame before it is taken.
//!
//! Memory: one frame. Cost: decoding.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};

use super::Captured;
use super::damage::Damage;
use super::slot::Slot;
use crate::ffmpeg;
use crate::input::{Kind, Source, is_stdin, is_url, shown};

/// Default rate of a folder's pictures, frames a second.
const FOLDER_FPS: f64 = 25.0;
/// Default rate at which an address is asked that gives one picture, frames a second.
const PICTURE_FPS: f64 = 5.0;
/// Maximum delay that the source makes up for. When it is later, it goes on from now.
const PATIENCE: Duration = Duration::from_secs(1);

/// Pauses before a file is opened again that cannot be read any more: the first and the
/// longest.
const PAUSES: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(10)];

/// Plays `path` into `frames` until that is closed, at `fps` frames a second or else at the
/// file's own rate. Frames that cannot be read are counted in `damage`. A file that could be
/// read before is tried again, and an address always; `told` takes the reason, and `None` when frames come again.
/// Standard input is played once.
///
/// # Errors
/// When no frame can be read from the start, for a reason that will not pass.
pub fn replay(
    path: &Path,
    fps: Option<f64>,
    frames: &Slot<Captured>,
    damage: &Damage,
    told: &dyn Fn(Option<String>),
) -> Result<()> {
    let name = if is_stdin(path) { "standard input".into() } else { shown(path) };
    let inputs = [PathBuf::from(path)];
    let mut number = 0;
    let mut due = Instant::now();
    let mut pause = PAUSES[0];
    let mut in_trouble = false;
    while !frames.is_closed() {
        let mut trouble = None;
        let before = number;
        for frame in Source::open(&inputs)? {
            let rate = fps.unwrap_or(match frame.kind {
                Kind::Still => FOLDER_FPS,
                Kind::Video { fps: (n, d) } => f64::from(n) / f64::from(d.max(1)),
            });
            // A damaged frame takes its time too: nothing runs in circles. Frames of a camera come when they were taken.
            if !frame.live || fps.is_some() {
                thread::sleep(due.saturating_duration_since(Instant::now()));
                due += Duration::from_secs_f64(1.0 / rate.max(0.1));
                if due + PATIENCE < Instant::now() {
                    due = Instant::now();
                }
            }
            let picture = match frame.picture {
                Ok(picture) => {
                    trouble = None;
                    picture
                }
                Err(error) => {
                    // A stream that cannot be opened has no damaged frames.
                    let is_closed = number == before && (is_url(path) || is_stdin(path));
                    if !is_passing(&error) && !is_closed {
                        damage.note(&name, &error);
                    }
                    trouble = Some(error);
                    continue;
                }
            };
            if in_trouble {
                (pause, in_trouble) = (PAUSES[0], false);
                told(None);
                tracing::info!("{name} can be read again");
            }
            if !frames.put(Captured { number, at: Instant::now(), picture, jpeg: None }) {
                return Ok(());
            }
            number += 1;
        }
        if is_stdin(path) {
            return match trouble {
                Some(trouble) => Err(trouble).with_context(|| format!("cannot replay {name}")),
                None => Ok(()),
            };
        }
        // An address may give one picture: it is asked for the next. A camera that breaks off is not called at once.
        if is_url(path) && number == before + 1 {
            thread::sleep(Duration::from_secs_f64(1.0 / fps.unwrap_or(PICTURE_FPS).max(0.1)));
        } else if is_url(path) && number > before {
            thread::sleep(PAUSES[0]);
        }
        if number == before {
            let trouble = trouble.unwrap_or_else(|| anyhow!("it has no frames"));
            if number == 0 && !is_passing(&trouble) && !(is_url(path) && ffmpeg::is_there()) {
                return Err(trouble).with_context(|| format!("cannot replay {name}"));
            }
            if !in_trouble {
                // Told before it is logged: who reads of it and asks is told the same.
                told(Some(format!("cannot replay {name}: {trouble:#}")));
                tracing::warn!("cannot replay {name}: {trouble:#}; trying again");
                in_trouble = true;
            }
            thread::sleep(pause);
            pause = (pause * 2).min(PAUSES[1]);
        }
    }
    Ok(())
}

/// Whether an error is one of the system that passes: too many open files, too little memory.
fn is_passing(error: &anyhow::Error) -> bool {
    /// Too many open files: ENFILE and EMFILE, `ERROR_TOO_MANY_OPEN_FILES`.
    const FILES: &[i32] = if cfg!(windows) { &[4] } else { &[23, 24] };
    const PASSING: [ErrorKind; 3] = [ErrorKind::Interrupted, ErrorKind::WouldBlock, ErrorKind::OutOfMemory];
    let of_system = |error: &io::Error| {
        error.raw_os_error().is_some_and(|code| FILES.contains(&code) || PASSING.contains(&error.kind()))
    };
    error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>()).any(of_system)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_the_system_that_pass_are_told_from_others() {
        let error = |code| anyhow::Error::from(io::Error::from_raw_os_error(code)).context("cannot open it");
        // EINTR, ENOMEM, ENFILE, EMFILE; then ENOENT, EACCES.
        assert!([4, 12, 23, 24].into_iter().all(|code| is_passing(&error(code))));
        assert!(![2, 13].into_iter().any(|code| is_passing(&error(code))));
        assert!(!is_passing(&io::Error::from(ErrorKind::OutOfMemory).into()), "a decoder's own");
    }
}
