//! Optimal motions: a model, a start, and a cost that is a sum of weighted residuals; out come controls, the motion, and gains that follow it.
//!
//! Derivatives of a whole trajectory are one call of [`crate::cloud`], step lengths are tried side by side as worlds of one batch.
//!
//! ```
//! use lanesim::Model;
//! use lanesim::optimise::{Problem, Settings, Term, optimise};
//!
//! let xml = "<mujoco><option timestep='0.02'/><worldbody><body><joint name='x' type='slide' axis='1 0 0'/><geom size='.1' mass='1'/></body></worldbody>
//!     <actuator><motor joint='x' ctrlrange='-5 5'/></actuator></mujoco>";
//! let model = Model::from_xml_string(xml, &Default::default())?;
//! // One metre within a second, and stand still there.
//! let terms = [Term::new("qpos:x", &[1.0], 0.0, 1e3)?, Term::new("qvel", &[], 0.0, 1e3)?, Term::new("ctrl", &[], 0.01, 0.0)?];
//! let problem = Problem::new(&model, &terms, 50)?;
//! let motion = optimise(&problem, &Settings::default())?;
//! assert!((motion.qpos[50] - 1.0).abs() < 0.01 && motion.ctrl.iter().all(|u| u.abs() <= 5.0));
//! # Ok::<(), lanesim::Error>(())
//! ```

mod banded;
mod boxqp;
mod cost;
mod flight;
mod ilqg;
mod positions;
mod tangent;
mod tasks;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

pub use self::boxqp::{Minimum, minimise};
pub use self::cost::{Cost, Norm, Quantity, Term};
use self::flight::{Gains, Trajectory};
pub use self::tasks::{Goal, Reached, TASKS, Task};
use crate::cloud::{self, Scheme};
use crate::error::Error;
use crate::model::{Key, Model};
use crate::rows::Values;
use crate::worlds::{Options, Precision};

/// What is to be found.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The model, with sensors for what terms are about, and solved accurately (see [`cloud::accurate`]).
    model: Model,
    cost: Cost,
    steps: usize,
    start: Key,
    /// `[steps, nu]`.
    controls: Vec<f64>,
    /// Bounds of controls, infinite where there are none.
    bounds: Vec<[f64; 2]>,
}

/// How an optimal motion is searched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Differential dynamic programming with Gauss-Newton Hessians: variables are controls, motions are always possible, and there are gains.
    #[default]
    Ilqg,
    /// Gauss-Newton over positions: velocities and accelerations are their differences, forces those of inverse dynamics, and that no force is
    /// missing is a constraint. Of models whose actuators are motors on hinges and slides. Gains and the motion are those of a last pass of iLQG.
    GaussNewton,
}

/// How the search is done.
#[derive(Clone, Debug)]
pub struct Settings {
    /// By which method.
    pub method: Method,
    /// Most iterations.
    pub iterations: usize,
    /// It ends when an iteration can gain no more than this share of the cost.
    pub tolerance: f64,
    /// Regularisation at the start.
    pub regularisation: f64,
    /// Differences by which derivatives are taken; sensors are asked for where the cost needs them.
    pub scheme: Scheme,
    /// How worlds work; double precision.
    pub options: Options,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: Method::Ilqg,
            iterations: 200,
            tolerance: 1e-6,
            regularisation: 1e-3,
            scheme: Scheme { centred: true, ..Scheme::default() },
            options: Options::default(),
        }
    }
}

/// An iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Its number; 0 is the start.
    pub iteration: usize,
    /// Cost at its end.
    pub cost: f64,
    /// Seconds since the start.
    pub seconds: f64,
    /// Regularisation with which it was computed.
    pub regularisation: f64,
    /// Length of the step that was taken; 0: none.
    pub step: f64,
    /// Largest force that the motion needs and no actuator gives, N or N m: 0 of methods whose motions are steps of the model.
    pub residual: f64,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Nothing more is to be gained.
    Converged,
    /// All iterations are done.
    Iterations,
    /// No step makes the cost less, whatever the regularisation.
    Stuck,
}

impl End {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            End::Converged => "converged",
            End::Iterations => "iterations used up",
            End::Stuck => "no step made it better",
        }
    }
}

/// Where time went, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Derivatives of steps and costs.
    pub derivatives: f64,
    /// Backward passes, or factors.
    pub backward: f64,
    /// Trials of step lengths.
    pub search: f64,
}

/// A motion that was found.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Positions, `[steps + 1, nq]`.
    pub qpos: Vec<f64>,
    /// Velocities, `[steps + 1, nv]`.
    pub qvel: Vec<f64>,
    /// Activations, `[steps + 1, na]`.
    pub act: Vec<f64>,
    /// Controls, `[steps, nu]`.
    pub ctrl: Vec<f64>,
    /// How controls should follow differences of the state, `[steps, nu, n]`, n = 2 nv + na as in [`cloud::Transition`].
    pub gains: Vec<f64>,
    /// Iterations, the start first.
    pub rows: Vec<Row>,
    /// Why the search ended.
    pub end: End,
    /// Where its time went.
    pub timing: Timing,
    /// Largest force that the positions that were found need and no actuator gives, N or N m: 0 where they are steps of the model.
    pub residual: f64,
    /// The same, with what else is known of it.
    at: Trajectory,
}

impl Motion {
    /// Cost of the motion.
    pub fn cost(&self) -> f64 {
        self.at.cost
    }

    /// How far the motion's end is from a term's goal: the norm of the differences, m, rad and so on.
    ///
    /// # Errors
    ///
    /// As of [`Problem::new`].
    pub fn distance(&self, problem: &Problem, term: &Term) -> Result<f64, Error> {
        let (model, cost) = Cost::new(&problem.model, std::slice::from_ref(term))?;
        let mut at = self.at.clone();
        if cost.senses {
            at.sensordata = sensors_at_the_end(&model, problem, &at)?;
        }
        Ok(cost.distance(&model, &at.point(&model, problem.steps)))
    }
}

/// Sensors of the last state, in a row of the last step; nothing before it is filled in.
fn sensors_at_the_end(model: &Model, problem: &Problem, at: &Trajectory) -> Result<Vec<f64>, Error> {
    use crate::field::Field;
    let mut worlds = crate::worlds::Worlds::new(model, 1, &Options { threads: Some(1), ..Options::default() })?;
    let end = at.point(&problem.model, problem.steps);
    for (field, values) in [
        (Field::Qpos, end.qpos),
        (Field::Qvel, end.qvel),
        (Field::MocapPos, &problem.start.mpos),
        (Field::MocapQuat, &problem.start.mquat),
    ] {
        worlds.set(field, 0, values)?;
    }
    let width = model.tables().sizes.nsensordata;
    let mut all = vec![0.0; (problem.steps + 1) * width];
    worlds.read_all(&["sensordata"], vec![crate::rows::Rows::F64(&mut all[problem.steps * width..])])?;
    Ok(all)
}

/// What a method hands over.
struct Found {
    at: Trajectory,
    gains: Gains,
    rows: Vec<Row>,
    end: End,
    timing: Timing,
    residual: f64,
}

/// Seconds that something took, added to a sum.
fn timed<T>(sum: &mut f64, what: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let out = what();
    *sum += start.elapsed().as_secs_f64();
    out
}

/// Who follows a search.
struct Watch<'a> {
    progress: Option<&'a AtomicU64>,
    cancel: Option<&'a AtomicBool>,
}

impl Watch<'_> {
    /// Counts an iteration; an error if there should be no more.
    fn next(&mut self) -> Result<(), Error> {
        if self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            return Err(Error::Cancelled);
        }
        if let Some(progress) = self.progress {
            progress.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    }
}

impl Problem {
    /// A motion of so many steps, from the reference configuration at rest, first without controls.
    ///
    /// # Errors
    ///
    /// If the model has no actuators, there are no steps, or a term is wrong.
    pub fn new(model: &Model, terms: &[Term], steps: usize) -> Result<Problem, Error> {
        if steps == 0 {
            return Err(Error::Options("the horizon has no step; expected at least one".into()));
        }
        if model.tables().sizes.nu == 0 {
            return Err(Error::Input("the model has no actuators: there is nothing to optimise".into()));
        }
        if terms.is_empty() {
            return Err(Error::Input("the cost has no terms; give at least one".into()));
        }
        let (model, cost) = Cost::new(&cloud::accurate(model)?, terms)?;
        let bounds = model.tables().controls.iter().map(|control| {
            if control.limited && model.tables().options.flags.clampctrl {
                control.range
            } else {
                [f64::NEG_INFINITY, f64::INFINITY]
            }
        });
        let bounds: Vec<_> = bounds.collect();
        let start = model.initial_key();
        let controls = bounds.iter().map(|[lo, hi]| lo.max(0.0).min(*hi)).collect::<Vec<_>>().repeat(steps);
        Ok(Problem { cost, steps, start, controls, bounds, model })
    }

    /// From another start: positions, velocities, activations and all else that a keyframe has but time and controls.
    ///
    /// # Errors
    ///
    /// If an array has another length or holds a number that is not finite, or a quaternion of length zero.
    pub fn start(self, key: &Key) -> Result<Problem, Error> {
        let sizes = &self.model.tables().sizes;
        for (name, values, expected) in
            [("qpos", &key.qpos, sizes.nq), ("qvel", &key.qvel, sizes.nv), ("act", &key.act, sizes.na)]
        {
            Values::F64(values).check_finite(name, &[expected])?;
        }
        cloud::check_quaternions(&self.model, Values::F64(&key.qpos), &[sizes.nq])?;
        Ok(Problem { start: Key { time: 0.0, ctrl: vec![0.0; sizes.nu], ..key.clone() }, ..self })
    }

    /// With these first controls, `[steps, nu]`, which are clamped to their ranges.
    ///
    /// # Errors
    ///
    /// If there are more or fewer, or one is not finite.
    pub fn controls(self, controls: &[f64]) -> Result<Problem, Error> {
        Values::F64(controls).check_finite("ctrl", &[self.steps, self.bounds.len()])?;
        let bounds = self.bounds.iter().cycle();
        let controls = controls.iter().zip(bounds).map(|(u, [lo, hi])| u.max(*lo).min(*hi)).collect();
        Ok(Problem { controls, ..self })
    }

    /// The model that is stepped: with sensors for what terms are about, and constraints solved accurately.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// The controls with which the search begins, `[steps, nu]`.
    pub fn first_controls(&self) -> &[f64] {
        &self.controls
    }

    /// Numbers of a state's difference.
    fn n(&self) -> usize {
        let sizes = &self.model.tables().sizes;
        2 * sizes.nv + sizes.na
    }
}

/// Searches an optimal motion.
///
/// # Errors
///
/// If settings are out of bounds, or the motion under the first controls diverges.
pub fn optimise(problem: &Problem, settings: &Settings) -> Result<Motion, Error> {
    optimise_watched(problem, settings, None, None)
}

/// The same, counting iterations; once the flag turns true the result is [`Error::Cancelled`].
///
/// # Errors
///
/// As above.
pub fn optimise_watched(
    problem: &Problem,
    settings: &Settings,
    progress: Option<&AtomicU64>,
    cancel: Option<&AtomicBool>,
) -> Result<Motion, Error> {
    settings.check()?;
    let mut watch = Watch { progress, cancel };
    let found = match settings.method {
        Method::Ilqg => ilqg::run(problem, settings, &mut watch)?,
        Method::GaussNewton => positions::run(problem, settings, &mut watch)?,
    };
    Ok(found.motion(problem))
}

impl Settings {
    fn check(&self) -> Result<(), Error> {
        if self.options.precision != Precision::F64 {
            return Err(Error::Options("motions are optimised in double precision; leave precision at f64".into()));
        }
        for (name, x) in [("tolerance", self.tolerance), ("regularisation", self.regularisation)] {
            if !(x.is_finite() && x >= 0.0) {
                return Err(Error::Options(format!("{name} is {x}; expected 0 or more")));
            }
        }
        Ok(())
    }
}

impl Found {
    fn motion(self, problem: &Problem) -> Motion {
        let (n, nu, at) = (problem.n(), problem.bounds.len(), self.at);
        let gains = self
            .gains
            .feedback
            .iter()
            .flat_map(|k| (0..nu).flat_map(move |i| (0..n).map(move |j| k[(i, j)])))
            .collect();
        Motion {
            qpos: at.qpos.clone(),
            qvel: at.qvel.clone(),
            act: at.act.clone(),
            ctrl: at.ctrl[..problem.steps * nu].to_vec(),
            gains,
            rows: self.rows,
            end: self.end,
            timing: self.timing,
            residual: self.residual,
            at,
        }
    }
}
