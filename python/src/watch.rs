//! Long work: the interpreter is free while it lasts, Ctrl-C stops it, and a callback may follow it.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// How often signals and progress are looked at.
const PERIOD: Duration = Duration::from_millis(50);
/// Work that should take less does not get a thread of its own: even if it takes ten times as long, nobody waits.
const SHORT_SECONDS: f64 = 0.002;
/// Stack of a thread that reads models, as a main thread has it.
const STACK: usize = 8 << 20;

/// Seconds that work takes per unit of its amount, as lately measured.
#[derive(Clone, Copy, Default)]
pub struct Pace(Option<f64>);

impl Pace {
    /// Whether so much work will be over before anyone could want to interrupt it.
    pub fn is_short(self, amount: f64) -> bool {
        self.0.is_some_and(|pace| pace * amount < SHORT_SECONDS)
    }

    /// Learns from work that is done. What was slow is forgotten slowly: the next run may be like it again.
    pub fn learn(&mut self, seconds: f64, amount: f64) {
        if amount > 0.0 {
            let pace = seconds / amount;
            self.0 = Some(self.0.map_or(pace, |old| pace.max(0.5 * old)));
        }
    }
}

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

/// Does `work`, which nothing can stop half way, on a thread of its own with the interpreter released. If a signal raises
/// an exception, that is the result at once; the work goes on to its end, and nobody hears of it.
pub fn abandonable<R: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> R + Send + 'static) -> PyResult<R> {
    let (sender, receiver) = mpsc::sync_channel(1);
    let send = move || drop(sender.send(work()));
    let thread = thread::Builder::new().name("lanesim-compile".into()).stack_size(STACK).spawn(send);
    let thread = thread.map_err(|e| PyRuntimeError::new_err(format!("cannot start a thread: {e}")))?;
    py.detach(move || {
        loop {
            match receiver.recv_timeout(PERIOD) {
                Ok(result) => return Ok(result),
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
                Err(RecvTimeoutError::Disconnected) => {
                    let panic = thread.join().err();
                    resume_unwind(panic.unwrap_or_else(|| Box::new("a thread ended without a result")));
                }
            }
        }
    })
}
