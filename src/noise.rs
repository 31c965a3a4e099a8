//! Control noise from counters: the number for (seed, world, step, actuator) is the same whatever the threads, blocks or
//! order.

/// The numbers of a step of a world: what their hashes have in common is computed once.
#[derive(Clone, Copy, Debug)]
pub struct Draws(u64);

impl Draws {
    /// Those for the counters.
    #[inline(always)]
    pub fn new(seed: u64, world: u64, step: u64) -> Self {
        let seed = mix(seed ^ 0x6c61_6e65_7369_6d00);
        Draws([world, step].into_iter().fold(seed, join))
    }

    /// A uniform number in [0, 1).
    #[inline(always)]
    pub fn uniform(self, index: u64) -> f64 {
        // Signed, as processors convert such numbers at once; the top bit is clear.
        (join(self.0, index) >> 11) as i64 as f64 / (1_u64 << 53) as f64
    }
}

/// A uniform number in [0, 1) for the counters.
pub fn uniform(seed: u64, world: u64, step: u64, index: u64) -> f64 {
    Draws::new(seed, world, step).uniform(index)
}

/// A standard normal number for the counters (Box and Muller).
pub fn normal(seed: u64, world: u64, step: u64, index: u64) -> f64 {
    let u = 1.0 - uniform(seed, world, step, 2 * index);
    let v = uniform(seed, world, step, 2 * index + 1);
    (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}

/// A hash with another counter.
#[inline(always)]
fn join(hash: u64, counter: u64) -> u64 {
    mix(hash ^ counter.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// The finaliser of splitmix64 (Steele, Lea, Flood, Fast splittable pseudorandom number generators, 2014).
#[inline(always)]
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_numbers_have_the_moments_of_a_uniform_distribution() {
        let n = 100_000;
        let numbers: Vec<f64> = (0..n).map(|i| uniform(1, i % 10, i / 10, 3)).collect();
        let mean = numbers.iter().sum::<f64>() / n as f64;
        let variance = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 0.005, "mean {mean}");
        assert!((variance - 1.0 / 12.0).abs() < 0.002, "variance {variance}");
        assert!(numbers.iter().all(|x| (0.0..1.0).contains(x)));
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let n = 100_000;
        let numbers: Vec<f64> = (0..n).map(|i| normal(7, i, 0, 0)).collect();
        let mean = numbers.iter().sum::<f64>() / n as f64;
        let variance = numbers.iter().map(|x| x * x).sum::<f64>() / n as f64;
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.03, "mean {mean}, variance {variance}");
    }

    #[test]
    fn numbers_stay_as_they_are() {
        let numbers = [uniform(0, 0, 0, 0), uniform(1, 2, 3, 4), uniform(u64::MAX, 4095, 99, 20)];
        assert_eq!(numbers, [0.9627437235354949, 0.3379901544580879, 0.5959848437660967]);
    }

    #[test]
    fn every_counter_matters() {
        let base = uniform(1, 2, 3, 4);
        for other in [uniform(2, 2, 3, 4), uniform(1, 3, 3, 4), uniform(1, 2, 4, 4), uniform(1, 2, 3, 5)] {
            assert_ne!(base, other);
        }
    }
}
