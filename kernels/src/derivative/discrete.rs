//! The metric of discrete steps, M + h D + h² K: D what dampers and actuators hold against velocity, K what springs and actuators hold
//! against displacement, both where they hold and do not push. The force is taken where the step ends, -h K v further.

use super::Stages;
use super::actuators::{Gain, gains, products};
use crate::lane::Lane;
use crate::math::vec3::norm;
use crate::model::{Features, Instance, Joint, JointKind, MomentDof, Tendon};
use crate::passive::{
    damper_slope, joint_rest, shift_from_rest, tendon_damper_slope, tendon_spring_slope, twist_from_rest,
};
use crate::state::State;
use crate::tendon::{self, Tendons};

/// Adds h D + h² K to a matrix, writes h K v, and where actuators and tendons add to it.
pub(super) fn add<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    stages: Stages<'_, L>,
    h: L,
    (matrix, pull, joined): (&mut [L], &mut [L], &mut [L]),
) {
    pull.fill(L::zero());
    joined.fill(L::zero());
    if model.features.dampers {
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            let diagonal = &mut matrix[model.rows.diagonal(i)];
            *diagonal = h.mul_add(damper_slope(model, i, state.qvel[i]).max(L::zero()), *diagonal);
        }
    }
    if model.features.springs {
        for (j, joint) in model.joints.iter().enumerate().filter(|(_, joint)| joint.spring) {
            for (dofs, stiffness) in slopes(model, (j, joint), state) {
                let held = h * stiffness.max(L::zero());
                for i in dofs {
                    let diagonal = &mut matrix[model.rows.diagonal(i)];
                    *diagonal = h.mul_add(held, *diagonal);
                    pull[i] = held * state.qvel[i];
                }
            }
        }
    }
    tendons(model, (stages.tendons, &state.plastic), h, (matrix, pull, joined));
    if model.features.actuation {
        gains(model, stages.actuation, |Gain { dofs, moment, length, velocity }| {
            let (spring, damper) = ((-length).max(L::zero()), (-velocity).max(L::zero()));
            let (held, both) = (h * spring, h * h.mul_add(spring, damper));
            let mut speed = L::zero();
            for (m, MomentDof { dof, .. }) in moment.iter().zip(dofs) {
                let dof = *dof as usize;
                joined[dof] = L::select(both.gt(L::zero()), L::one(), joined[dof]);
                speed = m.mul_add(state.qvel[dof], speed);
            }
            products(model, dofs, |at, [i, j]| matrix[at] = (both * moment[i]).mul_add(moment[j], matrix[at]));
            for (m, MomentDof { dof, .. }) in moment.iter().zip(dofs) {
                let pull = &mut pull[*dof as usize];
                *pull = (held * speed).mul_add(*m, *pull);
            }
        });
    }
}

/// Of dampers and springs of tendons.
fn tendons<L: Lane>(
    model: Instance<'_, L>,
    (tendons, plastic): (&Tendons<L>, &[L]),
    h: L,
    (matrix, pull, joined): (&mut [L], &mut [L], &mut [L]),
) {
    let Features { springs, dampers, .. } = model.features;
    let acts = |tendon: &Tendon<L::Real>| springs && tendon.spring || dampers && tendon.damped;
    for (t, _) in model.tendons.iter().enumerate().filter(|(_, tendon)| acts(tendon)) {
        let (zero, speed) = (L::zero(), tendons.velocity[t]);
        let damper = if dampers { tendon_damper_slope(model, t, speed) } else { zero };
        let spring = if springs { tendon_spring_slope(model, t, tendons.length[t], plastic) } else { zero };
        let held = h * spring.max(zero);
        let both = h.mul_add(held, h * damper.max(zero));
        for (dof, _) in tendon::columns(&model, t, &tendons.jacobian) {
            joined[dof] = L::select(both.gt(zero), L::one(), joined[dof]);
        }
        tendon::add_square(&model, t, &tendons.jacobian, both, matrix);
        tendon::pull(&model, t, &tendons.jacobian, held * speed, pull);
    }
}

/// What a joint's spring gains with displacement, a + 2 b r + 3 c r², for the dofs of each of its parts.
pub(super) fn slopes<L: Lane>(
    model: Instance<'_, L>,
    (j, joint): (usize, &Joint<L::Real>),
    State { qpos, plastic, .. }: &State<L>,
) -> impl Iterator<Item = (std::ops::Range<usize>, L)> {
    let ([a, b, c], rest) = (model.stiffness(j), joint_rest(&model, j, plastic));
    let q = &qpos[joint.qpos as usize..];
    let slope = |r: L| r.mul_add(r.mul_add(L::of(3.0) * c, b + b), a);
    let dof = joint.dof as usize;
    let (first, second) = match joint.kind {
        JointKind::Free => (
            (dof..dof + 3, slope(norm(&shift_from_rest(&rest, q)))),
            Some((dof + 3..dof + 6, slope(norm(&twist_from_rest(&rest[3..], &q[3..]))))),
        ),
        JointKind::Ball => ((dof..dof + 3, slope(norm(&twist_from_rest(&rest, q)))), None),
        JointKind::Slide | JointKind::Hinge => ((dof..dof + 1, slope(q[0] - rest[0])), None),
    };
    std::iter::once(first).chain(second)
}
