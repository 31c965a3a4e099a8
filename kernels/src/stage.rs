//! The stages of a step: their order, what each reads, which of them a model has, and what they cost.

use std::ops::BitOr;
use std::time::{Duration, Instant};

use crate::derivative;
use crate::model::{Model, Sizes};
use crate::options::Integrator;

/// The stages of a step, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // each variant is the module of the same name
pub enum Stage {
    Position,
    Tendon,
    Inertia,
    Velocity,
    Passive,
    Actuation,
    Derivative,
    Acceleration,
    Energy,
    Collision,
    Constraint,
    Solver,
    Sensor,
    Integration,
}

impl Stage {
    /// All stages, with their names.
    pub const ALL: [(Stage, &'static str); 14] = [
        (Stage::Position, "position"),
        (Stage::Tendon, "tendon"),
        (Stage::Inertia, "inertia"),
        (Stage::Velocity, "velocity"),
        (Stage::Passive, "passive"),
        (Stage::Actuation, "actuation"),
        (Stage::Derivative, "derivative"),
        (Stage::Acceleration, "acceleration"),
        (Stage::Energy, "energy"),
        (Stage::Collision, "collision"),
        (Stage::Constraint, "constraint"),
        (Stage::Solver, "solver"),
        (Stage::Sensor, "sensor"),
        (Stage::Integration, "integration"),
    ];

    /// The stages whose results it reads.
    pub fn reads(self) -> &'static [Stage] {
        use Stage::{
            Acceleration, Actuation, Collision, Constraint, Inertia, Passive, Position, Solver, Tendon, Velocity,
        };
        match self {
            Position => &[],
            Tendon | Collision => &[Position],
            Inertia => &[Position, Tendon],
            // A medium resists velocities of links.
            Passive => &[Position, Tendon, Velocity],
            Velocity => &[Position, Tendon, Inertia],
            Stage::Energy => &[Position, Tendon, Inertia],
            Constraint => &[Position, Tendon, Collision, Velocity],
            Actuation => &[Position, Tendon, Passive],
            Stage::Derivative => &[Inertia, Velocity, Passive, Actuation],
            // In the metric of discrete steps.
            Acceleration => &[Inertia, Velocity, Passive, Actuation, Stage::Derivative],
            Solver => &[Constraint, Acceleration],
            Stage::Sensor => &[Solver],
            Stage::Integration => &[Solver, Stage::Derivative],
        }
    }

    /// The sizes by which its fields are allocated: zero for a stage that the model does not have.
    pub fn sizes<T>(self, model: &Model<T>) -> Sizes {
        match self {
            // The factor of the damped inertia is needed where damping is implicit.
            Stage::Integration if !model.features.implicit_damping => Sizes { nm: 0, ..model.sizes.clone() },
            // Links matter to the derivative of the bias force alone.
            Stage::Derivative if self.present(model) && !derivative::of_bias(model) => {
                Sizes { nlink: 0, ..model.sizes.clone() }
            }
            // Without constraints, the solver only passes on the acceleration.
            Stage::Solver if !model.constrained() => Sizes { nv: model.sizes.nv, ..Sizes::default() },
            _ if self.present(model) => model.sizes.clone(),
            _ => Sizes::default(),
        }
    }

    /// Whether the model gives the stage anything to do.
    pub fn present<T>(self, model: &Model<T>) -> bool {
        match self {
            Stage::Tendon => !model.tendons.is_empty(),
            Stage::Collision => !model.pairs.is_empty(),
            Stage::Constraint => model.constrained(),
            Stage::Derivative => !matches!(model.options.integrator, Integrator::Euler | Integrator::Rk4),
            Stage::Passive => model.features.passive(),
            Stage::Sensor => !model.sensors.is_empty() && model.options.flags.sensor,
            // Lengths are there to be read even where actuation is off.
            Stage::Actuation => !model.actuators.is_empty(),
            _ => true,
        }
    }
}

/// A set of stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stages(u16);

impl Stages {
    /// None.
    pub const NONE: Stages = Stages(0);
    /// Those that a step needs: all but energy and sensors.
    pub const STEP: Stages =
        Stages(((1 << Stage::ALL.len()) - 1) & !(1 << Stage::Energy as u16) & !(1 << Stage::Sensor as u16));

    /// The stage, and all stages whose results it needs.
    pub fn up_to(stage: Stage) -> Stages {
        let own = Stages(1 << stage as u16);
        stage.reads().iter().fold(own, |all, read| all | Stages::up_to(*read))
    }

    /// All but one.
    #[must_use]
    pub fn without(self, stage: Stage) -> Stages {
        Stages(self.0 & !(1 << stage as u16))
    }

    /// Whether the stage belongs to the set.
    pub fn has(self, stage: Stage) -> bool {
        self.0 >> stage as u16 & 1 != 0
    }
}

impl Stages {
    /// Whether a stage of the set, or that one of them needs, is one that the model has.
    pub fn run<T>(self, stage: Stage, model: &Model<T>) -> bool {
        // Actuators on bodies act by what touches these.
        let touching = stage == Stage::Collision && model.features.adhesion && self.has(Stage::Actuation);
        (self.has(stage) || touching) && stage.present(model)
    }
}

/// Where an evaluation starts. What is before it was left by an earlier one, of the same worlds in states that differ only in what comes after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At positions.
    Position,
    /// At velocities.
    Velocity,
    /// At activations and controls.
    Actuation,
}

impl Start {
    /// All, in order.
    pub const ALL: [Start; 3] = [Start::Position, Start::Velocity, Start::Actuation];

    /// That of an evaluation of these stages.
    pub fn of(stages: Stages) -> Start {
        match (stages.has(Stage::Position), stages.has(Stage::Velocity)) {
            (true, _) => Start::Position,
            (_, true) => Start::Velocity,
            _ => Start::Actuation,
        }
    }

    /// Whether a stage comes after it.
    pub fn runs<T>(self, stage: Stage, model: &Model<T>) -> bool {
        let moves = matches!(stage, Stage::Position | Stage::Inertia | Stage::Collision);
        let drives = matches!(stage, Stage::Tendon | Stage::Velocity | Stage::Passive | Stage::Energy);
        // The rows of discrete steps know how strongly actuators resist.
        let rows = stage == Stage::Constraint && model.options.integrator != Integrator::Discrete;
        match self {
            Start::Position => true,
            Start::Velocity => !moves,
            Start::Actuation => !moves && !drives && !rows,
        }
    }

    /// Those of the stages that come after it. Where actuators act by contacts there are none that could be left out.
    pub fn within<T>(self, stages: Stages, model: &Model<T>) -> Stages {
        let from = if model.features.adhesion { Start::Position } else { self };
        let all = Stage::ALL.iter().filter(|(stage, _)| stages.has(*stage) && from.runs(*stage, model));
        Stages(all.fold(0, |bits, (stage, _)| bits | 1 << *stage as u16))
    }
}

impl BitOr for Stages {
    type Output = Stages;
    fn bitor(self, other: Stages) -> Stages {
        Stages(self.0 | other.0)
    }
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
    pub fn start(&mut self) {
        self.last = Instant::now();
    }

    /// Ends a stage.
    pub fn end(&mut self, stage: Stage) {
        let now = Instant::now();
        self.spent[stage as usize] += now - self.last;
        self.last = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_told_by_their_stages() {
        let mut model = Model::<f64>::default();
        for integrator in [Integrator::Euler, Integrator::Discrete] {
            model.options.integrator = integrator;
            for start in Start::ALL {
                let stages = start.within(Stages::STEP, &model);
                assert_eq!(Start::of(stages), start);
                assert!(stages.has(Stage::Solver) && stages.has(Stage::Acceleration));
                let rows = start != Start::Actuation || integrator == Integrator::Discrete;
                assert_eq!(stages.has(Stage::Constraint), rows);
            }
        }
    }

    #[test]
    fn a_stage_reads_earlier_ones_only() {
        for (i, (stage, _)) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage as usize, i);
            assert!(stage.reads().iter().all(|read| (*read as usize) < i), "{stage:?}");
        }
        assert_eq!(Stages::up_to(Stage::Integration), Stages::STEP);
        assert!(!Stages::up_to(Stage::Velocity).has(Stage::Collision));
    }
}
