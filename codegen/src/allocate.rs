//! Registers for values.
//!
//! Values leave registers by farthest next use. One that is in memory anyway - an input, a constant, an output already
//! stored, a value spilled before - leaves for nothing and is read again, as the memory operand of an instruction unless
//! more uses follow soon. Slots of spilled values are reused.

use rustc_hash::FxHashMap;

use crate::graph::{Id, Node, Op};
use crate::isa::InstructionSet;
use crate::lower::Lowered;
use crate::machine::{Class, Form, Instruction, Place, Source};
use crate::schedule::{Item, Order};
use crate::uses::{NEVER, Uses};

/// A value in memory is loaded into a register if its next use is at most this many steps away; else it is read in place.
const SOON: u32 = 24;

/// No register.
const NONE: u8 = u8::MAX;
/// No value.
const NOBODY: Id = Id::MAX;

/// Mask registers that may hold masks: k1 to k7, as k0 means "no mask" to instructions.
const MASK_REGISTERS: std::ops::Range<u8> = 1..8;

/// Instructions, and what they need.
pub(crate) struct Allocated {
    pub order: Order,
    pub instructions: Vec<Instruction>,
    /// Bits of the constants.
    pub constants: Vec<u64>,
    pub slots: u32,
    pub spills: usize,
    pub reloads: usize,
}

/// Values of a program beyond which latencies do not decide its order: while one chain waits, there is enough else to do,
/// and registers are what is short.
const MOST_BY_LATENCY: usize = 4096;

/// The best of the orders. That by latency may cost an eighth more than the others, as chains run side by side; `looped`
/// code does without, because its next round begins before the last one ends.
pub(crate) fn allocate(lowered: &Lowered, isa: InstructionSet, looped: bool) -> Allocated {
    let with = |order| {
        let items = lowered.schedule(order, isa, looped);
        Allocator::new(lowered, &items, isa, order).run(&items)
    };
    let [a, b] = [Order::Recorded, Order::DepthFirst].map(with);
    let best = if b.cost() < a.cost() { b } else { a };
    if lowered.nodes.len() > MOST_BY_LATENCY {
        return best;
    }
    let quick = with(Order::Latency);
    let most = best.cost() + if looped { 0 } else { best.cost() / 8 };
    if quick.cost() <= most { quick } else { best }
}

impl Allocated {
    /// Instructions, where traffic of spilled values counts twice: it competes with everything else for the cache.
    fn cost(&self) -> usize {
        self.instructions.len() + self.spills + self.reloads
    }
}

/// Registers of a class.
struct File {
    occupants: Vec<Id>,
    /// Registers that the present step needs to keep.
    locked: u32,
}

struct Allocator<'a> {
    nodes: &'a [Node],
    isa: InstructionSet,
    uses: Uses,
    now: u32,
    files: [File; 2],
    register: Vec<u8>,
    /// Where in memory each value is, if it is.
    home: Vec<Option<Place>>,
    constants: FxHashMap<Id, u32>,
    free_slots: Vec<u32>,
    out: Allocated,
}

impl<'a> Allocator<'a> {
    fn new(lowered: &'a Lowered, items: &[Item], isa: InstructionSet, order: Order) -> Self {
        let nodes = &lowered.nodes[..];
        let file = |n: u8| File { occupants: vec![NOBODY; usize::from(n)], locked: 0 };
        let out = Allocated { order, instructions: vec![], constants: vec![], slots: 0, spills: 0, reloads: 0 };
        Allocator {
            nodes,
            isa,
            uses: Uses::new(nodes, items),
            now: 0,
            files: [file(isa.vector_registers()), file(if isa.has_mask_registers() { MASK_REGISTERS.end } else { 0 })],
            register: vec![NONE; nodes.len()],
            home: vec![None; nodes.len()],
            constants: FxHashMap::default(),
            free_slots: vec![],
            out,
        }
    }

    fn run(mut self, items: &[Item]) -> Allocated {
        self.out.instructions.reserve(items.len() + items.len() / 4);
        for (now, item) in items.iter().enumerate() {
            self.now = now as u32;
            let mut operands = [NOBODY; 3];
            let count = Uses::operands(self.nodes, item, &mut operands);
            self.begin(&operands[..count]);
            match *item {
                Item::Compute(id) => self.compute(id),
                Item::Store(store) => self.store(store.value, Place::Field { field: store.field, lane: store.lane }),
                Item::StoreMask { value, index } => {
                    let from = self.in_register(value);
                    self.emit(Instruction::StoreMaskWord { from, index });
                }
            }
            operands[..count].iter().for_each(|id| self.release(*id));
        }
        self.out
    }

    /// Notes that the operands are used now, and keeps those that are in registers.
    fn begin(&mut self, operands: &[Id]) {
        self.files.iter_mut().for_each(|file| file.locked = 0);
        for id in operands {
            self.uses.pass(*id, self.now);
            if self.register[*id as usize] != NONE {
                self.lock(*id);
            } else if self.home[*id as usize].is_none() {
                self.home[*id as usize] = self.leaf_place(*id);
            }
        }
    }

    fn leaf_place(&mut self, id: Id) -> Option<Place> {
        let node = self.nodes[id as usize];
        let [field, index, _] = node.args;
        match node.op {
            Op::Input => Some(Place::Field { field, lane: index }),
            Op::Uniform => Some(Place::Uniform { field, index }),
            Op::MaskInput => Some(Place::MaskWord(field)),
            Op::Constant => {
                let constants = &mut self.out.constants;
                Some(Place::Constant(*self.constants.entry(id).or_insert_with(|| {
                    constants.push(node.bits());
                    constants.len() as u32 - 1
                })))
            }
            _ => None,
        }
    }

    fn emit(&mut self, instruction: Instruction) {
        self.out.instructions.push(instruction);
    }

    fn class(&self, id: Id) -> Class {
        let mask = self.isa.has_mask_registers() && self.nodes[id as usize].op.is_mask();
        if mask { Class::Mask } else { Class::Vector }
    }

    fn lock(&mut self, id: Id) {
        let class = self.class(id);
        self.files[class as usize].locked |= 1 << self.register[id as usize];
    }

    fn place_in(&mut self, id: Id, register: u8) {
        let class = self.class(id);
        self.register[id as usize] = register;
        self.files[class as usize].occupants[usize::from(register)] = id;
        self.files[class as usize].locked |= 1 << register;
    }

    /// Gives back what a value without further uses holds.
    fn release(&mut self, id: Id) {
        if self.uses.next(id) != NEVER {
            return;
        }
        self.vacate(id);
        if let Some(Place::Slot(slot)) = self.home[id as usize].take() {
            self.free_slots.push(slot);
        }
    }

    fn vacate(&mut self, id: Id) {
        let register = std::mem::replace(&mut self.register[id as usize], NONE);
        if register != NONE {
            let class = self.class(id);
            let file = &mut self.files[class as usize];
            file.occupants[usize::from(register)] = NOBODY;
            file.locked &= !(1 << register);
        }
    }

    /// A register that may be written: a free one, or that of the value whose next use is farthest, and when that is.
    fn candidate(&self, class: Class) -> (u8, u32) {
        let file = &self.files[class as usize];
        let first = if class == Class::Mask { MASK_REGISTERS.start } else { 0 };
        let (mut best, mut farthest, mut farthest_clean) = (NONE, 0, false);
        for register in first..file.occupants.len() as u8 {
            if file.locked >> register & 1 != 0 {
                continue;
            }
            let occupant = file.occupants[usize::from(register)];
            if occupant == NOBODY {
                return (register, NEVER);
            }
            let next = self.uses.next(occupant);
            let clean = self.home[occupant as usize].is_some();
            if best == NONE || (next, clean) > (farthest, farthest_clean) {
                (best, farthest, farthest_clean) = (register, next, clean);
            }
        }
        (best, farthest)
    }

    /// A register that may be written; its value is spilled if it is nowhere else.
    fn take(&mut self, class: Class) -> u8 {
        let (register, _) = self.candidate(class);
        assert!(register != NONE, "every register is an operand of the same instruction");
        let occupant = self.files[class as usize].occupants[usize::from(register)];
        if occupant != NOBODY {
            if self.home[occupant as usize].is_none() {
                let slot = self.free_slots.pop().unwrap_or_else(|| {
                    self.out.slots += 1;
                    self.out.slots - 1
                });
                self.home[occupant as usize] = Some(Place::Slot(slot));
                self.emit(Instruction::Store { class, from: register, to: Place::Slot(slot) });
                self.out.spills += 1;
            }
            self.vacate(occupant);
        }
        self.files[class as usize].locked |= 1 << register;
        register
    }

    /// The place of a value that is not in a register.
    fn place(&mut self, id: Id) -> Place {
        let place = self.home[id as usize].expect("a live value is in a register or in memory");
        self.out.reloads += usize::from(matches!(place, Place::Slot(_)));
        place
    }

    /// Register of the value, loaded if need be.
    fn in_register(&mut self, id: Id) -> u8 {
        if self.register[id as usize] == NONE {
            let class = self.class(id);
            let to = self.take(class);
            let from = self.place(id);
            self.emit(Instruction::Load { class, to, from });
            self.place_in(id, to);
        }
        self.register[id as usize]
    }

    fn is_in_register(&self, id: Id) -> bool {
        self.register[id as usize] != NONE
    }

    /// The value as an operand that may be in memory.
    fn source(&mut self, id: Id) -> Source {
        if !self.is_in_register(id) && self.readable_in_place(id) && !self.worth_loading(id) {
            return Source::Memory(self.place(id));
        }
        Source::Register(self.in_register(id))
    }

    fn readable_in_place(&self, id: Id) -> bool {
        match self.home[id as usize] {
            Some(Place::Uniform { .. }) => self.isa.has_broadcast_operands(),
            Some(Place::MaskWord(_)) => false,
            _ => true,
        }
    }

    /// Whether a register for the value costs less than it saves.
    fn worth_loading(&self, id: Id) -> bool {
        let next = self.uses.next(id);
        next <= self.now + SOON && self.candidate(Class::Vector).1 > next
    }

    /// A register for the result. Operands without further uses make room.
    fn result(&mut self, id: Id) -> u8 {
        let mut operands = [NOBODY; 3];
        let count = Uses::operands(self.nodes, &Item::Compute(id), &mut operands);
        for operand in &operands[..count] {
            if self.uses.next(*operand) == NEVER {
                self.vacate(*operand);
            }
        }
        let class = self.class(id);
        let register = self.take(class);
        self.place_in(id, register);
        register
    }

    fn store(&mut self, value: Id, to: Place) {
        let from = self.in_register(value);
        self.emit(Instruction::Store { class: Class::Vector, from, to });
        match self.home[value as usize] {
            None => self.home[value as usize] = Some(to),
            Some(Place::Slot(slot)) => {
                self.free_slots.push(slot);
                self.home[value as usize] = Some(to);
            }
            Some(_) => {}
        }
    }

    fn compute(&mut self, id: Id) {
        let Node { op, args: [a, b, c] } = self.nodes[id as usize];
        match op {
            Op::Copy | Op::Sqrt | Op::Round => {
                let from = self.source(a);
                let to = self.result(id);
                self.emit(match (op, from) {
                    (Op::Copy, Source::Register(from)) => Instruction::Move { to, from },
                    (Op::Copy, Source::Memory(from)) => Instruction::Load { class: Class::Vector, to, from },
                    _ => Instruction::Unary { op, to, from },
                });
            }
            Op::ShiftLeft | Op::ShiftRight => {
                let from = self.in_register(a);
                let to = self.result(id);
                self.emit(Instruction::Shift { op, to, from, bits: b as u8 });
            }
            Op::MulAdd | Op::NegMulAdd | Op::MulSub | Op::NegMulSub => self.fused(id, op, [a, b, c]),
            Op::Select => {
                let (mask, otherwise) = (self.in_register(a), self.in_register(c));
                let then = self.source(b);
                let to = self.result(id);
                self.emit(Instruction::Select { to, mask, then, otherwise });
            }
            Op::MaskNot => {
                let from = self.in_register(a);
                let to = self.result(id);
                self.emit(Instruction::MaskNot { to, from });
            }
            Op::MaskAnd | Op::MaskOr | Op::MaskDiffer | Op::MaskSame => {
                let (left, right) = (self.in_register(a), self.in_register(b));
                let to = self.result(id);
                self.emit(Instruction::MaskBinary { op, to, left, right });
            }
            _ => self.binary(id, op, a, b),
        }
    }

    fn binary(&mut self, id: Id, op: Op, a: Id, b: Id) {
        let comparison = op.negated_comparison().is_some();
        let commutes = matches!(op, Op::Add | Op::Mul | Op::BitAnd | Op::BitOr | Op::BitXor) || comparison;
        // The operand that is in memory is best the right one.
        let swapped = commutes && !self.is_in_register(a) && self.prefers_memory(a, b);
        let (a, b) = if swapped { (b, a) } else { (a, b) };
        let left = self.in_register(a);
        let right = self.source(b);
        let to = self.result(id);
        self.emit(match comparison {
            true => Instruction::Compare { op, swapped, to, left, right },
            false => Instruction::Binary { op, to, left, right },
        });
    }

    /// Of two values, the first one in memory: whether it is rather read there than the second.
    fn prefers_memory(&self, a: Id, b: Id) -> bool {
        self.is_in_register(b)
            || !self.readable_in_place(b)
            || self.readable_in_place(a) && self.uses.next(a) > self.uses.next(b)
    }

    /// a b + c: the result replaces an operand that has no further uses, or a copy of one.
    fn fused(&mut self, id: Id, op: Op, [a, b, c]: [Id; 3]) {
        let dies = |s: &Self, x: Id| s.is_in_register(x) && s.uses.next(x) == NEVER;
        let replaced = [c, a, b].into_iter().find(|x| dies(self, *x));
        let replaced = replaced.or_else(|| [c, a, b].into_iter().find(|x| !self.is_in_register(*x))).unwrap_or(c);
        // What else is read; with equal factors the other one is the same.
        let (form, second, third) = if replaced == c {
            let (x, y) = if self.is_in_register(a) || !self.is_in_register(b) && !self.prefers_memory(a, b) {
                (a, b)
            } else {
                (b, a)
            };
            (Form::F231, x, y)
        } else {
            let factor = if replaced == a { b } else { a };
            if self.is_in_register(c) && !self.is_in_register(factor) {
                (Form::F132, c, factor)
            } else {
                (Form::F213, factor, c)
            }
        };
        let own = dies(self, replaced);
        // A copy that is read from memory is of no use to an operand that is the same value: it wants a register.
        if !own && (second == replaced || third == replaced) {
            self.in_register(replaced);
        }
        let second = self.in_register(second);
        let third = self.source(third);
        let to = if own { self.replace(replaced, id) } else { self.copy_of(replaced, id) };
        self.emit(Instruction::Fused { op, form, to, second, third });
    }

    /// Gives the operand's register to the result.
    fn replace(&mut self, operand: Id, id: Id) -> u8 {
        let register = self.register[operand as usize];
        self.vacate(operand);
        self.place_in(id, register);
        register
    }

    /// A register for the result that already holds the operand.
    fn copy_of(&mut self, operand: Id, id: Id) -> u8 {
        let to = self.take(Class::Vector);
        if self.is_in_register(operand) {
            let from = self.register[operand as usize];
            self.emit(Instruction::Move { to, from });
        } else {
            let from = self.place(operand);
            self.emit(Instruction::Load { class: Class::Vector, to, from });
        }
        self.place_in(id, to);
        to
    }
}
