//! What actuator forces gain with velocity, and with length.

use crate::actuation::{Actuation, control, usable};
use crate::lane::{Lane, Mask};
use crate::model::{Actuator, Instance};
use crate::state::State;

/// What an actuator's force gains, and what it acts on.
pub(super) struct Gain<'a, L> {
    /// Its first dof.
    pub dof: usize,
    /// Its moments, dof by dof.
    pub moment: &'a [L],
    /// What the force gains with the actuator's length.
    pub length: L,
    /// With its velocity.
    pub velocity: L,
}

/// Subtracts h times the derivative from a matrix: the moments' products, times what force gains with the actuator's velocity.
pub fn add<L: Lane>(model: Instance<'_, L>, state: &State<L>, actuation: &Actuation<L>, h: L, matrix: &mut [L]) {
    gains(model, state, actuation, |Gain { dof, moment, velocity, .. }| {
        let slope = h * velocity;
        for i in 0..moment.len() {
            let scaled = slope * moment[i];
            for j in 0..=i {
                let entry = &mut matrix[model.rows.at(dof + i, dof + j)];
                *entry = scaled.neg_mul_add(moment[j], *entry);
            }
        }
    });
}

/// Calls `f` for every actuator whose force gains anything. A force at a bound, its own or that of its joint, gains nothing.
#[inline(always)]
pub(super) fn gains<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    actuation: &Actuation<L>,
    mut f: impl FnMut(Gain<'_, L>),
) {
    let good = usable(&state.ctrl);
    let acts = |actuator: &Actuator<L::Real>| !actuator.disabled && (actuator.gain_affine || actuator.bias_affine);
    for (a, actuator) in model.actuators.iter().enumerate().filter(|(_, actuator)| acts(actuator)) {
        let [_, length, velocity] = if actuator.bias_affine { model.bias(a) } else { [L::zero(); 3] };
        let [length, velocity] = if actuator.gain_affine {
            let (input, [_, by_length, by_velocity]) = (control(&model, a, good, &state.ctrl), model.gain(a));
            [by_length.mul_add(input, length), by_velocity.mul_add(input, velocity)]
        } else {
            [length, velocity]
        };
        let (dof, joint) = (actuator.dof as usize, &model.joints[actuator.joint as usize]);
        let mut free = L::Mask::splat(true);
        if actuator.force_limited {
            free = free & within(actuation.force[a], &actuator.force_range);
        }
        if joint.force_limited {
            free = free & within(actuation.qfrc_actuator[dof], &joint.force_range);
        }
        f(Gain {
            dof,
            moment: &actuation.moment[actuator.moments.range()],
            length: L::select(free, length, L::zero()),
            velocity: L::select(free, velocity, L::zero()),
        });
    }
}

/// Whether a force is strictly within its bounds.
fn within<L: Lane>(force: L, range: &[L::Real; 2]) -> L::Mask {
    force.gt(L::splat(range[0])) & force.lt(L::splat(range[1]))
}
