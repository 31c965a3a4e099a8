//! Inverse dynamics: against MuJoCo, and against the forward dynamics that it inverts.

use std::collections::BTreeMap;

use crate::support;
use crate::support::golden::{Failures, Golden};
use crate::support::{NOT_DISCRETE, Random, agree, all_models, fails, load, load_with, options};
use lanesim::inverse::inverse;
use lanesim::npz::{Array, Data};
use lanesim::outputs::Output;
use lanesim::{Backend, Controls, Field, Model, Options, Precision, Rollout, Worlds};

const BACKENDS: [Backend; 3] = [Backend::Native, Backend::Wide, Backend::Scalar];
/// Models that touch the floor, and themselves.
const TOUCHING: [&str; 5] = ["zoo/ant", "zoo/hopper", "zoo/cheetah", "zoo/humanoid18", "zoo/humanoid27"];
/// Solver settings under which results are the minimiser.
const CONVERGED: [(&str, &str); 3] = [("tolerance", "1e-14"), ("ls_tolerance", "1e-6"), ("iterations", "200")];

/// A golden's states in worlds, and the forces that they have for its accelerations.
fn inverted(golden: &Golden, qacc: &[f64], options: &Options) -> Vec<f64> {
    let mut worlds = Worlds::new(&golden.model, golden.states(), options).expect("a batch");
    for (name, array) in golden.inputs() {
        let field = Field::ALL.iter().find(|(_, known)| *known == name).expect("a field").0;
        let rows = golden.rows(&array.to_f64());
        rows.iter().enumerate().for_each(|(world, row)| worlds.set(field, world, row).expect("a state"));
    }
    worlds.inverse(qacc).expect("forces")
}

/// Forces in every recorded state against MuJoCo's, continuous or of a step by an integrator.
fn check(over_step: Option<&str>, precision: Precision, tolerance: f64) {
    let mut failures = Failures::default();
    let overrides = over_step.map(|integrator| [("integrator", integrator), ("invdiscrete", "enable")]);
    let field = over_step.map_or("inverse/qfrc_inverse".into(), |i| format!("inverse/qfrc_inverse_{i}"));
    for name in all_models() {
        if over_step == Some("discrete") && NOT_DISCRETE.contains(&&*name) {
            continue;
        }
        let golden = Golden::read_with(&name, overrides.as_ref().map_or(&[], |all| &all[..]));
        let recorded = golden.steps();
        let (Some(qacc), Some(expected)) = (recorded.get("inverse/qacc"), recorded.get(&field)) else { continue };
        let expected = golden.rows(&expected.to_f64());
        for backend in BACKENDS {
            let ours = golden.rows(&inverted(&golden, &qacc.to_f64(), &options(precision, backend)));
            for (state, (got, expected)) in ours.iter().zip(&expected).enumerate() {
                failures.check(|| format!("{name} state {state} {backend:?}"), agree(got, expected, tolerance, 1.0));
            }
        }
    }
    failures.report();
}

#[test]
fn forces_are_mujocos_f64() {
    check(None, Precision::F64, 1e-9);
}

/// The force is what is left of terms that are much larger.
#[test]
fn forces_are_mujocos_f32() {
    check(None, Precision::F32, 5e-3);
}

#[test]
fn forces_of_steps_are_mujocos() {
    for integrator in ["Euler", "implicitfast", "implicit", "discrete"] {
        check(Some(integrator), Precision::F64, 1e-9);
    }
}

/// Worlds in contact, under control noise and forces from outside.
fn touching(model: &Model, nworld: usize) -> Worlds {
    let (mut worlds, sizes) =
        (Worlds::new(model, 4 * nworld, &Options::default()).expect("a batch"), &model.tables().sizes);
    let noise = Rollout { nstep: 300, controls: Controls::Noise { seed: 5, scale: 1.0 }, ..Rollout::default() };
    worlds.rollout(&noise).expect("a rollout");
    let mut found = Vec::new();
    let ncon = Output::named("ncon").expect("an output");
    worlds.forward(&[ncon], &mut |world, values| found.extend((values[0][0] > 0.0).then_some(world))).expect("outputs");
    assert!(found.len() >= nworld, "only {} worlds of {} touch anything", found.len(), model.name());
    let mut chosen = Worlds::new(model, nworld, &Options::default()).expect("a batch");
    for (world, from) in found.into_iter().take(nworld).enumerate() {
        for field in [Field::Qpos, Field::Qvel, Field::Ctrl, Field::QaccWarmstart] {
            chosen.set(field, world, &worlds.get(field, from).expect("a state")).expect("a state");
        }
        let mut random = Random(world as u64);
        chosen.set(Field::QfrcApplied, world, &random.vector(sizes.nv, 0.5)).expect("forces");
        chosen.set(Field::XfrcApplied, world, &random.vector(6 * sizes.nbody, 0.5)).expect("forces");
    }
    chosen
}

/// An output of all worlds.
fn all(worlds: &mut Worlds, name: &str) -> Vec<f64> {
    let mut out = Vec::new();
    worlds
        .forward(&[Output::named(name).expect("an output")], &mut |_, values| out.extend(&values[0]))
        .expect("outputs");
    out
}

/// What came in from actuators and from outside: the smooth force without what the inverse leaves on the left.
fn applied(worlds: &mut Worlds) -> Vec<f64> {
    let [smooth, bias, passive] = ["qfrc_smooth", "qfrc_bias", "qfrc_passive"].map(|name| all(worlds, name));
    (0..smooth.len()).map(|i| smooth[i] + bias[i] - passive[i]).collect()
}

#[track_caller]
fn assert_rows(what: &str, got: &[f64], expected: &[f64], nv: usize) {
    for (world, (got, expected)) in got.chunks(nv).zip(expected.chunks(nv)).enumerate() {
        if let Err(problem) = agree(got, expected, 1e-9, 1.0) {
            panic!("{what} world {world}{problem}");
        }
    }
}

#[test]
fn inverse_after_forward_gives_back_what_was_applied() {
    for name in TOUCHING {
        let model = load_with(name, &CONVERGED);
        let mut worlds = touching(&model, 256);
        let (qacc, expected) = (all(&mut worlds, "qacc"), applied(&mut worlds));
        let got = worlds.inverse(&qacc).expect("forces");
        assert_rows(name, &got, &expected, model.tables().sizes.nv);
    }
}

#[test]
fn inverse_after_a_step_gives_back_what_was_applied() {
    for name in TOUCHING {
        for integrator in ["Euler", "implicitfast", "implicit", "discrete"] {
            let overrides = [&CONVERGED[..], &[("integrator", integrator), ("invdiscrete", "enable")]].concat();
            let model = load_with(name, &overrides);
            let (h, nv) = (model.tables().options.timestep, model.tables().sizes.nv);
            let mut worlds = touching(&model, 256);
            let expected = applied(&mut worlds);
            let [before, qpos] = [Field::Qvel, Field::Qpos].map(|field| worlds.get_all(field));
            worlds.step(1).expect("a step");
            assert_eq!(worlds.lost(), 0);
            let after = worlds.get_all(Field::Qvel);
            let qacc: Vec<f64> = after.iter().zip(&before).map(|(new, old)| (new - old) / h).collect();
            for world in 0..worlds.nworld() {
                worlds.set(Field::Qvel, world, &before[world * nv..][..nv]).expect("a state");
                let nq = model.tables().sizes.nq;
                worlds.set(Field::Qpos, world, &qpos[world * nq..][..nq]).expect("a state");
            }
            let got = worlds.inverse(&qacc).expect("forces");
            assert_rows(&format!("{name} {integrator}"), &got, &expected, nv);
        }
    }
}

/// A world's forces are the same bits however it is worked on, and nothing of its state changes.
#[test]
fn forces_have_the_same_bits_everywhere() {
    for (name, integrator) in
        [("zoo/humanoid27", "Euler"), ("unit/implicit", "implicit"), ("zoo/chain31", "implicitfast")]
    {
        for flag in ["disable", "enable"] {
            let model = load_with(name, &[("integrator", integrator), ("invdiscrete", flag)]);
            let nv = model.tables().sizes.nv;
            for precision in [Precision::F64, Precision::F32] {
                let run = |backend: Backend, ids: &[u64], threads: usize| {
                    let options = Options { threads: Some(threads), ..options(precision, backend) };
                    let mut worlds = Worlds::new(&model, ids.len(), &options).expect("a batch");
                    let mut qacc = Vec::new();
                    for (world, id) in ids.iter().enumerate() {
                        let mut random = Random(*id);
                        worlds.set(Field::Qvel, world, &random.vector(nv, 1.0)).expect("a state");
                        qacc.extend(random.vector(nv, 10.0));
                    }
                    worlds.step(20).expect("steps");
                    let before = worlds.state_hash();
                    let got = worlds.inverse(&qacc).expect("forces");
                    assert_eq!(worlds.state_hash(), before);
                    got.chunks(nv).map(|row| row.iter().map(|x| x.to_bits()).collect()).collect::<Vec<Vec<u64>>>()
                };
                let ids: Vec<u64> = (0..40).collect();
                let alone = run(Backend::Scalar, &ids, 1);
                let turned: Vec<u64> = (0..40).map(|i| (i * 7 + 3) % 40).collect();
                for backend in [Backend::Native, Backend::Wide] {
                    let got = run(backend, &turned, 2);
                    for (id, got) in turned.iter().zip(got) {
                        assert!(got == alone[*id as usize], "{name} {precision:?} {backend:?} {id}");
                    }
                }
            }
        }
    }
}

fn array(shape: &[usize], values: Vec<f64>) -> Array {
    Array::new(shape.to_vec(), Data::F64(values)).expect("an array")
}

/// A falling sphere needs no force, one that hovers its weight; over whole trajectories.
#[test]
fn trajectories_are_inverted() {
    let model = support::parse(
        "<mujoco><option gravity='0 0 -10'/><worldbody><body><freejoint/><geom size='.1' mass='3'/></body></worldbody></mujoco>",
    );
    let (nworld, nstep) = (2, 3);
    let states = nworld * nstep;
    let qpos = [0.0, 0.0, 5.0, 1.0, 0.0, 0.0, 0.0].repeat(states);
    let fall = |i: usize| if i % 6 == 2 && (i / 6).is_multiple_of(2) { -10.0 } else { 0.0 };
    let qacc: Vec<f64> = (0..6 * states).map(fall).collect();
    let inputs = BTreeMap::from([
        ("qpos".to_string(), array(&[nworld, nstep, 7], qpos)),
        ("qvel".to_string(), array(&[nworld, nstep, 6], vec![0.0; 6 * states])),
        ("qacc".to_string(), array(&[nworld, nstep, 6], qacc)),
    ]);
    let forces = inverse(&model, &inputs, &Options::default()).expect("forces");
    assert_eq!(forces.shape(), [nworld, nstep, 6]);
    for (i, force) in forces.to_f64().iter().enumerate() {
        let expected = if i % 6 == 2 && i / 6 % 2 == 1 { 30.0 } else { 0.0 };
        assert!((force - expected).abs() < 1e-12, "{i}: {force}");
    }
}

#[test]
fn bad_input_is_named() {
    let model = load("zoo/cartpole");
    let sizes = model.tables().sizes.clone();
    let mut worlds = Worlds::new(&model, 2, &Options::default()).expect("a batch");
    fails(worlds.inverse(&[0.0; 3]), "array `qacc` has 3 numbers; expected as many as its shape [2, 2] has");
    fails(worlds.inverse(&[0.0, 0.0, f64::NAN, 0.0]), "array `qacc` holds NaN at [1, 0]; every number must be finite");
    let given =
        |name: &str, rows: usize, width: usize| (name.to_string(), array(&[rows, width], vec![0.0; rows * width]));
    let run = |inputs: Vec<(String, Array)>| inverse(&model, &inputs.into_iter().collect(), &Options::default());
    let [nq, nv] = [sizes.nq, sizes.nv];
    fails(run(vec![given("qpos", 3, nq), given("qvel", 3, nv)]), "there is no array qacc; give qpos, qvel and qacc");
    fails(
        run(vec![given("qpos", 3, nq), given("qvel", 2, nv), given("qacc", 3, nv)]),
        "qvel has leading dimensions [2] and qpos has [3]; give all arrays for the same states",
    );
    fails(run(vec![given("qpos", 3, nq), given("qvle", 3, nv)]), "unknown input array qvle; did you mean \"qvel\"?");
    fails(run(vec![given("qpos", 3, nq + 1)]), "qpos has shape [3, 3]; expected [N, 2] or [nworld, nstep, 2]");
    let nan = ("qacc".to_string(), array(&[1, nv], vec![0.0, f64::INFINITY]));
    fails(run(vec![given("qpos", 1, nq), given("qvel", 1, nv), nan]), "array `qacc` holds inf at [0, 1]");
    let short = ("qacc".to_string(), array(&[3, 4, nv], vec![0.0; 12 * nv]));
    let long = |name: &str, width: usize| (name.to_string(), array(&[3, 5, width], vec![0.0; 15 * width]));
    fails(
        run(vec![long("qpos", nq), long("qvel", nv), short]),
        "qpos has leading dimensions [3, 5] and qacc has [3, 4]; give all arrays for the same states",
    );
}

/// What is not active pulls at nothing.
#[test]
fn active_constraints_are_an_input() {
    let model = load("zoo/four_bar");
    let sizes = &model.tables().sizes;
    let mut inputs = BTreeMap::from([
        ("qpos".to_string(), array(&[2, sizes.nq], vec![0.2; 2 * sizes.nq])),
        ("qvel".to_string(), array(&[2, sizes.nv], vec![0.0; 2 * sizes.nv])),
        ("qacc".to_string(), array(&[2, sizes.nv], vec![0.0; 2 * sizes.nv])),
    ]);
    let run = |inputs: &BTreeMap<String, Array>| {
        inverse(&model, inputs, &Options::default()).map(|forces| forces.to_f64().into_owned())
    };
    let all = run(&inputs).expect("forces");
    let active = [vec![1.0; sizes.neq], vec![0.0; sizes.neq]].concat();
    inputs.insert("eq_active".into(), array(&[2, sizes.neq], active));
    let some = run(&inputs).expect("forces");
    assert_eq!(some[..sizes.nv], all[..sizes.nv]);
    let off = load_with("zoo/four_bar", &[("equality", "disable")]);
    inputs.remove("eq_active");
    let none = inverse(&off, &inputs, &Options::default()).expect("forces").to_f64().into_owned();
    assert_eq!(some[sizes.nv..], none[sizes.nv..]);
    assert!((some[sizes.nv] - all[sizes.nv]).abs() > 1e-3);
    inputs.insert("eq_active".into(), array(&[2, sizes.neq], vec![0.5; 2 * sizes.neq]));
    fails(run(&inputs), "array `eq_active` holds 0.5; expected 0 or 1");
}

/// The acceleration over a step of four evaluations does not tell what any of them found.
#[test]
fn steps_of_runge_kutta_are_not_inverted() {
    let model = load_with("zoo/cartpole", &[("integrator", "RK4"), ("invdiscrete", "enable")]);
    let mut worlds = Worlds::new(&model, 1, &Options::default()).expect("a batch");
    fails(
        worlds.inverse(&[0.0; 2]),
        "flag invdiscrete: inverse dynamics of a step do not go with integrator RK4, which evaluates other states (set \
         integrator=\"implicitfast\", or leave out invdiscrete)",
    );
    let continuous = load_with("zoo/cartpole", &[("integrator", "RK4")]);
    assert!(Worlds::new(&continuous, 1, &Options::default()).expect("a batch").inverse(&[0.0; 2]).is_ok());
}

/// Worlds that are frozen, or whose state cannot be stepped, have no forces; their neighbours do.
#[test]
fn lost_worlds_have_no_forces() {
    let model = load("zoo/cartpole");
    let mut worlds = Worlds::new(&model, 3, &Options::default()).expect("a batch");
    worlds.set_unchecked(Field::Qvel, 1, &[f64::NAN, 0.0]).expect("a state");
    let forces = worlds.inverse(&[1.0; 6]).expect("forces");
    assert!(forces[2..4].iter().all(|f| f.is_nan()) && forces[..2].iter().chain(&forces[4..]).all(|f| f.is_finite()));
    assert_eq!(worlds.lost(), 0);
}
