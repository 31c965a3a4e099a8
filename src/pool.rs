//! Threads: the only place that knows about them.
//!
//! Whoever calls works, too, and helpers join while there is something to do. A helper that has not begun when the caller is
//! done is not waited for, so that no call takes longer because a core was busy with something else; one that has begun is.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, Thread};

use crate::error::Error;

/// More are a mistake, and starting them would keep the machine busy for minutes.
const MOST_THREADS: usize = 1024;
/// How often the caller looks whether the helpers are done before it sleeps: some ten microseconds.
const LOOKS: usize = 2000;

/// Threads that help whoever calls.
#[derive(Debug)]
pub struct Pool {
    shared: Arc<Shared>,
    /// The first helper's number is 1; the caller's is 0.
    helpers: Vec<Thread>,
}

/// What is lent to helpers: a call with the helper's number.
type Work = Arc<dyn Fn(usize) + Send + Sync>;

/// What callers and helpers tell each other.
#[derive(Default)]
struct Shared {
    job: Mutex<Job>,
    /// Helpers that have begun and not ended. Changes while `job` is locked.
    busy: AtomicUsize,
    /// Told when the last of them ends.
    idle: Condvar,
    /// Whether helpers shall end.
    closed: AtomicBool,
}

/// The present job.
#[derive(Default)]
struct Job {
    /// `None`: there is none, or it is over.
    work: Option<Work>,
    /// Counts jobs, so that a helper takes part once.
    number: u64,
    /// Helpers up to this number are wanted.
    wanted: usize,
    /// What a helper panicked with.
    panic: Option<Box<dyn Any + Send>>,
}

impl Pool {
    /// Room for `threads` threads at once, the caller's among them; `None`: as many as processors are available to the process.
    /// `pin` ties each helper to a processor of its own, for which there must be a thread for every processor that the process
    /// may use: fewer would crowd the first ones when several processes run side by side. The caller's thread stays free.
    ///
    /// # Errors
    ///
    /// If `threads` is 0 or more than 1024, or the system does not start as many, or cannot pin them.
    pub fn new(threads: Option<usize>, pin: bool) -> Result<Self, Error> {
        let threads = threads.unwrap_or_else(|| thread::available_parallelism().map_or(1, usize::from));
        if threads == 0 {
            return Err(Error::Options("threads must be at least 1".into()));
        }
        if threads > MOST_THREADS {
            return Err(Error::Options(format!("threads is {threads}; expected at most {MOST_THREADS}")));
        }
        let cores = if pin { core_affinity::get_core_ids().unwrap_or_default() } else { Vec::new() };
        if pin && cores.len() != threads {
            let n = cores.len();
            return Err(Error::Options(format!(
                "pinning takes one thread for each of the {n} processors that this process may use; threads is {threads}"
            )));
        }
        let mut pool = Pool { shared: Arc::default(), helpers: Vec::with_capacity(threads - 1) };
        for number in 1..threads {
            let shared = pool.shared.clone();
            let core = cores.get(number).copied();
            let helper = move || {
                if let Some(core) = core {
                    core_affinity::set_for_current(core);
                }
                shared.help(number);
            };
            let started = thread::Builder::new().name(format!("lanesim-{number}")).spawn(helper);
            let handle = started.map_err(|e| Error::Options(format!("cannot start {threads} threads: {e}")))?;
            pool.helpers.push(handle.thread().clone());
        }
        Ok(pool)
    }

    /// Number of threads that can work at once.
    pub fn threads(&self) -> usize {
        self.helpers.len() + 1
    }

    /// Calls `f` with 0 on the caller's thread, and meanwhile on up to `helpers` others with their numbers. Returns when the
    /// caller's call has ended and so have all that had begun by then: each call must go on until nothing is left to do. While
    /// the pool works for somebody else, nobody helps.
    pub(crate) fn run(&self, helpers: usize, f: impl Fn(usize) + Sync) {
        let helpers = helpers.min(self.helpers.len());
        if helpers == 0 {
            return f(0);
        }
        scope_lock::lock_scope(|scope| {
            let lent = scope.fn_(&f);
            let lending = self.shared.lend(Arc::new(move |number: usize| lent(number)), helpers);
            if lending.is_some() {
                self.helpers[..helpers].iter().for_each(Thread::unpark);
            }
            f(0);
            if let Some(panic) = lending.and_then(Lending::end) {
                resume_unwind(panic);
            }
        });
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        self.shared.closed.store(true, Ordering::Release);
        self.helpers.iter().for_each(Thread::unpark);
    }
}

impl std::fmt::Debug for Shared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shared").field("busy", &self.busy).finish_non_exhaustive()
    }
}

impl Shared {
    fn job(&self) -> MutexGuard<'_, Job> {
        self.job.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A helper's life.
    fn help(&self, number: usize) {
        let mut last = 0;
        while !self.closed.load(Ordering::Acquire) {
            let mut job = self.job();
            let wanted = job.number != last && number <= job.wanted;
            let Some(work) = job.work.clone().filter(|_| wanted) else {
                drop(job);
                thread::park();
                continue;
            };
            last = job.number;
            self.busy.fetch_add(1, Ordering::Relaxed);
            drop(job);
            let result = catch_unwind(AssertUnwindSafe(|| work(number)));
            drop(work);
            job = self.job();
            if let Err(panic) = result {
                job.panic.get_or_insert(panic);
            }
            if self.busy.fetch_sub(1, Ordering::Release) == 1 {
                self.idle.notify_all();
            }
        }
    }

    /// Makes `work` the present job; `None` if there is one.
    fn lend(&self, work: Work, wanted: usize) -> Option<Lending<'_>> {
        let mut job = self.job();
        if job.work.is_some() || self.busy.load(Ordering::Relaxed) > 0 {
            return None;
        }
        *job = Job { work: Some(work.clone()), number: job.number + 1, wanted, panic: None };
        Some(Lending { shared: self, _work: work })
    }
}

/// Work that helpers may take up until this goes.
struct Lending<'a> {
    shared: &'a Shared,
    /// The last to let go of it is the caller, whose it is.
    _work: Work,
}

impl Lending<'_> {
    /// Ends it; returns what a helper panicked with.
    fn end(self) -> Option<Box<dyn Any + Send>> {
        let shared = self.shared;
        drop(self);
        shared.job().panic.take()
    }
}

impl Drop for Lending<'_> {
    fn drop(&mut self) {
        self.shared.job().work = None;
        let busy = || self.shared.busy.load(Ordering::Acquire) > 0;
        for _ in 0..LOOKS {
            if !busy() {
                return;
            }
            std::hint::spin_loop();
        }
        let mut job = self.shared.job();
        while busy() {
            job = self.shared.idle.wait(job).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;

    /// Who takes how many of `n` things that take a while each.
    fn shares(pool: &Pool, helpers: usize, n: usize) -> Vec<usize> {
        let (queue, taken) = (AtomicUsize::new(0), Mutex::new(vec![0; pool.threads()]));
        pool.run(helpers, |number| {
            while queue.fetch_add(1, Ordering::Relaxed) < n {
                taken.lock().expect("shares")[number] += 1;
                thread::sleep(Duration::from_millis(1));
            }
        });
        taken.into_inner().expect("shares")
    }

    #[test]
    fn helpers_take_part_and_no_more_than_wanted() {
        let pool = Pool::new(Some(4), false).expect("a pool");
        for helpers in [0, 1, 3, 9] {
            let taken = shares(&pool, helpers, 200);
            assert_eq!(taken.iter().sum::<usize>(), 200);
            for (number, count) in taken.iter().enumerate() {
                assert_eq!(*count > 0, number <= helpers, "{helpers} helpers: {taken:?}");
            }
        }
    }

    #[test]
    fn the_caller_works_on_its_own_thread() {
        let pool = Pool::new(Some(3), false).expect("a pool");
        let threads = Mutex::new(HashSet::new());
        pool.run(0, |number| {
            threads.lock().expect("threads").insert((number, thread::current().id()));
        });
        assert_eq!(threads.into_inner().expect("threads"), HashSet::from([(0, thread::current().id())]));
    }

    /// A helper whose core does something else all the time delays nobody, and takes part when it is back.
    #[test]
    fn a_stalled_helper_is_not_waited_for() {
        let shared = Arc::new(Shared::default());
        let (release, released) = mpsc::channel::<()>();
        let theirs = shared.clone();
        let stalled = thread::spawn(move || {
            let _ = released.recv();
            theirs.help(1);
        });
        let pool = Pool { shared, helpers: vec![stalled.thread().clone()] };
        assert_eq!(shares(&pool, 1, 5), [5, 0]);
        drop(release);
        while shares(&pool, 1, 20)[1] == 0 {}
        drop(pool);
        stalled.join().expect("a helper that ends with its pool");
    }

    #[test]
    fn pins_are_for_all_processors_or_refused() {
        let all = core_affinity::get_core_ids().map_or(0, |cores| cores.len());
        if all > 0 {
            let pool = Pool::new(Some(all), true).expect("a pool");
            assert_eq!(shares(&pool, all, 50).iter().sum::<usize>(), 50);
        }
        let message = Pool::new(Some(all + 1), true).expect_err("too many").to_string();
        assert!(message.contains(&format!("the {all} processors")), "{message}");
    }

    #[test]
    fn a_pool_in_use_leaves_others_to_themselves() {
        let pool = Pool::new(Some(2), false).expect("a pool");
        let inner = Mutex::new(Vec::new());
        pool.run(1, |number| {
            if number == 0 {
                inner.lock().expect("shares").extend(shares(&pool, 1, 3));
            }
        });
        assert_eq!(inner.into_inner().expect("shares"), [3, 0]);
    }

    #[test]
    fn a_panic_of_a_helper_is_the_callers() {
        let pool = Pool::new(Some(2), false).expect("a pool");
        let began = AtomicBool::new(false);
        let result = catch_unwind(AssertUnwindSafe(|| {
            pool.run(1, |number| match number {
                0 => {
                    while !began.load(Ordering::Acquire) {
                        thread::yield_now();
                    }
                }
                _ => {
                    began.store(true, Ordering::Release);
                    panic!("of a helper");
                }
            });
        }));
        assert!(result.is_err());
        assert_eq!(shares(&pool, 1, 100).iter().sum::<usize>(), 100);
    }
}
