//! The ends of midpoint steps: positions drift for half a step with the old velocity, and, after the kick in the middle, for the other half
//! with the new one. What the kick is made of is in [`kick`](mod@crate::kick).

use super::{Integration, advance};
use crate::lane::Lane;
use crate::model::Model;
use crate::state::State;

/// The middle of the step: q ⊕ h/2 v, the rest as it is at the beginning.
pub fn drift<L: Lane>(model: &Model<L::Real>, state: &State<L>, middle: &mut State<L>) {
    let State { time, qpos, qvel, act, ctrl, eq_active, qacc_warmstart, mocap_pos, mocap_quat, tree_rest, tree_guard } =
        middle;
    let half = L::of(0.5 * model.options.timestep);
    time[0] = state.time[0] + half;
    advance(model, &state.qpos, &state.qvel, half, qpos);
    qvel.copy_from_slice(&state.qvel);
    act.copy_from_slice(&state.act);
    ctrl.copy_from_slice(&state.ctrl);
    eq_active.copy_from_slice(&state.eq_active);
    mocap_pos.copy_from_slice(&state.mocap_pos);
    mocap_quat.copy_from_slice(&state.mocap_quat);
    tree_rest.copy_from_slice(&state.tree_rest);
    tree_guard.copy_from_slice(&state.tree_guard);
    qacc_warmstart.copy_from_slice(&state.qacc_warmstart);
}

/// Next state: v⁺ = v + h a, q⁺ = qm ⊕ h/2 v⁺, from the middle's positions `qpos`.
pub fn staggered<L: Lane>(model: &Model<L::Real>, qpos: &[L], qvel: &[L], qacc: &[L], out: &mut Integration<L>) {
    let h = L::of(model.options.timestep);
    out.qacc.copy_from_slice(qacc);
    for (i, v) in out.qvel.iter_mut().enumerate() {
        *v = h.mul_add(qacc[i], qvel[i]);
    }
    let Integration { qpos: next, qvel, .. } = out;
    advance(model, qpos, qvel, L::of(0.5 * model.options.timestep), next);
}
