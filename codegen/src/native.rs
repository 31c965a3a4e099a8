//! Machine code as a function.

use iced_x86::{Decoder, DecoderOptions, Formatter, NasmFormatter};

use crate::allocate::Allocated;
use crate::emit::emit;
use crate::error::CompileError;
use crate::float::Precision;
use crate::isa::InstructionSet;
use crate::layout::Bindings;
use crate::memory::ExecutableMemory;

/// Addresses for a run of the code, as `emit` describes them.
#[derive(Clone, Copy)]
pub(crate) struct Arguments {
    pub fields: *const *mut u8,
    pub constants: *const u8,
    pub slots: *mut u8,
    pub masks_in: *const u32,
    pub masks_out: *mut u32,
}

type Entry = unsafe extern "sysv64" fn(*const *mut u8, *const u8, *mut u8, *const u32, *mut u32);
/// The last two: the first item, and the end of the items.
type EntryEach = unsafe extern "sysv64" fn(*const *mut u8, *const u8, *mut u8, *const u32, *const usize, *const usize);

/// The code of a fragment.
pub(crate) struct Code {
    memory: ExecutableMemory,
    /// Where it starts, for code without windows.
    entry: Entry,
    /// Number of instructions.
    pub instructions: usize,
}

impl Code {
    /// Encodes the instructions for this machine, which has the instruction set.
    pub fn new(
        allocated: &Allocated,
        bindings: Bindings<'_>,
        isa: InstructionSet,
        precision: Precision,
    ) -> Result<Self, CompileError> {
        let emitted = emit(allocated, bindings, isa, precision)?;
        let memory = ExecutableMemory::new(&emitted.code)?;
        // SAFETY: the pages hold a function of this signature, or of that of `EntryEach` if there are windows, complete with
        // its return, which `emit` has written; they stay mapped and unchanged as long as `memory`, which is kept beside it.
        let entry = unsafe { std::mem::transmute::<*const u8, Entry>(memory.code().as_ptr()) };
        Ok(Code { memory, entry, instructions: emitted.instructions })
    }

    /// The code.
    pub fn bytes(&self) -> &[u8] {
        self.memory.code()
    }

    /// Bytes of code.
    pub fn len(&self) -> usize {
        self.memory.code().len()
    }

    /// The code to be run.
    #[inline(always)]
    pub fn runner(&self) -> Runner {
        Runner(self.entry)
    }

    /// The instructions as text, one a line.
    pub fn disassembly(&self) -> String {
        let mut formatter = NasmFormatter::new();
        let mut text = String::new();
        for instruction in Decoder::new(64, self.memory.code(), DecoderOptions::NONE) {
            formatter.format(&instruction, &mut text);
            text.push('\n');
        }
        text
    }
}

/// Code to be run, as long as the [`Code`] that it is of lives.
#[derive(Clone, Copy)]
pub(crate) struct Runner(Entry);

impl Runner {
    /// Runs the code.
    ///
    /// # Safety
    ///
    /// The code must live. The addresses must be those of memory as large as the code was emitted for, aligned to 64 bytes (fields
    /// of lanes, constants, slots) or to their entries (uniform fields, masks), biased as [`crate::layout::bias`] says, and what
    /// is written to must be borrowed mutably.
    #[inline(always)]
    pub unsafe fn run(self, arguments: &Arguments) {
        let Arguments { fields, constants, slots, masks_in, masks_out } = *arguments;
        // SAFETY: the code reads and writes nothing but entries of what it is given, which `emit` asserts for every memory
        // operand and the caller vouches for; it preserves the registers and the stack that the convention asks for, and
        // `InstructionSet::check` has found its instructions on this machine before it was compiled.
        unsafe { (self.0)(fields, constants, slots, masks_in, masks_out) };
    }

    /// Runs the code that was emitted for windows, once for every item.
    ///
    /// # Safety
    ///
    /// As for [`run`](Runner::run), for the fields from where every item says that they start. The items are whole ones of
    /// the width that the code was emitted for, and at least one.
    #[inline(always)]
    pub unsafe fn run_each(self, arguments: &Arguments, items: &[usize]) {
        let Arguments { fields, constants, slots, masks_in, .. } = *arguments;
        let items = items.as_ptr_range();
        // SAFETY: for windows, `emit` writes a function of this signature.
        let entry = unsafe { std::mem::transmute::<Entry, EntryEach>(self.0) };
        // SAFETY: as in `run`; the loop ends at the end of the items, which is a whole number of them, not 0, ahead.
        unsafe { entry(fields, constants, slots, masks_in, items.start, items.end) };
    }
}
