//! Forked processes, which inherit memory but no threads.

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
