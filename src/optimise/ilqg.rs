//! Differential dynamic programming with Gauss-Newton Hessians (iLQG): linear models of all steps, a backward pass for gains, trials of step lengths
//! side by side. After Tassa, Erez, Todorov: Synthesis and stabilization of complex behaviors through online trajectory optimization, IROS 2012;
//! bounds of controls after Tassa, Mansard, Todorov, ICRA 2014.

use std::time::Instant;

use faer::Mat;

use super::boxqp;
use super::flight::{Flight, Gains, Linear, Trajectory, row};
use super::{End, Found, Problem, Row, Settings, Timing};
use crate::error::Error;

/// Step lengths that are tried at once: as many as lanes of double precision, twice.
const LENGTHS: usize = 16;
/// From one to the next.
const SHORTER: f64 = 0.63;
/// Least regularisation that is any.
const LEAST: f64 = 1e-6;
/// Most, beyond which nothing will help.
const MOST: f64 = 1e10;
/// By which the change of regularisation itself changes.
const FACTOR: f64 = 1.6;
/// Share of the promised gain that a step must bring.
const ENOUGH: f64 = 1e-4;

/// How much regularisation there is, and by which factor it last changed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    mu: f64,
    factor: f64,
}

impl Schedule {
    pub fn new(mu: f64) -> Schedule {
        Schedule { mu, factor: 1.0 }
    }

    fn raise(&mut self) {
        self.factor = (self.factor * FACTOR).max(FACTOR);
        self.mu = (self.mu * self.factor).max(LEAST);
    }

    fn lower(&mut self) {
        self.factor = (self.factor / FACTOR).min(1.0 / FACTOR);
        self.mu = if self.mu * self.factor >= LEAST { self.mu * self.factor } else { 0.0 };
    }
}

/// What a backward pass finds.
pub(super) struct Pass {
    pub gains: Gains,
    /// What the first and the second order of the model promise for a full step.
    promise: [f64; 2],
}

/// From the end to the start: how controls should change, and follow the state. `None` if a Hessian is not positive definite.
pub(super) fn backward(problem: &Problem, linear: &Linear, at: &Trajectory, mu: f64) -> Option<Pass> {
    let (n, nu) = (problem.n(), problem.bounds.len());
    let last = &linear.costs[problem.steps];
    let mut slope = last.gradient.submatrix(0, 0, n, 1).to_owned();
    let mut hessian = last.hessian.submatrix(0, 0, n, n).to_owned();
    let mut gains = Gains { forward: vec![Vec::new(); problem.steps], feedback: vec![Mat::new(); problem.steps] };
    let (mut promise, mut start) = ([0.0; 2], vec![0.0; nu]);
    for t in (0..problem.steps).rev() {
        let (a, b, cost) = (linear.a(t), linear.b(t), &linear.costs[t]);
        let qx = cost.gradient.submatrix(0, 0, n, 1) + a.transpose() * &slope;
        let qu = cost.gradient.submatrix(n, 0, nu, 1) + b.transpose() * &slope;
        let va = &hessian * a;
        let vb = &hessian * b;
        let qxx = cost.hessian.submatrix(0, 0, n, n) + a.transpose() * &va;
        let qux = cost.hessian.submatrix(n, 0, nu, n) + b.transpose() * &va;
        let quu = cost.hessian.submatrix(n, n, nu, nu) + b.transpose() * &vb;
        // As if changes of controls cost more.
        let regular = Mat::from_fn(nu, nu, |i, k| quu[(i, k)] + if i == k { mu } else { 0.0 });
        let u = row(&at.ctrl, t, nu);
        let lo: Vec<f64> = problem.bounds.iter().zip(u).map(|([lo, _], u)| lo - u).collect();
        let hi: Vec<f64> = problem.bounds.iter().zip(u).map(|([_, hi], u)| hi - u).collect();
        let g: Vec<f64> = (0..nu).map(|i| qu[(i, 0)]).collect();
        let best = boxqp::solve(regular.as_ref(), &g, [&lo, &hi], &start)?;
        let feedback = best.follow(qux.as_ref());
        let k = Mat::from_fn(nu, 1, |i, _| best.x[i]);
        let quuk = &quu * &k;
        promise[0] += (0..nu).map(|i| k[(i, 0)] * g[i]).sum::<f64>();
        promise[1] += 0.5 * (0..nu).map(|i| k[(i, 0)] * quuk[(i, 0)]).sum::<f64>();
        slope = qx + feedback.transpose() * (&quuk + &qu) + qux.transpose() * &k;
        let mixed = feedback.transpose() * &qux;
        let full = qxx + feedback.transpose() * (&quu * &feedback) + &mixed + mixed.transpose();
        hessian = Mat::from_fn(n, n, |i, k| 0.5 * (full[(i, k)] + full[(k, i)]));
        start.clone_from(&best.x);
        (gains.forward[t], gains.feedback[t]) = (best.x, feedback);
    }
    (promise[0].is_finite() && promise[1].is_finite()).then_some(Pass { gains, promise })
}

/// Goes on until it converges, finds no step, or is told to stop.
pub(super) fn run(problem: &Problem, settings: &Settings, watch: &mut super::Watch<'_>) -> Result<Found, Error> {
    let (begin, mut timing) = (Instant::now(), Timing::default());
    let lengths: Vec<f64> = (0..LENGTHS as i32).map(|i| SHORTER.powi(i)).collect();
    let mut flight = Flight::new(problem, settings, LENGTHS)?;
    let first = Trajectory { ctrl: problem.controls.clone(), ..Trajectory::default() };
    let mut at = flight.fly(&first, None, &lengths[..1])?.swap_remove(0);
    if !at.cost.is_finite() {
        return Err(Error::Input("the trajectory under the first controls diverges, or its cost is not finite".into()));
    }
    let mut schedule = Schedule::new(settings.regularisation);
    let mut rows = vec![Row {
        iteration: 0,
        cost: at.cost,
        seconds: begin.elapsed().as_secs_f64(),
        regularisation: schedule.mu,
        step: 0.0,
        residual: 0.0,
    }];
    let mut linear = super::timed(&mut timing.derivatives, || flight.linearise(&at))?;
    let mut end = End::Iterations;
    let mut last = None;
    for iteration in 1..=settings.iterations {
        watch.next()?;
        let Some(pass) = super::timed(&mut timing.backward, || regular(problem, &linear, &at, &mut schedule)) else {
            end = End::Stuck;
            break;
        };
        let tried = super::timed(&mut timing.search, || flight.fly(&at, Some(&pass.gains), &lengths))?;
        let gain = |one: &Trajectory| at.cost - one.cost;
        let promised = |length: f64| -length * pass.promise[0] - length * length * pass.promise[1];
        let best = tried.into_iter().zip(&lengths).min_by(|(a, _), (b, _)| a.cost.total_cmp(&b.cost));
        let best = best.filter(|(one, length)| gain(one) > 0.0 && gain(one) >= ENOUGH * promised(**length));
        let used = schedule.mu;
        let converged = promised(1.0) <= settings.tolerance * at.cost.abs() && used <= 1.0;
        let small = best.as_ref().is_some_and(|(one, _)| gain(one) <= settings.tolerance * at.cost.abs());
        let step = best.as_ref().map_or(0.0, |(_, length)| **length);
        match best {
            Some((one, _)) => {
                at = one;
                if step >= 0.3 {
                    schedule.lower();
                } else if step < 0.1 {
                    schedule.raise();
                }
                linear = super::timed(&mut timing.derivatives, || flight.linearise(&at))?;
                last = None;
            }
            None => {
                schedule.raise();
                last = Some(pass.gains);
            }
        }
        let seconds = begin.elapsed().as_secs_f64();
        rows.push(Row { iteration, cost: at.cost, seconds, regularisation: used, step, residual: 0.0 });
        if converged || (small && used <= 1.0) {
            end = End::Converged;
            break;
        }
        if schedule.mu > MOST {
            end = End::Stuck;
            break;
        }
    }
    // Gains belong to the trajectory that is returned.
    let gains = match last {
        Some(gains) => Some(gains),
        None => {
            super::timed(&mut timing.backward, || regular(problem, &linear, &at, &mut schedule)).map(|pass| pass.gains)
        }
    };
    let gains = gains.ok_or_else(no_gains)?;
    Ok(Found { at, gains, rows, end, timing, residual: 0.0 })
}

/// A backward pass with as much regularisation as it needs.
pub(super) fn regular(problem: &Problem, linear: &Linear, at: &Trajectory, schedule: &mut Schedule) -> Option<Pass> {
    loop {
        if let Some(pass) = backward(problem, linear, at, schedule.mu) {
            return Some(pass);
        }
        schedule.raise();
        if schedule.mu > MOST {
            return None;
        }
    }
}

/// Where no regularisation helps.
pub(super) fn no_gains() -> Error {
    Error::Input("no gains were found: a Hessian is not positive definite; weigh controls, or more of the state".into())
}
