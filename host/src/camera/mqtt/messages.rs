//! Payloads of messages; `docs/schema/mqtt.json` describes each field.
//!
//! In: states of objects, lines of frames. Out: JSON texts. Memory and cost: the text.

use serde_json::{Value, json};

use super::super::tracker::State;
use super::order::Order;
use super::topics::{Topics, id};
use crate::report;

/// The status of a running program.
pub const ONLINE: &str = "online";
/// The status of a program that ended.
pub const OFFLINE: &str = "offline";

/// The state of an object since the frame of `line`.
#[must_use]
pub fn state(name: &str, state: State, score: Option<f32>, line: &Value) -> String {
    json!({
        "object": name,
        "state": state.name(),
        "score": score.map(report::score),
        "frame": line["frame"],
        "time": line["time"],
    })
    .to_string()
}

/// The state of an object that nobody looks for any more, since the program ended.
#[must_use]
pub fn gone(name: &str, time: &str) -> String {
    json!({"object": name, "state": "gone", "score": null, "frame": null, "time": time}).to_string()
}

/// The models that were ordered: the order that is run, the one that is wanted, and why they differ.
#[must_use]
pub fn models(running: Option<&Order>, wanted: Option<&str>, error: Option<&str>, time: &str) -> String {
    let models = running.map_or(&[][..], |order| &order.models);
    let models: Vec<_> = models.iter().map(|m| json!({"name": m.name, "sha256": m.sha256, "bytes": m.bytes})).collect();
    json!({
        "running": running.map(|order| &order.version),
        "wanted": wanted,
        "error": error,
        "models": models,
        "time": time,
    })
    .to_string()
}

/// The description of an object for Home Assistant: a sensor that is on while the object is in
/// view.
#[must_use]
pub fn config(topics: &Topics, name: &str) -> String {
    let (node, version) = (topics.node(), env!("CARGO_PKG_VERSION"));
    json!({
        "name": name,
        "unique_id": format!("{node}_{}", id(name)),
        "device_class": "occupancy",
        "state_topic": topics.object(name),
        "value_template": "{{ 'ON' if value_json.state in ['found', 'tracked'] else 'OFF' }}",
        "json_attributes_topic": topics.object(name),
        "availability_topic": topics.status(),
        "device": {
            "identifiers": [node],
            "name": format!("Keygraph {}", topics.prefix()),
            "manufacturer": "Keygraph",
            "sw_version": version,
        },
        "origin": {"name": "Keygraph", "sw_version": version},
    })
    .to_string()
}
