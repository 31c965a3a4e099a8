//! Instructions on registers, between allocation and encoding.

use crate::graph::Op;

/// A place in memory that a lane value can be read from or written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Place {
    /// Of the scratch memory.
    Slot(u32),
    /// Lane of a field.
    Field { field: u32, lane: u32 },
    /// One number for all lanes, of a field.
    Uniform { field: u32, index: u32 },
    /// One number for all lanes, of the fragment's constants.
    Constant(u32),
    /// Word of bits of a mask given to the fragment.
    MaskWord(u32),
}

/// An operand that may be in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    Register(u8),
    Memory(Place),
}

/// Files of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    Vector = 0,
    Mask = 1,
}

/// Which operand of a fused operation the result replaces, as the digits of the instructions' names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// to = to · third ± second
    F132,
    /// to = second · to ± third
    F213,
    /// to = second · third ± to
    F231,
}

/// An instruction. Registers are numbers within the class that the operation implies.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Instruction {
    Load { class: Class, to: u8, from: Place },
    Store { class: Class, from: u8, to: Place },
    Move { to: u8, from: u8 },
    Unary { op: Op, to: u8, from: Source },
    Shift { op: Op, to: u8, from: u8, bits: u8 },
    Binary { op: Op, to: u8, left: u8, right: Source },
    Fused { op: Op, form: Form, to: u8, second: u8, third: Source },
    Compare { op: Op, swapped: bool, to: u8, left: u8, right: Source },
    Select { to: u8, mask: u8, then: Source, otherwise: u8 },
    MaskBinary { op: Op, to: u8, left: u8, right: u8 },
    MaskNot { to: u8, from: u8 },
    StoreMaskWord { from: u8, index: u32 },
}
