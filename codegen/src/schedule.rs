//! Orders of a fragment's operations, and where its stores go.
//!
//! What matters most is the number of values alive at once. Two orders are good at that in different programs: as recorded,
//! and every output's operands right before it. A processor of today looks hundreds of instructions ahead, but it holds
//! fewer that wait for operands: where chains are long, it sees no other. So both orders let operations that the end waits
//! for [overtake](crate::latency) some others. In small programs a third one, by latency alone, is quicker.
//! [`crate::allocate`] tries them.

use rustc_hash::FxHashMap;

use crate::graph::{Id, Op};
use crate::isa::InstructionSet;
use crate::latency::Limits;
use crate::lower::{Lowered, MaskOutput};
use crate::recording::FieldStore;

/// An order of operations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// As recorded, a few operations overtaking others.
    Recorded,
    /// Depth first from the outputs, in the order in which they were recorded, a few operations overtaking others.
    DepthFirst,
    /// By latency, with chains interleaved.
    Latency,
}

/// A step of a fragment.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Item {
    /// Compute the value.
    Compute(Id),
    /// Store a value.
    Store(FieldStore),
    /// Return a mask as the bits of word `index`.
    StoreMask { value: Id, index: u32 },
}

impl Lowered {
    /// The steps in the given order.
    ///
    /// Stores follow the computation of their values at once. A slot whose input is used as well is stored after the last
    /// use of that input, so that inputs are never read after they were overwritten. In `looped` code nothing need overtake: a
    /// processor sees the next round.
    pub fn schedule(&self, order: Order, isa: InstructionSet, looped: bool) -> Vec<Item> {
        let registers = usize::from(isa.vector_registers());
        // By latency alone, half of the registers is a good number: inputs and constants want some, and what is alive at once
        // sinks slowly where nothing is freed.
        let (ahead, alive) = (if looped { 1 } else { registers * 3 / 4 }, registers * 3 / 4);
        let (base, limits) = match order {
            Order::Recorded => (self.recorded(), Limits { ahead, alive }),
            Order::DepthFirst => (self.depth_first(), Limits { ahead, alive }),
            Order::Latency => (self.recorded(), Limits { ahead: usize::MAX, alive: registers / 2 }),
        };
        self.place_stores(&self.by_latency(&base, limits))
    }

    /// Stores whose value is an input that is overwritten get a copy of it as value: else a permutation of inputs would
    /// have stores wait for each other.
    pub fn detach_moved_inputs(&mut self) {
        let overwritten = self.overwritten();
        if overwritten.is_empty() {
            return;
        }
        let mut copies = FxHashMap::default();
        for i in 0..self.stores.len() {
            let value = self.stores[i].value;
            if overwritten.contains_key(&value) {
                self.stores[i].value = *copies.entry(value).or_insert_with(|| {
                    self.nodes.push(crate::graph::Node { op: Op::Copy, args: [value, 0, 0] });
                    self.nodes.len() as Id - 1
                });
            }
        }
    }

    /// The inputs that are overwritten, each with the store that does so.
    fn overwritten(&self) -> FxHashMap<Id, usize> {
        let stored: FxHashMap<(u32, u32), usize> =
            self.stores.iter().enumerate().map(|(i, s)| ((s.field, s.lane), i)).collect();
        let inputs = self.nodes.iter().enumerate().filter(|(_, node)| node.op == Op::Input);
        inputs.filter_map(|(id, node)| Some((id as Id, *stored.get(&(node.args[0], node.args[1]))?))).collect()
    }

    fn roots(&self) -> Vec<Id> {
        let masks = self.masks_out.iter().filter_map(|mask| match mask {
            MaskOutput::Value(id) => Some(*id),
            MaskOutput::Known(_) => None,
        });
        let mut roots: Vec<Id> = self.stores.iter().map(|s| s.value).chain(masks).collect();
        roots.sort_unstable();
        roots.dedup();
        roots
    }

    fn recorded(&self) -> Vec<Id> {
        (0..self.nodes.len() as Id).filter(|id| !self.nodes[*id as usize].op.is_leaf()).collect()
    }

    fn depth_first(&self) -> Vec<Id> {
        let mut heights = vec![0_u32; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate() {
            let below = node.operands().iter().map(|x| heights[*x as usize]).max();
            heights[i] = below.map_or(0, |h| h + 1);
        }
        let mut done: Vec<bool> = self.nodes.iter().map(|node| node.op.is_leaf()).collect();
        let mut order = vec![];
        let mut stack = vec![];
        for root in self.roots() {
            stack.push((root, false));
            while let Some((id, operands_done)) = stack.pop() {
                if done[id as usize] {
                    continue;
                }
                if operands_done {
                    done[id as usize] = true;
                    order.push(id);
                    continue;
                }
                stack.push((id, true));
                // The highest operand first: it needs the most registers while it is computed.
                let mut operands: [Id; 3] = self.nodes[id as usize].args;
                let operands = &mut operands[..self.nodes[id as usize].op.arity()];
                operands.sort_by_key(|x| heights[*x as usize]);
                stack.extend(operands.iter().map(|x| (*x, false)));
            }
        }
        order
    }

    /// Inserts the stores.
    fn place_stores(&self, computed: &[Id]) -> Vec<Item> {
        const NOWHERE: u32 = u32::MAX;
        let mut position = vec![NOWHERE; self.nodes.len()];
        let mut last_use = vec![NOWHERE; self.nodes.len()];
        for (at, id) in computed.iter().enumerate() {
            position[*id as usize] = at as u32;
            self.nodes[*id as usize].operands().iter().for_each(|x| last_use[*x as usize] = at as u32);
        }
        let mut after: Vec<u32> = self.stores.iter().map(|s| position[s.value as usize]).collect();
        for (input, store) in self.overwritten() {
            let used = last_use[input as usize];
            if used != NOWHERE && after[store] != NOWHERE {
                after[store] = after[store].max(used);
            } else if used != NOWHERE {
                after[store] = used;
            }
        }
        // Constants and inputs are stored at the end, equal ones together.
        let mut pending: Vec<(u32, Item)> =
            self.stores.iter().zip(after).map(|(s, at)| (at, Item::Store(*s))).collect();
        for (index, mask) in self.masks_out.iter().enumerate() {
            if let MaskOutput::Value(value) = *mask {
                pending.push((position[value as usize], Item::StoreMask { value, index: index as u32 }));
            }
        }
        pending.sort_by_key(|(at, item)| match item {
            Item::Store(store) if *at == NOWHERE => (*at, store.value),
            _ => (*at, 0),
        });
        let mut items = Vec::with_capacity(computed.len() + pending.len());
        let mut pending = pending.into_iter().peekable();
        for (at, id) in computed.iter().enumerate() {
            items.push(Item::Compute(*id));
            while let Some((_, item)) = pending.next_if(|(after, _)| *after == at as u32) {
                items.push(item);
            }
        }
        items.extend(pending.map(|(_, item)| item));
        items
    }
}
