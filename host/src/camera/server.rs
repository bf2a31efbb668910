//! Connections to the page: how many there are, and how long they may be silent.
//!
//! In: a listener and the routes of the page. Out: answers. A connection that has not sent
//! the head of a request after `SILENCE` is closed, also between two requests. One whose
//! client does not read its answer is closed after `UNREAD` (Linux). When
//! `MOST_CONNECTIONS` are open, others wait until one of them is closed.
//!
//! Memory: some 20 KB a connection, and the answers that are being sent. Cost: a task a
//! connection.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::sleep;

use super::FAREWELL;
use super::live::Live;
use super::repeated::Repeated;

/// Maximum number of connections.
const MOST_CONNECTIONS: usize = 256;
/// Maximum time until the head of a request has arrived.
const SILENCE: Duration = Duration::from_secs(10);
/// Maximum time for which a client may leave its answer unread.
#[cfg(target_os = "linux")]
const UNREAD: Duration = Duration::from_secs(30);
/// Maximum size of the head of a request in bytes.
const HEAD_BYTES: usize = 16 << 10;
/// Pause after a connection that could not be accepted, for example since too many files
/// are open.
const PAUSE: Duration = Duration::from_millis(500);

/// A connection.
#[derive(Debug)]
pub struct Visit {
    /// The address of the client.
    pub address: IpAddr,
    looks: AtomicBool,
    live: Arc<Live>,
}

impl Visit {
    /// Counts the client as a viewer, until the connection ends.
    pub fn look(&self) {
        if !self.looks.swap(true, Ordering::Relaxed) {
            self.live.tally.viewer_came();
        }
    }
}

impl Drop for Visit {
    fn drop(&mut self) {
        if *self.looks.get_mut() {
            self.live.tally.viewer_left();
        }
    }
}

/// Serves `router` until `stopped`, and then completes the answers that are being sent.
///
/// # Errors
/// When the listener cannot be used.
pub async fn serve(
    listener: TcpListener,
    router: Router,
    live: Arc<Live>,
    mut stopped: watch::Receiver<bool>,
) -> Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let (mut connections, repeated) = (JoinSet::new(), Repeated::default());
    let over = stopped.clone();
    let accept = async {
        loop {
            let place = Arc::clone(&places).acquire_owned().await;
            match listener.accept().await {
                Ok((stream, address)) => {
                    // Connections that have ended leave nothing behind.
                    while connections.try_join_next().is_some() {}
                    let routes = router.clone();
                    let (live, over) = (Arc::clone(&live), over.clone());
                    connections.spawn(async move {
                        let _place = place;
                        connection(stream, address, routes, live, over).await;
                    });
                }
                Err(error) => {
                    if let Some(told) = repeated.note(&error.to_string(), Instant::now()) {
                        tracing::warn!("a connection to the page cannot be accepted: {told}");
                    }
                    sleep(PAUSE).await;
                }
            }
        }
    };
    tokio::select! {
        () = accept => {}
        _ = stopped.wait_for(|&s| s) => {}
    }
    drop(listener);
    let rest = async { while connections.join_next().await.is_some() {} };
    // Answers that are not read are given up.
    let _ = tokio::time::timeout(FAREWELL, rest).await;
    Ok(())
}

async fn connection(
    stream: TcpStream,
    address: SocketAddr,
    routes: Router,
    live: Arc<Live>,
    mut stopped: watch::Receiver<bool>,
) {
    let _ = stream.set_nodelay(true);
    #[cfg(target_os = "linux")]
    let _ = socket2::SockRef::from(&stream).set_tcp_user_timeout(Some(UNREAD));
    let visit = Arc::new(Visit { address: address.ip(), looks: AtomicBool::new(false), live });
    let service = TowerToHyperService::new(routes.layer(Extension(visit)));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(SILENCE).max_buf_size(HEAD_BYTES);
    let mut served = std::pin::pin!(http.serve_connection(TokioIo::new(stream), service));
    // A client that breaks off is no error of this program.
    tokio::select! {
        _ = served.as_mut() => return,
        _ = stopped.wait_for(|&s| s) => served.as_mut().graceful_shutdown(),
    }
    let _ = served.await;
}
