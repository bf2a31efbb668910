//! Pictures for other programs: the newest frame as a JPEG, and all frames as Motion-JPEG.
//!
//! In: searched frames, as the painter encodes them while somebody looks. Out: answers with
//! one JPEG, or with one after the other (`multipart/x-mixed-replace`), plain or with outlines
//! and names drawn in. A stream sends the newest frame when its viewer has taken the last one:
//! a slow viewer gets fewer frames, and nothing waits for it.
//!
//! Memory: a JPEG for all viewers, and what the sockets hold. Cost: while somebody wants
//! outlines, a second JPEG a frame, `MOST_FPS` a second at most, in the painter's thread.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use axum::http::{HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use serde::Deserialize;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::sleep;

use super::intake::Problem;
use super::live::{Live, MOST_FPS, Wish};
use super::pace::Pace;
use super::server::Visit;
use super::shot::Shot;

/// Maximum number of streams at a time.
const MOST_STREAMS: usize = 8;
/// Number of frames a second of a stream that asks for none.
const USUAL_FPS: f64 = 10.0;
/// Range of the rates that a stream can ask for, frames a second.
const FPS: std::ops::RangeInclusive<f64> = 0.1..=MOST_FPS;
/// Time for which frames are encoded after one was asked for.
const ATTENTION: Duration = Duration::from_secs(1);
/// Maximum wait for the frame of a snapshot.
const PATIENCE: Duration = Duration::from_secs(5);
/// The line between two pictures of a stream.
const BOUNDARY: &str = "keygraph-frame";

/// What a program wants to see.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
pub struct Wanted {
    /// 0 for frames as they are. Otherwise outlines and names are drawn in.
    outlines: Option<u8>,
    /// Maximum number of frames a second.
    fps: Option<f64>,
}

impl Wanted {
    fn is_drawn(self) -> bool {
        self.outlines != Some(0)
    }
}

/// The frames, and the places of those who watch them.
#[derive(Clone, Debug)]
pub struct Feed {
    live: Arc<Live>,
    stopped: watch::Receiver<bool>,
    places: Arc<Semaphore>,
}

impl Feed {
    /// The frames of `live`, until `stopped`.
    #[must_use]
    pub fn new(live: Arc<Live>, stopped: watch::Receiver<bool>) -> Self {
        Self { live, stopped, places: Arc::new(Semaphore::new(MOST_STREAMS)) }
    }

    /// The next frame that is not number `after`; `None` at the end of the program, or when
    /// none has come within `patience`.
    async fn next(
        &mut self,
        drawn: bool,
        after: Option<u64>,
        patience: Option<Duration>,
    ) -> Option<(Arc<Shot>, Bytes)> {
        let mut shots = self.live.shots.subscribe();
        let start = Instant::now();
        let is_new = |shot: &Option<Arc<Shot>>| {
            shot.as_ref().is_some_and(|s| s.jpeg(drawn).is_some() && Some(s.number) != after)
        };
        loop {
            self.live.look(ATTENTION, if drawn { Wish::Outlines } else { Wish::Picture });
            let shot = tokio::select! {
                shot = shots.wait_for(is_new) => shot.ok().and_then(|s| s.clone()),
                _ = self.stopped.wait_for(|&s| s) => return None,
                () = sleep(ATTENTION / 2) => None,
            };
            if let Some((shot, jpeg)) = shot.and_then(|s| Some((s.clone(), s.jpeg(drawn)?))) {
                return Some((shot, jpeg));
            }
            if patience.is_some_and(|patience| start.elapsed() >= patience) {
                return None;
            }
        }
    }

    /// The newest frame.
    ///
    /// # Errors
    /// When there is none, or it is an old one because no more arrive.
    pub async fn snapshot(&mut self, wanted: Wanted) -> Result<Response, Problem> {
        let none = |why: String| Problem(StatusCode::SERVICE_UNAVAILABLE, why);
        if let Some(trouble) = self.live.trouble() {
            return Err(none(trouble));
        }
        let shot = self.next(wanted.is_drawn(), None, Some(PATIENCE)).await.filter(|_| self.live.delivers());
        let (shot, jpeg) = shot.ok_or_else(|| none("no frame arrives: try again in some seconds".into()))?;
        let headers = [
            (header::CONTENT_TYPE, "image/jpeg".to_string()),
            (header::CACHE_CONTROL, "no-store".to_string()),
            (HeaderName::from_static("x-age-ms"), shot.at.elapsed().as_millis().to_string()),
        ];
        Ok((headers, jpeg).into_response())
    }

    /// Frames, until the viewer leaves or the program ends.
    ///
    /// # Errors
    /// When the rate is none, or all places are taken.
    pub fn stream(self, wanted: Wanted, visit: Arc<Visit>) -> Result<Response, Problem> {
        let fps = wanted.fps.unwrap_or(USUAL_FPS);
        if !FPS.contains(&fps) {
            let told = format!("the rate fps lies between {} and {} frames a second", FPS.start(), FPS.end());
            return Err(Problem(StatusCode::BAD_REQUEST, told));
        }
        let place = Arc::clone(&self.places).try_acquire_owned().map_err(|_| {
            let told = format!("{MOST_STREAMS} streams are watched already, which is the maximum: close one");
            Problem(StatusCode::SERVICE_UNAVAILABLE, told)
        })?;
        let viewer = Viewer {
            feed: self,
            drawn: wanted.is_drawn(),
            pace: Pace::new(Duration::from_secs_f64(1.0 / fps)),
            last: None,
            _place: place,
            _visit: visit,
        };
        let parts = unfold(viewer, |mut viewer| async move {
            let part = viewer.part().await?;
            Some((Ok::<_, Infallible>(part), viewer))
        });
        let headers = [
            (header::CONTENT_TYPE, format!("multipart/x-mixed-replace; boundary={BOUNDARY}")),
            (header::CACHE_CONTROL, "no-store".to_string()),
        ];
        Ok((headers, Body::from_stream(parts)).into_response())
    }
}

/// The viewer of a stream.
struct Viewer {
    feed: Feed,
    drawn: bool,
    pace: Pace,
    /// Number of the frame that was sent last.
    last: Option<u64>,
    _place: OwnedSemaphorePermit,
    _visit: Arc<Visit>,
}

impl Viewer {
    /// The next frame as a part of the stream; `None` at the end of the program.
    async fn part(&mut self) -> Option<Bytes> {
        tokio::select! {
            () = sleep(self.pace.left(Instant::now())) => {}
            _ = self.feed.stopped.wait_for(|&s| s) => return None,
        }
        let (shot, jpeg) = self.feed.next(self.drawn, self.last, None).await?;
        self.pace.takes(Instant::now());
        let is_first = self.last.replace(shot.number).is_none();
        Some(part(&jpeg, is_first))
    }
}

/// A picture as a part of a stream. The line after it tells a browser that it is whole, so that
/// it is shown at once and not when the next one comes.
fn part(jpeg: &[u8], is_first: bool) -> Bytes {
    let opening = if is_first { format!("--{BOUNDARY}\r\n") } else { String::new() };
    let head = format!("{opening}Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.len());
    [head.as_bytes(), jpeg, format!("\r\n--{BOUNDARY}\r\n").as_bytes()].concat().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_divided_by_one_line() {
        let stream = [part(b"one", true), part(b"three", false)].concat();
        let head = |n: u8| format!("Content-Type: image/jpeg\r\nContent-Length: {n}\r\n\r\n");
        let (line, one, three) = ("--keygraph-frame\r\n", head(3), head(5));
        let whole = format!("{line}{one}one\r\n{line}{three}three\r\n{line}");
        assert_eq!(String::from_utf8(stream).expect("text"), whole);
    }
}
