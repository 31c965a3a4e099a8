//! How long work takes, so that small jobs wake nobody.

use lanesim_kernels::model::Sizes;

use crate::plan::Plan;

/// Nanoseconds of work for which a thread is worth waking: some times what that costs.
const WORTH: f64 = 50_000.0;

/// How many threads should help with `blocks` blocks that take `pace` nanoseconds each.
pub(crate) fn helpers(pace: f64, blocks: usize) -> usize {
    let worth = pace * blocks as f64 / WORTH;
    (worth as usize).min(blocks).saturating_sub(1)
}

/// Nanoseconds that something takes: guessed, then measured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace(f64);

impl Pace {
    /// The figure.
    pub fn get(self) -> f64 {
        self.0
    }

    /// Takes a measurement over. Other work on the machine makes it longer and nothing makes it shorter, so that shorter ones
    /// count at once.
    pub fn note(&mut self, measured: f64) {
        self.0 = measured.min(self.0 + 0.25 * (measured - self.0).max(0.0));
    }
}

/// What work on a block takes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Paces {
    /// A step.
    pub step: Pace,
    /// Outputs that have to be computed.
    derived: Pace,
    /// Outputs that are there.
    plain: Pace,
    /// Setting fields.
    pub copy: Pace,
}

impl Paces {
    /// Guesses for a model.
    pub fn new(sizes: &Sizes) -> Self {
        let operations = 500 * sizes.nlink + 10 * sizes.nm + 20 * sizes.npair;
        let numbers = sizes.nq + 2 * sizes.nv + sizes.na + sizes.nu;
        let [work, copy] = [operations, 10 * numbers].map(|n| Pace(n as f64));
        Paces { step: work, derived: work, plain: copy, copy }
    }

    /// That of reading what `plan` says.
    pub fn read(&mut self, plan: &Plan) -> &mut Pace {
        if plan.derived { &mut self.derived } else { &mut self.plain }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_shared_where_it_pays() {
        // 2 blocks of 6.5 µs; one block however long; many.
        assert_eq!(helpers(6_500.0, 2), 0);
        assert_eq!(helpers(1e9, 1), 0);
        assert_eq!(helpers(1e9, 3), 2);
        assert_eq!(helpers(1_000.0, 150), 2);
        assert_eq!(helpers(1e9, 0), 0);
    }

    #[test]
    fn one_slow_call_does_not_count_for_long() {
        let mut pace = Pace(100.0);
        pace.note(10.0);
        assert_eq!(pace.get(), 10.0);
        pace.note(4_000_000.0);
        pace.note(12.0);
        assert_eq!(pace.get(), 12.0);
    }
}
