//! `lanesim rollout`: many worlds, many steps, trajectories to a file.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueHint};
use lanesim::rollout::Statistics;
use lanesim::{Controls, Field, Model, Worlds};
use serde_json::json;

use super::arrays::{Dim, Inputs};
use super::destination::Destination;
use super::engine::{self, Loaded, set_all, size};
use super::failure::Failure;
use super::output::{self, Progress};
use super::{InputArgs, KeyArgs, ModelArgs, RunArgs, count, memory, share, with_outputs};

const EXAMPLES: &str = "\
Examples:
  lanesim rollout ant.xml --worlds 256 --steps 500 --noise 0.5 --seed 3 -o ant.npz
  lanesim rollout arm.xml --worlds 16 --steps 500 --keyframe reach --outputs qpos,xpos -o arm.npz
  lanesim rollout ant.xml --worlds 256 --steps 500 --controls u.npz --states s.npz --outputs qpos,qvel -o ant.npz

u.npz holds `ctrl` [nworld, nstep, nu]; s.npz holds any of `time` [nworld], s, `qpos` [nworld, nq] and `qvel` [nworld, nv], in
MuJoCo's units: m, rad, m/s, rad/s. The result holds one array [nworld, nstep, ...] per output.";

/// Arguments of `rollout`.
#[derive(Args)]
#[command(after_help = EXAMPLES, after_long_help = with_outputs(EXAMPLES))]
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
    /// Redraw every control at every step, uniformly in this share of its range around the middle; without a number in
    /// all of it (1)
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_missing_value = "1", value_parser = share,
          conflicts_with = "controls")]
    noise: Option<f64>,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// File with start states: `qpos` [nworld, nq], `qvel` [nworld, nv], `time` [nworld]; each may be missing
    #[arg(long, value_name = "S.npz", value_hint = ValueHint::FilePath)]
    states: Option<PathBuf>,
    #[command(flatten)]
    start: KeyArgs,
    #[command(flatten)]
    input: InputArgs,
    /// Quantities to write after every step, by MuJoCo's names
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "qpos,qvel")]
    outputs: Vec<String>,
    #[command(flatten)]
    output: Destination,
    /// Print a summary as one JSON object
    #[arg(long)]
    json: bool,
}

impl Rollout {
    /// Checks everything, then runs, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let names = engine::unique(&self.outputs)?;
        let inputs = [Some(&self.model.model), self.controls.as_ref(), self.states.as_ref()];
        self.output.check(inputs.into_iter().flatten())?;
        let Loaded { model, includes, .. } = engine::load(&self.model)?;
        self.output.check(&includes)?;
        output::losses(&model);
        let outputs = engine::outputs(&model, &names)?;
        let width: usize = outputs.iter().filter_map(|o| o.width(&model)).sum();
        memory::check("the outputs", &[self.worlds, self.steps, width, size_of::<f64>()], self.run.max_memory)?;
        let controls = self.controls(&model)?;
        let mut worlds = self.run.worlds(&model, self.worlds, self.start.find(&model)?)?;
        self.start(&model, &mut worlds)?;
        let progress = Progress::new("rollout", "steps", self.worlds as u64 * self.steps as u64, self.json);
        let start = Instant::now();
        let result = worlds.rollout(&lanesim::Rollout {
            nstep: self.steps,
            controls: match (&controls, self.noise) {
                (Some(u), _) => Controls::Given(u),
                (None, Some(scale)) => Controls::Noise { seed: self.seed, scale },
                (None, None) => Controls::Keep,
            },
            outputs: &outputs,
            progress: Some(progress.counter()),
            statistics: true,
            ..lanesim::Rollout::default()
        })?;
        let seconds = start.elapsed().as_secs_f64();
        progress.finish();
        let mut arrays = Vec::new();
        for (output, values) in names.iter().copied().zip(&outputs).zip(result.outputs) {
            arrays.push(engine::named(output, &model, &[self.worlds, self.steps], values)?);
        }
        self.output.write(&arrays)?;
        self.summary(&model, &worlds, &result.statistics, seconds)
    }

    fn controls(&self, model: &Model) -> Result<Option<Vec<f64>>, Failure> {
        let Some(path) = &self.controls else { return Ok(None) };
        let mut inputs = Inputs::read(path, self.input.input_limit)?;
        inputs.check_names(&["ctrl"])?;
        let shape = [Dim("nworld", self.worlds), Dim("nstep", self.steps), Dim("nu", size(model, "nu"))];
        let Some(controls) = inputs.take("ctrl", &shape)? else {
            return Err(Failure::file(path, "has no array `ctrl` [nworld, nstep, nu]"));
        };
        Ok(Some(controls))
    }

    /// Puts the worlds where they start, as far as the states say.
    fn start(&self, model: &Model, worlds: &mut Worlds) -> Result<(), Failure> {
        let Some(path) = &self.states else { return Ok(()) };
        let mut inputs = Inputs::read(path, self.input.input_limit)?;
        inputs.check_names(&["time", "qpos", "qvel"])?;
        for field in [Field::Time, Field::Qpos, Field::Qvel] {
            let own = super::eval::shape(field, model);
            let shape: Vec<Dim> = std::iter::once(Dim("nworld", self.worlds)).chain(own).collect();
            if let Some(values) = inputs.take(field.name(), &shape)? {
                set_all(worlds, field, &values)?;
            }
        }
        Ok(())
    }

    fn summary(&self, model: &Model, worlds: &Worlds, s: &Statistics, seconds: f64) -> Result<(), Failure> {
        let (lost, hash) = (worlds.lost(), format!("{:016x}", worlds.state_hash()));
        let rate = self.worlds as f64 * self.steps as f64 / seconds;
        let (niter, residual) = (s.per_world_step(s.iterations), s.per_world_step(s.residuals));
        if self.json {
            return output::json(&json!({
                "model": model.name(), "nworld": self.worlds, "nstep": self.steps, "seconds": seconds,
                "steps_per_second": rate, "lost": lost, "state_hash": hash,
                "solver_niter_mean": niter, "solver_niter_max": s.most_iterations,
                "solver_residual_mean": residual, "solver_residual_max": s.largest_residual,
                "guarded": s.per_world_step(s.guarded), "events": engine::events(worlds)?, "output": self.output.shown(),
            }));
        }
        output::notes("flag", &engine::events(worlds)?);
        let mut rows = vec![
            ("model", model.name().to_owned()),
            ("worlds x steps", format!("{} x {}", self.worlds, self.steps)),
            ("speed", format!("{}steps/s", output::human(rate))),
            ("lost worlds", lost.to_string()),
            ("state hash", hash),
            ("iterations", format!("{niter:.2} mean, {:.0} most", s.most_iterations)),
            ("residual", format!("{residual:.1e} mean, {:.1e} largest", s.largest_residual)),
            ("written", self.output.shown()),
        ];
        if model.tables().sizes.nguard > 0 {
            let share = 100.0 * s.per_world_step(s.guarded);
            rows.insert(rows.len() - 1, ("guard", format!("acted in {share:.3} % of the worlds' steps")));
        }
        output::table(&rows)
    }
}
