//! Springs that yield: where they rest is a part of the state, and follows the motion that stretches them beyond a bound (MuJoCo's manual,
//! `springyield`: ideal elasto-plasticity).

use super::twist_from_rest;
use crate::lane::Lane;
use crate::math::quat;
use crate::math::vec3::{build, norm, scale, select};
use crate::model::{Instance, JointKind, Model, NONE, Tendon};
use crate::state::State;
use crate::tendon::{self, Tendons};

/// Where a joint's spring rests.
#[inline(always)]
pub(crate) fn joint_rest<L: Lane>(model: &Instance<'_, L>, j: usize, plastic: &[L]) -> [L; 7] {
    let (joint, mut rest) = (&model.joints[j], model.rest(j));
    if joint.plastic != NONE {
        let count = if joint.kind == JointKind::Ball { 4 } else { 1 };
        rest[..count].copy_from_slice(&plastic[joint.plastic as usize..][..count]);
    }
    rest
}

/// The lengths between which a tendon's spring rests.
#[inline(always)]
pub(super) fn tendon_rest<L: Lane>(model: &Instance<'_, L>, t: usize, plastic: &[L]) -> [L; 2] {
    let at = model.tendons[t].plastic;
    if at == NONE { model.tendon_rest(t) } else { build(|k| plastic[at as usize + k]) }
}

/// Moves where springs rest after a step that has led to a state, in the lanes of `moved`. Lengths of tendons that run along a path are
/// told from those of `tendons`, where the step began, and the velocity at its end.
pub fn yield_springs<L: Lane>(model: &Model<L::Real>, tendons: &Tendons<L>, moved: L::Mask, state: &mut State<L>) {
    if state.plastic.is_empty() || !model.options.flags.spring {
        return;
    }
    for joint in model.joints.iter().filter(|joint| joint.plastic != NONE) {
        let (q, at) = (&state.qpos[joint.qpos as usize..], joint.plastic as usize);
        let most = L::splat(joint.springyield);
        if joint.kind == JointKind::Ball {
            let rest: [L; 4] = build(|k| state.plastic[at + k]);
            let twist = twist_from_rest(&rest, q);
            let (angle, zero) = (norm(&twist), L::zero());
            let beyond = angle.gt(most);
            let share = L::select(beyond, (angle - most) / L::select(beyond, angle, L::one()), zero);
            let next = quat::unit(&quat::mul(&rest, &quat::exp(&scale(share, &twist))));
            let next = select(beyond & moved, &next, &rest);
            state.plastic[at..at + 4].copy_from_slice(&next);
        } else {
            let rest = &mut state.plastic[at];
            *rest = L::select(moved, rest.clamp(q[0] - most, q[0] + most), *rest);
        }
    }
    for (t, tendon) in model.tendons.iter().enumerate().filter(|(_, tendon)| tendon.plastic != NONE) {
        let at = tendon.plastic as usize;
        let length = length_after(model, (t, tendon), tendons, state);
        let (most, rest) = (L::splat(tendon.springyield), [state.plastic[at], state.plastic[at + 1]]);
        let (zero, [low, high]) = (L::zero(), rest);
        let (longer, shorter) = ((length - most - high).max(zero), (length + most - low).min(zero));
        let tense = longer.gt(zero);
        let shift = L::select(tense, longer, shorter);
        // Of what is slack down to nothing, the lower end stays.
        let slack = tense & low.eq(zero) & high.gt(zero);
        state.plastic[at] = L::select(moved & !slack, low + shift, low);
        state.plastic[at + 1] = L::select(moved, high + shift, high);
    }
}

/// Length of a tendon in a state that a step led to.
fn length_after<L: Lane>(
    model: &Model<L::Real>,
    (t, tendon): (usize, &Tendon<L::Real>),
    tendons: &Tendons<L>,
    state: &State<L>,
) -> L {
    if tendon.fixed() {
        let dofs = &model.tendon_dofs[tendon.dofs.range()];
        return dofs.iter().fold(L::zero(), |sum, own| L::splat(own.coef).mul_add(state.qpos[own.qpos as usize], sum));
    }
    let h = L::of(model.options.timestep);
    let columns = tendon::columns(model, t, &tendons.jacobian);
    columns.fold(tendons.length[t], |length, (dof, j)| (h * j).mul_add(state.qvel[dof], length))
}
