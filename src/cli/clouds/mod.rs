//! `lanesim bench-clouds`: the benchmark of the paper about MuJoCo (Todorov, Erez, Tassa, IROS 2012), rebuilt.

mod report;
mod run;
mod scene;

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::thread::available_parallelism;

use clap::{Args, ValueHint};
use lanesim::cloud::{Grid, Points};
use lanesim::{Options, Precision, Worlds};
use serde_json::json;

use super::failure::Failure;
use super::mujoco::Process;
use super::output::{self, Progress};
use report::{Dynamics, Row};
use run::{Cloud, Derivatives, Outcome, errors, reference};
use scene::{STEPS, Scene};

const SCRIPT: &str = include_str!("mujoco.py");

const ABOUT: &str = "\
A humanoid with 18 degrees of freedom over 30 time steps: standing on 6 points, on 4, or in the air. A state costs half the sum of squares
of its accelerations (forward dynamics) or of the forces that an acceleration needs (inverse dynamics). Gradients are centred
differences, 30 x 105 states, Hessians forward ones, 30 x 1431, along 52 columns: positions but for the place on the floor, velocities,
and generalised forces or accelerations. Constraints are solved until only rounding is left, by all engines. Seconds are medians of
runs by turns. Evaluations per second are of clouds in which every state is evaluated as a whole; gradients and Hessians take over
what columns leave alone, and so does MuJoCo (mj_forwardSkip, mj_inverseSkip), whose time is without that of moving numbers in and out of
Python. Errors are relative to extrapolated centred differences, over states in whose clouds no contact begins or ends.

Examples:
  lanesim bench-clouds --quick
  lanesim bench-clouds --threads 8 -o clouds.json";

/// Arguments of `bench-clouds`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct BenchClouds {
    /// Six contacts only, and single runs: some seconds
    #[arg(long)]
    quick: bool,
    /// Threads of the runs that are not on one [default: all that this process may use]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,
    /// Runs of which medians are taken
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,
    /// Leave MuJoCo out
    #[arg(long)]
    no_mujoco: bool,
    /// Python with the package mujoco
    #[arg(long, value_name = "PYTHON", default_value = "python3", value_hint = ValueHint::ExecutablePath)]
    python: String,
    /// Print one JSON object instead of the tables
    #[arg(long)]
    json: bool,
    /// File for the same JSON object
    #[arg(short = 'o', long = "output", value_name = "FILE.json", value_hint = ValueHint::FilePath)]
    output: Option<PathBuf>,
}

/// Who works: worlds, or processes of MuJoCo.
enum Worker {
    Ours(Precision, Box<Worlds>),
    MuJoCo,
}

/// The clouds of a scene: one state, and those of gradients and of Hessians; of each the grid and its points.
struct Clouds([(Grid, Points); 3]);

/// What is timed: cost, gradient, Hessian, and the Hessian with whole evaluations.
const WHAT: [(usize, bool); 4] = [(0, false), (1, false), (2, false), (2, true)];

impl Clouds {
    fn new(scene: &Scene, inverse: bool, precision: Precision) -> Result<Clouds, Failure> {
        // Feet sink in by a tenth of a millimetre, and what goes beyond that is no derivative.
        let eps = |centred, second| match precision {
            Precision::F64 => Grid::eps(precision, centred, second),
            Precision::F32 => 1e-4,
        };
        let grid = |centred: bool, second: bool| scene.grid(inverse, (eps(centred, second), centred, second));
        let (gradient, hessian) = (grid(true, false)?, grid(false, true)?);
        let mut alone = Points::default();
        alone.push([]);
        let (first, second) = (gradient.points(), hessian.points());
        Ok(Clouds([(gradient.clone(), alone), (gradient, first), (hessian, second)]))
    }
}

impl BenchClouds {
    /// Measures and prints.
    pub fn run(self) -> Result<(), Failure> {
        if let Some(file) = &self.output {
            lanesim::npz::check_writable(file).map_err(|e| Failure::file(file, e))?;
        }
        let most = self.threads.map_or_else(|| available_parallelism().map_or(1, usize::from), |n| n as usize);
        let threads: &[usize] = if most > 1 { &[1, most] } else { &[1] };
        let mut processes = self.processes(most);
        let contacts: &[usize] = if self.quick { &[6] } else { &[6, 4, 0] };
        let runs = if self.quick { 1 } else { self.runs };
        let workers = if processes.is_empty() { 2 } else { 3 };
        let total = contacts.len() * 2 * threads.len() * (runs as usize * workers * WHAT.len() + 1);
        let progress = Progress::new("clouds", "runs", total as u64, self.json);
        let mut rows = Vec::new();
        for contacts in contacts {
            let scene = Scene::new(*contacts)?;
            for inverse in [false, true] {
                let exact = reference(&scene, inverse)?;
                for threads in threads {
                    progress.counter().fetch_add(1, Ordering::Relaxed);
                    let processes = processes.get_mut(..*threads).unwrap_or_default();
                    let plan = Plan { scene: &scene, inverse, threads: *threads, runs, exact: &exact };
                    rows.extend(plan.rows(processes, &progress)?);
                }
            }
        }
        progress.finish();
        let version = processes.first().map(|process| process.version.as_str());
        let record = json!({
            "steps": STEPS,
            "runs": runs,
            "mujoco": version,
            "rows": rows.iter().map(Row::json).collect::<Vec<_>>(),
        });
        if let Some(file) = &self.output {
            std::fs::write(file, record.to_string()).map_err(|e| Failure::file(file, e))?;
        }
        if self.json { output::json(&record) } else { output::text(&report::tables(&rows, threads, version)) }
    }

    /// As many processes of MuJoCo as threads, or none.
    fn processes(&self, count: usize) -> Vec<Process> {
        if self.no_mujoco {
            return Vec::new();
        }
        let all: Result<Vec<_>, _> = (0..count).map(|_| Process::start(&self.python, SCRIPT)).collect();
        all.unwrap_or_else(|why| {
            output::notes("without MuJoCo", &[why]);
            Vec::new()
        })
    }
}

/// A scene's clouds on so many threads.
struct Plan<'a> {
    scene: &'a Scene,
    inverse: bool,
    threads: usize,
    runs: u32,
    exact: &'a Derivatives,
}

impl Plan<'_> {
    /// A row for each engine.
    fn rows(&self, processes: &mut [Process], progress: &Progress) -> Result<Vec<Row>, Failure> {
        let mut workers = Vec::new();
        for precision in [Precision::F64, Precision::F32] {
            let options = Options { precision, threads: Some(self.threads), ..Options::default() };
            let worlds = Box::new(self.scene.worlds(&options)?);
            workers.push((Worker::Ours(precision, worlds), Clouds::new(self.scene, self.inverse, precision)?));
        }
        if !processes.is_empty() {
            workers.push((Worker::MuJoCo, Clouds::new(self.scene, self.inverse, Precision::F64)?));
        }
        let mut seconds = vec![[(); WHAT.len()].map(|()| Vec::new()); workers.len()];
        let mut found: Vec<[Derivatives; 2]> = workers.iter().map(|_| Default::default()).collect();
        for run in 0..=self.runs {
            for (k, (worker, clouds)) in workers.iter_mut().enumerate() {
                // The first run of ours makes code and wakes threads, and is not counted.
                let warms = run == 0;
                if warms && matches!(worker, Worker::MuJoCo) {
                    continue;
                }
                for (place, (which, whole)) in WHAT.into_iter().enumerate() {
                    let outcome = self.visit(worker, &clouds.0[which], whole, processes)?;
                    if !warms {
                        seconds[k][place].push(outcome.seconds);
                        progress.counter().fetch_add(1, Ordering::Relaxed);
                    }
                    match (which, whole) {
                        (1, _) => found[k][0] = outcome.derivatives,
                        (2, false) => found[k][1] = outcome.derivatives,
                        _ => {}
                    }
                }
            }
        }
        let engines = workers.iter().map(|(worker, _)| match worker {
            Worker::Ours(Precision::F64, _) => "f64",
            Worker::Ours(Precision::F32, _) => "f32",
            Worker::MuJoCo => "MuJoCo",
        });
        Ok(engines
            .zip(seconds)
            .zip(&found)
            .map(|((engine, seconds), found)| self.row(engine, seconds, found))
            .collect())
    }

    fn visit(
        &self,
        worker: &mut Worker,
        (grid, points): &(Grid, Points),
        whole: bool,
        processes: &mut [Process],
    ) -> Result<Outcome, Failure> {
        let cloud = Cloud { scene: self.scene, inverse: self.inverse, grid, points, whole };
        match worker {
            Worker::Ours(_, worlds) => cloud.run(worlds, false),
            Worker::MuJoCo => cloud.run_mujoco(processes),
        }
    }

    fn row(&self, engine: &'static str, seconds: [Vec<f64>; WHAT.len()], found: &[Derivatives; 2]) -> Row {
        let median = |mut all: Vec<f64>| {
            all.sort_by(f64::total_cmp);
            all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
        };
        let n = self.scene.columns(self.inverse).len();
        let Derivatives { gradient, hessian, kinks } = self.exact;
        Row {
            dynamics: if self.inverse { Dynamics::Inverse } else { Dynamics::Forward },
            contacts: self.scene.contacts,
            found: self.scene.found,
            engine,
            threads: self.threads,
            states: [STEPS, STEPS * (1 + 2 * n), STEPS * (1 + n + n * (n + 1) / 2)],
            seconds: seconds.map(median),
            gradient: errors(&found[0].gradient, gradient, kinks),
            hessian: errors(&found[1].hessian, hessian, kinks),
            judged: kinks.iter().filter(|kink| !**kink).count(),
        }
    }
}
