//! `lanesim bench`: speed, and the error that comes with it.

use std::collections::BTreeMap;

use clap::Args;
use lanesim::Model;
use serde_json::{Map, Value, json};

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::measure::{Measurement, Plan};
use super::output::{self, Progress};
use super::{KeyArgs, ModelArgs, RunArgs, count, share};

const ABOUT: &str = "\
Worlds start from 32 states that were warmed up under uniform control noise, copied over all worlds with a little noise on the
velocity; controls are redrawn at every step. The speed is that of a run without
statistics, residuals and clocks; those come from an equal run before it, which must end in the same state hash. Cycles are
the clock's: a chain of dependent multiplications tells how fast a core ticks around the runs. The step error is the relative difference
of the next velocity from the scalar f64 path solved to 1e-12, over 256 states of the run.

Examples:
  lanesim bench models/zoo/humanoid18.xml --worlds 4096 --steps 100
  lanesim bench models/zoo/ant.xml --worlds 4096 --steps 100 --precision f32 --threads 1 --json";

/// Arguments of `bench`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct Bench {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Number of worlds
    #[arg(long, value_name = "N", default_value = "4096", value_parser = count)]
    worlds: usize,
    /// Steps of each world
    #[arg(long, value_name = "T", default_value = "100", value_parser = count)]
    steps: usize,
    /// Share of their ranges, around the middle, from which controls are drawn at every step
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_value = "1", default_missing_value = "1",
          value_parser = share)]
    noise: f64,
    #[command(flatten)]
    start: KeyArgs,
    /// Steps of the warm-up before [default: those of 2 s of simulated time, at least 500 and at most 2000]
    #[arg(long, value_name = "T")]
    warm_up: Option<usize>,
    /// Seed of start states and control noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Bench {
    /// Measures and prints.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, seconds, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let accurate = engine::load_with(&self.model, &[("tolerance", "1e-12"), ("iterations", "200")])?.model;
        self.run.check_memory(&model, self.worlds)?;
        let key = self.start.find(&model)?;
        let plan = Plan {
            model: &model,
            accurate: &accurate,
            options: self.run.options(key),
            nworld: self.worlds,
            nstep: self.steps,
            key,
            warm_up: self.warm_up,
            noise: self.noise,
            seed: self.seed,
        };
        let progress = Progress::new("bench", "steps", plan.total(), self.json);
        let measured = plan.measure(progress.counter());
        progress.finish();
        let record = self.record(&model, &measured?, seconds);
        if self.json { output::json(&Value::Object(record)) } else { print(&record) }
    }

    /// The figures by name.
    fn record(&self, model: &Model, m: &Measurement, load_seconds: f64) -> Map<String, Value> {
        let s = &m.statistics;
        let per = |sum: f64, count: f64| if count > 0.0 { sum / count } else { 0.0 };
        let steps = self.worlds as f64 * self.steps as f64;
        // Of a core, per world and step.
        let cycles = |seconds: f64| seconds * m.hertz / steps;
        let stages = |f: &dyn Fn(f64) -> f64| -> Map<String, Value> {
            m.stage_seconds.iter().map(|(name, seconds)| ((*name).into(), json!(f(*seconds)))).collect()
        };
        let record = json!({
            "model": model.name(),
            "nworld": self.worlds,
            "nstep": self.steps,
            "threads": m.threads,
            "precision": format!("{:?}", self.run.options(None).precision).to_lowercase(),
            "backend": m.running.backend.name(),
            "isa": m.running.instructions.map_or_else(engine::isa, |set| set.name().to_lowercase()),
            "lanes": m.lanes.0,
            "lane_type": m.lanes.1,
            "noise": self.noise,
            "seed": self.seed,
            "load_seconds": load_seconds,
            "seconds": m.seconds,
            "steps_per_second": steps / m.seconds,
            "clock_hertz": m.hertz,
            "cycles": cycles(m.seconds * m.threads as f64),
            "lost": m.lost,
            "ncon_mean": per(s.contacts, s.world_steps),
            "nefc_mean": per(s.rows, s.world_steps),
            "solver_niter_mean": per(s.iterations, s.world_steps),
            "solver_niter_max": s.most_iterations,
            "solver_residual_mean": per(s.residuals, s.world_steps),
            "solver_residual_max": s.largest_residual,
            "solver_niter_block_max_mean": per(s.block_iterations, s.block_steps),
            "slot_occupancy": per(s.contacts, s.slots),
            "state_hash": format!("{:016x}", m.hash),
            "step_error_median": m.errors.get(m.errors.len() / 2),
            "step_error_max": m.errors.last(),
            "step_error_states": m.errors.len(),
            "stage_seconds": stages(&|seconds| seconds),
            "stage_cycles": stages(&cycles),
            "stage_operations": m.stage_operations.iter().copied().collect::<BTreeMap<_, _>>(),
        });
        match record {
            Value::Object(map) => map,
            _ => Map::new(),
        }
    }
}

/// The record for people.
fn print(record: &Map<String, Value>) -> Result<(), Failure> {
    let text = |name: &str| match record.get(name) {
        Some(Value::String(s)) => s.clone(),
        Some(v) => v.to_string(),
        None => String::new(),
    };
    let number = |name: &str| record.get(name).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let mut rows = vec![
        ("model", text("model")),
        ("worlds x steps", format!("{} x {}", text("nworld"), text("nstep"))),
        (
            "how",
            format!(
                "{}, {} ({} worlds per block), {}, threads: {}",
                text("precision"),
                text("backend"),
                text("lanes"),
                text("isa"),
                text("threads")
            ),
        ),
        ("speed", format!("{}steps/s in {:.3} s", output::human(number("steps_per_second")), number("seconds"))),
        (
            "cycles",
            format!("{:.0} of a core per world and step, at {:.2} GHz", number("cycles"), 1e-9 * number("clock_hertz")),
        ),
        ("lost worlds", text("lost")),
        ("state hash", text("state_hash")),
        (
            "step error",
            format!(
                "median {:.2e}, worst {:.2e} of {} states",
                number("step_error_median"),
                number("step_error_max"),
                text("step_error_states")
            ),
        ),
        ("contacts", format!("{:.2} per world, {:.2} rows", number("ncon_mean"), number("nefc_mean"))),
        ("slot occupancy", format!("{:.2}", number("slot_occupancy"))),
        (
            "iterations",
            format!(
                "{:.2} mean, {:.2} slowest of a block, {:.0} most",
                number("solver_niter_mean"),
                number("solver_niter_block_max_mean"),
                number("solver_niter_max")
            ),
        ),
        (
            "residual",
            format!("{:.1e} mean, {:.1e} largest", number("solver_residual_mean"), number("solver_residual_max")),
        ),
    ];
    rows.extend(stage_rows(record));
    output::table(&rows)
}

/// What the stages took in the run with clocks.
fn stage_rows(record: &Map<String, Value>) -> Vec<(&str, String)> {
    let number = |name: &str| record.get(name).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let of_stage = |list: &str, stage: &str| record.get(list).and_then(|all| all.get(stage)).and_then(Value::as_f64);
    let stages = record.get("stage_seconds").and_then(Value::as_object).into_iter().flatten();
    let times = stages.filter_map(|(name, seconds)| Some((name.as_str(), seconds.as_f64().filter(|s| *s > 0.0)?)));
    let total: f64 = times.clone().map(|(_, seconds)| seconds).sum();
    let steps = number("nworld") * number("nstep");
    let row = |(name, seconds): (_, f64)| {
        let cycles = of_stage("stage_cycles", name).unwrap_or(f64::NAN);
        let (percent, ns) = (100.0 * seconds / total, 1e9 * seconds / steps);
        let mut text = format!("{percent:5.1} % {ns:8.1} ns {cycles:8.0} cycles per world and step");
        if let Some(operations) = of_stage("stage_operations", name) {
            let blocks = operations / number("lanes");
            text += &format!("  {:.1} vector operations per ns, {:.2} per cycle", blocks / ns, blocks / cycles);
        }
        (name, text)
    };
    times.map(row).collect()
}
