//! Integration: semi-implicit Euler, with joint damping taken implicitly when the model asks for it; the other methods are in files of
//! their own.

mod implicit;
mod rk4;
mod staggered;
mod tangent;

pub use implicit::implicit;
pub use rk4::{Rates, Rk4};
pub use staggered::{drift, staggered};
pub use tangent::{difference, displace};

use crate::acceleration::articulated;
use crate::fields::fields;
use crate::inertia::Inertia;
use crate::lane::{Lane, Real};
use crate::math::ldl;
use crate::math::low;
use crate::math::quat;
use crate::math::vec3::select;
use crate::model::{Instance, JointKind, Model};
use crate::passive::damper_slope;
use crate::position::Position;
use crate::state::State;

fields! {
    /// The next state, before it is committed, and the damped inertia that leads to it.
    pub struct Integration(sizes) {
        /// Next positions.
        pub qpos: Vec<L> = sizes.nq,
        /// Next velocities.
        pub qvel: Vec<L> = sizes.nv,
        /// Next activations.
        pub act: Vec<L> = sizes.na,
        /// Next low words of the positions.
        pub low: Vec<L> = if sizes.nlow > 0 { sizes.nq } else { 0 },
        /// Acceleration over the step; differs from the solver's where damping is implicit.
        pub qacc: Vec<L> = sizes.nv,
        /// Factor of M + h B, B the slopes of the dampers.
        pub factor: Vec<L> = sizes.nm,
        /// Its D⁻¹.
        pub inverse: Vec<L> = sizes.nv,
        /// Scratch of the factorisation.
        pub multipliers: Vec<L> = sizes.nv,
        /// Scratch without M, as in [`Acceleration`](crate::acceleration::Acceleration).
        pub body: Vec<[L; 21]> = sizes.narticulated,
        /// The same: per link, force, then acceleration.
        pub twist: Vec<[L; 6]> = sizes.narticulated,
        /// The same.
        pub column: Vec<[L; 6]> = if sizes.narticulated > 0 { sizes.nv } else { 0 },
    } L
}

impl<L: Lane> Integration<L> {
    /// The lanes of `alive` whose next state is finite and not huge.
    pub fn usable(&self, alive: L::Mask) -> L::Mask {
        self.qpos.iter().chain(&self.qvel).chain(&self.act).fold(alive, |good, x| good & x.within(L::Real::MAXVAL))
    }
}

/// Next state: v⁺ = v + h a, q⁺ = q ⊕ h v⁺, with (M + h B) a = the sum of `forces` where damping is implicit, else
/// a = `qacc`. `qpos` has its low words beside it.
pub fn euler<L: Lane>(
    model: Instance<'_, L>,
    (position, inertia): (&Position<L>, &Inertia<L>),
    qpos: [&[L]; 2],
    qvel: &[L],
    qacc: &[L],
    forces: [&[L]; 2],
    out: &mut Integration<L>,
) {
    let h = L::of(model.options.timestep);
    out.qacc.copy_from_slice(qacc);
    if model.features.implicit_damping {
        for (i, sum) in out.qacc.iter_mut().enumerate() {
            *sum = forces[0][i] + forces[1][i];
        }
        let damped = |i: usize, diagonal: L| {
            let slope = || h.mul_add(damper_slope(model, i, qvel[i]), diagonal);
            if model.dofs[i].damped { slope() } else { diagonal }
        };
        let Integration { factor, inverse, multipliers, body, twist, column, qacc: next, .. } = out;
        if model.features.articulated {
            let scratch = articulated::Scratch { body, force: twist, column, inverse };
            let diagonal = |i| damped(i, model.armature(i));
            articulated::solve(&model, &position.cdof, &inertia.link, diagonal, scratch, next);
        } else {
            factor.copy_from_slice(&inertia.m);
            for i in 0..inverse.len() {
                let diagonal = &mut factor[model.rows.diagonal(i)];
                *diagonal = damped(i, *diagonal);
            }
            ldl::factor(&model.rows, &model.tree_pattern, factor, inverse, multipliers);
            ldl::solve(&model.rows, &model.tree_pattern, factor, inverse, next);
        }
        if let Some(damped) = model.damped() {
            // The same bits as those of a model without dampers.
            next.iter_mut().zip(qacc).for_each(|(a, explicit)| *a = L::select(damped, *a, *explicit));
        }
    }
    for i in 0..qvel.len() {
        out.qvel[i] = h.mul_add(out.qacc[i], qvel[i]);
    }
    advance(&model, qpos, &out.qvel, h, [&mut out.qpos, &mut out.low]);
}

/// Replaces the state by the next one in the lanes of `alive` whose next state is usable, and returns these; `accelerations` as of
/// [`replace`].
pub fn commit<L: Lane>(
    model: Instance<'_, L>,
    next: &Integration<L>,
    accelerations: [&[L]; 2],
    alive: L::Mask,
    state: &mut State<L>,
) -> L::Mask {
    let good = accelerations[0].iter().fold(next.usable(alive), |good, a| good & a.within(L::Real::MAXVAL));
    replace(model, next, accelerations, good, state);
    good
}

/// Replaces the state by the next one in the lanes of `good`. `qacc` is the acceleration with constraints and the smooth one. Adding a
/// zero turns a negative zero into a positive one, so that the sign of a zero that a wider factor, an inactive contact or code may
/// have left never reaches the state; whoever records must not know that it is 0, or the sum would be left out.
pub fn replace<L: Lane>(
    model: Instance<'_, L>,
    next: &Integration<L>,
    [qacc, qacc_smooth]: [&[L]; 2],
    good: L::Mask,
    state: &mut State<L>,
) {
    let zero = model.zero();
    let replace = |old: &mut [L], new: &[L]| {
        for (old, new) in old.iter_mut().zip(new) {
            *old = L::select(good, *new + zero, *old);
        }
    };
    replace(&mut state.qpos, &next.qpos);
    replace(&mut state.qvel, &next.qvel);
    replace(&mut state.act, &next.act);
    for (i, warm) in state.qacc_warmstart.iter_mut().enumerate() {
        *warm = L::select(good, qacc[i] - qacc_smooth[i] + zero, *warm);
    }
    let [time, low] = later(model.options.timestep, state);
    replace(&mut state.time, &[time]);
    if let [time, positions @ ..] = &mut state.low[..] {
        replace(std::slice::from_mut(time), &[low]);
        replace(positions, &next.low);
    }
}

/// The time a step later, and its low word: of single precision, the sum of a million steps would be off by a hundredth.
fn later<L: Lane>(timestep: f64, state: &State<L>) -> [L; 2] {
    let (time, step) = (state.time[0], L::of(timestep));
    state.low.first().map_or([time + step, L::zero()], |low| {
        let rest = L::of(timestep - L::Real::from_f64(timestep).to_f64());
        low::sum(time, step, *low + rest)
    })
}

/// q ⊕ h v: positions after moving with velocity `qvel` for a time `h`. Either has its low words beside it; without any, sums are rounded.
pub fn advance<L: Lane>(model: &Model<L::Real>, [qpos, low]: [&[L]; 2], qvel: &[L], h: L, out: [&mut [L]; 2]) {
    let [out, out_low] = out;
    for joint in &model.joints {
        let (at, v) = (joint.qpos as usize, &qvel[joint.dof as usize..]);
        let translations = match joint.kind {
            JointKind::Free => 3,
            JointKind::Ball => 0,
            JointKind::Slide | JointKind::Hinge => 1,
        };
        for k in 0..translations {
            if low.is_empty() {
                out[at + k] = h.mul_add(v[k], qpos[at + k]);
            } else {
                let step = h.mul_add(v[k], low[at + k]);
                [out[at + k], out_low[at + k]] = low::add(qpos[at + k], step);
            }
        }
        if matches!(joint.kind, JointKind::Free | JointKind::Ball) {
            let (at, v) = (at + translations, &v[translations..]);
            if low.is_empty() {
                turn(&qpos[at..], v, h, &mut out[at..]);
            } else {
                turn_low([&qpos[at..], &low[at..]], v, h, [&mut out[at..], &mut out_low[at..]]);
            }
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

/// How far the square of a quaternion's length may be from 1 for [`turn_low`] to keep its low words.
const NEARLY_UNIT: f64 = 1e-5;

/// The same as a sum, with low words: rotations too small for the quaternion's digits count. What adds to its length only need not be exact, and what
/// is missing there is made up for at the next step.
#[inline(always)]
fn turn_low<L: Lane>([q, low]: [&[L]; 2], w: &[L], h: L, [out, out_low]: [&mut [L]; 2]) {
    let given = [q[0], q[1], q[2], q[3]];
    let square = |q: &[L; 4]| q[3].mul_add(q[3], q[2].mul_add(q[2], q[1].mul_add(q[1], q[0] * q[0])));
    let unit = (square(&given) - L::one()).within(NEARLY_UNIT);
    let q = select(unit, &given, &quat::unit(&given));
    let [c, x, y, z] = quat::exp(&[h * w[0], h * w[1], h * w[2]]);
    let across = quat::mul(&q, &[L::zero(), x, y, z]);
    let along = (c - L::one()) + L::of(0.5) * (L::one() - square(&q));
    for k in 0..4 {
        let low = L::select(unit, low[k], L::zero());
        [out[k], out_low[k]] = low::add(q[k], along.mul_add(q[k], across[k]) + low);
    }
}
