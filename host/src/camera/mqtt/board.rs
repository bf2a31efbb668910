//! What the broker should hold: the newest message of each retained topic, and the newest line.
//!
//! In: messages from the search, which never waits, and what the broker was heard to hold.
//! Out: the next message that the broker does not have yet. A newer message of a topic takes
//! the place of the older one, and keeps its place in the queue.
//!
//! Memory: one message an object (two with discovery), and one line. Cost: a look-up a message,
//! and a comparison with each message that waits.
//! The board is never full: a line that was not taken is replaced by the next.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use super::messages::{OFFLINE, ONLINE, gone};
use super::topics::Topics;

/// The messages that the search and the connection share.
#[derive(Debug)]
pub struct Board {
    content: Mutex<Content>,
    status: String,
    /// Notified when there is something to publish.
    pub changed: Notify,
}

/// A retained message.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Message {
    /// The payload; an empty one removes the message from the broker.
    payload: String,
    /// The object whose state this is.
    object: Option<String>,
}

#[derive(Debug, Default)]
struct Content {
    retained: BTreeMap<String, Message>,
    /// Topics whose message the broker does not have; each once, and each in `retained`.
    waiting: VecDeque<String>,
    line: Option<String>,
}

impl Content {
    fn set(&mut self, topic: String, message: Message) {
        self.retained.insert(topic.clone(), message);
        self.send_again(topic);
    }

    fn send_again(&mut self, topic: String) {
        if !self.waiting.contains(&topic) {
            self.waiting.push_back(topic);
        }
    }
}

impl Board {
    /// A board that says `online`.
    #[must_use]
    pub fn new(topics: &Topics) -> Self {
        let board = Self { content: Mutex::default(), status: topics.status(), changed: Notify::new() };
        board.set(board.status.clone(), ONLINE.into());
        board
    }

    fn lock(&self) -> MutexGuard<'_, Content> {
        // No change is left half done by a panic.
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the retained message of a topic; an empty payload removes it.
    pub fn set(&self, topic: String, payload: String) {
        self.lock().set(topic, Message { payload, object: None });
        self.changed.notify_one();
    }

    /// Sets the state of an object.
    pub fn set_state(&self, topic: String, object: &str, payload: String) {
        self.lock().set(topic, Message { payload, object: Some(object.into()) });
        self.changed.notify_one();
    }

    /// Sets the newest line.
    pub fn set_line(&self, line: String) {
        self.lock().line = Some(line);
        self.changed.notify_one();
    }

    /// Takes the newest line.
    pub fn take_line(&self) -> Option<String> {
        self.lock().line.take()
    }

    /// Whether there is a line that was not taken.
    pub fn has_line(&self) -> bool {
        self.lock().line.is_some()
    }

    /// Takes the next topic and payload to publish.
    pub fn next(&self) -> Option<(String, String)> {
        let mut content = self.lock();
        let topic = content.waiting.pop_front()?;
        let payload = content.retained.get(&topic)?.payload.clone();
        if payload.is_empty() {
            content.retained.remove(&topic);
        }
        Some((topic, payload))
    }

    /// Starts again with a broker whose messages are not known: all must be published. Messages
    /// that should be removed are forgotten, since [`Self::heard`] finds them if they are there;
    /// so is the line, which is old.
    pub fn start_again(&self) {
        let mut content = self.lock();
        content.retained.retain(|_, message| !message.payload.is_empty());
        let status = &self.status;
        let others = content.retained.keys().filter(|topic| *topic != status).cloned().collect::<Vec<_>>();
        content.waiting = std::iter::once(status.clone()).chain(others).collect();
        content.line = None;
        drop(content);
        self.changed.notify_one();
    }

    /// Takes a message from the broker, to correct what other runs of the program left there:
    /// a status that is not ours, such as a last will that comes late, and `retained` messages
    /// of objects that are not ours.
    pub fn heard(&self, topic: &str, payload: &[u8], retained: bool) {
        let mut content = self.lock();
        match content.retained.get(topic) {
            Some(message) if topic == self.status && message.payload.as_bytes() != payload => {
                content.send_again(topic.into());
            }
            None if retained && !payload.is_empty() => {
                content.set(topic.into(), Message { payload: String::new(), object: None });
            }
            _ => return,
        }
        drop(content);
        self.changed.notify_one();
    }

    /// Says that the program ends at `time`: the state of each object is `gone`, and then the
    /// status is `offline`.
    pub fn end(&self, time: &str) {
        let mut content = self.lock();
        let states = content.retained.iter().filter(|(_, message)| !message.payload.is_empty());
        let states = states.filter_map(|(topic, message)| Some((topic.clone(), message.object.clone()?)));
        for (topic, object) in states.collect::<Vec<_>>() {
            content.set(topic, Message { payload: gone(&object, time), object: Some(object) });
        }
        let status = &self.status;
        content.waiting.retain(|topic| topic != status);
        content.set(status.clone(), Message { payload: OFFLINE.into(), object: None });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board() -> (Topics, Board) {
        let topics = Topics::new("p".into(), None);
        let board = Board::new(&topics);
        (topics, board)
    }

    fn all(board: &Board) -> Vec<(String, String)> {
        std::iter::from_fn(|| board.next()).collect()
    }

    #[test]
    fn the_newest_state_of_every_object_is_kept_whatever_their_number() {
        let (topics, board) = board();
        for round in 0..3 {
            for object in 0..1000 {
                let name = object.to_string();
                board.set_state(topics.object(&name), &name, round.to_string());
            }
        }
        let sent = all(&board);
        assert_eq!(sent.len(), 1001);
        assert_eq!(sent[0], ("p/status".into(), "online".into()));
        assert!(sent[1..].iter().all(|(_, payload)| payload == "2"));
        assert_eq!(all(&board), []);
        board.start_again();
        assert_eq!(all(&board).len(), 1001, "a new broker gets all of them");
    }

    #[test]
    fn what_other_runs_left_is_corrected() {
        let (topics, board) = board();
        board.set_state(topics.object("ours"), "ours", "{}".into());
        all(&board);
        board.heard("p/objects/ours", b"{}", true);
        board.heard("p/objects/left", b"{}", true);
        board.heard("p/objects/of-another-program", b"{}", false);
        board.heard("p/status", b"online", false);
        assert_eq!(all(&board), [("p/objects/left".into(), String::new())]);
        board.heard("p/objects/left", b"", false);
        board.heard("p/status", b"offline", false);
        assert_eq!(all(&board), [("p/status".into(), "online".into())], "the last will of an earlier run");
    }

    #[test]
    fn at_the_end_objects_are_gone_before_the_program_is_offline() {
        let (topics, board) = board();
        board.set_state(topics.object("a"), "a", "{}".into());
        board.set_state(topics.object("removed"), "removed", String::new());
        board.set("home/config".into(), "{}".into());
        all(&board);
        board.set("p/status".into(), ONLINE.into());
        board.end("T");
        let [(first, state), (last, status)] = all(&board).try_into().expect("two messages");
        assert_eq!((first.as_str(), last.as_str(), status.as_str()), ("p/objects/a", "p/status", "offline"));
        assert!(state.contains(r#""state":"gone""#) && state.contains(r#""time":"T""#), "{state}");
        board.heard("p/status", b"offline", false);
        assert_eq!(all(&board), []);
    }
}
