//! A step, from top to bottom.

use std::time::{Duration, Instant};

use crate::lane::{LaneQuery, Mask, Real};
use crate::model::Model;
use crate::state::{Applied, BlockStatus, State, Status};
use crate::workspace::Workspace;
use crate::{
    acceleration, actuation, collision, constraint, energy, inertia, integration, passive, position, solver, velocity,
};

/// The stages of a step, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // each variant is the module of the same name
pub enum Stage {
    Position,
    Inertia,
    Collision,
    Velocity,
    Constraint,
    Passive,
    Actuation,
    Acceleration,
    Solver,
    Integration,
}

impl Stage {
    /// All stages, with their names.
    pub const ALL: [(Stage, &'static str); 10] = [
        (Stage::Position, "position"),
        (Stage::Inertia, "inertia"),
        (Stage::Collision, "collision"),
        (Stage::Velocity, "velocity"),
        (Stage::Constraint, "constraint"),
        (Stage::Passive, "passive"),
        (Stage::Actuation, "actuation"),
        (Stage::Acceleration, "acceleration"),
        (Stage::Solver, "solver"),
        (Stage::Integration, "integration"),
    ];
}

/// Where the time of steps goes.
#[derive(Clone, Debug)]
pub struct StageClock {
    last: Instant,
    /// Time per stage, in the order of [`Stage::ALL`].
    pub spent: [Duration; Stage::ALL.len()],
}

impl Default for StageClock {
    fn default() -> Self {
        StageClock { last: Instant::now(), spent: [Duration::ZERO; Stage::ALL.len()] }
    }
}

impl StageClock {
    /// Begins a step.
    fn start(&mut self) {
        self.last = Instant::now();
    }

    /// Ends a stage.
    fn end(&mut self, stage: Stage) {
        let now = Instant::now();
        self.spent[stage as usize] += now - self.last;
        self.last = now;
    }
}

/// How the caller wants a block to be run.
pub struct Run<'a, L> {
    /// Forces from outside, if there are any.
    pub applied: Option<&'a Applied<L>>,
    /// Clock, if stages are to be timed.
    pub clock: Option<&'a mut StageClock>,
    /// Largest number of contacts of a world.
    pub max_contacts: usize,
    /// Collider of the convex pairs without a formula.
    pub convex: &'a dyn collision::ConvexCollider,
}

/// Everything up to the acceleration, from the block's state, for the lanes that are alive.
pub fn forward<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) {
    let alive = L::mask_of(status.alive);
    let mut clock = run.clock.as_deref_mut();
    let mut end = |stage| {
        if let Some(clock) = &mut clock {
            clock.end(stage);
        }
    };
    position::kinematics(model, &state.qpos, &mut ws.position);
    end(Stage::Position);
    inertia::crb(model, &ws.position, &mut ws.inertia);
    end(Stage::Inertia);
    let overflow = collision::collide(model, &ws.position, alive, run.max_contacts, run.convex, &mut ws.collision);
    end(Stage::Collision);
    velocity::rne(model, &ws.position, &ws.inertia, &state.qvel, &mut ws.velocity);
    end(Stage::Velocity);
    constraint::dof_rows(model, &state.qpos, &state.qvel, alive, &mut ws.constraint);
    constraint::contact_rows(model, &ws.position, &ws.velocity, &ws.collision, &state.qvel, &mut ws.constraint);
    end(Stage::Constraint);
    passive::passive(model, &ws.position, &state.qpos, &state.qvel, &mut ws.passive);
    end(Stage::Passive);
    // Lengths are there to be read even where actuation is off.
    actuation::transmission(model, &state.qpos, &mut ws.actuation);
    if model.features.actuation {
        let bad = actuation::actuation(model, &state.ctrl, &state.qvel, &ws.passive, &mut ws.actuation);
        status.record(Status::BAD_CTRL, L::bits(bad & alive));
    }
    end(Stage::Actuation);
    acceleration::smooth_force(
        model,
        &ws.position,
        &ws.velocity,
        &ws.passive,
        &ws.actuation,
        run.applied,
        &mut ws.acceleration,
    );
    let singular = acceleration::smooth_acceleration(model, &ws.inertia, &mut ws.acceleration);
    end(Stage::Acceleration);
    let unfinished = solve(model, state, alive, ws);
    end(Stage::Solver);
    status.record(Status::CONTACT_OVERFLOW, L::bits(overflow & alive));
    status.record(Status::SINGULAR_INERTIA, L::bits(singular & alive));
    status.record(Status::NOT_CONVERGED, L::bits(unfinished & alive));
}

/// The constrained acceleration; the smooth one if no row acts in any world. Returns the lanes left unconverged.
fn solve<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, alive: L::Mask, ws: &mut Workspace<L>) -> L::Mask {
    if ws.constraint.is_empty() {
        ws.solver.fields.qacc.copy_from_slice(&ws.acceleration.qacc_smooth);
        ws.solver.fields.qfrc_constraint.fill(L::zero());
        ws.solver.statistics = solver::Statistics { niter: L::zero(), block_niter: 0 };
        return L::Mask::splat(false);
    }
    let problem = solver::Problem {
        model,
        position: &ws.position,
        inertia: &ws.inertia,
        acceleration: &ws.acceleration,
        constraint: &ws.constraint,
    };
    solver::solve(&problem, &state.qacc_warmstart, alive, &mut ws.solver)
}

/// Energies of the state for which [`forward`] was called.
pub fn energy<L: LaneQuery>(model: &Model<L::Real>, state: &State<L>, ws: &mut Workspace<L>) {
    energy::energy(model, &ws.position, &ws.inertia, &state.qpos, &state.qvel, &mut ws.energy);
}

/// One step: forward, integrate, check, commit. A world whose next state would not be finite, or huge, keeps its last
/// state and is frozen.
pub fn step<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    ws: &mut Workspace<L>,
) {
    if let Some(clock) = &mut run.clock {
        clock.start();
    }
    forward(model, state, run, status, ws);
    integration::euler(
        model,
        &ws.inertia,
        &state.qpos,
        &state.qvel,
        &ws.solver.fields.qacc,
        [&ws.acceleration.qfrc_smooth, &ws.solver.fields.qfrc_constraint],
        &mut ws.integration,
    );
    commit(model, state, status, ws);
    if let Some(clock) = &mut run.clock {
        clock.end(Stage::Integration);
    }
}

/// Replaces the state by the next one in the lanes that are alive and whose next state is usable.
fn commit<L: LaneQuery>(model: &Model<L::Real>, state: &mut State<L>, status: &mut BlockStatus, ws: &Workspace<L>) {
    let next = &ws.integration;
    let qacc = &ws.solver.fields.qacc;
    let mut good = L::mask_of(status.alive);
    for x in next.qpos.iter().chain(&next.qvel).chain(qacc) {
        good = good & x.within(L::Real::MAXVAL);
    }
    let lost = status.alive & !L::bits(good);
    if lost != 0 {
        diagnose(state, ws, lost, status);
    }
    let replace = |old: &mut [L], new: &[L]| {
        for (old, new) in old.iter_mut().zip(new) {
            *old = L::select(good, *new, *old);
        }
    };
    replace(&mut state.qpos, &next.qpos);
    replace(&mut state.qvel, &next.qvel);
    for (i, warm) in state.qacc_warmstart.iter_mut().enumerate() {
        *warm = L::select(good, qacc[i] - ws.acceleration.qacc_smooth[i] + L::zero(), *warm);
    }
    let time = state.time[0] + L::of(model.options.timestep);
    replace(&mut state.time, &[time]);
}

/// Freezes the given lanes and records why: a bad state, a bad acceleration, or a value too large.
fn diagnose<L: LaneQuery>(state: &State<L>, ws: &Workspace<L>, lost: u32, status: &mut BlockStatus) {
    let bits_where = |values: &[L], test: fn(L) -> L::Mask| values.iter().fold(0, |bits, x| bits | L::bits(test(*x)));
    let not_finite = |x: L| !x.within(L::Real::MAX);
    let huge = |x: L| x.within(L::Real::MAX) & !x.within(L::Real::MAXVAL);
    let (next, qacc) = (&ws.integration, &ws.solver.fields.qacc);
    let pos = bits_where(&state.qpos, not_finite) & lost;
    let vel = bits_where(&state.qvel, not_finite) & lost & !pos;
    let acc = (bits_where(qacc, not_finite) | bits_where(&next.qvel, not_finite)) & lost & !pos & !vel;
    let large = [&next.qpos, &next.qvel, qacc].iter().fold(0, |bits, x| bits | bits_where(x, huge)) & lost;
    status.record(Status::NON_FINITE_POS, pos);
    status.record(Status::NON_FINITE_VEL, vel);
    status.record(Status::NON_FINITE_ACC, acc);
    status.record(Status::HUGE_VALUE, large & !pos & !vel & !acc);
    status.record(Status::FROZEN, lost);
    status.alive &= !lost;
}
