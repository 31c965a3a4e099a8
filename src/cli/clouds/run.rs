//! Clouds by lanesim and by MuJoCo: seconds, and derivatives of what a state costs.

use std::time::Instant;

use lanesim::cloud::{Found, Grid, How, Points, Solving};
use lanesim::rows::Rows;
use lanesim::{Options, Worlds};
use serde_json::{Value, json};

use super::super::failure::Failure;
use super::super::mujoco::{Process, numbers};
use super::scene::{STEPS, Scene};

/// What is asked of a cloud.
pub struct Cloud<'a> {
    pub scene: &'a Scene,
    pub inverse: bool,
    pub grid: &'a Grid,
    pub points: &'a Points,
    /// Whether every point is evaluated from its positions on.
    pub whole: bool,
}

/// What came of it.
pub struct Outcome {
    pub seconds: f64,
    pub derivatives: Derivatives,
}

/// Of each state's cost, half the sum of squares of accelerations or of forces.
#[derive(Default)]
pub struct Derivatives {
    /// `[STEPS, n]`.
    pub gradient: Vec<f64>,
    /// `[STEPS, n, n]`; empty without second differences.
    pub hessian: Vec<f64>,
    /// Of each state, whether contacts or limits begin or cease to act among the points.
    pub kinks: Vec<bool>,
}

impl Cloud<'_> {
    /// Numbers of a state's gradient and Hessian.
    fn sizes(&self) -> [usize; 2] {
        let n = self.grid.columns().len();
        [n, if self.points.len() > 1 + 2 * n { n * n } else { 0 }]
    }

    /// The derivatives by the costs of all points.
    fn differentiate(&self, costs: &[f64]) -> Derivatives {
        let [n, square] = self.sizes();
        let (mut gradient, mut hessian) = (vec![0.0; STEPS * n], vec![0.0; STEPS * square]);
        // A single point has no differences.
        if self.points.len() > n {
            let sides = vec![2.0; self.scene.target(self.inverse).columns(&self.scene.model)];
            for (i, costs) in costs.chunks_exact(self.points.len()).enumerate() {
                let hessian = &mut hessian[i * square..(i + 1) * square];
                self.grid.differentiate(costs, &sides, &mut gradient[i * n..(i + 1) * n], hessian);
            }
        }
        Derivatives { gradient, hessian, kinks: vec![] }
    }

    /// By lanesim; `kinks`: whether these are wanted.
    pub fn run(&self, worlds: &mut Worlds, kinks: bool) -> Result<Outcome, Failure> {
        let nv = self.scene.model.tables().sizes.nv;
        let count = STEPS * self.points.len();
        let (mut after, mut changed) = (vec![0.0; count * nv], vec![0; if kinks { count } else { 0 }]);
        let none = || Rows::F64(&mut []);
        let found = Found {
            after: Rows::F64(&mut after),
            before: none(),
            changed: Rows::I32(&mut changed),
            sides: none(),
            status: none(),
        };
        let how = How { solving: Solving::Accurate, whole: self.whole, ..How::default() };
        let start = Instant::now();
        worlds.points_into(&self.scene.target(self.inverse), self.points, &how, found, (None, None))?;
        let costs: Vec<f64> = after.chunks_exact(nv).map(|row| 0.5 * row.iter().map(|x| x * x).sum::<f64>()).collect();
        let mut derivatives = self.differentiate(&costs);
        let seconds = start.elapsed().as_secs_f64();
        derivatives.kinks = changed.chunks(self.points.len()).map(|all| all.iter().any(|n| *n > 0)).collect();
        Ok(Outcome { seconds, derivatives })
    }

    /// By MuJoCo, in all processes at once; seconds are those of a cloud for all of them together.
    pub fn run_mujoco(&self, processes: &mut [Process]) -> Result<Outcome, Failure> {
        let job = self.job();
        let words = |why: String| Failure::Input(format!("MuJoCo: {why}"));
        processes.iter_mut().try_for_each(|process| process.send(&job)).map_err(words)?;
        let answers: Result<Vec<_>, _> = processes.iter_mut().map(Process::receive).collect();
        let answers = answers.map_err(words)?;
        let rate: f64 = answers.iter().filter_map(|answer| answer["seconds"].as_f64()).map(|s| 1.0 / s).sum();
        let costs = answers.first().map_or(&Value::Null, |answer| &answer["costs"]);
        let costs: Vec<f64> = costs.as_array().into_iter().flatten().flat_map(numbers).collect();
        Ok(Outcome { seconds: 1.0 / rate, derivatives: self.differentiate(&costs) })
    }

    fn job(&self) -> Value {
        let Scene { xml, model, qpos, qvel, ctrl, qacc, .. } = self.scene;
        let sizes = &model.tables().sizes;
        let row = |numbers: &[f64], width: usize, i: usize| numbers[i * width..(i + 1) * width].to_vec();
        let state = |i| {
            json!({
                "qpos": row(qpos, sizes.nq, i),
                "qvel": row(qvel, sizes.nv, i),
                "ctrl": row(ctrl, sizes.nu, i),
                "qacc": row(qacc, sizes.nv, i),
            })
        };
        let drive = self.scene.columns(self.inverse)[2 * sizes.nv - 2];
        let moved = |(column, distance): &(usize, f64)| match column.checked_sub(drive) {
            Some(dof) => (2, dof, *distance),
            None => (column / sizes.nv, column % sizes.nv, *distance),
        };
        let options = &model.tables().options;
        json!({
            "xml": xml,
            "tolerance": options.tolerance,
            "ls_tolerance": options.ls_tolerance,
            "iterations": options.iterations,
            "ls_iterations": options.ls_iterations,
            "inverse": self.inverse,
            "whole": self.whole,
            "states": (0..STEPS).map(state).collect::<Vec<_>>(),
            "points": (0..self.points.len()).map(|p| self.points.moves(p).iter().map(moved).collect()).collect::<Vec<Vec<_>>>(),
        })
    }
}

/// What others are judged by: centred differences at a distance and at half of it, extrapolated, in double precision.
pub fn reference(scene: &Scene, inverse: bool) -> Result<Derivatives, Failure> {
    let mut worlds = scene.worlds(&Options::default())?;
    let mut find = |eps: f64, second: bool| -> Result<Derivatives, Failure> {
        let grid = scene.grid(inverse, (eps, true, second))?;
        let points = grid.points();
        let cloud = Cloud { scene, inverse, grid: &grid, points: &points, whole: false };
        Ok(cloud.run(&mut worlds, true)?.derivatives)
    };
    let extrapolate = |coarse: &[f64], fine: &[f64]| -> Vec<f64> {
        coarse.iter().zip(fine).map(|(coarse, fine)| (4.0 * fine - coarse) / 3.0).collect()
    };
    let (coarse, fine) = (find(FIRST, false)?, find(0.5 * FIRST, false)?);
    let (wide, near) = (find(SECOND, true)?, find(0.5 * SECOND, true)?);
    Ok(Derivatives {
        gradient: extrapolate(&coarse.gradient, &fine.gradient),
        hessian: extrapolate(&wide.hessian, &near.hessian),
        kinks: wide.kinks,
    })
}

/// How far the reference moves numbers for first and for second differences.
const FIRST: f64 = 1e-4;
const SECOND: f64 = 4e-4;

/// Relative errors, the median and the largest, over the states whose clouds have no kinks.
pub fn errors(found: &[f64], exact: &[f64], kinks: &[bool]) -> Option<[f64; 2]> {
    let width = exact.len() / STEPS;
    let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
    let error = |(i, _): (usize, &bool)| {
        let (found, exact) = (&found[i * width..(i + 1) * width], &exact[i * width..(i + 1) * width]);
        norm(&mut found.iter().zip(exact).map(|(a, b)| a - b)) / norm(&mut exact.iter().copied())
    };
    let mut all: Vec<f64> = kinks.iter().enumerate().filter(|(_, kink)| !**kink).map(error).collect();
    all.sort_by(f64::total_cmp);
    Some([*all.get(all.len() / 2)?, *all.last()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_leave_states_with_kinks_out() {
        let exact = vec![2.0; STEPS];
        let mut found = exact.clone();
        (found[3], found[4]) = (3.0, 5.0);
        let mut kinks = vec![true; STEPS];
        assert_eq!(errors(&found, &exact, &kinks), None);
        kinks[..4].fill(false);
        assert_eq!(errors(&found, &exact, &kinks), Some([0.0, 0.5]));
    }
}
