//! Results, published to an MQTT broker (MQTT 3.1.1, over TCP or TLS).
//!
//! In: the outcome of each frame. Out, under a prefix (`keygraph/HOST` by default):
//!
//! | topic | retained | payload |
//! | --- | --- | --- |
//! | `PREFIX/status` | yes | `online`, or `offline`: the broker also publishes this when the program is gone (last will) |
//! | `PREFIX/detections` | no | the newest line of a frame with a detection, or of the first frame without one, at a limited rate |
//! | `PREFIX/objects/NAME` | yes | the state of an object, when it changes |
//! | `PREFIX/models` | yes | the models that were ordered, if orders are followed |
//! | `DISCOVERY/binary_sensor/NODE/OBJECT/config` | yes | the description of an object for Home Assistant, if asked for |
//!
//! The search does not wait for the broker. The newest state of every object and the newest
//! line are kept until the broker takes them. A new connection publishes all states again, and
//! removes states of objects that this program does not have. At the end the state of each
//! object is `gone`. Under a topic of orders, the broker says which models this program runs.
//!
//! A file uses only files above it:
//!
//! - [`topics`]: names of topics
//! - [`order`]: what cameras are to run
//! - [`messages`]: payloads of messages
//! - [`board`]: what the broker should hold
//! - [`tls`]: encrypted connections (without the feature `tls`: `no_tls`, which refuses them)
//! - [`broker`]: the address of the broker
//! - [`fetch`]: files from a web server
//! - [`fleet`]: carries out orders
//! - [`rollout`]: follows the orders of the broker
//! - [`link`]: the connection
//!
//! Memory: the board, and 16 messages. Cost: a line of JSON a frame with a detection.

pub mod topics;
pub mod order;
pub mod messages;
pub mod board;
#[cfg(feature = "tls")]
pub mod tls;
#[cfg(not(feature = "tls"))]
#[path = "no_tls.rs"]
pub mod tls;
pub mod broker;
pub mod fetch;
pub mod fleet;
pub mod rollout;
pub mod link;

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use rumqttc::{AsyncClient, ClientError, PublishOptions};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};

use super::live::{Live, Outcome};
use super::tracker::State;
use crate::clock::stamp;
use board::Board;
use broker::Broker;
use fleet::Fleet;
use link::MOST_BYTES;

/// Maximum time at the end of the program for the last messages.
const GOODBYE: Duration = Duration::from_secs(1);
/// How retained messages are published.
const KEPT: PublishOptions = PublishOptions::at_least_once().retained();

/// The end of the board that takes outcomes.
#[derive(Debug)]
pub struct Publisher {
    broker: Arc<Broker>,
    board: Arc<Board>,
    before: BTreeMap<String, State>,
    was_found: bool,
}

/// The end of the board that gives messages.
#[derive(Debug)]
pub struct Outlet {
    broker: Arc<Broker>,
    board: Arc<Board>,
}

/// Makes a publisher for the search, and its outlet for [`publish`].
#[must_use]
pub fn channel(broker: Broker) -> (Publisher, Outlet) {
    let board = Arc::new(Board::new(&broker.topics));
    let broker = Arc::new(broker);
    let outlet = Outlet { broker: Arc::clone(&broker), board: Arc::clone(&board) };
    (Publisher { broker, board, before: BTreeMap::new(), was_found: false }, outlet)
}

impl Publisher {
    /// Takes the outcome of a frame. Does not wait.
    pub fn take(&mut self, outcome: &Outcome) {
        let topics = &self.broker.topics;
        // Of objects with one name, the greatest state counts.
        let mut states: BTreeMap<&str, (State, Option<f32>)> = BTreeMap::new();
        for (name, state, score) in &outcome.objects {
            let entry = states.entry(name).or_insert((*state, *score));
            if *state > entry.0 {
                *entry = (*state, *score);
            }
        }
        for name in self.before.keys().filter(|name| !states.contains_key(name.as_str())) {
            // An empty payload removes a retained message.
            if let Some(config) = topics.config(name) {
                self.board.set(config, String::new());
            }
            self.board.set(topics.object(name), String::new());
        }
        for (&name, &(state, score)) in &states {
            let before = self.before.get(name);
            if before.is_none()
                && let Some(config) = topics.config(name)
            {
                self.board.set(config, messages::config(topics, name));
            }
            if before != Some(&state) {
                let payload = messages::state(name, state, score, &outcome.line);
                self.board.set_state(topics.object(name), name, payload);
            }
        }
        self.before = states.into_iter().map(|(name, (state, _))| (name.to_string(), state)).collect();
        let is_found = outcome.line["detections"].as_array().is_some_and(|d| !d.is_empty());
        if is_found || self.was_found {
            let line = outcome.line.to_string();
            if line.len() <= MOST_BYTES {
                self.board.set_line(line);
            } else {
                tracing::warn!("a line of {} bytes is too long for the broker", line.len());
            }
        }
        self.was_found = is_found;
    }
}

/// Publishes messages until `stopped`, then says that the program ends, and disconnects. Takes
/// at most `GOODBYE` for that. With a `fleet`, the orders of the broker are followed meanwhile.
pub async fn publish(outlet: Outlet, fleet: Option<Fleet>, live: Arc<Live>, mut stopped: watch::Receiver<bool>) {
    let Outlet { broker, board } = outlet;
    let (client, events) = link::client(&broker);
    let (up, is_up) = watch::channel(false);
    let (newest, orders) = watch::channel(None);
    if let Some(fleet) = fleet {
        // It ends with the connection.
        let topics = broker.topics.clone();
        tokio::spawn(rollout::follow(Arc::new(fleet), live, Arc::clone(&board), topics, orders));
    }
    let connected = link::keep_connected(events, client.clone(), Arc::clone(&broker), Arc::clone(&board), up, newest);
    let mut connection = tokio::spawn(connected);
    tokio::select! {
        ended = deliver(&client, &broker, &board, is_up.clone()) => drop(ended),
        _ = stopped.wait_for(|&s| s) => {}
    }
    let has_broker = *is_up.borrow();
    if has_broker && timeout(GOODBYE, say_goodbye(&client, &board, &mut connection)).await.is_err() {
        tracing::warn!("the broker at {} does not answer", broker.place());
    }
    // Without an answer the connection is cut, and the broker publishes the last will.
    connection.abort();
}

/// Publishes what the board has, as fast as the broker takes it; lines at their rate.
async fn deliver(
    client: &AsyncClient,
    broker: &Broker,
    board: &Board,
    mut is_up: watch::Receiver<bool>,
) -> Result<Infallible, ClientError> {
    let topic = broker.topics.detections();
    let mut next_line = Instant::now();
    loop {
        // The connection lives as long as this task.
        let _ = is_up.wait_for(|&up| up).await;
        while let Some((topic, payload)) = board.next() {
            client.publish(topic, payload, KEPT).await?;
        }
        if next_line <= Instant::now()
            && let Some(line) = board.take_line()
        {
            client.publish(topic.as_str(), line, PublishOptions::at_most_once()).await?;
            next_line = Instant::now() + broker.period;
        }
        tokio::select! {
            () = board.changed.notified() => {}
            () = sleep_until(next_line), if board.has_line() => {}
        }
    }
}

/// Publishes that the program ends, waits until the broker has it, and disconnects.
async fn say_goodbye(client: &AsyncClient, board: &Board, connection: &mut JoinHandle<()>) -> anyhow::Result<()> {
    board.end(&stamp(SystemTime::now()));
    let mut last = None;
    while let Some((topic, payload)) = board.next() {
        last = Some(client.publish_tracked(topic, payload, KEPT).await?);
    }
    if let Some(last) = last {
        last.wait_async().await?;
    }
    client.disconnect().await?;
    Ok(connection.await?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn frame(objects: &[(&str, State)], detections: usize) -> Outcome {
        let objects = objects.iter().map(|&(name, state)| (name.to_string(), state, None)).collect();
        Outcome { line: json!({"frame": 1, "detections": vec![0; detections]}), objects }
    }

    fn publisher(discovery: Option<&str>) -> Publisher {
        let topics = topics::Topics::new("test".into(), discovery.map(str::to_string));
        let (host, period) = (String::new(), Duration::ZERO);
        let (publisher, outlet) =
            channel(Broker { host, port: 0, login: None, tls: None, topics, orders: None, period });
        assert_eq!(outlet.board.next(), Some(("test/status".into(), "online".into())));
        publisher
    }

    /// The messages after an outcome, without their times.
    fn after(publisher: &mut Publisher, outcome: &Outcome) -> String {
        publisher.take(outcome);
        let board = &publisher.board;
        let mut all = String::new();
        while let Some((topic, payload)) = board.next() {
            let state = if payload.is_empty() { "removed".into() } else { payload };
            let state = state.split(r#""state":""#).nth(1).map_or(state.as_str(), |s| s.split('"').next().unwrap_or(s));
            let state = if state.starts_with('{') { "described" } else { state };
            all += &format!("{} {state}, ", topic.trim_start_matches("test/objects/"));
        }
        if board.take_line().is_some() {
            all += "line";
        }
        all
    }

    #[test]
    fn changes_are_told_once() {
        let mut publisher = publisher(None);
        let mut after = |state, detections| after(&mut publisher, &frame(&[("book", state)], detections));
        assert_eq!(after(State::Searching, 0), "book searching, ");
        assert_eq!(after(State::Searching, 0), "");
        assert_eq!(after(State::Found, 1), "book found, line");
        assert_eq!(after(State::Found, 1), "line");
        assert_eq!(after(State::Lost, 0), "book lost, line", "the first frame without a detection");
        assert_eq!(after(State::Lost, 0), "");
    }

    #[test]
    fn no_state_is_lost_while_the_broker_is_slow() {
        let mut publisher = publisher(None);
        let names: Vec<String> = (0..100).map(|i| format!("{i:03}")).collect();
        let all = |state| frame(&names.iter().map(|n| (n.as_str(), state)).collect::<Vec<_>>(), 1);
        publisher.take(&all(State::Found));
        publisher.take(&all(State::Tracked));
        let sent = after(&mut publisher, &all(State::Lost));
        assert_eq!(sent.matches(" lost, ").count(), 100, "{sent}");
        assert_eq!(sent.matches(", ").count(), 100, "only the newest: {sent}");
    }

    #[test]
    fn objects_of_one_name_share_the_greatest_state() {
        let mut publisher = publisher(None);
        let both = frame(&[("book", State::Tracked), ("book", State::Searching)], 0);
        assert_eq!(after(&mut publisher, &both), "book tracked, ");
        assert_eq!(after(&mut publisher, &both), "");
    }

    #[test]
    fn an_object_that_is_unloaded_is_removed() {
        let mut publisher = publisher(Some("home"));
        let config = "home/binary_sensor/keygraph_test/a_2Fb/config";
        let sent = after(&mut publisher, &frame(&[("a/b", State::Found)], 0));
        assert_eq!(sent, format!("{config} described, a%2Fb found, "));
        assert_eq!(after(&mut publisher, &frame(&[], 0)), format!("{config} removed, a%2Fb removed, "));
    }
}
