//! Encoding of instructions, for every instruction set and precision.
//!
//! The code is a System V function of the table of field addresses, the constants, the scratch slots, the masks given and
//! the masks returned. All addresses but those of masks point [`bias`] bytes ahead, so that short displacements reach twice
//! as far. With AVX2 it computes the half of a block that the field addresses point to.
//!
//! Code for windows is a loop over items, whose first and whose end it gets in place of the masks returned. An item is a
//! row of offsets in bytes, which are added to the addresses of the fields that have a column.

mod bases;
mod codes;

use iced_x86::{Code, Encoder, Instruction as Native, MemoryOperand, Register};

use self::bases::{Bases, Stretch};
use crate::allocate::Allocated;
use crate::error::CompileError;
use crate::float::Precision;
use crate::graph::Op;
use crate::isa::InstructionSet;
use crate::layout::{Bindings, Columns, bias, constant_step, field_step};
use crate::machine::{Class, Instruction, Place, Source};
use crate::recording::FieldKind;

const FIELDS: Register = Register::RDI;
const CONSTANTS: Register = Register::RSI;
const SLOTS: Register = Register::RDX;
const MASKS_IN: Register = Register::RCX;
const MASKS_OUT: Register = Register::R8;
/// Holds a word of bits on its way to memory.
const BITS: Register = Register::EAX;
/// The present item of code for windows, which returns no masks.
const ITEM: Register = MASKS_OUT;
/// How the end of the items arrives, and what holds it during the loop.
const LAST_ARGUMENT: Register = Register::R9;
const END: Register = Register::RAX;

/// In place of a field's number, the slots: code that is larger than the first cache goes at the pace at which its bytes
/// arrive, so addresses for short displacements pay.
const SPILLED: u32 = u32::MAX;

/// Largest displacement that is used.
const REACH: usize = 1 << 30;

/// Machine code, and the number of its instructions.
pub(crate) struct Emitted {
    pub code: Vec<u8>,
    pub instructions: usize,
}

/// Encodes a fragment.
pub(crate) fn emit(
    allocated: &Allocated,
    bindings: Bindings<'_>,
    isa: InstructionSet,
    precision: Precision,
) -> Result<Emitted, CompileError> {
    let sizes = bindings.fields.iter().map(|field| field.len * field_step(field.kind, precision));
    let slots = allocated.slots as usize * isa.vector_bytes();
    let constants = (allocated.constants.len() + 1) * constant_step(isa, precision);
    if sizes.chain([slots, constants]).any(|size| size >= REACH) {
        return Err(CompileError::TooLarge("a field, the constants or the spilled values take a gigabyte"));
    }
    let mut emitter = Emitter {
        encoder: Encoder::new(64),
        count: 0,
        bytes: 0,
        isa,
        precision,
        bindings,
        constants: allocated.constants.len() as u32,
        slots: allocated.slots,
        bases: Bases::new(&[]),
    };
    let accesses: Vec<Stretch> = allocated.instructions.iter().filter_map(|i| emitter.stretch(i)).collect();
    emitter.bases = Bases::new(&accesses);
    emitter.fragment(&allocated.instructions).map_err(|error| CompileError::Encoding(error.to_string()))?;
    Ok(Emitted { code: emitter.encoder.take_buffer(), instructions: emitter.count })
}

type Encoded = Result<(), iced_x86::IcedError>;

struct Emitter<'a> {
    encoder: Encoder,
    count: usize,
    /// Bytes of the code so far.
    bytes: usize,
    isa: InstructionSet,
    precision: Precision,
    bindings: Bindings<'a>,
    constants: u32,
    slots: u32,
    bases: Bases,
}

impl Emitter<'_> {
    fn fragment(&mut self, instructions: &[Instruction]) -> Encoded {
        let preserved = self.bases.preserved();
        for register in preserved {
            self.put(Native::with1(Code::Push_r64, *register)?)?;
        }
        match self.bindings.windows {
            None => instructions.iter().try_for_each(|instruction| self.instruction(instruction))?,
            Some(columns) => self.for_each_item(columns, instructions)?,
        }
        for register in preserved.iter().rev() {
            self.put(Native::with1(Code::Pop_r64, *register)?)?;
        }
        self.put(Native::with(Code::VEX_Vzeroupper))?;
        self.put(Native::with(Code::Retnq))
    }

    fn for_each_item(&mut self, columns: &Columns, instructions: &[Instruction]) -> Encoded {
        assert_eq!(self.bindings.masks_out, 0, "masks returned");
        self.put(Native::with2(Code::Mov_r64_rm64, END, LAST_ARGUMENT)?)?;
        let first = self.bytes as u64;
        instructions.iter().try_for_each(|instruction| self.instruction(instruction))?;
        self.put(Native::with2(Code::Add_rm64_imm32, ITEM, columns.item_bytes() as i32)?)?;
        self.put(Native::with2(Code::Cmp_rm64_r64, ITEM, END)?)?;
        self.put(Native::with_branch(Code::Jne_rel32_64, first)?)
    }

    fn put(&mut self, native: Native) -> Encoded {
        self.count += 1;
        self.bytes += self.encoder.encode(&native, self.bytes as u64)?;
        Ok(())
    }

    fn code(&self, op: Op) -> Code {
        codes::code(op, self.isa, self.precision)
    }

    fn vector(&self, number: u8) -> Register {
        let first = match self.isa {
            InstructionSet::Avx2 => Register::YMM0,
            InstructionSet::Avx512 => Register::ZMM0,
        };
        first + u32::from(number)
    }

    fn mask(&self, number: u8) -> Register {
        if self.isa.has_mask_registers() { Register::K0 + u32::from(number) } else { self.vector(number) }
    }

    fn instruction(&mut self, instruction: &Instruction) -> Encoded {
        match *instruction {
            Instruction::Load { class: Class::Vector, to, from } => self.load(to, from),
            Instruction::Load { class: Class::Mask, to, from } => {
                let code =
                    if matches!(from, Place::MaskWord(_)) { self.code(Op::MaskInput) } else { Code::VEX_Kmovw_kr_km16 };
                let memory = self.memory(from)?;
                self.put(Native::with2(code, self.mask(to), memory)?)
            }
            Instruction::Store { class, from, to } => {
                let memory = self.memory(to)?;
                let (code, from) = match (class, self.isa) {
                    (Class::Mask, _) => (Code::VEX_Kmovw_m16_kr, self.mask(from)),
                    (Class::Vector, InstructionSet::Avx2) => (Code::VEX_Vmovaps_ymmm256_ymm, self.vector(from)),
                    (Class::Vector, InstructionSet::Avx512) => (Code::EVEX_Vmovaps_zmmm512_k1z_zmm, self.vector(from)),
                };
                self.put(Native::with2(code, memory, from)?)
            }
            Instruction::Move { to, from } => {
                let native = Native::with2(self.aligned_move(), self.vector(to), self.vector(from))?;
                self.put(native)
            }
            Instruction::Unary { op, to, from } => self.unary(op, to, from),
            Instruction::Shift { op, to, from, bits } => {
                let native = Native::with3(self.code(op), self.vector(to), self.vector(from), u32::from(bits))?;
                self.put(native)
            }
            Instruction::Binary { op, to, left, right } => {
                self.three(self.code(op), self.vector(to), self.vector(left), right).and_then(|native| self.put(native))
            }
            Instruction::Fused { op, form, to, second, third } => {
                let code = codes::fused(op, form, self.isa, self.precision);
                self.three(code, self.vector(to), self.vector(second), third).and_then(|native| self.put(native))
            }
            Instruction::Compare { op, swapped, to, left, right } => self.compare(op, swapped, to, left, right),
            Instruction::Select { to, mask, then, otherwise } => self.select(to, mask, then, otherwise),
            Instruction::MaskBinary { op, to, left, right } => {
                let native = Native::with3(self.code(op), self.mask(to), self.mask(left), self.mask(right))?;
                self.put(native)
            }
            Instruction::MaskNot { to, from } => {
                let native = Native::with2(self.code(Op::MaskNot), self.mask(to), self.mask(from))?;
                self.put(native)
            }
            Instruction::StoreMaskWord { from, index } => self.store_mask_word(from, index),
        }
    }

    fn aligned_move(&self) -> Code {
        match self.isa {
            InstructionSet::Avx2 => Code::VEX_Vmovaps_ymm_ymmm256,
            InstructionSet::Avx512 => Code::EVEX_Vmovaps_zmm_k1z_zmmm512,
        }
    }

    fn load(&mut self, to: u8, from: Place) -> Encoded {
        let to = self.vector(to);
        if let Place::MaskWord(_) = from {
            return self.load_mask_word(to, from);
        }
        let memory = self.memory(from)?;
        let one_number = match from {
            Place::Uniform { .. } => true,
            Place::Constant(_) => self.isa.has_broadcast_operands(),
            _ => false,
        };
        let code = if one_number { self.code(Op::Uniform) } else { self.aligned_move() };
        // A plain broadcast is not the broadcast of an operand within an instruction.
        let memory = MemoryOperand { is_broadcast: false, ..memory };
        self.put(Native::with2(code, to, memory)?)
    }

    /// Bits to a vector mask: a lane holds where its bit is set.
    fn load_mask_word(&mut self, to: Register, from: Place) -> Encoded {
        let word = self.memory(from)?;
        let lane_bits = self.memory(Place::Constant(self.constants))?;
        let test = self.code(Op::MaskInput);
        self.put(Native::with2(Code::VEX_Vpbroadcastd_ymm_xmmm32, to, word)?)?;
        self.put(Native::with3(Code::VEX_Vpand_ymm_ymm_ymmm256, to, to, lane_bits)?)?;
        self.put(Native::with3(test, to, to, lane_bits)?)
    }

    fn store_mask_word(&mut self, from: u8, index: u32) -> Encoded {
        assert!((index as usize) < self.bindings.masks_out, "mask {index} of {}", self.bindings.masks_out);
        let word = MemoryOperand::with_base_displ(MASKS_OUT, 4 * i64::from(index));
        if self.isa.has_mask_registers() {
            let native = Native::with2(Code::VEX_Kmovd_m32_kr, word, self.mask(from))?;
            return self.put(native);
        }
        let code = match self.precision {
            Precision::Single => Code::VEX_Vmovmskps_r32_ymm,
            Precision::Double => Code::VEX_Vmovmskpd_r32_ymm,
        };
        self.put(Native::with2(code, BITS, self.vector(from))?)?;
        self.put(Native::with2(Code::Mov_rm32_r32, word, BITS)?)
    }

    fn unary(&mut self, op: Op, to: u8, from: Source) -> Encoded {
        let (code, to) = (self.code(op), self.vector(to));
        // Round to nearest, ties to even, whatever the processor's mode; no exception for inexact results.
        const TO_NEAREST: u32 = 8;
        let native = match (from, op) {
            (Source::Register(from), Op::Round) => Native::with3(code, to, self.vector(from), TO_NEAREST)?,
            (Source::Register(from), _) => Native::with2(code, to, self.vector(from))?,
            (Source::Memory(place), Op::Round) => Native::with3(code, to, self.memory(place)?, TO_NEAREST)?,
            (Source::Memory(place), _) => Native::with2(code, to, self.memory(place)?)?,
        };
        self.put(native)
    }

    /// An instruction of two registers and an operand that may be in memory.
    fn three(
        &mut self,
        code: Code,
        to: Register,
        left: Register,
        right: Source,
    ) -> Result<Native, iced_x86::IcedError> {
        match right {
            Source::Register(right) => Native::with3(code, to, left, self.vector(right)),
            Source::Memory(place) => Native::with3(code, to, left, self.memory(place)?),
        }
    }

    fn compare(&mut self, op: Op, swapped: bool, to: u8, left: u8, right: Source) -> Encoded {
        let (code, to, left) = (self.code(op), self.mask(to), self.vector(left));
        let predicate = codes::predicate(op, swapped);
        let native = match right {
            Source::Register(right) => Native::with4(code, to, left, self.vector(right), predicate)?,
            Source::Memory(place) => Native::with4(code, to, left, self.memory(place)?, predicate)?,
        };
        self.put(native)
    }

    fn select(&mut self, to: u8, mask: u8, then: Source, otherwise: u8) -> Encoded {
        let (code, to, otherwise) = (self.code(Op::Select), self.vector(to), self.vector(otherwise));
        let mask = self.mask(mask);
        if self.isa.has_mask_registers() {
            let mut native = self.three(code, to, otherwise, then)?;
            native.set_op_mask(mask);
            return self.put(native);
        }
        let native = match then {
            Source::Register(then) => Native::with4(code, to, otherwise, self.vector(then), mask)?,
            Source::Memory(place) => Native::with4(code, to, otherwise, self.memory(place)?, mask)?,
        };
        self.put(native)
    }

    /// The stretch of a field that the instruction reads or writes.
    fn stretch(&self, instruction: &Instruction) -> Option<Stretch> {
        let place = match *instruction {
            Instruction::Load { from, .. } => from,
            Instruction::Store { to, .. } => to,
            Instruction::Unary { from: Source::Memory(place), .. }
            | Instruction::Binary { right: Source::Memory(place), .. }
            | Instruction::Fused { third: Source::Memory(place), .. }
            | Instruction::Compare { right: Source::Memory(place), .. }
            | Instruction::Select { then: Source::Memory(place), .. } => place,
            _ => return None,
        };
        match place {
            Place::Field { field, lane: entry } | Place::Uniform { field, index: entry } => {
                Some((field, entry / self.stretch_len(field)))
            }
            Place::Slot(slot) => Some((SPILLED, slot / self.slot_stretch())).filter(|(_, stretch)| *stretch > 0),
            _ => None,
        }
    }

    /// Slots that one address serves.
    fn slot_stretch(&self) -> u32 {
        match self.isa {
            InstructionSet::Avx2 => u32::MAX,
            InstructionSet::Avx512 => (2 * bias(self.isa, self.isa.vector_bytes()) / self.isa.vector_bytes()) as u32,
        }
    }

    /// Entries of a field that one address serves. Without scaled displacements more addresses would save nothing.
    fn stretch_len(&self, field: u32) -> u32 {
        let step = field_step(self.bindings.fields[field as usize].kind, self.precision);
        match self.isa {
            InstructionSet::Avx2 => u32::MAX,
            InstructionSet::Avx512 => (2 * bias(self.isa, step) / step) as u32,
        }
    }

    /// The memory operand for a place, and the address that it needs in a register.
    ///
    /// # Panics
    ///
    /// If the place is beyond what it is part of: code must never reach memory that its caller has not checked.
    fn memory(&mut self, place: Place) -> Result<MemoryOperand, iced_x86::IcedError> {
        let (base, offset, broadcast) = match place {
            Place::Field { field, lane } => self.entry(field, lane, FieldKind::Lanes)?,
            Place::Uniform { field, index } => self.entry(field, index, FieldKind::Uniform)?,
            Place::Slot(slot) => self.slot(slot)?,
            Place::Constant(index) => {
                assert!(index <= self.constants, "constant {index} of {}", self.constants);
                let step = constant_step(self.isa, self.precision);
                let broadcast = self.isa.has_broadcast_operands();
                (CONSTANTS, index as i64 * step as i64 - bias(self.isa, step) as i64, broadcast)
            }
            Place::MaskWord(index) => {
                assert!((index as usize) < self.bindings.masks_in, "mask {index} of {}", self.bindings.masks_in);
                (MASKS_IN, 4 * i64::from(index), false)
            }
        };
        Ok(MemoryOperand { is_broadcast: broadcast, ..MemoryOperand::with_base_displ(base, offset) })
    }

    /// Register, displacement and no broadcast for a slot. The first ones have an address of their own.
    fn slot(&mut self, slot: u32) -> Result<(Register, i64, bool), iced_x86::IcedError> {
        assert!(slot < self.slots, "slot {slot} of {}", self.slots);
        let step = self.isa.vector_bytes();
        let stretch = slot / self.slot_stretch();
        let start = i64::from(stretch) * i64::from(self.slot_stretch()) * step as i64;
        let (register, missing) = if stretch == 0 { (SLOTS, false) } else { self.bases.access((SPILLED, stretch)) };
        if missing {
            let address = MemoryOperand::with_base_displ(SLOTS, start);
            self.put(Native::with2(Code::Lea_r64_m, register, address)?)?;
        }
        Ok((register, i64::from(slot) * step as i64 - start - bias(self.isa, step) as i64, false))
    }

    /// Loads the address of a field, or of its part for the present item.
    fn address(&mut self, field: u32, register: Register) -> Encoded {
        let address = MemoryOperand::with_base_displ(FIELDS, 8 * i64::from(field));
        let Some(column) = self.bindings.windows.and_then(|columns| columns.of_fields[field as usize]) else {
            return self.put(Native::with2(Code::Mov_r64_rm64, register, address)?);
        };
        let offset = MemoryOperand::with_base_displ(ITEM, 8 * i64::from(column));
        self.put(Native::with2(Code::Mov_r64_rm64, register, offset)?)?;
        self.put(Native::with2(Code::Add_r64_rm64, register, address)?)
    }

    /// Register, displacement and broadcast for an entry of a field.
    fn entry(&mut self, field: u32, entry: u32, kind: FieldKind) -> Result<(Register, i64, bool), iced_x86::IcedError> {
        let bound = self.bindings.fields[field as usize];
        assert!(bound.kind == kind && (entry as usize) < bound.len, "entry {entry} of field {field}, {bound:?}");
        let step = field_step(kind, self.precision);
        let stretch = entry / self.stretch_len(field);
        let start = i64::from(stretch) * i64::from(self.stretch_len(field)) * step as i64;
        let (register, missing) = self.bases.access((field, stretch));
        if missing {
            self.address(field, register)?;
            if start > 0 {
                self.put(Native::with2(Code::Add_rm64_imm32, register, start as i32)?)?;
            }
        }
        let broadcast = kind == FieldKind::Uniform;
        Ok((register, i64::from(entry) * step as i64 - start - bias(self.isa, step) as i64, broadcast))
    }
}
