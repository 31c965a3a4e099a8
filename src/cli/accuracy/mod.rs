//! `lanesim accuracy`: error against run time, beside MuJoCo.

mod campaign;
mod curve;
mod engine;
mod error;
mod list;
mod mujoco;
mod ours;
mod plot;
mod reference;
mod report;
mod ruler;
mod scenario;

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};
use serde_json::Value;

use super::Precision;
use super::failure::Failure;
use super::output::{self, Progress};
use campaign::{Campaign, Row};
use list::SCENARIOS;
use mujoco::MuJoCo;
use reference::References;
use report::Line;
use scenario::Scenario;

const ABOUT: &str = "\
Every scenario is run over time steps, integrators, contact cones and solvers, with lanesim in double and single precision and,
if Python has the package, with MuJoCo, by turns on one thread. One ruler measures all errors from positions and velocities.
References are made once and kept. Work is wall seconds per simulated second, world and core: of one world for MuJoCo, of a full
batch for lanesim. An engine's curve is what no other of its settings beats; ratios are read at the errors of MuJoCo's Euler step
at 5, 2 and 0.5 ms.

Examples:
  lanesim accuracy --quick
  lanesim accuracy --list
  lanesim accuracy A1 B4 -o results
  lanesim accuracy --integrators midpoint,RK4 --precision f64 --no-mujoco";

/// Arguments of `accuracy`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct Accuracy {
    /// Scenarios, by their short names [default: all, or the quick ones]
    #[arg(value_name = "SCENARIO")]
    scenarios: Vec<String>,
    /// A few scenarios and time steps: under a minute
    #[arg(long)]
    quick: bool,
    /// List the scenarios, and run nothing
    #[arg(long)]
    list: bool,
    /// Number types of lanesim
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["f64", "f32"])]
    precision: Vec<Precision>,
    /// Integrators, those that MuJoCo lacks for lanesim alone
    #[arg(long, value_delimiter = ',', value_name = "NAMES",
          default_values = ["Euler", "implicitfast", "implicit", "discrete", "RK4", "midpoint"])]
    integrators: Vec<String>,
    /// Time steps in ms instead of the scenarios' own; each must divide 20
    #[arg(long, value_delimiter = ',', value_name = "MS", value_parser = milliseconds)]
    timesteps: Option<Vec<f64>>,
    /// Least time for which steps of a setting are timed, s
    #[arg(long, value_name = "SECONDS", default_value_t = 0.05)]
    timed: f64,
    /// Leave MuJoCo out
    #[arg(long)]
    no_mujoco: bool,
    /// Python with the package mujoco
    #[arg(long, value_name = "PYTHON", default_value = "python3", value_hint = ValueHint::ExecutablePath)]
    python: String,
    /// Folder where references are kept [default: the user's cache folder]
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    cache: Option<PathBuf>,
    /// Folder for accuracy.json, accuracy.md and the plots; it is made if it is not there
    #[arg(short = 'o', long = "output", value_name = "DIR", value_hint = ValueHint::DirPath)]
    output: Option<PathBuf>,
}

/// A time step in ms, as seconds; steps must fit into the time for which controls are held.
fn milliseconds(text: &str) -> Result<f64, String> {
    let ms: f64 = text.parse().map_err(|e| format!("{e}"))?;
    let steps = 20.0 / ms;
    let fits = ms > 0.0 && steps >= 1.0 - 1e-9 && (steps - steps.round()).abs() < 1e-6 && steps < 1e6;
    if fits { Ok(1e-3 * ms) } else { Err("must divide 20 ms".into()) }
}

impl Accuracy {
    /// Measures, prints the table, and writes the rest.
    pub fn run(self) -> Result<(), Failure> {
        if self.list {
            let rows: Vec<_> = SCENARIOS.iter().map(|s| (s.id, format!("{} ({})", s.title, s.error.name()))).collect();
            return output::table(&rows);
        }
        let chosen = self.chosen()?;
        if let Some(folder) = &self.output {
            std::fs::create_dir_all(folder).map_err(|e| Failure::file(folder, e))?;
        }
        let mut mujoco = self.mujoco();
        let campaign = self.campaign();
        let engines = campaign.engines(mujoco.is_some());
        let runs = |s: &&Scenario| {
            let settings = campaign.settings(s);
            engines.iter().map(|e| settings.iter().filter(|s| e.has(s)).count() as u64).sum::<u64>()
        };
        let progress = Progress::new("accuracy", "runs", chosen.iter().map(runs).sum(), false);
        let tell = || {
            progress.counter().fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        };
        let (mut lines, mut rows): (Vec<Line>, Vec<Row>) = Default::default();
        for scenario in &chosen {
            let found = campaign.run(scenario, &mut mujoco, &tell)?;
            lines.push(Line::new(scenario, &found));
            if let Some(folder) = &self.output {
                picture(&folder.join(format!("{}.svg", scenario.id)), |file| {
                    plot::scenario(file, &format!("{} {}", scenario.id, scenario.title), &found)
                })?;
            }
            rows.extend(found);
        }
        progress.finish();
        output::notes("not run", &refused(&rows));
        let version = mujoco.as_ref().map(|mujoco| mujoco.version.as_str());
        let table = report::markdown(&lines, version);
        if let Some(folder) = &self.output {
            self.write(folder, &table, &lines, &rows)?;
        }
        output::text(&table)
    }

    fn chosen(&self) -> Result<Vec<&'static Scenario>, Failure> {
        if self.scenarios.is_empty() {
            return Ok(SCENARIOS.iter().filter(|s| s.quick || !self.quick).collect());
        }
        let find = |name: &String| {
            let found = SCENARIOS.iter().find(|s| s.id.eq_ignore_ascii_case(name));
            found.ok_or_else(|| {
                Failure::Usage(format!("there is no scenario {name}: `lanesim accuracy --list` shows all"))
            })
        };
        self.scenarios.iter().map(find).collect()
    }

    fn campaign(&self) -> Campaign {
        let precision = |p: &Precision| match p {
            Precision::F32 => lanesim::Precision::F32,
            Precision::F64 => lanesim::Precision::F64,
        };
        Campaign {
            quick: self.quick,
            integrators: self.integrators.clone(),
            precisions: self.precision.iter().map(precision).collect(),
            timesteps: self.timesteps.clone(),
            seconds: if self.quick { 0.2 * self.timed } else { self.timed },
            references: References::new(self.cache.clone()),
        }
    }

    fn mujoco(&self) -> Option<MuJoCo> {
        if self.no_mujoco {
            return None;
        }
        match MuJoCo::start(&self.python) {
            Ok(mujoco) => Some(mujoco),
            Err(why) => {
                output::notes("without MuJoCo", &[why]);
                None
            }
        }
    }

    fn write(&self, folder: &Path, table: &str, lines: &[Line], rows: &[Row]) -> Result<(), Failure> {
        let json: Value = rows.iter().map(Row::json).collect();
        for (name, text) in [("accuracy.json", json.to_string()), ("accuracy.md", table.to_owned())] {
            let file = folder.join(name);
            std::fs::write(&file, text).map_err(|e| Failure::file(&file, e))?;
        }
        picture(&folder.join("summary.svg"), |file| plot::summary(file, lines))
    }
}

fn picture(file: &Path, draw: impl FnOnce(&Path) -> Result<(), Box<dyn std::error::Error>>) -> Result<(), Failure> {
    draw(file).map_err(|e| Failure::file(file, e))
}

/// Settings that were refused, each reason once.
fn refused(rows: &[Row]) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for row in rows {
        let Some(why) = &row.refused else { continue };
        let why = why.lines().next().unwrap_or_default();
        let line = format!("{} {} {}: {why}", row.scenario, row.engine, row.setting.name());
        if !all.contains(&line) {
            all.push(line);
        }
    }
    all
}
