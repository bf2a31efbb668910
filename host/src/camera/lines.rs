//! The JSON lines on standard output, written by a thread of their own.
//!
//! In: a line a frame, from the search, which never waits. Out: the lines in their order.
//! When nobody reads them, `QUEUE` lines wait; newer ones are dropped, counted and told of.
//! The thread that writes may wait for ever; the end of the program does not wait for it.
//!
//! Memory: the lines that wait, a few KB each. Cost: a copy and a system call a line.

use std::io::{ErrorKind, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Result;

/// Maximum number of lines that wait.
const QUEUE: usize = 256;
/// Minimum time between two warnings.
const INTERVAL: Duration = Duration::from_secs(10);
/// Maximum time at the end for lines that wait.
const FAREWELL: Duration = Duration::from_secs(1);

/// The lines on their way out.
#[derive(Debug)]
pub struct Lines {
    queue: SyncSender<String>,
    /// Is disconnected when the writer has ended.
    writing: Receiver<()>,
    /// Why the writer ended before its time.
    failure: Arc<OnceLock<ErrorKind>>,
    dropped: u64,
    told: Option<Instant>,
}

impl Lines {
    /// Starts the thread that writes to `out`.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(mut out: impl Write + Send + 'static) -> Result<Self> {
        let (queue, lines) = sync_channel::<String>(QUEUE);
        let (alive, writing) = channel::<()>();
        let failure = Arc::new(OnceLock::new());
        thread::Builder::new().name("lines".into()).spawn({
            let failure = Arc::clone(&failure);
            move || {
                let _alive = alive;
                for line in lines {
                    if let Err(error) = out.write_all(line.as_bytes()).and_then(|()| out.flush()) {
                        let _ = failure.set(error.kind());
                        return;
                    }
                }
            }
        })?;
        Ok(Self { queue, writing, failure, dropped: 0, told: None })
    }

    /// Takes a line. Returns false when it is dropped. Does not wait.
    ///
    /// # Errors
    /// When a line before it could not be written.
    pub fn put(&mut self, line: &str) -> Result<bool> {
        match self.queue.try_send(format!("{line}\n")) {
            Ok(()) => Ok(true),
            Err(TrySendError::Full(_)) => {
                self.dropped += 1;
                let now = Instant::now();
                if self.told.is_none_or(|told| now.duration_since(told) >= INTERVAL) {
                    self.told = Some(now);
                    tracing::warn!("standard output is not read: {} lines dropped so far", self.dropped);
                }
                Ok(false)
            }
            Err(TrySendError::Disconnected(_)) => {
                let kind = self.failure.get().copied().unwrap_or(ErrorKind::BrokenPipe);
                Err(std::io::Error::from(kind).into())
            }
        }
    }

    /// Waits until all lines are written, `FAREWELL` at most. Returns whether they are.
    pub fn end(self) -> bool {
        let Self { queue, writing, failure, .. } = self;
        drop(queue);
        writing.recv_timeout(FAREWELL) == Err(RecvTimeoutError::Disconnected) && failure.get().is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;
    use std::sync::Mutex;

    /// An output that takes nothing until its lock is free.
    struct Blocked(Arc<Mutex<Vec<u8>>>);

    impl Write for Blocked {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().expect("not poisoned").write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn lines_that_nobody_reads_are_dropped_and_counted() {
        let text = Arc::new(Mutex::new(Vec::new()));
        let mut lines = Lines::start(Blocked(Arc::clone(&text))).expect("a thread");
        let blocked = text.lock().expect("not poisoned");
        let taken = (0..1000).filter(|i| lines.put(&i.to_string()).expect("no error")).count();
        // One more line is in the hands of the writer.
        assert!((QUEUE..=QUEUE + 1).contains(&taken), "{taken}");
        assert_eq!(lines.dropped, 1000 - taken as u64);
        drop(blocked);
        assert!(lines.end(), "all are written now");
        let text = String::from_utf8(text.lock().expect("not poisoned").clone()).expect("text");
        assert!(text.starts_with("0\n1\n2\n") && text.lines().count() == taken, "{text}");
    }

    #[test]
    fn the_end_does_not_wait_for_a_writer_that_is_stuck() {
        let text = Arc::new(Mutex::new(Vec::new()));
        let mut lines = Lines::start(Blocked(Arc::clone(&text))).expect("a thread");
        let _blocked = text.lock().expect("not poisoned");
        lines.put("stuck").expect("no error");
        assert!(!lines.end());
    }

    #[test]
    fn a_closed_output_is_an_error() {
        struct Closed;
        impl Write for Closed {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(ErrorKind::BrokenPipe.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let mut lines = Lines::start(Closed).expect("a thread");
        let error = (0..10_000).find_map(|_| {
            thread::sleep(Duration::from_millis(1));
            lines.put("x").err()
        });
        let kind = error.and_then(|e| e.downcast::<io::Error>().ok()).map(|e| e.kind());
        assert_eq!(kind, Some(ErrorKind::BrokenPipe));
    }
}
