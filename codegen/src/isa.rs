//! Instruction sets: what they have, and whether this machine has them.

use crate::error::CompileError;

/// An instruction set that code is generated for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum InstructionSet {
    /// AVX2 and FMA: 16 registers of 32 bytes, masks among them. A block takes two runs.
    Avx2,
    /// AVX-512 F, DQ, BW: 32 registers of 64 bytes, 7 usable mask registers, broadcasts within instructions.
    Avx512,
}

impl InstructionSet {
    /// The best instruction set of this machine.
    ///
    /// # Errors
    ///
    /// If there is none for which code can be generated: not x86-64, Windows, or an old processor.
    pub fn detect() -> Result<Self, CompileError> {
        InstructionSet::Avx512.check().map(|()| InstructionSet::Avx512).or_else(|_| {
            InstructionSet::Avx2.check()?;
            Ok(InstructionSet::Avx2)
        })
    }

    /// Whether this machine can run its code.
    ///
    /// # Errors
    ///
    /// If it cannot, with the reason.
    pub fn check(self) -> Result<(), CompileError> {
        #[cfg(all(target_arch = "x86_64", unix))]
        {
            use std::is_x86_feature_detected as has;
            let present = match self {
                InstructionSet::Avx2 => has!("avx2") && has!("fma"),
                InstructionSet::Avx512 => has!("avx512f") && has!("avx512dq") && has!("avx512bw"),
            };
            if present { Ok(()) } else { Err(CompileError::Processor(self.name())) }
        }
        #[cfg(not(all(target_arch = "x86_64", unix)))]
        Err(CompileError::Platform)
    }

    /// Name, as reports spell it.
    pub fn name(self) -> &'static str {
        match self {
            InstructionSet::Avx2 => "AVX2",
            InstructionSet::Avx512 => "AVX-512",
        }
    }

    /// Number of vector registers.
    pub(crate) fn vector_registers(self) -> u8 {
        match self {
            InstructionSet::Avx2 => 16,
            InstructionSet::Avx512 => 32,
        }
    }

    /// Whether masks have registers of their own, a bit per lane; else they are vectors of ones and zeros.
    pub(crate) fn has_mask_registers(self) -> bool {
        self == InstructionSet::Avx512
    }

    /// Whether instructions can take one number from memory for all lanes.
    pub(crate) fn has_broadcast_operands(self) -> bool {
        self == InstructionSet::Avx512
    }

    /// Bytes of a register.
    #[inline(always)]
    pub(crate) fn vector_bytes(self) -> usize {
        match self {
            InstructionSet::Avx2 => 32,
            InstructionSet::Avx512 => 64,
        }
    }

    /// Bytes that a displacement of one byte reaches to either side, in steps of `step` bytes.
    #[inline(always)]
    pub(crate) fn short_reach(self, step: usize) -> usize {
        match self {
            InstructionSet::Avx2 => 128,
            InstructionSet::Avx512 => 128 * step,
        }
    }
}
