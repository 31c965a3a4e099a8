//! Forked processes, which inherit memory but no threads.

use std::ops::{Deref, DerefMut};
use std::process;

use pyo3::prelude::*;

use crate::failure;

/// The process that something was made in. A forked one inherits none of its threads: it would wait for them for ever.
#[derive(Clone, Copy)]
pub struct Home(u32);

impl Home {
    pub fn here() -> Self {
        Home(process::id())
    }

    /// Whether this is the process.
    pub fn is_here(self) -> bool {
        self.0 == process::id()
    }

    /// An exception if it is not.
    pub fn check(self, py: Python<'_>) -> PyResult<()> {
        if self.is_here() {
            return Ok(());
        }
        let text = "made before this process was forked, which has none of its threads: make worlds and pools after a \
                    fork, or start processes with multiprocessing's \"spawn\" or \"forkserver\"";
        Err(failure::new(py, "LanesimError", (text,)))
    }
}

/// Something with threads, which only the process that made it ends. In a forked one there are none to be told, and a lock
/// that one of them held during the fork stays closed: there it is left as it is.
pub struct AtHome<T> {
    value: Option<T>,
    home: Home,
}

impl<T> AtHome<T> {
    pub fn new(value: T) -> Self {
        AtHome { value: Some(value), home: Home::here() }
    }
}

impl<T> Drop for AtHome<T> {
    fn drop(&mut self) {
        if !self.home.is_here() {
            std::mem::forget(self.value.take());
        }
    }
}

impl<T> Deref for AtHome<T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.value.as_ref().expect("there until it is dropped")
    }
}

impl<T> DerefMut for AtHome<T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("there until it is dropped")
    }
}
