//! Integration: semi-implicit Euler, with joint damping taken implicitly when the model asks for it.

use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::Lane;
use crate::math::ldl;
use crate::math::quat;
use crate::model::{Instance, JointKind, Model};
use crate::passive::damper_slope;

fields! {
    /// The next state, before it is committed, and the damped inertia that leads to it.
    pub struct Integration(sizes) {
        /// Next positions.
        pub qpos: Vec<L> = sizes.nq,
        /// Next velocities.
        pub qvel: Vec<L> = sizes.nv,
        /// Acceleration over the step; differs from the solver's where damping is implicit.
        pub qacc: Vec<L> = sizes.nv,
        /// Factor of M + h B, B the slopes of the dampers.
        pub factor: Vec<L> = sizes.nm,
        /// Its D⁻¹.
        pub inverse: Vec<L> = sizes.nv,
        /// Scratch of the factorisation.
        pub multipliers: Vec<L> = sizes.nv,
    } L
}

/// Next state: v⁺ = v + h a, q⁺ = q ⊕ h v⁺, with (M + h B) a = the sum of `forces` where damping is implicit, else
/// a = `qacc`.
pub fn euler<L: Lane>(
    model: Instance<'_, L>,
    inertia: &Inertia<L>,
    qpos: &[L],
    qvel: &[L],
    qacc: &[L],
    forces: [&[L]; 2],
    out: &mut Integration<L>,
) {
    let h = L::of(model.options.timestep);
    out.qacc.copy_from_slice(qacc);
    if model.features.implicit_damping {
        out.factor.copy_from_slice(&inertia.m);
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            let diagonal = &mut out.factor[model.rows.diagonal(i)];
            *diagonal = h.mul_add(damper_slope(model, i, qvel[i]), *diagonal);
        }
        let Integration { factor, inverse, multipliers, .. } = out;
        ldl::factor(&model.rows, &model.tree_pattern, factor, inverse, multipliers);
        for (i, sum) in out.qacc.iter_mut().enumerate() {
            *sum = forces[0][i] + forces[1][i];
        }
        ldl::solve(&model.rows, &model.tree_pattern, &out.factor, &out.inverse, &mut out.qacc);
        if let Some(damped) = model.damped() {
            // The same bits as those of a model without dampers.
            out.qacc.iter_mut().zip(qacc).for_each(|(a, explicit)| *a = L::select(damped, *a, *explicit));
        }
    }
    for i in 0..qvel.len() {
        out.qvel[i] = h.mul_add(out.qacc[i], qvel[i]);
    }
    advance(&model, qpos, &out.qvel, h, &mut out.qpos);
}

/// q ⊕ h v: positions after moving with velocity `qvel` for a time `h`.
pub fn advance<L: Lane>(model: &Model<L::Real>, qpos: &[L], qvel: &[L], h: L, out: &mut [L]) {
    for joint in &model.joints {
        let (q, v) = (&qpos[joint.qpos as usize..], &qvel[joint.dof as usize..]);
        let out = &mut out[joint.qpos as usize..];
        match joint.kind {
            JointKind::Free => {
                for k in 0..3 {
                    out[k] = h.mul_add(v[k], q[k]);
                }
                turn(&q[3..], &v[3..], h, &mut out[3..]);
            }
            JointKind::Ball => turn(q, v, h, out),
            JointKind::Slide | JointKind::Hinge => out[0] = h.mul_add(v[0], q[0]),
        }
    }
}

/// normalise(q) ∘ exp(h ω)
#[inline(always)]
fn turn<L: Lane>(q: &[L], w: &[L], h: L, out: &mut [L]) {
    let q = quat::unit(&[q[0], q[1], q[2], q[3]]);
    let next = quat::unit(&quat::mul(&q, &quat::exp(&[h * w[0], h * w[1], h * w[2]])));
    out[..4].copy_from_slice(&next);
}
