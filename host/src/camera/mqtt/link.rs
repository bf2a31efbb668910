//! The connection to the broker.
//!
//! In: messages of the [`Board`]. Out: they are at the broker, in their order, and what the
//! broker holds is told to the board. Attempts to connect are 1, 2, 4 ... 30 seconds apart.
//!
//! Memory: `QUEUE` messages. Cost: negligible.

use std::sync::Arc;
use std::time::Duration;

use rumqttc::{AsyncClient, ConnectionError, Event, EventLoop, LastWill, MqttOptions, Packet, QoS};
use tokio::sync::watch;
use tokio::time::sleep;

use super::board::Board;
use super::broker::{Broker, host_name};
use super::messages::OFFLINE;
use super::rollout::Newest;
use super::tls;
use super::topics::level;

/// Maximum number of messages on their way. More wait on the board.
const QUEUE: usize = 16;
/// Interval of keep-alive messages, s. The broker takes the program for gone after 1.5 times
/// this silence.
const KEEP_ALIVE_S: u16 = 10;
/// Minimum and maximum time between two attempts to connect.
const PAUSES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];
/// Maximum size of a message in bytes: a line with many detections.
pub const MOST_BYTES: usize = 1 << 20;

/// Makes the client of a broker.
#[must_use]
pub fn client(broker: &Broker) -> (AsyncClient, EventLoop) {
    let id = format!("keygraph-{}-{}", level(&host_name()), std::process::id());
    let mut options = MqttOptions::new(id, (broker.host.clone(), broker.port));
    // The limit is that of payloads; a packet has the topic too.
    options.set_keep_alive(KEEP_ALIVE_S).set_max_packet_size(2 * MOST_BYTES, 2 * MOST_BYTES);
    options.set_last_will(LastWill::new(broker.topics.status(), OFFLINE, QoS::AtLeastOnce, true));
    if let Some((user, password)) = &broker.login {
        options.set_credentials(user, password.clone());
    }
    if let Some(tls) = &broker.tls {
        tls.apply_to(&mut options);
    }
    AsyncClient::builder(options).capacity(QUEUE).build()
}

/// Keeps the connection up until this program disconnects. `up` says whether it is; `newest` gets the
/// newest order.
pub async fn keep_connected(
    mut events: EventLoop,
    client: AsyncClient,
    broker: Arc<Broker>,
    board: Arc<Board>,
    up: watch::Sender<bool>,
    newest: watch::Sender<Newest>,
) {
    let [mut pause, most] = PAUSES;
    let mut told = None;
    let mut is_listening = false;
    loop {
        match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                tracing::info!("connected to the broker at {}", broker.place());
                (pause, told) = (PAUSES[0], None);
                board.start_again();
                // The queue was emptied when the connection ended.
                let _ = client.try_subscribe(broker.topics.status(), QoS::AtLeastOnce);
                for filter in broker.topics.of_all_objects().into_iter().chain(broker.orders.clone()) {
                    let _ = client.try_subscribe(filter, QoS::AtLeastOnce);
                }
                is_listening = true;
                up.send_replace(true);
            }
            Ok(Event::Incoming(Packet::Publish(message))) => {
                if broker.orders.as_ref().is_some_and(|orders| orders.as_bytes() == &message.topic[..]) {
                    // Each new connection brings the same one again.
                    newest.send_if_modified(|order| {
                        let is_new = order.as_deref() != Some(&message.payload[..]);
                        *order = Some(message.payload.to_vec());
                        is_new
                    });
                } else if let Ok(topic) = std::str::from_utf8(&message.topic) {
                    board.heard(topic, &message.payload, message.retain);
                }
            }
            // What the broker held came after the subscription, long ago.
            Ok(Event::Incoming(Packet::PingResp)) if is_listening => {
                for filter in broker.topics.of_all_objects() {
                    let _ = client.try_unsubscribe(filter);
                }
                is_listening = false;
            }
            Ok(Event::Outgoing(rumqttc::Outgoing::Disconnect)) | Err(ConnectionError::RequestsDone) => return,
            Ok(_) => {}
            Err(error) => {
                up.send_replace(false);
                let advice = advice(&error);
                // The text of an error may have a time in it.
                let kind = advice.map_or_else(|| error.to_string(), str::to_string);
                if told.as_ref() != Some(&kind) {
                    let detail = advice.map_or_else(String::new, |_| format!(" ({error})"));
                    tracing::warn!("no broker at {}: {kind}{detail}; trying again", broker.place());
                    told = Some(kind);
                }
                sleep(pause).await;
                pause = (pause * 2).min(most);
            }
        }
    }
}

/// The reason why there is no connection, and what to do about it. `None` when the error says
/// it well enough.
fn advice(error: &ConnectionError) -> Option<&'static str> {
    match error {
        ConnectionError::ConnectionRefused(_) => Some("it refuses this user and password"),
        ConnectionError::NetworkTimeout => Some("it does not answer"),
        other => tls::advice(other),
    }
}
