//! A data-oriented SIMD batch simulator for articulated bodies with contact.

pub mod compile;
pub mod diagnostics;
pub mod mjcf;
pub mod model;
pub mod spec;

pub use compile::compile;
pub use diagnostics::{Diagnostic, Diagnostics};
pub use model::Model;
pub use spec::Spec;
