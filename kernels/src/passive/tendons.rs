//! Springs and dampers along tendons.

use super::plastic::tendon_rest;
use super::stiffness;
use crate::lane::Lane;
use crate::model::{Features, Instance, Tendon};
use crate::tendon::{self, Tendons};

/// Adds their forces.
pub(super) fn add<L: Lane>(model: Instance<'_, L>, (tendons, plastic): (&Tendons<L>, &[L]), force: &mut [L]) {
    let Features { springs, dampers, .. } = model.features;
    let acts = |tendon: &Tendon<L::Real>| springs && tendon.spring || dampers && tendon.damped;
    for t in (0..model.tendons.len()).filter(|t| acts(&model.tendons[*t])) {
        tendon::pull(&model, t, &tendons.jacobian, -tension(model, tendons, t, plastic), force);
    }
}

/// Tension of a tendon's spring and damper; `plastic` is where springs rest that yield.
#[inline(always)]
pub fn tension<L: Lane>(model: Instance<'_, L>, tendons: &Tendons<L>, t: usize, plastic: &[L]) -> L {
    let Features { springs, dampers, .. } = model.features;
    let (tendon, rate) = (&model.tendons[t], tendons.velocity[t]);
    let mut tension = L::zero();
    if springs && tendon.spring {
        let x = stretched(model, t, tendons.length[t], plastic);
        tension = stiffness(&model.tendon_stiffness(t), x) * x;
    }
    if dampers && tendon.damped {
        let [a, b, c] = model.tendon_damping(t);
        let speed = rate.abs();
        let hold = if tendon.damping_linear { a } else { speed.mul_add(speed.mul_add(c, b), a) };
        tension = hold.mul_add(rate, tension);
    }
    tension
}

/// How far a tendon's spring is from where it rests: longer, or shorter.
#[inline(always)]
fn stretched<L: Lane>(model: Instance<'_, L>, t: usize, length: L, plastic: &[L]) -> L {
    let [low, high] = tendon_rest(&model, t, plastic);
    let zero = L::zero();
    L::select(length.gt(high), length - high, L::select(length.lt(low), length - low, zero))
}

/// Derivative of a tendon's damper force by the rate of its length, a + 2 b|v| + 3 c v².
#[inline(always)]
pub fn tendon_damper_slope<L: Lane>(model: Instance<'_, L>, tendon: usize, rate: L) -> L {
    let [a, b, c] = model.tendon_damping(tendon);
    if model.tendons[tendon].damping_linear {
        return a;
    }
    let speed = rate.abs();
    speed.mul_add(speed.mul_add(L::of(3.0) * c, b + b), a)
}

/// Derivative of a tendon's spring force by its length, a + 2 b x + 3 c x²; 0 where it rests.
#[inline(always)]
pub fn tendon_spring_slope<L: Lane>(model: Instance<'_, L>, tendon: usize, length: L, plastic: &[L]) -> L {
    let [a, b, c] = model.tendon_stiffness(tendon);
    let x = stretched(model, tendon, length, plastic);
    let slope = x.mul_add(x.mul_add(L::of(3.0) * c, b + b), a);
    L::select(x.eq(L::zero()), L::zero(), slope)
}

/// ½ a x² + b x³/3 + c x⁴/4 of a tendon's spring.
#[inline(always)]
pub fn tendon_spring_energy<L: Lane>(model: Instance<'_, L>, tendon: usize, length: L, plastic: &[L]) -> L {
    let [a, b, c] = model.tendon_stiffness(tendon);
    let x = stretched(model, tendon, length, plastic);
    x.mul_add(x.mul_add(c * L::of(0.25), b * L::of(1.0 / 3.0)), a * L::of(0.5)) * x * x
}
