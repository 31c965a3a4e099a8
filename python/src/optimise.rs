//! Optimal motions.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use lanesim::cloud::Scheme;
use lanesim::model::Key;
use lanesim::optimise::{Method, Motion, Norm, Problem, Quantity, Settings, TASKS, Task, Term, optimise_watched};
use lanesim::{Error, Options};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::raise;
use crate::model::Model;
use crate::watch::watched;

/// A term: quantity, goal, weights along the way and at the end, and the width of a smooth absolute value, or none.
type Words = (String, Vec<f64>, f64, f64, Option<f64>);
/// Positions, velocities, activations and first controls, as far as they are given.
type Start = [Option<Vec<f64>>; 4];
/// Method, most iterations, tolerance, eps, threads.
type How = (String, Option<usize>, f64, Option<f64>, Option<usize>);

/// Names of the tasks, in words, their seconds and iterations.
#[pyfunction]
pub fn tasks() -> Vec<(&'static str, &'static str, f64, usize)> {
    TASKS.iter().map(|task| (task.name, task.what, task.seconds, task.iterations)).collect()
}

fn term((quantity, goal, running, terminal, smooth): &Words) -> Result<Term, Error> {
    let norm = smooth.map_or(Norm::Quadratic, Norm::SmoothAbs);
    Ok(Term { quantity: Quantity::parse(quantity)?, goal: goal.clone(), running: *running, terminal: *terminal, norm })
}

/// The problem of a model, from the reference configuration where nothing else is given.
fn problem(model: &lanesim::Model, terms: &[Words], steps: usize, start: Start) -> Result<Problem, Error> {
    let terms = terms.iter().map(term).collect::<Result<Vec<_>, _>>()?;
    let [qpos, qvel, act, ctrl] = start;
    let key = model.initial_key();
    let key =
        Key { qpos: qpos.unwrap_or(key.qpos), qvel: qvel.unwrap_or(key.qvel), act: act.unwrap_or(key.act), ..key };
    let problem = Problem::new(model, &terms, steps)?.start(&key)?;
    ctrl.map_or(Ok(problem.clone()), |ctrl| problem.controls(&ctrl))
}

fn settings((method, iterations, tolerance, eps, threads): How, own: Option<usize>) -> Settings {
    let usual = Settings::default();
    Settings {
        method: if method == "gauss-newton" { Method::GaussNewton } else { Method::Ilqg },
        iterations: iterations.or(own).unwrap_or(usual.iterations),
        tolerance,
        scheme: Scheme { eps: eps.unwrap_or(usual.scheme.eps), ..usual.scheme },
        options: Options { threads, ..usual.options.clone() },
        ..usual
    }
}

/// Searches an optimal motion: of a task, over so many seconds, or of a model with terms, over so many steps. A dict of what was found.
#[pyfunction]
#[pyo3(signature = (task, seconds, model, terms, steps, start, how, progress))]
#[expect(clippy::too_many_arguments, reason = "as many as the Python side has to say")]
pub fn optimise<'py>(
    py: Python<'py>,
    task: Option<&str>,
    seconds: Option<f64>,
    model: Option<&Model>,
    terms: Vec<Words>,
    steps: usize,
    start: Start,
    how: How,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let task = task.map(Task::named).transpose().map_err(|e| raise(py, e))?;
    let settings = settings(how, task.map(|task| task.iterations));
    let model = model.map(|model| model.here(py)).transpose()?;
    let (cancel, done) = (AtomicBool::new(false), AtomicU64::new(0));
    let work = || -> Result<_, Error> {
        let problem = match (&task, &model) {
            (Some(task), _) => task.problem(seconds)?,
            (None, Some(model)) => problem(model, &terms, steps, start)?,
            (None, None) => return Err(Error::Input("neither a task nor a model is given".into())),
        };
        let motion = optimise_watched(&problem, &settings, Some(&done), Some(&cancel))?;
        let reached = task.map_or(Ok(Vec::new()), |task| task.reached(&problem, &motion))?;
        Ok((problem, motion, reached))
    };
    let follow = |py: Python<'_>| match &progress {
        Some(progress) => progress.call1(py, (done.load(Ordering::Relaxed),)).map(drop),
        None => Ok(()),
    };
    let (problem, motion, reached) = watched(py, &cancel, follow, work)?.map_err(|e| raise(py, e))?;
    let out = arrays(py, &problem, motion)?;
    let goals: Vec<_> =
        reached.iter().map(|one| (one.goal.what, one.distance, one.goal.within, one.goal.unit)).collect();
    out.set_item("goals", goals)?;
    Ok(out)
}

fn arrays<'py>(py: Python<'py>, problem: &Problem, motion: Motion) -> PyResult<Bound<'py, PyDict>> {
    let sizes = &problem.model().tables().sizes;
    let (steps, n) = (problem.steps(), 2 * sizes.nv + sizes.na);
    let out = PyDict::new(py);
    out.set_item("cost", motion.cost())?;
    out.set_item("end", motion.end.words())?;
    out.set_item("residual", motion.residual)?;
    let table = [
        ("costs", motion.rows.iter().map(|row| row.cost).collect::<Vec<_>>()),
        ("seconds", motion.rows.iter().map(|row| row.seconds).collect()),
        ("regularisation", motion.rows.iter().map(|row| row.regularisation).collect()),
        ("steps", motion.rows.iter().map(|row| row.step).collect()),
    ];
    for (name, column) in table {
        out.set_item(name, column.into_pyarray(py))?;
    }
    let arrays = [
        ("qpos", motion.qpos, vec![steps + 1, sizes.nq]),
        ("qvel", motion.qvel, vec![steps + 1, sizes.nv]),
        ("act", motion.act, vec![steps + 1, sizes.na]),
        ("ctrl", motion.ctrl, vec![steps, sizes.nu]),
        ("gains", motion.gains, vec![steps, sizes.nu, n]),
    ];
    for (name, numbers, shape) in arrays {
        out.set_item(name, numbers.into_pyarray(py).reshape(shape)?)?;
    }
    Ok(out)
}
