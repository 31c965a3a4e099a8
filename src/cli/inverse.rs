//! `lanesim inverse`: the forces behind a motion.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::{Args, ValueHint};
use lanesim::npz::{Array, Data};
use lanesim::{Field, Model};

use super::arrays::{Dim, Inputs};
use super::destination::Destination;
use super::engine::{self, Loaded, size};
use super::eval::leading;
use super::failure::Failure;
use super::{InputArgs, ModelArgs, RunArgs, memory, output};

const EXAMPLES: &str = "\
Examples:
  lanesim inverse arm.xml --states motion.npz -o forces.npz
  lanesim inverse arm.xml --states motion.npz -o forces.npz --option integrator=implicitfast --option invdiscrete=enable

motion.npz holds qpos [N, nq], qvel [N, nv] and qacc [N, nv], and may hold time [N], act [N, na], ctrl [N, nu] and
eq_active [N, neq]; or all of them with [nworld, nstep, ...] in place of [N, ...]. The result is `qfrc_inverse` [N, nv] or [nworld, nstep, nv]: the generalised force, N or N m, that
must come from actuators and from outside. With the flag invdiscrete, qacc is what qvel gains over a step, divided by the time step.";

/// Arguments of `inverse`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Inverse {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// File with states and accelerations: qpos, qvel, qacc, and perhaps time, act, ctrl, eq_active
    #[arg(long, visible_alias = "input", value_name = "S.npz", value_hint = ValueHint::FilePath)]
    states: PathBuf,
    #[command(flatten)]
    limit: InputArgs,
    #[command(flatten)]
    output: Destination,
}

/// Names of the arrays, and whether there must be one.
const ARRAYS: [(&str, bool); 6] =
    [("qpos", true), ("qvel", true), ("qacc", true), ("act", false), ("ctrl", false), ("eq_active", false)];

impl Inverse {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        self.output.check([&self.model.model, &self.states])?;
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let inputs = self.inputs(&model)?;
        let forces = lanesim::inverse::inverse(&model, &inputs, &self.run.options(None))?;
        self.output.write(&[("qfrc_inverse".to_owned(), forces)])
    }

    fn inputs(&self, model: &Model) -> Result<BTreeMap<String, Array>, Failure> {
        let mut inputs = Inputs::read(&self.states, self.limit.input_limit)?;
        let known: Vec<&str> = ARRAYS.iter().map(|(name, _)| *name).chain(["time"]).collect();
        inputs.check_names(&known)?;
        // A rollout writes it, and forces do not depend on it.
        inputs.drop("time");
        let (states, leading) = leading(&inputs, model)?;
        let nv = size(model, "nv");
        let mut arrays = BTreeMap::new();
        for (name, required) in ARRAYS {
            let field = Field::named(name);
            let width = field.map_or(nv, |field| field.len(model));
            let expected: Vec<Dim> = leading.iter().copied().chain([Dim("", width)]).collect();
            let Some(values) = inputs.take(name, &expected)? else {
                if required && width > 0 {
                    return Err(Failure::file(
                        &self.states,
                        format!("has no array `{name}`; give qpos, qvel and qacc"),
                    ));
                }
                continue;
            };
            let shape = expected.iter().map(|dim| dim.1).collect();
            arrays.extend(Array::new(shape, Data::F64(values)).map(|array| (name.to_owned(), array)));
        }
        memory::check("the forces", &[states, nv, size_of::<f64>()], self.run.max_memory)?;
        Ok(arrays)
    }
}
