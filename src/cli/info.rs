//! `lanesim info`: what a model is.

use clap::Args;
use lanesim::Model;
use lanesim::plan::{Part, Plan};
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
    /// Quantities that a rollout would record: what they need is part of what runs
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "qpos,qvel")]
    outputs: Vec<String>,
    /// Print one JSON object; sizes have MuJoCo's names
    #[arg(long)]
    json: bool,
}

impl Info {
    /// Prints sizes, memory, options and what was left out.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, seconds } = engine::load(&self.model)?;
        // A model that loads but cannot be stepped still has sizes.
        let memory = self.run.worlds(&model, 1, None).map(|w| w.memory()).ok();
        let outputs = engine::outputs(&self.outputs)?;
        let parts = Plan::step(&outputs).parts(&model);
        if self.json {
            return output::json(&json_of(&model, memory, seconds, &parts));
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
        output::table(&rows)?;
        let line =
            |part: &Part| (part.name, format!("{} {}", if part.runs { "runs:" } else { "left out:" }, part.what));
        output::table(
            &[vec![("", String::new()), ("a step", String::new())], parts.iter().map(line).collect()].concat(),
        )
    }
}

fn json_of(model: &Model, memory: Option<(usize, usize)>, seconds: f64, parts: &[Part]) -> Value {
    let mut out = Map::new();
    out.insert("model".into(), model.name().into());
    out.extend(model.sizes().iter().map(|(name, n)| ((*name).to_owned(), Value::from(*n))));
    if let Some((world, thread)) = memory {
        out.insert("bytes_per_world".into(), world.into());
        out.insert("scratch_bytes_per_thread".into(), thread.into());
    }
    out.insert("timestep".into(), model.tables().options.timestep.into());
    out.insert("load_seconds".into(), seconds.into());
    let part = |part: &Part| json!({ "stage": part.name.trim(), "runs": part.runs, "what": part.what });
    out.insert("plan".into(), parts.iter().map(part).collect());
    out.insert("losses".into(), json!(model.report().losses));
    out.insert("notes".into(), json!(model.report().notes));
    Value::Object(out)
}
