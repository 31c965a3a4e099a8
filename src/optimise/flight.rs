//! Trajectories of a problem: steps with feedback, several side by side, and what a whole one depends on.

use faer::{Mat, MatRef};
use lanesim_kernels::integration::difference;
use lanesim_kernels::state::Status;

use super::cost::{Point, Quadratic, When};
use super::{Problem, Settings};
use crate::cloud::Transition;
use crate::error::Error;
use crate::field::Field;
use crate::model::{Key, Model};
use crate::outputs::Output;
use crate::rollout::{Controls, Rollout};
use crate::rows::{Rows, Strided, Values};
use crate::status::OnDiverge;
use crate::worlds::{Options, Worlds};

/// States, controls and sensors along a way, with what it costs.
#[derive(Clone, Debug, Default)]
pub(super) struct Trajectory {
    /// `[steps + 1, nq]`.
    pub qpos: Vec<f64>,
    /// `[steps + 1, nv]`.
    pub qvel: Vec<f64>,
    /// `[steps + 1, na]`.
    pub act: Vec<f64>,
    /// `[steps, nu]`, then zeros.
    pub ctrl: Vec<f64>,
    /// `[steps + 1, nsensordata]`.
    pub sensordata: Vec<f64>,
    /// Infinite if it was not possible.
    pub cost: f64,
}

/// Row `t` of an array.
pub(super) fn row(values: &[f64], t: usize, width: usize) -> &[f64] {
    &values[t * width..(t + 1) * width]
}

impl Trajectory {
    /// What costs are told of a step.
    pub fn point(&self, model: &Model, t: usize) -> Point<'_> {
        let sizes = &model.tables().sizes;
        let sensors = if self.sensordata.is_empty() { 0 } else { sizes.nsensordata };
        Point {
            qpos: row(&self.qpos, t, sizes.nq),
            qvel: row(&self.qvel, t, sizes.nv),
            ctrl: row(&self.ctrl, t, sizes.nu),
            sensordata: row(&self.sensordata, t, sensors),
        }
    }
}

/// How controls follow the state: u + step k + K (x ⊖ nominal x).
#[derive(Clone, Debug)]
pub(super) struct Gains {
    /// k, `[steps]` of nu.
    pub forward: Vec<Vec<f64>>,
    /// K, `[steps]` of `[nu, n]`.
    pub feedback: Vec<Mat<f64>>,
}

/// The linear model of a trajectory's steps, and the quadratic one of its costs.
pub(super) struct Linear {
    n: usize,
    nu: usize,
    slopes: Transition,
    pub costs: Vec<Quadratic>,
}

impl Linear {
    /// The next state by the state.
    pub fn a(&self, t: usize) -> MatRef<'_, f64> {
        MatRef::from_row_major_slice(row(&self.slopes.a, t, self.n * self.n), self.n, self.n)
    }

    /// The next state by controls.
    pub fn b(&self, t: usize) -> MatRef<'_, f64> {
        MatRef::from_row_major_slice(row(&self.slopes.b, t, self.n * self.nu), self.n, self.nu)
    }
}

/// Worlds in which a problem's trajectories are tried, and worlds for the states along one.
pub(super) struct Flight<'a> {
    problem: &'a Problem,
    settings: &'a Settings,
    trials: Worlds,
    states: Worlds,
}

/// Worlds that all have the numbers of a key, whatever they did before.
pub(super) fn restart(worlds: &mut Worlds, key: &Key) -> Result<(), Error> {
    worlds.reset_all(None, None)?;
    for (field, _) in Field::ALL {
        let Some(values) = key.field(field).filter(|values| !values.is_empty()) else { continue };
        worlds.write_all(field, &Strided { values: Values::F64(values), offset: 0, stride: 0 }, None)?;
    }
    Ok(())
}

impl<'a> Flight<'a> {
    /// For so many trials at once.
    pub fn new(problem: &'a Problem, settings: &'a Settings, trials: usize) -> Result<Self, Error> {
        // A trial that diverges is one that costs too much, no more.
        let options = Options { on_diverge: OnDiverge::Freeze, ..settings.options.clone() };
        let trials = Worlds::new(&problem.model, trials, &options)?;
        let mut states = Worlds::new(&problem.model, problem.steps + 1, &options)?;
        restart(&mut states, &problem.start)?;
        Ok(Flight { problem, settings, trials, states })
    }

    /// Trajectories with feedback, one for each length of the step, from the start on.
    pub fn fly(
        &mut self,
        nominal: &Trajectory,
        gains: Option<&Gains>,
        lengths: &[f64],
    ) -> Result<Vec<Trajectory>, Error> {
        let problem = self.problem;
        let (model, steps) = (&problem.model, problem.steps);
        let sizes = &model.tables().sizes;
        restart(&mut self.trials, &problem.start)?;
        let mut all = vec![Trajectory::default(); lengths.len()];
        let key = &problem.start;
        for one in &mut all {
            (one.qpos, one.qvel, one.act) = (key.qpos.clone(), key.qvel.clone(), key.act.clone());
        }
        let names: Vec<&str> =
            if problem.cost.senses { vec!["qpos", "qvel", "sensordata"] } else { vec!["qpos", "qvel"] };
        let outputs = names.iter().map(|name| Output::named(name)).collect::<Result<Vec<_>, _>>()?;
        let count = self.trials.nworld();
        let widths = [sizes.nq, sizes.nv, sizes.nsensordata];
        let mut arrays: Vec<Vec<f64>> = (0..names.len()).map(|i| vec![0.0; count * widths[i]]).collect();
        let mut act = vec![0.0; count * sizes.na];
        let mut ctrl = vec![0.0; count * sizes.nu];
        for t in 0..steps {
            for (world, (one, length)) in all.iter_mut().zip(lengths).enumerate() {
                let u = problem.control(one, (nominal, gains), t, *length);
                ctrl[world * sizes.nu..(world + 1) * sizes.nu].copy_from_slice(&u);
                one.ctrl.extend(u);
            }
            let rollout =
                Rollout { nstep: 1, controls: Controls::Given(&ctrl), outputs: &outputs, ..Rollout::default() };
            self.trials.rollout_into(&rollout, arrays.iter_mut().map(|array| Rows::F64(array)).collect())?;
            if sizes.na > 0 {
                act = self.trials.get_all(Field::Act);
            }
            for (world, one) in all.iter_mut().enumerate() {
                one.qpos.extend_from_slice(row(&arrays[0], world, sizes.nq));
                one.qvel.extend_from_slice(row(&arrays[1], world, sizes.nv));
                one.act.extend_from_slice(row(&act, world, sizes.na));
                if problem.cost.senses {
                    one.sensordata.extend_from_slice(row(&arrays[2], world, sizes.nsensordata));
                }
            }
        }
        if problem.cost.senses {
            self.trials.read_all(&["sensordata"], vec![Rows::F64(&mut arrays[2])])?;
        }
        for (world, one) in all.iter_mut().enumerate() {
            one.ctrl.extend(vec![0.0; sizes.nu]);
            if problem.cost.senses {
                one.sensordata.extend_from_slice(row(&arrays[2], world, sizes.nsensordata));
            }
            let lost = self.trials.status(world)?.contains(Status::FROZEN);
            one.cost = if lost { f64::INFINITY } else { problem.cost_of(one) };
        }
        Ok(all)
    }

    /// Derivatives of all steps, in one call, and of all costs. An error if a state has none.
    pub fn linearise(&mut self, at: &Trajectory) -> Result<Linear, Error> {
        let (problem, model) = (self.problem, &self.problem.model);
        let sizes = &model.tables().sizes;
        let fields = [(Field::Qpos, &at.qpos), (Field::Qvel, &at.qvel), (Field::Act, &at.act), (Field::Ctrl, &at.ctrl)];
        for (field, values) in fields {
            if !values.is_empty() {
                let rows = Strided { values: Values::F64(values), offset: 0, stride: field.len(model) };
                self.states.write_all(field, &rows, None)?;
            }
        }
        let scheme = crate::cloud::Scheme { sensors: problem.cost.senses, ..self.settings.scheme };
        let slopes = self.states.transition(&scheme)?;
        let (n, nu, ns) = (2 * sizes.nv + sizes.na, sizes.nu, if problem.cost.senses { sizes.nsensordata } else { 0 });
        // Of the last state no step is taken; only its sensors count.
        let steps = [&slopes.a[..problem.steps * n * n], &slopes.b[..problem.steps * n * nu], &slopes.c, &slopes.d];
        if steps.into_iter().flatten().any(|x| !x.is_finite()) {
            return Err(Error::Input(
                "a state of the trajectory has no derivatives: its step diverges, or its quaternions have no length"
                    .into(),
            ));
        }
        let cost = |t: usize| {
            let sensors = (row(&slopes.c, t, ns * n), row(&slopes.d, t, ns * nu));
            problem.cost.quadratic(model, &at.point(model, t), sensors, problem.when(t))
        };
        let costs = (0..=problem.steps).map(cost).collect();
        Ok(Linear { n, nu, slopes, costs })
    }
}

impl Problem {
    /// When the cost of a state is due.
    pub(super) fn when(&self, t: usize) -> When {
        if t < self.steps { When::Running(self.model.tables().options.timestep) } else { When::Terminal }
    }

    /// The cost of a trajectory, infinite if it is no number.
    pub(super) fn cost_of(&self, at: &Trajectory) -> f64 {
        let due = |t: usize| self.cost.value(&self.model, &at.point(&self.model, t), self.when(t));
        let cost: f64 = (0..=self.steps).map(due).sum();
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// Controls of a step: those of the nominal trajectory, plus feedback, within bounds.
    fn control(
        &self,
        one: &Trajectory,
        (nominal, gains): (&Trajectory, Option<&Gains>),
        t: usize,
        length: f64,
    ) -> Vec<f64> {
        let sizes = &self.model.tables().sizes;
        let mut u = row(&nominal.ctrl, t, sizes.nu).to_vec();
        if let Some(gains) = gains {
            let apart = self.apart(one, nominal, t);
            for i in 0..sizes.nu {
                let back: f64 = apart.iter().enumerate().map(|(k, x)| gains.feedback[t][(i, k)] * x).sum();
                u[i] += length * gains.forward[t][i] + back;
            }
        }
        for (u, [lo, hi]) in u.iter_mut().zip(&self.bounds) {
            // Of a state that is lost anything will do.
            *u = if u.is_finite() { u.max(*lo).min(*hi) } else { lo.max(0.0).min(*hi) };
        }
        u
    }

    /// The difference of two states, n numbers.
    fn apart(&self, one: &Trajectory, from: &Trajectory, t: usize) -> Vec<f64> {
        let sizes = &self.model.tables().sizes;
        let mut out = vec![0.0; 2 * sizes.nv + sizes.na];
        let (qpos, rest) = out.split_at_mut(sizes.nv);
        difference(self.model.tables(), row(&from.qpos, t, sizes.nq), row(&one.qpos, t, sizes.nq), qpos);
        let (qvel, act) = rest.split_at_mut(sizes.nv);
        for (out, to, from, width) in [(qvel, &one.qvel, &from.qvel, sizes.nv), (act, &one.act, &from.act, sizes.na)] {
            let rows = row(to, t, width).iter().zip(row(from, t, width));
            out.iter_mut().zip(rows).for_each(|(out, (to, from))| *out = to - from);
        }
        out
    }
}
