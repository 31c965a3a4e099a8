//! The stages, from top to bottom, and the commit of what follows from them.

use crate::acceleration;
use crate::actuation;
use crate::collision::ConvexCollider;
use crate::constraint::{self, Metric, Motion};
use crate::derivative;
use crate::double;
use crate::drivers::{self, collision, solver};
use crate::history;
use crate::lane::LaneQuery;
use crate::model::{Instance, Model, Varied};
use crate::options::Integrator;
use crate::part::{Executor, KICKED, Kernels, Op, Part, Step};
use crate::sensor;
use crate::smooth::Findings;
pub use crate::stage::{Stage, StageClock, Stages, Start};
use crate::state::{Applied, BlockStatus, State, Status};
use crate::workspace::{Double, Workspace};

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
    pub convex: &'a dyn ConvexCollider,
    /// The stages that are wanted. A step runs all that it needs anyway; no stage runs for which the model has nothing.
    pub stages: Stages,
    /// Whether the solver's residual is wanted.
    pub residual: bool,
    /// Who runs the parts.
    pub executor: &'a mut dyn Executor<L>,
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

/// The stages that are wanted, from the block's state, for the lanes that are alive. The state stays as it is. What stages would do
/// that are not wanted is as it was left (see [`Start`]).
pub fn forward<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) -> Solved {
    let model = Instance { model, varied: run.varied };
    let mut clock = run.clock.take();
    let step = &mut Step { model, state, applied: run.applied, ws, stages: run.stages, clock: clock.as_deref_mut() };
    let solved = evaluate(step, run, status);
    run.clock = clock;
    solved
}

fn evaluate<L: LaneQuery>(step: &mut Step<'_, L>, run: &mut Run<'_, L>, status: &mut BlockStatus) -> Solved {
    let alive = status.alive;
    let findings = smooth(step, run);
    status.record(Status::BAD_CTRL, findings.bad_controls & alive);
    status.record(Status::SINGULAR_INERTIA, findings.singular & alive);
    if step.runs(Stage::Energy) {
        run.executor.run(Part::new(Op::Energy), 0, &mut [], step);
        step.end(Stage::Energy);
    }
    if step.runs(Stage::Collision) {
        if findings.due & alive == 0 {
            // Where no test is due, no pair is near.
            step.ws.collision.slots.clear();
        } else {
            let overflow = collision::collide(step, alive, run.max_contacts, run.convex, run.executor);
            status.record(Status::CONTACT_OVERFLOW, overflow & alive);
        }
        step.end(Stage::Collision);
    }
    let findings = if step.model.features.adhesion { adhere(step, findings) } else { findings };
    if step.runs(Stage::Constraint) {
        let idle = step.ws.collision.slots.is_empty() && findings.joint_rows & alive == 0;
        if drivers::constraint::equalities(step, alive, run.executor) == 0 && idle {
            step.ws.constraint.clear();
        } else {
            drivers::constraint::rows(step, alive, run.executor);
            if !step.model.belts.is_empty() {
                let Workspace { position, collision, constraint, .. } = &mut *step.ws;
                constraint::drive(step.model, position, collision, constraint);
            }
            discretise(step);
        }
        step.end(Stage::Constraint);
    }
    let mut solved = Solved { lanes: alive & !findings.wild, unfinished: 0 };
    if step.runs(Stage::Solver) {
        let stiff = L::bits(double::lanes(&step.ws.constraint)) & solved.lanes;
        let unfinished = solver::solve(step, solved.lanes & !stiff, (run.residual, run.keep), run.executor);
        solved.unfinished = unfinished & solved.lanes;
        release(step);
        if stiff != 0 {
            let given = double::Given { applied: run.applied, varied: run.varied, keep: run.keep };
            let evaluate = |double: &mut Double, count| in_double(double, run, count);
            solved.unfinished |= double::forward(step.model.model, step.state, given, stiff, step.ws, evaluate);
        }
        step.end(Stage::Solver);
    }
    if step.runs(Stage::Sensor) {
        run.executor.run(Part::new(Op::Sensor), 0, &mut [], step);
        let Step { model, state, applied, ws, .. } = step;
        let (stages, energy, sensors) = ws.sensing();
        sensor::measure_rows(*model, state, *applied, run.convex, (stages, energy), sensors);
        history::tell(model, state, sensors);
        step.end(Stage::Sensor);
    }
    solved
}

/// Evaluates the first worlds of those that were gathered; returns those whose solver reached the limit of iterations.
fn in_double<L>(double: &mut Double, run: &Run<'_, L>, count: usize) -> u32 {
    let Double { model, state, applied, varied, workspace } = double;
    let mut own = Run {
        applied: applied.as_ref().filter(|_| run.applied.is_some()),
        varied: varied.as_ref().filter(|_| run.varied.is_some()),
        clock: None,
        max_contacts: run.max_contacts,
        convex: run.convex,
        // Of a step, its kick.
        stages: match run.stages.has(Stage::Integration) {
            true => Stages::up_to(Stage::Integration),
            false => Stages::up_to(Stage::Solver),
        },
        residual: true,
        executor: &mut Kernels,
        keep: run.keep,
    };
    let mut status = BlockStatus { alive: (1 << count) - 1, ..BlockStatus::default() };
    forward(model, state, &mut own, &mut status, workspace).unfinished
}

/// Once contacts are known, the actuators that act by them, and the smooth acceleration with these.
fn adhere<L: LaneQuery>(step: &mut Step<'_, L>, mut findings: Findings<u32>) -> Findings<u32> {
    let (model, accelerates, solves) = (step.model, step.runs(Stage::Acceleration), step.runs(Stage::Solver));
    if !step.runs(Stage::Actuation) {
        return findings;
    }
    let Workspace { position, tendons, inertia, velocity, passive, actuation, acceleration, collision, .. } =
        &mut *step.ws;
    actuation::bodies(model, &step.state.qvel, (position, passive, collision), actuation);
    if accelerates {
        acceleration::smooth_force(&model, position, velocity, passive, actuation, step.applied, acceleration);
        acceleration::smooth_acceleration(model, (position, tendons, inertia), None, acceleration);
        if solves {
            findings.wild = L::bits(acceleration::wild(&acceleration.qacc_smooth));
        }
    }
    step.end(Stage::Acceleration);
    findings
}

/// What the solver has in place of the inertia; of a discrete step, the rows where it ends.
fn discretise<L: LaneQuery>(step: &mut Step<'_, L>) {
    let Workspace { position, tendons, velocity, inertia, derivative, collision, constraint, metric, .. } =
        &mut *step.ws;
    if let Some(metric) = metric {
        metric.m.copy_from_slice(&derivative.metric);
        if step.model.options.integrator != Integrator::Discrete {
            return;
        }
        let motion = Motion { position, velocity, tendons, qvel: &step.state.qvel };
        let metric = Metric { inertia: &inertia.m, step: &derivative.metric };
        constraint::discretise(step.model, motion, metric, collision, constraint);
    }
}

/// Of a discrete step, what free bodies gain that nothing holds.
fn release<L: LaneQuery>(step: &mut Step<'_, L>) {
    let (model, ws) = (step.model.model, &mut *step.ws);
    if model.options.integrator == Integrator::Discrete {
        let Workspace { derivative, constraint, acceleration, integration, solver, .. } = ws;
        let held = |dof: usize| constraint::held(model, constraint, dof);
        let forces = (&acceleration.qfrc_smooth[..], &mut integration.qacc[..]);
        derivative::release(model, derivative, &held, forces, &mut solver.fields.qacc);
    }
}

/// The stages that do without constraints; without an executor where not all of them are wanted.
fn smooth<L: LaneQuery>(step: &mut Step<'_, L>, run: &mut Run<'_, L>) -> Findings<u32> {
    history::recall(step.model.model, step.state, &mut step.ws.actuation.told);
    let start = Start::of(step.stages) as u32;
    let own = u32::from(run.applied.is_some()) | u32::from(run.keep) << 1 | start << 2;
    let kicks = step.ws.kick.is_some() && step.stages.has(Stage::Integration);
    let part = Part::of(Op::Smooth, if kicks { KICKED + own } else { own });
    let mut found = [0; 5];
    if step.runs(Stage::Acceleration) {
        run.executor.run(part, 0, &mut found, step);
        step.end(Stage::Acceleration);
    } else {
        Executor::<L>::run(&mut Kernels, part, 0, &mut found, step);
    }
    found.into()
}
