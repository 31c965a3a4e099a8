//! The gradient of a cost by finite differences: all perturbed rollouts are the worlds of one batch.
//!
//! `cargo run --release --example gradient`

use lanesim::outputs::Output;
use lanesim::{Controls, Error, Field, Model, Options, Rollout, Worlds};

/// Steps of a rollout.
const STEPS: usize = 100;
/// Size of a perturbation.
const SMALL: f64 = 1e-4;

fn main() -> Result<(), Error> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/zoo/cartpole.xml");
    let model = Model::from_xml_path(path.as_ref(), &Default::default())?;
    // One control per step: world 0 is unperturbed, world 1 + t has that of step t increased.
    let nworld = 1 + STEPS;
    let nu = Field::Ctrl.len(&model);
    let mut worlds = Worlds::new(&model, nworld, &Options::default())?;
    let mut plan = vec![0.1; nworld * STEPS * nu];
    for t in 0..STEPS {
        plan[((1 + t) * STEPS + t) * nu] += SMALL;
    }
    let outputs = [Output::named("qpos")?];
    let rollout = Rollout { nstep: STEPS, controls: Controls::Given(&plan), outputs: &outputs, ..Rollout::default() };
    let trajectories = worlds.rollout(&rollout)?;

    let nq = Field::Qpos.len(&model);
    let last = |world: usize| &trajectories.outputs[0][(world * STEPS + STEPS - 1) * nq..][..nq];
    let cost = |world: usize| last(world).iter().map(|q| q * q).sum::<f64>();
    let gradient: Vec<f64> = (0..STEPS).map(|t| (cost(1 + t) - cost(0)) / SMALL).collect();
    println!("cost {:.6}", cost(0));
    println!("slope by the first control {:.6}, by the last {:.6}", gradient[0], gradient[STEPS - 1]);
    Ok(())
}
