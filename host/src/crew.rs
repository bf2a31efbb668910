//! Threads that search one frame together.
//!
//! In: a number of threads. Out: a [`Crew`] for detectors, the same one for all of a number. Memory: the
//! stacks of the threads, which are made at the first frame and kept; they wait when there is nothing to
//! do. Cost: some microseconds each time that work is handed out.

use std::iter;
use std::process;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use keygraph_core::Crew;
use rayon_core::{ThreadPool, ThreadPoolBuilder};

/// Maximum number of threads that search one frame.
const MAX_CREW: usize = 8;

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
    /// Number of threads that have something to do.
    busy: AtomicUsize,
    /// The process whose threads these are: a child that was forked has none of them.
    process: u32,
}

impl Threads {
    fn new(others: usize) -> Option<Self> {
        if others == 0 {
            return None;
        }
        let named = |i| format!("search {}", i + 2);
        let pool = ThreadPoolBuilder::new().num_threads(others).thread_name(named).build().ok()?;
        Some(Self { pool, others, busy: AtomicUsize::new(0), process: process::id() })
    }

    /// Whether the caller may wait for these threads. A thread of another pool would do something else of that pool
    /// meanwhile, and perhaps search with a detector that it holds already.
    fn are_ours(&self) -> bool {
        self.process == process::id() && rayon_core::current_thread_index().is_none()
    }

    /// Takes a thread that has nothing to do.
    fn take(&self) -> Option<Busy<'_>> {
        if !self.is_free() {
            return None;
        }
        let before = self.busy.fetch_add(1, Ordering::Relaxed);
        let busy = Busy(&self.busy);
        (before < self.others).then_some(busy)
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
        self.busy.load(Ordering::Relaxed) < self.others && self.are_ours()
    }

    fn all(&self, mine: &mut dyn FnMut(), others: &(dyn Fn() + Sync)) {
        let Some(first) = self.take() else { return mine() };
        self.pool.in_place_scope(|scope| {
            for busy in iter::once(first).chain(iter::from_fn(|| self.take())) {
                scope.spawn(move |_| {
                    let _busy = busy;
                    others();
                });
            }
            mine();
        });
    }

    fn both(&self, mine: &mut dyn FnMut(), other: &mut (dyn FnMut() + Send)) {
        let Some(busy) = self.take() else {
            mine();
            return other();
        };
        self.pool.in_place_scope(|scope| {
            scope.spawn(move |_| {
                let _busy = busy;
                other();
            });
            mine();
        });
    }
}

#[cfg(test)]
#[allow(clippy::panic, reason = "what is tested")]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Mutex;
    use std::sync::mpsc::channel;
    use std::thread;
    use std::time::{Duration, Instant};

    /// Threads that no other test uses.
    fn threads(others: usize) -> Threads {
        Threads::new(others).expect("threads")
    }

    #[test]
    fn one_thread_is_no_crew() {
        assert!(crew(0).is_none() && crew(1).is_none());
        assert!(crew(2).is_some());
    }

    #[test]
    fn all_work_is_done_once_and_by_others_too() {
        let crew = threads(2);
        let left = Mutex::new((0..300).collect::<Vec<_>>());
        let done = Mutex::new(Vec::new());
        let work = || {
            while let Some(n) = left.lock().expect("no panic").pop() {
                done.lock().expect("no panic").push((n, thread::current().id()));
                thread::sleep(Duration::from_millis(1));
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
        let crew = threads(1);
        let (to_mine, of_other) = channel();
        let (to_other, of_mine) = channel();
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
        assert!(crew.is_free());
    }

    #[test]
    #[should_panic(expected = "a piece failed")]
    fn a_panic_of_another_thread_is_told() {
        threads(1).all(&mut || {}, &|| panic!("a piece failed"));
    }

    #[test]
    fn a_thread_that_failed_is_free_again() {
        let crew = threads(3);
        for _ in 0..9 {
            let both = || crew.both(&mut || {}, &mut || panic!("it failed"));
            assert!(catch_unwind(AssertUnwindSafe(both)).is_err());
        }
        let (met, start) = (AtomicUsize::new(0), Instant::now());
        let meet = || {
            met.fetch_add(1, Ordering::Relaxed);
            while met.load(Ordering::Relaxed) < 4 {
                assert!(start.elapsed().as_secs() < 60, "somebody is missing");
                thread::yield_now();
            }
        };
        crew.all(&mut || meet(), &meet);
    }

    #[test]
    fn threads_of_another_pool_work_alone() {
        let (crew, pool) = (threads(1), threads(1));
        pool.pool.in_place_scope(|scope| {
            scope.spawn(|_| {
                let mut done = 0;
                assert!(!crew.is_free());
                crew.all(&mut || done += 1, &|| panic!("there is no other"));
                let here = thread::current().id();
                crew.both(&mut || {}, &mut || assert_eq!(thread::current().id(), here));
                assert_eq!(done, 1);
            });
        });
    }
}
