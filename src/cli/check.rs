//! `lanesim check`: does a model load, and does it stay finite?

use clap::Args;
use lanesim::{Field, Rollout};
use serde_json::json;

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::output::{self, Progress};
use super::{ModelArgs, RunArgs, count};

/// Steps between two looks at the progress bar.
const STRIDE: usize = 1000;

/// Arguments of `check`.
#[derive(Args)]
pub struct Check {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Steps to take, from keyframe 0 if there is one, with its controls
    #[arg(long, value_name = "N", default_value = "100", value_parser = count)]
    steps: usize,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Check {
    /// Compiles and steps one world. Raised flags are reported, they are not a failure.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let mut worlds = self.run.worlds(&model, 1, (!model.keys().is_empty()).then_some(0))?;
        let progress = Progress::new("checking", self.steps as u64, self.json);
        for start in (0..self.steps).step_by(STRIDE) {
            let nstep = STRIDE.min(self.steps - start);
            worlds.rollout(&Rollout { nstep, progress: Some(progress.counter()), ..Rollout::default() })?;
        }
        progress.finish();
        let (flags, events) = (worlds.status(0)?.names(), worlds.status_detail(0)?);
        let time = worlds.get(Field::Time, 0)?[0];
        if self.json {
            return output::json(&json!({
                "model": model.name(), "steps": self.steps, "time": time, "flags": flags,
                "events": events.iter().map(output::event).collect::<Vec<_>>(),
                "losses": model.report().losses,
            }));
        }
        let verdict = if flags.is_empty() { "no flags".to_owned() } else { format!("flags: {}", flags.join(", ")) };
        let mut rows = vec![
            ("model", model.name().to_owned()),
            ("stepped", format!("{} steps to {time:.4} s", self.steps)),
            ("status", verdict),
        ];
        rows.extend(events.iter().map(|event| ("", event.to_string())));
        output::table(&rows)
    }
}
