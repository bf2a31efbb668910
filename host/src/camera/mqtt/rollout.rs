//! Follows the orders of the broker, and reports what is run.
//!
//! In: the newest payload under the topic of orders. Out: the models in use, and a report under
//! `PREFIX/models`. An order that cannot be carried out is tried again after 5, 10, 20 ... 300
//! seconds, until another one comes; the models in use stay meanwhile.
//!
//! Memory and cost: those of [`Fleet`].

use std::future::pending;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use super::super::live::Live;
use super::board::Board;
use super::fleet::Fleet;
use super::messages;
use super::order::Order;
use super::topics::Topics;
use crate::clock::stamp;

/// Minimum and maximum time between two attempts.
const PAUSES: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(300)];

/// The newest order of the broker; `None` before there is one.
pub type Newest = Option<Vec<u8>>;

/// Carries out the newest order, until the channel ends.
pub async fn follow(
    fleet: Arc<Fleet>,
    live: Arc<Live>,
    board: Arc<Board>,
    topics: Topics,
    newest: watch::Receiver<Newest>,
) {
    let mut newest = newest;
    let [mut pause, most] = PAUSES;
    let report = |wanted: Option<&str>, error: Option<&str>| {
        let running = fleet.running().clone();
        board.set(topics.models(), messages::models(running.as_ref(), wanted, error, &stamp(SystemTime::now())));
    };
    report(None, None);
    let mut told = None;
    loop {
        let payload = newest.borrow_and_update().clone().filter(|payload| !payload.is_empty());
        let mut is_done = true;
        match payload.map(|payload| Order::parse(&payload)) {
            None => {}
            Some(Err(error)) => {
                tracing::warn!("{error:#}; the models stay as they are");
                report(None, Some(&format!("{error:#}")));
            }
            Some(Ok(order)) => {
                let version = order.version.clone();
                if fleet.running().as_ref() != Some(&order) {
                    report(Some(&version), None);
                }
                match carry_out(&fleet, &live, order, &newest).await {
                    Ok(()) => {
                        told = None;
                        report(Some(&version), None);
                    }
                    Err(error) => {
                        is_done = false;
                        report(Some(&version), Some(&error));
                        if told.as_ref() != Some(&error) {
                            tracing::warn!("order {version}: {error}; the models stay as they are; trying again");
                            told = Some(error);
                        }
                    }
                }
            }
        }
        let again = async {
            if is_done {
                pending().await
            } else {
                sleep(pause).await;
            }
        };
        tokio::select! {
            () = again => pause = (pause * 2).min(most),
            changed = newest.changed() => {
                if changed.is_err() {
                    return;
                }
                pause = PAUSES[0];
            }
        }
    }
}

/// Carries out an order in another thread, until another one comes.
async fn carry_out(
    fleet: &Arc<Fleet>,
    live: &Arc<Live>,
    order: Order,
    newest: &watch::Receiver<Newest>,
) -> Result<(), String> {
    if fleet.running().as_ref() == Some(&order) {
        return Ok(());
    }
    let (fleet, live, newest) = (Arc::clone(fleet), Arc::clone(live), newest.clone());
    let work = move || {
        let goes_on = || !newest.has_changed().unwrap_or(true);
        let fetched = fleet.carry_out(&order, &live.models, &goes_on).map_err(|error| format!("{error:#}"))?;
        let (version, count) = (order.version, order.models.len());
        tracing::info!("order {version}: {count} models in use, {fetched} of them fetched");
        Ok(())
    };
    spawn_blocking(work).await.unwrap_or_else(|error| Err(error.to_string()))
}
