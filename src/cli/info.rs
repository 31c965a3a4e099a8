//! `lanesim info`: what a model is.

use clap::Args;
use lanesim::Model;
use serde_json::{Map, Value, json};

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::{ModelArgs, RunArgs, output};

/// Arguments of `info`.
#[derive(Args)]
pub struct Info {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Print one JSON object; sizes have MuJoCo's names
    #[arg(long)]
    json: bool,
}

impl Info {
    /// Prints sizes, memory, options and what was left out.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, seconds } = engine::load(&self.model)?;
        // A model that loads but cannot be stepped still has sizes.
        let memory = self.run.worlds(&model, 1).map(|w| w.memory()).ok();
        if self.json {
            return output::json(&json_of(&model, memory, seconds));
        }
        output::notes("left out", &model.report().losses);
        output::notes("note", &model.report().notes);
        let options = &model.tables().options;
        let mut rows = vec![("model", model.name().to_owned())];
        rows.extend(model.sizes().iter().map(|(name, n)| (*name, n.to_string())));
        if let Some((world, thread)) = memory {
            rows.push(("bytes per world", world.to_string()));
            rows.push(("scratch bytes per thread", thread.to_string()));
        }
        rows.push(("timestep", format!("{} s", options.timestep)));
        rows.push(("integrator", format!("{:?}", options.integrator)));
        rows.push(("cone", format!("{:?}", options.cone)));
        rows.push(("solver", format!("{:?}", options.solver)));
        rows.push(("loaded in", format!("{:.1} ms", seconds * 1e3)));
        output::table(&rows)
    }
}

fn json_of(model: &Model, memory: Option<(usize, usize)>, seconds: f64) -> Value {
    let mut out = Map::new();
    out.insert("model".into(), model.name().into());
    out.extend(model.sizes().iter().map(|(name, n)| ((*name).to_owned(), Value::from(*n))));
    if let Some((world, thread)) = memory {
        out.insert("bytes_per_world".into(), world.into());
        out.insert("scratch_bytes_per_thread".into(), thread.into());
    }
    out.insert("timestep".into(), model.tables().options.timestep.into());
    out.insert("load_seconds".into(), seconds.into());
    out.insert("losses".into(), json!(model.report().losses));
    out.insert("notes".into(), json!(model.report().notes));
    Value::Object(out)
}
