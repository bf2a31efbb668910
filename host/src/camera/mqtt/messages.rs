//! Payloads of messages; `docs/schema/mqtt.json` describes each field.
//!
//! In: states of objects, lines of frames. Out: JSON texts. Memory and cost: the text.

use std::time::{Duration, SystemTime};

use serde_json::{Value, json};

use super::super::tracker::State;
use super::order::Order;
use super::topics::{Topics, id};
use crate::report::rounded;

/// The status of a running program.
pub const ONLINE: &str = "online";
/// The status of a program that ended.
pub const OFFLINE: &str = "offline";

/// A time in UTC as in RFC 3339, to the millisecond.
#[must_use]
pub fn stamp(time: SystemTime) -> String {
    // A clock that was never set may lie before the epoch, which has no stamp.
    humantime::format_rfc3339_millis(time.max(SystemTime::UNIX_EPOCH)).to_string()
}

/// The time at which the frame of a line came from the source.
#[must_use]
pub fn time_of(line: &Value) -> String {
    let age = Duration::from_millis(line["age_ms"].as_u64().unwrap_or(0));
    let now = SystemTime::now();
    stamp(now.checked_sub(age).unwrap_or(now))
}

/// The state of an object since the frame of `line`.
#[must_use]
pub fn state(name: &str, state: State, score: Option<f32>, line: &Value, time: &str) -> String {
    json!({
        "object": name,
        "state": state.name(),
        "score": score.map(|s| rounded(s, 4)),
        "frame": line["frame"],
        "time": time,
    })
    .to_string()
}

/// The state of an object that nobody looks for any more, since the program ended.
#[must_use]
pub fn gone(name: &str, time: &str) -> String {
    json!({"object": name, "state": "gone", "score": null, "frame": null, "time": time}).to_string()
}

/// The line of a frame.
#[must_use]
pub fn detections(line: &Value, time: &str) -> String {
    let mut line = line.clone();
    line["time"] = json!(time);
    line.to_string()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_have_milliseconds_and_are_never_before_the_epoch() {
        let epoch = SystemTime::UNIX_EPOCH;
        assert_eq!(stamp(epoch + Duration::from_millis(1_764_326_096_007)), "2025-11-28T10:34:56.007Z");
        assert_eq!(stamp(epoch - Duration::from_secs(1)), "1970-01-01T00:00:00.000Z");
    }
}
