//! Which stages a run needs, from the model and the outputs that are asked for, and what is left out and why.

use lanesim_kernels::model::JointKind;
use lanesim_kernels::options::Integrator;
use lanesim_kernels::stage::{Stage, Stages};
use lanesim_kernels::{derivative, inverse};

use crate::model::Model;
use crate::outputs::Output;

/// What a run executes. Whatever is left out changes no result that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Stages that are wanted; those for which the model has nothing are passed over.
    pub stages: Stages,
    /// Whether the solver's residual is wanted.
    pub residual: bool,
    /// Whether any output comes from a stage, not from the state: then frozen worlds are computed, too.
    pub derived: bool,
}

/// One line of a plan in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// Stage, or a part of one.
    pub name: &'static str,
    /// Whether it runs.
    pub runs: bool,
    /// What it works on, or why it is left out.
    pub what: String,
}

impl Plan {
    /// For steps that record `outputs`.
    pub fn step(outputs: &[Output]) -> Plan {
        let forward = Plan::forward(outputs);
        Plan { stages: forward.stages | Stages::STEP, ..forward }
    }

    /// For a forward computation of `outputs`: no further than the stages that compute them.
    pub fn forward(outputs: &[Output]) -> Plan {
        Plan {
            stages: outputs
                .iter()
                .filter_map(Output::stage)
                .fold(Stages::NONE, |stages, stage| stages | Stages::up_to(stage)),
            residual: outputs.iter().any(Output::needs_residual),
            derived: outputs.iter().any(|output| output.stage().is_some()),
        }
    }

    /// For inverse dynamics: up to the rows of the constraints, without a solver.
    pub fn inverse() -> Plan {
        Plan { stages: inverse::stages(), residual: false, derived: true }
    }

    /// What runs for the model, and what does not and why.
    pub fn parts(&self, model: &Model) -> Vec<Part> {
        Stage::ALL.into_iter().flat_map(|(stage, name)| self.parts_of(model, stage, name)).collect()
    }

    fn parts_of(&self, model: &Model, stage: Stage, name: &'static str) -> Vec<Part> {
        if !self.stages.has(stage) {
            return vec![Part { name, runs: false, what: "no output that was asked for needs it".into() }];
        }
        let tables = model.tables();
        let (features, flags, sizes) = (&tables.features, &tables.options.flags, &tables.sizes);
        let part = |name, runs: bool, works_on: String, why_not: &str| Part {
            name,
            runs,
            what: if runs { works_on } else { why_not.to_owned() },
        };
        let count = |name, n: usize, what: &str, why_not: &str| part(name, n > 0, format!("{n} {what}"), why_not);
        let unless = |on: bool, off: &'static str, none: &'static str| if on { none } else { off };
        let turning = |kind| matches!(kind, JointKind::Free | JointKind::Ball);
        match stage {
            Stage::Position => vec![
                part(name, true, format!("{} joints, {} links", sizes.njnt, sizes.nlink), ""),
                count(
                    "  quaternions",
                    tables.joints.iter().filter(|joint| turning(joint.kind)).count(),
                    "free and ball joints",
                    "no free or ball joint",
                ),
            ],
            Stage::Tendon => vec![count(name, sizes.ntendon, "tendons", "no tendon")],
            Stage::Collision => {
                let contact = flags.contact && flags.constraint;
                let all = sizes.ngeom * sizes.ngeom.saturating_sub(1) / 2;
                let why = unless(contact, "contacts are switched off", "no pair of geoms may touch");
                let what = format!(
                    "{} of {all} pairs of geoms, {} contacts at most; the others are kept apart by contype and \
                     conaffinity, excludes, or bodies that are fixed to each other or neighbours",
                    sizes.npair, sizes.nslot
                );
                vec![part(name, sizes.npair > 0, what, why)]
            }
            Stage::Constraint => vec![
                part(name, tables.constrained(), "rows that act in some world of a block".into(), "nothing constrains"),
                count(
                    "  equality",
                    tables.equalities.len(),
                    "constraints",
                    unless(
                        flags.equality && flags.constraint,
                        "equality constraints are switched off",
                        "no equality constraint",
                    ),
                ),
                count(
                    "  limits",
                    tables.limits.len(),
                    "joints and tendons",
                    unless(
                        flags.limit && flags.constraint,
                        "limits are switched off",
                        "no joint or tendon has a limit",
                    ),
                ),
                count(
                    "  dry friction",
                    tables.friction_losses.len(),
                    "dofs and tendons",
                    unless(flags.frictionloss && flags.constraint, "dry friction is switched off", "no frictionloss"),
                ),
            ],
            Stage::Passive => vec![
                part(
                    name,
                    features.passive(),
                    "joint forces".into(),
                    "no spring, damper, gravity compensation or medium acts",
                ),
                part(
                    "  springs",
                    features.springs,
                    "on joints".into(),
                    unless(flags.spring, "springs are switched off", "no joint has stiffness"),
                ),
                part(
                    "  dampers",
                    features.dampers,
                    "on dofs".into(),
                    unless(flags.damper, "dampers are switched off", "no dof is damped"),
                ),
                part("  gravcomp", features.gravcomp, "on links".into(), "no body has it, or gravity is zero"),
                part(
                    "  fluid",
                    features.fluid,
                    "on bodies".into(),
                    "no density or viscosity, or passive forces are switched off",
                ),
            ],
            Stage::Actuation if !features.actuation && sizes.nout > 0 => {
                vec![Part { name, runs: true, what: "lengths only: actuation is switched off".into() }]
            }
            Stage::Actuation => vec![count(name, tables.actuators.len(), "actuators", "no actuator")],
            Stage::Solver => vec![
                part(
                    name,
                    tables.constrained(),
                    format!("{:?}, in blocks where some row acts", tables.options.solver),
                    "nothing constrains: the acceleration is the smooth one",
                ),
                part("  residual", self.residual, "of the solution".into(), "no output that was asked for needs it"),
            ],
            Stage::Integration => vec![
                part(name, true, tables.options.integrator.to_string(), ""),
                part(
                    "  guard",
                    sizes.nguard > 0,
                    format!("of {} trees", sizes.nguard),
                    "it was not asked for, or no tree needs it",
                ),
                part(
                    "  implicit damping",
                    features.implicit_damping,
                    if features.articulated { "articulated bodies of its own" } else { "a factor of its own" }.into(),
                    unless(
                        tables.options.integrator == Integrator::Euler,
                        "the integrator is not Euler",
                        "no dof is damped, or eulerdamp is switched off",
                    ),
                ),
            ],
            Stage::Derivative => vec![part(
                name,
                Stage::Derivative.present(tables),
                if derivative::of_bias(tables) {
                    "of passive, actuator and bias forces"
                } else {
                    "of passive and actuator forces"
                }
                .into(),
                "the integrator is not implicit",
            )],
            Stage::Acceleration if features.articulated => {
                vec![part(name, true, format!("{} dofs, by articulated bodies", sizes.nv), "")]
            }
            Stage::Inertia | Stage::Acceleration => {
                vec![part(name, true, format!("{} dofs, {} entries of the matrix", sizes.nv, sizes.nm), "")]
            }
            Stage::Sensor => {
                let (runs, why) = (Stage::Sensor.present(tables), "no sensor, or sensors are switched off");
                vec![part(
                    name,
                    runs,
                    format!("{} numbers of {} sensors", sizes.nsensordata, tables.sensors.len()),
                    why,
                )]
            }
            Stage::Velocity | Stage::Energy => vec![part(name, true, format!("{} links", sizes.nlink), "")],
        }
    }
}
