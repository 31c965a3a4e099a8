//! How a batch works: number type, backend, threads, limits.

use std::sync::Arc;

use lanesim_codegen::InstructionSet;
use lanesim_kernels::lane::Real;
use lanesim_kernels::model::Cast;

use crate::model::Model;
use crate::status::OnDiverge;

/// Number type of the simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// Single precision: twice the worlds per block.
    F32,
    /// Double precision.
    #[default]
    F64,
}

/// How kernels are run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// Machine code made for the model where the machine can run it, else SIMD lanes.
    #[default]
    Auto,
    /// The same.
    Native,
    /// Portable SIMD lanes: 8 worlds (f64) or 16 (f32) at a time.
    Wide,
    /// One world at a time: the reference. Same bits.
    Scalar,
}

impl Backend {
    /// Name, as the command line spells it.
    pub fn name(self) -> &'static str {
        match self {
            Backend::Auto => "auto",
            Backend::Native => "native",
            Backend::Wide => "wide",
            Backend::Scalar => "scalar",
        }
    }
}

/// What happens inside a batch.
#[derive(Clone, Debug)]
pub struct Options {
    /// Number type.
    pub precision: Precision,
    /// How kernels are run.
    pub backend: Backend,
    /// Instruction set of machine code made for the model; `None`: the best that the machine has.
    pub instructions: Option<InstructionSet>,
    /// Threads that may work at once, the caller's among them; `None`: as many as processors are available. Jobs too small to
    /// be worth it wake none.
    pub threads: Option<usize>,
    /// Whether threads are tied to processors, for a machine that does nothing else: there must be one for every processor
    /// that the process may use. The caller's own thread stays free.
    pub pin: bool,
    /// Most bytes for worlds and scratch together, and for the outputs of a call; `None`: three quarters of what the
    /// system has to give. More is refused with an error.
    pub max_memory: Option<usize>,
    /// Largest number of contacts of a world; beyond it the world's status says `ContactOverflow`.
    pub max_contacts: usize,
    /// What is done about a world that diverges.
    pub on_diverge: OnDiverge,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            precision: Precision::F64,
            backend: Backend::Auto,
            instructions: None,
            threads: None,
            pin: false,
            max_memory: None,
            max_contacts: 1 << 14,
            on_diverge: OnDiverge::Freeze,
        }
    }
}

/// Tables of the model for a number type.
pub trait Tables: Real {
    /// Tables rounded to this type.
    fn rounded(tables: lanesim_kernels::model::Model<f64>) -> Arc<lanesim_kernels::model::Model<Self>>;

    /// The tables, rounded to this type.
    fn tables(model: &Model) -> &Arc<lanesim_kernels::model::Model<Self>>;
}

impl Tables for f64 {
    fn rounded(tables: lanesim_kernels::model::Model<f64>) -> Arc<lanesim_kernels::model::Model<f64>> {
        Arc::new(tables)
    }

    fn tables(model: &Model) -> &Arc<lanesim_kernels::model::Model<f64>> {
        model.tables()
    }
}

impl Tables for f32 {
    fn rounded(tables: lanesim_kernels::model::Model<f64>) -> Arc<lanesim_kernels::model::Model<f32>> {
        Arc::new(tables.cast())
    }

    fn tables(model: &Model) -> &Arc<lanesim_kernels::model::Model<f32>> {
        model.tables_f32()
    }
}
