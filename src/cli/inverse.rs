//! `lanesim inverse`: the forces behind a motion.

use clap::Args;

use super::destination::Destination;
use super::engine::{self, Loaded, size};
use super::failure::Failure;
use super::states::StateArgs;
use super::{ModelArgs, RunArgs, memory, output};

const EXAMPLES: &str = "\
Examples:
  lanesim inverse arm.xml --states motion.npz -o forces.npz
  lanesim inverse arm.xml --states motion.npz -o forces.npz --option integrator=implicitfast --option invdiscrete=enable

motion.npz holds qpos [N, nq], qvel [N, nv] and qacc [N, nv], and may hold time [N], act [N, na], ctrl [N, nu], eq_active [N, neq],
mocap_pos [N, nmocap, 3] and mocap_quat [N, nmocap, 4]; or all of them with [nworld, nstep, ...] in place of [N, ...]. The result
is `qfrc_inverse` [N, nv] or [nworld, nstep, nv]: the generalised force, N or N m, that must come from actuators and from outside. With the flag invdiscrete, qacc is what qvel gains over a step, divided by the time step.";

/// Arguments of `inverse`.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Inverse {
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    run: RunArgs,
    #[command(flatten)]
    states: StateArgs,
    #[command(flatten)]
    output: Destination,
}

impl Inverse {
    /// Checks everything, then computes, then writes.
    pub fn run(self) -> Result<(), Failure> {
        self.output.check([&self.model.model, &self.states.states])?;
        let Loaded { model, .. } = engine::load(&self.model)?;
        output::losses(&model);
        let known: Vec<_> = lanesim::inverse::inputs().collect();
        let (count, inputs) = self.states.read(&model, &known)?;
        memory::check("the forces", &[count, size(&model, "nv"), size_of::<f64>()], self.run.max_memory)?;
        let forces = lanesim::inverse::inverse(&model, &inputs, &self.run.options(None))?;
        self.output.write(&[("qfrc_inverse".to_owned(), forces)])
    }
}
