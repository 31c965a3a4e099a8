//! Errors of the library.

use crate::diagnostics::Diagnostics;

/// What can go wrong outside the worlds themselves; what happens inside a world is its status.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The model was rejected.
    #[error("{0}")]
    Model(#[from] Diagnostics),
    /// The model compiles, but a step would need something that is not built yet.
    #[error("cannot step this model: {0}")]
    Unsupported(String),
    /// An array has the wrong shape or contents.
    #[error("{0}")]
    Input(String),
    /// An option is out of range.
    #[error("{0}")]
    Options(String),
    /// The caller stopped a run before its end.
    #[error("stopped before the end")]
    Cancelled,
    /// No output, field or key of that name.
    #[error("{0}")]
    Unknown(String),
}
