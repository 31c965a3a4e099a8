//! Stands in for [`crate::native`] on platforms without code generation: there is never any code.

use crate::allocate::Allocated;
use crate::error::CompileError;
use crate::float::Precision;
use crate::isa::InstructionSet;
use crate::layout::Bindings;

#[allow(missing_docs)]
pub(crate) struct Arguments {
    pub fields: *const *mut u8,
    pub constants: *const u8,
    pub slots: *mut u8,
    pub masks_in: *const u32,
    pub masks_out: *mut u32,
}

/// Code, of which there is none.
pub(crate) struct Code {
    pub instructions: usize,
    none: std::convert::Infallible,
}

impl Code {
    pub fn new(_: &Allocated, _: Bindings<'_>, _: InstructionSet, _: Precision) -> Result<Self, CompileError> {
        Err(CompileError::Platform)
    }

    pub fn len(&self) -> usize {
        match self.none {}
    }

    pub fn bytes(&self) -> &[u8] {
        match self.none {}
    }

    pub fn runner(&self) -> Runner {
        match self.none {}
    }

    pub fn disassembly(&self) -> String {
        match self.none {}
    }
}

/// Code to be run, of which there is none.
#[derive(Clone, Copy)]
pub(crate) struct Runner(std::convert::Infallible);

impl Runner {
    /// # Safety
    ///
    /// Cannot be called.
    pub unsafe fn run(self, _: &Arguments) {
        match self.0 {}
    }

    /// # Safety
    ///
    /// Cannot be called.
    pub unsafe fn run_each(self, _: &Arguments, _: &[usize]) {
        match self.0 {}
    }
}
