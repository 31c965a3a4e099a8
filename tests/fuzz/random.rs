//! Random choices from a seed and a number: an execution is the same wherever it runs.

#[allow(dead_code)] // what other tests draw
#[path = "../support/random.rs"]
mod stream;

/// A stream of choices.
pub struct Random(stream::Random);

impl Random {
    /// The stream of execution `index` of a run with `seed`.
    pub fn new(seed: u64, index: u64) -> Random {
        let first = stream::Random(seed ^ index.wrapping_mul(0xd134_2543_de82_ef95)).bits();
        Random(stream::Random(first))
    }

    /// 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0.bits()
    }

    /// A number below `n`; 0 if `n` is.
    pub fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.next() % n as u64) as usize }
    }

    /// Whether something happens that happens once in `n` times.
    pub fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    /// One of several.
    pub fn pick<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0.uniform(0.0, 1.0)
    }

    /// A finite number, now and then one at the end of what there is.
    pub fn finite(&mut self) -> f64 {
        const ENDS: [f64; 14] =
            [0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, -1e-160, 1e10, 1e16, -1e30, 1e160, 1e300, f64::MAX, f64::MIN];
        if self.one_in(4) { *self.pick(&ENDS) } else { 4.0 * self.unit() - 2.0 }
    }
}
