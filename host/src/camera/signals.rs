//! SIGINT and SIGTERM (on Windows what a console sends), in a thread of their own.
//!
//! In: signals. Out: the source of frames is closed, and with it all threads end. Whatever
//! they do, the program ends: after `LONGEST_END`, or at a second signal, this thread ends it.
//! Nothing that this thread does can wait for ever: it writes no log and takes no lock. So a
//! log that nobody reads, a disk that hangs and a thread that is stuck do not delay the end.
//!
//! Memory: a thread. Cost: none until a signal arrives.

use std::io;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
#[cfg(unix)]
use tokio::signal::unix::{Signal, SignalKind, signal};
#[cfg(windows)]
use tokio::signal::windows::{CtrlBreak, CtrlC, CtrlClose, ctrl_break, ctrl_c, ctrl_close};

use super::live::Live;
use crate::ending::{tidy, within};

/// Time that the program has to end by itself. After it, what still runs is given up: a search, a
/// training, a line that nobody reads. With three times [`PATIENCE`], some 0.4 s are left of two for
/// a machine that is busy.
const LONGEST_END: Duration = Duration::from_millis(1300);
/// Maximum time that this thread waits for work that another thread does for it.
const PATIENCE: Duration = Duration::from_millis(100);
/// Exit status of the program after a second signal.
const INTERRUPTED: i32 = 130;

/// Starts the thread. From now on, signals no longer end the program at once. `overdue` is the
/// exit status of the program when it does not end in time.
///
/// # Errors
/// When the system gives no thread, or signals cannot be waited for.
pub fn watch(live: Arc<Live>, overdue: i32) -> io::Result<()> {
    // A runtime of its own: no request and no message is ahead of a signal.
    let runtime = Builder::new_current_thread().enable_io().enable_time().build()?;
    let signals = {
        let _inside = runtime.enter();
        Signals::listen()?
    };
    thread::Builder::new().name("signals".into()).spawn(move || end_on_signal(&runtime, signals, live, overdue))?;
    Ok(())
}

/// The signals that end the program.
#[cfg(unix)]
struct Signals {
    interrupt: Signal,
    terminate: Signal,
}

#[cfg(unix)]
impl Signals {
    /// From now on, these signals no longer end the program at once. It is called inside of a runtime.
    fn listen() -> io::Result<Self> {
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    async fn next(&mut self) {
        tokio::select! { _ = self.interrupt.recv() => {}, _ = self.terminate.recv() => {} }
    }
}

/// The signals that end the program: keys, and that the window is closed.
#[cfg(windows)]
struct Signals {
    interrupt: CtrlC,
    terminate: CtrlBreak,
    close: CtrlClose,
}

#[cfg(windows)]
impl Signals {
    /// From now on, these signals no longer end the program at once. It is called inside of a runtime.
    fn listen() -> io::Result<Self> {
        Ok(Self { interrupt: ctrl_c()?, terminate: ctrl_break()?, close: ctrl_close()? })
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
            _ = self.close.recv() => {}
        }
    }
}

fn end_on_signal(runtime: &Runtime, mut signals: Signals, live: Arc<Live>, overdue: i32) {
    runtime.block_on(signals.next());
    // Before the source is closed: after that, the program may end at any time.
    within(PATIENCE, "ending", || tracing::info!("ending"));
    let frames = Arc::clone(&live);
    if !within(PATIENCE, "closing", move || frames.frames.close()) {
        live.frames.close();
    }
    let again = runtime.block_on(async { tokio::time::timeout(LONGEST_END, signals.next()).await.is_ok() });
    within(PATIENCE, "tidying", tidy);
    std::process::exit(if again { INTERRUPTED } else { overdue });
}
