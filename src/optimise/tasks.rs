//! Tasks: models of our own with a cost and a goal that is checked.

use super::{Motion, Norm, Problem, Term};
use crate::error::Error;
use crate::mjcf::LoadOptions;
use crate::model::Model;
use crate::suggest;

/// A term of a task: a quantity, what it should be, weights along the way and at the end, and the norm.
type Weight = (&'static str, &'static [f64], f64, f64, Norm);

/// What the end of a motion must be.
#[derive(Clone, Copy, Debug)]
pub struct Goal {
    /// In words.
    pub what: &'static str,
    /// Of which quantity.
    quantity: &'static str,
    target: &'static [f64],
    /// How far it may be from what it should be.
    pub within: f64,
    /// Unit of that.
    pub unit: &'static str,
}

/// A goal, and how far the motion is from it.
#[derive(Clone, Copy, Debug)]
pub struct Reached {
    /// The goal.
    pub goal: Goal,
    /// How far the end is from it.
    pub distance: f64,
}

impl Reached {
    /// Whether that is near enough.
    pub fn passed(&self) -> bool {
        self.distance <= self.goal.within
    }
}

/// Something to do, with a model of its own.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Name.
    pub name: &'static str,
    /// In words.
    pub what: &'static str,
    /// The model, MJCF, with a keyframe `start`, whose controls are the first ones.
    pub xml: &'static str,
    /// For how long, s.
    pub seconds: f64,
    /// Most iterations where nobody says how many.
    pub iterations: usize,
    terms: &'static [Weight],
    /// What must be true at the end.
    pub goals: &'static [Goal],
}

const Q: Norm = Norm::Quadratic;

/// All tasks.
pub const TASKS: [Task; 3] = [
    Task {
        name: "cartpole",
        what: "a cart swings its pole up, and stands still with it upright",
        xml: include_str!("../../models/tasks/cartpole.xml"),
        seconds: 3.0,
        iterations: 300,
        terms: &[
            ("qpos:pivot", &[], 0.0, 500.0, Q),
            ("qpos:slide", &[], 0.1, 100.0, Q),
            ("qvel", &[], 0.0, 50.0, Q),
            ("ctrl", &[], 0.5, 0.0, Q),
        ],
        goals: &[
            Goal { what: "angle of the pole", quantity: "qpos:pivot", target: &[], within: 0.1, unit: "rad" },
            Goal { what: "speed of cart and pole", quantity: "qvel", target: &[], within: 0.1, unit: "m/s, rad/s" },
        ],
    },
    Task {
        name: "hopper",
        what: "one leg leaps forward, its centre of mass a metre high",
        xml: include_str!("../../models/tasks/hopper.xml"),
        seconds: 1.0,
        iterations: 150,
        terms: &[
            ("sensor:com", &[0.6, 0.0, 1.0], 1.0, 200.0, Q),
            ("sensor:upright", &[0.0, 0.0, 1.0], 5.0, 50.0, Q),
            ("qvel", &[], 0.01, 1.0, Q),
            ("ctrl", &[-0.6, 1.2, -0.6], 0.2, 0.0, Q),
        ],
        goals: &[
            Goal {
                what: "centre of mass from 0.6 m ahead and 1 m high",
                quantity: "sensor:com",
                target: &[0.6, 0.0, 1.0],
                within: 0.1,
                unit: "m",
            },
            Goal {
                what: "trunk's axis from upright",
                quantity: "sensor:upright",
                target: &[0.0, 0.0, 1.0],
                within: 0.1,
                unit: "",
            },
        ],
    },
    Task {
        name: "humanoid",
        what: "a humanoid stands up from a deep squat",
        xml: include_str!("../../models/tasks/humanoid.xml"),
        seconds: 1.0,
        iterations: 60,
        terms: &[
            ("sensor:com", &[0.03, 0.0, 0.96], 20.0, 20.0, Q),
            ("sensor:head", &[0.03, 0.0, 1.53], 10.0, 10.0, Q),
            ("sensor:upright", &[0.0, 0.0, 1.0], 20.0, 20.0, Q),
            ("sensor:velocity", &[], 0.2, 20.0, Q),
            ("qvel", &[], 0.02, 0.5, Q),
            ("ctrl", &[], 1.0, 0.0, Q),
        ],
        goals: &[
            Goal {
                what: "head from where it is of one who stands, 1.53 m high",
                quantity: "sensor:head",
                target: &[0.03, 0.0, 1.53],
                within: 0.05,
                unit: "m",
            },
            Goal {
                what: "torso's axis from upright",
                quantity: "sensor:upright",
                target: &[0.0, 0.0, 1.0],
                within: 0.1,
                unit: "",
            },
            Goal {
                what: "velocity of the centre of mass",
                quantity: "sensor:velocity",
                target: &[],
                within: 0.2,
                unit: "m/s",
            },
        ],
    },
];

impl Task {
    /// The task of a name.
    ///
    /// # Errors
    ///
    /// If there is none.
    pub fn named(name: &str) -> Result<Task, Error> {
        TASKS.into_iter().find(|task| task.name == name).ok_or_else(|| {
            let remedy = suggest::or_list(name, TASKS.iter().map(|task| task.name));
            Error::Unknown(format!("there is no task {name:?}; {remedy}"))
        })
    }

    /// The terms of its cost.
    ///
    /// # Errors
    ///
    /// None of the tasks that there are.
    pub fn terms(&self) -> Result<Vec<Term>, Error> {
        let term = |(quantity, goal, running, terminal, norm): &Weight| {
            Ok(Term { norm: *norm, ..Term::new(quantity, goal, *running, *terminal)? })
        };
        self.terms.iter().map(term).collect()
    }

    /// The problem, over its own time or over so many seconds.
    ///
    /// # Errors
    ///
    /// If that is no time of at least a step, or of more than a million.
    pub fn problem(&self, seconds: Option<f64>) -> Result<Problem, Error> {
        let model = Model::from_xml_string(self.xml, &LoadOptions::default())?;
        let seconds = seconds.unwrap_or(self.seconds);
        let steps = (seconds / model.tables().options.timestep).round();
        if !(1.0..=1e6).contains(&steps) {
            let step = model.tables().options.timestep;
            return Err(Error::Options(format!("the horizon is {seconds} s; expected 1 to 1000000 steps of {step} s")));
        }
        let key = model.names().keys.id("start").and_then(|key| model.keys().get(key).cloned());
        let key = key.unwrap_or_else(|| model.initial_key());
        let steps = steps as usize;
        Problem::new(&model, &self.terms()?, steps)?.start(&key)?.controls(&key.ctrl.repeat(steps))
    }

    /// How far a motion is from each goal.
    ///
    /// # Errors
    ///
    /// If the motion is of another problem.
    pub fn reached(&self, problem: &Problem, motion: &Motion) -> Result<Vec<Reached>, Error> {
        let reached = |goal: &Goal| {
            let distance = motion.distance(problem, &Term::new(goal.quantity, goal.target, 0.0, 1.0)?)?;
            Ok(Reached { goal: *goal, distance })
        };
        self.goals.iter().map(reached).collect()
    }
}
