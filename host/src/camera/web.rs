//! The page, and the requests of other programs.
//!
//! In: requests over HTTP. Out: answers:
//!
//! | request | answer |
//! | --- | --- |
//! | `GET /` | the page, which asks for the rest |
//! | `GET /frame?after=N&details=1` | the newest searched frame that is not number N, as soon as there is one: picture and outlines in one body, see [`super::shot`]; 204 after 5 s without a frame |
//! | `GET /events` | JSON lines of all frames as server-sent events |
//! | `GET /status` | the trouble of the source, the models, the threshold, the [`Errand`] |
//! | `POST /models?name=N` | adds the model in the body |
//! | `GET /models/ID`, `DELETE /models/ID` | returns, removes a model |
//! | `PUT /threshold?value=V` | sets the minimum score |
//! | `POST /learn?name=N&corners=x,y,...` | trains on the part of the JPEG in the body within the outline |
//!
//! A viewer asks for the next frame when it has drawn the last one. Each viewer gets as
//! many frames as it can draw, always the newest, and waits for no other viewer.
//!
//! Memory: the newest frame, once for all viewers. Cost: a copy to each socket.

use std::convert::Infallible;
use std::io::Cursor;
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, Query, Request, State};
use axum::http::{Method, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{Html, IntoResponse, Json, Response};
use axum::routing::{get, post, put};
use futures_util::stream::{Stream, unfold};
use image::{ImageFormat, ImageReader};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::watch;

use super::FAREWELL;
use super::cutout::parse_outline;
use super::guard::{Action, Guard, Refusal};
use super::lesson::{Errand, Plan, learn};
use super::live::{Live, thousandths};
use crate::advice;
use crate::picture::flatten_onto_white;

const PAGE: &str = include_str!("../page.html");

/// The policy of the page: it may send requests to this program only.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
                      img-src blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Maximum wait for a frame. After it, the viewer is told that there is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time for which pictures are encoded after a viewer's last request.
const ATTENTION: Duration = Duration::from_secs(7);
/// Maximum size of a request in bytes: a large model or a photograph.
const MOST_BYTES: usize = 16 << 20;

#[derive(Clone)]
struct Web {
    live: Arc<Live>,
    guard: Arc<Guard>,
    school: Arc<School>,
    stopped: watch::Receiver<bool>,
}

/// How objects are learned on the page, and who gets them.
#[derive(Debug, Default)]
pub struct School {
    /// How much a model holds, and whether it has chroma.
    pub plan: Plan,
    /// The command that waits for the first object, if any. It ends the page.
    pub errand: Option<Errand>,
}

/// An error of a request, with a message for people.
struct Problem(StatusCode, String);

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        (self.0, self.1).into_response()
    }
}

impl From<anyhow::Error> for Problem {
    fn from(error: anyhow::Error) -> Self {
        Self(StatusCode::BAD_REQUEST, format!("{error:#}"))
    }
}

/// The URL of the page. When it listens on all addresses, the URL has the address under
/// which other machines reach this one.
#[must_use]
pub fn url(address: SocketAddr, token: Option<&str>) -> String {
    let mut shown = address;
    if address.ip().is_unspecified() {
        // Nothing is sent: the system only tells the address from which it would send.
        let route = UdpSocket::bind("0.0.0.0:0").and_then(|s| s.connect("192.0.2.1:9").and_then(|()| s.local_addr()));
        shown.set_ip(route.map_or(std::net::Ipv4Addr::LOCALHOST.into(), |a| a.ip()));
    }
    token.map_or_else(|| format!("http://{shown}/"), |token| format!("http://{shown}/#token={token}"))
}

/// Serves the page until `stopped`, and then completes the answers that are being sent.
///
/// # Errors
/// When the listener fails.
pub async fn serve(
    listener: TcpListener,
    guard: Guard,
    school: School,
    live: Arc<Live>,
    mut stopped: watch::Receiver<bool>,
) -> Result<()> {
    let web = Web { live, guard: Arc::new(guard), school: Arc::new(school), stopped: stopped.clone() };
    let router = Router::new()
        .route("/frame", get(frame))
        .route("/events", get(events))
        .route("/status", get(status))
        .route("/models", post(add_model))
        .route("/models/{id}", get(give_model).delete(remove_model))
        .route("/threshold", put(set_threshold))
        .route("/learn", post(learn_object))
        .route_layer(from_fn_with_state(web.clone(), guarded))
        .route("/", get(page))
        .layer(DefaultBodyLimit::max(MOST_BYTES))
        .with_state(web);
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let mut over = stopped.clone();
    let served = axum::serve(listener, router).with_graceful_shutdown(async move {
        let _ = stopped.wait_for(|&s| s).await;
    });
    tokio::select! {
        served = served => served?,
        () = async { let _ = over.wait_for(|&s| s).await; tokio::time::sleep(FAREWELL).await } => {}
    }
    Ok(())
}

async fn guarded(State(web): State<Web>, request: Request<Body>, next: Next) -> Response {
    let query = request.uri().query().unwrap_or_default();
    let token = query.split('&').find_map(|pair| pair.strip_prefix("token="));
    let action = if matches!(*request.method(), Method::GET | Method::HEAD) { Action::Look } else { Action::Change };
    match web.guard.check(request.headers(), token, action) {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            let code = if refusal == Refusal::Token { StatusCode::UNAUTHORIZED } else { StatusCode::FORBIDDEN };
            Problem(code, refusal.text().into()).into_response()
        }
    }
}

async fn page() -> impl IntoResponse {
    let headers = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, Html(PAGE))
}

#[derive(Deserialize)]
struct Wanted {
    after: Option<u64>,
    details: Option<u8>,
}

async fn frame(State(mut web): State<Web>, Query(wanted): Query<Wanted>) -> Response {
    let details = wanted.details == Some(1);
    web.live.look(ATTENTION, details);
    let mut shots = web.live.shots.subscribe();
    let is_new = |shot: &Option<Arc<super::shot::Shot>>| {
        shot.as_ref().is_some_and(|s| s.body.is_some() && Some(s.number) != wanted.after)
    };
    let shot = tokio::select! {
        shot = shots.wait_for(is_new) => shot.ok().and_then(|s| s.clone()),
        () = tokio::time::sleep(PATIENCE) => None,
        _ = web.stopped.wait_for(|&s| s) => None,
    };
    let Some((shot, body)) = shot.and_then(|s| Some((s.clone(), s.body.clone()?))) else {
        return StatusCode::NO_CONTENT.into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_string()),
        (header::CACHE_CONTROL, "no-store".to_string()),
        (header::HeaderName::from_static("x-age-ms"), shot.at.elapsed().as_millis().to_string()),
    ];
    (headers, if details { body } else { body.slice(..shot.lean) }).into_response()
}

async fn events(State(web): State<Web>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let start = (web.live.shots.subscribe(), web.stopped);
    let stream = unfold(start, |(mut shots, mut stopped)| async move {
        tokio::select! {
            changed = shots.changed() => changed.ok()?,
            _ = stopped.wait_for(|&s| s) => return None,
        }
        let line = shots.borrow_and_update().as_ref().map_or_else(String::new, |s| s.line.clone());
        Some((Ok(Event::default().data(line)), (shots, stopped)))
    });
    Sse::new(stream).keep_alive(KeepAlive::default())
}

async fn status(State(web): State<Web>) -> impl IntoResponse {
    let live = &web.live;
    Json(json!({
        "source": live.source,
        "trouble": live.trouble(),
        "threshold": thousandths(live.threshold()),
        "generation": live.models.generation(),
        "models": live.models.list(),
        "dropped": live.frames.dropped(),
        "damaged": live.damage.count(),
        "errand": web.school.errand.as_ref().map(|e| json!({"name": e.name, "output": e.output.display().to_string()})),
    }))
}

#[derive(Deserialize)]
struct Named {
    name: String,
}

async fn add_model(
    State(web): State<Web>,
    Query(named): Query<Named>,
    body: Bytes,
) -> Result<impl IntoResponse, Problem> {
    let added = apart(move || web.live.models.add(&named.name, body.to_vec())).await?;
    tracing::info!("model {} added", added.name);
    Ok((StatusCode::CREATED, Json(json!({"id": added.id, "file": added.file_name()}))))
}

/// Runs slow work in another thread, so that other requests are served meanwhile.
async fn apart<T: Send + 'static>(work: impl FnOnce() -> Result<T> + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work).await.context("this failed; please report what was asked for")?
}

async fn give_model(State(web): State<Web>, Path(id): Path<u64>) -> Result<impl IntoResponse, Problem> {
    let entry = web.live.models.get(id).ok_or_else(gone)?;
    Ok(([(header::CONTENT_TYPE, "application/octet-stream")], entry.bytes.to_vec()))
}

async fn remove_model(State(web): State<Web>, Path(id): Path<u64>) -> Result<StatusCode, Problem> {
    let removed = apart(move || web.live.models.remove(id)).await?.ok_or_else(gone)?;
    tracing::info!("model {} removed", removed.name);
    Ok(StatusCode::NO_CONTENT)
}

fn gone() -> Problem {
    Problem(StatusCode::NOT_FOUND, "there is no such model, or not any more".into())
}

#[derive(Deserialize)]
struct Threshold {
    value: f32,
}

async fn set_threshold(State(web): State<Web>, Query(threshold): Query<Threshold>) -> Result<StatusCode, Problem> {
    if !(0.0..=1.0).contains(&threshold.value) {
        return Err(Problem(StatusCode::BAD_REQUEST, "a threshold lies between 0 and 1".into()));
    }
    web.live.set_threshold(threshold.value);
    Ok(StatusCode::NO_CONTENT)
}

#[derive(Deserialize)]
struct Lesson {
    name: String,
    corners: String,
}

async fn learn_object(
    State(web): State<Web>,
    Query(lesson): Query<Lesson>,
    body: Bytes,
) -> Result<impl IntoResponse, Problem> {
    Ok((StatusCode::CREATED, Json(apart(move || learn_from(&web, &lesson, &body)).await?)))
}

/// Trains on the part of a JPEG within an outline. The object goes to the errand, or else
/// into the models in use.
fn learn_from(web: &Web, lesson: &Lesson, jpeg: &[u8]) -> Result<serde_json::Value> {
    let outline = parse_outline(&lesson.corners)?;
    let image = ImageReader::with_format(Cursor::new(jpeg), ImageFormat::Jpeg).decode();
    let (frame, _) = flatten_onto_white(image.context("the picture is no JPEG, or damaged")?);
    let learned = learn(&frame, &outline, &lesson.name, &web.school.plan)?;
    let (keygraphs, found) = (learned.trained.keygraphs.kept, learned.found);
    tracing::info!("{} learned: {keygraphs} keygraphs", learned.name);
    let Some(errand) = &web.school.errand else {
        // With an errand, the command that waits for the object warns.
        if let Some(warning) = advice::warning(&learned.picture, &learned.trained) {
            tracing::warn!("the picture of {} {warning}", learned.name);
        }
        let added = web.live.models.add(&learned.name, learned.model)?;
        return Ok(json!({"id": added.id, "file": added.file_name(), "keygraphs": keygraphs, "found": found}));
    };
    errand.hand_over(learned)?;
    // This ends the source, and with it all threads.
    web.live.frames.close();
    Ok(json!({"id": null, "file": errand.output.display().to_string(), "keygraphs": keygraphs, "found": found}))
}
