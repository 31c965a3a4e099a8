//! Integration that is implicit in velocity: v⁺ = v + h a, (M - h D) a = forces, D what they gain with velocity.

use super::{Integration, advance};
use crate::derivative::{self, Derivative};
use crate::lane::Lane;
use crate::model::Model;
use crate::state::State;

/// Next state: the sum of `forces` is that on the right, [`derivative`](mod@crate::derivative) has the factor of M - h D.
pub fn implicit<L: Lane>(
    model: &Model<L::Real>,
    state: &State<L>,
    forces: [&[L]; 2],
    derivative: &Derivative<L>,
    out: &mut Integration<L>,
) {
    let h = L::of(model.options.timestep);
    for (i, sum) in out.qacc.iter_mut().enumerate() {
        *sum = forces[0][i] + forces[1][i];
    }
    derivative::solve(model, derivative, &mut out.qacc);
    for (i, v) in out.qvel.iter_mut().enumerate() {
        *v = h.mul_add(out.qacc[i], state.qvel[i]);
    }
    let Integration { qpos, low, qvel, .. } = out;
    advance(model, state.positions(), qvel, h, [qpos, low]);
}
