//! A data-oriented SIMD batch simulator for articulated bodies with contact.

mod batch;
mod block;
mod columns;
pub mod compile;
pub mod convex;
pub mod diagnostics;
pub mod error;
pub mod eval;
mod group;
pub mod inverse;
mod memory;
pub mod mjcf;
pub mod model;
mod native;
pub mod noise;
pub mod npz;
pub mod outputs;
mod pace;
mod parameters;
pub mod plan;
pub mod pool;
pub mod rollout;
pub mod rows;
pub mod spec;
pub mod status;
mod store;
mod subset;
pub mod suggest;
mod unbuilt;
pub mod worlds;

pub use compile::compile;
pub use diagnostics::{Diagnostic, Diagnostics};
pub use error::Error;
pub use model::Model;
pub use parameters::Parameter;
pub use plan::Plan;
pub use rollout::{Controls, Rollout, Trajectories};
pub use spec::Spec;
pub use status::{OnDiverge, StatusEvent};
pub use subset::Reading;
pub use worlds::{Backend, CodePart, Field, Options, Precision, Running, Worlds};

pub use lanesim_codegen::{InstructionSet, Statistics as CodeStatistics, prepare as prepare_to_fork};

/// The Rust in the README is tested as documentation is.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
