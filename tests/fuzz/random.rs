//! Random choices from a seed and a number: an execution is the same wherever it runs.

/// A stream of numbers (splitmix64).
pub struct Random(u64);

impl Random {
    /// The stream of execution `index` of a run with `seed`.
    pub fn new(seed: u64, index: u64) -> Random {
        let mut random = Random(seed ^ index.wrapping_mul(0xd134_2543_de82_ef95));
        random.0 = random.next();
        random
    }

    /// 64 bits.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
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
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A finite number, now and then one at the end of what there is.
    pub fn finite(&mut self) -> f64 {
        const ENDS: [f64; 14] =
            [0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, -1e-160, 1e10, 1e16, -1e30, 1e160, 1e300, f64::MAX, f64::MIN];
        if self.one_in(4) { *self.pick(&ENDS) } else { 4.0 * self.unit() - 2.0 }
    }
}
