//! The classical Runge-Kutta method of order four.
//!
//! A rotation is told by the vector that leads to it from the start of the step. Its rate is not the angular velocity: with u that
//! vector and ω the velocity in the turned frame, u' = dexp⁻¹(u) ω (Munthe-Kaas, High order Runge-Kutta methods on manifolds, Appl.
//! Numer. Math. 29, 1999). The mean of angular velocities would be of second order only.

use std::f64::consts::PI;

use super::{Integration, advance, later};
use crate::actuation::activations;
use crate::fields::fields;
use crate::lane::{Lane, Real, sin_cos};
use crate::math::vec3::{cross, norm, scale_add};
use crate::model::{JointKind, Model, Sizes};
use crate::options::Integrator;
use crate::state::State;

fields! {
    /// Rates at an intermediate state, and their weighted sums.
    pub struct Rates(sizes) {
        /// Rates of the positions' coordinates: velocities, for rotations corrected.
        pub rate: Vec<L> = sizes.nv,
        /// Weighted sum of the rates.
        pub rates: Vec<L> = sizes.nv,
        /// Weighted sum of the accelerations.
        pub qaccs: Vec<L> = sizes.nv,
        /// Weighted sum of the rates of activations.
        pub act_dots: Vec<L> = sizes.na,
        /// How far motors' bristles will be bent, as the first evaluation has it.
        pub bristles: Vec<L> = sizes.nmotor,
        /// Where they lead.
        pub qpos: Vec<L> = sizes.nq,
        /// The low words of that.
        pub low: Vec<L> = if sizes.nlow > 0 { sizes.nq } else { 0 },
    } L
}

/// What a step by this method works with.
#[derive(Clone, Debug)]
pub struct Rk4<L> {
    /// The intermediate state that is evaluated.
    pub stage: State<L>,
    /// What its evaluations have added up to.
    pub rates: Rates<L>,
}

/// Where the next state is evaluated, as a part of the step: after the first evaluation, the second, the third.
const REACH: [f64; 3] = [0.5, 0.5, 1.0];
/// Weights of the evaluations.
const WEIGHT: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0];
/// Angles below which the correction's coefficient is that of angle zero.
const SMALL: f64 = 1e-4;

impl<L: Lane> Rk4<L> {
    /// Evaluations of a step.
    pub const PARTS: usize = WEIGHT.len();

    /// Room for a model that is integrated so.
    pub fn new(model: &Model<L::Real>) -> Option<Self> {
        let wanted = model.options.integrator == Integrator::Rk4;
        wanted.then(|| Rk4 { stage: State::new(&model.sizes), rates: Rates::new(&model.sizes) })
    }

    /// Bytes of that.
    pub fn bytes(model: &Model<L::Real>) -> usize {
        let of = |sizes: &Sizes| State::<L>::bytes(sizes).saturating_add(Rates::<L>::bytes(sizes));
        if model.options.integrator == Integrator::Rk4 { of(&model.sizes) } else { 0 }
    }

    /// Begins a step: the first evaluation is that of its state.
    pub fn start(&mut self, state: &State<L>) {
        self.stage.copy_from(state);
        let Rates { rate, rates, qaccs, act_dots, .. } = &mut self.rates;
        [rate, rates, qaccs, act_dots].into_iter().for_each(|sums| sums.fill(L::zero()));
    }

    /// Takes over what evaluation `part` of the present stage has found, the accelerations with constraints and without, the rates of
    /// activations and how far motors' bristles will be bent, and moves on: to the next stage, or after the last to the end of the step, which `out` then holds. `state` is where the step began.
    /// Worlds that are not `good` stay as they are. Returns the others whose accelerations and next state are usable.
    pub fn take(
        &mut self,
        model: &Model<L::Real>,
        part: usize,
        ([qacc, qacc_smooth], [act_dot, bent]): ([&[L]; 2], [&[L]; 2]),
        state: &State<L>,
        good: L::Mask,
        out: &mut Integration<L>,
    ) -> L::Mask {
        let h = model.options.timestep;
        let Rk4 { stage, rates: Rates { rate, rates, qaccs, act_dots, bristles, qpos, low } } = self;
        if part == 0 {
            bristles.copy_from_slice(bent);
        }
        // Of the accelerations only the first is held against the largest number, as for other integrators.
        let judged = if part == 0 { qacc } else { &[] };
        let good = judged.iter().fold(good, |good, a| good & a.within(L::Real::MAXVAL));
        let reached = if part == 0 { 0.0 } else { REACH[part - 1] * h };
        corrected(model, &stage.qvel, L::of(reached), rate);
        let weight = L::of(WEIGHT[part]);
        for i in 0..rate.len() {
            rates[i] = weight.mul_add(rate[i], rates[i]);
            qaccs[i] = weight.mul_add(qacc[i], qaccs[i]);
        }
        for (sum, rate) in act_dots.iter_mut().zip(act_dot) {
            *sum = weight.mul_add(*rate, *sum);
        }
        let last = part + 1 == Self::PARTS;
        let (reach, rates, qaccs) = if last { (h, &*rates, &**qaccs) } else { (REACH[part] * h, &*rate, qacc) };
        let take = |old: &mut L, new: L| *old = L::select(good, new, *old);
        advance(model, state.positions(), rates, L::of(reach), [qpos, low]);
        out.qpos.iter_mut().zip(qpos).for_each(|(old, new)| take(old, *new));
        out.low.iter_mut().zip(low).for_each(|(old, new)| take(old, *new));
        for (i, a) in qaccs.iter().enumerate() {
            take(&mut out.qvel[i], L::of(reach).mul_add(*a, state.qvel[i]));
            take(&mut out.qacc[i], *a);
        }
        if last {
            let Integration { act, .. } = out;
            // What a lost world would have is judged with the rest of its state.
            activations(model, &state.act, (act_dots, bristles), act);
        } else {
            for (i, rate) in act_dot.iter().enumerate() {
                take(&mut out.act[i], L::of(reach).mul_add(*rate, state.act[i]));
            }
        }
        let good = out.usable(good);
        if !last {
            let take = |old: &mut [L], new: &[L]| {
                old.iter_mut().zip(new).for_each(|(old, new)| *old = L::select(good, *new, *old));
            };
            take(&mut stage.qpos, &out.qpos);
            take(stage.low.get_mut(1..).unwrap_or_default(), &out.low);
            take(&mut stage.qvel, &out.qvel);
            take(&mut stage.act, &out.act);
            let [time, low] = later(reach, state);
            take(&mut stage.time, &[time]);
            take(stage.low.get_mut(..1).unwrap_or_default(), &[low]);
            for (i, warm) in stage.qacc_warmstart.iter_mut().enumerate() {
                *warm = L::select(good, qacc[i] - qacc_smooth[i], *warm);
            }
        }
        good
    }
}

/// The rates of the coordinates at a stage that was reached in a time `reached` from the start of the step with the rates in
/// `rate`, which are replaced.
fn corrected<L: Lane>(model: &Model<L::Real>, qvel: &[L], reached: L, rate: &mut [L]) {
    for joint in &model.joints {
        let dof = joint.dof as usize;
        let turn = match joint.kind {
            JointKind::Free => {
                rate[dof..dof + 3].copy_from_slice(&qvel[dof..dof + 3]);
                dof + 3
            }
            JointKind::Ball => dof,
            JointKind::Slide | JointKind::Hinge => {
                rate[dof] = qvel[dof];
                continue;
            }
        };
        let u = [turn, turn + 1, turn + 2].map(|i| reached * rate[i]);
        let corrected = rate_of_turn(&u, &[qvel[turn], qvel[turn + 1], qvel[turn + 2]]);
        rate[turn..turn + 3].copy_from_slice(&corrected);
    }
}

/// dexp⁻¹(u) ω = ω + ½ u × ω + c u × (u × ω), c = (1 - ½θ cot ½θ) / θ², θ = ‖u‖, of the shortest u that leads to the same
/// orientation: whole turns do not count.
fn rate_of_turn<L: Lane>(u: &[L; 3], w: &[L; 3]) -> [L; 3] {
    let whole = norm(u);
    let turns = (whole * L::of(0.5 / PI)).round();
    let angle = turns.neg_mul_add(L::of(2.0 * PI), whole);
    let none = whole.lt(L::of(SMALL));
    let share = L::select(none, L::one(), angle / L::select(none, L::one(), whole));
    let u = &u.map(|x| share * x);
    let small = angle.abs().lt(L::of(SMALL));
    let safe = L::select(small, L::one(), angle);
    let half = safe * L::of(0.5);
    let (sin, cos) = sin_cos(half);
    let exact = (L::one() - half * cos / sin) / (safe * safe);
    let coefficient = L::select(small, L::of(1.0 / 12.0), exact);
    let first = cross(u, w);
    scale_add(coefficient, &cross(u, &first), &scale_add(L::of(0.5), &first, w))
}
