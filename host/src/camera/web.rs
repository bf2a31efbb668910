//! The page, and the requests of other programs.
//!
//! In: requests over HTTP. Out: answers:
//!
//! | request | answer |
//! | --- | --- |
//! | `GET /`, `/page.css`, `/page.js`, ... | the page, which asks for the rest |
//! | `GET /frame?after=N&details=1` | the newest searched frame that is not number N, as soon as there is one: picture and outlines in one body, see [`super::shot`]; 204 after 5 s without a frame |
//! | `GET /snapshot.jpg?outlines=0` | the newest frame as a JPEG, see [`super::feed`] |
//! | `GET /stream.mjpg?outlines=0&fps=F` | frames as Motion-JPEG |
//! | `GET /events` | JSON lines of all frames as server-sent events |
//! | `GET /health` | whether frames arrive, without a token: 200, or 503 |
//! | `GET /metrics` | numbers for Prometheus |
//! | `GET /status` | the trouble of the source, the models, the threshold, the [`Errand`] |
//! | `POST /models?name=N` | adds the model in the body |
//! | `GET /models/ID`, `DELETE /models/ID` | returns, removes a model |
//! | `PUT /threshold?value=V` | sets the minimum score |
//! | `POST /learn?name=N&corners=x,y,...&from=F` | trains on the picture in the body: on the part within the outline, or all of it. `from` is `camera` (a frame) or `picture` |
//!
//! A viewer asks for the next frame when it has drawn the last one. Each viewer gets as
//! many frames as it can draw, always the newest, and waits for no other viewer.
//!
//! Memory: the newest frame, once for all viewers; one picture at a time that is learned.
//! Cost: a copy to each socket.

use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr, TcpListener, UdpSocket};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use axum::body::Body;
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Json, Response};
use axum::routing::{get, post, put};
use axum::{Extension, Router};
use futures_util::stream::{Stream, unfold};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::watch;

use super::attempts::Attempts;
use super::feed::{self, Feed};
use super::guard::{Action, Guard, Refusal, token_in};
use super::intake::{Intake, Problem, Upload, discard};
use super::lesson::{Errand, learn, learn_picture};
use super::live::{Live, Wish, thousandths};
use super::server::{self, Visit};
use super::tally::Others;
use crate::advice;
use crate::cutout::{cut_out, parse_outline};
use crate::learn::{Learned, Plan};
use crate::picture::{decode_sent, flatten_onto_white, opaque};
use crate::report::score;

const PAGE: &str = include_str!("../page/page.html");
/// The other files of the page: path, type, text.
const PARTS: [(&str, &str, &str); 4] = [
    ("/page.css", "text/css; charset=utf-8", include_str!("../page/page.css")),
    ("/draw.js", "text/javascript; charset=utf-8", include_str!("../page/draw.js")),
    ("/lesson.js", "text/javascript; charset=utf-8", include_str!("../page/lesson.js")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../page/page.js")),
];

/// The policy of the page: its files come from this program, and it may send requests to this program only.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Maximum wait for a frame. After it, the viewer is told that there is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time for which pictures are encoded after a viewer's last request.
const ATTENTION: Duration = Duration::from_secs(7);
/// Maximum number of pixels of a picture to learn from: a photograph of 4032x3024 px, as telephones
/// take them. A picture that is decoded takes up to 9 bytes a pixel.
const MOST_PIXELS: u64 = 12_500_000;

/// Size of a piece of a model that is sent, bytes.
const PIECE: usize = 64 << 10;

#[derive(Clone)]
struct Web {
    live: Arc<Live>,
    guard: Arc<Guard>,
    attempts: Attempts,
    intake: Intake,
    feed: Feed,
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
    stopped: watch::Receiver<bool>,
) -> Result<()> {
    let web = Web {
        live: Arc::clone(&live),
        guard: Arc::new(guard),
        attempts: Attempts::default(),
        intake: Intake::default(),
        feed: Feed::new(Arc::clone(&live), stopped.clone()),
        school: Arc::new(school),
        stopped: stopped.clone(),
    };
    let mut router = Router::new()
        .route("/frame", get(frame))
        .route("/snapshot.jpg", get(snapshot))
        .route("/stream.mjpg", get(stream))
        .route("/events", get(events))
        .route("/status", get(status))
        .route("/metrics", get(metrics))
        .route("/models", post(add_model))
        .route("/models/{id}", get(give_model).delete(remove_model))
        .route("/threshold", put(set_threshold))
        .route("/learn", post(learn_object))
        .route_layer(from_fn_with_state(web.clone(), guarded))
        .route("/", get(page))
        .route("/health", get(health));
    for (path, kind, text) in PARTS {
        router = router.route(path, get(move || async move { (plain_headers(kind), text) }));
    }
    server::serve(listener, router.with_state(web), live, stopped).await
}

async fn guarded(
    State(web): State<Web>,
    Extension(visit): Extension<Arc<Visit>>,
    request: Request<Body>,
    next: Next,
) -> Response {
    let client = client(&web.guard, &visit, request.headers());
    if web.attempts.is_barred(client) {
        return Problem(StatusCode::TOO_MANY_REQUESTS, "too many wrong tokens: try again in some seconds".into())
            .into_response();
    }
    let action = if matches!(*request.method(), Method::GET | Method::HEAD) { Action::Look } else { Action::Change };
    let refusal = match web.guard.check(request.headers(), token_in(request.uri()).as_deref(), action) {
        Ok(()) => return next.run(request).await,
        Err(refusal) => refusal,
    };
    if refusal == Refusal::Wrong {
        let held = web.attempts.fail(client, Instant::now());
        if held.failures.is_power_of_two() {
            tracing::warn!("a wrong token from {client} ({} so far)", held.failures);
        }
        tokio::time::sleep(held.delay).await;
    }
    discard(request.into_body()).await;
    let code = match refusal {
        Refusal::Token | Refusal::Wrong => StatusCode::UNAUTHORIZED,
        Refusal::Host | Refusal::Origin => StatusCode::FORBIDDEN,
    };
    Problem(code, refusal.text().into()).into_response()
}

/// The address of a client. Behind a proxy on this machine, the address that the proxy adds
/// last.
fn client(guard: &Guard, visit: &Visit, headers: &HeaderMap) -> IpAddr {
    let told = headers.get_all("x-forwarded-for").iter().next_back().and_then(|v| v.to_str().ok());
    let told = told.and_then(|v| v.rsplit(',').next()?.trim().parse().ok());
    told.filter(|_| guard.is_behind_proxy() && visit.address.is_loopback()).unwrap_or(visit.address)
}

async fn page() -> impl IntoResponse {
    let headers = [(header::CONTENT_SECURITY_POLICY, POLICY), (header::REFERRER_POLICY, "no-referrer")];
    (plain_headers("text/html; charset=utf-8"), headers, PAGE)
}

/// Headers of a file of the page. Nothing is kept: the next program may have another page.
const fn plain_headers(kind: &str) -> [(header::HeaderName, &str); 3] {
    [(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-store"), (header::X_CONTENT_TYPE_OPTIONS, "nosniff")]
}

#[derive(Deserialize)]
struct Wanted {
    after: Option<u64>,
    details: Option<u8>,
}

async fn frame(
    State(mut web): State<Web>,
    Extension(visit): Extension<Arc<Visit>>,
    Query(wanted): Query<Wanted>,
) -> Response {
    visit.look();
    let details = wanted.details == Some(1);
    web.live.look(ATTENTION, if details { Wish::Details } else { Wish::Picture });
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

async fn snapshot(
    State(mut web): State<Web>,
    Extension(visit): Extension<Arc<Visit>>,
    Query(wanted): Query<feed::Wanted>,
) -> Result<Response, Problem> {
    visit.look();
    Ok(shared(&web.guard, web.feed.snapshot(wanted).await?))
}

async fn stream(
    State(web): State<Web>,
    Extension(visit): Extension<Arc<Visit>>,
    Query(wanted): Query<feed::Wanted>,
) -> Result<Response, Problem> {
    visit.look();
    Ok(shared(&web.guard, web.feed.stream(wanted, visit)?))
}

/// A picture that pages elsewhere may show if they know the token. Without a token, the browser
/// keeps it from them: they may be any page that the user of this machine opens.
fn shared(guard: &Guard, mut answer: Response) -> Response {
    let policy = if guard.has_token() { "cross-origin" } else { "same-origin" };
    let name = header::HeaderName::from_static("cross-origin-resource-policy");
    answer.headers_mut().insert(name, header::HeaderValue::from_static(policy));
    answer
}

async fn events(
    State(web): State<Web>,
    Extension(visit): Extension<Arc<Visit>>,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    visit.look();
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

/// Whether the program does its work, for a supervisor. Anybody may ask.
async fn health(State(web): State<Web>) -> impl IntoResponse {
    let camera = web.live.delivers();
    let code = if camera { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    (code, Json(json!({"alive": true, "camera": camera, "models": web.live.models.count()})))
}

async fn metrics(State(web): State<Web>) -> impl IntoResponse {
    let live = &web.live;
    let others = Others {
        dropped: live.frames.dropped(),
        damaged: live.damage.count(),
        models: live.models.count(),
        camera: live.delivers(),
    };
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], live.tally.text(&others))
}

#[derive(Deserialize)]
struct Named {
    name: String,
}

async fn add_model(
    State(web): State<Web>,
    Query(named): Query<Named>,
    body: Body,
) -> Result<impl IntoResponse, Problem> {
    let upload = web.intake.read(body).await?;
    let added = apart(move || web.live.models.add(&named.name, upload.bytes)).await?;
    tracing::info!("model {} added", added.name);
    Ok((StatusCode::CREATED, Json(json!({"id": added.id, "file": added.file_name()}))))
}

/// Runs slow work in another thread, so that other requests are served meanwhile.
async fn apart<T: Send + 'static>(work: impl FnOnce() -> Result<T> + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work).await.context("this failed; please report what was asked for")?
}

async fn give_model(State(web): State<Web>, Path(id): Path<u64>) -> Result<impl IntoResponse, Problem> {
    let entry = web.live.models.get(id).ok_or_else(gone)?;
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_string()),
        (header::CONTENT_LENGTH, entry.length.to_string()),
    ];
    // In pieces: whole models, one for each client, would take much memory.
    let pieces = unfold((entry, 0), |(entry, start)| async move {
        let length = PIECE.min(entry.length - start);
        if length == 0 {
            return None;
        }
        let (entry, piece) = tokio::task::spawn_blocking(move || {
            let mut piece = vec![0; length];
            let read = entry.read_into(start, &mut piece);
            (entry, read.map(|()| piece))
        })
        .await
        .ok()?;
        Some((piece, (entry, start + length)))
    });
    Ok((headers, Body::from_stream(pieces)))
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
    corners: Option<String>,
    #[serde(default)]
    from: Subject,
}

/// What an object is learned from.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Subject {
    /// A frame of the camera, which may be mirrored.
    #[default]
    Camera,
    /// A picture of the object.
    Picture,
}

async fn learn_object(
    State(web): State<Web>,
    Query(lesson): Query<Lesson>,
    body: Body,
) -> Result<impl IntoResponse, Problem> {
    let upload = web.intake.read(body).await?;
    let place = web.intake.place()?;
    let turn = web.intake.turn().await?;
    let learned = apart(move || {
        // The turn ends with the work, even when the client is gone.
        let _held = (place, turn);
        learn_from(&web, &lesson, upload)
    });
    Ok((StatusCode::CREATED, Json(learned.await?)))
}

/// Trains on a picture, or on the part of it within an outline. The object goes to the errand, or
/// else into the models in use.
fn learn_from(web: &Web, lesson: &Lesson, upload: Upload) -> Result<serde_json::Value> {
    let outline = lesson.corners.as_deref().map(parse_outline).transpose()?;
    let alone = web.live.models.without_merges();
    let image = decode_sent(&upload.bytes, MOST_PIXELS)?;
    drop(upload);
    let (name, plan) = (&lesson.name, &web.school.plan);
    let learned = match (lesson.from, outline) {
        (Subject::Camera, Some(outline)) => learn(&flatten_onto_white(image).0, &outline, name, plan)?,
        (Subject::Camera, None) => {
            bail!("mark the object in the frame (corners=x,y,...), or give from=picture for a picture of it alone")
        }
        (Subject::Picture, Some(outline)) => {
            learn_picture(cut_out(&flatten_onto_white(image).0, &outline)?, name, plan)?
        }
        (Subject::Picture, None) => {
            let shown =
                opaque(&image).context("the picture is transparent everywhere: there is nothing to train on")?;
            drop(image);
            learn_picture(shown.picture, name, plan)?
        }
    };
    // The model is merged next, which needs the memory.
    drop(alone);
    let warning = advice::warning(&learned.picture, &learned.trained);
    let (keygraphs, found) = (learned.trained.keygraphs.kept, learned.found.map(score));
    tracing::info!("{} learned: {keygraphs} keygraphs", learned.name);
    let Some(errand) = &web.school.errand else {
        // With an errand, the command that waits for the object warns.
        if let Some(warning) = &warning {
            tracing::warn!("the picture of {} {warning}", learned.name);
        }
        let Learned { name, model, picture, .. } = learned;
        drop(picture);
        let added = web.live.models.add(&name, model)?;
        return Ok(json!({
            "id": added.id, "file": added.file_name(), "keygraphs": keygraphs, "found": found, "warning": warning,
        }));
    };
    errand.hand_over(learned)?;
    // This ends the source, and with it all threads.
    web.live.frames.close();
    Ok(json!({
        "id": null, "file": errand.output.display().to_string(), "keygraphs": keygraphs, "found": found, "warning": warning,
    }))
}
