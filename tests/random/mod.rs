//! Random models in random states: laws of mechanics, optimality of the solvers' answers, and bits that depend on nothing
//! but the world. Seeds are fixed: every run tests the same models. A failing model is shrunk before it is printed.

mod contacts;
mod recipe;
mod trees;

use crate::support::Random;
use lanesim::outputs::Output;
use lanesim::worlds::Field;
use lanesim::{Model, Options, Worlds};
use proptest::test_runner::{Config, RngSeed};

/// So many models, the same on every run.
fn config(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(20_26), failure_persistence: None, ..Config::default() }
}

/// Positions and velocities of a world.
#[derive(Clone, Debug)]
struct State {
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    qfrc_applied: Vec<f64>,
}

impl State {
    /// Some motion from the reference configuration, velocity and force. Rotations may be anything, translations are small.
    fn random(model: &Model, turn: f64, shift: f64, speed: f64, random: &mut Random) -> State {
        let tables = model.tables();
        let nv = tables.sizes.nv;
        let mut change = random.vector(nv, turn);
        for (change, dof) in change.iter_mut().zip(&tables.dofs) {
            use lanesim_kernels::model::DofKind::{FreeTranslation, Slide};
            if matches!(dof.kind, FreeTranslation(_) | Slide) {
                *change *= shift / turn;
            }
        }
        let qpos = recipe::integrate(model, &tables.qpos0, &change, 1.0);
        State { qpos, qvel: random.vector(nv, speed), qfrc_applied: random.vector(nv, 1.0) }
    }

    fn set(&self, worlds: &mut Worlds, world: usize) {
        let fields = [(Field::Qpos, &self.qpos), (Field::Qvel, &self.qvel), (Field::QfrcApplied, &self.qfrc_applied)];
        for (field, values) in fields {
            worlds.set(field, world, values).unwrap_or_else(|e| panic!("{e}"));
        }
    }
}

/// Worlds in the given states.
fn worlds(model: &Model, states: &[State], options: &Options) -> Worlds {
    let mut worlds = Worlds::new(model, states.len(), options).unwrap_or_else(|e| panic!("{e}"));
    for (world, state) in states.iter().enumerate() {
        state.set(&mut worlds, world);
    }
    worlds
}

/// Fields of every world, `[world][field]`, as the worlds stand.
fn forward(worlds: &mut Worlds, fields: &[&str]) -> Vec<Vec<Vec<f64>>> {
    let outputs: Vec<Output> =
        fields.iter().map(|name| Output::named(name).unwrap_or_else(|e| panic!("{e}"))).collect();
    let mut found = Vec::new();
    worlds.forward(&outputs, &mut |_, values| found.push(values)).expect("outputs");
    found
}

/// Fields of every state.
fn evaluate(model: &Model, states: &[State], fields: &[&str], options: &Options) -> Vec<Vec<Vec<f64>>> {
    forward(&mut worlds(model, states, options), fields)
}

/// Matrix times vector, the matrix row by row.
fn times(matrix: &[f64], x: &[f64]) -> Vec<f64> {
    matrix.chunks(x.len().max(1)).map(|row| dot(row, x)).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
