//! `lanesim info`: what a model is.

use clap::Args;
use serde_json::{Map, Value, json};

use super::engine::{self, Batch, Setup};
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
        let loaded = engine::load(&self.model)?;
        let model = &loaded.model;
        let bytes = Batch::new(model, 1, &Setup::from(&self.run))?.bytes_per_world();
        let options = model.options();
        if self.json {
            let mut out = Map::new();
            out.insert("model".into(), model.name().into());
            for (name, n) in model.sizes() {
                out.insert(name.into(), n.into());
            }
            out.insert("bytes_per_world".into(), bytes.into());
            out.insert("timestep".into(), options.timestep.into());
            out.insert("load_seconds".into(), loaded.seconds.into());
            out.insert("losses".into(), json!(loaded.losses));
            out.insert("notes".into(), json!(loaded.notes));
            return output::json(&Value::Object(out));
        }
        output::notes("left out", &loaded.losses);
        output::notes("note", &loaded.notes);
        let mut rows = vec![("model", model.name().to_owned())];
        rows.extend(model.sizes().into_iter().map(|(name, n)| (name, n.to_string())));
        rows.push(("bytes per world", bytes.to_string()));
        rows.push(("timestep", format!("{} s", options.timestep)));
        rows.push(("integrator", format!("{:?}", options.integrator)));
        rows.push(("cone", format!("{:?}", options.cone)));
        rows.push(("solver", format!("{:?}", options.solver)));
        rows.push(("loaded in", format!("{:.1} ms", loaded.seconds * 1e3)));
        output::table(&rows)
    }
}
