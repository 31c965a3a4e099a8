//! `lanesim check`: does a model load, and does it stay finite?

use clap::Args;
use serde_json::json;

use super::engine::{self, Batch, Controls, Setup};
use super::failure::Failure;
use super::rollout::reset;
use super::{ModelArgs, RunArgs, count, output};

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
        let loaded = engine::load(&self.model)?;
        output::notes("left out", &loaded.losses);
        let model = &loaded.model;
        let mut batch = Batch::new(model, 1, &Setup::from(&self.run))?;
        if let Some(key) = model.key(0) {
            reset(&mut batch, &key)?;
        }
        let bar = output::progress("checking", self.steps as u64, self.json);
        batch.run(self.steps, Controls::Hold, &[], &|done| bar.set_position(done))?;
        bar.finish_and_clear();
        let flags = batch.flags(0);
        let time = batch.get("time", 0)[0];
        if self.json {
            return output::json(&json!({
                "model": model.name(), "steps": self.steps, "time": time, "flags": flags, "losses": loaded.losses,
            }));
        }
        let verdict = if flags.is_empty() { "no flags".to_owned() } else { format!("flags: {}", flags.join(", ")) };
        output::table(&[
            ("model", model.name().to_owned()),
            ("stepped", format!("{} steps to {time:.4} s", self.steps)),
            ("status", verdict),
        ])
    }
}
