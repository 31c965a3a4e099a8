//! Long runs: the interpreter is free while they last, Ctrl-C stops them, and a callback may follow them.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

/// How often signals and progress are looked at.
const PERIOD: Duration = Duration::from_millis(50);

/// Says that the work is over, even if it panicked.
struct Finish<'a>(&'a Mutex<bool>, &'a Condvar);

impl Drop for Finish<'_> {
    fn drop(&mut self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.1.notify_one();
    }
}

/// Does `work` on a thread of its own with the interpreter released. Now and then `poll` is called, and signals are
/// handled; if either raises, `cancel` turns true, and the exception is the result once the work has come to its end.
pub fn watched<R: Send>(
    py: Python<'_>,
    cancel: &AtomicBool,
    mut poll: impl FnMut(Python<'_>) -> PyResult<()> + Send,
    work: impl FnOnce() -> R + Send,
) -> PyResult<R> {
    let (over, bell) = (Mutex::new(false), Condvar::new());
    py.detach(|| {
        thread::scope(|scope| {
            let worker = scope.spawn(|| {
                let _finish = Finish(&over, &bell);
                work()
            });
            let mut raised = None;
            loop {
                let lock = over.lock().unwrap_or_else(PoisonError::into_inner);
                let (lock, _) =
                    bell.wait_timeout_while(lock, PERIOD, |over| !*over).unwrap_or_else(PoisonError::into_inner);
                if *lock {
                    break;
                }
                drop(lock);
                if raised.is_none() {
                    raised = Python::attach(|py| py.check_signals().and_then(|()| poll(py))).err();
                    cancel.store(raised.is_some(), Ordering::Relaxed);
                }
            }
            let result = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
            raised.map_or(Ok(result), Err)
        })
    })
}
