//! A place for one item: the newest.
//!
//! In: items from a thread that never waits. Out: the newest item, to a thread that waits
//! for it. An item that is not taken before the next one arrives is dropped and counted.
//! The thread that takes is behind by at most the item that it works on.
//!
//! Memory: one item. Cost: a lock.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Holds the newest item.
#[derive(Debug)]
pub struct Slot<T> {
    content: Mutex<Content<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Content<T> {
    item: Option<T>,
    dropped: u64,
    closed: bool,
}

/// What [`Slot::take_within`] finds.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// An item.
    Item(T),
    /// No item yet.
    Nothing,
    /// No item, and there will be none: the slot is closed.
    Closed,
}

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self { content: Mutex::new(Content { item: None, dropped: 0, closed: false }), changed: Condvar::new() }
    }
}

impl<T> Slot<T> {
    fn lock(&self) -> MutexGuard<'_, Content<T>> {
        // No change of the content is half done when a thread panics.
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts an item in, and drops the item that nobody took. Returns false when the slot is
    /// closed: nobody will take the item.
    pub fn put(&self, item: T) -> bool {
        let mut content = self.lock();
        if content.closed {
            return false;
        }
        if content.item.replace(item).is_some() {
            content.dropped += 1;
        }
        drop(content);
        self.changed.notify_one();
        true
    }

    /// Counts items that were lost before they could be put in.
    pub fn count_dropped(&self, items: u64) {
        self.lock().dropped += items;
    }

    /// Waits for an item and takes it. `None` when the slot is closed and empty.
    pub fn take(&self) -> Option<T> {
        let waiting = |content: &mut Content<T>| content.item.is_none() && !content.closed;
        let mut content = self.changed.wait_while(self.lock(), waiting).unwrap_or_else(PoisonError::into_inner);
        content.item.take()
    }

    /// Waits for an item, `time` at most, and takes it.
    pub fn take_within(&self, time: Duration) -> Taken<T> {
        let waiting = |content: &mut Content<T>| content.item.is_none() && !content.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), time, waiting);
        let mut content = waited.unwrap_or_else(PoisonError::into_inner).0;
        match content.item.take() {
            Some(item) => Taken::Item(item),
            None if content.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Closes the slot: it takes no more items, and threads that wait go on.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether [`Slot::close`] was called.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// The number of items that nobody took, or that were lost before.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_is_taken_and_the_others_are_counted() {
        let slot = Slot::default();
        for item in 1..=3 {
            assert!(slot.put(item));
        }
        assert_eq!((slot.take(), slot.dropped()), (Some(3), 2));
        slot.count_dropped(4);
        assert_eq!(slot.dropped(), 6);
    }

    #[test]
    fn the_taker_goes_on_when_nothing_comes() {
        let slot = Slot::default();
        let take = || slot.take_within(Duration::from_millis(1));
        assert_eq!(take(), Taken::Nothing);
        assert!(slot.put(1));
        assert_eq!(take(), Taken::Item(1));
        assert!(slot.put(2));
        slot.close();
        assert_eq!([take(), take()], [Taken::Item(2), Taken::Closed]);
    }

    #[test]
    fn closing_wakes_the_taker_and_refuses_items() {
        let slot = Slot::<u8>::default();
        std::thread::scope(|scope| {
            let taker = scope.spawn(|| slot.take());
            slot.close();
            assert_eq!(taker.join().expect("no panic"), None);
        });
        assert!(!slot.put(1));
        assert_eq!(slot.take(), None);
    }
}
