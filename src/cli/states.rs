//! States of which something is computed, as files have them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::{Args, ValueHint};
use lanesim::npz::{Array, Data};
use lanesim::{Field, Model};

use super::InputArgs;
use super::arrays::{Dim, Inputs};
use super::engine::size;
use super::eval::{leading, shape};
use super::failure::Failure;

/// Where states are.
#[derive(Args)]
pub struct StateArgs {
    /// File with states: arrays qpos and qvel, and others that the command reads
    #[arg(long, visible_alias = "input", value_name = "S.npz", value_hint = ValueHint::FilePath)]
    pub states: PathBuf,
    #[command(flatten)]
    pub limit: InputArgs,
}

impl StateArgs {
    /// The number of states, and their arrays, of which those that are `required` must be there.
    pub fn read(
        &self,
        model: &Model,
        known: &[(&'static str, bool)],
    ) -> Result<(usize, BTreeMap<String, Array>), Failure> {
        let mut inputs = Inputs::read(&self.states, self.limit.input_limit)?;
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).chain(["time"]).collect();
        inputs.check_names(&names)?;
        // A rollout writes it, and nothing that is computed here depends on it.
        inputs.drop("time");
        let (states, leading) = leading(&inputs, model)?;
        let mut arrays = BTreeMap::new();
        for (name, required) in known {
            let own = Field::named(name).map_or(vec![Dim("", size(model, "nv"))], |field| shape(field, model));
            let width: usize = own.iter().map(|dim| dim.1).product();
            let expected: Vec<Dim> = leading.iter().copied().chain(own.into_iter().map(|dim| Dim("", dim.1))).collect();
            let Some(values) = inputs.take(name, &expected)? else {
                if *required && width > 0 {
                    let required: Vec<_> = known.iter().filter(|known| known.1).map(|known| known.0).collect();
                    let (last, others) = required.split_last().map_or(("", &[][..]), |(last, others)| (*last, others));
                    return Err(Failure::file(
                        &self.states,
                        format!("has no array `{name}`; give {} and {last}", others.join(", ")),
                    ));
                }
                continue;
            };
            let shape = expected.iter().map(|dim| dim.1).collect();
            arrays.extend(Array::new(shape, Data::F64(values)).map(|array| ((*name).to_owned(), array)));
        }
        Ok((states, arrays))
    }
}
