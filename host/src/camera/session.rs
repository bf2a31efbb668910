//! The threads beside the search: the source of frames; the page, the broker and the folder of models; signals.
//!
//! In: the source of frames, and what to serve. Out: frames in [`Live`], until the
//! source ends, a signal arrives, or the session is ended. No thread waits for the search.
//!
//! Memory and cost: those of the threads.

use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use tokio::sync::watch;

use super::arguments::Origin;
#[cfg(all(feature = "camera", target_os = "linux"))]
use super::device;
use super::folder;
use super::guard::{self, Guard};
use super::live::{Live, paint};
use super::mqtt::fleet::Fleet;
use super::mqtt::{self, Outlet};
use super::replay::replay;
use super::signals;
use super::web::{self, School};
use crate::input::shown;

/// The page: its address, its token, and how objects are learned on it.
#[derive(Debug)]
pub struct Page {
    /// The address on which the page listens.
    pub address: SocketAddr,
    /// The secret that users must give. `None`: no token on loopback, else a random one.
    pub token: Option<String>,
    /// The address of the page behind a proxy, such as `https://cam.example.org`.
    pub public: Option<String>,
    /// How objects are learned on the page.
    pub school: School,
}

/// Maximum number of threads that train, merge, and look up the broker's name.
const WORKERS: usize = 4;
/// Maximum time at the end for trainings and merges.
const LAST_WORK: Duration = Duration::from_millis(100);

/// The running threads.
#[derive(Debug)]
pub struct Session {
    live: Arc<Live>,
    stop: watch::Sender<bool>,
    network: thread::JoinHandle<()>,
    painter: thread::JoinHandle<()>,
    failure: Arc<Mutex<Option<anyhow::Error>>>,
}

impl Session {
    /// Starts all threads. `overdue` is the exit status of the program when it does not end in
    /// time after a signal.
    ///
    /// # Errors
    /// When the token is too short, the page's address cannot be bound, or the system gives no
    /// thread.
    pub fn start(
        origin: &Origin,
        live: &Arc<Live>,
        page: Option<Page>,
        outlet: Option<(Outlet, Option<Fleet>)>,
        overdue: i32,
    ) -> Result<Self> {
        let (stop, stopped) = watch::channel(false);
        // Before the page can be reached: from then on, a signal must end the program cleanly.
        signals::watch(Arc::clone(live), overdue).context("signals cannot be waited for")?;
        let network = serve(page, live, outlet, stopped)?;
        let failure = Arc::new(Mutex::new(None));
        thread::Builder::new().name("source".into()).spawn({
            let (live, failure, origin) = (Arc::clone(live), Arc::clone(&failure), origin.clone());
            move || {
                let end = match &origin.replay {
                    Some(path) => {
                        replay(path, origin.fps, &live.frames, &live.damage, &|trouble| live.set_trouble(trouble))
                    }
                    None => capture(&origin, &live),
                };
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = end.err();
                live.frames.close();
            }
        })?;
        let painter = thread::Builder::new().name("painter".into()).spawn({
            let live = Arc::clone(live);
            move || paint(&live)
        })?;
        Ok(Self { live: Arc::clone(live), stop, network, painter, failure })
    }

    /// Ends all threads, and completes the answers that are being sent.
    ///
    /// # Errors
    /// The reason why the source ended by itself.
    pub fn end(self) -> Result<()> {
        self.live.frames.close();
        self.live.work.close();
        let _ = self.stop.send(true);
        // Both threads end by themselves now; a panic in them was printed already.
        let _ = self.painter.join();
        let _ = self.network.join();
        match self.failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

/// The name of a source.
#[must_use]
pub fn name_of(origin: &Origin) -> String {
    match (&origin.replay, &origin.device) {
        (Some(path), _) => shown(path),
        (None, device) => device.clone().unwrap_or_else(|| "camera".into()),
    }
}

#[cfg(all(feature = "camera", target_os = "linux"))]
fn capture(origin: &Origin, live: &Live) -> Result<()> {
    let request = device::Request {
        device: origin.device.clone(),
        wish: super::mode::Wish { size: origin.size, format: origin.format, fps: origin.fps },
        lock_exposure: origin.lock_exposure,
        lock_white_balance: origin.lock_white_balance,
    };
    device::capture(&request, live)
}

/// Lines that describe all cameras.
///
/// # Errors
/// When there is no camera.
#[cfg(all(feature = "camera", target_os = "linux"))]
pub fn list() -> Result<Vec<String>> {
    device::list()
}

/// The message that there is no camera, and what to do.
#[cfg(all(not(feature = "camera"), target_os = "linux"))]
const NO_CAMERA: &str = "this program was built without cameras: install libclang with `sudo apt-get install libclang-dev` \
                         and build with `cargo build --release --features keygraph/camera`, or give --replay VIDEO";
/// The message that cameras are not read on this system, and what to do.
#[cfg(windows)]
const NO_CAMERA: &str = "cameras of this machine are read on Linux only: give a stream with --replay, or pipe the camera through ffmpeg, \
                         `ffmpeg -f dshow -i video=\"NAME\" -pix_fmt yuv420p -f yuv4mpegpipe - | keygraph camera --replay - ...`; \
                         see docs/platforms.md";
/// The message that cameras are not read on this system, and what to do.
#[cfg(not(any(target_os = "linux", windows)))]
const NO_CAMERA: &str = "cameras of this machine are read on Linux only: give a stream with --replay, or pipe the camera through ffmpeg, \
                         `ffmpeg -f avfoundation -framerate 30 -i 0 -pix_fmt yuv420p -f yuv4mpegpipe - | keygraph camera --replay - ...`; \
                         see docs/platforms.md";

/// Lines that describe all cameras.
///
/// # Errors
/// Always: cameras were left out of this program.
#[cfg(not(all(feature = "camera", target_os = "linux")))]
pub fn list() -> Result<Vec<String>> {
    anyhow::bail!(NO_CAMERA)
}

#[cfg(not(all(feature = "camera", target_os = "linux")))]
fn capture(_: &Origin, _: &Live) -> Result<()> {
    anyhow::bail!(NO_CAMERA)
}

/// Starts the thread that serves the page, talks to the broker, and looks at the folder of models.
fn serve(
    page: Option<Page>,
    live: &Arc<Live>,
    outlet: Option<(Outlet, Option<Fleet>)>,
    mut stopped: watch::Receiver<bool>,
) -> Result<thread::JoinHandle<()>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().max_blocking_threads(WORKERS).build()?;
    let page = page.map(listen).transpose()?;
    let live = Arc::clone(live);
    let served = async move {
        let publishing = outlet
            .map(|(outlet, fleet)| tokio::spawn(mqtt::publish(outlet, fleet, Arc::clone(&live), stopped.clone())));
        if live.models.shelf.is_some() {
            // It ends with the runtime.
            tokio::spawn(folder::follow(Arc::clone(&live), stopped.clone()));
        }
        if let Some((listener, guard, school)) = page
            && let Err(error) = web::serve(listener, guard, school, live, stopped.clone()).await
        {
            tracing::error!("the page is gone: {error}");
        }
        let _ = stopped.wait_for(|&s| s).await;
        if let Some(publishing) = publishing {
            // The task ends by itself; a panic in it was printed already.
            let _ = publishing.await;
        }
    };
    Ok(thread::Builder::new().name("network".into()).spawn(move || {
        runtime.block_on(served);
        // The look-up of a broker's name cannot be stopped; the program does not wait for it.
        runtime.shutdown_timeout(LAST_WORK);
    })?)
}

/// Binds the page's address, and logs its URL.
fn listen(page: Page) -> Result<(TcpListener, Guard, School)> {
    page.token.as_deref().map(guard::check_token).transpose()?;
    let address = page.address;
    let listener = TcpListener::bind(address)
        .with_context(|| format!("cannot serve the page at {address}: give another address with --web"))?;
    listener.set_nonblocking(true)?;
    let given = page.token.is_some();
    let token = match page.token {
        None if address.ip().is_loopback() && page.public.is_none() => None,
        None => Some(guard::random_token()?),
        given => given,
    };
    // A log is read by more people than a token is for: a token that was given is known.
    let shown = if given { Some("TOKEN") } else { token.as_deref() };
    tracing::info!("the page is at {}", web::url(listener.local_addr()?, shown));
    Ok((listener, Guard::new(token, page.public), page.school))
}
