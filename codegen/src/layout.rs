//! How memory is laid out for code: fields, constants, and where the addresses that code is given point.

use crate::float::{BLOCK_BYTES, Precision};
use crate::isa::InstructionSet;
use crate::recording::{FieldKind, FieldUse};

/// What the caller of the code has lengths for.
#[derive(Clone, Copy)]
pub(crate) struct Bindings<'a> {
    pub fields: &'a [FieldUse],
    /// Number of masks given.
    pub masks_in: usize,
    /// Number of masks returned.
    pub masks_out: usize,
    /// For code that runs once for every item of a list.
    pub windows: Option<&'a Columns>,
}

/// Which fields start elsewhere for every item of a list, and where in an item that is said.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Columns {
    /// For every field, its column if it has one; the others stay where they are.
    pub of_fields: Vec<Option<u32>>,
    /// Columns of an item.
    pub width: usize,
}

impl Columns {
    /// Bytes of an item.
    pub fn item_bytes(&self) -> usize {
        self.width * size_of::<usize>()
    }
}

/// Distance from the start of a field, the slots or the constants to the address that code is given, bytes.
#[inline(always)]
pub(crate) fn bias(isa: InstructionSet, step: usize) -> usize {
    isa.short_reach(step)
}

/// Bytes between entries of a field.
pub(crate) fn field_step(kind: FieldKind, precision: Precision) -> usize {
    match kind {
        FieldKind::Lanes => BLOCK_BYTES,
        FieldKind::Uniform => precision.bytes(),
    }
}

/// Bytes between constants: instruction sets that cannot broadcast within instructions keep vectors of them.
pub(crate) fn constant_step(isa: InstructionSet, precision: Precision) -> usize {
    if isa.has_broadcast_operands() { precision.bytes() } else { isa.vector_bytes() }
}

/// The distance of the constants' address from their start, bytes.
pub(crate) fn constant_bias(isa: InstructionSet, precision: Precision) -> usize {
    bias(isa, constant_step(isa, precision))
}

/// The constants as the code wants them, then a vector of one bit per lane, which turns words of bits into masks.
pub(crate) fn constant_bytes(constants: &[u64], isa: InstructionSet, precision: Precision) -> Vec<u8> {
    let copies = constant_step(isa, precision) / precision.bytes();
    let repeated = constants.iter().flat_map(|bits| std::iter::repeat_n(*bits, copies));
    let lane_bits = (0..isa.vector_bytes() / precision.bytes()).map(|lane| 1 << lane);
    repeated.chain(lane_bits).flat_map(|bits: u64| bits.to_le_bytes().into_iter().take(precision.bytes())).collect()
}
