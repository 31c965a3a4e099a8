//! Errors of the library.

use crate::diagnostics::Diagnostics;
use crate::status::StatusEvent;

/// What can go wrong outside the worlds themselves; what happens inside a world is its status.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The model was rejected.
    #[error("{0}")]
    Model(#[from] Diagnostics),
    /// An array has the wrong shape or contents.
    #[error("{0}")]
    Input(String),
    /// An option is out of range.
    #[error("{0}")]
    Options(String),
    /// The system does not grant the memory.
    #[error("{}", no_memory(what, *bytes))]
    Memory {
        /// What it is for.
        what: &'static str,
        /// Bytes asked for; `None` if they cannot be counted.
        bytes: Option<usize>,
    },
    /// More memory than the limit.
    #[error(
        "{what} would take {} of memory, the limit is {}; ask for fewer {fewer}, or raise the limit, max_memory (--max-memory)",
        gigabytes(*bytes),
        gigabytes(*limit)
    )]
    MemoryLimit {
        /// What it is for.
        what: String,
        /// Bytes asked for.
        bytes: usize,
        /// Most bytes (see [`Options::max_memory`](crate::Options::max_memory)).
        limit: usize,
        /// Of what there could be fewer.
        fewer: &'static str,
    },
    /// A world diverged, and the batch's policy makes that an error.
    #[error("world {world} diverged: {event}")]
    Diverged {
        /// The world: of those that diverged first, the lowest.
        world: usize,
        /// What happened, when and where.
        event: StatusEvent,
    },
    /// The caller stopped a run before its end.
    #[error("stopped before the end")]
    Cancelled,
    /// No output, field or key of that name.
    #[error("{0}")]
    Unknown(String),
}

/// Bytes in words.
pub(crate) fn gigabytes(bytes: usize) -> String {
    let bytes = bytes as f64;
    match bytes {
        0.0..1e6 => format!("{:.1} kB", bytes / 1e3),
        1e6..1e9 => format!("{:.1} MB", bytes / 1e6),
        _ => format!("{:.1} GB", bytes / 1e9),
    }
}

fn no_memory(what: &str, bytes: Option<usize>) -> String {
    let need = bytes.map_or("more memory than can be addressed".to_owned(), |b| format!("{b} bytes of memory"));
    format!("{what} would take {need}, which the system does not give; ask for fewer worlds, steps or outputs")
}
