//! The same search with MuJoCo's steps and derivatives, in a Python process of its own.

use std::io::Write;
use std::process::{Command, Stdio};

use lanesim::optimise::{Motion, Norm, Problem, Row, Settings, Task, Timing};
use serde_json::{Value, json};

const SCRIPT: &str = include_str!("mujoco.py");

/// What it found.
pub struct Beside {
    /// MuJoCo's version.
    pub version: String,
    pub rows: Vec<Row>,
    pub timing: Timing,
}

/// Runs it on the task, which starts as ours did; an error says why there is nothing.
pub fn run(
    python: &str,
    task: &Task,
    problem: &Problem,
    settings: &Settings,
    motion: &Motion,
) -> Result<Beside, String> {
    let sizes = &problem.model().tables().sizes;
    let options = &problem.model().tables().options;
    let terms = task.terms().map_err(|e| e.to_string())?;
    let term = |term: &lanesim::optimise::Term| {
        let smooth = if let Norm::SmoothAbs(width) = term.norm { Some(width) } else { None };
        json!({ "quantity": term.quantity.to_string(), "goal": term.goal, "running": term.running, "terminal": term.terminal, "smooth": smooth })
    };
    let job = json!({
        "xml": task.xml,
        "options": { "tolerance": options.tolerance, "ls_tolerance": options.ls_tolerance, "iterations": options.iterations,
            "ls_iterations": options.ls_iterations },
        "terms": terms.iter().map(term).collect::<Vec<_>>(),
        "steps": problem.steps(),
        "qpos": &motion.qpos[..sizes.nq],
        "qvel": &motion.qvel[..sizes.nv],
        "ctrl": problem.first_controls(),
        "iterations": settings.iterations,
        "tolerance": settings.tolerance,
        "regularisation": settings.regularisation,
    });
    let answer = ask(python, &job)?;
    let numbers = |value: &Value| value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect::<Vec<_>>();
    let row = |value: &Value| match numbers(value)[..] {
        [iteration, cost, seconds, regularisation, step] => {
            Some(Row { iteration: iteration as usize, cost, seconds, regularisation, step, residual: 0.0 })
        }
        _ => None,
    };
    let rows = answer["rows"].as_array().into_iter().flatten().filter_map(row).collect();
    let seconds = numbers(&answer["seconds"]);
    let [derivatives, backward, search] = seconds[..] else { return Err("its answer has no times".to_owned()) };
    let version = answer["version"].as_str().unwrap_or_default().to_owned();
    Ok(Beside { version, rows, timing: Timing { derivatives, backward, search } })
}

fn ask(python: &str, job: &Value) -> Result<Value, String> {
    let mut command = Command::new(python);
    command.args(["-c", SCRIPT]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| format!("cannot run {python}: {e}"))?;
    if let Some(mut input) = child.stdin.take() {
        // Where there is no MuJoCo, the process ends without reading.
        let _ = write!(input, "{job}");
    }
    let out = child.wait_with_output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&out.stderr);
    if said.contains("ModuleNotFoundError") {
        return Err(format!("{python} lacks the package mujoco or numpy"));
    }
    let last = || said.lines().last().unwrap_or("no answer").to_owned();
    serde_json::from_slice(&out.stdout).map_err(|_| last())
}
