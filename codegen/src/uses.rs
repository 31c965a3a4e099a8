//! When values are used.

use crate::graph::{Id, Node};
use crate::schedule::Item;

/// After the end.
pub(crate) const NEVER: u32 = u32::MAX;

/// For every value, the steps that use it.
pub(crate) struct Uses {
    /// Steps of all values, one after the other.
    steps: Vec<u32>,
    /// For every value, where its next use is in `steps`, and where its uses end.
    ranges: Vec<(u32, u32)>,
}

impl Uses {
    pub fn new(nodes: &[Node], items: &[Item]) -> Self {
        let mut operands = [0; 3];
        let mut ranges = vec![(0, 0); nodes.len()];
        for item in items {
            let count = Self::operands(nodes, item, &mut operands);
            operands[..count].iter().for_each(|id| ranges[*id as usize].1 += 1);
        }
        let mut total = 0;
        for (start, end) in &mut ranges {
            let count = std::mem::replace(end, total);
            *start = total;
            total += count;
        }
        let mut steps = vec![0; total as usize];
        for (step, item) in items.iter().enumerate() {
            let count = Self::operands(nodes, item, &mut operands);
            for id in &operands[..count] {
                let end = &mut ranges[*id as usize].1;
                steps[*end as usize] = step as u32;
                *end += 1;
            }
        }
        Uses { steps, ranges }
    }

    /// Writes the different operands of a step, returns their number.
    pub fn operands(nodes: &[Node], item: &Item, out: &mut [Id; 3]) -> usize {
        let stored;
        let operands = match item {
            Item::Compute(id) => nodes[*id as usize].operands(),
            Item::Store(store) => {
                stored = [store.value];
                &stored
            }
            Item::StoreMask { value, .. } => {
                stored = [*value];
                &stored
            }
        };
        let mut count = 0;
        for id in operands {
            if !out[..count].contains(id) {
                out[count] = *id;
                count += 1;
            }
        }
        count
    }

    /// Moves on from the use at step `now`.
    pub fn pass(&mut self, id: Id, now: u32) {
        let (next, end) = &mut self.ranges[id as usize];
        if *next < *end && self.steps[*next as usize] == now {
            *next += 1;
        }
    }

    /// The next use of the value, or [`NEVER`].
    pub fn next(&self, id: Id) -> u32 {
        let (next, end) = self.ranges[id as usize];
        if next < end { self.steps[next as usize] } else { NEVER }
    }
}
