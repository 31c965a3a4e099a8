//! Figures about a fragment.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::graph::Op;
use crate::isa::InstructionSet;
use crate::schedule::Order;

/// What a fragment consists of.
#[derive(Clone, Debug)]
pub struct Statistics {
    /// Instruction set.
    pub isa: InstructionSet,
    /// Order of operations.
    pub order: Order,
    /// Operations by kind.
    pub operations: BTreeMap<Op, usize>,
    /// Lane values stored to fields.
    pub stores: usize,
    /// Different constants.
    pub constants: usize,
    /// Instructions.
    pub instructions: usize,
    /// Values written to scratch memory for want of registers.
    pub spills: usize,
    /// Times that spilled values are read, by instructions that compute too or by loads of their own.
    pub reloads: usize,
    /// Most spilled values at once.
    pub slots: usize,
    /// Bytes of code.
    pub bytes: usize,
    /// Time that compiling took, from the recorded program on.
    pub compile_time: Duration,
}

impl Statistics {
    /// Operations of all kinds.
    pub fn total_operations(&self) -> usize {
        self.operations.values().sum()
    }
}
