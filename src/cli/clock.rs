//! The processor's clock, measured.

use std::hint::black_box;
use std::time::Instant;

/// Cycles from a multiplication of 64-bit integers to one that needs its result: so on Intel's processors since 2008, on
/// AMD's since Zen, and on most of Arm's.
const LATENCY: f64 = 3.0;
/// Multiplications of a sample: some 20 µs, rarely interrupted.
const CHAIN: usize = 20_000;
/// Samples, of which the fastest counts: interruptions only slow them down.
const SAMPLES: usize = 50;

/// Cycles per second of the core that this thread runs on, at present: timed by a chain of multiplications each of which
/// waits for the one before. A chain leaves the core's units to whoever shares them, so that neighbours do not slow it down.
pub fn hertz() -> f64 {
    let samples = (0..SAMPLES).map(|_| {
        let start = Instant::now();
        let mut x = black_box(3_u64);
        for _ in 0..CHAIN {
            x = x.wrapping_mul(x);
        }
        black_box(x);
        start.elapsed().as_secs_f64()
    });
    LATENCY * CHAIN as f64 / samples.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    #[test]
    fn clocks_are_of_this_age() {
        let hertz = super::hertz();
        assert!((1e7..2e10).contains(&hertz), "{hertz}");
    }
}
