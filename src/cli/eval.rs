//! `lanesim eval`: named quantities at given states.

use std::path::PathBuf;

use clap::{Args, ValueHint};
use lanesim::npz::{self, Array};

use super::arrays::{Dim, Inputs};
use super::engine::{self, Batch, Controls, Model, Setup};
use super::failure::Failure;
use super::rollout::set_all;
use super::{ModelArgs, RunArgs, output};

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

/// What a state file may hold: name, size that must not be zero, shape after N.
fn known(model: &Model) -> [(&'static str, Vec<Dim>); 10] {
    let dim = |name| Dim(name, model.size(name));
    [
        ("time", vec![]),
        ("qpos", vec![dim("nq")]),
        ("qvel", vec![dim("nv")]),
        ("act", vec![dim("na")]),
        ("ctrl", vec![dim("nu")]),
        ("qfrc_applied", vec![dim("nv")]),
        ("xfrc_applied", vec![dim("nbody"), Dim("", 6)]),
        ("mocap_pos", vec![dim("nmocap"), Dim("", 3)]),
        ("mocap_quat", vec![dim("nmocap"), Dim("", 4)]),
        ("qacc_warmstart", vec![dim("nv")]),
    ]
}

impl Eval {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        let loaded = engine::load(&self.model)?;
        output::notes("left out", &loaded.losses);
        let model = &loaded.model;
        let (n, states) = self.states(model)?;
        let mut batch = Batch::new(model, n, &Setup::from(&self.run))?;
        for (name, values) in &states {
            set_all(&mut batch, name, values, n)?;
        }
        let (once, fields): (Vec<String>, Vec<String>) =
            self.fields.iter().cloned().partition(|f| model.array(f).is_some());
        if self.nstep > 0 {
            batch.run(self.nstep as usize, Controls::Hold, &[], &|_| ())?;
        }
        let mut arrays: Vec<(String, Array)> =
            once.into_iter().filter_map(|name| model.array(&name).map(|a| (name, a))).collect();
        arrays.extend(fields.iter().cloned().zip(batch.forward(&fields)?));
        npz::write(&self.output, &arrays).map_err(|e| Failure::file(&self.output, e))
    }

    /// The number of states, and their arrays.
    fn states(&self, model: &Model) -> Result<(usize, Vec<(&'static str, Vec<f64>)>), Failure> {
        let mut inputs = Inputs::read(&self.input)?;
        let known = known(model);
        let n = match inputs.names().next() {
            None => 1,
            Some(name) => match inputs.shape(name).and_then(<[usize]>::first) {
                Some(&n) if n > 0 => n,
                _ => return Err(inputs.error(name, "has no leading dimension N > 0, the number of states")),
            },
        };
        let mut states = Vec::new();
        for (name, rest) in &known {
            let shape: Vec<Dim> = std::iter::once(Dim("N", n)).chain(rest.iter().copied()).collect();
            states.extend(inputs.take(name, &shape)?.map(|values| (*name, values)));
        }
        inputs.finish(&known.map(|(name, _)| name))?;
        Ok((n, states))
    }
}
