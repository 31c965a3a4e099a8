//! Order of a small fragment's operations by their latencies.
//!
//! What the end waits for longest comes first, so that chains are interleaved, and no more is begun than registers hold.

use std::cmp::Reverse;

use crate::graph::{Id, Op};
use crate::lower::Lowered;

/// Operations on whole registers that a processor begins in a cycle.
const WIDTH: usize = 2;

/// Cycles until the result of an operation is there, about.
fn latency(op: Op) -> u32 {
    match op {
        Op::Div => 14,
        Op::Sqrt => 20,
        Op::BitAnd | Op::BitOr | Op::BitXor | Op::IntegerSub | Op::ShiftLeft | Op::ShiftRight => 1,
        Op::Select | Op::MaskAnd | Op::MaskOr | Op::MaskNot | Op::Copy => 1,
        _ => 4,
    }
}

impl Lowered {
    /// Operations by latency, with about so many values alive at once. Half of the registers is a good number: inputs and
    /// constants want some, and what is alive at once sinks slowly where nothing is freed.
    pub fn by_latency(&self, most: usize) -> Vec<Id> {
        let mut plan = Plan::new(self);
        let mut order = vec![];
        let (mut cycle, mut begun) = (0, 0);
        while let Some(place) = plan.choose(cycle, most) {
            let Ready { id, when } = plan.ready.swap_remove(place);
            if when > cycle {
                (cycle, begun) = (when, 0);
            }
            order.push(id);
            plan.begin(id, cycle);
            begun += 1;
            if begun == WIDTH {
                (cycle, begun) = (cycle + 1, 0);
            }
        }
        order
    }
}

/// An operation whose operands are known, from a cycle on.
struct Ready {
    id: Id,
    when: u32,
}

/// Operations begun and to begin; the lists are by value.
struct Plan {
    latency: Vec<u32>,
    /// Different operands that are computed.
    operands: Vec<Vec<Id>>,
    users: Vec<Vec<Id>>,
    /// Cycles from its beginning to the end of what waits for it longest.
    heights: Vec<u32>,
    /// Operands that are still missing.
    missing: Vec<usize>,
    /// Uses that are still to come.
    uses: Vec<usize>,
    /// The cycle from which on it is there.
    done: Vec<u32>,
    ready: Vec<Ready>,
    /// Values in registers.
    live: usize,
}

impl Plan {
    fn new(lowered: &Lowered) -> Self {
        let nodes = &lowered.nodes;
        let computed = |id: &Id| !nodes[*id as usize].op.is_leaf();
        let mut users = vec![vec![]; nodes.len()];
        let operands = nodes.iter().enumerate().map(|(i, node)| {
            let mut operands: Vec<Id> = node.operands().iter().copied().filter(computed).collect();
            operands.sort_unstable();
            operands.dedup();
            operands.iter().for_each(|x| users[*x as usize].push(i as Id));
            operands
        });
        let operands: Vec<Vec<Id>> = operands.collect();
        let latency: Vec<u32> = nodes.iter().map(|node| latency(node.op)).collect();
        let mut heights = latency.clone();
        for i in (0..nodes.len()).rev() {
            heights[i] += users[i].iter().map(|user| heights[*user as usize]).max().unwrap_or(0);
        }
        let ids = (0..nodes.len() as Id).filter(computed);
        let free = ids.filter(|id| operands[*id as usize].is_empty()).map(|id| Ready { id, when: 0 });
        Plan {
            ready: free.collect(),
            missing: operands.iter().map(Vec::len).collect(),
            uses: users.iter().map(Vec::len).collect(),
            done: vec![0; nodes.len()],
            live: 0,
            latency,
            operands,
            users,
            heights,
        }
    }

    /// The next to begin, as a place in the list: the highest of those that need not wait; when enough is alive, one that
    /// frees registers.
    fn choose(&self, cycle: u32, most: usize) -> Option<usize> {
        let full = self.live >= most;
        let key = |place: &usize| {
            let Ready { id, when } = self.ready[*place];
            let freed = if full { self.freed(id) } else { 0 };
            (freed, Reverse(when.max(cycle)), self.heights[id as usize], Reverse(id))
        };
        (0..self.ready.len()).max_by_key(key)
    }

    /// Registers that the operation gives back.
    fn freed(&self, id: Id) -> usize {
        self.operands[id as usize].iter().filter(|x| self.uses[**x as usize] == 1).count()
    }

    fn begin(&mut self, id: Id, cycle: u32) {
        let i = id as usize;
        self.live = self.live + usize::from(self.uses[i] > 0) - self.freed(id);
        for x in &self.operands[i] {
            self.uses[*x as usize] -= 1;
        }
        self.done[i] = cycle + self.latency[i];
        for user in std::mem::take(&mut self.users[i]) {
            let u = user as usize;
            self.missing[u] -= 1;
            if self.missing[u] == 0 {
                let when = self.operands[u].iter().map(|x| self.done[*x as usize]).max().unwrap_or(0);
                self.ready.push(Ready { id: user, when });
            }
        }
    }
}
