//! All other forces over dual numbers: springs, dampers, tendons, media, actuators, limits, dry friction, equality constraints.
//!
//! Where every force acts on one joint by what is known of that joint alone, one evaluation has the derivatives by all joints at once: each is read
//! from its own joint's forces. Else there is one evaluation for each column; where forces depend on how links move, rigid bodies' forces are taken from it as well.

use std::ops::Range;

use super::held::EDGE;
use super::missing::{Reach, companions};
use crate::actuation::Actuation;
use crate::constraint::DofRowKind;
use crate::derivative;
use crate::lane::{Lane, Mask, Tangent};
use crate::math::{ldl, quat};
use crate::model::{Instance, JointKind, Model, Varied};
use crate::options::Integrator;
use crate::passive::damper_slope;
use crate::state::{Applied, State};
use crate::workspace::Workspace;
use crate::{acceleration, actuation, constraint, inertia, passive, position, solver, tendon, velocity};

/// What is evaluated anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Anew {
    Position,
    Velocity,
    Input,
}

/// What an evaluation finds, as rates.
#[derive(Clone, Debug)]
pub(super) struct Found<L> {
    /// M a + c - other forces - Jᵀf, but for contacts; without rigid bodies' where these are analytic.
    pub residual: Vec<L>,
    /// (M - h D) a⁺ - M a, of an implicit step with the acceleration a⁺; likewise.
    pub excess: Vec<L>,
    /// Activations after the step.
    pub act: Vec<L>,
}

/// Everything over dual numbers.
#[derive(Clone, Debug)]
pub(super) struct Rest<L: Lane> {
    pub reach: Reach,
    /// By dof, the dofs of its joint on whose motion forces on it depend, where forces are local.
    pub companions: Vec<Range<usize>>,
    /// Whether actuators count.
    pub driven: bool,
    pub state: State<Tangent<L>>,
    applied: Option<Applied<Tangent<L>>>,
    varied: Option<Varied<Tangent<L>>>,
    pub ws: Workspace<Tangent<L>>,
    /// The acceleration.
    qacc: Vec<Tangent<L>>,
    /// The acceleration over an implicit step.
    pub over: Vec<Tangent<L>>,
    /// M a, where rigid bodies are over dual numbers.
    inertial: Vec<Tangent<L>>,
    product: Vec<Tangent<L>>,
    act: Vec<Tangent<L>>,
    pub found: Found<L>,
}

impl<L: Lane> Rest<L> {
    pub fn new(model: &Model<L::Real>) -> Self {
        let (nv, na, zero) = (model.sizes.nv, model.sizes.na, Tangent::zero());
        Rest {
            reach: Reach::new(model),
            companions: (0..nv).map(|i| companions(model, i)).collect(),
            driven: true,
            state: State::new(&model.sizes),
            applied: None,
            varied: None,
            ws: Workspace::without_groups(model),
            qacc: vec![zero; nv],
            over: vec![zero; nv],
            inertial: vec![zero; nv],
            product: vec![zero; nv],
            act: vec![zero; na],
            found: Found { residual: vec![L::zero(); nv], excess: vec![L::zero(); nv], act: vec![L::zero(); na] },
        }
    }

    /// Takes over a state and what comes from outside, at rest.
    pub fn load(&mut self, model: Instance<'_, L>, state: &State<L>, applied: Option<&Applied<L>>, qacc: &[L]) {
        let still =
            |from: &[L], to: &mut [Tangent<L>]| to.iter_mut().zip(from).for_each(|(to, x)| *to = Tangent::still(*x));
        (0..State::<L>::COUNT).for_each(|n| still(state.field(n), self.state.field_mut(n)));
        self.applied = applied.map(|applied| {
            let mut own = Applied::new(&model.sizes);
            (0..Applied::<L>::COUNT).for_each(|n| still(applied.field(n), own.field_mut(n)));
            own
        });
        self.varied = model.varied.map(|varied| {
            let mut own = Varied::new(model.model, varied.set());
            varied.set().iter().for_each(|quantity| still(varied.lanes(quantity), own.lanes_mut(quantity)));
            own
        });
        still(qacc, &mut self.qacc);
    }

    /// The model as the worlds have it.
    pub fn instance<'a>(&'a self, model: &'a Model<L::Real>) -> Instance<'a, Tangent<L>> {
        Instance { model, varied: self.varied.as_ref() }
    }

    /// Moves position `dof` by the dual unit.
    pub fn move_position(&mut self, model: &Model<L::Real>, dof: usize) {
        let joint = &model.joints[model.dofs[dof].joint as usize];
        let (at, k) = (joint.qpos as usize, dof - joint.dof as usize);
        let turned = match joint.kind {
            JointKind::Free if k >= 3 => Some((at + 3, k - 3)),
            JointKind::Ball => Some((at, k)),
            _ => None,
        };
        let qpos = &mut self.state.qpos;
        let Some((at, axis)) = turned else {
            qpos[at + k].rate = L::one();
            return;
        };
        let q: [L; 4] = std::array::from_fn(|i| qpos[at + i].value);
        let mut half = [L::zero(); 4];
        half[1 + axis] = L::of(0.5);
        quat::mul(&q, &half).into_iter().zip(&mut qpos[at..]).for_each(|(rate, q)| q.rate += rate);
    }

    /// Puts everything back to rest.
    pub fn rest(&mut self) {
        let State { qpos, qvel, act, ctrl, .. } = &mut self.state;
        for x in [qpos, qvel, act, ctrl].into_iter().flatten() {
            x.rate = L::zero();
        }
    }

    /// Adds what the residual gains with accelerations by all rows but those of contacts, as they were last evaluated.
    pub fn stiffen(&mut self, model: &Model<L::Real>, hessian: &mut [L]) {
        let Rest { varied, ws, .. } = self;
        let model = Instance { model, varied: varied.as_ref() };
        let Workspace { position, tendons, inertia, acceleration, constraint, solver, .. } = ws;
        if constraint.is_empty() {
            return;
        }
        let mean_inertia = model.mean_inertia();
        let problem = solver::Problem { model, mean_inertia, position, tendons, inertia, acceleration, constraint };
        solver::stiffness_at(&problem, solver);
        hessian.iter_mut().zip(&solver.fields.hessian).for_each(|(sum, x)| *sum += x.value);
    }

    /// How many rows on joints and tendons, as they were last evaluated, are within [`EDGE`] of where they begin or cease to act, or to slide.
    pub fn edges(&self, model: &Model<L::Real>) -> L {
        let instance = Instance { model, varied: self.varied.as_ref() };
        let Workspace { constraint, solver, .. } = &self.ws;
        let mut count = L::zero();
        for (law, y) in constraint.dof_laws().zip(&solver.jp.dof) {
            let (d, reference, mut far) = (law.d().value, law.reference().value, y.value);
            let size = (y.value - reference).abs() + reference.abs();
            if law.row.kind == DofRowKind::Friction {
                far = y.value.abs()
                    - solver::joints::bound(instance, &law).value / L::select(d.gt(L::zero()), d, L::one());
            }
            let there = far.abs().le(L::of(EDGE) * size) & d.gt(L::zero());
            count += L::select(there, L::one(), L::zero());
        }
        count
    }

    /// Evaluates all that may have changed. Passive forces and rows do not change with inputs.
    pub fn evaluate(&mut self, model: &Model<L::Real>, from: Anew) {
        let reach = self.reach;
        let instance = Instance { model, varied: self.varied.as_ref() };
        smooth(instance, &self.state, self.applied.as_ref(), (reach, from), &mut self.ws);
        if from != Anew::Input {
            rows(instance, &self.state, &self.qacc, &mut self.ws);
        }
        let Workspace { inertia, passive, actuation, acceleration, solver, .. } = &self.ws;
        if reach.rigid {
            ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, &self.qacc, &mut self.inertial);
        }
        for (i, out) in self.found.residual.iter_mut().enumerate() {
            let actuated = if model.features.actuation { actuation.qfrc_actuator[i].rate } else { L::zero() };
            let follows = model.features.passive() && from != Anew::Input;
            let passive = if follows { passive.qfrc_passive[i].rate } else { L::zero() };
            let smooth = match (reach.rigid, self.driven) {
                (false, true) => passive + actuated,
                (false, false) => passive,
                (true, true) => acceleration.qfrc_smooth[i].rate,
                (true, false) => acceleration.qfrc_smooth[i].rate - actuated,
            };
            let inertial = if reach.rigid { self.inertial[i].rate } else { L::zero() };
            let rows = if from == Anew::Input { L::zero() } else { solver.fields.qfrc_constraint[i].rate };
            *out = inertial - (smooth + rows);
        }
        if super::is_implicit(model) {
            self.exceed(model);
        }
        let Actuation { act_dot, bent, .. } = &self.ws.actuation;
        actuation::activations(model, &self.state.act, (act_dot, bent), &mut self.act);
        self.found.act.iter_mut().zip(&self.act).for_each(|(out, x)| *out = x.rate);
    }

    /// (M - h D) a⁺ - M a of an implicit step; without M where rigid bodies are analytic.
    fn exceed(&mut self, model: &Model<L::Real>) {
        let Rest { reach, state, varied, ws, over, inertial, product, found, .. } = self;
        let model = Instance { model, varied: varied.as_ref() };
        let Workspace { position, tendons, inertia, velocity, actuation, derivative, .. } = ws;
        if model.options.integrator != Integrator::Euler {
            let stages = derivative::Stages { position, tendons, inertia, velocity, actuation };
            derivative::implicit(model, state, stages, derivative);
            derivative::multiply(&model, derivative, over, product);
        } else {
            product.fill(Tangent::zero());
            if reach.rigid {
                ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, over, product);
            }
            let h = Tangent::of(model.options.timestep);
            for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
                product[i] = (h * damper_slope(model, i, state.qvel[i])).mul_add(over[i], product[i]);
            }
        }
        for (i, out) in found.excess.iter_mut().enumerate() {
            *out = product[i].rate - if reach.rigid { inertial[i].rate } else { L::zero() };
        }
    }
}

/// The generalised force of all rows but those of contacts.
fn rows<L: Lane>(
    model: Instance<'_, Tangent<L>>,
    state: &State<Tangent<L>>,
    qacc: &[Tangent<L>],
    ws: &mut Workspace<Tangent<L>>,
) {
    let everywhere = L::Mask::splat(true);
    let Workspace { position, tendons, inertia, velocity, acceleration, constraint, solver, .. } = ws;
    if !constraint.dof_rows.is_empty() {
        let measured = constraint::Measured { qpos: &state.qpos, qvel: &state.qvel, tendons };
        constraint::dof_lanes(model, measured, everywhere, constraint);
        constraint.joint_lanes = u32::MAX;
    }
    if !model.equalities.is_empty() {
        let motion = constraint::Motion { position, velocity, tendons, qvel: &state.qvel };
        let read = (state.into(), &state.eq_active[..]);
        constraint::equality_rows(model, motion, read, everywhere, &mut constraint.equality);
        constraint.equality.lanes = u32::MAX;
    }
    let mean_inertia = model.mean_inertia();
    let problem = solver::Problem { model, mean_inertia, position, tendons, inertia, acceleration, constraint };
    solver::force_at(&problem, qacc, solver);
}

/// The smooth stages that may have changed and that matter.
fn smooth<L: Lane>(
    model: Instance<'_, Tangent<L>>,
    state: &State<Tangent<L>>,
    applied: Option<&Applied<Tangent<L>>>,
    (reach, from): (Reach, Anew),
    ws: &mut Workspace<Tangent<L>>,
) {
    let Workspace { position, tendons, inertia, velocity, passive, actuation, acceleration, .. } = ws;
    let (places, rates) = (from <= Anew::Position, from <= Anew::Velocity);
    if reach.places && places {
        position::kinematics(model, state.into(), position);
    }
    if rates && !model.tendons.is_empty() {
        tendon::tendons(&model, position, &state.qpos, &state.qvel, tendons);
    }
    if reach.rigid && places {
        inertia::crb(model, position, tendons, inertia);
    }
    if reach.rigid && rates {
        velocity::rne(model, (position, tendons, inertia), &state.qvel, velocity);
    }
    if rates && model.features.passive() {
        let stages = passive::Stages { position, tendons, velocity };
        passive::passive(model, stages, state, passive);
    }
    if from <= Anew::Input && !model.actuators.is_empty() {
        actuation::actuation(model, state, (position, tendons, passive), actuation);
    }
    if reach.rigid && from <= Anew::Input {
        acceleration::smooth_force(&model, position, velocity, passive, actuation, applied, acceleration);
    }
}
