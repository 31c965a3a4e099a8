//! Records the kernels once and runs them as straight-line SIMD machine code.

mod allocate;
#[cfg(all(target_arch = "x86_64", unix))]
mod emit;
mod error;
mod float;
mod fragment;
mod graph;
mod isa;
mod layout;
mod lower;
mod machine;
#[cfg(all(target_arch = "x86_64", unix))]
mod memory;
#[cfg_attr(not(all(target_arch = "x86_64", unix)), path = "elsewhere.rs")]
mod native;
mod recorder;
mod recording;
mod schedule;
mod simplify;
mod statistics;
mod uses;

pub use error::CompileError;
pub use float::{Block, Float, Precision};
pub use fragment::{FieldSlice, Fragment, Scratch};
pub use graph::Op;
pub use isa::InstructionSet;
pub use recorder::{Recorder, RecorderMask};
pub use recording::{FieldKind, FieldUse, Program, Recording};
pub use schedule::Order;
pub use statistics::Statistics;
