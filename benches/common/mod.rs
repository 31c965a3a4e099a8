//! What the benches share: models of the zoo, and worlds in typical states.
#![allow(dead_code)] // every bench uses its own part

use std::path::Path;
use std::time::Duration;

use criterion::Criterion;
use lanesim::mjcf::LoadOptions;
use lanesim::{Backend, Controls, Field, Model, Options, Precision, Rollout, Worlds};

/// Steps under control noise after which a state is typical.
const SETTLE: usize = 500;
/// Worlds that are settled; the others are copies.
const BASES: usize = 32;

/// What costs what: contacts of feet, contacts between limbs, a planar body, depth, no coupling, many contacts.
pub const MODELS: [&str; 6] = ["humanoid18", "humanoid27", "hopper", "chain31", "isolated34", "balls_in_box"];

/// The two number types, by name.
pub const PRECISIONS: [(Precision, &str); 2] = [(Precision::F32, "f32"), (Precision::F64, "f64")];

/// Short runs: differences of a few percent show, and a whole bench takes about a minute.
pub fn criterion() -> Criterion {
    Criterion::default()
        .without_plots()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args()
}

/// A model of the zoo.
pub fn load(name: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/zoo").join(format!("{name}.xml"));
    Model::from_xml_path(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// Controls that are redrawn at every step.
pub fn noise() -> Rollout<'static> {
    Rollout { nstep: 1, controls: Controls::Noise { seed: 1, scale: 1.0 }, ..Rollout::default() }
}

/// Worlds that have been under control noise for a while.
pub fn settled(model: &Model, nworld: usize, precision: Precision, threads: usize) -> Worlds {
    let options = Options { precision, backend: Backend::Auto, threads: Some(threads), ..Options::default() };
    let new = |n: usize| Worlds::new(model, n, &options).unwrap_or_else(|e| panic!("{e}"));
    let (mut bases, mut worlds) = (new(BASES), new(nworld));
    run(
        &mut bases,
        &Rollout { nstep: SETTLE, controls: Controls::Noise { seed: 2, scale: 1.0 }, ..Rollout::default() },
    );
    for world in 0..nworld {
        for field in [Field::Qpos, Field::Qvel, Field::QaccWarmstart] {
            let values = bases.get(field, world % BASES).unwrap_or_else(|e| panic!("{e}"));
            worlds.set(field, world, &values).unwrap_or_else(|e| panic!("{e}"));
        }
    }
    worlds
}

/// Runs and hands out what the run recorded.
pub fn run(worlds: &mut Worlds, rollout: &Rollout<'_>) -> lanesim::Trajectories {
    worlds.rollout(rollout).unwrap_or_else(|e| panic!("{e}"))
}
