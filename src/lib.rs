//! A data-oriented SIMD batch simulator for articulated bodies with contact.

pub mod diagnostics;
pub mod mjcf;
pub mod spec;

pub use diagnostics::{Diagnostic, Diagnostics};
pub use spec::Spec;
