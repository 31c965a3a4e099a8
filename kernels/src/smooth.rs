//! The stages that do without constraints, as one kernel: from positions to the smooth acceleration.

use crate::acceleration::Acceleration;
use crate::actuation::Actuation;
use crate::collision::Colliders;
use crate::constraint::Measured;
use crate::derivative::Derivative;
use crate::inertia::Inertia;
use crate::kick::{self, Kick};
use crate::lane::{Lane, Mask};
use crate::model::{Instance, Model};
use crate::options;
use crate::passive::Passive;
use crate::position::Position;
use crate::stage::{Stage, Start};
use crate::state::{Applied, State};
use crate::tendon::Tendons;
use crate::velocity::Velocity;
use crate::{acceleration, actuation, collision, constraint, derivative, inertia, passive, position, tendon, velocity};

/// The stages that do without constraints, borrowed from where they are.
#[allow(missing_docs)] // each field is the stage of the same name
pub struct Smooth<'a, L> {
    pub position: &'a mut Position<L>,
    pub tendons: &'a mut Tendons<L>,
    pub inertia: &'a mut Inertia<L>,
    pub velocity: &'a mut Velocity<L>,
    pub passive: &'a mut Passive<L>,
    pub actuation: &'a mut Actuation<L>,
    pub acceleration: &'a mut Acceleration<L>,
    pub derivative: &'a mut Derivative<L>,
    pub colliders: &'a mut Colliders<L>,
    /// Of a step that is kicked: what that works with.
    pub kick: Option<&'a mut Kick<L>>,
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
    /// Some row on a joint or tendon may act.
    pub joint_rows: M,
    /// The smooth acceleration is beyond what a solver can work with (see [`acceleration::wild`]): the world is lost.
    pub wild: M,
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

/// From positions to the smooth acceleration and what integrates it implicitly, how far geoms moved, and where rows on joints act:
/// those of its stages for which `runs` holds. Calls `end` after each.
pub fn smooth<L: Lane>(
    model: Instance<'_, L>,
    state: &State<L>,
    applied: Option<&Applied<L>>,
    runs: &dyn Fn(Stage) -> bool,
    stages: Smooth<'_, L>,
    end: &mut dyn FnMut(Stage),
) -> Findings<L::Mask> {
    let Smooth { position, tendons, inertia, velocity, passive, actuation, acceleration, derivative, colliders, kick } =
        stages;
    let midpoint = model.options.integrator == options::Integrator::Midpoint;
    let mut findings = Findings::from([L::Mask::splat(false); 5]);
    if runs(Stage::Position) {
        position::kinematics(model, state.into(), position);
        end(Stage::Position);
    }
    if runs(Stage::Tendon) {
        tendon::tendons(&model, position, &state.qpos, &state.qvel, tendons);
        end(Stage::Tendon);
    }
    if runs(Stage::Collision) {
        findings.due = collision::way(&model, state.into(), position, colliders);
        end(Stage::Collision);
    }
    if runs(Stage::Constraint) {
        findings.joint_rows = constraint::joint_rows(model, Measured { qpos: &state.qpos, qvel: &state.qvel, tendons });
        end(Stage::Constraint);
    }
    if runs(Stage::Inertia) {
        inertia::crb(model, position, tendons, inertia);
        end(Stage::Inertia);
    }
    if runs(Stage::Velocity) {
        velocity::rne(model, (position, tendons, inertia), &state.qvel, velocity);
        end(Stage::Velocity);
    }
    if runs(Stage::Passive) {
        passive::passive(model, passive::Stages { position, tendons, velocity }, state, passive);
        end(Stage::Passive);
    }
    if runs(Stage::Actuation) {
        findings.bad_controls = actuation::actuation(model, state, (position, tendons, passive), actuation);
        end(Stage::Actuation);
    }
    if runs(Stage::Derivative) {
        let stages = derivative::Stages { position, tendons, inertia, velocity, actuation };
        if midpoint {
            derivative::fitted(model, state, stages, kick.is_some(), derivative);
        } else {
            derivative::implicit(model, state, stages, derivative);
            derivative::factor(&model, derivative);
        }
        end(Stage::Derivative);
    }
    if runs(Stage::Acceleration) {
        acceleration::smooth_force(&model, position, velocity, passive, actuation, applied, acceleration);
        let of_step = model.options.integrator == options::Integrator::Discrete || midpoint && kick.is_some();
        let metric = of_step.then_some(&derivative.metric[..]);
        if of_step {
            acceleration.qfrc_smooth.iter_mut().zip(&derivative.pull).for_each(|(force, pull)| *force -= *pull);
        }
        let stages = (&*position, &*tendons, &*inertia);
        // Where the inertia was left as it was, so was its factor.
        if runs(Stage::Inertia) || of_step || model.features.articulated {
            findings.singular = acceleration::smooth_acceleration(model, stages, metric, acceleration);
        } else {
            acceleration::solve_smooth(model, stages, true, acceleration);
        }
        if let Some(kick) = kick {
            let metric = metric.unwrap_or(&inertia.m);
            if midpoint {
                kick::midpoint(model, stages, (metric, velocity), &state.qvel, acceleration, kick);
            } else {
                kick.scratch.bias.copy_from_slice(&velocity.qfrc_bias);
            }
            if model.sizes.nguard > 0 {
                kick::guard(model, kick::Stages { position, inertia, metric }, state, acceleration, kick);
            }
        }
        if runs(Stage::Solver) {
            findings.wild = acceleration::wild(&acceleration.qacc_smooth);
        }
        end(Stage::Acceleration);
    }
    findings
}

/// Fields that it leaves for others if it starts at `start`: all, or those that later parts of a step read.
pub fn changes<T>(model: &Model<T>, keep: bool, start: Start) -> Vec<&'static str> {
    let mut all = all_changes(model, keep);
    let kept = |name: &str| {
        // An inverse without a factor is scratch, and discrete steps have another factor at every velocity.
        let factor = matches!(name, "acceleration.factor" | "acceleration.inverse");
        let solved = factor && !model.features.articulated && model.options.integrator != options::Integrator::Discrete;
        let stage = Stage::ALL.iter().find(|(_, stage)| name.split('.').next() == Some(*stage));
        solved || stage.is_some_and(|(stage, _)| !start.runs(*stage, model))
    };
    if start != Start::Position {
        if keep {
            all.retain(|name| *name != "acceleration");
            all.extend(["acceleration.qfrc_smooth", "acceleration.qacc_smooth"]);
            all.extend(["acceleration.factor", "acceleration.inverse"]);
        }
        all.retain(|name| !kept(name));
    }
    all
}

fn all_changes<T>(model: &Model<T>, keep: bool) -> Vec<&'static str> {
    // Actuators on bodies take up again what is found here.
    let mut all = match keep || model.features.adhesion {
        true => vec!["position", "tendon", "inertia", "velocity", "passive", "actuation", "acceleration", "derivative"],
        false => vec![
            "position.origin",
            "position.origin_low",
            "position.pos",
            "position.rot",
            "position.cdof",
            "tendon",
            "velocity.cvel",
            if model.features.articulated { "inertia.link" } else { "inertia.m" },
            "acceleration.qfrc_smooth",
            "acceleration.qacc_smooth",
            "acceleration.inverse",
            "derivative.lower",
            "derivative.upper",
            "derivative.inverse",
        ],
    };
    // The rows of discrete steps, and what follows the solver.
    if model.options.integrator == options::Integrator::Discrete {
        all.extend(["inertia.m", "derivative.metric", "derivative.pull", "derivative.joined"]);
    }
    if model.options.integrator == options::Integrator::Midpoint {
        all.push("derivative.metric");
    }
    if model.sizes.nguard > 0 {
        all.extend(["inertia.m", "inertia.composite", "guard"]);
    }
    // The integration reads them.
    if model.sizes.na > 0 {
        all.push("actuation.act_dot");
    }
    if model.sizes.nmotor > 0 {
        all.push("actuation.bent");
    }
    // Rows of equality constraints read accelerations of links.
    if !model.equalities.is_empty() {
        all.push("velocity.cacc");
    }
    all.extend([
        "collision.qpos",
        "collision.mocap_quat",
        "collision.origin",
        "collision.way",
        "collision.blur",
        "collision.travel",
        "collision.due",
    ]);
    // Newton's method has a factor of its own.
    if model.options.solver != options::Solver::Newton || model.options.noslip_iterations > 0 {
        all.push("acceleration.factor");
    }
    all
}
