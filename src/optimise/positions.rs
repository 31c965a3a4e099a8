//! Gauss-Newton over trajectories of positions: velocities are differences of positions, accelerations those of velocities, and inverse dynamics have the
//! forces. What no actuator can give is a constraint, held by an augmented Lagrangian; a step couples three successive positions, so the Hessian is a band.

use std::time::Instant;

use faer::Mat;
use lanesim_kernels::integration::{difference, displace};
use lanesim_kernels::model::{JointKind, NONE};

use super::banded::Banded;
use super::flight::{Flight, Trajectory, restart, row};
use super::{End, Found, Problem, Row, Settings, Timing, Watch, ilqg, tangent};
use crate::cloud::{Follow, Solving, Target};
use crate::error::Error;
use crate::field::Field;
use crate::model::Model;
use crate::rows::{Rows, Strided, Values};
use crate::status::OnDiverge;
use crate::worlds::{Options, Worlds};

/// Step lengths that are tried at once.
const LENGTHS: usize = 8;
/// First weight of forces that no actuator gives, and by how much it grows where they do not shrink.
const PENALTY: (f64, f64) = (1.0, 4.0);
/// Largest weight.
const MOST_PENALTY: f64 = 1e4;
/// Share of the largest force that may be missing at the end.
const MISSING: f64 = 1e-5;
/// Share of the merit that an iteration must gain, or multipliers are renewed.
const PAUSE: f64 = 1e-4;
/// Least regularisation where there was some.
const LEAST: f64 = 1e-9;
/// Most regularisation.
const MOST: f64 = 1e10;

/// Which dof an actuator drives, and its force per unit of control.
type Drive = (usize, f64);

/// A trajectory of positions with what follows from it.
#[derive(Clone, Default)]
struct Way {
    at: Trajectory,
    /// `[steps, nv]`.
    qacc: Vec<f64>,
    /// What inverse dynamics ask for, `[steps, nv]`.
    force: Vec<f64>,
    /// Cost, with what constraints add.
    merit: f64,
}

/// A constraint's multipliers: forces that no actuator gives, `[steps, nv]`, and controls beyond their bounds, `[steps, nu]`.
struct Multipliers {
    weight: f64,
    missing: Vec<f64>,
    beyond: Vec<f64>,
}

/// The problem with what inverse dynamics need.
struct Inverse<'a> {
    problem: &'a Problem,
    settings: &'a Settings,
    drives: Vec<Drive>,
    /// Whether a dof has no actuator.
    free: Vec<bool>,
    trials: Worlds,
    states: Worlds,
    h: f64,
}

/// The drives of actuators, if all are motors on joints.
fn drives(model: &Model) -> Result<Vec<Drive>, Error> {
    let tables = model.tables();
    let drive = |(i, actuator): (usize, &lanesim_kernels::model::Actuator<f64>)| {
        let joint = (actuator.joint != NONE).then(|| &tables.joints[actuator.joint as usize]);
        let simple =
            joint.filter(|joint| matches!(joint.kind, JointKind::Slide | JointKind::Hinge) && !joint.force_limited);
        let plain = !actuator.follows()
            && !actuator.disabled
            && !actuator.force_limited
            && actuator.act == NONE
            && actuator.controller == NONE
            && actuator.servo == NONE;
        let force = actuator.gear[0] * actuator.gain[0];
        match simple {
            Some(joint) if plain && force != 0.0 => Ok((joint.dof as usize, force)),
            _ => {
                let name = model.names().actuators.name(i);
                Err(Error::Input(format!(
                    "actuator {i} {name:?}: Gauss-Newton over positions needs motors on hinges and slides, without activations, bias and bounds of \
                     force; use the method ilqg"
                )))
            }
        }
    };
    let drives: Vec<Drive> = tables.actuators.iter().enumerate().map(drive).collect::<Result<_, _>>()?;
    for (i, (dof, _)) in drives.iter().enumerate() {
        if let Some(k) = drives[..i].iter().position(|(other, _)| other == dof) {
            return Err(Error::Input(format!(
                "actuators {k} and {i} drive the same joint: Gauss-Newton over positions needs one for each; use the method ilqg"
            )));
        }
    }
    Ok(drives)
}

/// The same model, whose inverse dynamics are those of its steps.
fn discrete(model: &Model) -> Result<Model, Error> {
    let mut spec = model.basis().spec.clone();
    spec.option.flags.invdiscrete = true;
    let model = Model::from_spec(&spec)?;
    crate::inverse::check_model(&model)?;
    Ok(model)
}

/// Goes on until nothing is to be gained and no force is missing, or it is told to stop.
pub(super) fn run(problem: &Problem, settings: &Settings, watch: &mut Watch<'_>) -> Result<Found, Error> {
    let (begin, mut timing) = (Instant::now(), Timing::default());
    let mut inverse = Inverse::new(problem, settings)?;
    let (steps, nv, nu) = (problem.steps, inverse.free.len(), inverse.drives.len());
    let mut held = Multipliers { weight: PENALTY.0, missing: vec![0.0; steps * nv], beyond: vec![0.0; steps * nu] };
    let start = inverse.start()?;
    let mut at = inverse.ways(&[start], &held)?.swap_remove(0);
    if !at.merit.is_finite() {
        return Err(Error::Input("the first trajectory has no finite cost or forces".into()));
    }
    let (mut mu, mut end, mut worst) = (settings.regularisation, End::Iterations, f64::INFINITY);
    let note = |iteration: usize, at: &Way, missing: f64, (regularisation, step): (f64, f64)| {
        let seconds = begin.elapsed().as_secs_f64();
        Row { iteration, cost: at.at.cost, seconds, regularisation, step, residual: missing }
    };
    let mut rows = vec![note(0, &at, inverse.missing(&at).0, (mu, 0.0))];
    for iteration in 1..=settings.iterations {
        watch.next()?;
        let (hessian, gradient) = super::timed(&mut timing.derivatives, || inverse.linearise(&at, &held))?;
        let (used, best) = inverse.search(&at, &held, (&hessian, &gradient), (&mut mu, &mut timing))?;
        let gained = best.as_ref().map_or(0.0, |(way, _)| at.merit - way.merit);
        let step = best.as_ref().map_or(0.0, |(_, length)| *length);
        if let Some((way, _)) = best {
            at = way;
        }
        let (missing, most) = inverse.missing(&at);
        rows.push(note(iteration, &at, missing, (used, step)));
        if gained > PAUSE * at.merit.abs() {
            continue;
        }
        let fits = missing <= MISSING * most.max(1e-12);
        if fits && gained <= settings.tolerance * at.at.cost.abs() {
            end = End::Converged;
            break;
        }
        if fits {
            continue;
        }
        if step == 0.0 && held.weight >= MOST_PENALTY {
            end = End::Stuck;
            break;
        }
        inverse.renew(&at, &mut held);
        if missing > 0.5 * worst {
            let weight = (held.weight * PENALTY.1).min(MOST_PENALTY);
            if weight > held.weight {
                // Another problem: what was learned of steps is forgotten.
                (held.weight, mu) = (weight, settings.regularisation);
            }
        }
        worst = missing;
        at.merit = inverse.merit(&at, &held);
    }
    inverse.fly(at, rows, (end, timing))
}

impl<'a> Inverse<'a> {
    fn new(problem: &'a Problem, settings: &'a Settings) -> Result<Self, Error> {
        let model = discrete(&problem.model)?;
        let tables = model.tables();
        let drives = drives(&model)?;
        let free = (0..tables.sizes.nv).map(|dof| drives.iter().all(|(driven, _)| *driven != dof)).collect();
        let options = Options { on_diverge: OnDiverge::Freeze, ..settings.options.clone() };
        let trials = Worlds::new(&model, LENGTHS * (problem.steps + 1), &options)?;
        let states = Worlds::new(&model, problem.steps + 1, &options)?;
        Ok(Inverse { problem, settings, drives, free, trials, states, h: tables.options.timestep })
    }

    /// Positions under the first controls.
    fn start(&self) -> Result<Vec<f64>, Error> {
        let first = Trajectory { ctrl: self.problem.controls.clone(), ..Trajectory::default() };
        let mut flight = Flight::new(self.problem, self.settings, 1)?;
        Ok(flight.fly(&first, None, &[1.0])?.swap_remove(0).qpos)
    }

    fn nq(&self) -> usize {
        self.problem.model.tables().sizes.nq
    }

    /// `to` ⊖ `from` of positions of two steps.
    fn moved(&self, qpos: &[f64], t: usize) -> Vec<f64> {
        let mut out = vec![0.0; self.free.len()];
        let at = |t: usize| row(qpos, t, self.nq());
        difference(self.problem.model.tables(), at(t - 1), at(t), &mut out);
        out
    }

    /// What follows from trajectories of positions, at most as many as there are lengths.
    fn ways(&mut self, all: &[Vec<f64>], held: &Multipliers) -> Result<Vec<Way>, Error> {
        let (steps, nv, h) = (self.problem.steps, self.free.len(), self.h);
        let mut ways: Vec<Way> = Vec::with_capacity(all.len());
        for qpos in all {
            let mut qvel = self.problem.start.qvel.clone();
            (1..=steps).for_each(|t| qvel.extend(self.moved(qpos, t).iter().map(|x| x / h)));
            let qacc = (0..steps * nv).map(|i| (qvel[i + nv] - qvel[i]) / h).collect();
            let at = Trajectory { qpos: qpos.clone(), qvel, ..Trajectory::default() };
            ways.push(Way { at, qacc, ..Way::default() });
        }
        let forces = self.forces(&ways)?;
        let nu = self.drives.len();
        for (way, force) in ways.iter_mut().zip(forces.chunks((steps + 1) * nv)) {
            way.force = force[..steps * nv].to_vec();
            let control = |t: usize, (dof, gear): &Drive| way.force[t * nv + dof] / gear;
            way.at.ctrl = (0..steps)
                .flat_map(|t| self.drives.iter().map(move |drive| (t, drive)))
                .map(|(t, drive)| control(t, drive))
                .collect();
            way.at.ctrl.extend(vec![0.0; nu]);
        }
        self.sense(&mut ways)?;
        for way in &mut ways {
            way.at.cost = self.problem.cost_of(&way.at);
            way.merit = self.merit(way, held);
        }
        Ok(ways)
    }

    /// Inverse dynamics of all states of all ways, side by side; of last states nothing is wanted.
    fn forces(&mut self, ways: &[Way]) -> Result<Vec<f64>, Error> {
        let (nq, nv, count) = (self.nq(), self.free.len(), self.trials.nworld());
        restart(&mut self.trials, &self.problem.start)?;
        // Worlds that are not needed repeat the first way.
        let padded = || (0..LENGTHS).map(|k| ways.get(k).unwrap_or(&ways[0]));
        let qpos: Vec<f64> = padded().flat_map(|way| way.at.qpos.iter().copied()).collect();
        let qvel: Vec<f64> = padded().flat_map(|way| way.at.qvel.iter().copied()).collect();
        for (field, values, width) in [(Field::Qpos, &qpos, nq), (Field::Qvel, &qvel, nv)] {
            self.trials.write_all(field, &Strided { values: Values::F64(values), offset: 0, stride: width }, None)?;
        }
        let last = vec![0.0; nv];
        let qacc: Vec<f64> = padded().flat_map(|way| way.qacc.iter().chain(&last).copied()).collect();
        let mut out = vec![0.0; count * nv];
        let rows = Strided { values: Values::F64(&qacc), offset: 0, stride: nv };
        self.trials.inverse_into(&rows, Rows::F64(&mut out), None)?;
        Ok(out)
    }

    /// Sensors, where costs read them: worlds are in the ways' states.
    fn sense(&mut self, ways: &mut [Way]) -> Result<(), Error> {
        if !self.problem.cost.senses {
            return Ok(());
        }
        let (nu, ns) = (self.drives.len(), self.problem.model.tables().sizes.nsensordata);
        let ctrl: Vec<f64> = (0..LENGTHS).flat_map(|k| ways.get(k).unwrap_or(&ways[0]).at.ctrl.clone()).collect();
        self.trials.write_all(Field::Ctrl, &Strided { values: Values::F64(&ctrl), offset: 0, stride: nu }, None)?;
        let mut all = vec![0.0; self.trials.nworld() * ns];
        self.trials.read_all(&["sensordata"], vec![Rows::F64(&mut all)])?;
        let each = (self.problem.steps + 1) * ns;
        ways.iter_mut().zip(all.chunks(each)).for_each(|(way, sensors)| way.at.sensordata = sensors.to_vec());
        Ok(())
    }

    /// Largest force that no actuator gives, or that is beyond its bounds, and the largest force of all.
    fn missing(&self, way: &Way) -> (f64, f64) {
        let nv = self.free.len();
        let most = way.force.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let free = way.force.iter().enumerate().filter(|(i, _)| self.free[i % nv]).map(|(_, x)| x.abs());
        let nu = self.drives.len();
        let beyond = way.at.ctrl.iter().enumerate().map(|(i, u)| {
            let [lo, hi] = self.problem.bounds[i % nu];
            self.drives[i % nu].1.abs() * (u - hi).max(lo - u).max(0.0)
        });
        // The last row of controls is none.
        let beyond = beyond.take(self.problem.steps * nu);
        (free.chain(beyond).fold(0.0, f64::max), most)
    }

    /// How far a control is beyond its bounds, by what its multiplier adds: 0 where it is within.
    fn beyond(&self, i: usize, u: f64, held: &Multipliers) -> f64 {
        let nu = self.drives.len();
        let ([lo, hi], gear) = (self.problem.bounds[i % nu], self.drives[i % nu].1.abs());
        let push = held.beyond[i] / held.weight;
        (gear * (u - hi) + push).max(0.0) + (gear * (u - lo) + push).min(0.0)
    }

    fn merit(&self, way: &Way, held: &Multipliers) -> f64 {
        let nv = self.free.len();
        let free = (0..way.force.len()).filter(|i| self.free[i % nv]);
        let missing: f64 = free.map(|i| (way.force[i] + held.missing[i] / held.weight).powi(2)).sum();
        let controls = way.at.ctrl.iter().take(held.beyond.len()).enumerate();
        let beyond: f64 = controls.map(|(i, u)| self.beyond(i, *u, held).powi(2)).sum();
        let merit = way.at.cost + 0.5 * self.h * held.weight * (missing + beyond);
        if merit.is_finite() { merit } else { f64::INFINITY }
    }

    /// Multipliers that take over what the weight holds.
    fn renew(&self, way: &Way, held: &mut Multipliers) {
        let nv = self.free.len();
        for i in (0..way.force.len()).filter(|i| self.free[i % nv]) {
            held.missing[i] += held.weight * way.force[i];
        }
        for i in 0..held.beyond.len() {
            held.beyond[i] = held.weight * self.beyond(i, way.at.ctrl[i], held);
        }
    }

    /// Trials of steps with as much regularisation as it takes until one is better; what was used, and the best.
    #[allow(clippy::type_complexity)]
    fn search(
        &mut self,
        at: &Way,
        held: &Multipliers,
        (hessian, gradient): (&Banded, &[f64]),
        (mu, timing): (&mut f64, &mut Timing),
    ) -> Result<(f64, Option<(Way, f64)>), Error> {
        let lengths: Vec<f64> = (0..LENGTHS as i32).map(|i| 0.5_f64.powi(i)).collect();
        let down: Vec<f64> = gradient.iter().map(|x| -x).collect();
        loop {
            let used = *mu;
            if let Some(step) = super::timed(&mut timing.backward, || hessian.solve(used, &down)) {
                let trials: Vec<_> = lengths.iter().map(|length| self.displaced(&at.at.qpos, &step, *length)).collect();
                let ways = super::timed(&mut timing.search, || self.ways(&trials, held))?;
                let best = ways.into_iter().zip(&lengths).min_by(|(a, _), (b, _)| a.merit.total_cmp(&b.merit));
                if let Some((way, length)) = best.filter(|(way, _)| way.merit < at.merit) {
                    *mu = if *length >= 0.5 {
                        (used / 10.0).max(LEAST)
                    } else if *length < 0.1 {
                        (10.0 * used).max(1e-8)
                    } else {
                        used
                    };
                    return Ok((used, Some((way, *length))));
                }
            }
            *mu = (10.0 * used).max(1e-8);
            if *mu > MOST {
                *mu = self.settings.regularisation;
                return Ok((used, None));
            }
        }
    }

    /// All positions but the first, moved by a share of a step.
    fn displaced(&self, qpos: &[f64], step: &[f64], length: f64) -> Vec<f64> {
        let (nq, nv) = (self.nq(), self.free.len());
        let mut out = qpos.to_vec();
        for t in 1..=self.problem.steps {
            let part: Vec<f64> = row(step, t - 1, nv).iter().map(|x| length * x).collect();
            displace(self.problem.model.tables(), row(qpos, t, nq), &part, &mut out[t * nq..(t + 1) * nq]);
        }
        out
    }

    /// The quadratic model of the merit by all positions but the first.
    fn linearise(&mut self, at: &Way, held: &Multipliers) -> Result<(Banded, Vec<f64>), Error> {
        let (steps, nv, nu) = (self.problem.steps, self.free.len(), self.drives.len());
        let slopes = self.slopes(at)?;
        let mut hessian = Banded::new(steps, nv);
        let mut gradient = vec![0.0; steps * nv];
        for t in 0..=steps {
            let (velocity, force) = self.step_slopes(at, t, &slopes.forces);
            // State and controls by the positions of three steps.
            let whole = Mat::from_fn(2 * nv + nu, 3 * nv, |i, k| match i {
                i if i < nv => f64::from(u8::from(k == nv + i)),
                i if i < 2 * nv => velocity[(i - nv, k)],
                i => force[(self.drives[i - 2 * nv].0, k)] / self.drives[i - 2 * nv].1,
            });
            let model = &self.problem.model;
            let cost =
                self.problem.cost.quadratic(model, &at.at.point(model, t), slopes.sensors(t), self.problem.when(t));
            let mut local = whole.transpose() * (&cost.hessian * &whole);
            let mut down = whole.transpose() * &cost.gradient;
            if t < steps {
                self.constrain(at, held, t, &force, (&mut local, &mut down));
            }
            // Numbers of three steps: the first that varies is that after the start.
            for i in (0..3 * nv).filter(|i| (2..steps + 2).contains(&(t + i / nv))) {
                let block = t + i / nv - 2;
                gradient[block * nv + i % nv] += down[(i, 0)];
                for k in (0..3 * nv).filter(|k| (2..steps + 2).contains(&(t + k / nv)) && k / nv <= i / nv) {
                    hessian.add((block, i % nv), (t + k / nv - 2, k % nv), local[(i, k)]);
                }
            }
        }
        Ok((hessian, gradient))
    }

    /// Adds what constraints of a step cost.
    fn constrain(
        &self,
        at: &Way,
        held: &Multipliers,
        t: usize,
        force: &Mat<f64>,
        (local, down): (&mut Mat<f64>, &mut Mat<f64>),
    ) {
        let (nv, nu) = (self.free.len(), self.drives.len());
        let mut add = |dof: usize, residual: f64| {
            let weight = self.h * held.weight;
            for i in 0..3 * nv {
                down[(i, 0)] += weight * residual * force[(dof, i)];
                for k in 0..3 * nv {
                    local[(i, k)] += weight * force[(dof, i)] * force[(dof, k)];
                }
            }
        };
        for dof in (0..nv).filter(|dof| self.free[*dof]) {
            let i = t * nv + dof;
            add(dof, at.force[i] + held.missing[i] / held.weight);
        }
        for (i, (dof, gear)) in self.drives.iter().enumerate() {
            let beyond = self.beyond(t * nu + i, at.at.ctrl[t * nu + i], held);
            if beyond != 0.0 {
                add(*dof, beyond * gear.signum());
            }
        }
    }

    /// How velocity and force of a step follow positions: of the step before, of its own, of the next.
    fn step_slopes(&self, at: &Way, t: usize, forces: &[Vec<f64>]) -> (Mat<f64>, Mat<f64>) {
        let (nv, h, steps) = (self.free.len(), self.h, self.problem.steps);
        let model = &self.problem.model;
        let mut velocity = Mat::zeros(nv, 3 * nv);
        let mut next = Mat::zeros(nv, 3 * nv);
        // Of the velocity that step `t` comes with; that at the start is given.
        let fill = |out: &mut Mat<f64>, t: usize, first: usize| {
            let apart = self.moved(&at.at.qpos, t);
            let (to, from) =
                (tangent::slopes(model, &apart), tangent::slopes(model, &apart.iter().map(|x| -x).collect::<Vec<_>>()));
            for i in 0..nv {
                for k in 0..nv {
                    out[(i, first + k)] = -from[(i, k)] / h;
                    out[(i, first + nv + k)] = to[(i, k)] / h;
                }
            }
        };
        if t > 0 {
            fill(&mut velocity, t, 0);
        }
        if t == steps {
            return (velocity, next);
        }
        fill(&mut next, t + 1, nv);
        let part = |array: &Vec<f64>| Mat::from_fn(nv, nv, |i, k| array[(t * nv + i) * nv + k]);
        let [dq, dv, da] = [part(&forces[0]), part(&forces[1]), part(&forces[2])];
        let mut force = dv * &velocity + da * ((next - &velocity) * faer::Scale(1.0 / h));
        for i in 0..nv {
            for k in 0..nv {
                force[(i, nv + k)] += dq[(i, k)];
            }
        }
        (velocity, force)
    }

    /// Derivatives of inverse dynamics, and of sensors, along a way: one call each.
    fn slopes(&mut self, at: &Way) -> Result<Slopes, Error> {
        let (steps, nv, nu) = (self.problem.steps, self.free.len(), self.drives.len());
        let sizes = &self.problem.model.tables().sizes;
        restart(&mut self.states, &self.problem.start)?;
        let fields =
            [(Field::Qpos, &at.at.qpos, self.nq()), (Field::Qvel, &at.at.qvel, nv), (Field::Ctrl, &at.at.ctrl, nu)];
        for (field, values, width) in fields {
            self.states.write_all(field, &Strided { values: Values::F64(values), offset: 0, stride: width }, None)?;
        }
        let mut qacc = at.qacc.clone();
        qacc.extend(vec![0.0; nv]);
        let target = Target::Inverse(Strided { values: Values::F64(&qacc), offset: 0, stride: nv });
        let scheme = crate::cloud::Scheme { sensors: false, ..self.settings.scheme };
        let arrays = target.arrays(&self.problem.model, false);
        let mut forces: Vec<Vec<f64>> =
            arrays.iter().map(|(_, dims, _)| vec![0.0; (steps + 1) * dims.iter().product::<usize>()]).collect();
        let rows = forces.iter_mut().map(|rows| Rows::F64(rows)).collect();
        self.states.derivatives_into(&target, &scheme, Solving::FixedWork, rows, Follow::default())?;
        let mut slopes = Slopes { forces, c: Vec::new(), d: Vec::new(), widths: [0, 0] };
        if self.problem.cost.senses {
            let found = self.states.transition(&crate::cloud::Scheme { sensors: true, ..self.settings.scheme })?;
            (slopes.c, slopes.d) = (found.c, found.d);
            slopes.widths = [sizes.nsensordata * 2 * nv, sizes.nsensordata * nu];
        }
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
        let known = slopes.forces[..3].iter().all(|array| finite(&array[..steps * nv * nv]))
            && finite(&slopes.c)
            && finite(&slopes.d);
        if known { Ok(slopes) } else { Err(Error::Input("a state of the trajectory has no derivatives".into())) }
    }

    /// Ends with a motion of the model: gains along the way that was found, and what steps do with them.
    fn fly(&self, way: Way, mut rows: Vec<Row>, (end, mut timing): (End, Timing)) -> Result<Found, Error> {
        let mut flight = Flight::new(self.problem, self.settings, 1)?;
        let residual = self.missing(&way).0;
        let begin = Instant::now();
        let linear = flight.linearise(&way.at)?;
        let mut schedule = ilqg::Schedule::new(self.settings.regularisation);
        let pass = ilqg::regular(self.problem, &linear, &way.at, &mut schedule);
        let gains = pass.map(|pass| pass.gains).ok_or_else(ilqg::no_gains)?;
        let at = flight.fly(&way.at, Some(&gains), &[0.0])?.swap_remove(0);
        timing.search += begin.elapsed().as_secs_f64();
        if let Some(last) = rows.last_mut() {
            last.seconds += begin.elapsed().as_secs_f64();
        }
        Ok(Found { at, gains, rows, end, timing, residual })
    }
}

/// Derivatives along a way.
struct Slopes {
    /// dq, dv, da and marks.
    forces: Vec<Vec<f64>>,
    c: Vec<f64>,
    d: Vec<f64>,
    widths: [usize; 2],
}

impl Slopes {
    fn sensors(&self, t: usize) -> (&[f64], &[f64]) {
        (row(&self.c, t, self.widths[0]), row(&self.d, t, self.widths[1]))
    }
}
