//! Threads: the only place that knows about them.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::Error;

/// More are a mistake, and starting them would keep the machine busy for minutes.
const MOST_THREADS: usize = 1024;

/// A pool of worker threads, pinned if there is one for every processor and the system allows it.
#[derive(Debug)]
pub struct Pool {
    pool: rayon::ThreadPool,
}

impl Pool {
    /// A pool of `threads` workers; `None`: as many as processors are available to the process.
    pub fn new(threads: Option<usize>) -> Result<Self, Error> {
        let available = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = threads.unwrap_or(available);
        if threads == 0 {
            return Err(Error::Options("threads must be at least 1".into()));
        }
        if threads > MOST_THREADS {
            return Err(Error::Options(format!("threads is {threads}; expected at most {MOST_THREADS}")));
        }
        let cores = core_affinity::get_core_ids().unwrap_or_default();
        // Only a pool that takes every processor pins. Fewer workers would crowd the first processors when several
        // processes or pools run side by side, and more would stack.
        let pin = threads == cores.len();
        let next = AtomicUsize::new(0);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("lanesim-{i}"))
            .start_handler(move |_| {
                if let Some(core) = cores.get(next.fetch_add(1, Ordering::Relaxed)).filter(|_| pin) {
                    core_affinity::set_for_current(*core);
                }
            })
            .build()
            .map_err(|e| Error::Options(format!("cannot start {threads} threads: {e}")))?;
        Ok(Pool { pool })
    }

    /// Number of workers.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Calls `f` once on every worker, with the worker's number, and waits for all.
    pub fn run(&self, f: impl Fn(usize) + Sync) {
        self.pool.broadcast(|context| f(context.index()));
    }
}
