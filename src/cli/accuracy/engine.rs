//! What an engine is asked for, and what it gives back: the same for every engine.

use serde_json::{Value, json};

use super::ruler::Sample;

/// A way to step a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Integrator.
    pub integrator: String,
    /// Contact cone, if it is not the model's.
    pub cone: Option<String>,
    /// Solver.
    pub solver: String,
    /// Time step, s.
    pub timestep: f64,
    /// Iterations of the solver, if it is not to stop by itself.
    pub iterations: Option<usize>,
}

impl Setting {
    /// As attributes of MJCF's `option`.
    pub fn options(&self) -> Vec<(String, String)> {
        let pair = |name: &str, value: String| (name.to_owned(), value);
        let mut all = vec![
            pair("timestep", format!("{:?}", self.timestep)),
            pair("integrator", self.integrator.clone()),
            pair("solver", self.solver.clone()),
        ];
        if let Some(n) = self.iterations {
            all.extend([pair("iterations", n.to_string()), pair("tolerance", "0".into())]);
        }
        all.extend(self.cone.as_ref().map(|cone| pair("cone", cone.clone())));
        all
    }

    /// In words.
    pub fn name(&self) -> String {
        let cone = self.cone.as_deref().map_or(String::new(), |cone| format!(" {cone}"));
        let solver = if self.solver == "Newton" { String::new() } else { format!(" {}", self.solver) };
        let iterations = self.iterations.map_or(String::new(), |n| format!(" {n}"));
        format!("{}{cone}{solver}{iterations}", self.integrator)
    }
}

/// Runs to be made: all worlds go through the same number of intervals, in each of which controls are held.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// The model, MJCF.
    pub xml: &'a str,
    /// How it is stepped.
    pub setting: &'a Setting,
    /// Where worlds start.
    pub starts: &'a [Sample],
    /// Their controls, `[world][interval][actuator]`; empty: none.
    pub controls: &'a [Vec<Vec<f64>>],
    /// Steps of an interval.
    pub steps: usize,
    /// Number of intervals.
    pub intervals: usize,
    /// Intervals from one sample to the next.
    pub every: usize,
    /// What is timed.
    pub timing: Timing<'a>,
}

/// A run whose steps are timed.
#[derive(Clone, Debug)]
pub struct Timing<'a> {
    /// Where worlds start.
    pub start: &'a Sample,
    /// Their controls, which are held.
    pub control: &'a [f64],
    /// Number of steps.
    pub steps: usize,
    /// Least time spent, s.
    pub seconds: f64,
    /// Number of worlds, for engines that step many at once.
    pub batch: usize,
}

/// A world's way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Its states, the start first; as many as there were before it was lost.
    pub samples: Vec<Sample>,
    /// Whether it was lost.
    pub lost: bool,
}

/// What came of a job.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// One per world.
    pub trajectories: Vec<Trajectory>,
    /// Wall time per step of a world on a core, s; none if all worlds were lost.
    pub seconds_per_step: Option<f64>,
}

/// Speeds beyond this, rad/s or m/s, are a loss.
const FASTEST: f64 = 1e4;

/// Whether a state is one.
pub fn sound(sample: &Sample) -> bool {
    sample.qpos.iter().all(|x| x.is_finite()) && sample.qvel.iter().all(|x| x.abs() <= FASTEST)
}

/// A state as JSON.
pub fn to_json(sample: &Sample) -> Value {
    json!({ "qpos": sample.qpos, "qvel": sample.qvel })
}
