//! The parts of the solver for which code is made: what each reads and writes, and recording it.

use lanesim_codegen::{Float, Program, Recorder};
use lanesim_kernels::acceleration::Acceleration;
use lanesim_kernels::code::SolverPart;
use lanesim_kernels::constraint::{self, Constraint, Law};
use lanesim_kernels::inertia::Inertia;
use lanesim_kernels::lane::Lane;
use lanesim_kernels::model::{Model, Pair, Pattern};
use lanesim_kernels::position::Position;
use lanesim_kernels::solver::{self, Arrival, Problem, SolverWork, Trial};

use super::fields::Field;
use super::parts::Binder;
use super::structure::{Structure, fill_in};

/// Most fields of a part.
pub const MOST_FIELDS: usize = 16;

/// All parts.
pub const ALL: [SolverPart; 12] = [
    SolverPart::Depart,
    SolverPart::Choose,
    SolverPart::Motion,
    SolverPart::Turn,
    SolverPart::Curve,
    SolverPart::Descend { filled: false },
    SolverPart::Descend { filled: true },
    SolverPart::Polish { filled: false },
    SolverPart::Polish { filled: true },
    SolverPart::Probe { first: true },
    SolverPart::Probe { first: false },
    SolverPart::Gather,
];

/// Place of a part in the list of all.
pub const fn number(part: SolverPart) -> usize {
    match part {
        SolverPart::Depart => 0,
        SolverPart::Choose => 1,
        SolverPart::Motion => 2,
        SolverPart::Turn => 3,
        SolverPart::Curve => 4,
        SolverPart::Descend { filled } => 5 + filled as usize,
        SolverPart::Polish { filled } => 7 + filled as usize,
        SolverPart::Probe { first } => 10 - first as usize,
        SolverPart::Gather => 11,
    }
}

/// Names of the parts.
pub const NAMES: [&str; ALL.len()] = [
    "depart",
    "choose",
    "motion",
    "turn",
    "curve",
    "descend",
    "descend filled",
    "polish",
    "polish filled",
    "probe first",
    "probe",
    "gather",
];

/// Number of masks that a part takes and returns.
pub fn masks(part: SolverPart) -> (usize, usize) {
    match part {
        SolverPart::Choose => (0, 1),
        SolverPart::Polish { .. } => (1, 0),
        SolverPart::Probe { .. } | SolverPart::Gather => (1, 2),
        _ => (0, 0),
    }
}

/// Whether a step may run a part, by Newton's method or conjugate gradients, with pairs that are both links, and with pairs
/// that join branches.
pub fn wanted(part: SolverPart, newton: bool, both: bool, joins: bool) -> bool {
    match part {
        SolverPart::Depart | SolverPart::Choose | SolverPart::Probe { .. } | SolverPart::Gather => true,
        SolverPart::Motion => !newton,
        SolverPart::Turn => newton,
        SolverPart::Curve => newton && both,
        SolverPart::Descend { filled } => newton && both && (joins || !filled),
        SolverPart::Polish { filled } => newton && (joins || !filled),
    }
}

/// The fields of a part, and how many of the first of them it changes.
pub const fn fields(part: SolverPart) -> (&'static [Field], usize) {
    macro_rules! fields {
        ($($changed:ident),*; $($read:ident),*) => {
            const { (&[$(Field::$changed,)* $(Field::$read,)*] as &[Field], [$(Field::$changed,)*].len()) }
        };
    }
    match part {
        SolverPart::Depart => fields!(Search, MSearch, Twist, ColdTwist, Line, JointJp, JointY;
            Axes, Inertia, SmoothForce, SmoothAcceleration, WarmStart, Joints),
        SolverPart::Choose => {
            fields!(Qacc, Ma, JointY, Line, Search, MSearch; JointJp, SmoothForce, SmoothAcceleration)
        }
        SolverPart::Motion => fields!(MSearch, Twist, Line, JointJp;
            Search, Ma, Gradient, Axes, Inertia, SmoothForce, Joints),
        SolverPart::Turn => fields!(Search, MSearch, Twist, Line, JointJp, Hessian, Inverse, Stiffness;
            Gradient, Ma, JointY, Axes, Inertia, SmoothForce, Joints),
        SolverPart::Curve => fields!(Hessian, Stiffness; JointY, Axes, Inertia, Joints),
        SolverPart::Descend { .. } => fields!(Search, MSearch, Twist, Line, JointJp, Hessian, Inverse;
            Gradient, Ma, Axes, Inertia, SmoothForce, Joints),
        SolverPart::Polish { .. } => fields!(Qacc, Ma, QfrcConstraint;
            Hessian, Inverse, Gradient, Inertia, SmoothForce),
        SolverPart::Probe { .. } => fields!(Line; JointY, JointJp, Joints),
        SolverPart::Gather => fields!(QfrcConstraint, Gradient, Qacc, Ma, JointY, JointForce, Wrench;
            Pull, JointJp, Search, MSearch, Line, Axes, SmoothForce, Joints),
    }
}

/// Multiplications of a part, about: what decides whether straight-line code is small enough.
pub fn operations<T>(part: SolverPart, model: &Model<T>) -> usize {
    let (nv, nm) = (model.sizes.nv, model.sizes.nm);
    let joints = 8 * (2 * model.limits.len() + model.friction_losses.len());
    joints
        + match part {
            SolverPart::Choose | SolverPart::Probe { .. } => 4 * nv,
            SolverPart::Depart | SolverPart::Motion => nm + 12 * nv,
            SolverPart::Curve => 8 * nm,
            SolverPart::Turn => 10 * nm + work_of_factor(model, false),
            SolverPart::Descend { filled } => 2 * nm + work_of_factor(model, filled),
            SolverPart::Polish { .. } => 3 * nm,
            SolverPart::Gather => 12 * nv,
        }
}

/// What earlier stages give, recorded.
struct Stages<T: Float> {
    position: Position<Recorder<T>>,
    inertia: Inertia<Recorder<T>>,
    acceleration: Acceleration<Recorder<T>>,
    constraint: Constraint<Recorder<T>>,
    warmstart: Vec<Recorder<T>>,
}

impl<T: Float> Stages<T> {
    fn new(model: &Model<T>) -> Self {
        let mut constraint = Constraint::new(model);
        constraint.dof_rows.extend(constraint::all_dof_rows(model));
        constraint.dof_lanes.resize(constraint.dof_rows.len(), [Recorder::zero(); 6]);
        Stages {
            position: Position::new(&model.sizes),
            inertia: Inertia::new(&model.sizes),
            acceleration: Acceleration::new(&model.sizes),
            constraint,
            warmstart: vec![Recorder::zero(); model.sizes.nv],
        }
    }

    fn lanes(&mut self, field: Field) -> Option<&mut [Recorder<T>]> {
        Some(match field {
            Field::Axes => self.position.cdof.as_flattened_mut(),
            Field::Inertia => &mut self.inertia.m,
            Field::SmoothForce => &mut self.acceleration.qfrc_smooth,
            Field::SmoothAcceleration => &mut self.acceleration.qacc_smooth,
            Field::Joints => self.constraint.dof_lanes.as_flattened_mut(),
            Field::WarmStart => &mut self.warmstart,
            _ => return None,
        })
    }
}

/// Records a part; masks are what the kernel takes and returns.
pub fn record<T: Float>(model: &Model<T>, structure: &Structure<T>, part: SolverPart) -> Program<T> {
    let filled = matches!(part, SolverPart::Descend { filled: true } | SolverPart::Polish { filled: true });
    record_on(model, structure, part, &pattern(model, filled))
}

/// Records a part, with the Hessian on the given pattern.
pub fn record_on<T: Float>(
    model: &Model<T>,
    structure: &Structure<T>,
    part: SolverPart,
    pattern: &Pattern,
) -> Program<T> {
    let mut binder = Binder::new();
    let mut stages = Stages::new(model);
    let mut work = SolverWork::new(model);
    work.fit(&stages.constraint);
    work.touched.fill(true);
    let (fields, changed) = fields(part);
    let mut before = vec![];
    for field in fields {
        if let Some(lanes) = stages.lanes(*field).or_else(|| field.of_solver(&mut work)) {
            binder.input(lanes);
            before.push(lanes.to_vec());
        }
    }
    fill_in(stages.position.cdof.as_flattened_mut(), &structure.axes);
    fill_in(&mut stages.inertia.m, &structure.inertia);
    let Stages { position, inertia, acceleration, constraint, warmstart } = &stages;
    let mean_inertia = Recorder::splat(model.mean_inertia);
    let problem = Problem { model, mean_inertia, position, inertia, acceleration, constraint };
    run((part, pattern), &problem, warmstart, &mut binder, &mut work);
    for (place, (field, before)) in fields.iter().zip(&before).enumerate().take(changed) {
        if let Some(lanes) = field.of_solver(&mut work) {
            let dead = (0..lanes.len()).filter(|entry| field.is_dead(*entry, structure.live));
            dead.for_each(|entry| lanes[entry] = before[entry]);
            binder.recording.output(place, lanes);
        }
    }
    binder.recording.finish()
}

/// Runs the part's kernel, with its masks.
fn run<T: Float>(
    (part, pattern): (SolverPart, &Pattern),
    problem: &Problem<'_, Recorder<T>>,
    warmstart: &[Recorder<T>],
    binder: &mut Binder<T>,
    work: &mut SolverWork<Recorder<T>>,
) {
    let recording = &mut binder.recording;
    match part {
        SolverPart::Depart => solver::depart(problem, warmstart, work),
        SolverPart::Choose => {
            let warm = solver::choose(problem, work);
            recording.mask_output(warm);
        }
        SolverPart::Motion => solver::motion(problem, work),
        SolverPart::Turn => {
            solver::curve(problem, work);
            solver::descend(problem, pattern, work);
        }
        SolverPart::Curve => solver::curve(problem, work),
        SolverPart::Descend { .. } => solver::descend(problem, pattern, work),
        SolverPart::Polish { .. } => {
            let open = recording.mask_input();
            solver::polish(problem, pattern, open, work);
        }
        SolverPart::Probe { first } => {
            let open = recording.mask_input();
            let Trial { open, full } = solver::probe(problem, first, open, work);
            recording.mask_output(open);
            recording.mask_output(full);
        }
        SolverPart::Gather => {
            let open = recording.mask_input();
            let Arrival { converged, still } = solver::gather(problem, open, work);
            recording.mask_output(converged);
            recording.mask_output(still);
        }
    }
}

/// [`solver::couple`] of a pair's contacts, on [`COUPLE`](super::contacts::COUPLE).
pub fn couple<T: Float>(model: &Model<T>, pair: &Pair<T>) -> Program<T> {
    let mut binder = Binder::new();
    let dofs = &model.pair_dofs[pair.dofs.range()];
    let dim = pair.condim as usize;
    let mut strength = [Recorder::zero(); 7];
    let mut jacobian = vec![Recorder::zero(); dofs.len() * dim];
    let mut y = vec![Recorder::zero(); dim];
    let mut hessian = vec![Recorder::zero(); model.sizes.nm];
    binder.input(&mut strength);
    binder.input(&mut jacobian);
    binder.input(&mut y);
    let field = binder.input(&mut hessian);
    let law = Law { cone: constraint::cone(model, pair), strength: &strength };
    solver::couple(&model.rows, dofs, law, &jacobian, &y, &mut hessian);
    binder.recording.output(field, &hessian);
    binder.recording.finish()
}

/// The pattern of the Hessian.
fn pattern<T>(model: &Model<T>, filled: bool) -> Pattern {
    let fullest = if filled { solver::fullest_pattern(model) } else { None };
    fullest.unwrap_or_else(|| model.tree_pattern.clone())
}

/// Multiplications in a factorisation; where the matrix is too large even to be read, no more than that.
pub fn work_of_factor<T>(model: &Model<T>, filled: bool) -> usize {
    if filled && model.sizes.nm > super::MOST_OPERATIONS {
        return model.sizes.nm;
    }
    operations_of(&pattern(model, filled))
}

/// Multiplications in a factorisation on a pattern.
pub fn operations_of(pattern: &Pattern) -> usize {
    let entries = |i: usize| pattern.row(i).iter().map(|run| run.len as usize).sum::<usize>();
    (0..pattern.rows.len()).map(entries).map(|n| n * (n + 3) / 2).sum()
}
