//! What actuator forces gain with velocity.

use crate::actuation::{Actuation, control, usable};
use crate::lane::{Lane, Mask};
use crate::model::{Actuator, Instance};
use crate::state::State;

/// Subtracts h times the derivative from a matrix: the moments' products, times what force gains with the actuator's velocity. A force at a
/// bound, its own or that of its joint, gains nothing.
pub fn add<L: Lane>(model: Instance<'_, L>, state: &State<L>, actuation: &Actuation<L>, h: L, matrix: &mut [L]) {
    let good = usable(&state.ctrl);
    let acts = |actuator: &Actuator<L::Real>| !actuator.disabled && (actuator.gain_affine || actuator.bias_affine);
    for (a, actuator) in model.actuators.iter().enumerate().filter(|(_, actuator)| acts(actuator)) {
        let bias = if actuator.bias_affine { model.bias(a)[2] } else { L::zero() };
        let slope = if actuator.gain_affine {
            model.gain(a)[2].mul_add(control(&model, a, good, &state.ctrl), bias)
        } else {
            bias
        };
        let (dof, joint) = (actuator.dof as usize, &model.joints[actuator.joint as usize]);
        let mut free = L::Mask::splat(true);
        if actuator.force_limited {
            free = free & within(actuation.force[a], &actuator.force_range);
        }
        if joint.force_limited {
            free = free & within(actuation.qfrc_actuator[dof], &joint.force_range);
        }
        let slope = h * L::select(free, slope, L::zero());
        let moment = &actuation.moment[actuator.moments.range()];
        for i in 0..moment.len() {
            let scaled = slope * moment[i];
            for j in 0..=i {
                let entry = &mut matrix[model.rows.at(dof + i, dof + j)];
                *entry = scaled.neg_mul_add(moment[j], *entry);
            }
        }
    }
}

/// Whether a force is strictly within its bounds.
fn within<L: Lane>(force: L, range: &[L::Real; 2]) -> L::Mask {
    force.gt(L::splat(range[0])) & force.lt(L::splat(range[1]))
}
