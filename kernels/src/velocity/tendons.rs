//! What the armature of tendons adds to the bias force: a Jᵀ J̇ v, J̇ v what a length's rate gains without an acceleration of the joints.

use super::Velocity;
use crate::lane::{Lane, Real};
use crate::math::spatial::{Spatial, lin, rot};
use crate::math::vec3::{Vec3, add, cross, cross_add, dot, sub, zero};
use crate::model::{Model, NONE, Stretch};
use crate::position::Position;
use crate::tendon::{self, Straight, Tendons};

/// Adds it to the bias force.
pub(super) fn resist<L: Lane>(
    model: &Model<L::Real>,
    position: &Position<L>,
    tendons: &Tendons<L>,
    gravity: &Vec3<L>,
    velocity: &mut Velocity<L>,
) {
    for (t, tendon) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.heavy && !tendon.fixed()) {
        let force = L::splat(tendon.armature) * stretching(model, t, position, gravity, velocity);
        tendon::pull(model, t, &tendons.jacobian, force, &mut velocity.qfrc_bias);
    }
}

/// J̇ v of a spatial tendon.
#[inline(always)]
pub fn stretching<L: Lane>(
    model: &Model<L::Real>,
    t: usize,
    position: &Position<L>,
    gravity: &Vec3<L>,
    velocity: &Velocity<L>,
) -> L {
    let mut drift = L::zero();
    for stretch in &model.stretches[model.tendons[t].stretches.range()] {
        let own = self::drift(model, stretch, position, gravity, velocity);
        drift = L::splat(stretch.share).mul_add(own, drift);
    }
    drift
}

/// What the rate of a straight piece's length gains by itself: what its ends are accelerated by along it, and what turning it does.
#[inline(always)]
fn drift<L: Lane>(
    model: &Model<L::Real>,
    stretch: &Stretch<L::Real>,
    position: &Position<L>,
    gravity: &Vec3<L>,
    velocity: &Velocity<L>,
) -> L {
    let Straight { points, unit, length } = tendon::straight(model, stretch, position);
    let still = [L::zero(), L::zero(), L::zero(), -gravity[0], -gravity[1], -gravity[2]];
    let of = |side: usize| {
        let (link, point) = (stretch.links[side], &points[side]);
        let [twist, change] = match link {
            NONE => [zero(), still],
            link => [velocity.cvel[link as usize], velocity.cacc[link as usize]],
        };
        let speed = at(&twist, point);
        (speed, add(&at(&change, point), &cross(&rot(&twist), &speed)))
    };
    let (first, second) = (of(0), of(1));
    let (speed, change) = (sub(&second.0, &first.0), sub(&second.1, &first.1));
    let along = dot(&speed, &unit);
    let short = length.lt(L::of(L::Real::MINVAL));
    let turning = along.neg_mul_add(along, dot(&speed, &speed)) / L::select(short, L::one(), length);
    dot(&change, &unit) + L::select(short, L::zero(), turning)
}

/// A motion at a point.
#[inline(always)]
fn at<L: Lane>(motion: &Spatial<L>, point: &Vec3<L>) -> Vec3<L> {
    cross_add(&rot(motion), point, &lin(motion))
}
