//! Inverse dynamics: the force for which a state has a given acceleration. No iteration: the force of the constraints follows from the
//! acceleration (Todorov, Convex and analytically-invertible dynamics with contacts and constraints, ICRA 2014).

use crate::acceleration::Acceleration;
use crate::constraint;
use crate::derivative;
use crate::fields::fields;
use crate::lane::{Lane, LaneQuery};
use crate::math::ldl;
use crate::model::{Instance, Model};
use crate::options::Integrator;
use crate::passive::damper_slope;
use crate::pipeline::{Run, Stage, Stages, forward};
use crate::solver;
use crate::state::{BlockStatus, State};
use crate::workspace::Workspace;

fields! {
    /// Inverse dynamics.
    pub struct Inverse(sizes) {
        /// The acceleration that is given: the derivative of velocity, or that over a step.
        pub given: Vec<L> = sizes.nv,
        /// The derivative of velocity.
        pub qacc: Vec<L> = sizes.nv,
        /// The inertia's force, M qacc.
        pub inertial: Vec<L> = sizes.nv,
        /// The force that must come from actuators and from outside.
        pub qfrc_inverse: Vec<L> = sizes.nv,
    } L
}

/// The stages that it needs.
pub fn stages() -> Stages {
    Stages::up_to(Stage::Acceleration) | Stages::up_to(Stage::Constraint)
}

/// Whether a step of this model can be inverted: its acceleration over the step has to follow from one evaluation.
pub fn invertible<T>(model: &Model<T>) -> bool {
    !matches!(model.options.integrator, Integrator::Rk4 | Integrator::Midpoint)
}

/// Finds the force for which the worlds of the block have the acceleration in [`Inverse::given`]; `over_step`: have it over a step, v⁺ - v
/// divided by its time. Forces from outside and controls count for nothing, but that the latter decide what actuators gain with velocity.
pub fn inverse<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    over_step: bool,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    (ws, inverse): (&mut Workspace<L>, &mut Inverse<L>),
) {
    run.stages = stages();
    again(model, state, over_step, run, status, (ws, inverse));
}

/// The same of which the run says the stages: those that are not wanted, or all of them, are as an earlier evaluation left them.
pub fn again<L: LaneQuery>(
    model: &Model<L::Real>,
    state: &mut State<L>,
    over_step: bool,
    run: &mut Run<'_, L>,
    status: &mut BlockStatus,
    (ws, inverse): (&mut Workspace<L>, &mut Inverse<L>),
) {
    run.keep = true;
    if run.stages != Stages::NONE {
        forward(model, state, run, status, ws);
    }
    let instance = Instance { model, varied: run.varied };
    let Inverse { given, qacc, inertial, qfrc_inverse } = inverse;
    qacc.copy_from_slice(given);
    let discrete = model.options.integrator == Integrator::Discrete;
    if discrete {
        // The solver's acceleration is that of the step, and rows are of that: as in MuJoCo, whatever is asked for.
        let Workspace { position, tendons, inertia, velocity, actuation, derivative, constraint, .. } = &mut *ws;
        derivative::implicit(
            instance,
            state,
            derivative::Stages { position, tendons, inertia, velocity, actuation },
            derivative,
        );
        let held = |dof: usize| constraint::held(model, constraint, dof);
        derivative::multiply_discrete(model, derivative, &held, given, inertial);
        inertial.iter_mut().zip(&ws.derivative.pull).for_each(|(force, pull)| *force += *pull);
    } else if over_step {
        implicit_product(instance, state, ws, given, inertial);
        if model.constrained() {
            qacc.copy_from_slice(inertial);
            let Acceleration { factor, inverse, .. } = &ws.acceleration;
            ldl::solve(&model.rows, &model.tree_pattern, factor, inverse, qacc);
        }
    } else {
        ldl::multiply(&model.rows, &model.tree_pattern, &ws.inertia.m, qacc, inertial);
    }
    let problem = solver::Problem {
        model: instance,
        mean_inertia: instance.mean_inertia(),
        position: &ws.position,
        tendons: &ws.tendons,
        inertia: &ws.inertia,
        acceleration: &ws.acceleration,
        constraint: &ws.constraint,
    };
    solver::force_at(&problem, qacc, &mut ws.solver);
    let passive = |i: usize| if model.features.passive() { ws.passive.qfrc_passive[i] } else { L::zero() };
    for (i, force) in qfrc_inverse.iter_mut().enumerate() {
        *force = inertial[i] + ws.velocity.qfrc_bias[i] - passive(i) - ws.solver.fields.qfrc_constraint[i];
    }
}

/// y = (M - h D) x, with the matrix of the integrator: that by which it divides forces.
fn implicit_product<L: Lane>(model: Instance<'_, L>, state: &State<L>, ws: &mut Workspace<L>, x: &[L], y: &mut [L]) {
    let Workspace { position, tendons, inertia, velocity, actuation, derivative, .. } = ws;
    if Stage::Derivative.present(&model) {
        let stages = derivative::Stages { position, tendons, inertia, velocity, actuation };
        derivative::implicit(model, state, stages, derivative);
        return derivative::multiply(&model, derivative, x, y);
    }
    ldl::multiply(&model.rows, &model.tree_pattern, &inertia.m, x, y);
    if model.features.implicit_damping {
        let h = L::of(model.options.timestep);
        for (i, _) in model.dofs.iter().enumerate().filter(|(_, dof)| dof.damped) {
            y[i] = (h * damper_slope(model, i, state.qvel[i])).mul_add(x[i], y[i]);
        }
    }
}
