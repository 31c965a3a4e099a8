//! Compiled fragments, and running them.

mod call;
mod session;
mod windows;

pub use session::{Lending, Session};
pub use windows::{Windows, WindowsList};

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Instant;

use crate::allocate::allocate;
use crate::error::CompileError;
use crate::float::{BLOCK_BYTES, Float, Precision};
use crate::isa::InstructionSet;
use crate::layout::{Bindings, Columns, bias, constant_bias, constant_bytes, field_step};
use crate::lower::{MaskOutput, lower};
use crate::native::{Arguments, Code};
use crate::recording::{FieldKind, FieldUse, Program};
use crate::statistics::Statistics;

/// Memory as aligned as code wants it.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Aligned([u8; BLOCK_BYTES]);

const ZEROS: Aligned = Aligned([0; BLOCK_BYTES]);

/// A field for a run of a fragment: borrowed memory.
pub struct FieldSlice<'a, T> {
    start: *mut u8,
    /// Length and flags in one word, see [`tag`], so that one comparison does.
    tag: usize,
    borrowed: PhantomData<&'a mut T>,
}

impl<'a, T: Float> FieldSlice<'a, T> {
    /// A field that is read.
    #[inline(always)]
    pub fn read(lanes: &'a [T::Block]) -> Self {
        Self::new(lanes.as_ptr().cast_mut().cast(), lanes.len(), FieldKind::Lanes, false)
    }

    /// A field that is written, and perhaps read.
    #[inline(always)]
    pub fn write(lanes: &'a mut [T::Block]) -> Self {
        Self::new(lanes.as_mut_ptr().cast(), lanes.len(), FieldKind::Lanes, true)
    }

    /// A field of numbers that all worlds share.
    #[inline(always)]
    pub fn uniform(numbers: &'a [T]) -> Self {
        Self::new(numbers.as_ptr().cast_mut().cast(), numbers.len(), FieldKind::Uniform, false)
    }

    /// A field of length 0, for a number that no field was bound to.
    pub const fn unused() -> Self {
        FieldSlice { start: std::ptr::null_mut(), tag: 0, borrowed: PhantomData }
    }

    #[inline(always)]
    fn new(start: *mut u8, len: usize, kind: FieldKind, writable: bool) -> Self {
        FieldSlice { start, tag: tag(len, kind, writable), borrowed: PhantomData }
    }
}

/// A field's length, kind and mutability as a number; slices are too short for any bit to be lost.
#[inline(always)]
const fn tag(len: usize, kind: FieldKind, writable: bool) -> usize {
    len << 2 | (matches!(kind, FieldKind::Uniform) as usize) << 1 | writable as usize
}

/// A field as the code wants it, ready to be compared and addressed.
#[derive(Clone, Copy)]
struct Wanted {
    tag: usize,
    /// Bits of the tag that matter: mutability where it is written, kind where it is not empty.
    mask: usize,
    /// The column of its windows, if it has any, else of no items.
    column: usize,
    /// Distance from its start to the address that the code is given for each part of the block, bytes.
    offsets: [usize; MOST_RUNS],
}

/// Runs for a block, at most.
const MOST_RUNS: usize = 2;

impl Wanted {
    fn new(bound: &FieldUse, column: Option<u32>, isa: InstructionSet, precision: Precision) -> Self {
        let indifferent =
            usize::from(!bound.written) | if bound.len == 0 { tag(0, FieldKind::Uniform, false) } else { 0 };
        let part = if bound.kind == FieldKind::Lanes { isa.vector_bytes() } else { 0 };
        Wanted {
            tag: tag(bound.len, bound.kind, bound.written),
            mask: !indifferent,
            column: column.map_or(usize::MAX, |column| column as usize),
            offsets: std::array::from_fn(|run| bias(isa, field_step(bound.kind, precision)) + run * part),
        }
    }

    /// Number of entries.
    #[inline(always)]
    fn len(&self) -> usize {
        self.tag >> 2
    }

    /// Bits in which the field differs.
    #[inline(always)]
    fn differs(&self, tag: usize) -> usize {
        (tag ^ self.tag) & self.mask
    }

    /// Whether a field with the tag is what the code wants, or has such windows up to the largest start by column.
    #[inline(always)]
    fn fits<T: Float, const N: usize>(&self, tag: usize, largest: &[usize; N]) -> bool {
        match largest.get(self.column) {
            None => self.differs(tag) == 0,
            Some(largest) => self.room::<T>(tag).is_some_and(|room| *largest <= room),
        }
    }

    /// Largest start of a window into a field with the tag; `None`: it has no such windows.
    #[inline(always)]
    fn room<T: Float>(&self, tag: usize) -> Option<usize> {
        let room = (tag >> 2).checked_sub(self.len())?;
        (self.differs(tag) & 3 == 0).then(|| if self.tag & 2 == 0 { room } else { room / per_start::<T>() })
    }
}

/// Numbers that worlds share from one possible start of a window to the next: see [`Program::compile_each`].
const fn per_start<T: Float>() -> usize {
    BLOCK_BYTES / T::PRECISION.bytes()
}

/// Memory that fragments work in, one for every thread. It grows to what the largest fragment needs.
#[derive(Default)]
pub struct Scratch {
    slots: Vec<Aligned>,
    masks_in: Vec<u32>,
    masks_out: Vec<u32>,
    /// Addresses of the fields of a call for one run; of no meaning between calls.
    fields: Vec<*mut u8>,
    /// What sessions have bound.
    kept: session::Kept,
}

// SAFETY: the addresses are written for every call and not used after it; all else is plain data.
unsafe impl Send for Scratch {}
// SAFETY: nothing can be done with a shared `Scratch`.
unsafe impl Sync for Scratch {}

impl Scratch {
    /// Empty.
    pub fn new() -> Self {
        Self::default()
    }

    /// What code of an instruction set is given of it.
    #[inline(always)]
    fn arguments(&mut self, isa: InstructionSet) -> Arguments {
        Arguments {
            fields: std::ptr::null(),
            constants: std::ptr::null(),
            slots: self.slots.as_mut_ptr().cast::<u8>().wrapping_add(bias(isa, isa.vector_bytes())),
            masks_in: self.masks_in.as_ptr(),
            masks_out: self.masks_out.as_mut_ptr(),
        }
    }

    /// Makes room for a fragment, so that its runs do not allocate.
    #[inline]
    pub fn reserve<T: Float>(&mut self, fragment: &Fragment<T>) {
        grow(&mut self.slots, fragment.slot_blocks, ZEROS);
        grow(&mut self.masks_in, fragment.masks_in, 0);
        grow(&mut self.masks_out, fragment.masks_out.len(), 0);
        grow(&mut self.fields, fragment.fields.len(), std::ptr::null_mut());
    }
}

#[inline(always)]
fn grow<X: Copy>(x: &mut Vec<X>, len: usize, filling: X) {
    #[cold]
    fn resize<X: Copy>(x: &mut Vec<X>, len: usize, filling: X) {
        x.resize(len, filling);
    }
    if x.len() < len {
        resize(x, len, filling);
    }
}

/// Code and its constants.
struct Machine {
    code: Code,
    constants: Vec<Aligned>,
    /// The same, as the code wants their address: bytes from their start.
    constants_bias: usize,
}

impl Machine {
    /// The address of the constants as the code wants it.
    #[inline(always)]
    fn constants(&self) -> *const u8 {
        self.constants.as_ptr().cast::<u8>().wrapping_add(self.constants_bias)
    }
}

/// A recorded program as machine code.
pub struct Fragment<T> {
    /// Shared with the calls that sessions keep.
    machine: Arc<Machine>,
    fields: Vec<FieldUse>,
    /// The same fields.
    wanted: Vec<Wanted>,
    masks_in: usize,
    masks_out: Vec<MaskOutput>,
    /// Of code that runs once for every item of a list.
    columns: Option<Columns>,
    /// Blocks of memory for spilled values.
    slot_blocks: usize,
    statistics: Statistics,
    real: PhantomData<fn() -> T>,
}

impl<T: Float> Program<T> {
    /// Compiles for an instruction set of this machine.
    ///
    /// # Errors
    ///
    /// If the platform or the processor cannot run the code, the system refuses memory for it, or the program is too
    /// large. The caller then runs its kernels over other lanes.
    pub fn compile(&self, isa: InstructionSet) -> Result<Fragment<T>, CompileError> {
        self.compile_with(isa, None)
    }

    fn compile_with(&self, isa: InstructionSet, columns: Option<Columns>) -> Result<Fragment<T>, CompileError> {
        isa.check()?;
        let start = Instant::now();
        let precision = T::PRECISION;
        let lowered = lower(self, isa);
        let allocated = allocate(&lowered, isa, columns.is_some());
        let (masks_in, masks_out) = self.masks();
        let bindings = Bindings { fields: &self.fields, masks_in, masks_out, windows: columns.as_ref() };
        let code = Code::new(&allocated, bindings, isa, precision)?;
        let bytes = constant_bytes(&allocated.constants, isa, precision);
        let constants = bytes.chunks(BLOCK_BYTES).map(|chunk| {
            let mut block = ZEROS;
            block.0[..chunk.len()].copy_from_slice(chunk);
            block
        });
        let mut operations = BTreeMap::new();
        for node in lowered.nodes.iter().filter(|node| !node.op.is_leaf()) {
            *operations.entry(node.op).or_default() += 1;
        }
        let statistics = Statistics {
            isa,
            order: allocated.order,
            operations,
            stores: lowered.stores.len(),
            constants: allocated.constants.len(),
            instructions: code.instructions,
            spills: allocated.spills,
            reloads: allocated.reloads,
            slots: allocated.slots as usize,
            bytes: code.len(),
            compile_time: start.elapsed(),
        };
        let column = |field| columns.as_ref().and_then(|columns| columns.of_fields[field]);
        let bound = self.fields.iter().enumerate();
        let wanted = bound.map(|(field, bound)| Wanted::new(bound, column(field), isa, precision)).collect();
        let constants_bias = constant_bias(isa, precision);
        Ok(Fragment {
            machine: Arc::new(Machine { code, constants: constants.collect(), constants_bias }),
            wanted,
            fields: self.fields.clone(),
            masks_in,
            masks_out: lowered.masks_out,
            columns,
            slot_blocks: (allocated.slots as usize * isa.vector_bytes()).div_ceil(BLOCK_BYTES),
            statistics,
            real: PhantomData,
        })
    }
}

impl<T: Float> Fragment<T> {
    /// Runs the code on one block: `fields` by number, the bits of the masks given and returned, lane 0 lowest.
    ///
    /// # Panics
    ///
    /// If the number of fields or masks, or a field's kind or length, differs from what was recorded, a field that is
    /// written was lent for reading only, or the code was made for windows.
    pub fn run(
        &self,
        scratch: &mut Scratch,
        fields: &mut [FieldSlice<'_, T>],
        masks_in: &[u32],
        masks_out: &mut [u32],
    ) {
        self.call_with(scratch, fields, &[]).run(masks_in, masks_out);
    }

    /// How often the code runs for a block.
    fn runs(&self) -> usize {
        BLOCK_BYTES / self.statistics.isa.vector_bytes()
    }

    /// Moves the addresses of fields from a run on part of a block to the next one.
    #[inline(always)]
    fn advance(&self, run: usize, scratch: &mut Scratch) {
        if run > 0 {
            for (address, wanted) in scratch.fields.iter_mut().zip(&self.wanted) {
                *address = address.wrapping_add(wanted.offsets[run].wrapping_sub(wanted.offsets[run - 1]));
            }
        }
    }

    /// What the code is given beside the fields, for a run on part of a block.
    #[inline(always)]
    fn arguments(&self, scratch: &mut Scratch, masks_in: &[u32], run: usize) -> Arguments {
        let isa = self.statistics.isa;
        for (word, given) in scratch.masks_in.iter_mut().zip(masks_in) {
            *word = given >> (run * isa.vector_bytes() / T::PRECISION.bytes());
        }
        Arguments { constants: self.machine.constants(), ..scratch.arguments(isa) }
    }

    #[cold]
    fn refuse(&self, field: usize, tag: usize, largest: &[usize]) -> ! {
        let (len, writable) = (tag >> 2, tag & 1 != 0);
        let kind = if tag & 2 == 0 { FieldKind::Lanes } else { FieldKind::Uniform };
        let (bound, windows) = (&self.fields[field], largest.get(self.wanted[field].column));
        let from = windows.map_or(String::new(), |largest| format!(" in windows up to {largest}"));
        panic!("field {field} is {kind:?}, length {len}, writable {writable}; the fragment wants {bound:?}{from}");
    }

    /// Adds the masks that a run returned, whose first lane is `first`.
    fn collect_masks(&self, words: &[u32], first: usize, masks_out: &mut [u32]) {
        for ((out, word), mask) in masks_out.iter_mut().zip(words).zip(&self.masks_out) {
            let before = if first == 0 { 0 } else { *out };
            *out = match mask {
                MaskOutput::Value(_) => before | word << first,
                MaskOutput::Known(true) => ((1_u64 << T::PRECISION.lanes()) - 1) as u32,
                MaskOutput::Known(false) => 0,
            };
        }
    }

    /// The fields that it wants, by number.
    pub fn fields(&self) -> &[FieldUse] {
        &self.fields
    }

    /// Figures about it.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Gives the code a name, for profiles: see the environment variable `LANESIM_PERF_MAP`.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        crate::perf::note(name, self.machine.code.bytes());
        self
    }

    /// Its instructions as text, one a line.
    pub fn disassembly(&self) -> String {
        self.machine.code.disassembly()
    }
}

impl<T> std::fmt::Debug for Fragment<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Fragment").field("statistics", &self.statistics).finish_non_exhaustive()
    }
}
