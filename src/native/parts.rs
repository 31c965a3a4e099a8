//! The parts of a step for which code is made: what each reads and writes, and recording it.

use lanesim_codegen::{Float, Program, Recorder, Recording};
use lanesim_kernels::acceleration::Acceleration;
use lanesim_kernels::actuation::Actuation;
use lanesim_kernels::collision::Colliders;
use lanesim_kernels::constraint::Constraint;
use lanesim_kernels::inertia::Inertia;
use lanesim_kernels::integration::{self, Integration};
use lanesim_kernels::lane::Lane;
use lanesim_kernels::model::{Model, Pattern};
use lanesim_kernels::options;
use lanesim_kernels::passive::Passive;
use lanesim_kernels::pipeline::{self, Smooth};
use lanesim_kernels::position::Position;
use lanesim_kernels::solver::{self, Arrival, Problem, Solver};
use lanesim_kernels::stage::Stage;
use lanesim_kernels::state::{Applied, State};
use lanesim_kernels::velocity::Velocity;

/// Which of the smooth stages' code: without or with forces from outside, for steps alone or for whoever reads fields.
#[derive(Clone, Copy, Debug)]
pub struct SmoothKind {
    pub applied: bool,
    pub keep: bool,
}

/// Part of the solver, on its fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverPart {
    Motion,
    Curve,
    /// With the inertia matrix's pattern, or with all that contacts between branches may fill in.
    Descend {
        filled: bool,
    },
    /// The direction from the factor at hand.
    Polish {
        filled: bool,
    },
    Gather,
}

/// Most fields of the solver that a part works on.
pub const SOLVER_FIELDS: usize = 9;

impl SolverPart {
    /// The solver's fields that it works on, and how many of the first of them it changes.
    #[inline(always)]
    pub fn fields<L: Lane>(self, solver: &mut Solver<L>) -> ([&mut [L]; SOLVER_FIELDS], usize) {
        let Solver { search, msearch, along, step, hessian, inverse, gradient, qfrc_constraint, qacc, ma, .. } = solver;
        let twist = solver.twist.as_flattened_mut();
        let (stiffness, wrench) = (solver.stiffness.as_flattened_mut(), solver.wrench.as_flattened_mut());
        let no = || -> &mut [L] { &mut [] };
        match self {
            SolverPart::Motion => ([msearch, along, twist, search, ma, gradient, no(), no(), no()], 3),
            SolverPart::Curve => ([hessian, stiffness, no(), no(), no(), no(), no(), no(), no()], 1),
            SolverPart::Descend { .. } => ([search, msearch, along, twist, hessian, inverse, gradient, ma, no()], 6),
            SolverPart::Polish { .. } => ([search, msearch, along, twist, hessian, inverse, gradient, ma, no()], 4),
            SolverPart::Gather => ([qfrc_constraint, gradient, qacc, ma, wrench, search, msearch, along, step], 4),
        }
    }
}

impl SolverPart {
    /// Multiplications, about: what decides whether straight-line code is small enough.
    pub fn operations<T>(self, model: &Model<T>) -> usize {
        match self {
            SolverPart::Motion => model.sizes.nm,
            SolverPart::Curve => 8 * model.sizes.nm,
            SolverPart::Descend { filled } => work_of_factor(model, filled),
            SolverPart::Polish { .. } => 2 * model.sizes.nm,
            SolverPart::Gather => 12 * model.sizes.nv,
        }
    }
}

/// Fields of the smooth stages that the code writes: all, or those that later parts of a step read.
pub fn smooth_fields<'a, L: Lane, T>(
    model: &Model<T>,
    keep: bool,
    stages: Smooth<'a, L>,
    f: &mut dyn FnMut(&'a mut [L]),
) {
    let Smooth { position, inertia, velocity, passive, actuation, acceleration, colliders } = stages;
    f(colliders.pos.as_flattened_mut());
    f(&mut colliders.way);
    if keep {
        position.for_each(&mut |field| f(field.data));
        inertia.for_each(&mut |field| f(field.data));
        velocity.for_each(&mut |field| f(field.data));
        passive.for_each(&mut |field| f(field.data));
        actuation.for_each(&mut |field| f(field.data));
        acceleration.for_each(&mut |field| f(field.data));
        return;
    }
    f(position.origin.as_flattened_mut());
    f(position.pos.as_flattened_mut());
    f(position.rot.as_flattened_mut());
    f(position.cdof.as_flattened_mut());
    f(velocity.cvel.as_flattened_mut());
    f(&mut inertia.m);
    f(&mut acceleration.qfrc_smooth);
    f(&mut acceleration.qacc_smooth);
    f(&mut acceleration.inverse);
    // Newton's method has a factor of its own.
    if model.options.solver != options::Solver::Newton || model.options.noslip_iterations > 0 {
        f(&mut acceleration.factor);
    }
}

/// A recording, and the number of its next field.
struct Binder<T: Float> {
    recording: Recording<T>,
    next: usize,
}

impl<T: Float> Binder<T> {
    fn new() -> Self {
        Binder { recording: Recording::new(), next: 0 }
    }

    /// Makes the lanes those of the next field; returns its number.
    fn input(&mut self, lanes: &mut [Recorder<T>]) -> usize {
        let field = self.next;
        lanes.copy_from_slice(&self.recording.input(field, lanes.len()));
        self.next += 1;
        field
    }
}

/// Fields: qpos, qvel, ctrl; forces from outside, if any; those of [`smooth_fields`]. Masks: bad controls, singular inertia.
pub fn smooth<T: Float>(model: &Model<T>, kind: SmoothKind) -> Program<T> {
    let mut binder = Binder::new();
    let mut state = State::<Recorder<T>>::new(&model.sizes);
    for lanes in [&mut state.qpos, &mut state.qvel, &mut state.ctrl] {
        binder.input(lanes);
    }
    let applied = kind.applied.then(|| {
        let mut applied = Applied::new(&model.sizes);
        applied.for_each(&mut |field| {
            binder.input(field.data);
        });
        applied
    });
    let mut position = Position::new(&model.sizes);
    let mut inertia = Inertia::new(&model.sizes);
    let mut velocity = Velocity::new(&model.sizes);
    let mut passive = Passive::new(&Stage::Passive.sizes(model));
    let mut actuation = Actuation::new(&Stage::Actuation.sizes(model));
    let mut acceleration = Acceleration::new(&model.sizes);
    let mut colliders = Colliders::new(&model.sizes);
    let mut stages = Smooth {
        position: &mut position,
        inertia: &mut inertia,
        velocity: &mut velocity,
        passive: &mut passive,
        actuation: &mut actuation,
        acceleration: &mut acceleration,
        colliders: &mut colliders,
    };
    let first = binder.next;
    smooth_fields(model, kind.keep, stages.borrow(), &mut |lanes| {
        binder.input(lanes);
    });
    let present = |stage: Stage| stage.present(model);
    let masks = pipeline::smooth(model, &state, applied.as_ref(), &present, stages.borrow(), &mut |_| {});
    let mut field = first;
    smooth_fields(model, kind.keep, stages, &mut |lanes| {
        binder.recording.output(field, lanes);
        field += 1;
    });
    for mask in masks {
        binder.recording.mask_output(mask);
    }
    binder.recording.finish()
}

/// Fields: qpos, qvel, M, qacc, smooth force, force of constraints; next qpos, next qvel, acceleration over the step.
pub fn euler<T: Float>(model: &Model<T>) -> Program<T> {
    let mut binder = Binder::new();
    let mut state = State::<Recorder<T>>::new(&model.sizes);
    let mut inertia = Inertia::new(&model.sizes);
    let mut forces = [vec![Recorder::zero(); model.sizes.nv], vec![Recorder::zero(); model.sizes.nv]];
    let mut qacc = forces[0].clone();
    let [smooth, constraint] = &mut forces;
    for lanes in [&mut state.qpos, &mut state.qvel, &mut inertia.m, &mut qacc, smooth, constraint] {
        binder.input(lanes);
    }
    let mut next = Integration::new(&Stage::Integration.sizes(model));
    let forces = forces.each_ref().map(Vec::as_slice);
    integration::euler(model, &inertia, &state.qpos, &state.qvel, &qacc, forces, &mut next);
    for (field, lanes) in [&next.qpos, &next.qvel, &next.qacc].into_iter().enumerate() {
        binder.recording.output(binder.next + field, lanes);
    }
    binder.recording.finish()
}

/// Fields: dof axes, M, smooth force; those of [`SolverPart::fields`]. Masks of `Gather`: open; converged, still.
pub fn solver<T: Float>(model: &Model<T>, part: SolverPart) -> Program<T> {
    let mut binder = Binder::new();
    let mut position = Position::<Recorder<T>>::new(&model.sizes);
    let mut inertia = Inertia::new(&model.sizes);
    let mut acceleration = Acceleration::new(&model.sizes);
    binder.input(position.cdof.as_flattened_mut());
    binder.input(&mut inertia.m);
    binder.input(&mut acceleration.qfrc_smooth);
    let constraint = Constraint::new(model);
    let problem =
        Problem { model, position: &position, inertia: &inertia, acceleration: &acceleration, constraint: &constraint };
    let mut work = Solver::new(&Stage::Solver.sizes(model));
    let first = binder.next;
    for lanes in part.fields(&mut work).0 {
        binder.input(lanes);
    }
    let every = vec![true; model.sizes.nlink];
    match part {
        SolverPart::Motion => solver::motion(&problem, &mut work),
        SolverPart::Curve => solver::curve(&problem, &every, &mut work),
        SolverPart::Descend { filled } => {
            let pattern = pattern(model, filled);
            solver::descend(&problem, &pattern, &mut work);
        }
        SolverPart::Polish { filled } => {
            let pattern = pattern(model, filled);
            solver::polish(&problem, &pattern, &mut work);
        }
        SolverPart::Gather => {
            let open = binder.recording.mask_input();
            let Arrival { converged, still } = solver::gather(&problem, &every, open, &mut work);
            binder.recording.mask_output(converged);
            binder.recording.mask_output(still);
        }
    }
    let (fields, changed) = part.fields(&mut work);
    for (i, lanes) in fields.into_iter().enumerate().take(changed) {
        binder.recording.output(first + i, lanes);
    }
    binder.recording.finish()
}

/// The pattern of the Hessian.
fn pattern<T>(model: &Model<T>, filled: bool) -> Pattern {
    let fullest = if filled { solver::fullest_pattern(model) } else { None };
    fullest.unwrap_or_else(|| model.tree_pattern.clone())
}

/// Multiplications in a factorisation.
pub fn work_of_factor<T>(model: &Model<T>, filled: bool) -> usize {
    let pattern = pattern(model, filled);
    let entries = |i: usize| pattern.row(i).iter().map(|run| run.len as usize).sum::<usize>();
    (0..model.sizes.nv).map(entries).map(|n| n * (n + 3) / 2).sum()
}
