//! The position of a joint, or the length of a tendon, as a polynomial of another's.

use super::{Held, Rates};
use crate::lane::Lane;
use crate::math::vec3::zero;
use crate::model::{Equality, NONE};

/// What r gains with x; nothing without it.
#[inline(always)]
pub fn slope<L: Lane>(equality: &Equality<L::Real>, x: u32, at: &[L]) -> L {
    if x == NONE {
        return -L::zero();
    }
    let [_, a1, a2, a3, a4] = equality.polynomial.map(L::splat);
    let x = at[x as usize] - L::splat(equality.reference[1]);
    let [two, three, four] = [2.0, 3.0, 4.0].map(L::of);
    -x.mul_add(x.mul_add(x.mul_add(four * a4, three * a3), two * a2), a1)
}

/// r = y - y₀ - Σ aₖ (x - x₀)ᵏ of the numbers `which` of `at`, y and x; without x, r = y - y₀ - a₀.
#[inline(always)]
pub(super) fn held<L: Lane>(equality: &Equality<L::Real>, [y, x]: [u32; 2], at: &[L]) -> Held<L> {
    let [y0, x0] = equality.reference.map(L::splat);
    let [a0, a1, a2, a3, a4] = equality.polynomial.map(L::splat);
    let mut off = at[y as usize] - y0 - a0;
    if x != NONE {
        let x = at[x as usize] - x0;
        off -= x * x.mul_add(x.mul_add(x.mul_add(a4, a3), a2), a1);
    }
    let mut pos = zero();
    pos[0] = off;
    Held { pos, drift: zero(), rates: Rates::Lengths([L::one(), slope(equality, x, at)]) }
}
