//! Impedance of a row as a function of its violation.

use crate::lane::{Lane, powf};
use crate::model::Impedance;

/// d(|r|), in [dmin, dmax].
#[inline(always)]
pub fn impedance<L: Lane>(model: &Impedance<L>, r: L) -> L {
    let (dmin, dmax) = (model.dmin, model.dmax);
    if model.flat {
        return (dmin + dmax) * L::of(0.5);
    }
    let one = L::one();
    let x = r.abs() * model.inverse_width;
    let past = x.ge(one);
    let x = x.min(one);
    let y = match model.small_power {
        1 => x,
        2 => {
            let low = model.low * x * x;
            let high = (model.high * (one - x)).neg_mul_add(one - x, one);
            L::select(x.le(model.midpoint), low, high)
        }
        _ => {
            let low = model.low * powf(x, model.power);
            let high = model.high.neg_mul_add(powf(one - x, model.power), one);
            L::select(x.le(model.midpoint), low, high)
        }
    };
    L::select(past, dmax, y.mul_add(dmax - dmin, dmin))
}
