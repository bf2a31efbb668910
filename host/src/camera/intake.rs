//! Bodies of requests, and those who wait to train.
//!
//! In: bodies, as they arrive. Out: whole bodies, and turns to train, one at a time. A body
//! that stops arriving is given up after `SILENCE`. All bodies together have `BUDGET_KIB`,
//! which a body takes as it arrives: one that was announced and is not sent takes none.
//! `MOST_WAITING` learners wait for their turn; others are told to come back later.
//!
//! Memory: the budget. Cost: a copy of each body.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, timeout, timeout_at};

/// Maximum size of all bodies together, KiB.
const BUDGET_KIB: usize = 32 << 10;
/// Maximum size of a body in bytes: a large model or a photograph.
const MOST_BYTES: usize = 16 << 20;
/// Maximum time between two pieces of a body.
const SILENCE: Duration = Duration::from_secs(10);
/// Maximum time of a body.
const LONGEST: Duration = Duration::from_secs(120);
/// Maximum number of learners that wait for their turn.
const MOST_WAITING: usize = 3;

/// Maximum time for the body of a request that is refused.
const PATIENCE: Duration = Duration::from_secs(5);

/// An error of a request, with a message for people.
#[derive(Debug)]
pub struct Problem(pub StatusCode, pub String);

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

fn busy(what: &str) -> Problem {
    Problem(StatusCode::SERVICE_UNAVAILABLE, format!("{what}: try again in some seconds"))
}

/// Reads a body that nobody wants, and keeps nothing of it: a client that still sends does not
/// see the answer.
pub async fn discard(body: Body) {
    let mut pieces = body.into_data_stream();
    let mut left = MOST_BYTES;
    let all = async {
        while let Some(Ok(piece)) = pieces.next().await
            && left > 0
        {
            left = left.saturating_sub(piece.len());
        }
    };
    let _ = timeout(PATIENCE, all).await;
}

/// The budget of bodies, and the turns.
#[derive(Clone, Debug)]
pub struct Intake {
    budget: Arc<Semaphore>,
    places: Arc<Semaphore>,
    turn: Arc<Semaphore>,
}

/// A whole body, and its part of the budget.
#[derive(Debug)]
pub struct Upload {
    /// The body.
    pub bytes: Vec<u8>,
    _budget: Option<OwnedSemaphorePermit>,
}

impl Default for Intake {
    fn default() -> Self {
        let semaphore = |permits| Arc::new(Semaphore::new(permits));
        // Who trains has a place too.
        Self { budget: semaphore(BUDGET_KIB), places: semaphore(MOST_WAITING + 1), turn: semaphore(1) }
    }
}

impl Intake {
    /// Reads a whole body.
    ///
    /// # Errors
    /// When the body is too large, stops arriving, or finds no room.
    pub async fn read(&self, body: Body) -> Result<Upload, Problem> {
        let (mut bytes, mut budget) = (Vec::new(), None::<OwnedSemaphorePermit>);
        let mut pieces = body.into_data_stream();
        let end = Instant::now() + LONGEST;
        loop {
            let piece = timeout_at(end, timeout(SILENCE, pieces.next())).await;
            let Ok(Ok(piece)) = piece else {
                return Err(Problem(StatusCode::REQUEST_TIMEOUT, "the rest of the request did not arrive".into()));
            };
            let Some(piece) = piece else { return Ok(Upload { bytes, _budget: budget }) };
            let piece = piece.map_err(|error| Problem(StatusCode::BAD_REQUEST, error.to_string()))?;
            let length = bytes.len() + piece.len();
            if length > MOST_BYTES {
                let told = format!("more than {} MB are not read", MOST_BYTES >> 20);
                return Err(Problem(StatusCode::PAYLOAD_TOO_LARGE, told));
            }
            let more = length.div_ceil(1024) - budget.as_ref().map_or(0, OwnedSemaphorePermit::num_permits);
            let more = u32::try_from(more).unwrap_or(u32::MAX);
            let permit = Arc::clone(&self.budget).try_acquire_many_owned(more);
            let permit = permit.map_err(|_| busy("too many uploads at a time"))?;
            match &mut budget {
                Some(budget) => budget.merge(permit),
                none => *none = Some(permit),
            }
            bytes.extend_from_slice(&piece);
        }
    }

    /// A place among those who train or wait. It is taken when the body has arrived, so that
    /// nobody holds a place with a body that stops.
    ///
    /// # Errors
    /// When all places are taken.
    pub fn place(&self) -> Result<OwnedSemaphorePermit, Problem> {
        Arc::clone(&self.places).try_acquire_owned().map_err(|_| busy("several objects are being learned"))
    }

    /// Waits for the turn to train, which ends when it is dropped.
    ///
    /// # Errors
    /// Never: the turns do not end.
    pub async fn turn(&self) -> Result<OwnedSemaphorePermit, Problem> {
        Arc::clone(&self.turn).acquire_owned().await.map_err(|_| busy("nobody can train"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::stream;
    use std::io;

    fn run<T>(future: impl Future<Output = T>) -> T {
        tokio::runtime::Builder::new_current_thread().enable_time().build().expect("a runtime").block_on(future)
    }

    /// A body of `pieces` of 1 MiB; with `stuck`, its end never comes.
    fn body(pieces: usize, stuck: bool) -> Body {
        let sent = stream::iter((0..pieces).map(|_| Ok::<_, io::Error>(vec![7; 1 << 20])));
        if stuck { Body::from_stream(sent.chain(stream::pending())) } else { Body::from_stream(sent) }
    }

    #[test]
    fn bodies_have_a_budget_that_comes_back() {
        run(async {
            let intake = Intake::default();
            assert_eq!(intake.read(body(17, false)).await.expect_err("too large").0, StatusCode::PAYLOAD_TOO_LARGE);
            let first = intake.read(body(16, false)).await.expect("room");
            let second = intake.read(body(15, false)).await.expect("room");
            assert_eq!((first.bytes.len(), second.bytes.len()), (16 << 20, 15 << 20));
            assert_eq!(intake.read(body(2, false)).await.expect_err("full").0, StatusCode::SERVICE_UNAVAILABLE);
            drop(first);
            intake.read(body(16, false)).await.expect("room again");
        });
    }

    #[test]
    fn bodies_that_stop_cost_what_has_arrived() {
        run(async {
            let intake = Intake::default();
            let mut stuck: Vec<_> = (0..60).map(|_| Box::pin(intake.read(body(0, true)))).collect();
            for one in &mut stuck {
                assert!(timeout(Duration::ZERO, one).await.is_err(), "it waits");
            }
            assert_eq!(intake.read(body(16, false)).await.expect("room").bytes.len(), 16 << 20);
        });
    }

    #[test]
    fn some_wait_for_their_turn_and_others_are_sent_away() {
        run(async {
            let intake = Intake::default();
            let places: Vec<_> = (0..=MOST_WAITING).map(|_| intake.place().expect("room")).collect();
            assert_eq!(intake.place().expect_err("full").0, StatusCode::SERVICE_UNAVAILABLE);
            let turn = intake.turn().await.expect("free");
            let mut next = Box::pin(intake.turn());
            assert!(timeout(Duration::ZERO, &mut next).await.is_err(), "it waits");
            drop((turn, places));
            let _turn = next.await.expect("free again");
            let _place = intake.place().expect("room again");
        });
    }
}
