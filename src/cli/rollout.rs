//! `lanesim rollout`: many worlds, many steps, trajectories to a file.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueHint};
use lanesim::npz;
use serde_json::json;

use super::arrays::{Dim, Inputs};
use super::engine::{self, Batch, Controls, Key, Model, Setup};
use super::failure::Failure;
use super::{ModelArgs, RunArgs, count, output};

const EXAMPLES: &str = "\
Examples:
  lanesim rollout ant.xml --worlds 256 --steps 500 --noise --seed 3 -o ant.npz
  lanesim rollout ant.xml --worlds 256 --steps 500 --controls u.npz --states s.npz --outputs qpos,qvel -o ant.npz

u.npz holds `ctrl` [nworld, nstep, nu]; s.npz holds `qpos` [nworld, nq] and, if wanted, `qvel` [nworld, nv].";

/// Arguments of `rollout`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Rollout {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Number of worlds
    #[arg(long, value_name = "N", value_parser = count)]
    worlds: usize,
    /// Steps of each world
    #[arg(long, value_name = "T", value_parser = count)]
    steps: usize,
    /// File with controls: array `ctrl` [nworld, nstep, nu]; without it they stay zero, or the keyframe's
    #[arg(long, value_name = "U.npz", value_hint = ValueHint::FilePath)]
    controls: Option<PathBuf>,
    /// Redraw every control uniformly in its range at every step
    #[arg(long, conflicts_with = "controls")]
    noise: bool,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// File with start states: `qpos` [nworld, nq], `qvel` [nworld, nv], `time` [nworld]; each may be missing
    #[arg(long, value_name = "S.npz", value_hint = ValueHint::FilePath)]
    states: Option<PathBuf>,
    /// Keyframe from which worlds start where the states do not say otherwise
    #[arg(long, value_name = "INDEX")]
    keyframe: Option<usize>,
    /// Quantities to write after every step, by MuJoCo's names
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "qpos,qvel")]
    outputs: Vec<String>,
    /// File to write: one array [nworld, nstep, ...] per output
    #[arg(short, long, value_name = "OUT.npz", value_hint = ValueHint::FilePath)]
    output: PathBuf,
    /// Print a summary as one JSON object
    #[arg(long)]
    json: bool,
}

impl Rollout {
    /// Checks everything, then runs, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let loaded = engine::load(&self.model)?;
        output::notes("left out", &loaded.losses);
        let model = &loaded.model;
        let controls = self.controls(model)?;
        let mut batch = Batch::new(model, self.worlds, &Setup::from(&self.run))?;
        self.start(model, &mut batch)?;
        let controls = match &controls {
            Some(u) => Controls::Given(u),
            None if self.noise => Controls::Noise { seed: self.seed },
            None => Controls::Hold,
        };
        let bar = output::progress("rollout", self.worlds as u64 * self.steps as u64, self.json);
        let start = Instant::now();
        let done = batch.run(self.steps, controls, &self.outputs, &|n| bar.set_position(n))?;
        let seconds = start.elapsed().as_secs_f64();
        bar.finish_and_clear();
        let arrays: Vec<_> = self.outputs.iter().cloned().zip(done.outputs).collect();
        npz::write(&self.output, &arrays).map_err(|e| Failure::file(&self.output, e))?;
        self.summary(model, &batch, seconds)
    }

    fn controls(&self, model: &Model) -> Result<Option<Vec<f64>>, Failure> {
        let Some(path) = &self.controls else { return Ok(None) };
        let mut inputs = Inputs::read(path)?;
        let shape = [Dim("nworld", self.worlds), Dim("nstep", self.steps), Dim("nu", model.size("nu"))];
        let Some(controls) = inputs.take("ctrl", &shape)? else {
            return Err(Failure::file(path, "has no array `ctrl` [nworld, nstep, nu]"));
        };
        inputs.finish(&["ctrl"])?;
        Ok(Some(controls))
    }

    fn start(&self, model: &Model, batch: &mut Batch) -> Result<(), Failure> {
        if let Some(index) = self.keyframe {
            let nkey = model.size("nkey");
            let key = model
                .key(index)
                .ok_or_else(|| Failure::Usage(format!("--keyframe {index}: the model has {nkey} keyframes")))?;
            for world in 0..self.worlds {
                reset_world(batch, world, &key)?;
            }
        }
        let Some(path) = &self.states else { return Ok(()) };
        let mut inputs = Inputs::read(path)?;
        let fields = [("qpos", Some(Dim("nq", model.size("nq")))), ("qvel", Some(Dim("nv", model.size("nv")))), ("time", None)];
        for (name, width) in fields {
            let shape: Vec<Dim> = std::iter::once(Dim("nworld", self.worlds)).chain(width).collect();
            if let Some(values) = inputs.take(name, &shape)? {
                set_all(batch, name, &values, self.worlds)?;
            }
        }
        inputs.finish(&["qpos", "qvel", "time"])
    }

    fn summary(&self, model: &Model, batch: &Batch, seconds: f64) -> Result<(), Failure> {
        let lost = (0..self.worlds).filter(|&w| batch.lost(w)).count();
        let rate = self.worlds as f64 * self.steps as f64 / seconds;
        if self.json {
            return output::json(&json!({
                "model": model.name(), "nworld": self.worlds, "nstep": self.steps, "seconds": seconds,
                "steps_per_second": rate, "lost": lost, "output": self.output,
            }));
        }
        output::table(&[
            ("model", model.name().to_owned()),
            ("worlds x steps", format!("{} x {}", self.worlds, self.steps)),
            ("speed", format!("{} steps/s", output::human(rate))),
            ("lost worlds", lost.to_string()),
            ("written", self.output.display().to_string()),
        ])
    }
}

/// Sets a field of every world from an array with one row per world.
pub fn set_all(batch: &mut Batch, name: &str, values: &[f64], worlds: usize) -> Result<(), Failure> {
    let width = values.len() / worlds;
    (0..worlds).try_for_each(|w| batch.set(name, w, &values[w * width..][..width]))
}

/// Puts world 0 into a keyframe.
pub fn reset(batch: &mut Batch, key: &Key) -> Result<(), Failure> {
    reset_world(batch, 0, key)
}

fn reset_world(batch: &mut Batch, world: usize, key: &Key) -> Result<(), Failure> {
    batch.set("time", world, &[key.time])?;
    batch.set("qpos", world, &key.qpos)?;
    batch.set("qvel", world, &key.qvel)?;
    batch.set("ctrl", world, &key.ctrl)
}
