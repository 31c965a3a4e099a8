//! `lanesim eval`: named quantities at given states.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::{Args, ValueHint};
use lanesim::npz::{self, Array};
use lanesim::outputs::Output;
use lanesim::{Field, Model};

use super::arrays::{Dim, Inputs};
use super::engine::{self, Loaded, size};
use super::failure::Failure;
use super::{ModelArgs, RunArgs, memory, output};

const EXAMPLES: &str = "\
Examples:
  lanesim eval ant.xml --input states.npz --output out.npz --fields xpos,qM,qacc
  lanesim eval ant.xml --input states.npz --output out.npz --fields qpos,qvel --nstep 10

states.npz holds any of qpos [N, nq], qvel [N, nv], ctrl [N, nu], qfrc_applied [N, nv], xfrc_applied [N, nbody, 6]; what is
missing is zero (qpos: the reference configuration), and an empty archive means N = 1. Results have a leading N; quantities
of the model itself, such as body_mass, come once. Contacts and constraint rows are padded: ncon and nefc count them.";

/// Arguments of `eval`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Eval {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    /// File with the states
    #[arg(long, value_name = "IN.npz", value_hint = ValueHint::FilePath)]
    input: PathBuf,
    /// File to write
    #[arg(long, value_name = "OUT.npz", value_hint = ValueHint::FilePath)]
    output: PathBuf,
    /// Quantities to compute, by MuJoCo's names
    #[arg(long, value_name = "NAMES", value_delimiter = ',', required = true)]
    fields: Vec<String>,
    /// Steps to take before computing them
    #[arg(long, value_name = "K", default_value_t = 0)]
    nstep: u32,
}

/// Arrays that MuJoCo's state has and ours does not have yet: passed over, since a lenient load leaves out what they are for.
const PASSED_OVER: [&str; 3] = ["mocap_pos", "mocap_quat", "eq_active"];

/// Shape of a field after the number of states.
fn shape(field: Field, model: &Model) -> Vec<Dim> {
    let dim = |name| Dim(name, size(model, name));
    match field {
        Field::Time => vec![],
        Field::Qpos => vec![dim("nq")],
        Field::Qvel | Field::QaccWarmstart | Field::QfrcApplied => vec![dim("nv")],
        Field::Act => vec![dim("na")],
        Field::Ctrl => vec![dim("nu")],
        Field::XfrcApplied => vec![dim("nbody"), Dim("", 6)],
    }
}

impl Eval {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let (n, states) = self.states(&model)?;
        let fields: Vec<&str> = self.fields.iter().map(|name| name.trim()).collect();
        let width: usize =
            fields.iter().filter_map(|name| Output::named(name).ok()).filter_map(|output| output.width(&model)).sum();
        memory::check("the fields", &[n, width, size_of::<f64>()], self.run.max_memory)?;
        self.run.check_memory(&model, n)?;
        let arrays = lanesim::eval::eval(&model, &states, &fields, self.nstep as usize, &self.run.options())?;
        npz::write(&self.output, &arrays).map_err(|e| Failure::file(&self.output, e))
    }

    /// The number of states, and their arrays.
    fn states(&self, model: &Model) -> Result<(usize, BTreeMap<String, Array>), Failure> {
        let mut inputs = Inputs::read(&self.input)?;
        PASSED_OVER.iter().for_each(|name| inputs.drop(name));
        let n = match inputs.first() {
            None => 1,
            Some((name, shape)) => match shape.first() {
                Some(&n) if n > 0 => n,
                _ => return Err(inputs.error(name, "has no leading dimension N > 0, the number of states")),
            },
        };
        let mut states = BTreeMap::new();
        let mut known = Vec::new();
        for (field, name) in Field::ALL.into_iter().filter(|(field, _)| *field != Field::QaccWarmstart) {
            let shape: Vec<Dim> = std::iter::once(Dim("N", n)).chain(shape(field, model)).collect();
            states.extend(inputs.take(name, &shape)?.map(|values| (name.to_owned(), values)));
            known.push(name);
        }
        inputs.finish(&known)?;
        Ok((n, states))
    }
}
