//! Threads that search one frame together.
//!
//! In: a number of threads. Out: a [`Crew`] for detectors, the same one for all of a number. Memory: the
//! stacks of the threads, which are made at the first frame and kept; they wait when there is nothing to
//! do. Cost: some microseconds each time that work is handed out.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use keygraph_core::Crew;
use rayon_core::{ThreadPool, ThreadPoolBuilder};

/// Maximum number of threads that search one frame.
pub const MAX_CREW: usize = 8;

/// The crew of `threads` threads, the caller's among them. `None` for one thread, and when the system gives no more.
#[must_use]
pub fn crew(threads: usize) -> Option<&'static dyn Crew> {
    static CREWS: [OnceLock<Option<Threads>>; MAX_CREW + 1] = [const { OnceLock::new() }; MAX_CREW + 1];
    let threads = threads.min(MAX_CREW);
    let crew = CREWS[threads].get_or_init(|| Threads::new(threads.checked_sub(1)?));
    crew.as_ref().map(|crew| crew as &dyn Crew)
}

/// Threads beside that of the caller.
#[derive(Debug)]
struct Threads {
    pool: ThreadPool,
    others: usize,
    /// Number of threads that do something which takes long.
    busy: AtomicUsize,
}

impl Threads {
    fn new(others: usize) -> Option<Self> {
        if others == 0 {
            return None;
        }
        let named = |i| format!("search {}", i + 2);
        let pool = ThreadPoolBuilder::new().num_threads(others).thread_name(named).build().ok()?;
        Some(Self { pool, others, busy: AtomicUsize::new(0) })
    }

    /// Number of threads that wait for work.
    fn free(&self) -> usize {
        self.others.saturating_sub(self.busy.load(Ordering::Relaxed))
    }
}

/// Counts a thread as busy for as long as it lives.
struct Busy<'a>(&'a AtomicUsize);

impl Drop for Busy<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Crew for Threads {
    fn is_free(&self) -> bool {
        self.free() > 0
    }

    fn all(&self, mine: &mut dyn FnMut(), others: &(dyn Fn() + Sync)) {
        self.pool.in_place_scope(|scope| {
            for _ in 0..self.free() {
                scope.spawn(|_| others());
            }
            mine();
        });
    }

    fn both(&self, mine: &mut dyn FnMut(), other: &mut (dyn FnMut() + Send)) {
        let is_free = self.busy.fetch_add(1, Ordering::Relaxed) < self.others;
        let busy = Busy(&self.busy);
        if is_free {
            self.pool.in_place_scope(|scope| {
                scope.spawn(move |_| {
                    let _busy = busy;
                    other();
                });
                mine();
            });
        } else {
            drop(busy);
            mine();
            other();
        }
    }
}

#[cfg(test)]
#[allow(clippy::panic, reason = "what is tested")]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::thread;

    #[test]
    fn one_thread_is_no_crew() {
        assert!(crew(0).is_none() && crew(1).is_none());
        assert!(crew(2).is_some());
    }

    #[test]
    fn all_work_is_done_once_and_by_others_too() {
        let crew = crew(3).expect("threads");
        let left = Mutex::new((0..300).collect::<Vec<_>>());
        let done = Mutex::new(Vec::new());
        let work = || {
            while let Some(n) = left.lock().expect("no panic").pop() {
                thread::yield_now();
                done.lock().expect("no panic").push((n, thread::current().id()));
            }
        };
        assert!(crew.is_free());
        crew.all(&mut || work(), &work);
        let mut done = done.into_inner().expect("no panic");
        done.sort_by_key(|d| d.0);
        assert!(done.iter().map(|d| d.0).eq(0..300));
        assert!(done.iter().any(|d| d.1 != thread::current().id()), "the others had their share");
    }

    #[test]
    fn both_are_done_at_the_same_time() {
        let crew = crew(2).expect("threads");
        let (to_mine, of_other) = std::sync::mpsc::channel();
        let (to_other, of_mine) = std::sync::mpsc::channel();
        // Each waits for the other.
        let mut met = 0;
        crew.both(
            &mut || {
                to_other.send(()).expect("the other listens");
                met = of_other.recv().expect("the other answers");
                // Meanwhile the others are busy, and work is not left to them.
                let mut called = false;
                crew.all(&mut || called = true, &|| panic!("no other is free"));
                assert!(called && !crew.is_free());
                to_other.send(()).expect("the other listens");
            },
            &mut {
                let waits = Mutex::new(of_mine);
                move || {
                    let of_mine = waits.lock().expect("no panic");
                    of_mine.recv().expect("mine asks");
                    to_mine.send(7).expect("mine listens");
                    of_mine.recv().expect("mine is done");
                }
            },
        );
        assert_eq!(met, 7);
    }

    #[test]
    #[should_panic(expected = "a piece failed")]
    fn a_panic_of_another_thread_is_told() {
        crew(2).expect("threads").all(&mut || {}, &|| panic!("a piece failed"));
    }

    #[test]
    fn a_thread_that_failed_is_free_again() {
        let crew = crew(4).expect("threads");
        for _ in 0..9 {
            let both = || crew.both(&mut || {}, &mut || panic!("it failed"));
            assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(both)).is_err());
        }
        let met = AtomicUsize::new(0);
        let meet = || {
            met.fetch_add(1, Ordering::Relaxed);
            while met.load(Ordering::Relaxed) < 4 {
                thread::yield_now();
            }
        };
        crew.all(&mut || meet(), &meet);
    }
}
