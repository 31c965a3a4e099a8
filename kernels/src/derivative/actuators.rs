//! What actuator forces gain with velocity, and with length.

use crate::actuation::{Actuation, servo_within, slopes};
use crate::lane::{Lane, Mask, Real};
use crate::math::vec3::splat;
use crate::model::{Dof, Instance, MomentDof, NONE};
use crate::options::Integrator;

/// What an actuator's force gains, and what it acts on.
pub(super) struct Gain<'a, L> {
    /// Its dofs.
    pub dofs: &'a [MomentDof],
    /// Its moments, dof by dof.
    pub moment: &'a [L],
    /// What the force gains with the actuator's length.
    pub length: L,
    /// With its velocity.
    pub velocity: L,
}

/// Subtracts h times the derivative from a matrix: the moments' products, times what force gains with the actuator's velocity.
pub fn add<L: Lane>(model: Instance<'_, L>, actuation: &Actuation<L>, h: L, matrix: &mut [L]) {
    gains(model, actuation, |Gain { dofs, moment, velocity, .. }| {
        let slope = h * velocity;
        products(model, dofs, |at, [i, j]| {
            let scaled = slope * moment[i];
            matrix[at] = scaled.neg_mul_add(moment[j], matrix[at]);
        });
    });
}

/// Calls `f` with the place in the matrix of every two of an actuator's dofs, and their numbers. As in MuJoCo, what joins branches is
/// left out, and what joins dofs of a simple body where the matrix is that of symmetric derivatives.
#[inline(always)]
pub(super) fn products<L: Lane>(model: Instance<'_, L>, dofs: &[MomentDof], mut f: impl FnMut(usize, [usize; 2])) {
    let unsymmetric = |dof: &Dof<L::Real>| match model.options.integrator {
        Integrator::ImplicitFast | Integrator::Discrete => dof.free_base != NONE,
        _ => true,
    };
    let apart = |dof: &Dof<L::Real>| dof.simple && !unsymmetric(dof);
    for (i, later) in dofs.iter().enumerate() {
        let row = later.dof as usize;
        for (j, earlier) in dofs[..=i].iter().enumerate() {
            let column = earlier.dof as usize;
            let above = || model.tree_pattern.row(row).iter().any(|run| run.range().contains(&column));
            if i == j || !apart(&model.dofs[row]) && above() {
                f(model.rows.at(row, column), [i, j]);
            }
        }
    }
}

/// Calls `f` for every actuator whose force gains anything. A force at a bound, its own or that of its joint, gains nothing. (Of a clamped
/// orientation servo, rounding decides whether MuJoCo sees it so.)
#[inline(always)]
pub(super) fn gains<L: Lane>(model: Instance<'_, L>, actuation: &Actuation<L>, mut f: impl FnMut(Gain<'_, L>)) {
    for (a, actuator) in model.actuators.iter().enumerate().filter(|(_, actuator)| actuator.follows()) {
        let [length, velocity] = slopes(model, a, actuation);
        let mut free = L::Mask::splat(true);
        if actuator.force_limited && actuator.motor == NONE {
            free = free & within(actuation.force[a], &model.force_range(a));
        }
        if let Some(servo) = model.servos.get(actuator.servo as usize).filter(|servo| servo.bounded) {
            free = free & servo_within(servo, &actuation.force);
        }
        if actuator.joint != NONE && model.joints[actuator.joint as usize].force_limited {
            let joint = &model.joints[actuator.joint as usize];
            free = free & within(actuation.qfrc_actuator[joint.dof as usize], &splat(&joint.force_range));
        }
        if let Some(tendon) = model.tendons.get(actuator.tendon as usize).filter(|tendon| tendon.force_limited) {
            // Shares of a bound add up to it but for rounding; less, where an actuator's own bound holds it back.
            let [low, high] = tendon.force_range.map(L::splat);
            let (total, close) = (actuation.total[actuator.tendon as usize], L::of(1.0 - 16.0 * L::Real::EPSILON));
            free = free & total.gt(close * low) & total.lt(close * high);
        }
        f(Gain {
            dofs: &model.moment_dofs[actuator.moments.range()],
            moment: &actuation.moment[actuator.moments.range()],
            length: L::select(free, length, L::zero()),
            velocity: L::select(free, velocity, L::zero()),
        });
    }
}

/// Whether a force is strictly within its bounds.
fn within<L: Lane>(force: L, [low, high]: &[L; 2]) -> L::Mask {
    force.gt(*low) & force.lt(*high)
}
