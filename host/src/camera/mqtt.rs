//! Results, published to an MQTT broker (MQTT 3.1.1, over TCP).
//!
//! In: the outcome of each frame. Out, under a prefix (`keygraph/HOST` by default):
//!
//! | topic | retained | payload |
//! | --- | --- | --- |
//! | `PREFIX/status` | yes | `online`, or `offline`: the broker also publishes this when the program is gone (last will) |
//! | `PREFIX/detections` | no | the JSON line of each frame with a detection, and of the first frame without one |
//! | `PREFIX/objects/NAME` | yes | `{"state","score","frame"}` when the state of an object changes |
//!
//! The search does not wait for the broker. When the broker is slow, lines are dropped, and
//! the newest state of each object is kept; it is published when the broker is back.
//! Attempts to connect are 1, 2, 4 ... 30 seconds apart.
//!
//! Memory: 64 messages, and one state an object. Cost: a message a frame.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use rumqttc::{AsyncClient, Event, EventLoop, LastWill, MqttOptions, Packet, QoS};
use serde_json::json;
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::{sleep, timeout};

use super::FAREWELL;
use super::live::Outcome;
use super::tracker::State;
use crate::report::rounded;

/// Maximum number of messages that wait for the broker.
const QUEUE: usize = 64;
/// Interval of keep-alive messages. The broker takes the program for gone after 1.5 times
/// this silence.
const KEEP_ALIVE: Duration = Duration::from_secs(10);
/// Minimum and maximum time between two attempts to connect.
const PAUSES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];
/// Maximum size of a message in bytes: a line with many detections.
const MOST_BYTES: usize = 1 << 20;

/// The address of a broker, and the prefix of the topics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broker {
    host: String,
    port: u16,
    login: Option<(String, String)>,
    prefix: String,
}

impl Broker {
    /// Parses `mqtt://[USER:PASSWORD@]HOST[:PORT][/PREFIX]`.
    ///
    /// # Errors
    /// When `url` has another form, asks for TLS, or the prefix has + or # in it.
    pub fn parse(url: &str) -> Result<Self> {
        const FORM: &str = "a broker is given as mqtt://[USER:PASSWORD@]HOST[:PORT][/PREFIX]";
        let rest = match url.split_once("://") {
            Some(("mqtt", rest)) => rest,
            Some(("mqtts" | "ssl" | "tls", _)) => {
                bail!("TLS is not supported: let a broker on this machine bridge to the one outside")
            }
            _ => bail!(FORM),
        };
        let (place, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let (login, place) = match place.rsplit_once('@') {
            Some((login, place)) => (Some(login.split_once(':').unwrap_or((login, ""))), place),
            None => (None, place),
        };
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) if !port.contains(']') => (host, port.parse().ok().context(FORM)?),
            _ => (place, 1883),
        };
        ensure!(!host.is_empty(), FORM);
        let prefix = prefix.trim_matches('/');
        ensure!(!prefix.contains(['+', '#']), "a topic prefix has no + and no #");
        let prefix = if prefix.is_empty() { format!("keygraph/{}", level(&host_name())) } else { prefix.into() };
        let login = login.map(|(user, password)| (unescape(user), unescape(password)));
        Ok(Self { host: host.trim_matches(['[', ']']).into(), port, login, prefix })
    }
}

/// Replaces escapes such as `%40` by their characters.
fn unescape(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = (*first == b'%').then(|| tail.get(..2)).flatten().and_then(|h| std::str::from_utf8(h).ok());
        match code.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Converts a name to one level of a topic.
fn level(name: &str) -> String {
    name.chars().map(|c| if matches!(c, '/' | '+' | '#' | '\0') { '_' } else { c }).collect()
}

fn host_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").or_else(|_| std::env::var("HOSTNAME"));
    name.map_or_else(|_| "camera".into(), |n| n.trim().to_string())
}

enum Message {
    Line(String),
    State { object: String, payload: String },
}

/// The end of the channel that takes outcomes.
#[derive(Debug)]
pub struct Publisher {
    queue: mpsc::Sender<Message>,
    before: BTreeMap<String, State>,
    was_found: bool,
    /// Number of messages that were dropped, since the broker was too slow.
    dropped: u64,
}

/// The end of the channel that gives messages.
#[derive(Debug)]
pub struct Outlet {
    broker: Broker,
    queue: mpsc::Receiver<Message>,
}

/// Makes a publisher for the search, and its outlet for [`publish`].
#[must_use]
pub fn channel(broker: Broker) -> (Publisher, Outlet) {
    let (sender, queue) = mpsc::channel(QUEUE);
    (Publisher { queue: sender, before: BTreeMap::new(), was_found: false, dropped: 0 }, Outlet { broker, queue })
}

impl Publisher {
    /// Takes the outcome of a frame. Does not wait.
    pub fn take(&mut self, outcome: &Outcome) {
        let mut states = BTreeMap::new();
        for (name, state, score) in &outcome.objects {
            states.insert(name.clone(), *state);
            if self.before.get(name) != Some(state) {
                let payload = json!({
                    "state": state.name(),
                    "score": score.map(|s| rounded(s, 4)),
                    "frame": outcome.line["frame"],
                });
                if !self.send(Message::State { object: name.clone(), payload: payload.to_string() }) {
                    // The state was not sent: it will be sent with the next frame.
                    states.remove(name);
                }
            }
        }
        for name in self.before.keys().filter(|n| !states.contains_key(*n)).cloned().collect::<Vec<_>>() {
            if outcome.objects.iter().all(|o| o.0 != name) {
                // An empty payload removes a retained message.
                self.send(Message::State { object: name, payload: String::new() });
            }
        }
        self.before = states;
        let is_found = outcome.line["detections"].as_array().is_some_and(|d| !d.is_empty());
        if is_found || self.was_found {
            self.send(Message::Line(outcome.line.to_string()));
        }
        self.was_found = is_found;
    }

    fn send(&mut self, message: Message) -> bool {
        let sent = self.queue.try_send(message).is_ok();
        if !sent {
            self.dropped += 1;
            if self.dropped.is_power_of_two() {
                tracing::warn!("the broker is slow: {} messages dropped so far", self.dropped);
            }
        }
        sent
    }
}

/// Publishes messages until `stopped`, then publishes `offline` and disconnects.
pub async fn publish(outlet: Outlet, mut stopped: watch::Receiver<bool>) {
    let Outlet { broker, mut queue } = outlet;
    let status = format!("{}/status", broker.prefix);
    let id = format!("keygraph-{}-{}", level(&host_name()), std::process::id());
    let mut options = MqttOptions::new(id, &broker.host, broker.port);
    options.set_keep_alive(KEEP_ALIVE).set_max_packet_size(MOST_BYTES, MOST_BYTES);
    options.set_last_will(LastWill::new(&status, "offline", QoS::AtLeastOnce, true));
    if let Some((user, password)) = &broker.login {
        options.set_credentials(user, password);
    }
    let (client, events) = AsyncClient::new(options, QUEUE);
    let link = Arc::new(Link::default());
    let connection =
        tokio::spawn(keep_connected(events, Arc::clone(&link), format!("{}:{}", broker.host, broker.port)));

    // The newest state of each object, for a broker that lost it.
    let mut states = BTreeMap::new();
    let send = |topic: &str, qos: QoS, retain: bool, payload: &str| {
        link.up.load(Ordering::Relaxed) && client.try_publish(topic, qos, retain, payload).is_ok()
    };
    loop {
        tokio::select! {
            message = queue.recv() => match message {
                None => break,
                Some(Message::Line(line)) => _ = send(&format!("{}/detections", broker.prefix), QoS::AtMostOnce, false, &line),
                Some(Message::State { object, payload }) => {
                    let topic = format!("{}/objects/{}", broker.prefix, level(&object));
                    send(&topic, QoS::AtLeastOnce, true, &payload);
                    states.insert(topic, payload);
                }
            },
            () = link.connected.notified() => {
                send(&status, QoS::AtLeastOnce, true, "online");
                for (topic, payload) in &states {
                    send(topic, QoS::AtLeastOnce, true, payload);
                }
            }
            _ = stopped.wait_for(|&s| s) => break,
        }
    }
    if send(&status, QoS::AtLeastOnce, true, "offline") {
        let _ = client.try_disconnect();
        let _ = timeout(FAREWELL, connection).await;
    }
}

/// The state of the connection, for the publisher.
#[derive(Debug, Default)]
struct Link {
    up: AtomicBool,
    connected: Notify,
}

/// Keeps the connection up until this program disconnects.
async fn keep_connected(mut events: EventLoop, link: Arc<Link>, name: String) {
    let [mut pause, most] = PAUSES;
    let mut told = false;
    loop {
        match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                tracing::info!("connected to the broker at {name}");
                (pause, told) = (PAUSES[0], false);
                link.up.store(true, Ordering::Relaxed);
                link.connected.notify_one();
            }
            Ok(Event::Outgoing(rumqttc::Outgoing::Disconnect)) => return,
            Ok(_) => {}
            Err(error) => {
                link.up.store(false, Ordering::Relaxed);
                if !told {
                    tracing::warn!("no broker at {name} ({error}): trying again");
                    told = true;
                }
                sleep(pause).await;
                pause = (pause * 2).min(most);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_brokers() {
        let broker = Broker::parse("mqtt://me:p%40ss@broker.lan:1884/plant/door/").expect("parses");
        let expected = Broker {
            host: "broker.lan".into(),
            port: 1884,
            login: Some(("me".into(), "p@ss".into())),
            prefix: "plant/door".into(),
        };
        assert_eq!(broker, expected);
        let plain = Broker::parse("mqtt://[::1]").expect("parses");
        assert_eq!((plain.host.as_str(), plain.port, plain.login), ("::1", 1883, None));
        assert!(plain.prefix.starts_with("keygraph/"), "{}", plain.prefix);
        for (wrong, word) in [
            ("broker.lan", "mqtt://"),
            ("mqtt://", "mqtt://"),
            ("mqtt://a:b", "mqtt://"),
            ("mqtts://a", "TLS"),
            ("mqtt://a/x/#", "no #"),
        ] {
            let error = Broker::parse(wrong).expect_err(wrong).to_string();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }

    #[test]
    fn changes_are_told_once_and_a_full_queue_loses_no_state() {
        let (mut publisher, mut outlet) = channel(Broker::parse("mqtt://localhost/test").expect("parses"));
        let frame = |state, detections: usize| Outcome {
            line: json!({"frame": 1, "detections": vec![0; detections]}),
            objects: vec![("book".into(), state, None)],
        };
        let mut kinds = |publisher: &mut Publisher, outcome| {
            publisher.take(&outcome);
            let mut kinds = String::new();
            while let Ok(message) = outlet.queue.try_recv() {
                kinds += match message {
                    Message::Line(_) => "line ",
                    Message::State { payload, .. } if payload.is_empty() => "gone ",
                    Message::State { .. } => "state ",
                };
            }
            kinds
        };
        assert_eq!(kinds(&mut publisher, frame(State::Searching, 0)), "state ");
        assert_eq!(kinds(&mut publisher, frame(State::Searching, 0)), "");
        assert_eq!(kinds(&mut publisher, frame(State::Found, 1)), "state line ");
        assert_eq!(kinds(&mut publisher, frame(State::Found, 1)), "line ");
        assert_eq!(kinds(&mut publisher, frame(State::Lost, 0)), "state line ");
        for _ in 0..QUEUE {
            publisher.send(Message::Line(String::new()));
        }
        publisher.take(&frame(State::Found, 0));
        assert_eq!(publisher.dropped, 1, "there was no room for the state");
        assert_eq!(kinds(&mut publisher, frame(State::Found, 0)).replace("line ", ""), "", "still no room");
        assert_eq!(kinds(&mut publisher, frame(State::Found, 0)), "state ", "told as soon as there is");
        let nothing = Outcome { line: json!({"detections": []}), objects: Vec::new() };
        assert_eq!(kinds(&mut publisher, nothing), "gone ");
    }
}
