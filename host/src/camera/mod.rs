//! In front of a camera: `keygraph camera`.
//!
//! In: a camera, or a file in place of one. Out: JSON lines, a page, messages to a
//! broker. Threads, each waiting only for the one to its left:
//!
//! ```text
//! source ──newest frame──► search ──newest result──► painter ──► page, events
//!                             └────► standard output, broker
//! ```
//!
//! A file uses only files above it:
//!
//! - [`mode`]: in which ways cameras give pictures, and which to ask for
//! - [`arguments`]: the command line
//! - [`slot`]: the newest item of a thread, for another
//! - [`replay`]: a file in place of a camera
//! - [`models`]: the models in use
//! - [`tracker`]: from frame to frame
//! - [`shot`]: a searched frame as it is handed out
//! - [`live`]: frames searched as they come
//! - `device`: cameras through V4L2 (with the feature `camera`, on Linux)
//! - [`cutout`]: the object out of a frame, to learn it
//! - [`guard`]: who may look, and who may change something
//! - [`web`]: the page
//! - [`mqtt`]: what is found, to a broker
//!
//! Memory: a few frames; it does not grow. Cost: a search a frame, and a JPEG encoded
//! while somebody looks.

pub mod mode;
pub mod arguments;
pub mod slot;
pub mod replay;
pub mod models;
pub mod tracker;
pub mod shot;
pub mod live;
#[cfg(all(feature = "camera", target_os = "linux"))]
pub mod device;
pub mod cutout;
pub mod guard;
pub mod web;
pub mod mqtt;

use std::io::{self, IsTerminal, Write};
use std::net::TcpListener;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use crate::input::Picture;
use arguments::Arguments;
use guard::Guard;
use live::{Live, Outcome, paint, search_frames};
use models::Models;
use mqtt::{Broker, Outlet};
use tracker::State;

/// Longest wait for those who are still being served at the end.
const FAREWELL: Duration = Duration::from_secs(2);

/// A frame as the source gave it.
#[derive(Debug)]
pub struct Captured {
    /// Its index, those that were dropped included.
    pub number: u64,
    /// When it was there.
    pub at: Instant,
    /// The frame.
    pub picture: Picture,
    /// The same as JPEG, where the camera gives that.
    pub jpeg: Option<Vec<u8>>,
}

/// Runs until it is told to stop, by a signal or by `--frames`, or the source ends.
///
/// # Errors
/// When a model or the source cannot be read, or the page's address is not to be had.
pub fn camera(arguments: &Arguments) -> Result<()> {
    log_to_standard_error(arguments);
    if arguments.list {
        return list();
    }
    ensure!(
        arguments.web.is_some() || !arguments.models.is_empty(),
        "nothing to look for: give a model with -m (make one with `keygraph train`), or --web to learn objects on a page"
    );
    let source = match (&arguments.replay, &arguments.device) {
        (Some(path), _) => path.display().to_string(),
        (None, device) => device.clone().unwrap_or_else(|| "camera".into()),
    };
    let live = Arc::new(Live::new(source, Models::load(&arguments.models)?, arguments.threshold));
    let (stop, stopped) = watch::channel(false);
    let broker = arguments.mqtt.as_deref().map(Broker::parse).transpose()?.map(mqtt::channel);
    let (mut publisher, outlet) = broker.unzip();
    let network = serve(arguments, &live, outlet, &stopped)?;

    let failure = Arc::new(Mutex::new(None));
    thread::Builder::new().name("source".into()).spawn({
        let (live, failure, arguments) = (Arc::clone(&live), Arc::clone(&failure), arguments.clone());
        move || {
            let end = match &arguments.replay {
                Some(path) => replay::replay(path, arguments.fps, &live.frames),
                None => capture(&arguments, &live),
            };
            *failure.lock().unwrap_or_else(PoisonError::into_inner) = end.err();
            live.frames.close();
        }
    })?;
    let painter = thread::Builder::new().name("painter".into()).spawn({
        let live = Arc::clone(&live);
        move || paint(&live)
    })?;

    let mut left = arguments.frames;
    let mut diary = Diary::default();
    let searched = search_frames(&live, arguments.profile, |outcome| {
        diary.note(outcome);
        if let Some(publisher) = &mut publisher {
            publisher.take(outcome);
        }
        if arguments.json {
            print(&outcome.line.to_string())?;
        }
        left = left.map(|n| n.saturating_sub(1));
        Ok(left != Some(0))
    });
    live.frames.close();
    live.work.close();
    let _ = stop.send(true);
    // Both end by themselves now; a panic of theirs has been told.
    let _ = painter.join();
    let _ = network.join();
    searched?;
    match failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

#[cfg(all(feature = "camera", target_os = "linux"))]
fn list() -> Result<()> {
    device::list()?.iter().try_for_each(|line| print(line))
}

#[cfg(all(feature = "camera", target_os = "linux"))]
fn capture(arguments: &Arguments, live: &Live) -> Result<()> {
    let request = device::Request {
        device: arguments.device.clone(),
        wish: mode::Wish { size: arguments.size, format: arguments.format, fps: arguments.fps },
        lock_exposure: arguments.lock_exposure,
        lock_white_balance: arguments.lock_white_balance,
    };
    device::capture(&request, live)
}

/// Why there is no camera, and what to do.
#[cfg(not(all(feature = "camera", target_os = "linux")))]
const NO_CAMERA: &str = "this program was built without cameras (Linux only): install libclang with `sudo apt-get install libclang-dev` \
                         and build with `cargo build --release --features keygraph/camera`, or give --replay VIDEO";

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn list() -> Result<()> {
    anyhow::bail!(NO_CAMERA)
}

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn capture(_: &Arguments, _: &Live) -> Result<()> {
    anyhow::bail!(NO_CAMERA)
}

fn log_to_standard_error(arguments: &Arguments) {
    let log = tracing_subscriber::fmt()
        .with_max_level(arguments.log)
        .with_target(false)
        .with_ansi(io::stderr().is_terminal())
        .with_writer(io::stderr);
    // The journal of systemd has its own times. A second call, in a test, changes nothing.
    let _ = if std::env::var_os("JOURNAL_STREAM").is_some() { log.without_time().try_init() } else { log.try_init() };
}

/// A line on standard output, at once.
fn print(line: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()?;
    Ok(())
}

/// Starts the thread that waits for signals, serves the page and talks to the broker.
fn serve(
    arguments: &Arguments,
    live: &Arc<Live>,
    outlet: Option<Outlet>,
    stopped: &watch::Receiver<bool>,
) -> Result<thread::JoinHandle<()>> {
    let page = match arguments.web {
        None => None,
        Some(address) => {
            let listener = TcpListener::bind(address)
                .with_context(|| format!("cannot serve the page at {address}: give another address with --web"))?;
            listener.set_nonblocking(true)?;
            let token = match &arguments.token {
                None if address.ip().is_loopback() => None,
                None => Some(guard::random_token()?),
                given => given.clone(),
            };
            tracing::info!("the page is at {}", web::url(listener.local_addr()?, token.as_deref()));
            Some((listener, Guard::new(token)))
        }
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (live, mut stopped) = (Arc::clone(live), stopped.clone());
    let served = async move {
        tokio::spawn(close_on_signal(Arc::clone(&live)));
        let publishing = outlet.map(|outlet| tokio::spawn(mqtt::publish(outlet, stopped.clone())));
        if let Some((listener, guard)) = page
            && let Err(error) = web::serve(listener, guard, live, stopped.clone()).await
        {
            tracing::error!("the page is gone: {error}");
        }
        let _ = stopped.wait_for(|&s| s).await;
        if let Some(publishing) = publishing {
            // It ends by itself; a panic of it has been told.
            let _ = publishing.await;
        }
    };
    Ok(thread::Builder::new().name("network".into()).spawn(move || {
        runtime.block_on(served);
        runtime.shutdown_timeout(FAREWELL);
    })?)
}

/// The first signal ends the source, and with it all else in turn; the second, all at
/// once.
async fn close_on_signal(live: Arc<Live>) {
    let signals = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()));
    let (Ok(mut interrupt), Ok(mut terminate)) = signals else {
        return tracing::warn!("signals cannot be waited for: they end the program at once");
    };
    for last in [false, true] {
        tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
        if last {
            std::process::exit(130);
        }
        tracing::info!("ending");
        live.frames.close();
    }
}

/// Logs objects that come and go.
#[derive(Debug, Default)]
struct Diary(Vec<(String, State)>);

impl Diary {
    fn note(&mut self, outcome: &Outcome) {
        for (i, (name, state, score)) in outcome.objects.iter().enumerate() {
            let before = self.0.get(i).filter(|b| b.0 == *name).map_or(State::Searching, |b| b.1);
            match (before.is_seen(), state.is_seen()) {
                (false, true) => tracing::info!("{name} found, score {:.2}", score.unwrap_or(0.0)),
                (true, false) => tracing::info!("{name} lost"),
                _ => {}
            }
        }
        self.0 = outcome.objects.iter().map(|(name, state, _)| (name.clone(), *state)).collect();
    }
}
