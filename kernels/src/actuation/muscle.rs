//! Muscles: force by length and velocity, and how their activation follows a control by MuJoCo's laws.

use crate::lane::Lane;
use crate::math::vec3::splat;
use crate::model::{Actuator, Muscle};

/// The muscle's own length and velocity.
#[inline(always)]
fn own<L: Lane>(muscle: &Muscle<L::Real>, length: L, velocity: L) -> (L, L) {
    let shift = length - L::splat(muscle.start);
    (shift.mul_add(L::splat(muscle.scale), L::splat(muscle.low)), velocity * L::splat(muscle.speed))
}

/// ½ x².
#[inline(always)]
fn arc<L: Lane>(x: L) -> L {
    x * x * L::of(0.5)
}

/// Active force by length, as a share of the peak, and its derivative: four arcs of parabolas.
#[inline(always)]
fn by_length<L: Lane>(muscle: &Muscle<L::Real>, length: L) -> (L, L) {
    let ([least, most], [low, high]): ([L; 2], [L; 2]) = (splat(&muscle.reach), splat(&muscle.knees));
    let arcs: [L; 4] = splat(&muscle.arcs);
    let one = L::one();
    let rise = (length - least) * arcs[0];
    let near = (one - length) * arcs[1];
    let past = (length - one) * arcs[2];
    let fall = (most - length) * arcs[3];
    let pick = |a, b, c, d| {
        let curve = L::select(length.le(high), c, d);
        let curve = L::select(length.le(one), b, curve);
        let curve = L::select(length.le(low), a, curve);
        L::select(length.ge(least) & length.le(most), curve, L::zero())
    };
    let value = pick(arc(rise), one - arc(near), one - arc(past), arc(fall));
    (value, pick(rise * arcs[0], near * arcs[1], -(past * arcs[2]), -(fall * arcs[3])))
}

/// Active force by velocity, as a share of that at rest, and its derivative.
#[inline(always)]
fn by_velocity<L: Lane>(muscle: &Muscle<L::Real>, velocity: L) -> (L, L) {
    let (one, fvmax) = (L::one(), L::splat(muscle.fvmax));
    let excess = fvmax - one;
    let inverse = one / excess.max(L::of(1e-15));
    let (shortening, left) = (velocity + one, excess - velocity);
    let (still, slow, quick) = (velocity.le(-one), velocity.le(L::zero()), velocity.le(excess));
    let pick = |a, b, c| L::select(still, L::zero(), L::select(slow, a, L::select(quick, b, c)));
    let value = pick(shortening * shortening, (left * left).neg_mul_add(inverse, fvmax), fvmax);
    let slope = pick(shortening + shortening, (left + left) * inverse, L::zero());
    (value, slope)
}

/// Gain, and what it gains with the actuator's length and velocity.
#[inline(always)]
pub(super) fn gain<L: Lane>(muscle: &Muscle<L::Real>, length: L, velocity: L) -> (L, [L; 2]) {
    let (length, velocity) = own(muscle, length, velocity);
    let ((pull, rise), (share, slope)) = (by_length(muscle, length), by_velocity(muscle, velocity));
    let peak = -L::splat(muscle.force);
    let by_velocity = peak * pull * slope * L::splat(muscle.speed);
    (peak * pull * share, [peak * rise * share * L::splat(muscle.scale), by_velocity])
}

/// Passive force, and what it gains with the actuator's length: a parabola from 1 on, and a line beyond the knee.
#[inline(always)]
pub(super) fn bias<L: Lane>(muscle: &Muscle<L::Real>, length: L) -> (L, L) {
    let (length, _) = own(muscle, length, L::zero());
    let (one, knee, inverse) = (L::one(), L::splat(muscle.knees[1]), L::splat(muscle.arcs[2]));
    let stretch = (length - one) * inverse;
    let line = (length - knee).mul_add(inverse, L::of(0.5));
    let pick = |bend, line| L::select(length.le(one), L::zero(), L::select(length.le(knee), bend, line));
    let peak = -(L::splat(muscle.force) * L::splat(muscle.fpmax));
    (peak * pick(arc(stretch), line), peak * pick(stretch * inverse, inverse) * L::splat(muscle.scale))
}

/// Rate of activation `w` at a control `u`.
#[inline(always)]
pub(super) fn rate<L: Lane>((actuator, [tense, relax, sharpness]): (&Actuator<L::Real>, [L; 3]), u: L, w: L) -> L {
    let (zero, one) = (L::zero(), L::one());
    let slowness = w.clamp(zero, one).mul_add(L::of(1.5), L::of(0.5));
    let (tense, relax) = (tense * slowness, relax / slowness);
    let gap = u.clamp(zero, one) - w;
    let time = if actuator.smooth {
        // 6 x⁵ - 15 x⁴ + 10 x³
        let x = gap.mul_add(sharpness, L::of(0.5)).clamp(zero, one);
        let blend = x * x * x * x.mul_add(x.mul_add(L::of(6.0), L::of(-15.0)), L::of(10.0));
        (tense - relax).mul_add(blend, relax)
    } else {
        L::select(gap.gt(zero), tense, relax)
    };
    gap / time.max(L::of(1e-15))
}
