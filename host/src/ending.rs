//! The end of the program: at a signal, and in the middle of its work.
//!
//! In: SIGINT and SIGTERM. Out: the end, as without this, but no file that is not finished, no temporary file and no
//! ffmpeg is left: one that waits for a silent camera would outlive this program. Nothing delays the end for longer than
//! `PATIENCE`, not even a disk that hangs.
//!
//! Memory: a thread. Cost: none until a signal arrives.

use std::io;
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use crate::{ffmpeg, unfinished};

/// Ends the program at a signal from now on, without leaving anything behind. On Windows, a console ends the program
/// as it ends any other.
///
/// # Errors
/// When the system gives no thread, or signals cannot be waited for.
#[cfg(not(unix))]
#[allow(clippy::unnecessary_wraps, reason = "as where there are signals")]
pub fn end_at_signals() -> io::Result<()> {
    Ok(())
}

/// Ends the program at a signal from now on, without leaving anything behind.
///
/// # Errors
/// When the system gives no thread, or signals cannot be waited for.
#[cfg(unix)]
pub fn end_at_signals() -> io::Result<()> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;
    use std::process::exit;

    /// Maximum time to leave nothing behind.
    const PATIENCE: Duration = Duration::from_millis(500);
    /// What shells add to the number of a signal that ended a program.
    const BY_SIGNAL: i32 = 128;

    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            within(PATIENCE, "tidying", tidy);
            // Whoever waits for this program sees that the signal has ended it.
            let _ = emulate_default_handler(signal);
            exit(BY_SIGNAL + signal);
        }
    };
    thread::Builder::new().name("signals".into()).spawn(wait)?;
    Ok(())
}

/// Removes files that are not finished, and ends ffmpeg, for a program that is about to end. What waits for ffmpeg
/// waits from now on without an end.
pub fn tidy() {
    unfinished::remove();
    ffmpeg::stop_all();
}

/// Works in a thread of its own, and waits for it for `patience`. Returns false when the system gives no thread: then
/// nothing was done.
pub(crate) fn within(patience: Duration, name: &str, work: impl FnOnce() + Send + 'static) -> bool {
    let (done, end) = channel::<()>();
    let thread = thread::Builder::new().name(name.into()).spawn(move || {
        let _done = done;
        work();
    });
    if thread.is_ok() {
        let _ = end.recv_timeout(patience);
    }
    thread.is_ok()
}
