//! `lanesim info`: what a model is.

use std::time::Instant;

use clap::Args;
use lanesim::plan::{Part, Plan};
use lanesim::{CodePart, Model, Worlds, suggest};
use serde_json::{Map, Value, json};

use super::engine::{self, Loaded};
use super::failure::Failure;
use super::{ModelArgs, RunArgs, output};

const EXAMPLES: &str = "\
Examples:
  lanesim info models/zoo/ant.xml
  lanesim info models/zoo/ant.xml --json --option timestep=0.001
  lanesim info models/zoo/ant.xml --outputs energy          # what a run that records the energy computes
  lanesim info models/zoo/ant.xml --native --precision f32
  lanesim info models/zoo/ant.xml --disassembly smooth";

/// Arguments of `info`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Info {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// Quantities that a rollout would record: what they need is part of what runs
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "qpos,qvel")]
    outputs: Vec<String>,
    /// Print what the machine code made for the model consists of
    #[arg(long)]
    native: bool,
    /// Print the instructions of one part of the machine code, such as smooth, and nothing else
    #[arg(long, value_name = "PART")]
    disassembly: Option<String>,
    /// Print one JSON object; sizes have MuJoCo's names
    #[arg(long)]
    json: bool,
}

impl Info {
    /// Prints sizes, memory, options and what was left out.
    pub fn run(self) -> Result<(), Failure> {
        let names = engine::unique(&self.outputs)?;
        let Loaded { model, seconds, .. } = engine::load(&self.model)?;
        let outputs = engine::outputs(&model, &names)?;
        let memory = Worlds::memory_of(&model, &self.run.options(None));
        if let Some(part) = &self.disassembly {
            return disassembly(&self.code(&model)?, part);
        }
        let first_step = self.first_step(&model, seconds).ok();
        let code = if self.native { Some(self.code(&model)?) } else { None };
        let parts = Plan::step(&outputs).parts(&model);
        if self.json {
            return output::json(&json_of(&model, memory, (seconds, first_step), &parts, code.as_deref()));
        }
        output::notes("left out", &model.report().losses);
        output::notes("note", &model.report().notes);
        let options = &model.tables().options;
        let mut rows = vec![("model", model.name().to_owned())];
        rows.extend(model.sizes().iter().map(|(name, n)| (*name, n.to_string())));
        rows.push(("bytes per world", memory.0.to_string()));
        rows.push(("scratch bytes per thread", memory.1.to_string()));
        rows.push(("timestep", format!("{} s", options.timestep)));
        rows.push(("integrator", options.integrator.to_string()));
        if options.guard {
            rows.push(("guard", format!("of {} trees", model.tables().sizes.nguard)));
        }
        rows.push(("cone", format!("{:?}", options.cone)));
        rows.push(("solver", format!("{:?}", options.solver)));
        rows.push(("loaded in", milliseconds(seconds)));
        rows.push((
            "first step after",
            first_step.map_or_else(|| "none is possible; `lanesim check` says why".into(), milliseconds),
        ));
        output::table(&rows)?;
        let line =
            |part: &Part| (part.name, format!("{} {}", if part.runs { "runs:" } else { "left out:" }, part.what));
        output::table(
            &[vec![("", String::new()), ("a step", String::new())], parts.iter().map(line).collect()].concat(),
        )?;
        code.map_or(Ok(()), |code| output::table(&code_rows(&code)))
    }

    /// Seconds from the start of loading, which took `load_seconds`, to the end of a world's first step: what a user waits for.
    fn first_step(&self, model: &Model, load_seconds: f64) -> Result<f64, Failure> {
        let start = Instant::now();
        self.run.worlds(model, 1, None)?.step(1)?;
        Ok(load_seconds + start.elapsed().as_secs_f64())
    }

    /// The machine code, or an error that says why there is none.
    fn code(&self, model: &Model) -> Result<Vec<CodePart>, Failure> {
        let worlds = self.run.worlds(model, 1, None)?;
        match (&worlds.running().notice, worlds.running().instructions) {
            (Some(notice), _) => Err(Failure::Input(notice.clone())),
            (None, None) => Err(Failure::Usage("this backend makes no machine code; leave out --backend".into())),
            (None, Some(_)) => Ok(worlds.code()),
        }
    }
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.1} ms", seconds * 1e3)
}

/// Prints the instructions of one part.
fn disassembly(code: &[CodePart], name: &str) -> Result<(), Failure> {
    let part = code.iter().find(|part| part.name == name);
    let part = part.ok_or_else(|| {
        let remedy = suggest::or_list(name, code.iter().map(|part| &*part.name));
        let remedy = if remedy.is_empty() { "`lanesim info --native` lists them" } else { &remedy };
        Failure::Usage(format!("there is no part {name}; {remedy}"))
    })?;
    let text = part.disassembly.as_ref();
    output::text(text.ok_or_else(|| {
        Failure::Input(format!("{name} is left to the kernels: no code is made for it, or it would be too large"))
    })?)
}

/// Rows of a table: each part of the code and its figures.
fn code_rows(code: &[CodePart]) -> Vec<(&str, String)> {
    let figures = |part: &CodePart| match &part.statistics {
        None => "left to the kernels: no code is made for it, or it would be too large".to_owned(),
        Some(s) => format!(
            "{:>6} operations {:>6} instructions {:>5} spills {:>6} reloads {:>5} stores {:>7} bytes {:>5.2} ms",
            s.total_operations(),
            s.instructions,
            s.spills,
            s.reloads,
            s.stores,
            s.bytes,
            s.compile_time.as_secs_f64() * 1e3
        ),
    };
    let set = code.iter().find_map(|part| part.statistics.as_ref()).map_or("", |s| s.isa.name());
    let title = vec![("", String::new()), ("machine code", set.to_owned())];
    title.into_iter().chain(code.iter().map(|part| (&*part.name, figures(part)))).collect()
}

/// The same as JSON.
fn code_json(code: &[CodePart]) -> Value {
    let part = |part: &CodePart| match &part.statistics {
        None => json!({ "part": part.name }),
        Some(s) => json!({
            "part": part.name,
            "isa": s.isa.name(),
            "operations": s.total_operations(),
            "instructions": s.instructions,
            "spills": s.spills,
            "reloads": s.reloads,
            "stores": s.stores,
            "bytes": s.bytes,
            "compile_seconds": s.compile_time.as_secs_f64(),
        }),
    };
    code.iter().map(part).collect()
}

fn json_of(
    model: &Model,
    memory: (usize, usize),
    (load, first_step): (f64, Option<f64>),
    parts: &[Part],
    code: Option<&[CodePart]>,
) -> Value {
    let mut out = Map::new();
    out.insert("model".into(), model.name().into());
    out.extend(model.sizes().iter().map(|(name, n)| ((*name).to_owned(), Value::from(*n))));
    out.insert("bytes_per_world".into(), memory.0.into());
    out.insert("scratch_bytes_per_thread".into(), memory.1.into());
    out.insert("timestep".into(), model.tables().options.timestep.into());
    out.insert("load_seconds".into(), load.into());
    out.insert("first_step_seconds".into(), first_step.into());
    let part = |part: &Part| json!({ "stage": part.name.trim(), "runs": part.runs, "what": part.what });
    out.insert("plan".into(), parts.iter().map(part).collect());
    if let Some(code) = code {
        out.insert("native".into(), code_json(code));
    }
    out.insert("losses".into(), json!(model.report().losses));
    out.insert("notes".into(), json!(model.report().notes));
    Value::Object(out)
}
