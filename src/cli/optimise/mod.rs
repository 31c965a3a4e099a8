//! `lanesim optimise`: optimal motions.

mod mujoco;
mod plot;

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum, ValueHint};
use lanesim::Options;
use lanesim::npz::{self, Array, Data};
use lanesim::optimise::{self, Motion, Problem, Row, Settings, TASKS, Task, Timing, optimise_watched};

use super::failure::Failure;
use super::output::{self, Progress};
use mujoco::Beside;

const ABOUT: &str = "\
A task is a model with a cost and a goal. The table has iterations with cost, time, regularisation and length of the step that was taken (0: none);
then come the goals, and how far the motion's end is from them.

Examples:
  lanesim optimise --list
  lanesim optimise cartpole
  lanesim optimise hopper --iterations 50 -o hopping
  lanesim optimise humanoid --beside-mujoco

The folder gets costs.svg, cost against iteration and against time, and motion.npz, which holds, with n = 2 nv + na (qpos in the tangent
space, qvel, act):
  qpos, qvel, act  [steps + 1, ...]  the motion
  ctrl             [steps, nu]       its controls
  gains            [steps, nu, n]    how controls follow differences of the state: ctrl + gains (x - nominal x)
  cost, seconds, regularisation, step  [iterations + 1]  the table";

/// Arguments of `optimise`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct Optimise {
    /// The task, by its name
    #[arg(value_name = "TASK", required_unless_present = "list")]
    task: Option<String>,
    /// List the tasks, and do none
    #[arg(long)]
    list: bool,
    /// How the motion is searched
    #[arg(long, value_enum, default_value_t = Method::Ilqg)]
    method: Method,
    /// Most iterations [default: the task's own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: Option<u32>,
    /// Length of the motion, s [default: the task's own]
    #[arg(long, visible_alias = "horizon", value_name = "SECONDS", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Threads [default: all that this process may use]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,
    /// The same search with MuJoCo's steps and derivatives (method ilqg), for its costs and times
    #[arg(long)]
    beside_mujoco: bool,
    /// Python with the package mujoco
    #[arg(long, value_name = "PYTHON", default_value = "python3", value_hint = ValueHint::ExecutablePath)]
    python: String,
    /// Folder for motion.npz and costs.svg; it is made if it is not there
    #[arg(short = 'o', long = "output", value_name = "DIR", value_hint = ValueHint::DirPath)]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Method {
    /// Differential dynamic programming: variables are controls
    Ilqg,
    /// Gauss-Newton over positions, with forces from inverse dynamics
    GaussNewton,
}

impl Optimise {
    /// Searches, prints the table and the goals, and writes the rest.
    pub fn run(self) -> Result<(), Failure> {
        if self.list {
            return output::table(&TASKS.map(|task| (task.name, task.what.to_owned())));
        }
        if self.beside_mujoco && matches!(self.method, Method::GaussNewton) {
            return Err(Failure::Usage(
                "--beside-mujoco compares the method ilqg; leave out --method gauss-newton".into(),
            ));
        }
        let task = Task::named(self.task.as_deref().unwrap_or_default())?;
        let problem = task.problem(self.seconds)?;
        let settings = self.settings(&task);
        if let Some(folder) = &self.output {
            std::fs::create_dir_all(folder).map_err(|e| Failure::file(folder, e))?;
        }
        let progress = Progress::new("optimise", "iterations", settings.iterations as u64, false);
        let motion = optimise_watched(&problem, &settings, Some(progress.counter()), None);
        progress.finish();
        let motion = motion?;
        output::text(&report(&task, &problem, &motion)?)?;
        let beside = if self.beside_mujoco { self.beside(&task, &problem, &settings, &motion)? } else { None };
        self.output.as_ref().map_or(Ok(()), |folder| write(folder, (&task, &problem), &motion, beside.as_ref()))
    }

    /// What MuJoCo does; nothing, with a note, where there is none.
    fn beside(
        &self,
        task: &Task,
        problem: &Problem,
        settings: &Settings,
        motion: &Motion,
    ) -> Result<Option<Beside>, Failure> {
        match mujoco::run(&self.python, task, problem, settings, motion) {
            Ok(beside) => {
                output::text(&compared(motion, &beside))?;
                Ok(Some(beside))
            }
            Err(why) => {
                output::notes("without MuJoCo", &[why]);
                Ok(None)
            }
        }
    }

    fn settings(&self, task: &Task) -> Settings {
        let method = match self.method {
            Method::Ilqg => optimise::Method::Ilqg,
            Method::GaussNewton => optimise::Method::GaussNewton,
        };
        Settings {
            method,
            iterations: self.iterations.map_or(task.iterations, |n| n as usize),
            options: Options { threads: self.threads.map(|n| n as usize), ..Options::default() },
            ..Settings::default()
        }
    }
}

/// The table, why it ends, and the goals.
fn report(task: &Task, problem: &Problem, motion: &Motion) -> Result<String, Failure> {
    let mut out = "iteration        cost      time  regularisation    step  missing force\n".to_owned();
    for row in &motion.rows {
        let Row { iteration, cost, seconds, regularisation, step, residual } = row;
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            "{iteration:>9}  {cost:>10.5}  {seconds:>6.3} s  {regularisation:>14.2e}  {step:>6.3}  {residual:>13.2e}"
        );
    }
    let timing = &motion.timing;
    let _ = writeln!(out, "\n{} after {} iterations", motion.end.words(), motion.rows.len() - 1);
    let _ = writeln!(
        out,
        "derivatives {:.3} s, backward passes {:.3} s, trials {:.3} s",
        timing.derivatives, timing.backward, timing.search
    );
    for reached in task.reached(problem, motion)? {
        let word = if reached.passed() { "reached" } else { "not reached" };
        let goal = reached.goal;
        let _ = writeln!(out, "{word}: {} {:.4} {} (at most {})", goal.what, reached.distance, goal.unit, goal.within);
    }
    Ok(out)
}

/// Times and costs of both, per iteration where there is a sense in it.
fn compared(motion: &Motion, beside: &Beside) -> String {
    let mut out = format!(
        "\n{:<14}  iterations        cost      time  derivatives  per iteration  backward passes    trials\n",
        "engine"
    );
    let mut line = |name: &str, rows: &[Row], timing: &Timing| {
        let Some(last) = rows.last() else { return };
        let (n, each) = (last.iteration, 1e3 * timing.derivatives / rows.len() as f64);
        let Timing { derivatives, backward, search } = timing;
        let _ = writeln!(
            out,
            "{name:<14}  {n:>10}  {:>10.5}  {:>6.3} s  {derivatives:>9.3} s  {each:>10.3} ms  {backward:>13.3} s  {search:>6.3} s",
            last.cost, last.seconds
        );
    };
    line("lanesim", &motion.rows, &motion.timing);
    line(&format!("MuJoCo {}", beside.version), &beside.rows, &beside.timing);
    out
}

fn write(
    folder: &Path,
    (task, problem): (&Task, &Problem),
    motion: &Motion,
    beside: Option<&Beside>,
) -> Result<(), Failure> {
    let sizes = &problem.model().tables().sizes;
    let (steps, n) = (problem.steps(), 2 * sizes.nv + sizes.na);
    let column = |of: fn(&Row) -> f64| motion.rows.iter().map(of).collect::<Vec<_>>();
    let rows = vec![motion.rows.len()];
    let arrays = [
        ("qpos", vec![steps + 1, sizes.nq], motion.qpos.clone()),
        ("qvel", vec![steps + 1, sizes.nv], motion.qvel.clone()),
        ("act", vec![steps + 1, sizes.na], motion.act.clone()),
        ("ctrl", vec![steps, sizes.nu], motion.ctrl.clone()),
        ("gains", vec![steps, sizes.nu, n], motion.gains.clone()),
        ("cost", rows.clone(), column(|row| row.cost)),
        ("seconds", rows.clone(), column(|row| row.seconds)),
        ("regularisation", rows.clone(), column(|row| row.regularisation)),
        ("step", rows, column(|row| row.step)),
    ];
    let array = |(name, shape, numbers): (&str, Vec<usize>, Vec<f64>)| {
        Array::new(shape, Data::F64(numbers)).map(|array| (name.to_owned(), array))
    };
    let arrays: Vec<_> = arrays.into_iter().filter_map(array).collect();
    let file = folder.join("motion.npz");
    npz::write(&file, &arrays).map_err(|e| Failure::file(&file, e))?;
    let file = folder.join("costs.svg");
    let ours = plot::Line { name: "lanesim".to_owned(), rows: &motion.rows };
    let theirs = beside.map(|beside| plot::Line { name: format!("MuJoCo {}", beside.version), rows: &beside.rows });
    let lines: Vec<_> = std::iter::once(ours).chain(theirs).collect();
    plot::costs(&file, task.what, &lines).map_err(|e| Failure::file(&file, e))
}
