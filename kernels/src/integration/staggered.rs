//! The ends of midpoint steps: positions drift for half a step with the old velocity, and, after the kick in the middle, for the other half
//! with the new one. What the kick is made of is in [`kick`](mod@crate::kick).

use super::{Integration, advance, later};
use crate::lane::Lane;
use crate::model::Model;
use crate::state::State;

/// The middle of the step: q ⊕ h/2 v, the rest as it is at the beginning.
pub fn drift<L: Lane>(model: &Model<L::Real>, state: &State<L>, middle: &mut State<L>) {
    let half = L::of(0.5 * model.options.timestep);
    middle.copy_from(state);
    let [time, rest] = later(0.5 * model.options.timestep, state);
    middle.time[0] = time;
    middle.low.first_mut().into_iter().for_each(|low| *low = rest);
    let State { qpos, low, .. } = middle;
    advance(model, state.positions(), &state.qvel, half, [qpos, low.get_mut(1..).unwrap_or_default()]);
}

/// Next state: v⁺ = v + h a, q⁺ = qm ⊕ h/2 v⁺, from the middle's positions `qpos`, with their low words.
pub fn staggered<L: Lane>(model: &Model<L::Real>, qpos: [&[L]; 2], qvel: &[L], qacc: &[L], out: &mut Integration<L>) {
    let h = L::of(model.options.timestep);
    out.qacc.copy_from_slice(qacc);
    for (i, v) in out.qvel.iter_mut().enumerate() {
        *v = h.mul_add(qacc[i], qvel[i]);
    }
    let Integration { qpos: next, low, qvel, .. } = out;
    advance(model, qpos, qvel, L::of(0.5 * model.options.timestep), [next, low]);
}
