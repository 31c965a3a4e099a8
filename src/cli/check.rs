//! `lanesim check`: does a model load, and does it stay finite?

use std::sync::atomic::AtomicU64;

use clap::Args;
use lanesim::{Controls, Field, Model, Rollout, StatusEvent};
use serde_json::{Value, json};

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::output::{self, Progress};
use super::{KeyArgs, ModelArgs, RunArgs, count, share};

const ABOUT: &str = "\
A world starts from the keyframe, or else from the reference configuration, and is stepped twice: with the controls that it
starts with, which are zero unless the keyframe says otherwise; and, if the model has actuators, under control noise from the
same start. Flags of both are reported. Raised flags are no failure: a world that diverged is one of them.

Examples:
  lanesim check models/zoo/ant.xml --steps 1000
  lanesim check models/zoo/arm.xml --keyframe reach --noise 0.5 --seed 7
  lanesim check models/zoo/ant.xml --on-diverge error       # exit status 1 if the world diverges

Exit status: 0 the model loaded and was stepped, 1 it was rejected, 2 the command line is wrong.";

/// Steps between two looks at the progress bar.
const STRIDE: usize = 1000;

/// Arguments of `check`.
#[derive(Args)]
#[command(after_help = ABOUT)]
pub struct Check {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Steps to take with the controls of the start, and as many again under control noise
    #[arg(long, value_name = "N", default_value = "100", value_parser = count)]
    steps: usize,
    /// Share of their ranges, around the middle, from which controls are drawn at every step of the second run
    #[arg(long, value_name = "SHARE", num_args = 0..=1, default_value = "1", default_missing_value = "1",
          value_parser = share)]
    noise: f64,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    start: KeyArgs,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What one of the two runs came to.
struct Outcome {
    controls: &'static str,
    time: f64,
    flags: Vec<&'static str>,
    events: Vec<StatusEvent>,
}

impl Check {
    /// Compiles and steps one world. Raised flags are reported, they are not a failure.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let mut runs = vec![("held", Controls::Keep)];
        if engine::size(&model, "nu") > 0 {
            runs.push(("noise", Controls::Noise { seed: self.seed, scale: self.noise }));
        }
        let progress = Progress::new("checking", "steps", (runs.len() * self.steps) as u64, self.json);
        let step = |(name, controls)| self.step(&model, name, controls, progress.counter());
        let outcomes = runs.into_iter().map(step).collect::<Result<Vec<_>, _>>();
        progress.finish();
        let outcomes = outcomes?;
        if self.json { self.print_json(&model, &outcomes) } else { self.print(&model, &outcomes) }
    }

    fn step(
        &self,
        model: &Model,
        name: &'static str,
        controls: Controls,
        done: &AtomicU64,
    ) -> Result<Outcome, Failure> {
        let first = (!model.keys().is_empty()).then_some(0);
        let mut worlds = self.run.worlds(model, 1, self.start.find(model)?.or(first))?;
        for start in (0..self.steps).step_by(STRIDE) {
            let nstep = STRIDE.min(self.steps - start);
            worlds.rollout(&Rollout { nstep, controls, progress: Some(done), ..Rollout::default() })?;
        }
        Ok(Outcome {
            controls: name,
            time: worlds.get(Field::Time, 0)?[0],
            flags: worlds.status(0)?.names(),
            events: worlds.status_detail(0)?,
        })
    }

    fn print_json(&self, model: &Model, outcomes: &[Outcome]) -> Result<(), Failure> {
        let event = |outcome: &Outcome, event: &StatusEvent| {
            let mut value = output::event(event);
            value["controls"] = outcome.controls.into();
            value
        };
        let events = outcomes.iter().flat_map(|outcome| outcome.events.iter().map(|e| event(outcome, e)));
        let run = |o: &Outcome| json!({ "controls": o.controls, "time": o.time, "flags": o.flags });
        output::json(&json!({
            "model": model.name(), "steps": self.steps, "time": outcomes.first().map(|o| o.time),
            "flags": all_flags(outcomes), "events": events.collect::<Value>(),
            "runs": outcomes.iter().map(run).collect::<Value>(), "losses": model.report().losses,
        }))
    }

    fn print(&self, model: &Model, outcomes: &[Outcome]) -> Result<(), Failure> {
        let mut rows = vec![("model", model.name().to_owned())];
        for outcome in outcomes {
            let how = match outcome.controls {
                "noise" => format!("under control noise (share {}, seed {})", self.noise, self.seed),
                _ => "with the controls of the start".to_owned(),
            };
            rows.push(("stepped", format!("{} steps to {:.4} s {how}", self.steps, outcome.time)));
            let flags = outcome.flags.join(", ");
            rows.push(("status", if flags.is_empty() { "no flags".to_owned() } else { format!("flags: {flags}") }));
            rows.extend(outcome.events.iter().map(|event| ("", event.to_string())));
        }
        output::table(&rows)
    }
}

/// The flags that any of the runs raised, each once.
fn all_flags(outcomes: &[Outcome]) -> Vec<&'static str> {
    let mut flags = Vec::new();
    for flag in outcomes.iter().flat_map(|outcome| &outcome.flags) {
        if !flags.contains(flag) {
            flags.push(*flag);
        }
    }
    flags
}
