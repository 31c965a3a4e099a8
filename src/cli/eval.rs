//! `lanesim eval`: named quantities at given states.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::{Args, ValueHint};
use lanesim::npz::{Array, Data};
use lanesim::{Field, Model};

use super::arrays::{Dim, Inputs};
use super::destination::Destination;
use super::engine::{self, Loaded};
use super::failure::Failure;
use super::{InputArgs, KeyArgs, ModelArgs, RunArgs, memory, output, with_outputs};

const EXAMPLES: &str = "\
Examples:
  lanesim eval ant.xml --input states.npz --output out.npz --outputs xpos,qM,qacc
  lanesim eval ant.xml --input states.npz --output out.npz --outputs qpos,qvel --steps 10

states.npz holds any of time [N], qpos [N, nq], qvel [N, nv], act [N, na], ctrl [N, nu], qfrc_applied [N, nv],
xfrc_applied [N, nbody, 6]; what is missing is the keyframe's, or else zero (qpos: the reference configuration), and an empty
archive means N = 1. What `rollout` writes can be given as it is: [nworld, nstep, ...] are N = nworld * nstep states. Results have
a leading N; quantities of the model itself, such as body_mass, come once. Contacts and constraint rows are padded: ncon
and nefc count them.";

/// Arguments of `eval`.
#[derive(Args)]
#[command(after_help = EXAMPLES, after_long_help = with_outputs(EXAMPLES))]
pub struct Eval {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// File with the states: any of time, qpos, qvel, act, ctrl, qfrc_applied, xfrc_applied, one row per state
    #[arg(long, visible_alias = "states", value_name = "IN.npz", value_hint = ValueHint::FilePath)]
    input: PathBuf,
    #[command(flatten)]
    limit: InputArgs,
    #[command(flatten)]
    start: KeyArgs,
    #[command(flatten)]
    output: Destination,
    /// Quantities to compute, by MuJoCo's names: outputs, and arrays of the model such as body_mass
    #[arg(long, alias = "fields", value_name = "NAMES", value_delimiter = ',', required = true)]
    outputs: Vec<String>,
    /// Steps to take before computing them
    #[arg(long, alias = "nstep", value_name = "K", default_value_t = 0)]
    steps: u32,
}

/// Arrays that MuJoCo's state has and ours does not have yet: passed over, since a lenient load leaves out what they are for.
const PASSED_OVER: [&str; 2] = ["mocap_pos", "mocap_quat"];

/// Shape of a field after the number of states.
pub fn shape(field: Field, model: &Model) -> Vec<Dim> {
    field.shape(model).into_iter().map(|(name, count)| Dim(name, count)).collect()
}

/// The number of states, and the dimensions before a state's own: that number, or worlds and steps as a rollout writes them.
pub fn leading(inputs: &Inputs, model: &Model) -> Result<(usize, Vec<Dim>), Failure> {
    let Some((name, given)) = inputs.first() else { return Ok((1, vec![Dim("N", 1)])) };
    let field = Field::named(name);
    // An acceleration has one row, as fields have; time has none.
    let own = field.map_or(usize::from(name == "qacc"), |field| shape(field, model).len());
    let dims = match given[..given.len().saturating_sub(own)] {
        [n] => vec![Dim("N", n)],
        [nworld, nstep] => vec![Dim("nworld", nworld), Dim("nstep", nstep)],
        _ => vec![],
    };
    if dims.is_empty() || dims.iter().any(|dim| dim.1 == 0) {
        return Err(inputs.error(name, "has no leading dimension N > 0, the number of states"));
    }
    let count = dims.iter().try_fold(1_usize, |count, dim| count.checked_mul(dim.1));
    let count = count.ok_or_else(|| inputs.error(name, "has more states than can be counted"))?;
    Ok((count, dims))
}

impl Eval {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let fields = engine::unique(&self.outputs)?;
        self.output.check([&self.model.model, &self.input])?;
        let Loaded { model, includes, .. } = engine::load(&self.model)?;
        self.output.check(&includes)?;
        output::losses(&model);
        let key = self.start.find(&model)?;
        let (n, states) = self.states(&model, key)?;
        let width: usize =
            fields.iter().filter_map(|name| model.output(name).ok()).filter_map(|output| output.width(&model)).sum();
        memory::check("the fields", &[n, width, size_of::<f64>()], self.run.max_memory)?;
        self.run.check_memory(&model, n)?;
        let arrays = lanesim::eval::eval(&model, &states, &fields, self.steps as usize, &self.run.options(key))?;
        self.output.write(&arrays)
    }

    /// The number of states, and their arrays.
    fn states(&self, model: &Model, key: Option<usize>) -> Result<(usize, BTreeMap<String, Array>), Failure> {
        let mut inputs = Inputs::read(&self.input, self.limit.input_limit)?;
        PASSED_OVER.iter().for_each(|name| inputs.drop(name));
        inputs.check_names(&lanesim::eval::inputs().map(Field::name).collect::<Vec<_>>())?;
        let (n, leading) = leading(&inputs, model)?;
        let key = key.and_then(|key| model.keys().get(key));
        let mut states = BTreeMap::new();
        for field in lanesim::eval::inputs() {
            let (name, own) = (field.name(), shape(field, model));
            let expected: Vec<Dim> = leading.iter().copied().chain(own.iter().copied()).collect();
            let lengths: Vec<usize> = std::iter::once(n).chain(own.iter().map(|dim| dim.1)).collect();
            let values = match (inputs.take(name, &expected)?, key.and_then(|key| key.field(field))) {
                (Some(values), _) => values,
                (None, Some(row)) => {
                    memory::check("the states", &[n, row.len(), size_of::<f64>()], self.run.max_memory)?;
                    row.repeat(n)
                }
                (None, None) => continue,
            };
            states.extend(Array::new(lengths, Data::F64(values)).map(|array| (name.to_owned(), array)));
        }
        Ok((n, states))
    }
}
