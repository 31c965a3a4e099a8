//! Springs that yield: where they rest is a part of the state, and follows the motion that stretches them beyond a bound (MuJoCo's manual,
//! `springyield`: ideal elasto-plasticity).

use super::twist_from_rest;
use crate::lane::Lane;
use crate::math::quat;
use crate::math::vec3::{build, norm, scale, select};
use crate::model::{Joint, JointKind, Model, NONE, Tendon};
use crate::state::State;
use crate::tendon::{self, Tendons};

/// A number of where a joint's spring rests.
#[inline(always)]
pub(crate) fn joint_rest<L: Lane>(joint: &Joint<L::Real>, plastic: &[L], k: usize) -> L {
    if joint.plastic == NONE { L::splat(joint.qpos_spring[k]) } else { plastic[joint.plastic as usize + k] }
}

/// The lengths between which a tendon's spring rests.
#[inline(always)]
pub(super) fn tendon_rest<L: Lane>(tendon: &Tendon<L::Real>, plastic: &[L]) -> [L; 2] {
    if tendon.plastic == NONE { tendon.rest.map(L::splat) } else { build(|k| plastic[tendon.plastic as usize + k]) }
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
            let twist = twist_from_rest(joint, q, 0, &state.plastic);
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
