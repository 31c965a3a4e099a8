//! Orders of operations by their latencies.
//!
//! What the end waits for longest comes first, so that chains are interleaved, and no more is begun than registers hold. In
//! large fragments an operation overtakes but so many others of an order that is good for registers.

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
        Op::Select | Op::MaskAnd | Op::MaskOr | Op::MaskDiffer | Op::MaskSame | Op::MaskNot | Op::Copy => 1,
        _ => 4,
    }
}

/// How far an order by latency goes.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    /// Operations that are looked at, from the first one that has not begun.
    pub ahead: usize,
    /// Values alive at once, about.
    pub alive: usize,
}

impl Lowered {
    /// The operations, which are given in an order that would do, by latency.
    pub fn by_latency(&self, base: &[Id], limits: Limits) -> Vec<Id> {
        let mut plan = Plan::new(self, base, limits);
        let mut order = Vec::with_capacity(base.len());
        let (mut cycle, mut begun) = (0, 0);
        while let Some(place) = plan.choose(cycle) {
            let Ready { rank, when } = plan.ready.swap_remove(place);
            if when > cycle {
                (cycle, begun) = (when, 0);
            }
            order.push(base[rank]);
            plan.begin(rank, cycle);
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
    /// Its place in the given order.
    rank: usize,
    when: u32,
}

/// Operations begun and to begin; the lists are by value.
struct Plan<'a> {
    base: &'a [Id],
    limits: Limits,
    /// Places in the given order.
    ranks: Vec<usize>,
    /// By rank: whether it has begun.
    begun: Vec<bool>,
    /// Rank of the first that has not.
    oldest: usize,
    /// By rank: from when on those beyond the limit could begin.
    later: Vec<Option<u32>>,
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

impl<'a> Plan<'a> {
    fn new(lowered: &Lowered, base: &'a [Id], limits: Limits) -> Self {
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
        let mut ranks = vec![usize::MAX; nodes.len()];
        base.iter().enumerate().for_each(|(rank, id)| ranks[*id as usize] = rank);
        let free = |id: &Id| operands[*id as usize].is_empty().then_some(0);
        let mut plan = Plan {
            base,
            limits,
            ranks,
            begun: vec![false; base.len()],
            oldest: 0,
            later: base.iter().map(free).collect(),
            ready: vec![],
            missing: operands.iter().map(Vec::len).collect(),
            uses: users.iter().map(Vec::len).collect(),
            done: vec![0; nodes.len()],
            live: 0,
            latency,
            operands,
            users,
            heights,
        };
        plan.look_at(0);
        plan
    }

    /// Rank of the first operation that is too far ahead.
    fn reach(&self) -> usize {
        self.oldest.saturating_add(self.limits.ahead).min(self.base.len())
    }

    /// Adds what has come into reach, from the given rank on.
    fn look_at(&mut self, first: usize) {
        for rank in first..self.reach() {
            self.ready.extend(self.later[rank].take().map(|when| Ready { rank, when }));
        }
    }

    /// The next to begin, as a place in the list: the highest of those that need not wait; when enough is alive, one that
    /// frees registers.
    fn choose(&self, cycle: u32) -> Option<usize> {
        let full = self.live >= self.limits.alive;
        let key = |place: &usize| {
            let Ready { rank, when } = self.ready[*place];
            let id = self.base[rank];
            let freed = if full { self.freed(id) } else { 0 };
            (freed, Reverse(when.max(cycle)), self.heights[id as usize], Reverse(rank))
        };
        (0..self.ready.len()).max_by_key(key)
    }

    /// Registers that the operation gives back.
    fn freed(&self, id: Id) -> usize {
        self.operands[id as usize].iter().filter(|x| self.uses[**x as usize] == 1).count()
    }

    fn begin(&mut self, rank: usize, cycle: u32) {
        let id = self.base[rank];
        let i = id as usize;
        self.live = self.live + usize::from(self.uses[i] > 0) - self.freed(id);
        for x in &self.operands[i] {
            self.uses[*x as usize] -= 1;
        }
        self.done[i] = cycle + self.latency[i];
        for user in std::mem::take(&mut self.users[i]) {
            self.missing[user as usize] -= 1;
            if self.missing[user as usize] == 0 {
                self.offer(user);
            }
        }
        let reach = self.reach();
        self.begun[rank] = true;
        self.oldest += self.begun[self.oldest..].iter().take_while(|begun| **begun).count();
        self.look_at(reach);
    }

    /// Notes that all operands of the operation have begun.
    fn offer(&mut self, id: Id) {
        let when = self.operands[id as usize].iter().map(|x| self.done[*x as usize]).max().unwrap_or(0);
        let rank = self.ranks[id as usize];
        if rank < self.reach() {
            self.ready.push(Ready { rank, when });
        } else {
            self.later[rank] = Some(when);
        }
    }
}
