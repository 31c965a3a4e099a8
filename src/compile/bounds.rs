//! Ranges with infinite ends, for the tables: kernels see finite numbers that never act.

/// Beyond every position of a world that is not lost.
const FAR: f64 = 1e11;
/// Beyond every force and control that is finite in single precision.
const HUGE: f64 = f32::MAX as f64;

/// Whether a range has no end that bounds anything.
pub(super) fn are_none(range: [f64; 2]) -> bool {
    range.iter().all(|x| !x.is_finite())
}

/// The range of a joint.
pub(super) fn of_limit(range: [f64; 2]) -> [f64; 2] {
    within(range, FAR)
}

/// The range of a force or control. An end that is not a number bounds nothing either.
pub(crate) fn of_clamp(range: [f64; 2]) -> [f64; 2] {
    within(range, HUGE)
}

fn within([lo, hi]: [f64; 2], most: f64) -> [f64; 2] {
    // The larger and the smaller of a number and NaN is the number.
    [lo.max(-most), hi.min(most)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn infinite_ends() {
        assert_eq!(of_limit([f64::NEG_INFINITY, 1.0]), [-1e11, 1.0]);
        assert_eq!(of_clamp([0.0, f64::INFINITY]), [0.0, f64::from(f32::MAX)]);
        assert_eq!(of_clamp([-1.0, 1.0]), [-1.0, 1.0]);
        assert!(of_clamp([f64::NEG_INFINITY, f64::NAN]).iter().all(|x| (*x as f32).is_finite()));
        assert!(are_none([f64::NEG_INFINITY, f64::INFINITY]) && !are_none([f64::NEG_INFINITY, 0.0]));
    }
}
