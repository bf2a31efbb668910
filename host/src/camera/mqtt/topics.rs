//! Names of topics.
//!
//! In: the prefix of the broker's address, the prefix of Home Assistant, names of objects.
//! Out: topics. Two names never share a topic, and a topic has only characters that every
//! broker takes. Names are taken apart into UTF-8 bytes:
//!
//! | place | bytes kept | other bytes | inverse |
//! | --- | --- | --- | --- |
//! | a level of a topic | `A-Z a-z 0-9 . _ -` | `%` and two upper-case hexadecimal digits | percent-decoding |
//! | an id of Home Assistant | `A-Z a-z 0-9 -` | `_` and two upper-case hexadecimal digits | the same with `_` |
//!
//! Memory: the topics. Cost: negligible.

use std::fmt::Write;

use anyhow::{Result, ensure};

/// Converts a name to one level of a topic.
#[must_use]
pub fn level(name: &str) -> String {
    escaped(name, '%', |b| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-'))
}

/// Converts a name to an id of Home Assistant, which takes letters, digits, `_` and `-`.
#[must_use]
pub fn id(name: &str) -> String {
    escaped(name, '_', |b| b.is_ascii_alphanumeric() || b == b'-')
}

fn escaped(name: &str, mark: char, is_kept: impl Fn(u8) -> bool) -> String {
    name.bytes().fold(String::with_capacity(name.len()), |mut text, byte| {
        if is_kept(byte) {
            text.push(char::from(byte));
        } else {
            // Writing to a string cannot fail.
            let _ = write!(text, "{mark}{byte:02X}");
        }
        text
    })
}

/// Checks a prefix that a user gave.
///
/// # Errors
/// When the prefix has characters that brokers refuse in topics, or begins with `$`, which is
/// kept for the broker.
pub fn check_prefix(prefix: &str) -> Result<()> {
    let is_refused = |c: char| {
        // The last two of each plane, and U+FDD0 to U+FDEF, are no characters.
        let code = u32::from(c);
        c.is_control() || code & 0xFFFE == 0xFFFE || (0xFDD0..=0xFDEF).contains(&code)
    };
    ensure!(!prefix.contains(['+', '#']), "a topic prefix has no + and no #");
    ensure!(!prefix.contains(is_refused), "a topic prefix has no control characters");
    ensure!(!prefix.starts_with('$'), "a topic prefix does not begin with $");
    Ok(())
}

/// The topics of one program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topics {
    prefix: String,
    discovery: Option<String>,
}

impl Topics {
    /// The topics under `prefix`; with `discovery`, also those of Home Assistant under that
    /// prefix. Both were checked.
    #[must_use]
    pub const fn new(prefix: String, discovery: Option<String>) -> Self {
        Self { prefix, discovery }
    }

    /// The prefix of all topics but those of Home Assistant.
    #[must_use]
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Whether the program is running.
    #[must_use]
    pub fn status(&self) -> String {
        format!("{}/status", self.prefix)
    }

    /// Lines of frames.
    #[must_use]
    pub fn detections(&self) -> String {
        format!("{}/detections", self.prefix)
    }

    /// The models that this program runs.
    #[must_use]
    pub fn models(&self) -> String {
        format!("{}/models", self.prefix)
    }

    /// Checks that this program publishes nothing under `topic`.
    ///
    /// # Errors
    /// When it does, or a topic cannot be so.
    pub fn check_other(&self, topic: &str) -> Result<()> {
        check_prefix(topic)?;
        let own = [self.status(), self.detections(), self.models()];
        let is_own = own.iter().any(|t| t == topic) || topic.starts_with(&format!("{}/objects/", self.prefix));
        ensure!(!topic.is_empty() && !is_own, "orders need a topic of their own: {topic} is one of this program");
        Ok(())
    }

    /// The state of an object.
    #[must_use]
    pub fn object(&self, name: &str) -> String {
        format!("{}/objects/{}", self.prefix, level(name))
    }

    /// The id of this program in Home Assistant.
    #[must_use]
    pub fn node(&self) -> String {
        format!("keygraph_{}", id(&self.prefix))
    }

    /// The description of an object for Home Assistant; `None` without discovery.
    #[must_use]
    pub fn config(&self, name: &str) -> Option<String> {
        let discovery = self.discovery.as_ref()?;
        Some(format!("{discovery}/binary_sensor/{}/{}/config", self.node(), id(name)))
    }

    /// Filters that match the retained messages of this program for each object.
    #[must_use]
    pub fn of_all_objects(&self) -> Vec<String> {
        let configs = self.discovery.as_ref().map(|d| format!("{d}/binary_sensor/{}/+/config", self.node()));
        [format!("{}/objects/+", self.prefix)].into_iter().chain(configs).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_a_topic_of_its_own() {
        let names =
            ["a/b", "a_b", "a+b", "a#b", "a%2Fb", "a b", "a\u{1}b", "a\u{7f}b", "a\u{fffe}b", "é", "e", "", "a_2Fb"];
        for map in [level, id] {
            let mut all = names.map(map).to_vec();
            assert!(all.iter().all(|t| t.bytes().all(|b| b.is_ascii_graphic() && !b"/+#".contains(&b))), "{all:?}");
            all.sort();
            all.dedup();
            assert_eq!(all.len(), names.len(), "two names share {all:?}");
        }
        assert_eq!([level("my book/1.5"), level("é")], ["my%20book%2F1.5", "%C3%A9"]);
        assert_eq!([id("my book"), id("a_b")], ["my_20book", "a_5Fb"]);
    }

    #[test]
    fn prefixes_that_brokers_refuse() {
        for (prefix, word) in
            [("a/+", "no +"), ("#", "no #"), ("a\nb", "control"), ("a\u{fffe}", "control"), ("$SYS/a", "$")]
        {
            let error = check_prefix(prefix).expect_err(prefix).to_string();
            assert!(error.contains(word), "{prefix:?}: {error}");
        }
        check_prefix("plant/Tür 3").expect("is taken");
    }

    #[test]
    fn orders_have_a_topic_of_their_own() {
        let topics = Topics::new("plant/door".into(), None);
        for topic in ["plant/models", "plant/door/order", "plant/door/models/1"] {
            topics.check_other(topic).expect(topic);
        }
        for topic in ["", "plant/#", "plant/door/models", "plant/door/status", "plant/door/objects/a"] {
            assert!(topics.check_other(topic).is_err(), "{topic}");
        }
    }
}
