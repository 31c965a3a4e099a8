//! From the derivatives of the residual to those of the acceleration and of the next state, some columns at a time.

use super::sides::{self, Factors, STRIP, Strip};
use super::{Anew, Exact, Given, Of, Taker, actuator_dof, is_implicit, width};
use crate::collision::Slot;
use crate::derivative::{self, Derivative};
use crate::lane::{Lane, LaneQuery, Tangent, sin_cos};
use crate::math::vec3::{Mat3, Vec3, build, norm, scale};
use crate::math::{ldl, quat};
use crate::model::{DofKind, Instance, Model, Rows};
use crate::options::Integrator;
use crate::passive::damper_slope;
use crate::solver::Fill;

/// Room for some columns, and what solves an implicit step.
#[derive(Clone, Debug)]
pub(super) struct Step<L> {
    /// M - h D, factored.
    derivative: Derivative<L>,
    /// -h D: entries up to the diagonal, and above it; by dof where it has no others.
    added: [Vec<L>; 2],
    product: Vec<L>,
    /// No velocity.
    still: Vec<L>,
    /// Reciprocal pivots of the residual's derivative by accelerations.
    inverse: Vec<L>,
    /// Of some columns, in which rows they begin other than zero.
    there: Vec<bool>,
    /// Derivatives of the acceleration.
    acceleration: Vec<Strip<L>>,
    /// Scratch.
    other: Vec<Strip<L>>,
    /// Derivatives of the next state: positions, velocities, activations.
    next: Vec<Strip<L>>,
    /// By rotation of a joint, by its first dof: how the end of its turn changes with what it starts from, and with the velocity.
    turns: Vec<[Mat3<L>; 2]>,
}

impl<L: Lane> Step<L> {
    pub fn new(model: &Model<L::Real>) -> Self {
        let (nv, na, zero) = (model.sizes.nv, model.sizes.na, L::zero());
        Step {
            derivative: Derivative::new(&model.sizes),
            added: [vec![zero; model.sizes.nm], vec![zero; model.sizes.nm]],
            product: vec![zero; nv],
            still: vec![zero; nv],
            inverse: vec![zero; nv],
            there: vec![true; nv],
            acceleration: vec![[zero; STRIP]; nv],
            other: vec![[zero; STRIP]; nv],
            next: vec![[zero; STRIP]; 2 * nv + na],
            turns: Vec::new(),
        }
    }
}

impl<L> Step<L> {
    /// Velocities that are zero, and room for accelerations.
    pub fn room_for_motions(&mut self) -> (&[L], &mut [L]) {
        (&self.still, &mut self.product)
    }
}

/// Some columns of a symmetric matrix that is stored by rows.
fn load_symmetric<L: Lane>(rows: &Rows, from: &[L], first: usize, to: &mut [Strip<L>]) {
    for (i, to) in to.iter_mut().enumerate() {
        *to = build(|c| {
            let (low, high) = (i.min(first + c), i.max(first + c));
            match rows.first.get(high) {
                Some(start) if *start as usize <= low => from[rows.at(high, low)],
                _ => L::zero(),
            }
        });
    }
}

/// Some columns, `STRIP` of them or what is left.
fn load<L: Lane>(from: &[L], width: usize, first: usize, to: &mut [Strip<L>]) {
    for (row, to) in from.chunks_exact(width).zip(to) {
        let row = &row[first..];
        *to = match row.first_chunk::<STRIP>() {
            Some(all) => *all,
            None => build(|c| row.get(c).copied().unwrap_or(L::zero())),
        };
    }
}

impl<L: LaneQuery> Exact<L> {
    /// Finds the acceleration over an implicit step, and what solves for its derivatives.
    pub(super) fn find_over(&mut self, model: Instance<'_, L>, given: &Given<'_, L>) {
        let Exact { inertia, rest, step, .. } = self;
        let m = &inertia.m;
        let Derivative { lower, upper, inverse, multipliers, .. } = &mut step.derivative;
        lower.copy_from_slice(m);
        let over = &mut step.product;
        ldl::multiply(&model.rows, &model.tree_pattern, m, given.qacc, over);
        if model.options.integrator == Integrator::Euler {
            let h = L::of(model.options.timestep);
            step.added[0].fill(L::zero());
            for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
                let (at, slope) = (model.rows.diagonal(i), h * damper_slope(model, i, given.state.qvel[i]));
                lower[at] += slope;
                step.added[0][at] = slope;
            }
            ldl::factor(&model.rows, &model.tree_pattern, lower, inverse, multipliers);
            ldl::solve(&model.rows, &model.tree_pattern, lower, inverse, over);
        } else {
            rest.rest();
            rest.evaluate(&model, Anew::Position);
            // Without rigid bodies the matrix is what they leave out.
            derivative::complete(&model, &mut rest.ws.derivative);
            let found = &rest.ws.derivative;
            let [below, above] = &mut step.added;
            for (to, added, found) in [(lower, below, &found.lower), (upper, above, &found.upper)] {
                for ((to, added), (x, m)) in to.iter_mut().zip(added).zip(found.iter().zip(m)) {
                    *added = if rest.reach.rigid { x.value - *m } else { x.value };
                    *to = *added + *m;
                }
            }
            derivative::factor(&model, &mut step.derivative);
            derivative::complete(&model, &mut step.derivative);
            derivative::solve(&model, &step.derivative, over);
        }
        rest.over.iter_mut().zip(&*over).for_each(|(to, x)| *to = Tangent::still(*x));
    }

    /// Hands out the derivatives by all columns, from those of the residual: the first column of some, and their rows.
    pub(super) fn hand_out(&mut self, of: Of, model: Instance<'_, L>, given: &Given<'_, L>, out: &mut Taker<'_, L>) {
        let (nv, width) = (model.sizes.nv, width(&model));
        if of == Of::Inverse {
            for column in
                [0, nv].into_iter().flat_map(|first| (first..first + nv).step_by(STRIP).map(move |c| (c, first + nv)))
            {
                let (column, after) = column;
                load(&self.slopes, width, column, &mut self.step.acceleration);
                out(column, STRIP.min(after - column), &self.step.acceleration);
            }
            for column in (0..nv).step_by(STRIP) {
                load_symmetric(&model.rows, &self.hessian, column, &mut self.step.acceleration);
                out(2 * nv + column, STRIP.min(nv - column), &self.step.acceleration);
            }
            return;
        }
        self.factor(&model, given.slots);
        if of == Of::Transition {
            self.turn(model, given);
        }
        for first in (0..width).step_by(STRIP) {
            let count = STRIP.min(width - first);
            self.find_rows(&model, first..first + count);
            let Exact { slopes, hessian, rest, step: Step { acceleration, inverse, there, .. }, filled, .. } =
                &mut *self;
            load(slopes, width, first, acceleration);
            let pattern = if *filled { &rest.ws.solver.fill.pattern } else { &model.tree_pattern };
            let factors = Factors { lower: hessian, upper: hessian, inverse };
            sides::solve((&model.rows, pattern), factors, |i| there[i], acceleration);
            acceleration.iter_mut().flatten().for_each(|x| *x = -*x);
            if of == Of::Acceleration {
                out(first, count, &self.step.acceleration);
                continue;
            }
            if is_implicit(&model) {
                self.over_step(&model, width, first);
            }
            self.advance(&model, width, first);
            out(first, count, &self.step.next);
        }
    }

    /// Factors the residual's derivative by accelerations. Contacts join dofs that the inertia matrix does not.
    fn factor(&mut self, model: &Model<L::Real>, slots: &[Slot]) {
        let Exact { hessian, rest, step, filled, .. } = self;
        let joins = || slots.iter().map(|slot| slot.pair).filter(|pair| model.pairs[*pair as usize].cross);
        let fill = &mut rest.ws.solver.fill;
        *filled = Fill::always(model) || joins().next().is_some();
        if *filled {
            fill.find(model, joins());
        }
        let pattern = if *filled { &fill.pattern } else { &model.tree_pattern };
        let multipliers = &mut step.product;
        ldl::factor(&model.rows, pattern, hessian, &mut step.inverse, multipliers);
    }

    /// In which rows the residual's derivatives by some columns may be other than zero: where all forces are local, in those that are coupled with
    /// the columns' dofs.
    fn find_rows(&mut self, model: &Model<L::Real>, columns: std::ops::Range<usize>) {
        let Exact { rest, step: Step { there, .. }, filled, .. } = self;
        if !rest.reach.local {
            return;
        }
        let (nv, na) = (model.sizes.nv, model.sizes.na);
        let pattern = if *filled { &rest.ws.solver.fill.pattern } else { &model.tree_pattern };
        there.fill(false);
        for column in columns {
            let actuator = match column.checked_sub(2 * nv) {
                Some(act) if act < na => model.actuators.iter().find(|actuator| actuator.act as usize == act),
                Some(input) => model.actuators.get(input - na),
                None => None,
            };
            // What an input forces is a dof alone; a dof's motion also forces all that it carries.
            let j = actuator.map_or(column % nv, |actuator| actuator_dof(model, actuator));
            let below = if column < 2 * nv { pattern.column(j) } else { &[] };
            below.iter().map(|i| *i as usize).chain([j]).for_each(|i| there[i] = true);
        }
        // Elimination brings each row's columns in, and theirs.
        for k in (0..nv).rev() {
            if there[k] {
                pattern.row(k).iter().for_each(|run| there[run.range()].fill(true));
            }
        }
    }

    /// In place of the derivatives of the solver's acceleration da, those of the acceleration over an implicit step: with A = M - h D,
    /// A da⁺ = M da - (change of A a⁺ - M a), so da⁺ = da - A⁻¹(that change - h D da).
    fn over_step(&mut self, model: &Model<L::Real>, width: usize, first: usize) {
        let Exact { excess_slopes, rest, step: Step { acceleration, other, derivative, added, .. }, .. } = self;
        let (rows, pattern) = (&model.rows, &model.tree_pattern);
        load(excess_slopes, width, first, other);
        let skew = model.options.integrator != Integrator::Euler && derivative::of_bias(model);
        let Derivative { lower, upper, inverse, .. } = derivative;
        let upper = if skew { upper } else { &*lower };
        if rest.reach.local || model.options.integrator == Integrator::Euler {
            for (i, (other, own)) in other.iter_mut().zip(&*acceleration).enumerate() {
                let factor = added[0][rows.diagonal(i)];
                other.iter_mut().zip(own).for_each(|(sum, x)| *sum = factor.mul_add(*x, *sum));
            }
        } else {
            let both = [&added[0][..], &added[usize::from(skew)][..]];
            sides::add_product(rows, pattern, both, acceleration, other);
        }
        sides::solve((rows, pattern), Factors { lower, upper, inverse }, |_| true, other);
        for (own, other) in acceleration.iter_mut().flatten().zip(other.iter().flatten()) {
            *own -= *other;
        }
    }

    /// How rotations of joints end.
    fn turn(&mut self, model: Instance<'_, L>, given: &Given<'_, L>) {
        let Exact { rest, step, .. } = self;
        let (h, implicit) = (L::of(model.options.timestep), is_implicit(&model));
        let speed = |i: usize| {
            let a = if implicit { rest.over[i].value } else { given.qacc[i] };
            h * h.mul_add(a, given.state.qvel[i])
        };
        step.turns.clear();
        for (i, dof) in model.dofs.iter().enumerate() {
            if matches!(dof.kind, DofKind::FreeRotation(0) | DofKind::BallRotation(0)) {
                let turn = [speed(i), speed(i + 1), speed(i + 2)];
                let back = quat::to_matrix(&quat::exp(&scale(L::of(-1.0), &turn)));
                step.turns.push([back, right_jacobian(&turn).map(|x| h * x)]);
            }
        }
    }

    /// The derivatives of the next state by some columns, from those of the acceleration.
    fn advance(&mut self, model: &Model<L::Real>, width: usize, first: usize) {
        let Exact { act_slopes, step: Step { acceleration, next, turns, .. }, .. } = self;
        let (nv, h) = (model.sizes.nv, L::of(model.options.timestep));
        let (positions, others) = next.split_at_mut(nv);
        let (velocities, acts) = others.split_at_mut(nv);
        load(act_slopes, width, first, acts);
        let own = |column: usize| column.checked_sub(first).filter(|c| *c < STRIP);
        for (i, (velocity, a)) in velocities.iter_mut().zip(acceleration).enumerate() {
            *velocity = scale(h, a);
            own(nv + i).into_iter().for_each(|c| velocity[c] += L::one());
        }
        let mut turns = turns.iter();
        let mut i = 0;
        while i < nv {
            if !matches!(model.dofs[i].kind, DofKind::FreeRotation(_) | DofKind::BallRotation(_)) {
                positions[i] = scale(h, &velocities[i]);
                own(i).into_iter().for_each(|c| positions[i][c] += L::one());
                i += 1;
                continue;
            }
            let Some([back, right]) = turns.next() else { return };
            for r in 0..3 {
                let [x, y, z] = [right[3 * r], right[3 * r + 1], right[3 * r + 2]];
                positions[i + r] =
                    build(|c| z.mul_add(velocities[i + 2][c], y.mul_add(velocities[i + 1][c], x * velocities[i][c])));
                (0..3).for_each(|k| own(i + k).into_iter().for_each(|c| positions[i + r][c] += back[3 * r + k]));
            }
            i += 3;
        }
    }
}

/// How the end of a turn by a vector changes, in its own axes, with the vector: 1 - (1 - cos θ)/θ² [φ] + (θ - sin θ)/θ³ [φ]².
fn right_jacobian<L: Lane>(turn: &Vec3<L>) -> Mat3<L> {
    let angle = norm(turn);
    let small = angle.lt(L::of(1e-2));
    let safe = L::select(small, L::one(), angle);
    let square = angle * angle;
    let series = |a: f64, b: f64, c: f64| square.mul_add(square.mul_add(L::of(c), L::of(-b)), L::of(a));
    let (half_sine, sine) = (sin_cos(safe * L::of(0.5)).0, sin_cos(safe).0);
    let first = L::of(2.0) * half_sine * half_sine / (safe * safe);
    let second = (safe - sine) / (safe * safe * safe);
    let first = L::select(small, series(0.5, 1.0 / 24.0, 1.0 / 720.0), first);
    let second = L::select(small, series(1.0 / 6.0, 1.0 / 120.0, 1.0 / 5040.0), second);
    let [x, y, z] = *turn;
    let zero = L::zero();
    let cross = [zero, -z, y, z, zero, -x, -y, x, zero];
    build(|at| {
        let (r, c) = (at / 3, at % 3);
        let squared = (0..3).fold(zero, |sum, k| cross[3 * r + k].mul_add(cross[3 * k + c], sum));
        let identity = if r == c { L::one() } else { zero };
        second.mul_add(squared, first.neg_mul_add(cross[at], identity))
    })
}
