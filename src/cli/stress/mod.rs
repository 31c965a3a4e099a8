//! `lanesim stress`: which worlds are lost, and when.

mod long;
mod map;
mod wild;

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum, ValueHint};
use serde_json::json;

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::output::{self, Progress};
use super::{KeyArgs, ModelArgs, RunArgs, count};
use long::Long;
use map::Map;
use wild::Wildness;

const ABOUT: &str = "\
Wild worlds start with random joint speeds and are driven by controls at the ends of their ranges, drawn again ten times a second.
A world is lost when it is frozen: when its state, or its rate, is not finite or huge. The map counts lost worlds for every
integrator, time step and severity; severity multiplies what --scale names.

The long test (--long) runs one severity, with the model's own integrator and time step, for as long as is asked for, and writes
its state to a file every now and then. The same command goes on from that file, with the same bits, after it was stopped.

Examples:
  lanesim stress models/zoo/humanoid27.xml
  lanesim stress models/zoo/humanoid27.xml --integrators Euler,implicitfast --timesteps 2,5,10 --picture map.svg
  lanesim stress models/zoo/humanoid27.xml --long 3600 --worlds 4096 --state wild.npz --option timestep=0.005";

/// Arguments of `stress`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct Stress {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    #[command(flatten)]
    start: KeyArgs,
    /// Worlds of a cell, or of the long test
    #[arg(long, value_name = "N", default_value = "128", value_parser = count)]
    worlds: usize,
    /// Simulated time of a cell, s
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = positive)]
    seconds: f64,
    /// Integrators of the map
    #[arg(long, value_delimiter = ',', value_name = "NAMES",
          default_values = ["Euler", "implicitfast", "implicit", "discrete", "RK4", "midpoint"])]
    integrators: Vec<String>,
    /// Time steps of the map, ms
    #[arg(long, value_delimiter = ',', value_name = "MS", default_values = ["1", "2", "5", "10", "20"], value_parser = positive)]
    timesteps: Vec<f64>,
    /// Severities of the map; the long test takes the first
    #[arg(long, value_delimiter = ',', value_name = "FACTORS", value_parser = positive)]
    severity: Vec<f64>,
    /// What severity multiplies
    #[arg(long, value_delimiter = ',', value_enum, default_values = ["speeds", "torques"])]
    scale: Vec<Scale>,
    /// Standard deviation of joint speeds at severity 1, rad/s or m/s
    #[arg(long, value_name = "SPEED", default_value = "15", value_parser = positive)]
    speed: f64,
    /// Seed
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Run the long test for so much simulated time, s
    #[arg(long, value_name = "SECONDS", value_parser = positive, requires = "state")]
    long: Option<f64>,
    /// File of the long test's state; if it is there, the test goes on from it
    #[arg(long, value_name = "FILE.npz", value_hint = ValueHint::FilePath, requires = "long")]
    state: Option<PathBuf>,
    /// Time between two times that the state is written, s
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = positive)]
    every: f64,
    /// Draw the map to this file
    #[arg(long, value_name = "FILE.svg", value_hint = ValueHint::FilePath, conflicts_with = "long")]
    picture: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What severity multiplies.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Scale {
    /// Speeds of joints at the start
    Speeds,
    /// Share of the control ranges, at most 1
    Torques,
    /// Gains and biases of actuators
    Gains,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 1e9 => Ok(x),
        Ok(_) => Err("must be above 0, and at most 1e9".into()),
        Err(e) => Err(e.to_string()),
    }
}

impl Stress {
    /// Runs the map or the long test.
    pub fn run(self) -> Result<(), Failure> {
        match (self.long, &self.state) {
            (Some(seconds), Some(file)) => self.long(seconds, file),
            _ => self.map(),
        }
    }

    fn wildness(&self, severity: f64) -> Wildness {
        let factor = |scale| if self.scale.contains(&scale) { severity } else { 1.0 };
        Wildness {
            speed: self.speed * factor(Scale::Speeds),
            torque: factor(Scale::Torques).min(1.0),
            gain: factor(Scale::Gains),
            hertz: 10.0,
            seed: self.seed,
        }
    }

    fn map(&self) -> Result<(), Failure> {
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let severities = if self.severity.is_empty() { &[0.25, 0.5, 1.0, 2.0, 4.0][..] } else { &self.severity };
        let timesteps: Vec<f64> = self.timesteps.iter().map(|ms| 1e-3 * ms).collect();
        let map = Map {
            model: &self.model,
            run: &self.run,
            start: &self.start,
            worlds: self.worlds,
            seconds: self.seconds,
            integrators: &self.integrators,
            timesteps: &timesteps,
            severities: severities.iter().map(|s| (*s, self.wildness(*s))).collect(),
        };
        let progress = Progress::new("stress", "cells", map.cells() as u64, self.json);
        let sheets = map.measure(progress.counter());
        progress.finish();
        let sheets = sheets?;
        if let Some(file) = &self.picture {
            map.picture(file, &sheets).map_err(|e| Failure::file(file, e))?;
        }
        if self.json { output::json(&map.json(&sheets)) } else { output::text(&map.text(&sheets)) }
    }

    fn long(&self, seconds: f64, file: &std::path::Path) -> Result<(), Failure> {
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let key = self.start.find(&model)?;
        let mut worlds = self.run.worlds(&model, self.worlds, key)?;
        let wildness = self.wildness(self.severity.first().copied().unwrap_or(1.0));
        let timestep = model.tables().options.timestep;
        let held = wildness.held(timestep);
        let intervals = (seconds / (timestep * held as f64)).round().max(1.0) as u64;
        let long = Long { wildness, intervals, file, every: Duration::from_secs_f64(self.every) };
        let from = long.begin(&mut worlds, key)?;
        let steps = (held * self.worlds) as u64;
        let progress = Progress::new("stress", "steps", intervals * steps, self.json);
        let result = long.run(&mut worlds, from, progress.counter());
        progress.finish();
        result?;
        let done = intervals.max(from);
        let simulated = done as f64 * held as f64 * timestep;
        if self.json {
            let went_on = from > 0;
            return output::json(&json!({
                "model": model.name(), "worlds": self.worlds, "seconds": simulated, "world_steps": done * steps,
                "lost": worlds.lost(), "resumed": went_on, "state_hash": format!("{:016x}", worlds.state_hash()),
            }));
        }
        output::table(&[
            ("model", model.name().to_owned()),
            ("simulated", format!("{} worlds, {simulated} s each, {} world steps", self.worlds, done * steps)),
            ("lost worlds", worlds.lost().to_string()),
            ("state hash", format!("{:016x}", worlds.state_hash())),
        ])
    }
}
