//! Records the kernels once and runs them as straight-line SIMD machine code.
//!
//! A kernel is generic over a [`Lane`](lanesim_kernels::lane::Lane). Run over a [`Recorder`], it computes nothing and
//! writes down what it would: all loops over the model's topology unrolled, all model numbers constants. What is left is a
//! graph of arithmetic operations for *this model*, which becomes code for *this processor*.
//!
//! ```
//! use lanesim_codegen::{CompileError, FieldSlice, InstructionSet, Recording, Scratch};
//! use lanesim_kernels::lane::{Lane, sin_cos};
//! use wide::f32x16;
//!
//! fn pendulum<L: Lane>(angle: L, length: L) -> [L; 2] {
//!     let (sin, cos) = sin_cos(angle);
//!     [length * sin, -(length * cos)]
//! }
//!
//! // Once for a model: fields are numbered by the caller.
//! let mut recording = Recording::<f32>::new();
//! let angle = recording.input(0, 1);
//! let length = recording.uniform(1, 1);
//! recording.output(2, &pendulum(angle[0], length[0]));
//! let program = recording.finish();
//! let fragment = match InstructionSet::detect().and_then(|isa| program.compile(isa)) {
//!     Ok(fragment) => fragment,
//!     Err(CompileError::Platform | CompileError::Processor(_)) => return, // run the kernel over f32x16 instead
//!     Err(error) => panic!("{error}"),
//! };
//!
//! // For every block of worlds, with one scratch per thread.
//! let mut scratch = Scratch::new();
//! let (angle, mut end) = ([f32x16::splat(0.5)], [f32x16::ZERO; 2]);
//! let mut fields = [FieldSlice::read(&angle), FieldSlice::uniform(&[2.0]), FieldSlice::write(&mut end)];
//! fragment.run(&mut scratch, &mut fields, &[], &mut []);
//! assert_eq!(end, pendulum(angle[0], f32x16::splat(2.0)));
//! ```
//!
//! # From kernel to code
//!
//! | module | what it does |
//! |---|---|
//! | `recorder`, `recording` | the lane that records, and binding its values to fields and masks |
//! | `graph`, `simplify` | equal values are one node; rules that simplify while recording, listed there |
//! | `lower` | drops dead values, maps what is left to what the instruction set has |
//! | `schedule`, `latency` | orders of operations; stores go right behind what they store |
//! | `uses`, `allocate` | registers by farthest next use, operands read from memory in place, spilling |
//! | `machine` | instructions on registers, still without encoding |
//! | `layout`, `emit` | addresses and displacements; encoding by `iced-x86`, one emitter for all instruction sets |
//! | `memory`, `native` | pages that are written, then executable, never both; calling them |
//! | `fragment` | the safe interface: checks what it is given, then runs the code, once or in a loop over windows |
//!
//! # What holds
//!
//! * **The bits are those of the other lanes**, except for signs of zeros, and except that a constant factor of zero hides
//!   infinities and NaN (`simplify` lists every rule). Products and sums are fused where the kernel says `mul_add` and
//!   nowhere else.
//! * **No world sees its neighbours**: there is no operation across lanes.
//! * **A block is 64 bytes per lane value** with every instruction set: 16 worlds in single precision, 8 in double. AVX-512
//!   takes it at once, AVX2 in two runs of the same code.
//! * **Fields may be read and written**: inputs are what a field held when the fragment started, whatever is stored to it.
//! * **Loops are over windows**: [`Program::compile_each`] makes code that runs once for every item of a list, which says
//!   where in larger fields the recorded ones start ([`Windows`]). Lists know how far they reach, so one comparison per field
//!   does for a run.
//! * **Safe callers stay safe**: lengths and mutability of fields are compared with the recording before every run, and
//!   every memory operand with its field when the code is made. This is the only package of the project with unsafe code:
//!   calling what it emitted, and little else.
//! * **No code is no error of the caller**: on other platforms, older processors or systems that forbid executable memory,
//!   [`Program::compile`] says why, and kernels run over `wide` lanes.
//!
//! A fragment is one basic block, or that in a loop. What depends on values - iterations of a solver, skipping stages that no world needs -
//! is between fragments: they return masks as bits for that.

// Where there is no code, there is nothing that reads the instructions for it.
#![cfg_attr(not(all(target_arch = "x86_64", unix)), allow(dead_code))]

mod allocate;
#[cfg(all(target_arch = "x86_64", unix))]
mod emit;
mod error;
mod float;
mod fragment;
mod graph;
mod isa;
mod latency;
mod layout;
mod lower;
mod machine;
#[cfg(all(target_arch = "x86_64", unix))]
mod memory;
#[cfg_attr(not(all(target_arch = "x86_64", unix)), path = "elsewhere.rs")]
mod native;
mod perf;
mod recorder;
mod recording;
mod schedule;
mod simplify;
mod statistics;
mod uses;

pub use error::CompileError;
pub use float::{Block, Float, Precision};
pub use fragment::{FieldSlice, Fragment, Lending, Scratch, Session, Windows, WindowsList};
pub use graph::Op;
pub use isa::InstructionSet;
pub use recorder::{Recorder, RecorderMask};
pub use recording::{FieldKind, FieldUse, Program, Recording};
pub use schedule::Order;
pub use statistics::Statistics;

/// Makes the tables of the encoder, which every process has once: whoever will fork does so first, lest another thread be at it
/// during the fork, and the new process wait for that thread for ever.
pub fn prepare() {
    #[cfg(all(target_arch = "x86_64", unix))]
    drop(iced_x86::Encoder::new(64));
}
