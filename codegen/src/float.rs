//! The number types and blocks that code is generated for.

use lanesim_kernels::lane::{LaneQuery, Scalar};
use wide::{f32x16, f64x8};

/// Bytes of one lane value of a block, whatever the instruction set.
pub(crate) const BLOCK_BYTES: usize = 64;

/// Width of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 32 bits.
    Single,
    /// 64 bits.
    Double,
}

impl Precision {
    /// Bytes of a number.
    pub const fn bytes(self) -> usize {
        match self {
            Precision::Single => 4,
            Precision::Double => 8,
        }
    }

    /// Worlds in a block.
    pub const fn lanes(self) -> usize {
        BLOCK_BYTES / self.bytes()
    }

    /// Bits of the mantissa.
    pub(crate) const fn mantissa(self) -> u8 {
        match self {
            Precision::Single => 23,
            Precision::Double => 52,
        }
    }

    /// What the exponent field holds for an exponent of 0.
    pub(crate) const fn bias(self) -> u64 {
        match self {
            Precision::Single => 127,
            Precision::Double => 1023,
        }
    }

    /// All bits of a number set.
    pub(crate) const fn ones(self) -> u64 {
        match self {
            Precision::Single => u32::MAX as u64,
            Precision::Double => u64::MAX,
        }
    }

    /// The sign bit.
    pub(crate) const fn sign(self) -> u64 {
        1 << (8 * self.bytes() - 1)
    }
}

/// A number type that can be recorded: `f32` or `f64`.
pub trait Float: Scalar + sealed::Sealed {
    /// Its width.
    const PRECISION: Precision;
    /// The block that its code computes with.
    type Block: Block<Float = Self>;

    /// The number of the given bits, the upper ones of which are ignored in single precision.
    fn of_bits(bits: u64) -> Self;
}

/// A lane type as which generated code sees memory: 64 aligned bytes, lane 0 first.
pub trait Block: LaneQuery<Real = Self::Float> + sealed::Sealed {
    /// The number type.
    type Float: Float<Block = Self>;
}

impl Float for f32 {
    const PRECISION: Precision = Precision::Single;
    type Block = f32x16;

    fn of_bits(bits: u64) -> f32 {
        f32::from_bits(bits as u32)
    }
}

impl Float for f64 {
    const PRECISION: Precision = Precision::Double;
    type Block = f64x8;

    fn of_bits(bits: u64) -> f64 {
        f64::from_bits(bits)
    }
}

impl Block for f32x16 {
    type Float = f32;
}

impl Block for f64x8 {
    type Float = f64;
}

mod sealed {
    /// Keeps other crates from implementing the traits, on whose memory layout the machine code relies.
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
    impl Sealed for wide::f32x16 {}
    impl Sealed for wide::f64x8 {}
}

const _: () = assert!(size_of::<f32x16>() == BLOCK_BYTES && align_of::<f32x16>() == BLOCK_BYTES);
const _: () = assert!(size_of::<f64x8>() == BLOCK_BYTES && align_of::<f64x8>() == BLOCK_BYTES);
