//! What the tests share.
#![allow(dead_code)]

use lanesim_codegen::InstructionSet;
use lanesim_kernels::lane::{LaneQuery, Real};

/// The instruction sets of this machine.
pub fn instruction_sets() -> Vec<InstructionSet> {
    [InstructionSet::Avx512, InstructionSet::Avx2].into_iter().filter(|isa| isa.check().is_ok()).collect()
}

/// A small generator of random numbers (SplitMix64).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }
}

/// Whether two numbers have the same bits, taking zeros of both signs as one, and all NaN as one.
pub fn same<T: Real>(a: T, b: T) -> bool {
    a.bits() == b.bits() || a == b || a.to_f64().is_nan() && b.to_f64().is_nan()
}

/// Asserts that all lanes are the same.
#[track_caller]
pub fn assert_same<L: LaneQuery>(what: &str, got: &[L], expected: &[L]) {
    assert_eq!(got.len(), expected.len());
    for (i, (a, b)) in got.iter().zip(expected).enumerate() {
        for lane in 0..L::WIDTH {
            let (a, b) = (a.get(lane), b.get(lane));
            assert!(same(a, b), "{what}[{i}] lane {lane} is {a:?} instead of {b:?}");
        }
    }
}
