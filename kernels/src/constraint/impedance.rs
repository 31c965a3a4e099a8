//! Impedance of a row as a function of its violation.

use crate::lane::{Lane, powf};
use crate::model::Impedance;

/// d(|r|), in [dmin, dmax].
#[inline(always)]
pub fn impedance<L: Lane>(model: &Impedance<L::Real>, r: L) -> L {
    let (dmin, dmax) = (L::splat(model.dmin), L::splat(model.dmax));
    if model.flat {
        return (dmin + dmax) * L::of(0.5);
    }
    let one = L::one();
    let x = r.abs() * L::splat(model.inverse_width);
    let past = x.ge(one);
    let x = x.min(one);
    let y = match model.small_power {
        1 => x,
        2 => {
            let low = L::splat(model.low) * x * x;
            let high = (L::splat(model.high) * (one - x)).neg_mul_add(one - x, one);
            L::select(x.le(L::splat(model.midpoint)), low, high)
        }
        _ => {
            let power = L::splat(model.power);
            let low = L::splat(model.low) * powf(x, power);
            let high = L::splat(model.high).neg_mul_add(powf(one - x, power), one);
            L::select(x.le(L::splat(model.midpoint)), low, high)
        }
    };
    L::select(past, dmax, y.mul_add(dmax - dmin, dmin))
}
