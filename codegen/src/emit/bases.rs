//! General registers for the addresses of fields, by farthest next use.

use iced_x86::Register;
use rustc_hash::FxHashMap;

/// Registers that hold addresses: first those that the caller does not expect to find unchanged.
pub(super) const POOL: [Register; 9] = [
    Register::R9,
    Register::R10,
    Register::R11,
    Register::RBX,
    Register::RBP,
    Register::R12,
    Register::R13,
    Register::R14,
    Register::R15,
];

/// How many of the pool need not be preserved.
pub(super) const VOLATILE: usize = 3;

/// A stretch of a field, or of the slots, that short displacements from one address reach: field, number of the stretch.
pub(super) type Stretch = (u32, u32);

/// Which address is in which register.
pub(super) struct Bases {
    /// For every access, in order, the next access to the same stretch.
    next: Vec<u32>,
    /// Number of accesses so far.
    now: usize,
    /// For every register, the stretch and the next access to it.
    held: Vec<Option<(Stretch, u32)>>,
}

impl Bases {
    pub fn new(accesses: &[Stretch]) -> Self {
        let mut next = vec![u32::MAX; accesses.len()];
        let mut later = FxHashMap::default();
        for (i, stretch) in accesses.iter().enumerate().rev() {
            next[i] = later.insert(*stretch, i as u32).unwrap_or(u32::MAX);
        }
        // Preserving a register takes two instructions: no more of them than there are addresses.
        Bases { next, now: 0, held: vec![None; later.len().min(POOL.len())] }
    }

    /// The registers to be preserved.
    pub fn preserved(&self) -> &'static [Register] {
        &POOL[VOLATILE.min(self.held.len())..self.held.len()]
    }

    /// Register for the next access, which is to `stretch`, and whether the address must be loaded into it first.
    pub fn access(&mut self, stretch: Stretch) -> (Register, bool) {
        let next = self.next[self.now];
        self.now += 1;
        let found = self.held.iter().position(|held| held.is_some_and(|(s, _)| s == stretch));
        let register = found.unwrap_or_else(|| self.farthest());
        self.held[register] = Some((stretch, next));
        (POOL[register], found.is_none())
    }

    fn farthest(&self) -> usize {
        let key = |register: &usize| self.held[*register].map_or(u64::MAX, |(_, next)| u64::from(next));
        (0..self.held.len()).max_by_key(key).unwrap_or_default()
    }
}
