//! Laws of mechanics on random trees.

use lanesim::model::ArrayData;
use lanesim::{Backend, Model, Precision};
use proptest::prelude::{TestCaseError, prop_assert, prop_assert_eq, prop_assume, proptest};

use super::recipe::{TreeRecipe, integrate, product, tree};
use super::{State, config, dot, evaluate, minus, norm, times, worlds};
use crate::support::{Random, agree, options};

/// Worlds per model: two blocks in double precision, the second with padding.
const WORLDS: usize = 11;
/// Step of central differences: their error is its square times third derivatives, which reach 1e3 with nine bodies and
/// three joints each.
const H: f64 = 1e-6;
/// What remains of that, and of rounding divided by the step.
const DIFFERENCES: f64 = 1e-6;
/// Rounding through an inertia matrix of condition up to 1e6.
const SOLVED: f64 = 1e-9;
/// Sums over the tree.
const SUMS: f64 = 1e-11;

/// The recipe's model, or none if nothing in it moves, with states.
fn moving(recipe: &TreeRecipe) -> Result<(Model, Vec<State>), TestCaseError> {
    let model = recipe.model();
    prop_assume!(model.tables().sizes.nv > 0);
    let mut random = Random(recipe.seed);
    let states = (0..WORLDS).map(|_| State::random(&model, 2.0, 0.5, 1.0, &mut random)).collect();
    Ok((model, states))
}

fn exact(model: &Model, states: &[State], fields: &[&str]) -> Vec<Vec<Vec<f64>>> {
    evaluate(model, states, fields, &options(Precision::F64, Backend::Wide))
}

fn array(model: &Model, name: &str) -> Vec<f64> {
    match model.array(name).map(|array| &array.data) {
        Some(ArrayData::F64(x)) => x.clone(),
        _ => panic!("there is no array {name}"),
    }
}

fn close(what: &str, got: &[f64], expected: &[f64], tolerance: f64, floor: f64) -> Result<(), TestCaseError> {
    agree(got, expected, tolerance, floor).map(|_| ()).map_err(|e| TestCaseError::fail(format!("{what}{e}")))
}

/// Cholesky's pivots of a dense matrix.
fn pivots(mut m: Vec<f64>, n: usize) -> Vec<f64> {
    for k in 0..n {
        for i in k + 1..n {
            let l = m[i * n + k] / m[k * n + k];
            (k..n).for_each(|j| m[i * n + j] -= l * m[k * n + j]);
        }
    }
    (0..n).map(|k| m[k * n + k]).collect()
}

proptest! {
    #![proptest_config(config(100))]

    #[test]
    fn inertia_is_symmetric_and_positive(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let nv = model.tables().sizes.nv;
        for fields in exact(&model, &states, &["qM"]) {
            let m = &fields[0];
            for (i, j) in (0..nv).flat_map(|i| (0..i).map(move |j| (i, j))) {
                prop_assert_eq!(m[i * nv + j], m[j * nv + i]);
            }
            let least = pivots(m.clone(), nv).into_iter().fold(f64::INFINITY, f64::min);
            prop_assert!(least > 0.0, "pivot {least}");
        }
    }

    /// Forces, the factor and its solution belong together: M (a(τ) - a(0)) = τ and M a = smooth force.
    #[test]
    fn accelerations_solve_the_equation_of_motion(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let free: Vec<State> =
            states.iter().map(|s| State { qfrc_applied: vec![0.0; s.qvel.len()], ..s.clone() }).collect();
        let with = exact(&model, &states, &["qM", "qacc_smooth", "qfrc_smooth"]);
        let without = exact(&model, &free, &["qacc_smooth"]);
        for ((with, without), state) in with.iter().zip(&without).zip(&states) {
            let size = norm(&times(&with[0].iter().map(|x| x.abs()).collect::<Vec<_>>(), &with[1]));
            close("force", &times(&with[0], &minus(&with[1], &without[0])), &state.qfrc_applied, SOLVED, size)?;
            close("residual", &times(&with[0], &with[1]), &with[2], SOLVED, size)?;
        }
    }

    /// ½ vᵀMv and the height of the centres of mass, against every body's own motion.
    #[test]
    fn energy_is_the_sum_over_bodies(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let (mass, inertia, gravity) = (array(&model, "body_mass"), array(&model, "body_inertia"), [0.0, 0.0, -9.81]);
        let armature = array(&model, "dof_armature");
        let fields = ["energy", "qM", "xvel", "xpos", "xipos", "ximat"];
        for (found, state) in exact(&model, &states, &fields).iter().zip(&states) {
            let [energy, m, xvel, xpos, xipos, ximat] = found.as_slice() else { panic!("six fields") };
            let v = &state.qvel;
            let (mut potential, mut kinetic) = (0.0, 0.0);
            for b in 1..mass.len() {
                let (w, u) = xvel[6 * b..6 * b + 6].split_at(3);
                let r = minus(&xipos[3 * b..3 * b + 3], &xpos[3 * b..3 * b + 3]);
                let at = [0, 1, 2].map(|k| {
                    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                    u[k] + w[i] * r[j] - w[j] * r[i]
                });
                let turn = [0, 1, 2].map(|k| (0..3).map(|i| ximat[9 * b + 3 * i + k] * w[i]).sum::<f64>());
                kinetic += 0.5 * mass[b] * dot(&at, &at);
                kinetic += (0..3).map(|k| 0.5 * inertia[3 * b + k] * turn[k] * turn[k]).sum::<f64>();
                potential -= mass[b] * dot(&gravity, &xipos[3 * b..3 * b + 3]);
            }
            kinetic += (0..v.len()).map(|i| 0.5 * armature[i] * v[i] * v[i]).sum::<f64>();
            close("energy", energy, &[potential, kinetic], SUMS, 1.0)?;
            close("vᵀMv", &[0.5 * dot(v, &times(m, v))], &[kinetic], SUMS, 1.0)?;
        }
    }

    /// Along a motion of acceleration a, energy changes at the power of the applied force: this ties the bias force (Coriolis,
    /// gravity) to the inertia matrix, which come from different recursions.
    #[test]
    fn energy_changes_by_the_work_of_forces(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let now = exact(&model, &states, &["qacc_smooth", "energy"]);
        let moved = |h: f64| -> Vec<State> {
            let along = |(state, found): (&State, &Vec<Vec<f64>>)| {
                let qvel: Vec<f64> = state.qvel.iter().zip(&found[0]).map(|(v, a)| v + h * a).collect();
                State { qpos: integrate(&model, &state.qpos, &state.qvel, h), qvel, ..state.clone() }
            };
            states.iter().zip(&now).map(along).collect()
        };
        let (after, before) = (exact(&model, &moved(H), &["energy"]), exact(&model, &moved(-H), &["energy"]));
        for (i, state) in states.iter().enumerate() {
            let total = |found: &[Vec<Vec<f64>>]| found[i].last().map_or(f64::NAN, |energy| energy.iter().sum::<f64>());
            let rate = (total(&after) - total(&before)) / (2.0 * H);
            // Large energies and accelerations that cancel in the sum leave their rounding.
            let size = norm(&now[i][0]) + norm(&now[i][1]) + 1.0;
            close("power", &[rate], &[dot(&state.qfrc_applied, &state.qvel)], 10.0 * DIFFERENCES, size)?;
        }
    }

    /// Velocities of bodies are the rates of their poses.
    #[test]
    fn velocities_are_rates_of_poses(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let shifted = |h: f64| -> Vec<State> {
            let along = |s: &State| State { qpos: integrate(&model, &s.qpos, &s.qvel, h), ..s.clone() };
            states.iter().map(along).collect()
        };
        let fields = ["xpos", "xquat"];
        let (after, before) = (exact(&model, &shifted(H), &fields), exact(&model, &shifted(-H), &fields));
        for (i, found) in exact(&model, &states, &["xvel"]).iter().enumerate() {
            let rates = |b: usize| {
                let quat = |pose: &[Vec<f64>]| -> [f64; 4] { std::array::from_fn(|k| pose[1][4 * b + k]) };
                let old = quat(&before[i]);
                let turn = product(&quat(&after[i]), &[old[0], -old[1], -old[2], -old[3]]);
                // Half the rotation vector of 2h, whichever sign the quaternions have.
                let w = [1, 2, 3].map(|k| turn[k] * turn[0].signum() / H);
                let u = [0, 1, 2].map(|k| (after[i][0][3 * b + k] - before[i][0][3 * b + k]) / (2.0 * H));
                [w, u].concat()
            };
            let expected: Vec<f64> = (0..found[0].len() / 6).flat_map(rates).collect();
            close("xvel", &found[0], &expected, DIFFERENCES, 1.0)?;
        }
    }

    /// Single precision rounds, and that is all.
    #[test]
    fn single_precision_is_near(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        let fields = ["xpos", "xmat", "qM", "qfrc_bias", "xvel"];
        let double = exact(&model, &states, &fields);
        let single = evaluate(&model, &states, &fields, &options(Precision::F32, Backend::Wide));
        for (double, single) in double.iter().zip(&single) {
            for (name, (double, single)) in fields.iter().zip(double.iter().zip(single)) {
                close(name, single, double, 2e-5, 1.0)?;
            }
        }
    }

    #[test]
    fn lanes_and_scalars_give_the_same_bits(recipe in tree()) {
        let (model, states) = moving(&recipe)?;
        for precision in [Precision::F32, Precision::F64] {
            let hash = |backend| {
                let mut worlds = worlds(&model, &states, &options(precision, backend));
                worlds.step(5).map(|()| worlds.state_hash()).map_err(|e| TestCaseError::fail(e.to_string()))
            };
            prop_assert_eq!(hash(Backend::Wide)?, hash(Backend::Scalar)?);
        }
    }
}
