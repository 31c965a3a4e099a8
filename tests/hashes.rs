//! Hashes of the states after short runs, so that a changed bit is seen. A change that is meant is explained in the CHANGELOG,
//! and the new hashes are written by `WRITE_HASHES=1 cargo test --profile ci --test hashes`.

use std::fmt::Write as _;

use crate::support::{load_with, options, repository};
use lanesim::{Backend, Controls, Precision, Rollout, Worlds};

const FILE: &str = "tests/goldens/hashes.txt";
/// Two blocks in double precision, one and a part of one in single.
const WORLDS: usize = 16;
const STEPS: usize = 60;

/// Models with every kind of joint, contact and row, and the options that they run with.
const RUNS: &[(&str, &[(&str, &str)])] = &[
    ("zoo/ant", &[]),
    ("zoo/arm", &[]),
    ("zoo/balls_in_box", &[("cone", "elliptic")]),
    ("zoo/box_stack", &[]),
    ("zoo/capsule_pile", &[("cone", "elliptic")]),
    ("zoo/cartpole", &[]),
    ("zoo/chain31", &[]),
    ("zoo/hand32", &[]),
    ("zoo/hopper", &[("solver", "CG")]),
    ("zoo/humanoid27", &[]),
    ("zoo/quadruped", &[("solver", "PGS")]),
    ("zoo/walker", &[("noslip_iterations", "3")]),
];

fn hash(name: &str, overrides: &[(&str, &str)], precision: Precision) -> u64 {
    let model = load_with(name, overrides);
    let mut worlds = Worlds::new(&model, WORLDS, &options(precision, Backend::Auto)).expect("a batch");
    let controls = Controls::Noise { seed: 11, scale: 1.0 };
    worlds.rollout(&Rollout { nstep: STEPS, controls, ..Rollout::default() }).expect("a rollout");
    worlds.state_hash()
}

#[test]
fn states_after_short_runs_keep_their_bits() {
    let mut now = String::new();
    for (name, overrides) in RUNS {
        for (precision, word) in [(Precision::F32, "f32"), (Precision::F64, "f64")] {
            let options: Vec<String> = overrides.iter().map(|(k, v)| format!("{k}={v} ")).collect();
            let hash = hash(name, overrides, precision);
            writeln!(now, "{name} {}{word} {hash:016x}", options.concat()).expect("text");
        }
    }
    if std::env::var_os("WRITE_HASHES").is_some() {
        std::fs::write(repository(FILE), &now).expect("written");
    }
    let recorded = std::fs::read_to_string(repository(FILE)).unwrap_or_default();
    let changed: Vec<&str> = now.lines().filter(|line| !recorded.lines().any(|old| old == *line)).collect();
    assert!(
        changed.is_empty(),
        "changed bits; explain them in the CHANGELOG and write the hashes anew (see {}):\n{}",
        file!(),
        changed.join("\n")
    );
}
