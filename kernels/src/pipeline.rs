//! The stages, from top to bottom, and the commit of what follows from them.

use crate::acceleration::Acceleration;
use crate::actuation::Actuation;
use crate::code::Code;
use crate::collision::Colliders;
use crate::derivative::Derivative;
use crate::inertia::Inertia;
use crate::integration::Integration;
use crate::lane::{Lane, LaneQuery, Mask, Real};
use crate::model::{Instance, Model, Varied};
use crate::options::Integrator;
use crate::passive::Passive;
use crate::position::Position;
pub use crate::stage::{Stage, StageClock, Stages};
use crate::state::{Applied, BlockStatus, State, Status};
use crate::velocity::Velocity;
use crate::workspace::Workspace;
use crate::{
    acceleration, actuation, collision, constraint, derivative, double, energy, inertia, passive, position, solver,
    velocity,
};

/// How the caller wants a block to be run.
pub struct Run<'a, L> {
    /// Forces from outside, if there are any.
    pub applied: Option<&'a Applied<L>>,
    /// Numbers of the model that vary from world to world, if any do.
    pub varied: Option<&'a Varied<L>>,
    /// Clock, if stages are to be timed.
    pub clock: Option<&'a mut StageClock>,
    /// Largest number of contacts of a world.
    pub max_contacts: usize,
    /// Collider of the convex pairs without a formula.
    pub convex: &'a dyn collision::ConvexCollider,
    /// The stages that are wanted. A step runs all that it needs anyway; no stage runs for which the model has nothing.
    pub stages: Stages,
    /// Whether the solver's residual is wanted.
    pub residual: bool,
    /// Code made for the model, if there is any.
    pub code: &'a mut dyn Code<L>,
    /// Whether somebody reads what the stages leave.
    pub keep: bool,
}

/// What the solver made of a block's worlds, as bits.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// Worlds with which it could work; all that are alive, if it was not wanted.
    pub lanes: u32,
    /// Those of them in which it reached its limit of iterations.
    pub unfinished: u32,
}

/// The stages that are wanted, from the block's state, for the lanes that are alive.
pub fn forward<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) -> Solved {
    let alive = L::mask_of(status.alive);
    let instance = Instance { model, varied: run.varied };
    let stages = run.stages;
    let runs = |stage: Stage| stages.has(stage) && stage.present(model);
    let mut clock = run.clock.as_deref_mut();
    let mut end = |stage| {
        if let Some(clock) = &mut clock {
            clock.end(stage);
        }
    };
    let outside = (run.applied, run.varied);
    // Rows of equality constraints read accelerations of links, which no other part of a step does.
    let linked = !model.equalities.is_empty();
    let keep = run.keep || linked;
    let coded = if runs(Stage::Acceleration) { run.code.smooth(state, outside, keep, ws) } else { None };
    let findings = match coded {
        Some(findings) => {
            end(Stage::Acceleration);
            findings
        }
        None => smooth(instance, state, run.applied, &runs, ws.smooth(), &mut end).map(L::bits),
    };
    status.record(Status::BAD_CTRL, findings.bad_controls & status.alive);
    status.record(Status::SINGULAR_INERTIA, findings.singular & status.alive);
    if runs(Stage::Energy) {
        energy::energy(instance, &ws.position, &ws.inertia, &state.qpos, &state.qvel, &mut ws.energy);
        end(Stage::Energy);
    }
    if runs(Stage::Collision) && findings.due & status.alive == 0 {
        // Where no test is due, no pair is near.
        ws.collision.slots.clear();
        end(Stage::Collision);
    } else if runs(Stage::Collision) {
        let (most, code) = (run.max_contacts, &mut *run.code);
        let overflow =
            collision::collide(model, (&state.qpos, &ws.position), alive, most, run.convex, code, &mut ws.collision);
        status.record(Status::CONTACT_OVERFLOW, L::bits(overflow & alive));
        end(Stage::Collision);
    }
    let motion = constraint::Motion { position: &ws.position, velocity: &ws.velocity, qvel: &state.qvel };
    if runs(Stage::Constraint) && linked {
        let (read, out) = ((&state.qpos[..], &state.eq_active[..]), &mut ws.constraint.equality);
        constraint::equality_rows(instance, motion, read, alive, out);
    }
    let idle = ws.collision.slots.is_empty() && findings.joint_rows & status.alive == 0;
    if runs(Stage::Constraint) && idle && ws.constraint.equality.is_empty() {
        ws.constraint.clear();
        end(Stage::Constraint);
    } else if runs(Stage::Constraint) {
        if !run.code.dof_rows(state, run.varied, &mut ws.constraint) {
            constraint::dof_rows(instance, &state.qpos, &state.qvel, alive, &mut ws.constraint);
        }
        constraint::contact_rows(instance, motion, &ws.collision, run.code, &mut ws.constraint);
        if let Some(metric) = &mut ws.metric {
            metric.m.copy_from_slice(&ws.derivative.metric);
            let metric = constraint::Metric { inertia: &ws.inertia.m, step: &ws.derivative.metric };
            constraint::discretise(instance, motion, metric, &ws.collision, &mut ws.constraint);
        }
        end(Stage::Constraint);
    }
    let mut solved = Solved { lanes: status.alive & !findings.wild, unfinished: 0 };
    if runs(Stage::Solver) {
        let tame = L::mask_of(solved.lanes);
        let stiff = double::lanes(&ws.constraint) & tame;
        let unfinished = solve(instance, state, tame & !stiff, (run.residual, run.keep), run.code, ws);
        solved.unfinished = L::bits(unfinished & tame);
        if ws.metric.is_some() {
            let Workspace { derivative, constraint, acceleration, integration, solver, .. } = &mut *ws;
            let held = |dof: usize| constraint::held(model, constraint, dof);
            let forces = (&acceleration.qfrc_smooth[..], &mut integration.qacc[..]);
            derivative::release(model, derivative, &held, forces, &mut solver.fields.qacc);
        }
        let stiff = L::bits(stiff);
        if stiff != 0 {
            let Run { applied, varied, max_contacts, convex, keep, .. } = *run;
            let given = double::Given { applied, varied, max_contacts, convex, keep };
            solved.unfinished |= double::forward(model, state, given, stiff, ws);
        }
        end(Stage::Solver);
    }
    solved
}

/// The stages that do without constraints, borrowed from where they are.
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Smooth<'a, L> {
    pub position: &'a mut Position<L>,
    pub inertia: &'a mut Inertia<L>,
    pub velocity: &'a mut Velocity<L>,
    pub passive: &'a mut Passive<L>,
    pub actuation: &'a mut Actuation<L>,
    pub acceleration: &'a mut Acceleration<L>,
    pub derivative: &'a mut Derivative<L>,
    pub colliders: &'a mut Colliders<L>,
}

impl<L> Smooth<'_, L> {
    /// Borrowed for a shorter time.
    pub fn borrow(&mut self) -> Smooth<'_, L> {
        let Smooth { position, inertia, velocity, passive, actuation, acceleration, derivative, colliders } = self;
        Smooth { position, inertia, velocity, passive, actuation, acceleration, derivative, colliders }
    }
}

/// What the smooth stages find, world by world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Findings<M> {
    /// Controls are unusable.
    pub bad_controls: M,
    /// The inertia matrix is singular.
    pub singular: M,
    /// Bounding tests of pairs are due.
    pub due: M,
    /// Some row on a joint may act.
    pub joint_rows: M,
    /// The smooth acceleration is beyond what a solver can work with (see [`acceleration::wild`]): the world is lost.
    pub wild: M,
}

impl<M> Findings<M> {
    /// The same in other terms.
    pub fn map<N>(self, f: impl Fn(M) -> N) -> Findings<N> {
        let [bad_controls, singular, due, joint_rows, wild] = <[M; 5]>::from(self).map(f);
        Findings { bad_controls, singular, due, joint_rows, wild }
    }
}

impl<M> From<[M; 5]> for Findings<M> {
    fn from([bad_controls, singular, due, joint_rows, wild]: [M; 5]) -> Self {
        Findings { bad_controls, singular, due, joint_rows, wild }
    }
}

impl<M> From<Findings<M>> for [M; 5] {
    fn from(findings: Findings<M>) -> Self {
        let Findings { bad_controls, singular, due, joint_rows, wild } = findings;
        [bad_controls, singular, due, joint_rows, wild]
    }
}

/// From positions to the smooth acceleration and what integrates it implicitly, how far geoms moved, and where rows on joints act: those of its stages for which
/// `runs` holds. Calls `end` after each.
pub fn smooth<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    applied: Option<&Applied<L>>,
    runs: &dyn Fn(Stage) -> bool,
    stages: Smooth<'_, L>,
    end: &mut dyn FnMut(Stage),
) -> Findings<L::Mask> {
    let Smooth { position, inertia, velocity, passive, actuation, acceleration, derivative, colliders } = stages;
    let mut findings = Findings::from([L::Mask::splat(false); 5]);
    position::kinematics(model, &state.qpos, position);
    end(Stage::Position);
    if runs(Stage::Collision) {
        findings.due = collision::way(&model, &state.qpos, position, colliders);
        end(Stage::Collision);
    }
    if runs(Stage::Constraint) {
        findings.joint_rows = constraint::joint_rows(&model, &state.qpos, &state.qvel);
        end(Stage::Constraint);
    }
    if runs(Stage::Inertia) {
        inertia::crb(model, position, inertia);
        end(Stage::Inertia);
    }
    if runs(Stage::Velocity) {
        velocity::rne(model, position, inertia, &state.qvel, velocity);
        end(Stage::Velocity);
    }
    if runs(Stage::Passive) {
        passive::passive(model, (position, velocity), &state.qpos, &state.qvel, passive);
        end(Stage::Passive);
    }
    if runs(Stage::Actuation) {
        findings.bad_controls = actuation::actuation(model, state, passive, actuation);
        end(Stage::Actuation);
    }
    let discrete = model.options.integrator == Integrator::Discrete;
    if runs(Stage::Derivative) {
        let stages = derivative::Stages { position, inertia, velocity, actuation };
        derivative::implicit(model, state, stages, derivative);
        derivative::factor(&model, derivative);
        end(Stage::Derivative);
    }
    if runs(Stage::Acceleration) {
        acceleration::smooth_force(&model, position, velocity, passive, actuation, applied, acceleration);
        let metric = discrete.then_some(&derivative.metric[..]);
        if discrete {
            acceleration.qfrc_smooth.iter_mut().zip(&derivative.pull).for_each(|(force, pull)| *force -= *pull);
        }
        findings.singular = acceleration::smooth_acceleration(model, position, inertia, metric, acceleration);
        if runs(Stage::Solver) {
            findings.wild = acceleration::wild(&acceleration.qacc_smooth);
        }
        end(Stage::Acceleration);
    }
    findings
}

/// The constrained acceleration; the smooth one if no row acts in any world. Returns the lanes left unconverged.
fn solve<L: LaneQuery>(
    model: Instance<'_, L>,
    state: &State<L>,
    alive: L::Mask,
    (residual, keep): (bool, bool),
    code: &mut dyn Code<L>,
    ws: &mut Workspace<L>,
) -> L::Mask {
    if ws.constraint.is_empty() {
        ws.solver.fields.qacc.copy_from_slice(&ws.acceleration.qacc_smooth);
        ws.solver.fields.qfrc_constraint.fill(L::zero());
        ws.solver.statistics = solver::Statistics::none();
        return L::Mask::splat(false);
    }
    let problem = solver::Problem {
        model: model.model,
        mean_inertia: model.mean_inertia(),
        position: &ws.position,
        inertia: ws.metric.as_deref().unwrap_or(&ws.inertia),
        acceleration: &ws.acceleration,
        constraint: &ws.constraint,
    };
    let unfinished = solver::solve(&problem, &state.qacc_warmstart, alive, keep, code, &mut ws.solver);
    if residual {
        solver::measure_residual(&problem, &mut ws.solver);
    }
    unfinished
}

/// Replaces the state by the next one in the lanes of `alive` whose next state is usable, and returns these. `qacc` is the
/// acceleration with constraints and the smooth one. Adding `zero`, which is 0, turns a negative zero into a positive one, so that the
/// sign of a zero that a wider factor, an inactive contact or code may have left never reaches the state; whoever records must
/// not let it be known that it is 0, or the sum would be left out.
pub fn commit<L: Lane>(
    model: &Model<L::Real>,
    next: &Integration<L>,
    [qacc, qacc_smooth]: [&[L]; 2],
    zero: L,
    alive: L::Mask,
    state: &mut State<L>,
) -> L::Mask {
    let good = qacc.iter().fold(next.usable(alive), |good, a| good & a.within(L::Real::MAXVAL));
    replace(model, next, [qacc, qacc_smooth], zero, good, state);
    good
}

/// Replaces the state by the next one in the lanes of `good`; arguments as of [`commit`].
pub fn replace<L: Lane>(
    model: &Model<L::Real>,
    next: &Integration<L>,
    [qacc, qacc_smooth]: [&[L]; 2],
    zero: L,
    good: L::Mask,
    state: &mut State<L>,
) {
    let replace = |old: &mut [L], new: &[L]| {
        for (old, new) in old.iter_mut().zip(new) {
            *old = L::select(good, *new + zero, *old);
        }
    };
    replace(&mut state.qpos, &next.qpos);
    replace(&mut state.qvel, &next.qvel);
    for (i, warm) in state.qacc_warmstart.iter_mut().enumerate() {
        *warm = L::select(good, qacc[i] - qacc_smooth[i] + zero, *warm);
    }
    let time = state.time[0] + L::of(model.options.timestep);
    replace(&mut state.time, &[time]);
}
